"""Simulated data with known ground truth: the paper's generators, in memory or to a file, and two scans.

Every function takes `rng`, a whole number (a seed) or a NumPy ``Generator``. One seed, one result.
"""

from nonsac.simulate.clouds import CloudPair, cloud_pair
from nonsac.simulate.elephant import demo_scans
from nonsac.simulate.files import to_file
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
    "to_file",
]
