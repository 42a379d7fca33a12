"""What is kept of a verified pair while others are still at work: lines of JSON, and the row that COLMAP is to get."""

from __future__ import annotations

import base64
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nonsac.calls.two_views import View
from nonsac.io.colmap_pairs import checksum
from nonsac.io.correspondences import Matches
from nonsac.io.two_view_geometry import Configuration
from nonsac.result import Result

_NOT_KEPT = (Configuration.UNDEFINED, Configuration.DEGENERATE, Configuration.WATERMARK)
_ROW, _MATCHES = "row", "checksum"


@dataclass(frozen=True)
class VerifiedPair:
    """What was found of a pair of images.

    Attributes
    ----------
    image1, image2 : str
        The names of the images.
    configuration : str
        COLMAP's kind of geometry, in lower case: "calibrated", "planar", "panoramic", "planar_or_panoramic",
        "watermark", or "degenerate" and "undefined" if the pair is not to be trusted.
    status : str
        That of the result; "fallback" if another method was used, "skipped" or "failed" if none.
    num_matches, num_inliers : int
    confidence : float
    noise : float or None
        In pixels.
    remarks : tuple of str
    error : str or None
        Why the pair has failed.
    """

    image1: str
    image2: str
    configuration: str
    status: str
    num_matches: int
    num_inliers: int = 0
    confidence: float = 0.0
    noise: float | None = None
    remarks: tuple[str, ...] = ()
    error: str | None = None

    @property
    def kept(self) -> bool:
        """Whether a mapper gets its inliers."""
        return self.num_inliers > 0 and Configuration[self.configuration.upper()] not in _NOT_KEPT

    @classmethod
    def of_record(cls, record: dict[str, Any]) -> Self:
        """From the record of `record_of`."""
        fields = {name: value for name, value in record.items() if name not in (_ROW, _MATCHES)}
        return cls(**fields | {"remarks": tuple(record["remarks"])})

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self)


def pair_of_result(names: tuple[str, str], result: Result, view: View, told: list[str]) -> VerifiedPair:
    """What is said of a pair that was estimated; `told` are warnings."""
    measured = result.info.get("measured_noise", result.noise)
    return VerifiedPair(
        *names,
        configuration=view.geometry.config.name.lower(),
        status=str(result.status),
        num_matches=len(view.inliers),
        num_inliers=int(view.inliers.sum()),
        confidence=result.confidence,
        noise=float(measured) if np.isfinite(measured) else None,
        remarks=(*result.remarks, *told),
    )


def record_of(pair: VerifiedPair, view: View | None) -> dict[str, Any]:
    """A pair, and the row of the database, if it is to be written, as text: a tenth of what the inliers would take."""
    row = None
    if view is not None:
        columns = {name: _text(value) for name, value in view.geometry.columns().items()}
        row = {"inliers": _text(np.packbits(view.inliers).tobytes()), "columns": columns}
    return pair.to_dict() | {_ROW: row}


def with_checksum(record: dict[str, Any], matches: Matches) -> dict[str, Any]:
    """The record, with a checksum of the matches that were verified."""
    return record | {_MATCHES: 0 if matches.indices is None else checksum(matches.indices)}


def row_of(record: dict[str, Any]) -> tuple[NDArray[np.bool_], dict[str, Any], int] | None:
    """Which matches are inliers, the columns of the database, and the checksum; None if nothing is to be written."""
    row = record[_ROW]
    if row is None:
        return None
    packed = np.frombuffer(base64.b64decode(row["inliers"]), np.uint8)
    columns = {
        name: base64.b64decode(value) if isinstance(value, str) else value for name, value in row["columns"].items()
    }
    return np.unpackbits(packed, count=record["num_matches"]).astype(bool), columns, int(record[_MATCHES])


def _text(value: bytes | int | None) -> str | int | None:
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


@contextmanager
def warnings_told() -> Iterator[list[str]]:
    """What is warned of within, once it is over, instead of the warnings."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield told
    told += [str(warning.message) for warning in caught if warning.category is UserWarning]
