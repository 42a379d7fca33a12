"""The core estimators by name: what each is for, where it is, and what it needs."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import cast

from nonsac.estimators.contract import Estimator
from nonsac.estimators.external import External
from nonsac.problems.contract import Problem
from nonsac.problems.registration import Registration


@dataclass(frozen=True)
class Named:
    """An estimator that can be asked for by name.

    Attributes
    ----------
    where : str
        `module:function` in `nonsac.estimators`. The function makes the estimator for a problem; the module is not
        imported before.
    about : str
        What it is, and whose, in one line.
    problems : tuple of str
        Classes of problems that it is for; any problem if there are none.
    needs : str or None
        Module of another library.
    extra : str or None
        The extra of this package that installs it, `pip install "nonsac[extra]"`.
    weighted : bool
        Whether it needs rows with weights.
    """

    where: str
    about: str
    problems: tuple[str, ...] = ()
    needs: str | None = None
    extra: str | None = None
    weighted: bool = False

    def fits(self, problem: Problem) -> bool:
        """Whether it is for this kind of problem; its own `check` has the last word."""
        return not self.problems or any(base.__name__ in self.problems for base in type(problem).__mro__)

    @property
    def is_installed(self) -> bool:
        return self.needs is None or find_spec(self.needs) is not None

    def made_for(self, problem: Problem) -> Estimator:
        module, function = self.where.split(":")
        return cast(Estimator, getattr(import_module(f"nonsac.estimators.{module}"), function)(problem))


_PAIRS, _TWO_VIEWS, _ONE_VIEW = ("Registration",), ("RelativePose",), ("AbsolutePose",)
_POSES = _TWO_VIEWS + _ONE_VIEW
_KINDS = {"Registration": "3D registrations", "RelativePose": "relative poses", "AbsolutePose": "absolute poses"}


def _other(where: str, about: str, problems: tuple[str, ...], needs: str, extra: str) -> Named:
    """A search of another library."""
    return Named(f"others.{where}", about, problems, needs, extra)


ESTIMATORS: dict[str, Named] = {
    "ransac": Named("ransac:default", "RANSAC with local optimisation and early stopping (Fischler 1981, Chum 2003)"),
    "pcr99": Named("pcr99:default", "PCR-99, pairs ranked by consistency (Lee et al. 2024; NONSAC, Sec. 4.3)", _PAIRS),
    "msac": Named("usac:msac", "RANSAC with a truncated quadratic score (Torr and Zisserman 2000)"),
    "lo-ransac": Named("inner_ransac:lo_ransac", "RANSAC with an inner RANSAC among inliers (Chum et al. 2003)"),
    "prosac": Named(
        "prosac:prosac", "PROSAC, rows drawn in the order of their weights (Chum and Matas 2005)", weighted=True
    ),
    "magsac": Named("usac:magsac", "MAGSAC++, a score and a fit without one noise level (Barath et al. 2020)"),
    "gc-ransac": Named("graph_cut:gc_ransac", "RANSAC, inliers labelled with their neighbours (Barath and Matas 2018)"),
    "gnc-tls": Named("graduated:gnc_tls", "Graduated non-convexity, truncated least squares (Yang et al. 2020)"),
    "gnc-gm": Named("graduated:gnc_gm", "Graduated non-convexity, Geman-McClure loss (Yang et al. 2020)"),
    "irls": Named("graduated:irls", "Reweighted least squares, a truncation that shrinks (after Peng et al. 2023)"),
    "hough": Named("hough:hough", "Randomised Hough transform for rotations (Xu et al. 1990)", _PAIRS),
    "sc2-pcr": Named("sc2_pcr:default", "SC2-PCR, second-order consistency around seeds (Chen et al. 2022)", _PAIRS),
    "teaser": Named("teaser:default", "TEASER++, the largest clique, then GNC and votes (Yang et al. 2021)", _PAIRS),
    "mac": Named("mac:default", "MAC, the heaviest maximal cliques (Zhang et al. 2023)", _PAIRS),
    "turboreg": Named("turboreg:default", "TurboReg, the best triangles on the best edges (Yan et al. 2025)", _PAIRS),
    "gore": Named("gore:default", "GORE, outliers removed with a guarantee, then RANSAC (Parra, Chin 2018)", _PAIRS),
    "tr-de": Named("tr_de:default", "TR-DE, branch and bound over axis, then angle (Chen et al. 2022)", _PAIRS),
    "tear": Named("tear:default", "TEAR, branch and bound on absolute residuals (Huang et al. 2024)", _PAIRS),
    "poselib": _other("poselib:default", "PoseLib's LO-RANSAC (Larsson 2020)", _POSES, "poselib", "poselib"),
    "pycolmap": _other("pycolmap:default", "COLMAP's LO-RANSAC (Schönberger 2016)", _POSES, "pycolmap", "pycolmap"),
    "opencv": _other("opencv:default", "OpenCV's USAC (Raguram 2013)", _POSES, "cv2", "opencv"),
    "opencv-accurate": _other(
        "opencv:accurate", "OpenCV's USAC with graph cuts (Barath and Matas 2018)", _POSES, "cv2", "opencv"
    ),
    "opencv-magsac": _other("opencv:magsac", "OpenCV's MAGSAC++ (Barath et al. 2020)", _TWO_VIEWS, "cv2", "opencv"),
    "opencv-p3p": _other("opencv:p3p", "OpenCV's solvePnPRansac with P3P", _ONE_VIEW, "cv2", "opencv"),
    "opencv-sqpnp": _other(
        "opencv:sqpnp", "OpenCV's USAC, its inliers fitted by SQPnP (Terzakis 2020)", _ONE_VIEW, "cv2", "opencv"
    ),
    "kiss-matcher": _other(
        "kiss_matcher:default", "KISS-Matcher's solver (Lim et al. 2025)", _PAIRS, "kiss_matcher", "kiss-matcher"
    ),
    "open3d-ransac": _other("open3d:ransac", "Open3D's RANSAC (Zhou et al. 2018)", _PAIRS, "open3d", "open3d"),
    "open3d-fgr": _other(
        "open3d:fast_global", "Open3D's fast global registration (Zhou et al. 2016)", _PAIRS, "open3d", "open3d"
    ),
}


def default_estimator(problem: Problem) -> str:
    """The name of the estimator that is used if none is given."""
    return "pcr99" if isinstance(problem, Registration) else "ransac"


def estimators_for(problem: Problem) -> list[str]:
    """The names of those that are for a problem, installed or not."""
    return [name for name, named in ESTIMATORS.items() if named.fits(problem)]


def chosen_estimator(estimator: object, problem: Problem) -> Estimator:
    """The estimator that was given: as an object, a name, a function (see `External`), or None for the default.

    Raises
    ------
    TypeError, ValueError
        If it is none of these, cannot work on the problem, or needs what is not installed.
    """
    if estimator is None:
        estimator = default_estimator(problem)
    if isinstance(estimator, str):
        chosen = _by_name(estimator, problem)
    elif isinstance(estimator, Estimator):
        chosen = estimator
    elif callable(estimator) and not isinstance(estimator, type):
        chosen = External(estimator)
    else:
        raise TypeError(
            "estimator must be a name, a function of (values, threshold, seed), or an object of a class derived from "
            f"nonsac.Estimator, got {_told(estimator)}"
        )
    chosen.check(problem)
    return chosen


def _by_name(name: str, problem: Problem) -> Estimator:
    if name not in ESTIMATORS:
        raise ValueError(f"estimator must be one of {', '.join(estimators_for(problem))}, or an object, got {name!r}")
    named = ESTIMATORS[name]
    if not named.fits(problem):
        kinds = " and ".join(_KINDS.get(kind, kind) for kind in named.problems)
        raise TypeError(f"{name} is for {kinds}, got {type(problem).__name__}")
    if not named.is_installed:
        raise ValueError(f'{name} needs {named.needs}, which is not installed: pip install "nonsac[{named.extra}]"')
    return named.made_for(problem)


def _told(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
