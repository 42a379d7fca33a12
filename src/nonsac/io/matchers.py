"""Matches as SuperGlue, LightGlue, LoFTR, RoMa, MASt3R, RAFT and others of their kind leave them in NPZ files."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import Archive, as_rows, open_npz
from nonsac.files.errors import FilePath, InputError, input_error
from nonsac.io.correspondences import Matches, Points
from nonsac.io.flow import from_flow
from nonsac.io.warp import from_warp

# Points that match row by row, by what the programs call them.
_MATCHED = (
    ("mkpts0", "mkpts1"),  # LoFTR, EfficientLoFTR, XFeat
    ("mkpts0_f", "mkpts1_f"),
    ("mkpts_0", "mkpts_1"),
    ("matched_kpts0", "matched_kpts1"),
    ("matches_im0", "matches_im1"),  # DUSt3R, MASt3R
    ("kpts0", "kpts1"),  # RoMa, DKM
    ("kptsA", "kptsB"),
    ("kpts1", "kpts2"),
    ("corr0", "corr1"),  # ASpanFormer
    ("points0", "points1"),  # LightGlue
)
# Keypoints of SuperGlue and LightGlue, and which of them match; without that, those of Kornia's LoFTR match row by row.
_KEYPOINTS = ("keypoints0", "keypoints1")
_INDICES = ("matches", "matches0", "matches01")
_BATCH = ("batch_indexes", "m_bids", "b_ids")  # of which pair of a batch each match is: LoFTR
_CONFIDENCE = (
    "match_confidence",
    "matching_scores0",
    "mconf",
    "confidence",
    "certainty",
    "scores",
    "conf",
    "overlaps",  # RoMa v2
    "overlap",
)
_WARP = ("warp", "certainty")  # RoMa, DKM
_SIZES = (("W_A", "H_A", "W_B", "H_B"), ("width0", "height0", "width1", "height1"))
_FLOW, _FLOW_HOLDS = ("flow",), ("certainty", "confidence", "valid", "mask")  # RAFT


def is_of_a_matcher(path: FilePath, but_for: Iterable[Sequence[str]] = ()) -> bool:
    """Whether an NPZ file has keys that a matcher gives, and none of others, going by its directory."""
    if not os.path.isfile(path):  # a pipe can be read once only
        return False
    try:
        with zipfile.ZipFile(path) as file:
            names = {name.removesuffix(".npy") for name in file.namelist()}
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):  # the usual reader says what is wrong
        return False
    if any(set(pair) <= names for pair in but_for):
        return False
    return any(set(pair) <= names for pair in (*_MATCHED, _KEYPOINTS, _WARP, _FLOW))


def read_matcher(path: FilePath) -> Matches:
    """Read the matches of an NPZ file of a matcher, with its confidences as weights.

    Raises
    ------
    InputError
        If the file cannot be read or its arrays do not fit each other.
    """
    with open_npz(path) as archive:
        _check_one_pair(archive)
        pair = next((pair for pair in _MATCHED if set(pair) <= set(archive.names)), None)
        if pair is not None:
            points = [_points(archive, name) for name in pair]
            return _row_by_row(archive, pair, points, _confidence(archive, len(points[0])))
        if not set(_KEYPOINTS) <= set(archive.names):
            return _dense(archive)
        keypoints = [_points(archive, name) for name in _KEYPOINTS]
        name = next((name for name in _INDICES if name in archive.names), None)
        if name is None:
            return _matched_row_by_row(archive, keypoints)
        indices, held = _indices(archive, name, keypoints)
        weights = _confidence(archive, len(held))
        points1, points2 = (points[column] for points, column in zip(keypoints, indices.T, strict=True))
        return Matches(points1, points2, None if weights is None else weights[held], indices=indices)


def _check_one_pair(archive: Archive) -> None:
    """Refuse the matches of a batch of several pairs of images, which no single pose explains."""
    name = next((name for name in _BATCH if name in archive.names), None)
    if name is not None and len(numbers := np.unique(archive.load(name))) > 1:
        problem = f"holds the matches of {len(numbers)} pairs of images (the array {name} tells which)"
        raise input_error(archive.path, problem, "save the matches of each pair in a file of its own")


def _dense(archive: Archive) -> Matches:
    """The matches of a warp whose images have known sizes, or of flow."""
    try:
        if set(_WARP) <= set(archive.names):
            return from_warp(archive.load("warp"), archive.load("certainty"), *_sizes(archive))
        holds = next((name for name in _FLOW_HOLDS if name in archive.names), None)
        return from_flow(archive.load("flow"), None if holds is None else archive.load(holds))
    except InputError:
        raise
    except ValueError as error:
        raise input_error(archive.path, str(error), "save the arrays as the program gave them") from error


def _sizes(archive: Archive) -> tuple[tuple[int, int], tuple[int, int]]:
    """Width and height of both images."""
    keys = next((keys for keys in _SIZES if set(keys) <= set(archive.names)), None)
    if keys is None:
        problem = "holds a dense warp, which needs the sizes of the images to become matches"
        fix = f"save {', '.join(_SIZES[0])} besides, or use nonsac.io.from_warp and save its points1 and points2"
        raise input_error(archive.path, problem, fix)
    lengths = [archive.load(name) for name in keys]
    if any(length.size != 1 or length.dtype.kind not in "iuf" for length in lengths):
        raise input_error(archive.path, f"{', '.join(keys)} must be a number each", "save widths and heights in pixels")
    width1, height1, width2, height2 = (length.item() for length in lengths)
    return (width1, height1), (width2, height2)


def _matched_row_by_row(archive: Archive, keypoints: list[Points]) -> Matches:
    weights = _confidence(archive, len(keypoints[0]))
    if weights is None:
        problem = f"holds keypoints, and nothing says which of them match (its keys are: {', '.join(archive.names)})"
        raise input_error(archive.path, problem, "save matches besides, or the matched points as points1 and points2")
    return _row_by_row(archive, _KEYPOINTS, keypoints, weights)


def _row_by_row(archive: Archive, names: Sequence[str], points: list[Points], weights: Points | None) -> Matches:
    first, second = points
    if len(first) != len(second):
        problem = f"{' and '.join(names)} have {len(first)} and {len(second)} rows, which should match one by one"
        raise input_error(archive.path, problem, "save one row of each for every match")
    return Matches(first, second, weights)


def _points(archive: Archive, name: str) -> Points:
    return as_rows(archive.path, _without_batch(archive.load(name)), 2)


def _without_batch(array: NDArray[Any]) -> NDArray[Any]:
    """The only one of a batch (1, n, 2), as networks give it."""
    return array[0] if array.ndim == 3 and len(array) == 1 else array


def _indices(archive: Archive, name: str, keypoints: list[Points]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Which keypoints match (k, 2), and which rows of the array say so: -1 stands for none."""
    given = _without_batch(archive.load(name))
    if given.dtype.kind not in "iu":
        problem = f"the array {name} has the type {given.dtype}, not whole numbers"
        raise input_error(archive.path, problem, "save the numbers of the keypoints, with -1 for none")
    if given.ndim == 2 and given.shape[0] == 1 and given.shape[1] == len(keypoints[0]):
        given = given[0]
    first, second = len(keypoints[0]), len(keypoints[1])
    if given.shape == (first,):
        pairs = np.column_stack([np.arange(first), given])
    elif given.ndim == 2 and given.shape[1] == 2:
        pairs = given
    else:
        problem = f"the array {name} has the shape {given.shape}, with {first} and {second} keypoints"
        raise input_error(archive.path, problem, f"save one number for each of keypoints0 ({first},), or pairs (k, 2)")
    held: NDArray[np.bool_] = np.asarray((pairs >= 0).all(axis=1))
    pairs = pairs[held].astype(np.int64)
    if len(pairs) and (pairs.max(axis=0) >= (first, second)).any():
        problem = f"the array {name} names a keypoint that is not there (there are {first} and {second})"
        raise input_error(archive.path, problem, "save the keypoints that were matched")
    return pairs, held


def _confidence(archive: Archive, rows: int) -> Points | None:
    """One number for each match, if the file has any."""
    name = next((name for name in _CONFIDENCE if name in archive.names), None)
    if name is None:
        return None
    weights = archive.load(name)
    weights = weights.reshape(-1) if weights.size == rows else weights
    if weights.shape != (rows,) or weights.dtype.kind not in "iufb":
        problem = f"the array {name} has the shape {weights.shape} and the type {weights.dtype}"
        raise input_error(archive.path, problem, f"save one number for every match ({rows},)")
    return weights.astype(np.float64)
