"""Simulated data with known ground truth: the paper's generators, and two scans to look at.

Every function takes `rng`, a whole number (a seed) or a NumPy ``Generator``. One seed, one result.
"""

from nonsac.simulate.clouds import CloudPair, cloud_pair
from nonsac.simulate.elephant import demo_scans
from nonsac.simulate.matches import ImageMatches, Pairs, PointMatches, absolute_pose, registration, relative_pose
from nonsac.simulate.motions import random_rotation

__all__ = [
    "CloudPair",
    "ImageMatches",
    "Pairs",
    "PointMatches",
    "absolute_pose",
    "cloud_pair",
    "demo_scans",
    "random_rotation",
    "registration",
    "relative_pose",
]
