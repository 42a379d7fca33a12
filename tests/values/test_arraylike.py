"""What calls take for arrays, and what they refuse with the way out."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.calls.arguments import points_argument, weights_argument
from nonsac.values.arraylike import as_array, cloud_array

XYZ = np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, np.nan], [9, 10, 11], [12, 13, 14]])
TABLE = "an array of real numbers"


class Tensor:
    """A tensor as PyTorch has it: NumPy takes one that has no gradient, lies on the CPU and is of a type it knows."""

    def __init__(self, array, gradient=True, device="cuda", kind="bfloat16"):
        self.array, self.gradient, self.device, self.kind = array, gradient, device, kind

    def detach(self):
        return Tensor(self.array, False, self.device, self.kind)

    def cpu(self):
        return Tensor(self.array, self.gradient, "cpu", self.kind)

    def double(self):
        return Tensor(self.array.astype(np.float64), self.gradient, self.device, "float64")

    def numpy(self):
        if self.gradient:
            raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy() instead.")
        if self.device != "cpu" or self.kind == "bfloat16":
            raise TypeError(f"can't convert {self.device} device type tensor to numpy, or {self.kind}")
        return self.array

    def __array__(self, dtype=None, copy=None):
        return self.numpy()

    def __len__(self):
        return len(self.array)


class Frame:
    """A DataFrame of pandas with nullable columns."""

    def __init__(self, **columns):
        self.data, self.columns = columns, tuple(columns)

    def __getitem__(self, names):
        return Frame(**{name: self.data[name] for name in names})

    def to_numpy(self, dtype=object, na_value=None):
        rows = np.array(list(self.data.values()), dtype=object).T
        if dtype is object:
            return rows
        return np.array([[na_value if value is None else value for value in row] for row in rows], dtype=dtype)

    def __array__(self, dtype=None, copy=None):
        return self.to_numpy()


def structured(**fields):
    array = np.zeros(len(XYZ), [(name, kind) for name, (kind, _) in fields.items()])
    for name, (_, values) in fields.items():
        array[name] = values
    return array


def columns(kind="f4"):
    return {name: (kind, np.nan_to_num(column)) for name, column in zip("xyz", XYZ.T, strict=True)}


PLAIN = np.nan_to_num(XYZ)
TENSORS = [
    Tensor(XYZ),
    Tensor(XYZ, gradient=False, device="cpu", kind="float64"),
    Tensor(XYZ, gradient=False, device="cuda", kind="float64"),
    Tensor(XYZ, gradient=True, device="cpu", kind="float64"),
    Tensor(XYZ, gradient=False, device="cpu", kind="bfloat16"),
    [Tensor(row) for row in XYZ],
]


@pytest.mark.parametrize("tensor", TENSORS)
def test_tensors(tensor):
    np.testing.assert_array_equal(points_argument(tensor, "points", 3), XYZ)
    np.testing.assert_array_equal(nonsac.ArraySource(tensor).take(np.arange(5)), XYZ)


def test_an_array_is_not_copied():
    assert as_array(XYZ, "points") is XYZ
    single = XYZ.astype(np.float32)
    assert np.shares_memory(points_argument(single, "points", 3), single)
    assert points_argument(single, "points", 3).dtype == np.float32


def test_real_libraries():
    torch = pytest.importorskip("torch")
    for tensor in (torch.tensor(XYZ, requires_grad=True), torch.tensor(XYZ).bfloat16(), torch.tensor(XYZ).half()):
        np.testing.assert_array_equal(points_argument(tensor, "points", 3), XYZ)


def test_real_tables():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"z": XYZ[:, 2], "x": XYZ[:, 0], "y": XYZ[:, 1], "label": list("abcde")})
    np.testing.assert_array_equal(points_argument(frame, "points", 3), XYZ)
    np.testing.assert_array_equal(points_argument(frame.convert_dtypes(), "points", 3), XYZ)
    nullable = pandas.DataFrame(XYZ[:, :2]).convert_dtypes()
    nullable.iloc[1, 0] = pandas.NA
    np.testing.assert_array_equal(points_argument(nullable, "points", 2)[:2], [[1, 2], [np.nan, 5]])
    weights = pandas.Series([1, 2, None, 3, 4], dtype="Int64")
    np.testing.assert_array_equal(weights_argument(weights, 5), [1, 2, np.nan, 3, 4])


def test_real_polars():
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"z": [3.0, None], "x": [1, 4], "y": [2.0, 5], "label": ["a", "b"]})
    np.testing.assert_array_equal(points_argument(frame, "points", 3), [[1, 2, 3], [4, 5, np.nan]])


@pytest.mark.parametrize(
    ("table", "width", "expected"),
    [
        (Frame(a=[1, 2], b=[3.5, None], c=[5, 6]), 3, [[1, 3.5, 5], [2, np.nan, 6]]),
        (Frame(y=[1, 2], x=[3, 4]), 2, [[3, 1], [4, 2]]),
        (Frame(intensity=[9, 9], z=[1, 2], Y=[3, 4], x=[5, 6]), 3, [[5, 3, 1], [6, 4, 2]]),
        (Frame(y1=[1, 2], x1=[3, 4]), 2, [[3, 1], [4, 2]]),
        (Frame(v=[1, 2], u=[3, 4], z=["a", "b"]), 2, [[3, 1], [4, 2]]),
        (structured(**columns()), 3, PLAIN),
        (structured(intensity=("u2", 7), **columns("f8")), 3, PLAIN),
        (structured(**columns("i8")), 3, PLAIN),
        (structured(X=("f8", 1), Y=("f8", 2), Z=("f8", 3)), 3, np.tile([1, 2, 3], (5, 1))),
    ],
)
def test_named_columns_are_found_by_name(table, width, expected):
    np.testing.assert_array_equal(points_argument(table, "points", width), expected)


def test_columns_that_are_there_twice_are_not_guessed():
    with pytest.raises(ValueError, match=r"points1 must have one point in each row \(n, 2\), got shape \(3, 4\)"):
        points_argument(Frame(**{name: [1, 2, 3] for name in ("x1", "y1", "x2", "y2")}), "points1", 2)


@pytest.mark.parametrize(
    "cloud",
    [
        SimpleNamespace(points=XYZ, colors=np.zeros((5, 3))),  # Open3D, PyVista
        SimpleNamespace(vertices=XYZ.tolist(), faces=[]),  # trimesh
        SimpleNamespace(points=XYZ * 1000, xyz=XYZ),  # laspy, whose points are numbers yet to be scaled
        SimpleNamespace(point={"positions": Tensor(XYZ, kind="float64", gradient=False)}),  # Open3D's tensors
    ],
)
def test_clouds_of_other_libraries(cloud):
    np.testing.assert_array_equal(points_argument(cloud, "source", 3), XYZ)
    np.testing.assert_array_equal(cloud_array(cloud, "source", TABLE), XYZ)


def test_a_las_file_in_memory(tmp_path):
    laspy = pytest.importorskip("laspy")
    las = laspy.create()
    las.header.scales, las.header.offsets = [0.01] * 3, [1000.0, 0, 0]
    las.x, las.y, las.z = 1000 + PLAIN.T[0], PLAIN.T[1], PLAIN.T[2]
    np.testing.assert_allclose(points_argument(las, "source", 3), PLAIN + np.array([1000, 0, 0]))
    with pytest.raises(TypeError, match=r"source must be an array of real numbers \(n, 3\), got the fields X, Y, Z"):
        points_argument(las.points.array, "source", 3)


def test_keypoints_of_opencv():
    cv2 = pytest.importorskip("cv2")
    keypoints = [cv2.KeyPoint(float(x), float(y), 1) for x, y in PLAIN[:, :2]]
    np.testing.assert_array_equal(points_argument(keypoints, "points1", 2), PLAIN[:, :2])
    np.testing.assert_array_equal(points_argument(tuple(keypoints), "points1", 2), PLAIN[:, :2])
    with pytest.raises(ValueError, match=r"got 5 and 4 rows: pass the keypoints that matches name, \[keypoints1\[m.qu"):
        nonsac.relative_pose(keypoints, keypoints[:4])
    with pytest.raises(TypeError, match=r"points1 must be an array .*: pass the points that they name, \[keypoints1"):
        nonsac.relative_pose([cv2.DMatch(0, 0, 0.5)], keypoints)


def test_masked_numbers_are_missing():
    masked = np.ma.masked_greater(np.arange(6).reshape(2, 3), 4)
    np.testing.assert_array_equal(points_argument(masked, "points", 3), [[0, 1, 2], [3, 4, np.nan]])
    np.testing.assert_array_equal(weights_argument(np.ma.masked_equal([1, 2, 3], 2), 3), [1, np.nan, 3])


def test_homogeneous_points_and_intensities():
    ones = np.column_stack([XYZ, [1, 1, np.nan, 1, 1]])
    np.testing.assert_array_equal(points_argument(ones, "source", 3), XYZ)
    np.testing.assert_array_equal(points_argument(ones[:, [0, 1, 3]], "points1", 2), XYZ[:, :2])
    with pytest.raises(
        ValueError, match=r"source .* got shape \(5, 4\): pass source\[:, :3\] if the last column is som"
    ):
        points_argument(np.column_stack([XYZ, np.linspace(0, 1, 5)]), "source", 3)


def test_organised_clouds():
    grid = np.arange(24.0).reshape(2, 4, 3)
    np.testing.assert_array_equal(points_argument(grid, "source", 3, organised=True), grid.reshape(8, 3))
    with pytest.raises(ValueError, match=r"source .* got shape \(2, 4, 3\): pass source.reshape\(-1, 3\)"):
        points_argument(grid, "source", 3)
    scans = simulate.demo_scans(rng=0)
    n = len(scans.source) // 4 * 4
    flat = nonsac.register_clouds(scans.source[:n], scans.target, samples=2)
    organised = nonsac.register_clouds(scans.source[:n].reshape(4, -1, 3), scans.target, samples=2)
    np.testing.assert_array_equal(organised.T, flat.T)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("a.ply", r"got the path 'a.ply': read the file first, with nonsac.io.read_cloud or nonsac.open_source"),
        (Path("a.ply"), r"got the path 'a.ply': read the file first"),
        (b"a.ply", r"got the path b'a.ply': read"),
        (None, "got None"),
        ((row for row in XYZ), "got generator"),
        ({1: 2}, "got dict"),
        (object(), "got object"),
        (nonsac.ArraySource(XYZ), "got ArraySource"),
        ([[1, 2, 3], [4, 5]], "got list that NumPy cannot take: .*inhomogeneous"),
        ([[1, 2, None]], "got dtype object"),
        (
            structured(a=("f4", 1), b=("f4", 1)),
            r"got the fields a, b: pass numpy.stack\(\[source\[field\] for field in ",
        ),
        (structured(**dict.fromkeys("xyz", ("S1", b"a"))), "got dtype .S1"),
    ],
)
def test_what_is_no_array_is_refused_by_name(value, message):
    with pytest.raises(
        (TypeError, ValueError), match=rf"^source must be an array of real numbers \(n, 3\), .*{message}"
    ):
        nonsac.register_clouds(value, XYZ)


@pytest.mark.parametrize("call", [nonsac.relative_pose, nonsac.absolute_pose, nonsac.register_pairs])
def test_paths_are_refused_with_the_way_out(call):
    with pytest.raises(TypeError, match=r"got the path 'm.csv': read the file first, with .* or nonsac.open_source"):
        call("m.csv")


def test_weights_of_another_shape():
    with pytest.raises(ValueError, match=r"weights must have .* \(5,\), got shape \(5, 1\): pass weights.ravel\(\)"):
        weights_argument(np.arange(5.0)[:, None], 5)


def test_cameras_of_tensors():
    K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
    plain = nonsac.Camera.parse(K)
    assert nonsac.Camera.parse(Tensor(K)) == plain
    assert nonsac.Camera.parse((Tensor(K), Tensor(np.zeros(5)))) == plain
    pixels = np.array([[1.0, 2], [3, 4]])
    np.testing.assert_array_equal(plain.normalise(Tensor(pixels)), plain.normalise(pixels))
