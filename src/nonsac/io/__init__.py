"""Read and write point clouds, matches, and transforms."""

from nonsac.files.atomic import check_target, write_atomically
from nonsac.files.errors import InputError
from nonsac.files.masks import check_mask_suffix, write_mask
from nonsac.io.clouds import read_cloud, write_cloud
from nonsac.io.colmap_database import read_colmap_pair, write_two_view_geometry
from nonsac.io.colmap_model import read_colmap_points, read_colmap_pose
from nonsac.io.correspondences import Matches, PointMatches
from nonsac.io.hloc import read_hloc
from nonsac.io.matches import read_matches, read_points
from nonsac.io.pairs import read_pairs
from nonsac.io.transforms import read_transform, write_transform
from nonsac.io.warp import from_warp

__all__ = [
    "InputError",
    "Matches",
    "PointMatches",
    "check_mask_suffix",
    "check_target",
    "from_warp",
    "read_cloud",
    "read_colmap_pair",
    "read_colmap_points",
    "read_colmap_pose",
    "read_hloc",
    "read_matches",
    "read_pairs",
    "read_points",
    "read_transform",
    "write_atomically",
    "write_cloud",
    "write_mask",
    "write_transform",
    "write_two_view_geometry",
]
