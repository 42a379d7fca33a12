"""What was found of all images that were to be localized."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath
from nonsac.layouts import Array


@dataclass(frozen=True, eq=False)
class LocalizedImage:
    """What was found of an image.

    Attributes
    ----------
    name : str
    status : str
        That of the result; "failed" if there is none.
    T : (4, 4) or None
        From the world to the camera; None if it is not to be trusted.
    num_matches, num_inliers : int
    confidence : float
    noise : float or None
        In pixels.
    remarks : tuple of str
    error : str or None
        Why it has failed.
    camera : str or None
        As a line of COLMAP's cameras.txt.
    """

    name: str
    status: str
    T: Array | None = None
    num_matches: int = 0
    num_inliers: int = 0
    confidence: float = 0.0
    noise: float | None = None
    remarks: tuple[str, ...] = ()
    error: str | None = None
    camera: str | None = None

    @classmethod
    def of_record(cls, record: dict[str, Any]) -> Self:
        """From what `to_dict` gave."""
        T = None if record["T"] is None else np.array(record["T"])
        return cls(**record | {"T": T, "remarks": tuple(record["remarks"])})

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return self.__dict__ | {"T": None if self.T is None else self.T.tolist()}


@dataclass(frozen=True, eq=False)
class Localization:
    """What was found of all images, and the noise that they share, in pixels."""

    images: tuple[LocalizedImage, ...]
    noise: float | None = None
    seconds: float = field(default=0.0)

    @property
    def statuses(self) -> Counter[str]:
        """How many images ended in which way."""
        return Counter(image.status for image in self.images)

    def write(self, path: FilePath) -> None:
        """Write a line of JSON for each image."""
        text = "".join(json.dumps(image.to_dict()) + "\n" for image in self.images)
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))

    def to_dict(self) -> dict[str, Any]:
        """What `print` shows, ready for JSON."""
        facts = {"images": len(self.images), "statuses": dict(self.statuses)}
        return facts | {"noise": self.noise, "seconds": self.seconds}

    def __str__(self) -> str:
        statuses = self.statuses
        lines = [f"{len(self.images):,} images, {statuses['ok']:,} localized"]
        if self.noise is not None:
            lines[0] += f"; noise {self.noise:.3g} pixels"
        return "\n".join(
            [*lines, *(f"  {n:9,}  {s.replace('_', ' ')}" for s, n in statuses.most_common() if s != "ok")]
        )
