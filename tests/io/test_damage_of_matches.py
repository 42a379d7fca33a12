"""Whatever happens to a file of matches, reading it gives matches or an InputError."""

import contextlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from io_samples import npy, npz
from match_samples import PAIRS, POINTS, WEIGHTS, K, fill_database, parquet, write_binary_model, write_text_model
from nonsac.io import InputError, read_colmap_points, read_colmap_pose, read_matches, read_points

NAMES = [
    "pairs.npz",
    "points.npz",
    "a.npy",
    "a.csv",
    "a.parquet",
    "a.feather",
    "a.db",
    "cameras.bin",
    "images.bin",
    "points3D.bin",
]
NAMES += ["cameras.txt", "images.txt", "points3D.txt"]


@pytest.fixture(params=NAMES)
def whole(request, tmp_path):
    """The path of a valid file, with what belongs to it beside it."""
    path = tmp_path / request.param
    if path.suffix == ".npz":
        parts = {"x1": PAIRS[:, :2], "x2": PAIRS[:, 2:], "weights": WEIGHTS, "K1": K, "camera2": "PINHOLE 1 2 3 4"}
        path.write_bytes(npz(**parts) if path.stem == "pairs" else npz(points=POINTS, camera=K))
    elif path.suffix == ".parquet":
        columns = dict(zip(["x1", "y1", "x2", "y2"], PAIRS.T, strict=True))
        path.write_bytes(parquet(**columns, weight=WEIGHTS))
    elif path.suffix == ".npy":
        path.write_bytes(npy(PAIRS.shape, PAIRS.tobytes()))
    elif path.suffix == ".csv":
        path.write_text("x1;weight;y1;x2;name;y2\n1;.5;2;3;a;4\n7;.25;8;nan;;10\n")
    elif path.suffix == ".feather":
        table = pytest.importorskip("pyarrow").table(dict(zip(["x1", "y1", "x2", "y2"], PAIRS.T, strict=True)))
        pytest.importorskip("pyarrow.feather").write_feather(table, str(path))
    elif path.suffix == ".db":
        fill_database(path)
    else:
        (write_binary_model if path.suffix == ".bin" else write_text_model)(tmp_path)
    return path


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files(whole, data):
    content = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    damaged = whole.with_name(f"damaged{whole.suffix}")
    if whole.suffix in (".bin", ".txt"):
        damaged = whole.with_name("damaged") / whole.name
        damaged.parent.mkdir(exist_ok=True)
        for path in whole.parent.glob(f"*{whole.suffix}"):
            (damaged.parent / path.name).write_bytes(path.read_bytes())
    damaged.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    for read, *arguments in (
        (read_matches,),
        (read_points,),
        (read_matches, 3, "b.jpg"),
        (read_colmap_points, "b.jpg"),
        (read_colmap_pose, 4),
    ):
        with contextlib.suppress(InputError):
            assert len(read(damaged, *arguments)) >= 0
