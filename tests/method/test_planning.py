import json

import numpy as np
import pytest

import nonsac
from nonsac import AllPairsSource, ArraySource, MappedSource, StreamSource
from nonsac.method import planning
from nonsac.running.memory import bytes_for
from nonsac.sources.contract import About


class Groups(nonsac.Source):
    """A hundred groups of a million rows on a disk, of which any row costs all of its group."""

    about = About(blocks=np.arange(0, 100_000_001, 1_000_000))
    width = 4

    def __len__(self):
        return 100_000_000

    def take(self, indices):
        raise AssertionError("nothing is read")

    def bytes_to_take(self, rows):
        return 16_000_000 * min(rows, 100)


def test_a_draw_of_blocks_reads_less():
    rows, blocks = (nonsac.plan(Groups(), draw=draw) for draw in ("rows", "blocks"))
    assert (rows.bytes_read, blocks.bytes_read) == (1_600_000_000, 256_000_000)
    assert (rows.bytes_of_all, rows.rows, rows.blocks) == (blocks.bytes_of_all, blocks.rows, blocks.blocks)
    with pytest.raises(ValueError, match='draw must be "rows" or "blocks", got \'groups\''):
        nonsac.plan(Groups(), draw="groups")


class Blocks(ArraySource):
    """A million rows in blocks of 1,000, of which each takes 50 bytes a row to read."""

    about = About(blocks=np.arange(0, 1_000_001, 1000))

    def __init__(self):
        super().__init__(np.broadcast_to(np.zeros((1, 4)), (1_000_000, 4)))

    def bytes_to_take(self, rows):
        return 50 * min(1000 * rows, 1_000_000)


def test_a_source_of_blocks():
    plan = nonsac.plan(MappedSource(Blocks(), np.negative), samples=5, sample_size=100)
    assert (plan.kind, plan.rows, plan.columns, plan.blocks) == ("Blocks", 1_000_000, 4, 1000)
    assert (plan.rows_read, plan.bytes_read, plan.bytes_of_all) == (100_000, 50_000_000, 50_000_000)
    assert plan.memory == bytes_for(100_000, Blocks())
    assert plan.seconds == pytest.approx(0.25 + 0.5 + 0.5)
    assert plan.seconds_of_all == pytest.approx(0.25)


@pytest.mark.parametrize(("samples", "size", "read"), [(10, 2000, 100_000), (100, 2000, 200_000), (1000, 2000, 1e6)])
def test_rows_of_the_samples_or_of_the_last_fit(samples, size, read):
    assert nonsac.plan(Blocks(), samples=samples, sample_size=size).rows_read == read


@pytest.mark.parametrize(
    "source",
    [
        ArraySource(np.zeros((3000, 4))),
        StreamSource([np.zeros((3000, 4))]),
        AllPairsSource(np.zeros((100, 2)), np.zeros((30, 2))),
        nonsac.JoinedSource([np.zeros((3000, 4))]),
    ],
)
def test_what_is_in_memory_is_not_read(source):
    plan = nonsac.plan(source)
    assert (plan.kind, plan.blocks) == (type(source).__name__, None)
    assert (plan.rows_read, plan.bytes_read, plan.bytes_of_all) == (3000, 0, 0)


def test_a_source_that_does_not_tell_its_cost():
    class Mine(nonsac.Source):
        width = 5

        def __len__(self):
            return 10**9

        def take(self, indices):
            raise AssertionError("rows are read")

    plan = nonsac.plan(Mine())
    assert (plan.bytes_read, plan.bytes_of_all) == (4_000_000, 40_000_000_000)


def test_no_rows():
    plan = nonsac.plan(ArraySource(np.zeros((0, 4))))
    assert (plan.rows, plan.rows_read, plan.memory) == (0, 0, bytes_for(0, ArraySource(np.zeros((0, 4)))))
    assert "0 rows of 4 columns" in str(plan)


def test_a_table_on_disk_as_the_system_sees_it(tmp_path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    rng = np.random.default_rng(0)
    columns = {name: rng.normal(size=200_000) for name in "abcdefgh"}
    parquet.write_table(pa.table(columns), tmp_path / "rows.parquet", row_group_size=20_000)
    plan = nonsac.plan(nonsac.open_source(tmp_path / "rows.parquet", columns=["a", "b"]))
    assert (plan.kind, plan.blocks) == ("ParquetSource", 10)
    assert plan.bytes_of_all == pytest.approx((tmp_path / "rows.parquet").stat().st_size / 4, rel=0.1)


def test_texts():
    plan = nonsac.plan(Blocks())
    assert json.loads(json.dumps(plan.to_dict()))["blocks"] == 1000
    lines = str(plan).splitlines()
    assert lines[0] == "1,000,000 rows of 4 columns, in 1,000 blocks that are read whole (Blocks)"
    assert "10 samples of 2,000 rows, estimated" in lines[1]
    assert "100,000 rows, 50 MB, if none is read twice" in lines[2]
    assert "38.1 MB" in lines[3]
    assert "about 2 s" in lines[4]
    assert "50 MB, less than 1 s" in lines[5]


@pytest.mark.parametrize(("seconds", "text"), [(0.2, "less than 1 s"), (90, "90 s"), (600, "10 min"), (9000, "2 h")])
def test_times(seconds, text):
    assert planning._time(seconds).endswith(text)


@pytest.mark.parametrize("wrong", [0, -1, 2.5, True, "auto"])
@pytest.mark.parametrize("name", ["samples", "sample_size"])
def test_numbers_must_be_counts(name, wrong):
    with pytest.raises(ValueError, match=f"{name} must be a positive integer"):
        nonsac.plan(Blocks(), **{name: wrong})
