"""Core estimators: each finds one robust model in one non-minimal sample."""

from nonsac.estimators.contract import Estimator
from nonsac.estimators.external import External
from nonsac.estimators.pcr99 import Pcr99
from nonsac.estimators.ransac import Ransac

__all__ = ["Estimator", "External", "Pcr99", "Ransac"]
