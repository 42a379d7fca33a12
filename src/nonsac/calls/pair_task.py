"""The verification of one pair of images, where it is sent to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nonsac.calls.fallback import view_by_pycolmap
from nonsac.calls.jobs import Job
from nonsac.calls.pair_records import VerifiedPair, pair_of_result, record_of, warnings_told
from nonsac.calls.pooling import PooledRun
from nonsac.calls.two_views import view_of
from nonsac.cameras.camera import Camera
from nonsac.cameras.unreadable import UnreadableCamera
from nonsac.files.errors import in_one_line
from nonsac.io.correspondences import Matches

_GUESSED = "focal lengths are guesses of COLMAP's (--trust-focal-lengths, or --fallback pycolmap)"
_UNKNOWN_MODEL = "the model of a camera is not known here"


@dataclass(frozen=True, eq=False)
class PairItem:
    """What travels to a worker.

    Attributes
    ----------
    names : two names of images
    matches : Matches
        With cameras.
    has_known_focal_lengths : bool
        Whether these may be relied on.
    """

    names: tuple[str, str]
    matches: Matches
    has_known_focal_lengths: bool

    @property
    def flaw(self) -> str | None:
        """Why no pose can be found with these cameras."""
        if any(isinstance(camera, UnreadableCamera) for camera in (self.matches.camera1, self.matches.camera2)):
            return _UNKNOWN_MODEL
        return None if self.has_known_focal_lengths else _GUESSED

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """Of both images."""
        first, second = self.matches.camera1, self.matches.camera2
        assert first is not None
        assert second is not None
        return Camera.parse(first, "camera1"), Camera.parse(second, "camera2")

    def without_row(self, status: str, remarks: tuple[str, ...] = (), error: str | None = None) -> dict[str, Any]:
        """The record of a pair whose row is left as it is."""
        count = len(self.matches)
        return record_of(VerifiedPair(*self.names, "undefined", status, count, remarks=remarks, error=error), None)

    def failed(self, error: Exception) -> dict[str, Any]:
        """The record of a pair that could not be verified."""
        return self.without_row("failed", error=in_one_line(error))


@dataclass(frozen=True)
class PairTask:
    """Verifies a pair, and brings back the record of it.

    Attributes
    ----------
    noise : float or None
        What pairs of the scene share.
    fallback : str
        See `nonsac.calls.fallback`.
    settings : dict
        Of `relative_pose`.
    """

    noise: float | None
    fallback: str
    settings: dict[str, Any]

    def __call__(self, item: PairItem) -> dict[str, Any]:
        if item.flaw is not None:
            return self._without_cameras(item, item.flaw)
        matches, cameras = item.matches, item.cameras
        settings = self.settings | {"camera1": cameras[0], "camera2": cameras[1]}
        with warnings_told() as told:
            job = Job("relative_pose", matches.points1, matches.points2, **settings)
            result = PooledRun(self.noise)(job)
            view = view_of(result, matches, cameras)
        return record_of(pair_of_result(item.names, result, view, told), view)

    def _without_cameras(self, item: PairItem, flaw: str) -> dict[str, Any]:
        if self.fallback == "skip" or flaw == _UNKNOWN_MODEL:
            return item.without_row("skipped", (flaw,))
        view = view_by_pycolmap(item.matches)
        kind, count = view.geometry.config.name.lower(), int(view.inliers.sum())
        pair = VerifiedPair(*item.names, kind, "fallback", len(item.matches), count, remarks=(flaw,))
        return record_of(pair, view)
