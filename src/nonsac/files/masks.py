"""Write which rows are inliers, piece by piece."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error

MASK_SUFFIXES = (".npy", ".txt", ".csv")


def check_mask_suffix(path: FilePath) -> None:
    """Check that a mask can be written under this name.

    Raises
    ------
    InputError
        If it ends in another suffix than .npy, .txt and .csv.
    """
    if Path(path).suffix.lower() not in MASK_SUFFIXES:
        raise input_error(path, "the inliers are written as .npy, .txt or .csv", "end the name in one of these")


def write_mask(path: FilePath, pieces: Iterable[NDArray[np.bool_]], rows: int) -> None:
    """Write a mask that comes in pieces, whole or not at all.

    Parameters
    ----------
    path
        .npy holds an array of bool, shape (rows,); .txt and .csv hold a line of 0 or 1 for each row.
    pieces
        Together `rows` values.
    rows
        How many there are.

    Raises
    ------
    InputError
        If the name has another suffix, or the file cannot be written.
    """
    check_mask_suffix(path)

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            if temporary.suffix.lower() == ".npy":
                header = {"descr": "|b1", "fortran_order": False, "shape": (rows,)}
                np.lib.format.write_array_header_1_0(file, header)
                for piece in pieces:
                    file.write(piece.tobytes())
            else:
                for piece in pieces:
                    file.write(np.where(piece, b"1\n", b"0\n").tobytes())

    write_atomically(path, write)
