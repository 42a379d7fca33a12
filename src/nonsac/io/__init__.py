"""Read and write point clouds, pairs of matched points, and transforms."""

from nonsac.io.atomic import check_target, write_atomically
from nonsac.io.clouds import read_cloud, write_cloud
from nonsac.io.errors import InputError
from nonsac.io.pairs import read_pairs
from nonsac.io.transforms import read_transform, write_transform

__all__ = [
    "InputError",
    "check_target",
    "read_cloud",
    "read_pairs",
    "read_transform",
    "write_atomically",
    "write_cloud",
    "write_transform",
]
