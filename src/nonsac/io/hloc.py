"""Read the matches between two images from the features.h5 and matches.h5 of hloc."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import as_rows
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.files.hdf5 import Parts, open_hdf5, read_dataset
from nonsac.io.correspondences import Matches, Points

_NEEDS = ("the files of hloc", "hloc")


def read_hloc(features: FilePath, matches: FilePath, image1: str, image2: str) -> Matches:
    """Read the matches between two images that hloc has written.

    Parameters
    ----------
    features
        The file of the keypoints, with a group for each image.
    matches
        The file of the matches of these keypoints, with a group for each pair of images.
    image1, image2
        Names of the images, such as ``db/1.jpg``, in either order.

    Returns
    -------
    Matches
        The matches, with the matching scores as weights and with the indices of the keypoints. As hloc stores
        them, (0, 0) is the centre of the top-left pixel; COLMAP has (0.5, 0.5) there, so add 0.5 to the points
        before they meet a camera from COLMAP. There may be no match, as far as hloc found none.

    Raises
    ------
    InputError
        If h5py is missing, a file cannot be read, is no HDF5 file, is truncated or damaged, does not hold the
        images or the pair, or the files do not fit each other.
    """
    with open_hdf5(features, *_NEEDS) as file:
        keypoints = [_read_keypoints(features, file, image) for image in (image1, image2)]
    with open_hdf5(matches, *_NEEDS) as file:
        pair, swapped = _find_pair(matches, file, image1, image2)
        partners = _read(matches, pair, "matches0", "i")
        scores = _read(matches, pair, "matching_scores0", "iuf") if _holds(matches, pair, "matching_scores0") else None
    stored = keypoints[::-1] if swapped else keypoints
    matched = np.flatnonzero(partners >= 0)
    indices = np.column_stack([matched, partners[matched]])
    sizes = {len(stored[0]), len(partners), len(partners if scores is None else scores)}
    if len(sizes) > 1 or indices[:, 1].max(initial=-1) >= len(stored[1]):
        raise input_error(matches, f"does not fit the keypoints in {features}", "give those it was computed from")
    indices = np.array(indices[:, ::-1] if swapped else indices, dtype=np.int64)
    points1, points2 = keypoints[0][indices[:, 0]], keypoints[1][indices[:, 1]]
    weights = None if scores is None else scores[matched].astype(np.float64)
    return Matches(points1, points2, weights, indices=indices)


def _read_keypoints(path: FilePath, file: Any, image: str) -> Points:
    group = _find_group(path, file, image, "keypoints")
    if group is None:
        raise not_held(path, f"keypoints of image {image!r}", _names(file, "keypoints"))
    return as_rows(path, read_dataset(path, group, "keypoints"), 2)


def _find_pair(path: FilePath, file: Any, image1: str, image2: str) -> tuple[Any, bool]:
    """Return the group of a pair of images, and whether the pair is stored in the reverse order."""
    names = [image.replace("/", "-") for image in (image1, image2)]
    # Older versions of hloc have "_" between the names.
    for separator in "/_":
        for swapped in (False, True):
            group = _find_group(path, file, separator.join(reversed(names) if swapped else names), "matches0")
            if group is not None:
                return group, swapped
    raise not_held(path, f"matches of {image1!r} and {image2!r}", _names(file, "matches0"))


def _find_group(path: FilePath, file: Any, name: str, dataset: str) -> Any:
    """Return the group of this name if there is one that holds the data set, else None."""
    group: Any = Parts(path, []).find(file, name) if name else None
    return group if hasattr(group, "keys") and _holds(path, group, dataset) else None


def _holds(path: FilePath, group: Any, dataset: str) -> bool:
    # The operator "in" would open whatever file a link names.
    return hasattr(Parts(path, []).find(group, dataset), "shape")


def _names(file: Any, dataset: str) -> list[str]:
    """Return the names of all groups that hold the data set."""
    names: list[str] = []
    file.visit(lambda name: names.append(name.rpartition("/")[0]) if name.rpartition("/")[2] == dataset else None)
    return names


def _read(path: FilePath, group: Any, name: str, kinds: str) -> NDArray[Any]:
    array = read_dataset(path, group, name)
    if array.ndim != 1 or array.dtype.kind not in kinds:
        problem = f"the data set {name} has the shape {array.shape} and the type {array.dtype}"
        raise input_error(path, problem, "write it with hloc: one number for every keypoint")
    return array
