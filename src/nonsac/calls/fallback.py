"""Pairs of images whose focal lengths nobody knows: left to pycolmap, if it is there."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.calls.two_views import View
from nonsac.io.correspondences import Matches
from nonsac.io.two_view_geometry import Configuration, TwoViewGeometry
from nonsac.values.numeric import shown

FALLBACKS = ("skip", "pycolmap")


def check_fallback(fallback: object) -> None:
    """Refuse what is no fallback, or one that is not installed."""
    if not isinstance(fallback, str) or fallback not in FALLBACKS:
        raise ValueError(f"fallback must be one of {', '.join(map(repr, FALLBACKS))}, got {shown(fallback)}")
    if fallback == "pycolmap" and find_spec("pycolmap") is None:
        raise ValueError("fallback='pycolmap' needs it: pip install pycolmap")


def view_by_pycolmap(matches: Matches) -> View:
    """COLMAP's own geometry of two views, with its default settings, and a seed so that it can be had again."""
    pycolmap: Any = import_module("pycolmap")
    cameras = [pycolmap.Camera(**_described(camera)) for camera in (matches.camera1, matches.camera2)]
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    rows = np.column_stack([np.arange(len(matches))] * 2)
    found = pycolmap.estimate_two_view_geometry(cameras[0], matches.points1, cameras[1], matches.points2, rows, options)
    inliers: NDArray[np.bool_] = np.zeros(len(matches), bool)
    inliers[np.asarray(found.inlier_matches, np.int64).reshape(-1, 2)[:, 0]] = True
    return View(TwoViewGeometry(Configuration(int(found.config)), found.E, found.F, found.H), inliers)


def _described(camera: Any) -> dict[str, Any]:
    assert isinstance(camera, dict)
    return camera
