"""Read the matches between two images from the HDF5 files of hloc, and from those of DISK, kornia and others."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import as_rows
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.files.hdf5 import Parts, nodes_of, open_hdf5, read_dataset
from nonsac.io.correspondences import Matches, Points

_NEEDS = ("the files of hloc", "hloc")
_MOST_KEYPOINTS = 2**62


def read_hloc(features: FilePath, matches: FilePath, image1: str, image2: str) -> Matches:
    """Read the matches between two images that hloc, or DISK, kornia or deep-image-matching have written.

    Parameters
    ----------
    features
        The file of the keypoints: of hloc, with a group for each image that holds the array ``keypoints``; or with an
        array (n, 2) for each image.
    matches
        The file of the matches of these keypoints: of hloc, with a group for each pair of images; or with a group for
        the first image, which holds an array (k, 2) or (2, k) for the second one; or with such an array for each pair,
        whose name has a hyphen between the images, as the image matching challenge (IMC) has it.
    image1, image2
        Names of the images, such as ``db/1.jpg``, in either order.

    Returns
    -------
    Matches
        The matches, with the matching scores as weights, if hloc wrote some, and with the indices of the keypoints. As
        they are stored, (0, 0) is the centre of the top-left pixel; COLMAP has (0.5, 0.5) there, so add 0.5 to the
        points before they meet a camera from COLMAP. There may be no match, as far as none was found.

    Raises
    ------
    InputError
        If h5py is missing, a file cannot be read, is no HDF5 file, is truncated or damaged, does not hold the
        images or the pair, or the files do not fit each other.
    """
    with HlocFiles.open(features, matches) as files:
        return files.read(image1, image2)


@dataclass(frozen=True, eq=False)
class HlocFiles:
    """Features and matches that are open."""

    names: tuple[FilePath, FilePath]
    features: Any
    matches: Any

    @classmethod
    @contextmanager
    def open(cls, features: FilePath, matches: FilePath) -> Iterator[Self]:
        """Open both files; raises what `read_hloc` raises."""
        with open_hdf5(features, *_NEEDS) as of_images, open_hdf5(matches, *_NEEDS) as of_pairs:
            yield cls((features, matches), of_images, of_pairs)

    def keypoints(self, image: str) -> Points:
        """Those of an image (n, 2), as they are stored."""
        return _read_keypoints(self.names[0], self.features, image)

    def read(self, image1: str, image2: str) -> Matches:
        """What `read_hloc` reads."""
        return self.matched(image1, image2, self.keypoints(image1), self.keypoints(image2))

    def matched(self, image1: str, image2: str, points1: Points, points2: Points) -> Matches:
        """The same for keypoints that were read before."""
        features, matches = self.names
        stored, swapped = _read_pair(matches, self.matches, image1, image2)
        counts = [len(points) for points in ((points2, points1) if swapped else (points1, points2))]
        if {*stored.of_first} - {counts[0]} or (stored.indices.max(axis=0, initial=-1) >= counts).any():
            raise input_error(matches, f"does not fit the keypoints in {features}", "give those it was computed from")
        indices = np.array(stored.indices[:, ::-1] if swapped else stored.indices, dtype=np.int64)
        return Matches(points1[indices[:, 0]], points2[indices[:, 1]], stored.weights, indices=indices)


@dataclass(frozen=True)
class _Stored:
    """Matches in the order of the file, and of how many keypoints of the first image it holds something, if of all."""

    indices: NDArray[np.int64]
    weights: NDArray[np.float64] | None = None
    of_first: tuple[int, ...] = ()


def _read_partners(path: FilePath, pair: Any) -> _Stored:
    """Matches of hloc: for each keypoint of the first image, its partner or -1."""
    partners = _read(path, pair, "matches0", "i")
    scores = _read(path, pair, "matching_scores0", "iuf") if _is_array(path, pair, "matching_scores0") else None
    matched = np.flatnonzero(partners >= 0)
    indices = np.column_stack([matched, partners[matched]]).astype(np.int64)
    if scores is None:
        return _Stored(indices, None, (len(partners),))
    weights = scores[matched[matched < len(scores)]].astype(np.float64)
    return _Stored(indices, weights, (len(partners), len(scores)))


def _read_indices(path: FilePath, file: Any, name: str) -> _Stored:
    """Matches of others: the two keypoints of each in a row or, of DISK itself and of IMC, in a column."""
    array = read_dataset(path, file, name)
    if array.ndim == 2 and array.shape[0] == 2 and array.shape[1] != 2:
        array = array.T
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 2:
        problem = f"holds matches of shape {array.shape} and type {array.dtype}, not integers (k, 2) or (2, k)"
        raise input_error(path, problem, "save a row of two numbers of keypoints for each match")
    if len(array) and not 0 <= array.min() <= array.max() < _MOST_KEYPOINTS:
        raise input_error(path, "holds a match with a keypoint that is not there", "number the keypoints from 0")
    return _Stored(array.astype(np.int64))


def _read_keypoints(path: FilePath, file: Any, image: str) -> Points:
    group = _find_group(path, file, image, "keypoints")
    if group is not None:
        return as_rows(path, read_dataset(path, group, "keypoints"), 2)
    if not _is_plain_array(path, file, image):
        raise not_held(path, f"keypoints of image {image!r}", _names(file, "keypoints"))
    return as_rows(path, read_dataset(path, file, image), 2)


def _read_pair(path: FilePath, file: Any, image1: str, image2: str) -> tuple[_Stored, bool]:
    """Return the matches of a pair of images, and whether the pair is stored in the reverse order."""
    names = [image.replace("/", "-") for image in (image1, image2)]
    # Older versions of hloc have "_" between the names.
    for separator in "/_":
        for swapped in (False, True):
            group = _find_group(path, file, separator.join(reversed(names) if swapped else names), "matches0")
            if group is not None:
                return _read_partners(path, group), swapped
    for separator in "/-":
        for swapped in (False, True):
            first, second = (image2, image1) if swapped else (image1, image2)
            if _is_plain_array(path, file, name := f"{first}{separator}{second}"):
                return _read_indices(path, file, name), swapped
    raise not_held(path, f"matches of {image1!r} and {image2!r}", _names(file, "matches0"))


def _find_group(path: FilePath, file: Any, name: str, dataset: str) -> Any:
    """Return the group of this name if there is one that holds the data set, else None."""
    group: Any = Parts(path, []).find(file, name) if name else None
    return group if hasattr(group, "keys") and _is_array(path, group, dataset) else None


def _is_array(path: FilePath, group: Any, name: str) -> bool:
    # The operator "in" would open whatever file a link names.
    return bool(name) and hasattr(Parts(path, []).find(group, name), "shape")


def _is_plain_array(path: FilePath, file: Any, name: str) -> bool:
    """Whether there is an array of this name that is no part of a group of hloc."""
    return _is_array(path, file, name) and _find_group(path, file, name.rpartition("/")[0], "keypoints") is None


def _names(file: Any, dataset: str) -> list[str]:
    """Return the names of all groups that hold the data set or, if there are none, of all arrays (n, 2)."""
    nodes = nodes_of(file)
    groups = [name.rpartition("/")[0] for name, _ in nodes if name.rpartition("/")[2] == dataset]
    return groups or [name for name, node in nodes if getattr(node, "ndim", 0) == 2]


def _read(path: FilePath, group: Any, name: str, kinds: str) -> NDArray[Any]:
    array = read_dataset(path, group, name)
    if array.ndim != 1 or array.dtype.kind not in kinds:
        problem = f"the data set {name} has the shape {array.shape} and the type {array.dtype}"
        raise input_error(path, problem, "write it with hloc: one number for every keypoint")
    return array
