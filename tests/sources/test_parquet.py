import io
import os
import pickle
import re
import shutil
from contextlib import suppress

import numpy as np
import pytest

import nonsac
from limits import little_memory
from nonsac.io import InputError
from nonsac.layouts import MATCHES, Layout
from nonsac.sources import ParquetSource, parquet

__all__ = ["little_memory"]

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
feather = pytest.importorskip("pyarrow.feather")

NAMES = ("x1", "y1", "x2", "y2")
ROWS = np.arange(400.0).reshape(100, 4)


def table(rows=ROWS, names=NAMES, **more):
    return pa.table(dict(zip(names, rows.T, strict=True)) | more)


def write(path, data=None, rows=30, **options):
    data = table() if data is None else data
    options["compression"] = options.get("compression") or ("none" if path.suffix == ".parquet" else "uncompressed")
    if path.suffix == ".parquet":
        pq.write_table(data, path, row_group_size=rows, **options)
    else:
        feather.write_feather(data, str(path), compression=options["compression"], chunksize=rows)
    return path


@pytest.fixture
def folder(tmp_path):
    """Three files of 40, 40 and 20 rows, in row groups of at most 15."""
    for number, (first, last) in enumerate([(0, 40), (40, 80), (80, 100)]):
        (tmp_path / f"year={number}").mkdir()
        write(tmp_path / f"year={number}" / "part.parquet", table(ROWS[first:last]), 15)
    return tmp_path


@pytest.mark.parametrize("name", ["a.parquet", "a.arrow", "a.feather"])
@pytest.mark.parametrize("compression", ["lz4", None])
def test_rows_and_blocks_are_those_of_the_file(tmp_path, name, compression):
    source = ParquetSource(write(tmp_path / name, compression=compression))
    assert source.about.blocks.tolist() == [0, 30, 60, 90, 100]
    assert source.about.largest_block == 30
    indices = np.array([99, 0, 31, 31, 5])
    np.testing.assert_array_equal(source.take(indices), ROWS[indices])
    np.testing.assert_array_equal(np.vstack(list(source.chunks(7))), ROWS)


@pytest.mark.parametrize("columns", [["y2", "x1"], [3, 0], ["y2", 0]])
@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_columns_by_name_and_position(tmp_path, name, columns):
    source = ParquetSource(write(tmp_path / name), columns)
    assert (source.width, source.names, source.about.names) == (2, ("y2", "x1"), None)
    np.testing.assert_array_equal(source.take(np.arange(100)), ROWS[:, [3, 0]])
    np.testing.assert_array_equal(source.narrowed([1]).take(np.array([4])), [[16.0]])


def test_all_columns_of_numbers_are_taken_by_default(tmp_path):
    more = {"word": ["a"] * 100, "__index_level_0__": np.arange(100), "day": pa.array([0] * 100, pa.date32())}
    source = ParquetSource(write(tmp_path / "a.parquet", table(**more)))
    assert source.names == source.about.names == NAMES
    assert source.other_columns == {"word": "holds string, not numbers", "day": "holds date32[day], not numbers"}


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", "i1", "i8", "u1", "u4"])
@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_numbers_of_any_size(tmp_path, name, kind):
    numbers = np.arange(10).astype(kind)
    source = ParquetSource(write(tmp_path / name, pa.table({"n": numbers})))
    taken = source.take(np.arange(10))
    assert taken.dtype == np.float64
    np.testing.assert_array_equal(taken[:, 0], numbers)


@pytest.mark.parametrize("kind", [pa.int32(), pa.float32(), pa.float64(), pa.uint8()])
@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_what_is_missing_is_nan(tmp_path, name, kind):
    source = ParquetSource(write(tmp_path / name, pa.table({"n": pa.array([1, None, 3], kind)})))
    np.testing.assert_array_equal(source.take(np.arange(3)), [[1.0], [np.nan], [3.0]])


@pytest.mark.parametrize("style", [str, lambda folder: f"{folder}/*/part.parquet", lambda folder: f"{folder}/**"])
def test_a_folder_or_pattern_is_its_files_in_order(folder, style):
    (folder / "_SUCCESS").touch()
    (folder / ".part.crc").touch()
    if "**" not in style(folder):
        (folder / "readme.txt").write_text("not data")
    paths = style(folder)
    source = ParquetSource(paths if "**" not in paths else f"{paths}/*.parquet")
    assert source.about.blocks.tolist() == [0, 15, 30, 40, 55, 70, 80, 95, 100]
    np.testing.assert_array_equal(source.take(np.arange(100)), ROWS)


def test_files_without_a_suffix_in_a_folder(tmp_path):
    shutil.move(write(tmp_path / "a.parquet"), tmp_path / "part-0")
    np.testing.assert_array_equal(ParquetSource(tmp_path).take(np.arange(100)), ROWS)


def test_parquet_and_arrow_files_in_a_list_keep_its_order(tmp_path):
    paths = [write(tmp_path / "b.parquet", table(ROWS[:50])), str(write(tmp_path / "a.arrow", table(ROWS[50:])))]
    np.testing.assert_array_equal(ParquetSource(paths).take(np.arange(100)), ROWS)


def test_files_behind_urls(folder):
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    memory.put(str(folder), "/rows", recursive=True)
    for paths in ("memory://rows", "memory://rows/*/part.parquet", f"file://{folder}"):
        source = pickle.loads(pickle.dumps(ParquetSource(paths, ["x2"])))
        np.testing.assert_array_equal(source.take(np.arange(100)), ROWS[:, [2]])
    for paths in ("memory://nothing.parquet", "memory://rows/*.arrow"):
        with pytest.raises(InputError, match=r"memory://\S+: no "):
            ParquetSource(paths)
    with pytest.raises(InputError, match=r"unknown://rows: .*unknown"):
        ParquetSource("unknown://rows")
    memory.rm("/rows", recursive=True)


@pytest.fixture
def reads(monkeypatch):
    """What is read of the files: (block of the file, columns)."""
    seen = []
    for kind in (parquet._ParquetFile, parquet._ArrowFile):
        read = kind.read_column
        monkeypatch.setattr(
            kind,
            "read_column",
            lambda self, block, name, rows, read=read: seen.append((block, name)) or read(self, block, name, rows),
        )
    return seen


def test_only_row_groups_that_hold_a_row_are_read_and_each_once(folder, reads):
    """And of these a column at a time, so that Arrow never holds a second copy of them all."""
    source = ParquetSource(folder, ["y2", "x1"])
    assert reads == []
    source.take(np.array([96, 31, 32, 97, 3]))
    assert reads == [(block, column) for block in (0, 2, 1) for column in ("y2", "x1")]


@pytest.fixture
def openings(monkeypatch):
    """The files that are opened, in order, each as often as it is."""
    seen, opened = [], parquet._opened
    monkeypatch.setattr(parquet, "_opened", lambda path: seen.append(os.path.basename(path)) or opened(path))
    return seen


@pytest.mark.parametrize("layout", ["y2 | x1 y1", Layout("Y2 X1"), None])
@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_a_file_is_opened_once_for_its_footer_and_choosing_columns_opens_nothing(
    tmp_path, reads, openings, name, layout
):
    path = write(tmp_path / name, table(word=["a"] * 100))
    source = nonsac.open_source(path, layout=layout)
    assert openings == [name]
    narrowed = source.narrowed([1, 0])
    assert (len(narrowed), narrowed.width, narrowed.about.blocks.tolist()) == (100, 2, [0, 30, 60, 90, 100])
    assert narrowed.about.names == (("x1", "y2") if layout else ("y1", "x1"))
    assert 0 < narrowed.bytes_to_take(100) <= source.bytes_to_take(100)
    assert openings == [name]
    assert reads == []
    np.testing.assert_array_equal(narrowed.take(np.array([95, 99])), ROWS[[95, 99]][:, [0, 3] if layout else [1, 0]])
    assert openings == [name] * 2
    assert {column for _, column in reads} == set(narrowed.names)


def test_each_of_many_files_is_opened_once(folder, openings):
    nonsac.open_source(folder, layout="x1 y1 | x2 y2").narrowed([3])
    assert openings == ["part.parquet"] * 3


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"y2": ["a"] * 100}, r"column 'y2' holds string, not numbers; save one column of numbers under this name"),
        ({"Y2": pa.array([0] * 100, pa.date32())}, r"column 'Y2' holds date32\[day\], not numbers; save"),
        (
            {},
            r"rows of 3 columns \(x1 y1 x2\), of which none is called y2; rename the columns, or choose them, by name",
        ),
    ],
)
def test_a_column_of_the_right_name_that_holds_no_numbers_is_named(tmp_path, columns, message):
    path = write(tmp_path / "a.parquet", table(ROWS[:, :3], NAMES[:3], **columns))
    with pytest.raises(InputError, match=f"a.parquet: {message}"):
        nonsac.open_source(path, layout=MATCHES)
    assert nonsac.open_source(path, layout="x1 y1").width == 2


def test_of_two_columns_of_one_name_nobody_knows_which_is_meant(tmp_path):
    twice = pa.table([*ROWS.T, ROWS[:, 0]], [*NAMES, "x1"])
    with pytest.raises(InputError, match=r"a.parquet: column 'x1' is there several times; save one column of numbers"):
        nonsac.open_source(write(tmp_path / "a.parquet", twice), layout=MATCHES)


class Counting(io.FileIO):
    """Tells how many bytes are read."""

    read_bytes = 0

    def read(self, size=-1):
        content = super().read(size)
        Counting.read_bytes += len(content)
        return content


@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_other_columns_and_blocks_are_not_read(tmp_path, name, monkeypatch):
    rows, plain = np.random.default_rng(0).normal(size=(40_000, 8)), {"use_dictionary": False}
    path = write(tmp_path / name, table(rows, tuple("abcdefgh")), 10_000, **plain)
    monkeypatch.setattr(parquet, "open_file", lambda url: Counting(url.removeprefix("file://")))
    whole, source = ParquetSource(f"file://{path}"), ParquetSource(f"file://{path}", ["b", "g"])
    monkeypatch.setattr(Counting, "read_bytes", 0)
    np.testing.assert_array_equal(source.take(np.array([39_999, 5])), rows[[39_999, 5]][:, [1, 6]])
    size = 2 * 2 * 10_000 * 8
    assert size <= Counting.read_bytes < size + 150_000  # footers
    assert source.bytes_to_take(40_000) == pytest.approx(whole.bytes_to_take(40_000) / 4, rel=0.01)


def test_bytes_are_those_of_the_blocks_that_random_rows_hit(tmp_path):
    rows = np.random.default_rng(0).normal(size=(100_000, 4))
    path = write(tmp_path / "a.parquet", table(rows), 1000)
    source, size = ParquetSource(path), path.stat().st_size
    assert source.bytes_to_take(0) == 0
    assert source.bytes_to_take(1) == pytest.approx(size / 100, rel=0.1)
    assert source.bytes_to_take(100) == pytest.approx(size * (1 - 0.99**100), rel=0.1)
    assert source.bytes_to_take(100_000) == pytest.approx(size, rel=0.1)


def test_no_rows(tmp_path):
    source = ParquetSource(write(tmp_path / "a.parquet", table(ROWS[:0])))
    assert (len(source), source.width, source.bytes_to_take(10)) == (0, 4, 0)
    assert source.take(np.empty(0, np.int64)).shape == (0, 4)


def test_the_pickle_is_a_description(folder):
    source = ParquetSource(folder)
    source.take(np.arange(100))
    assert len(pickle.dumps(source)) < 2000


def test_what_is_not_read_does_not_travel(tmp_path):
    columns = {f"column {number}": np.zeros(1) if number % 2 else ["a"] for number in range(2000)}
    source = nonsac.open_source(write(tmp_path / "a.parquet", table(ROWS[:1]).add_column(0, "id", [[1]])), layout="x2")
    wide = nonsac.open_source(write(tmp_path / "b.parquet", pa.table(columns | {"x2": [2.0]})), layout="x2")
    assert len(pickle.dumps(wide)) < len(pickle.dumps(source)) + 100


def test_the_working_directory_may_change(tmp_path, monkeypatch):
    write(tmp_path / "a.parquet")
    monkeypatch.chdir(tmp_path)
    source = ParquetSource("a.parquet")
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(source)).take(np.arange(100)), ROWS)


def test_a_column_that_is_not_there(tmp_path):
    path = write(tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"a.parquet: holds no column 'u' \(it holds x1, y1, x2, y2\)"):
        ParquetSource(path, ["x1", "u"])
    with pytest.raises(InputError, match=r"a.parquet: holds no column 4, counted from 0 \(it holds x1, y1, x2, y2\)"):
        ParquetSource(path, [4])
    for columns, message in (([], r"columns must be a sequence .* got \[\]"), ("x1", "got 'x1'"), ([0, 0], "x1, x1")):
        with pytest.raises(ValueError, match=message):
            ParquetSource(path, columns)


@pytest.mark.parametrize("name", ["b.parquet", "b.arrow"])
def test_a_partition_of_another_schema_is_named(tmp_path, name):
    first, second = write(tmp_path / "a.parquet"), tmp_path / name
    write(second, table(names=("x1", "y1", "u2", "y2")))
    with pytest.raises(InputError, match=rf"{name}: holds no column 'x2' \(it holds x1, y1, u2, y2\)"):
        ParquetSource([first, second])
    for wrong in (pa.array(["a"] * 100), pa.array([None] * 100, pa.decimal128(5)), pa.array([True] * 100)):
        write(second, table(ROWS[:, :3], NAMES[:3], y2=wrong))
        with pytest.raises(InputError, match=re.escape(f"{name}: column 'y2' holds {wrong.type}, not numbers")):
            ParquetSource([first, second], NAMES)
    assert ParquetSource([first, second], ["x1"]).take(np.array([100])) == ROWS[0, 0]


def test_other_content_is_refused(tmp_path):
    path = tmp_path / "a.parquet"
    for content, message in (
        (b"", "the file is empty"),
        (b"x1,y1\n1,2\n", "is neither a Parquet nor an Arrow file"),
        (b"PAR1", "is truncated or damaged"),
        (b"ARROW1", "is truncated or damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=f"a.parquet: {message}"):
            ParquetSource(path)
    path.write_bytes(write(tmp_path / "b.parquet", pa.table({"word": ["a"]})).read_bytes())
    with pytest.raises(InputError, match=r"a.parquet: holds no columns of numbers"):
        ParquetSource(path)
    with pytest.raises(InputError, match=r"none.parquet: no such file"):
        ParquetSource(tmp_path / "none.parquet")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: the folder holds no files"):
        ParquetSource(tmp_path / "empty")
    with pytest.raises(InputError, match=r"\*.arrow: no file matches"):
        ParquetSource(f"{tmp_path}/*.arrow")
    with pytest.raises(ValueError, match="paths must name at least one"):
        ParquetSource([])


@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_a_file_cut_anywhere_is_refused_in_one_line(tmp_path, name):
    content = write(tmp_path / name).read_bytes()
    for length in range(0, len(content), 97):
        (tmp_path / name).write_bytes(content[:length])
        with pytest.raises(InputError) as caught:
            ParquetSource(tmp_path / name)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_damaged_bytes_are_refused_or_read(tmp_path, name, rng):
    content = np.frombuffer(write(tmp_path / name, compression="lz4").read_bytes(), np.uint8)
    for _ in range(60):
        damaged = content.copy()
        damaged[rng.integers(8, len(content), 20)] = rng.integers(0, 256, 20)
        (tmp_path / name).write_bytes(damaged.tobytes())
        # Fewer rows is what it may then say, and hence an IndexError.
        with suppress(InputError, IndexError):
            assert ParquetSource(tmp_path / name, ["x1"]).take(np.array([1, 50, 99])).shape == (3, 1)


@pytest.mark.usefixtures("little_memory")
def test_blocks_do_not_explode(tmp_path):
    for name, compression in [("a.parquet", "snappy"), ("a.arrow", "zstd")]:
        path = tmp_path / name
        rows = np.zeros((3_000_000, 4))
        with pytest.raises(InputError, match=r"its largest block of rows would take up 96 MB of memory, from"):
            ParquetSource(write(path, table(rows), 10**7, compression=compression))
        assert len(ParquetSource(write(path, table(rows), 10**6, compression=compression))) == 3_000_000


def test_columns_that_go_on_for_ever_are_left(tmp_path, monkeypatch):
    """Row groups and the pages in them count their rows each for itself."""
    path = write(tmp_path / "a.parquet", rows=100)
    monkeypatch.setattr(parquet._ParquetFile, "block_rows", lambda self: [40])
    with pytest.raises(InputError, match="was changed"):
        ParquetSource(path).take(np.array([1]))
    with parquet._opened(str(path)) as file:
        assert len(file.read_column(0, "x1", 40)) == 41


def test_lengths_of_arrow_are_compared_with_its_bytes(tmp_path):
    path = write(tmp_path / "a.arrow", rows=100)
    content = path.read_bytes()
    longer = content.replace((100).to_bytes(8, "little"), (10**6).to_bytes(8, "little"))
    assert longer != content
    path.write_bytes(longer)
    with pytest.raises(InputError, match=r"a.arrow: is truncated or damaged"):
        ParquetSource(path).take(np.array([1]))


def test_footers_that_end_the_process_are_not_asked_for_sizes(tmp_path):
    """Of some damaged ones pyarrow does not raise what is wrong, but aborts; whatever happens, it is an InputError."""
    content = write(tmp_path / "a.parquet").read_bytes()
    for place in [match.start() for match in re.finditer(rb"\x29\x06", content)]:  # lists of no numbers
        for length in range(1, 15):
            damaged = bytearray(content)
            damaged[place + 1] = length << 4 | 6
            (tmp_path / "a.parquet").write_bytes(damaged)
            with suppress(InputError):
                list(ParquetSource(tmp_path / "a.parquet").chunks(1000))


def test_a_file_that_changes_while_it_is_read(tmp_path):
    path = write(tmp_path / "a.parquet")
    source = ParquetSource(path)
    os.utime(path, ns=(0, 0))
    with pytest.raises(InputError, match=r"a.parquet: the file was changed after it was opened"):
        source.take(np.array([0]))
    path.unlink()
    with pytest.raises(InputError, match=r"a.parquet: no such file"):
        source.take(np.array([0]))


@pytest.mark.parametrize("name", ["a.parquet", "a.arrow"])
def test_a_file_that_is_written_anew_during_a_reading(tmp_path, name, monkeypatch):
    path = write(tmp_path / name)
    source, kind = ParquetSource(path), parquet._ParquetFile if name == "a.parquet" else parquet._ArrowFile
    read = kind.read_column

    def reading_while_it_changes(*arguments):
        os.utime(path, ns=(0, 0))
        return read(*arguments)

    monkeypatch.setattr(kind, "read_column", reading_while_it_changes)
    with pytest.raises(InputError, match=rf"{name}: the file was changed after it was opened"):
        source.take(np.array([0]))


def test_a_file_behind_a_url_that_becomes_shorter(tmp_path):
    path = write(tmp_path / "a.parquet")
    source = ParquetSource(f"file://{path}")
    write(path, table(ROWS[:40]))
    np.testing.assert_array_equal(source.take(np.array([3])), ROWS[[3]])
    with pytest.raises(InputError, match=r"a.parquet: the file was changed"):
        source.take(np.array([31]))
    with pytest.raises(InputError, match=r"a.parquet: cannot be read"):
        source.take(np.array([91]))


def test_without_pyarrow(tmp_path, monkeypatch):
    path = write(tmp_path / "a.parquet")
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r'needs pyarrow; pip install "nonsac\[parquet\]"'):
        ParquetSource(path)
