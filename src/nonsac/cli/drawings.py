"""Pictures of poses. A drawing is made only if it is asked for; there is none for data without a finite point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from nonsac.cli.outputs import Draw

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nonsac.cameras.camera import Camera
    from nonsac.cli.inputs import Cameras, Photo
    from nonsac.layouts import Array
    from nonsac.result import Result


def drawing_of_pair(
    result: Result, first: Array, second: Array, cameras: Cameras, photos: tuple[Photo, Photo]
) -> Draw | None:
    if not _finite_rows(first, second).any():
        return None

    def draw(path: Path, title: str) -> None:
        from nonsac import plot

        if any(camera is not None and "PINHOLE" not in camera.model for camera in cameras):
            title += "; epipolar lines without lens distortion"
        F, size1, size2 = fundamental_matrix(result.T, cameras), _size(cameras[0]), _size(cameras[1])
        plot.two_views(path, first, second, result.inliers, F, size1, size2, *photos, title)

    return draw


def drawing_of_points(
    result: Result, points2d: Array, points3d: Array, camera: Camera | None, photo: Photo
) -> Draw | None:
    if not _finite_rows(points2d, points3d).any():
        return None

    def draw(path: Path, title: str) -> None:
        from nonsac import plot

        projected = project(result.apply(points3d), camera)
        plot.reprojections(path, points2d, projected, result.inliers, _size(camera), photo, title)

    return draw


def _finite_rows(first: Array, second: Array) -> NDArray[Any]:
    import numpy as np

    return np.asarray(np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1))


def fundamental_matrix(T: Array, cameras: Cameras) -> Array:
    """F of x2^T F x1 = 0, in pixels if there are cameras."""
    import numpy as np

    x, y, z = T[:3, 3]
    essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ T[:3, :3]
    inverse1, inverse2 = (np.eye(3) if camera is None else np.linalg.inv(camera.K) for camera in cameras)
    return np.asarray(inverse2.T @ essential @ inverse1)


def project(points: Array, camera: Camera | None) -> Array:
    """Where the camera sees points in its frame; NaN for those that are not in front of it."""
    import numpy as np

    normalised = points[:, :2] / np.where(points[:, 2:] > 0.0, points[:, 2:], np.nan)
    return normalised if camera is None else camera.project(normalised)


def _size(camera: Camera | None) -> tuple[int, int] | None:
    if camera is None or camera.width is None or camera.height is None:
        return None
    return camera.width, camera.height
