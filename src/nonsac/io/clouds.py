"""Read and write point clouds."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.files.arrays import as_rows, load_npy, load_npz
from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.files.las import read_las
from nonsac.files.paths import choose_by_suffix
from nonsac.files.pipes import TEXT_SUFFIXES as TEXT_SUFFIXES
from nonsac.files.pipes import is_stream
from nonsac.files.records import find_axes
from nonsac.files.text import EXACT, read_table
from nonsac.io.pcd import read_pcd, write_pcd
from nonsac.io.ply import read_ply, write_ply
from nonsac.values.arraylike import as_array

Reader = Callable[[FilePath], NDArray[np.float64]]
Writer = Callable[[Path, NDArray[np.float64]], None]


def read_cloud(path: FilePath) -> NDArray[np.float64]:
    """Read a point cloud; the suffix names the format.

    Parameters
    ----------
    path
        A file that ends in .ply, .pcd, .xyz, .txt, .csv, .asc, .pts, .npy, .npz, .las or .laz. An NPZ file
        holds the points under the key ``points`` or ``xyz``, or as its only array of shape (n, 3). In text,
        the points are the columns x, y and z of the header (or `x [m]`, Easting, Northing and Height, and the like),
        or the first three if there is none. Text may also come from standard input (`-`) or a pipe, at most 256 MiB.

    Returns
    -------
    ndarray of float64, shape (n, 3)
        One point per row, in the unit and order of the file, C-contiguous. Points with NaN or infinite
        coordinates are kept.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says, is truncated or holds no points, or if it names its
        columns and x, y and z are not among them.
    """
    points = _read_text(path) if is_stream(path) else choose_by_suffix(path, READERS)(path)
    if not len(points):
        raise input_error(path, "the file holds no points", "export it again with its points")
    return np.ascontiguousarray(points)


def write_cloud(path: FilePath, points: ArrayLike) -> None:
    """Write a point cloud without loss; the suffix names the format.

    Parameters
    ----------
    path
        A file that ends in .ply, .pcd, .xyz, .txt, .csv, .npy or .npz. It is replaced as a whole or not at
        all.
    points
        Shape (n, 3), one point per row.

    Raises
    ------
    InputError
        If the suffix is unknown, the points have another shape or type, or the file cannot be written.
    """
    write = choose_by_suffix(path, WRITERS)
    rows = as_rows(path, as_array(points, "points"), 3)
    write_atomically(path, lambda temporary: write(temporary, rows))


def _read_npy(path: FilePath) -> NDArray[np.float64]:
    array = load_npy(path)
    if array.dtype.names and array.ndim == 1:
        names = array.dtype.names
        array = np.column_stack([array[names[axis]] for axis in find_axes(path, names)])
    return as_rows(path, array, 3)


def _read_npz(path: FilePath) -> NDArray[np.float64]:
    return load_npz(path, [("points",), ("xyz",)], 3)[0]


def _read_text(path: FilePath) -> NDArray[np.float64]:
    table = read_table(path)
    return table.numbers([0, 1, 2] if table.names is None else find_axes(path, table.names))


def _write_text(path: Path, points: NDArray[np.float64]) -> None:
    np.savetxt(path, points, fmt=EXACT)


def _write_csv(path: Path, points: NDArray[np.float64]) -> None:
    np.savetxt(path, points, fmt=EXACT, delimiter=",", header="x,y,z", comments="")


def _write_npy(path: Path, points: NDArray[np.float64]) -> None:
    with path.open("wb") as file:
        np.save(file, points)


def _write_npz(path: Path, points: NDArray[np.float64]) -> None:
    with path.open("wb") as file:
        np.savez(file, points=points)


READERS: dict[str, Reader] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    **dict.fromkeys(TEXT_SUFFIXES, _read_text),
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".las": read_las,
    ".laz": read_las,
}
WRITERS: dict[str, Writer] = {
    ".ply": write_ply,
    ".pcd": write_pcd,
    ".xyz": _write_text,
    ".txt": _write_text,
    ".csv": _write_csv,
    ".npy": _write_npy,
    ".npz": _write_npz,
}
