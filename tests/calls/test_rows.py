"""Sources in place of arrays, in the calls of the library."""

import pickle

import numpy as np
import pytest

import nonsac
from nonsac import ArraySource, JoinedSource, MappedSource, Source, simulate
from nonsac.calls.rows import rows_of_source, spread_rows
from nonsac.layouts import MATCHES, POINTS
from nonsac.sources import HeldSource
from nonsac.sources.columns import arranged
from nonsac.sources.contract import About

BENT = nonsac.Camera("OPENCV", (500, 510, 495, 505, -0.1, 0.02, 0.002, -0.001), 1000, 1020)
OTHER = nonsac.Camera("PINHOLE", (600, 610, 640, 615), 1280, 1240)
N = 3000
WEIGHTS = np.linspace(0.1, 1.0, N)


def views():
    found = simulate.relative_pose(N, 0.5, 0.001, 1)
    return BENT.project(found.points1), OTHER.project(found.points2)


def same(a, b):
    np.testing.assert_array_equal(a.T, b.T)
    np.testing.assert_array_equal(a.residuals, b.residuals)
    assert (a.status, a.confidence, a.num_inliers) == (b.status, b.confidence, b.num_inliers)


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_relative_pose_of_a_source_is_that_of_the_arrays(weights):
    a, b = views()
    rows = np.hstack([a, b] if weights is None else [a, b, weights[:, None]])
    expected = nonsac.relative_pose(a, b, BENT, OTHER, noise=0.5, weights=weights)
    assert expected.success
    same(nonsac.relative_pose(ArraySource(rows), camera1=BENT, camera2=OTHER, noise=0.5), expected)


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_absolute_pose_of_a_source_is_that_of_the_arrays(weights):
    scene = simulate.absolute_pose(N, 0.5, 0.001, 1)
    image = BENT.project(scene.points2d)
    rows = np.hstack([image, scene.points3d] if weights is None else [image, scene.points3d, weights[:, None]])
    expected = nonsac.absolute_pose(image, scene.points3d, BENT, noise=0.5, weights=weights)
    assert expected.success
    same(nonsac.absolute_pose(ArraySource(rows), camera=BENT, noise=0.5), expected)


@pytest.mark.parametrize("weights", [None, WEIGHTS])
@pytest.mark.parametrize("scale", [1.0, None])
def test_pairs_of_a_source_are_registered_as_the_arrays(weights, scale):
    pairs = simulate.registration(N, 0.5, 0.01, 1)
    both = [pairs.source, pairs.target]
    rows = np.hstack(both if weights is None else [*both, weights[:, None]])
    expected = nonsac.register_pairs(*both, noise=0.01, weights=weights, scale=scale)
    assert expected.success
    same(nonsac.register_pairs(ArraySource(rows), noise=0.01, scale=scale), expected)


def test_columns_with_the_standard_names_are_picked_wherever_they_are():
    a, b = views()
    rows = np.hstack([np.full((N, 1), np.nan), b, WEIGHTS[:, None], a])
    source = ArraySource(rows, ("id", "x2", "y2", "weight", "x1", "y1"))
    same(
        nonsac.relative_pose(source, camera1=BENT, camera2=OTHER, noise=0.5),
        nonsac.relative_pose(a, b, BENT, OTHER, noise=0.5, weights=WEIGHTS),
    )


def test_the_case_of_names_makes_no_difference():
    a, b = views()
    source = ArraySource(np.hstack([b, a]), ("X2", "Y2", "X1", "Y1"))
    same(
        nonsac.relative_pose(source, camera1=BENT, camera2=OTHER, noise=0.5),
        nonsac.relative_pose(a, b, BENT, OTHER, noise=0.5),
    )


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (("id", "x1", "y1", "x2"), "y2"),
        (("id", "x1", "y1", "x2", "other"), "y2"),
        (("y1", "x1", "p", "q"), "x2 y2"),
        (("a", "b", "c", "d"), "x1 y1 x2 y2"),
        (("x1", "y1", "u", "v"), "x2 y2"),
        (("a", "b", "c", "d", "weight"), "x1 y1 x2 y2"),
        (("x1", "y1", "x2", "Y2", "y2 "), None),
        (("x1", "y1", "x2", "Y2", "y2"), None),
        (("x1", "X1", "y1", "x2", "y2"), None),
        (("X1", "y1", "x2", "y2", "x1"), None),
    ],
)
def test_columns_that_have_names_are_found_by_them_or_refused(names, missing):
    source = ArraySource(np.arange(9.0 * len(names)).reshape(9, -1), names)
    if missing is None:
        places = [names.index(name) if name in names else names.index(name.upper()) for name in MATCHES.names]
        np.testing.assert_array_equal(arranged(source, MATCHES).take(np.arange(9)), source.rows[:, places])
        return
    with pytest.raises(ValueError, match="rows of ") as caught:
        arranged(source, MATCHES)
    held = (
        f"rows of {len(names)} columns ({' '.join(names)}), of which none is called {missing}; rename the columns, or"
    )
    way_out = "choose them, by name or position (columns=, --columns), in the order of x1 y1 x2 y2"
    assert str(caught.value) == f"{held} {way_out}"


def test_a_name_that_two_columns_have_in_other_case_is_nobodys():
    with pytest.raises(ValueError, match=r"where several columns could be X \(x, x\); rename"):
        arranged(ArraySource(np.zeros((9, 3)), ("u", "x", "x")), nonsac.Layout("u X"))


@pytest.mark.parametrize("names", [None, ("x1", "y1", "x2", "y2"), ("X1", "Y1", "X2", "Y2", "Weight")])
def test_columns_in_their_order_are_left_as_they_are(names):
    source = ArraySource(np.zeros((9, len(names or range(4)))), names)
    assert arranged(source, MATCHES) is source


def test_a_table_on_disk(tmp_path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    scene = simulate.absolute_pose(N, 0.5, 0.001, 1)
    columns = {"word": ["a"] * N, "z": scene.points3d[:, 2], "y": scene.points3d[:, 1], "x": scene.points3d[:, 0]}
    columns |= {"v": scene.points2d[:, 1], "u": scene.points2d[:, 0], "other": np.full(N, np.nan)}
    parquet.write_table(pa.table(columns), tmp_path / "rows.parquet", row_group_size=1000)
    source = nonsac.open_source(tmp_path / "rows.parquet")
    same(
        nonsac.absolute_pose(source, noise=0.001),
        nonsac.absolute_pose(scene.points2d, scene.points3d, noise=0.001),
    )
    assert arranged(source, POINTS).names == ("u", "v", "x", "y", "z")


def test_only_a_few_rows_are_looked_at_before():
    seen = []
    rows = ArraySource(np.zeros((10_000, 5)))
    given = rows_of_source(MappedSource(rows, lambda taken: seen.append(len(taken)) or taken), MATCHES, "points1")
    assert max(seen) == 1000
    assert [part.shape for part in given.parts] == [(1000, 2), (1000, 2)]
    assert given.weighted


def test_what_passes_through_the_cameras_travels():
    given = rows_of_source(ArraySource(np.hstack(views())), MATCHES, "points1")
    source = pickle.loads(pickle.dumps(given.through([BENT.normalise, None])))
    np.testing.assert_array_equal(source.take(np.array([3]))[:, :2], BENT.normalise(views()[0][[3]]))
    assert given.through([None, None]) is given.source


def test_pixels_without_a_camera_are_noticed():
    a, b = views()
    rows = ArraySource(np.hstack([a, OTHER.normalise(b)]))
    with pytest.warns(UserWarning, match="points1 look like pixels"):
        assert not nonsac.relative_pose(rows, samples=1).success


def test_rows_that_are_not_finite_are_dropped():
    pairs = simulate.registration(N, 0.5, 0.01, 1)
    rows = np.hstack([pairs.source, pairs.target])
    rows[::10] = np.nan
    with pytest.warns(UserWarning, match=r"dropped \d+ sampled rows with NaN"):
        assert nonsac.register_pairs(ArraySource(rows), noise=0.01).success


class Blocks(ArraySource):
    def __init__(self, starts):
        super().__init__(np.zeros((starts[-1], 4)))
        self.starts = np.array(starts)

    @property
    def about(self):
        return About(blocks=self.starts)


def test_rows_spread_over_a_source():
    assert spread_rows(ArraySource(np.zeros((10, 1))), 4, 8).tolist() == [0, 2, 5, 7]
    assert spread_rows(ArraySource(np.zeros((3, 1))), 4, 8).tolist() == [0, 1, 2]
    assert spread_rows(ArraySource(np.zeros((0, 1))), 4, 8).tolist() == []
    assert spread_rows(Blocks([0, 5, 5, 8]), 99, 8).tolist() == list(range(8))
    found = spread_rows(Blocks([0, *range(100, 100_001, 100)]), 400, 8)
    assert len(found) == len(set(found)) == 400
    assert len(set(found // 100)) == 8
    assert found.max() - found.min() > 80_000


def test_what_does_not_fit_is_refused():
    source = ArraySource(np.zeros((10, 7)))
    for call, name, columns in (
        (nonsac.relative_pose, "points1", r"4 \(x1 y1 x2 y2\), or 5"),
        (nonsac.absolute_pose, "points2d", r"5 \(u v X Y Z\), or 6"),
    ):
        with pytest.raises(ValueError, match=rf"{name} is a source with rows of 7 columns, not of {columns}"):
            call(source)
    with pytest.raises(ValueError, match=r"source is a source with rows of 4 columns, not of 6 \(x1 y1 z1 x2 y2 z2\)"):
        nonsac.register_pairs(ArraySource(np.zeros((10, 4))))
    named = ArraySource(np.zeros((10, 3)), ("a", "b", "x1"))
    with pytest.raises(
        ValueError, match=r"points1 is a source with rows of 3 columns \(a b x1\), of which none is cal"
    ):
        nonsac.relative_pose(named)
    with pytest.raises(ValueError, match="points2 must be left out if points1 is a source"):
        nonsac.relative_pose(source, np.zeros((10, 2)))
    with pytest.raises(ValueError, match="weights must be left out if source is a source"):
        nonsac.register_pairs(source, weights=np.ones(10))
    for call, name in (
        (nonsac.relative_pose, "points2"),
        (nonsac.absolute_pose, "points3d"),
        (nonsac.register_pairs, "target"),
    ):
        with pytest.raises(TypeError, match=f"{name} must be an array of real numbers"):
            call(np.zeros((10, 3 if name == "target" else 2)))


# --- weights that are all the same ------------------------------------------------------------------------------------


def weighted(rows, weights):
    """The same rows as sources of several kinds, of which the last column is a weight."""
    table = np.column_stack([rows, weights])
    names = ("weight", *reversed(MATCHES.names))
    return {
        "array": ArraySource(table),
        "joined": JoinedSource([rows[:, :2], rows[:, 2:], table[:, 4:]]),
        "named": arranged(ArraySource(table[:, ::-1], names), MATCHES),
        "names": ArraySource(table[:, ::-1], names),
    }


@pytest.mark.parametrize("kind", ["array", "joined", "named", "names"])
def test_equal_weights_are_none(kind):
    """As in arrays: there is a covariance then."""
    a, b = views()
    source = weighted(np.hstack([a, b]), np.full(N, 0.3))[kind]
    expected = nonsac.relative_pose(a, b, BENT, OTHER, noise=0.5)
    found = nonsac.relative_pose(source, camera1=BENT, camera2=OTHER, noise=0.5)
    same(found, expected)
    np.testing.assert_array_equal(found.covariance, expected.covariance)


@pytest.mark.parametrize("weights", [[0.5] * 2999 + [0.6], [0.0] * 3000, [np.nan] * 3000, [np.inf] * 3000])
@pytest.mark.parametrize("kind", ["array", "joined", "named", "names"])
def test_other_weights_are_weights(kind, weights):
    given = rows_of_source(weighted(np.ones((3000, 4)), np.array(weights))[kind], MATCHES, "points1")
    assert given.weighted
    assert given.source.width == 5


@pytest.mark.parametrize("kind", ["array", "joined", "named", "names"])
def test_negative_weights_are_refused(kind):
    with pytest.raises(ValueError, match=r"weights must not be negative, got -1"):
        rows_of_source(weighted(np.ones((3000, 4)), np.array([0.5, -1.0, 2.0] * 1000))[kind], MATCHES, "points1")


def test_no_weight_at_all_is_refused():
    with pytest.raises(ValueError, match=r"weights must not all be zero"):
        rows_of_source(ArraySource(np.column_stack([np.ones((100, 4)), np.zeros(100)])), MATCHES, "points1")


class Costly(Source):
    """Rows with equal weights that are in memory, as somebody says, but not in an array."""

    width = 5

    def __init__(self):
        self.taken = []

    @property
    def about(self):
        return About(in_memory=True)

    def __len__(self):
        return 10**9

    def take(self, indices):
        self.taken.append(len(indices))
        return np.ones((len(indices), 5))


@pytest.mark.parametrize("make", [lambda source: source, HeldSource, lambda s: MappedSource(s, np.sqrt)])
def test_weights_are_looked_at_in_arrays_only(make):
    source = Costly()
    assert rows_of_source(make(source), MATCHES, "points1").weighted
    assert sum(source.taken) <= 1000


def test_weights_that_differ_are_looked_at_no_further():
    class Counting(ArraySource):
        seen = 0

        def chunks(self, *bounds):
            for chunk in super().chunks(*bounds):
                Counting.seen += len(chunk)
                yield chunk

    assert rows_of_source(Counting(np.random.default_rng(0).random((10**6, 5))), MATCHES, "points1").weighted
    assert Counting.seen <= 2000


# --- what is refused before a row is read -----------------------------------------------------------------------------


class Unread(Source):
    """Fails the test if it is read."""

    width = 6

    def __len__(self):
        return 1000

    def take(self, indices):
        raise AssertionError("rows are read")


@pytest.mark.parametrize(
    "call",
    [
        nonsac.register_pairs,
        lambda source, **settings: nonsac.relative_pose(source.narrowed(range(4)), **settings),
        lambda source, **settings: nonsac.absolute_pose(source.narrowed(range(5)), **settings),
        lambda source, **settings: nonsac.estimate(source, nonsac.Registration(), "ransac", **settings),
    ],
    ids=["register_pairs", "relative_pose", "absolute_pose", "estimate"],
)
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"workers": 0}, "workers must be .*got 0"),
        ({"workers": -2}, "workers must be .*got -2"),
        ({"workers": True}, "workers must be .*got True"),
        ({"workers": 2.5}, "workers must be .*got 2.5"),
        ({"workers": [1]}, r"workers must be .*got \[1\]"),
        ({"workers": "many"}, "workers must be .*got 'many'"),
        ({"noise": 0.0}, "noise must be a positive number"),
        ({"rule": "best"}, "rule must be one of"),
        ({"refine": "icp"}, "refine must be"),
        ({"sample_size": 0}, "sample_size must be"),
    ],
)
def test_a_wrong_setting_is_refused_before_a_row_is_read(call, settings, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call(Unread(), **settings)
