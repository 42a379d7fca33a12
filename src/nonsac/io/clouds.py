"""Read and write point clouds."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.io.arrays import as_rows, load_npy, load_npz
from nonsac.io.atomic import write_atomically
from nonsac.io.content import unreadable
from nonsac.io.errors import FilePath, input_error
from nonsac.io.las import read_las
from nonsac.io.pcd import read_pcd, write_pcd
from nonsac.io.ply import read_ply, write_ply
from nonsac.io.records import find_axes, truncated
from nonsac.io.text import EXACT, read_table

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
Reader = Callable[[FilePath], NDArray[np.float64]]
Writer = Callable[[Path, NDArray[np.float64]], None]
Choice = TypeVar("Choice")


def read_cloud(path: FilePath) -> NDArray[np.float64]:
    """Read a point cloud; the suffix names the format.

    Parameters
    ----------
    path
        A file that ends in .ply, .pcd, .xyz, .txt, .csv, .asc, .pts, .npy, .npz, .las or .laz. An NPZ file
        holds the points under the key ``points`` or ``xyz``, or as its only array of shape (n, 3). In text,
        the points are the columns x, y and z of the header, or the first three.

    Returns
    -------
    ndarray of float64, shape (n, 3)
        One point per row, in the unit and order of the file, C-contiguous. Points with NaN or infinite
        coordinates are kept.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says, is truncated or holds no points.
    """
    points = choose_by_suffix(path, READERS)(path)
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
    rows = as_rows(path, np.asarray(points), 3)
    write_atomically(path, lambda temporary: write(temporary, rows))


def choose_by_suffix(path: FilePath, choices: dict[str, Choice]) -> Choice:
    """Return the choice for the suffix of a path.

    Parameters
    ----------
    path
        A file name; the case of its suffix does not matter.
    choices
        What to choose from, by lower-case suffix with its dot.

    Returns
    -------
    object
        The value of `choices` for this suffix.

    Raises
    ------
    InputError
        If the path is a folder, or no choice has its suffix.
    """
    suffix = Path(path).suffix.lower()
    if suffix in choices:
        return choices[suffix]
    if Path(path).is_dir():
        raise unreadable(path, IsADirectoryError())
    problem = f"unknown suffix {suffix!r}" if suffix else "the file name has no suffix"
    raise input_error(path, problem, f"use one of {', '.join(choices)}")


def _read_npy(path: FilePath) -> NDArray[np.float64]:
    return as_rows(path, load_npy(path), 3)


def _read_npz(path: FilePath) -> NDArray[np.float64]:
    return load_npz(path, [("points",), ("xyz",)], 3)[0]


def _read_text(path: FilePath) -> NDArray[np.float64]:
    table = read_table(path)
    promised = 0
    # A PTS file starts with the number of its points.
    if len(row := table.first_row()) == 1 and row[0].isdecimal():
        promised = int(row[0])
        table = table.after_first_row()
    names = table.names or ()
    axes = find_axes(path, names) if set("xyz") & set(names) else [0, 1, 2]
    points = table.numbers(axes)
    if len(points) < promised:
        raise truncated(path, promised, len(points))
    return points


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
