"""Matches of optical flow, of RAFT and its kind: arrays, and the files of Middlebury and KITTI."""

from __future__ import annotations

import os
import struct
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.files.claims import check_expansion
from nonsac.files.content import content_kind, read_content
from nonsac.files.errors import FilePath, input_error
from nonsac.files.paths import read_head
from nonsac.io.correspondences import Matches
from nonsac.io.dense import checked_count, drawn, numbers_of

_KINDS = {".flo": "Middlebury flow file", ".png": "PNG image"}
_UNKNOWN = 1e9  # Middlebury: where a number is larger, there is no flow
_HEADER = struct.Struct("<4sii")
_PNG_HEADER = struct.Struct(">8sI4sIIBB")
_PNG_START, _PNG_AROUND = 8, 12  # bytes before the first part, and around the data of each
_KITTI_DEPTH, _KITTI_COLOUR = 16, 2  # bits of a channel; RGB


def from_flow(
    flow: ArrayLike,
    certainty: ArrayLike | None = None,
    count: int | None = None,
    rng: int | np.random.Generator | None = 0,
) -> Matches:
    """Turn optical flow into matches: each pixel (x, y) of the first image with (x + u, y + v) of the second.

    Parameters
    ----------
    flow
        How far each pixel moves, in pixels: (H, W, 2), or (2, H, W) or (1, 2, H, W) as networks give it. Tensors are
        taken as well. Of RAFT take the last, unpadded flow. Where it is NaN, infinite or beyond 1e9 there is none.
    certainty
        Shape (H, W), or (1, H, W): 0 where the flow does not hold, as where an occlusion was found; else how much a
        match counts.
    count
        How many matches to draw, without replacement, the more certain the more often; None takes all.
    rng
        Where the draw comes from: a seed, a generator, or None for another draw in every call.

    Returns
    -------
    Matches
        Row by row of the image; (0, 0) is the centre of the top-left pixel, as in OpenCV. Points that leave the second
        image are kept. The weights are the certainties; None without them, or if these were spent on the draw.

    Raises
    ------
    ValueError
        If shapes or values do not fit.
    """
    moves = _moves(numbers_of("flow", flow))
    trust = None if certainty is None else _trust(numbers_of("certainty", certainty), moves.shape[:2])
    count = checked_count(count)
    known = np.ones(moves.shape[:2], bool) if trust is None else trust > 0
    for k in range(2):
        known &= np.abs(moves[:, :, k]) <= _UNKNOWN
    pixels = np.flatnonzero(known)
    chosen, weights = drawn(pixels, None if trust is None else trust.ravel()[pixels], count, rng)
    y, x = np.divmod(chosen, moves.shape[1])
    points1, points2 = np.empty((len(chosen), 2)), np.empty((len(chosen), 2))
    for k, places in enumerate((x, y)):
        points1[:, k] = places
        points2[:, k] = points1[:, k] + moves[y, x, k]
    return Matches(points1, points2, weights)


def is_flow(path: FilePath) -> bool:
    """Whether a file has the name of one of flow, or begins as one."""
    if not os.path.isfile(path):  # a pipe can be read once only
        return False
    suffix = Path(path).suffix.lower()
    return suffix in _KINDS or content_kind(read_head(os.fspath(path), 16)) in _KINDS.values()


def read_flow(path: FilePath) -> Matches:
    """Read the flow of a Middlebury file (.flo), or of a 16-bit PNG as KITTI has it.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, or holds something else; a PNG also if OpenCV is not installed.
    """
    head = read_head(os.fspath(path), 16)
    kind = content_kind(head)
    if kind not in _KINDS.values():
        kind = _KINDS[Path(path).suffix.lower()]
    content = read_content(path, kind)
    if kind == "PNG image":
        return _kitti(path, content)
    return _middlebury(path, content)


def _middlebury(path: FilePath, content: bytes) -> Matches:
    """The four letters PIEH, width and height, and u and v of each pixel in single precision."""
    if len(content) < _HEADER.size:
        raise input_error(path, "is truncated or damaged (it ends within its header)", "copy or save the file again")
    _, width, height = _HEADER.unpack_from(content)
    held = len(content) - _HEADER.size
    if width < 1 or height < 1 or held != 8 * width * height:
        problem = f"is truncated or damaged (its header promises {width} x {height} pixels, it holds {held / 8:g})"
        raise input_error(path, problem, "copy or save the file again")
    return from_flow(np.frombuffer(content, "<f4", offset=_HEADER.size).reshape(height, width, 2))


def _kitti(path: FilePath, content: bytes) -> Matches:
    """Red and green are 64 u + 2^15 and 64 v + 2^15, blue is 0 where there is no flow (Geiger et al. 2012)."""
    if len(content) < _PNG_HEADER.size:
        raise input_error(path, "is truncated or damaged (it ends within its header)", "copy or save the file again")
    _, _, _, width, height, depth, colour = _PNG_HEADER.unpack_from(content)
    if (depth, colour) != (_KITTI_DEPTH, _KITTI_COLOUR):
        problem = "is a picture, not the flow between two images, which has three channels of 16 bits"
        raise input_error(path, problem, "give a file of matches")
    check_expansion(path, "the picture", 3 * width * height, len(content), "save the flow as .npy or .flo")
    if find_spec("cv2") is None:
        problem = "is a PNG of 16 bits, which only OpenCV reads"
        raise input_error(path, problem, 'pip install "nonsac[opencv]", or save the flow as .flo')
    essential = _essential(content)
    channels = None if essential is None else _decoded(essential)
    if channels is None or channels.shape != (height, width, 3) or channels.dtype != np.uint16:
        raise input_error(path, "is truncated or damaged", "copy or save the file again")
    moves = (channels[:, :, :0:-1].astype(np.float32) - 2.0**15) / 64.0  # blue, green, red; exact in single precision
    moves[channels[:, :, 0] == 0] = np.nan
    return from_flow(moves)


def _essential(content: bytes) -> bytes | None:
    """The PNG with nothing but its header and pixels; None if a part is damaged: it might promise any size."""
    kept, place = [content[:_PNG_START]], _PNG_START
    while place + _PNG_AROUND <= len(content):
        length, kind = struct.unpack_from(">I4s", content, place)
        end = place + _PNG_AROUND + length
        told = int.from_bytes(content[end - 4 : end], "big")
        if end > len(content) or zlib.crc32(content[place + 4 : end - 4]) != told:
            return None
        if kind in (b"IHDR", b"IDAT", b"IEND"):
            kept.append(content[place:end])
        if kind == b"IEND":
            return b"".join(kept)
        place = end
    return None


def _decoded(content: bytes) -> NDArray[Any] | None:
    import cv2

    try:
        decoded: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return decoded


def _moves(flow: NDArray[Any]) -> NDArray[Any]:
    """Flow (H, W, 2) of any of its shapes; the two numbers of a pixel are looked for first behind, then in front."""
    alone = flow[0] if flow.ndim == 4 and len(flow) == 1 else flow
    if alone.ndim == 3 and alone.shape[2] == 2:
        return alone
    if alone.ndim == 3 and alone.shape[0] == 2:
        return alone.transpose(1, 2, 0)
    raise ValueError(f"flow has shape {flow.shape}; expected (H, W, 2) or (2, H, W), of one pair of images")


def _trust(certainty: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    alone = certainty.reshape(shape) if certainty.size == np.prod(shape) and certainty.ndim > 2 else certainty
    if alone.shape != shape:
        raise ValueError(f"certainty has shape {certainty.shape}; expected {shape}, as flow has")
    return alone
