"""Simulated data with known ground truth: the paper's generators, in memory or to a file; two scans; odd matches.

Every function takes `rng`, a whole number (a seed) or a NumPy ``Generator``. One seed, one result.
"""

from nonsac.simulate.clouds import CloudPair, cloud_pair
from nonsac.simulate.elephant import demo_scans
from nonsac.simulate.files import to_file
from nonsac.simulate.matches import ImageMatches, Pairs, PointMatches, absolute_pose, registration, relative_pose
from nonsac.simulate.motions import random_rotation
from nonsac.simulate.structured import (
    blobs_in_images,
    blobs_in_space,
    local_displacements,
    moving_object,
    narrow_view,
    periodic_texture,
    statue,
    two_planes,
)

__all__ = [
    "CloudPair",
    "ImageMatches",
    "Pairs",
    "PointMatches",
    "absolute_pose",
    "blobs_in_images",
    "blobs_in_space",
    "cloud_pair",
    "demo_scans",
    "local_displacements",
    "moving_object",
    "narrow_view",
    "periodic_texture",
    "random_rotation",
    "registration",
    "relative_pose",
    "statue",
    "to_file",
    "two_planes",
]
