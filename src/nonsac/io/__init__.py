"""Read and write point clouds, matches, and transforms."""

from nonsac.files.errors import InputError
from nonsac.io.clouds import read_cloud, write_cloud
from nonsac.io.colmap_database import read_colmap_pair, write_two_view_geometry
from nonsac.io.colmap_model import read_colmap_points, read_colmap_pose
from nonsac.io.correspondences import Matches, PointMatches
from nonsac.io.flow import from_flow
from nonsac.io.hloc import read_hloc
from nonsac.io.matches import Opened, open_matches, read_matches, read_pairs, read_points
from nonsac.io.transforms import read_transform, read_truth, write_transform
from nonsac.io.warp import from_warp

__all__ = [
    "InputError",
    "Matches",
    "Opened",
    "PointMatches",
    "from_flow",
    "from_warp",
    "open_matches",
    "read_cloud",
    "read_colmap_pair",
    "read_colmap_points",
    "read_colmap_pose",
    "read_hloc",
    "read_matches",
    "read_pairs",
    "read_points",
    "read_transform",
    "read_truth",
    "write_cloud",
    "write_transform",
    "write_two_view_geometry",
]
