"""A draw of some blocks, and the test whether their rows are alike; the rates are those of thousands of draws."""

import numpy as np
import pytest
from scipy.stats import chi2, kruskal, rankdata

import nonsac
from nonsac.method.block_draw import _ranks, _scores, alikeness, drawn_blocks, most_alike
from nonsac.result import Remark
from nonsac.sources import ArraySource, SomeBlocksSource
from nonsac.sources.contract import About

pytest.importorskip("pyarrow")


class Blocks(ArraySource):
    def __init__(self, sizes):
        super().__init__(np.zeros((int(np.sum(sizes)), 2)))
        self.sizes = sizes

    @property
    def about(self):
        return About(blocks=np.append(0, np.cumsum(self.sizes)))


class Runs(ArraySource):
    about = About(run=10)


def numbers(drawn):
    """Of the rows that were drawn, in the source."""
    pairs = zip(drawn.firsts, drawn.firsts + np.diff(drawn.starts), strict=True)
    return np.concatenate([np.arange(*pair) for pair in pairs])


# --- which blocks -----------------------------------------------------------------------------------------------------


def test_as_many_blocks_as_hold_the_rows_and_sixteen_at_least():
    source = Blocks(np.full(100, 50))
    assert [len(drawn_blocks(source, rows, 0).firsts) for rows in (1, 800, 801, 2000)] == [16, 16, 17, 40]
    assert drawn_blocks(source, 5000, 0) is source
    assert drawn_blocks(Blocks(np.full(16, 50)), 1, 0).__class__ is Blocks


def test_blocks_are_whole_distinct_and_in_order():
    sizes = np.random.default_rng(0).integers(0, 30, 200)
    starts = np.append(0, np.cumsum(sizes))
    drawn = drawn_blocks(Blocks(sizes), 900, 3)
    assert 900 <= len(drawn) < 930
    assert (np.diff(drawn.starts) > 0).all()
    assert (np.diff(numbers(drawn)) > 0).all()
    assert set(drawn.firsts) <= set(starts)
    assert set(drawn.firsts + np.diff(drawn.starts)) <= set(starts)


def test_rows_that_can_be_read_one_by_one_are_cut_into_runs():
    drawn = drawn_blocks(Runs(np.zeros((1003, 2))), 300, 1)
    assert len(drawn.firsts) == 31
    assert (drawn.firsts % 10 == 0).all()
    assert set(np.diff(drawn.starts)) <= {10, 3}
    assert len(drawn_blocks(Runs(np.zeros((1003, 2))), 1, 1).firsts) == 16


@pytest.mark.parametrize(
    "source", [ArraySource(np.zeros((10**6, 2))), nonsac.AllPairsSource(*2 * [np.zeros((999, 2))])]
)
def test_what_is_in_memory_is_drawn_by_rows(source):
    assert drawn_blocks(source, 100, 0) is source


def test_a_memory_map_and_an_npy_file_have_runs(tmp_path):
    np.save(tmp_path / "rows.npy", np.zeros((10**6, 4), np.float32))
    mapped = np.load(tmp_path / "rows.npy", mmap_mode="r")
    for source in (nonsac.open_source(tmp_path / "rows.npy"), ArraySource(mapped), nonsac.JoinedSource([mapped])):
        drawn = drawn_blocks(source, 100_000, 0)
        assert isinstance(drawn, SomeBlocksSource)
        assert set(np.diff(drawn.starts)) <= {2**14, 10**6 % 2**14}


def test_every_block_is_drawn_equally_often():
    sizes, hits = np.full(40, 5), np.zeros(40)
    for seed in range(2000):
        hits[drawn_blocks(Blocks(sizes), 1, seed).firsts // 5] += 1
    assert abs(hits / 2000 - 16 / 40).max() < 0.05  # more than four standard deviations


# --- whether their rows are alike -------------------------------------------------------------------------------------


def test_ranks_are_those_of_scipy(rng):
    column = rng.integers(0, 50, 300).astype(float)
    np.testing.assert_allclose(_ranks(column), (2 * rankdata(column) - 1) / 300 - 1, atol=1e-12)


def test_the_sum_of_squares_is_that_of_kruskal_and_wallis(rng):
    ranks, blocks = rng.permutation(400).astype(float), np.repeat(np.arange(8), 50)
    ranks[blocks == 3] += 90.0
    statistic = kruskal(*(ranks[blocks == block] for block in range(8))).statistic
    x = -alikeness(rankdata(ranks), blocks).log_chance
    assert 7 + 2 * np.sqrt(7 * x) + 2 * x == pytest.approx(statistic)
    assert chi2.sf(statistic, 7) < np.exp(-x)  # the bound is one


def test_the_share_between_blocks_is_the_one_that_was_put_in(rng):
    blocks = np.repeat(np.arange(200), 50)
    for share in (0.1, 0.5, 0.9):
        scores = np.sqrt(share) * rng.standard_normal(200)[blocks] + np.sqrt(1 - share) * rng.standard_normal(10_000)
        assert alikeness(scores, blocks).share == pytest.approx(share, abs=0.1)


@pytest.mark.parametrize("kind", ["even", "rare", "uneven", "two columns"])
def test_random_order_is_told_as_seldom_as_stated(rng, kind):
    count, size = (100, 300) if kind == "rare" else (16, 100)
    rows = count * size
    blocks = (
        np.sort(rng.integers(0, count, rows) ** 2 // count) if kind == "uneven" else np.repeat(np.arange(count), size)
    )
    for level in (0.3, 0.1):
        told = 0
        for _ in range(500):
            scores = rng.random(rows) - 0.5
            scores = scores * (rng.random(rows) - 0.5) if kind == "two columns" else scores
            scores = (scores > 0.48).astype(float) if kind == "rare" else scores
            told += alikeness(scores, blocks).log_chance < np.log(level)
        assert told < 500 * level


def test_of_what_is_rarer_than_blocks_nothing_is_said(rng):
    blocks, scores = np.repeat(np.arange(200), 50), np.zeros(10_000)
    scores[:50] = 1.0  # all in one block: but so few could be anywhere
    assert alikeness(scores, blocks) == (0.0, 0.0)
    assert alikeness(np.ones(100), blocks[:100]) == (0.0, 0.0)
    assert alikeness(rng.random(50), blocks[:50]) == (0.0, 0.0)


def test_all_that_is_looked_at_counts_for_the_rate(rng):
    blocks = np.repeat(np.arange(16), 100)
    scores = [(str(number), rng.permutation(1600).astype(float)) for number in range(400)]
    assert most_alike(scores, blocks) is None
    assert most_alike([*scores, ("sorted", np.arange(1600.0))], blocks)[1] == "sorted"


def test_what_is_told_is_the_most_alike():
    blocks = np.repeat(np.arange(20), 100)
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.random(2000), blocks + 30 * rng.random(2000), blocks + 3 * rng.random(2000)])
    share, name = most_alike([*_scores(("a", "b", "c"), table)], blocks)
    assert name == "c"
    assert 0.7 < share < 1.0


@pytest.mark.parametrize(("kind", "name"), [("spread", "a squared"), ("relation", "a times b")])
def test_columns_may_be_alike_only_in_their_spread_or_together(rng, kind, name):
    blocks = np.repeat(np.arange(20), 200)
    signs = rng.permutation(np.repeat([-1.0, 1.0], 10))[blocks]
    table = rng.standard_normal((4000, 2))
    if kind == "spread":
        table[:, 0] *= np.exp(0.5 * signs)
    else:
        table[:, 1] += signs * table[:, 0]
    scores = [*_scores(("a", "b"), table)]
    assert most_alike(scores, blocks)[1] == name
    assert most_alike([score for score in scores if score[0] in ("a", "b")], blocks) is None


# --- the whole call ---------------------------------------------------------------------------------------------------

ROWS, GROUP = 120_000, 2000


def table_of(order):
    views = nonsac.simulate.relative_pose(ROWS, 0.6, 0.002, rng=1)
    table = np.hstack([views.points1, views.points2])
    rng = np.random.default_rng(7)
    numbers = {
        "shuffled": lambda: np.arange(ROWS),
        "by the image": lambda: np.lexsort((table[:, 0], np.round(table[:, 1], 2))),
        "by a place in the other image": lambda: np.argsort(np.hypot(*table[:, 2:].T)),
        "right ones first": lambda: np.argsort(~views.inliers, kind="stable"),
        "slightly": lambda: np.argsort(table[:, 0] + 4.0 * rng.standard_normal(ROWS)),
    }[order]()
    return views, table[numbers]


def written(folder, table, kind):
    names = ["x1", "y1", "x2", "y2"]
    if kind == "parquet":
        import pyarrow
        from pyarrow.parquet import write_table

        write_table(pyarrow.table(list(table.T), names), folder / "rows.parquet", row_group_size=GROUP)
        return nonsac.open_source(folder / "rows.parquet")
    if kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / "rows.h5", "w") as file:
            file.create_dataset("rows", data=table, chunks=(GROUP, 4), compression="lzf")
        return nonsac.open_source(folder / "rows.h5")
    np.save(folder / "rows.npy", table)
    return nonsac.open_source(folder / "rows.npy")


@pytest.fixture
def few(monkeypatch):
    """Blocks of a small file are drawn as those of a large one."""
    monkeypatch.setattr("nonsac.method.budget.LARGEST_SIZE", 200)
    monkeypatch.setattr("nonsac.method.budget._READ_AT_ONCE", 30_000)
    monkeypatch.setattr("nonsac.sources.records._RUN", 32 * GROUP)
    monkeypatch.setattr("nonsac.sources.blocks._BLOCK_BYTES", 32 * GROUP)


def told(result):
    return [remark for remark in result.remarks if remark.startswith(Remark.BLOCKS_DIFFER)]


SETTINGS = {"noise": 0.002, "draw": "blocks", "refine": "union"}


@pytest.mark.parametrize("kind", ["parquet", "npy"])
@pytest.mark.parametrize(
    "order", ["shuffled", "by the image", "by a place in the other image", "right ones first", "slightly"]
)
def test_a_sorted_file_is_told_and_a_shuffled_one_is_not(tmp_path, few, order, kind):
    views, table = table_of(order)
    source = written(tmp_path, table, kind)
    result = nonsac.relative_pose(source, **SETTINGS)
    assert result.info["blocks"] == 16 if kind == "parquet" else 16 <= result.info["blocks"] < 40
    assert bool(told(result)) is (order != "shuffled")
    assert nonsac.evaluation.rotation_error(result.R, views.T[:3, :3]) < 1.0
    if order == "right ones first":
        assert "being an inlier" in told(result)[0]
    assert not told(nonsac.relative_pose(source, **SETTINGS | {"draw": "rows"}))


def test_seeds_of_a_shuffled_file(tmp_path, few):
    source = written(tmp_path, table_of("shuffled")[1], "parquet")
    assert not [seed for seed in range(20) if told(nonsac.relative_pose(source, rng=seed, **SETTINGS))]


class Reading(nonsac.Source):
    """Counts the blocks that are read."""

    def __init__(self, source):
        self.source, self.width, self.read = source, source.width, set()

    @property
    def about(self):
        return self.source.about

    def __len__(self):
        return len(self.source)

    def take(self, indices):
        self.read |= set(np.asarray(indices) // GROUP)
        return self.source.take(indices)


def test_other_blocks_are_not_read_unless_all_rows_are_asked_for(tmp_path, few):
    _, table = table_of("shuffled")
    source = Reading(written(tmp_path, table, "parquet"))
    result = nonsac.relative_pose(source, **SETTINGS)
    assert len(source.read - {0}) <= 16  # and the first rows, which are looked at before anything is drawn
    assert len(result.inliers) == ROWS
    full = nonsac.relative_pose(source, **SETTINGS | {"refine": "full"})
    assert full.num_rows == ROWS
    assert result.info["blocks"] == full.info["blocks"] == 16


def test_chunks_of_hdf5_are_blocks(tmp_path, few):
    results = [
        nonsac.relative_pose(written(tmp_path, table_of(order)[1], "hdf5"), **SETTINGS)
        for order in ("shuffled", "by the image")
    ]
    assert [result.info["blocks"] for result in results] == [16, 16]
    assert [bool(told(result)) for result in results] == [False, True]


@pytest.mark.parametrize("kind", ["parquet", "npy"])
def test_seed_and_data_decide_whatever_the_workers(tmp_path, few, kind):
    source = written(tmp_path, table_of("by the image")[1], kind)
    one, three, other = (
        nonsac.relative_pose(source, samples=5, workers=workers, rng=seed, **SETTINGS)
        for workers, seed in ((1, 0), (3, 0), (1, 1))
    )
    assert one.T.tobytes() == three.T.tobytes() != other.T.tobytes()
    assert one.remarks == three.remarks


def test_rows_that_are_not_finite_do_not_matter(tmp_path, few):
    _, table = table_of("shuffled")
    table[::3, 1] = np.nan
    with pytest.warns(UserWarning, match="rows"):
        result = nonsac.relative_pose(written(tmp_path, table, "parquet"), **SETTINGS)
    assert result.success
    assert not told(result)


def test_nothing_found_is_told_as_well(tmp_path, few, rng):
    table = np.sort(rng.uniform(-1, 1, (ROWS, 4)), axis=0)[:, :1] + rng.uniform(-1, 1, (ROWS, 4))
    result = nonsac.relative_pose(written(tmp_path, table, "parquet"), samples=2, **SETTINGS)
    assert not result.success
    assert told(result)


def test_blocks_of_few_rows_are_all_drawn(tmp_path):
    result = nonsac.relative_pose(written(tmp_path, table_of("by the image")[1], "parquet"), **SETTINGS)
    assert "blocks" not in result.info
    assert not told(result)
