"""Read pairs of matched points."""

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import as_rows, load_npy, load_npz
from nonsac.files.errors import FilePath, input_error
from nonsac.files.paths import choose_by_suffix
from nonsac.files.text import read_table
from nonsac.io.clouds import READERS, TEXT_SUFFIXES, read_cloud

_COLUMNS = ("x1", "y1", "z1", "x2", "y2", "z2")
_Points = NDArray[np.float64]


def read_pairs(path: FilePath, second: FilePath | None = None) -> tuple[_Points, _Points]:
    """Read pairs of matched points, from one file of pairs or from two clouds of equal length.

    Parameters
    ----------
    path
        Without `second`, a file of pairs: NPY of shape (n, 6); NPZ with the keys ``source`` and ``target``,
        or ``src`` and ``tgt``, or one array of shape (n, 6); or text with the columns x1, y1, z1, x2, y2 and
        z2 in any order, or with six columns and no header. With `second`, the source: any file that
        `read_cloud` takes.
    second
        The target cloud; its points match those of the source, row by row.

    Returns
    -------
    source, target : ndarray of float64, shape (n, 3)
        The pairs in the unit and order of the file. Those with NaN or infinite coordinates are kept.

    Raises
    ------
    InputError
        If a file cannot be read, is not what its suffix says or holds no pairs, or the lengths differ.
    """
    if second is not None:
        source, target = read_cloud(path), read_cloud(second)
        if len(source) != len(target):
            problem = f"holds {len(source)} points and {second} holds {len(target)}, so they are no pairs"
            raise input_error(path, problem, "for unmatched clouds use `nonsac register-clouds`")
        return source, target
    source, target = choose_by_suffix(path, _READERS)(path)
    if len(source) != len(target):
        problem = f"holds {len(source)} source points and {len(target)} target points"
        raise input_error(path, problem, "for unmatched clouds use `nonsac register-clouds`")
    if not len(source):
        raise input_error(path, "the file holds no pairs", "export it again with its pairs")
    return source, target


def _read_npy(path: FilePath) -> tuple[_Points, _Points]:
    return _split(as_rows(path, load_npy(path), 6))


def _read_npz(path: FilePath) -> tuple[_Points, _Points]:
    first, *others = load_npz(path, [("source", "target"), ("src", "tgt")], 6)
    return (first, others[0]) if others else _split(first)


def _read_text(path: FilePath) -> tuple[_Points, _Points]:
    table = read_table(path)
    if table.names is None:
        if len(row := table.first_row()) not in (0, len(_COLUMNS)):
            problem = f"has {len(row)} columns and no header, where pairs have six"
            raise input_error(path, problem, f"keep six, or add the header line {' '.join(_COLUMNS)}")
        return _split(table.numbers(range(len(_COLUMNS))))
    missing = [name for name in _COLUMNS if name not in table.names]
    if missing:
        problem = f"the header names no {', '.join(missing)}"
        raise input_error(path, problem, f"name the columns {' '.join(_COLUMNS)}")
    return _split(table.numbers([table.names.index(name) for name in _COLUMNS]))


def _refuse_cloud(path: FilePath) -> tuple[_Points, _Points]:
    raise input_error(path, "this format is for one cloud, not for pairs", "give the target cloud as the second file")


def _split(rows: _Points) -> tuple[_Points, _Points]:
    return np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])


_READERS = {
    **dict.fromkeys(READERS, _refuse_cloud),
    **dict.fromkeys(TEXT_SUFFIXES, _read_text),
    ".npy": _read_npy,
    ".npz": _read_npz,
}
