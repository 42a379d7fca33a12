"""Simulated matches in files: as those in memory, in constant memory, whole or not at all."""

import errno
import hashlib
import os
import shutil
import tracemalloc
from collections import namedtuple

import numpy as np
import pytest

from nonsac import AbsolutePose, Registration, RelativePose, io, simulate
from nonsac.io.rows import write_rows
from nonsac.simulate import files, to_file

MODELS = {"relative-pose": RelativePose(), "absolute-pose": AbsolutePose(), "registration": Registration()}
N, RATIO, NOISE = 150_000, 0.7, 0.002  # three blocks, the last one in part

problems = pytest.mark.parametrize("problem", MODELS)
suffixes = pytest.mark.parametrize("suffix", [".npy", ".parquet"])


def in_memory(problem, n, ratio, noise, seed):
    data = getattr(simulate, problem.replace("-", "_"))(n, ratio, noise, seed)
    first, second, T, inliers = vars(data).values()
    return np.hstack([first, second]), T, inliers


def residuals(problem, T, rows):
    return MODELS[problem].residuals(T[None, :3], rows)[0]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """For each problem the rows of a file, and the true transform."""
    folder = tmp_path_factory.mktemp("rows")
    T = {problem: to_file(folder / f"{problem}.npy", problem, N, RATIO, NOISE, 5) for problem in MODELS}
    return {problem: (np.load(folder / f"{problem}.npy"), T[problem]) for problem in MODELS}


@problems
def test_shape_and_truth_are_those_in_memory(written, problem):
    rows, T = written[problem]
    same, same_T, _ = in_memory(problem, 10, RATIO, NOISE, 5)
    assert rows.shape == (N, same.shape[1])
    assert rows.dtype == np.float64
    assert np.isfinite(rows).all()
    assert len(np.unique(rows[:, 0])) > 0.999 * N  # no block repeats another
    np.testing.assert_array_equal(T, same_T)


@problems
def test_rows_are_distributed_as_in_memory(written, problem):
    """Deciles of every column, and of the residuals at the truth, within four standard errors or so."""
    rows, T = written[problem]
    same, _, inliers = in_memory(problem, N, RATIO, NOISE, 5)
    for a, b in zip([*rows.T, residuals(problem, T, rows)], [*same.T, residuals(problem, T, same)], strict=True):
        bounds = np.quantile(b, np.linspace(0.1, 0.9, 9))
        assert np.abs((a[:, None] < bounds).mean(axis=0) - np.linspace(0.1, 0.9, 9)).max() < 4 * 0.5 * np.sqrt(2 / N)
    near = residuals(problem, T, rows) < 5 * NOISE
    near_in_memory = residuals(problem, T, same) < 5 * NOISE
    assert near_in_memory[inliers].mean() > 0.99
    assert near.mean() == pytest.approx(near_in_memory.mean(), abs=4 * np.sqrt(0.5 / N))


@problems
@pytest.mark.parametrize(("ratio", "outliers"), [(0.0, 0), (0.3333, 333), (0.85, 849), (1.0, 999)])
def test_the_number_of_outliers_is_exact_and_their_rows_are_anywhere(tmp_path, problem, ratio, outliers, monkeypatch):
    monkeypatch.setattr(files, "_BLOCK", 100)
    T = to_file(tmp_path / "a.npy", problem, 999, ratio, 0.0, 1)
    wrong = residuals(problem, T, np.load(tmp_path / "a.npy")) > 1e-7
    assert wrong.sum() == pytest.approx(outliers, abs=1)  # an outlier may fit by chance
    if 0 < outliers < 999:
        assert 0 < wrong[:333].sum() - wrong[333:666].sum() + 333 < 666
        parts = [wrong[k::3].sum() for k in range(3)] + [part.sum() for part in np.split(wrong, 3)]
        assert np.ptp(parts) < 6 * np.sqrt(333 * 0.25)


@problems
def test_image_points_of_outliers_and_cubes_of_sources_keep_their_ranges(written, problem):
    rows, T = written[problem]
    if problem == "registration":
        assert rows[:, :3].min() >= 0
        assert rows[:, :3].max() <= 1
        far = residuals(problem, T, rows) > 0.1
        centre = T[:3, :3] @ np.full(3, 0.5) + T[:3, 3]
        assert np.linalg.norm(rows[far, 3:] - centre, axis=1).max() <= np.sqrt(3) / 2
    else:
        image = rows[:, :2] if problem == "absolute-pose" else rows
        assert 0.999 < np.abs(image).max() < 1 + 6 * NOISE
    if problem == "absolute-pose":
        assert rows[:, 4].min() >= 0.1
        assert rows[:, 4].max() <= 10


@problems
@suffixes
def test_same_seed_same_bytes(tmp_path, problem, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    digests = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        to_file(tmp_path / f"{name}{suffix}", problem, 70_000, 0.5, 0.01, seed, dtype="float32")
        digests.append(hashlib.sha256((tmp_path / f"{name}{suffix}").read_bytes()).hexdigest())
    assert digests[0] == digests[1] != digests[2]


@problems
def test_parquet_holds_the_same_numbers_by_name(tmp_path, problem):
    parquet = pytest.importorskip("pyarrow.parquet")
    for dtype in ("float32", "float64"):
        to_file(tmp_path / "a.npy", problem, 70_001, 0.5, 0.01, 1, dtype=dtype)
        to_file(tmp_path / "a.parquet", problem, 70_001, 0.5, 0.01, 1, dtype=dtype, row_group=30_000)
        rows, table = np.load(tmp_path / "a.npy"), parquet.ParquetFile(tmp_path / "a.parquet")
        assert rows.dtype == dtype
        groups = [table.metadata.row_group(k).num_rows for k in range(table.metadata.num_row_groups)]
        assert groups == [30_000, 30_000, 10_001]
        columns = table.read()
        assert tuple(columns.column_names) == files.PROBLEMS[problem].columns
        np.testing.assert_array_equal(np.column_stack([c.to_numpy() for c in columns.columns]), rows)
        assert columns.column(0).type == {"float32": "float", "float64": "double"}[dtype]


def test_the_readers_take_the_files(tmp_path, written):
    rows, _ = written["relative-pose"]
    np.save(tmp_path / "m.npy", rows)
    assert len(io.read_matches(tmp_path / "m.npy")) == N
    to_file(tmp_path / "p.npy", "absolute-pose", 50, 0.5, 0.0, 1)
    assert len(io.read_points(tmp_path / "p.npy")) == 50
    to_file(tmp_path / "r.npy", "registration", 50, 0.5, 0.0, 1)
    assert io.read_pairs(tmp_path / "r.npy")[0].shape == (50, 3)


def test_single_precision_is_double_precision_rounded(tmp_path):
    for dtype in ("float32", "float64"):
        to_file(tmp_path / f"{dtype}.npy", "registration", 1000, 0.5, 0.01, 3, dtype=dtype)
    double = np.load(tmp_path / "float64.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "float32.npy"), double.astype(np.float32))


def test_a_generator_is_drawn_from(tmp_path):
    rng = np.random.default_rng(4)
    first = to_file(tmp_path / "a.npy", "registration", 100, 0.5, 0.01, rng)
    second = to_file(tmp_path / "b.npy", "registration", 100, 0.5, 0.01, rng)
    assert not np.allclose(first, second)
    to_file(tmp_path / "c.npy", "registration", 100, 0.5, 0.01, np.random.default_rng(4))
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "c.npy").read_bytes()


def test_memory_does_not_grow_with_the_rows(tmp_path):
    def peak(n):
        tracemalloc.start()
        to_file(tmp_path / "a.npy", "registration", n, 0.85, 0.01, 0)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(1000)
    assert peak(600_000) < 1.3 * peak(140_000)


def test_progress_is_told(tmp_path):
    seen = []
    to_file(tmp_path / "a.npy", "registration", N, 0.5, 0.01, 0, progress=lambda *done: seen.append(done))
    assert seen == [(65_536, N), (131_072, N), (N, N)]


@suffixes
@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))])
def test_what_is_interrupted_leaves_nothing(tmp_path, suffix, error):
    def stop(done, total):
        raise error

    with pytest.raises(KeyboardInterrupt if error is KeyboardInterrupt else io.InputError) as caught:
        to_file(tmp_path / f"a{suffix}", "registration", N, 0.5, 0.01, 0, progress=stop)
    if error is not KeyboardInterrupt:
        assert "cannot be written (No space left on device)" in str(caught.value)
    assert os.listdir(tmp_path) == []


def test_a_disk_that_is_too_small_is_told_before_the_work(tmp_path, monkeypatch):
    usage = namedtuple("usage", "free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(free=4_000_000_000))
    with pytest.raises(io.InputError, match=r"a\.npy: needs 4\.8 GB, and 4 GB are free there; make room"):
        to_file(tmp_path / "a.npy", "registration", 10**8, 0.5, 0.01, 0)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"problem": "pnp"}, "problem is 'pnp'; expected one of relative-pose, absolute-pose, registration"),
        ({"n": 0}, "n is 0"),
        ({"outlier_ratio": 1.1}, "outlier_ratio is 1.1"),
        ({"noise": -1.0}, "noise is -1.0"),
        ({"dtype": "int8"}, "dtype is 'int8'"),
        ({"row_group": 0}, "row_group is 0"),
        ({"path": "a.csv"}, "unknown suffix '.csv'; use one of .npy, .parquet"),
        ({"path": "none/a.npy"}, "does not exist; create it first"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, monkeypatch, change, words):
    monkeypatch.chdir(tmp_path)
    arguments = {"path": "a.npy", "problem": "registration", "n": 10, "outlier_ratio": 0.5, "noise": 0.1, "rng": 0}
    with pytest.raises(ValueError, match=words):
        to_file(**arguments | change)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("sizes", [[10], [3, 4, 3], [1] * 10, [7, 3]])
def test_blocks_of_any_size_make_the_same_file(tmp_path, sizes):
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = np.arange(20.0).reshape(10, 2)
    for suffix in (".npy", ".parquet"):
        write_rows(tmp_path / f"a{suffix}", "xy", 10, "float64", np.split(rows, np.cumsum(sizes)[:-1]), 4)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), rows)
    table = parquet.ParquetFile(tmp_path / "a.parquet")
    assert [table.metadata.row_group(k).num_rows for k in range(3)] == [4, 4, 2]
    np.testing.assert_array_equal(table.read().column("y").to_numpy(), rows[:, 1])
