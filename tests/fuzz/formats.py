"""All kinds of files that the package reads: small whole ones, how they are changed, and what reads them."""

from __future__ import annotations

import io
import json
import random
import struct
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import match_samples
import nonsac
from fuzz import bombs, mutations
from fuzz.mutations import ARCHIVE, DATABASE, JSON, TEXT, Change, Files
from io_samples import FACES, XYZ, compressed, mixed_faces, npy, npz, pcd_header, ply_header
from nonsac import io as nio
from nonsac.io import colmap_binary, colmap_text
from nonsac.io.clouds import TEXT_SUFFIXES
from nonsac.io.colmap_pairs import DatabasePairs

Read = Callable[[Path], object]
CANARY = 8642.0  # stands in a file beside the input, which nothing has to read
_ROWS = np.random.default_rng(0).normal(size=(40, 6)).round(6)
_FEW = 200_000  # rows that are read whole


@dataclass(frozen=True, eq=False)
class Format:
    """A kind of file.

    Attributes
    ----------
    seeds
        Makes whole files, each a dict from names to contents.
    reads
        What reads them, given their folder. Each has to return, or raise a documented error.
    aware
        Changes that know the format.
    build
        Makes whole but odd files, from a random generator.
    cost
        Milliseconds of an input, about: how many are tried depends on it.
    needs
        Libraries without which it is left out.
    """

    seeds: Callable[[], list[Files]]
    reads: Sequence[Read]
    aware: Sequence[Change] = ()
    build: Callable[[random.Random], Files] | None = None
    cost: float = 1.0
    needs: Sequence[str] = ()
    documented: Callable[[], tuple[type[BaseException], ...]] = field(default=lambda: (nonsac.InputError,))

    def files(self, name: str, seed: int, number: int) -> Files:
        """Input number `number`: the same for ever, as long as this code is the same."""
        rng = random.Random(f"{name}/{seed}/{number}")
        if self.build is not None and rng.random() < 0.35:
            built = self.build(rng)
            return built if rng.random() < 0.7 else mutations.mutated(rng, built, rng.choice(_made(self)), self.aware)
        seeds = _made(self)
        return mutations.mutated(rng, rng.choice(seeds), rng.choice(seeds), self.aware)


@cache
def _made(format: Format) -> list[Files]:
    return format.seeds()


# --- reading -----------------------------------------------------------------------------------


def exhaust(source: nonsac.Source) -> None:
    """Read a source in all ways, which must agree."""
    count, width = len(source), source.width
    assert count >= 0, f"a source of {count} rows"
    assert width >= 1, f"a source of {width} columns"
    first = next(iter(source.chunks(7, 0, 7)), np.empty((0, width)))
    assert first.shape == (min(count, 7), width), f"a chunk of shape {first.shape}, of {count} rows and {width} columns"
    places = np.unique(np.array([0, count // 2, count - 1])) if count else np.empty(0, np.int64)
    rows = source.take(places)
    assert rows.shape == (len(places), width), f"rows of shape {rows.shape}"
    assert rows.dtype == np.float64, f"rows of type {rows.dtype}"
    if count:
        assert np.array_equal(rows[0], first[0], equal_nan=True), "take and chunks differ"
        _check(rows)
    if count <= _FEW:
        whole = [*source.chunks(1000)]
        assert sum(map(len, whole)) == count, f"chunks of {sum(map(len, whole))} rows, of {count}"


def _check(rows: Any) -> None:
    assert not np.any(rows == CANARY), "the content of another file"


def _read_any(folder: Path) -> None:
    for path in folder.iterdir():
        if path.suffix == ".pcd":
            nio.read_cloud(path)
        elif path.suffix != ".bin":
            exhaust(nonsac.open_source(path))


def _points(read: Callable[[Path], Any]) -> Callable[[Path], object]:
    def points(path: Path) -> None:
        found = read(path)
        assert found.shape == (max(len(found), 1), 3), f"points of shape {found.shape}"
        assert found.dtype == np.float64, f"points of type {found.dtype}"
        assert found.flags.c_contiguous, "points not in C order"
        _check(found)

    return points


def _cloud(name: str) -> Read:
    read = _points(nio.read_cloud)
    return lambda folder: read(folder / name)


def _source(name: str, **options: Any) -> Read:
    return lambda folder: exhaust(nonsac.open_source(folder / name, **options))


def _matches(read: Callable[..., Any], name: str, *images: Any) -> Read:
    def matches(folder: Path) -> None:
        found = read(folder / name, *images)
        held = found if isinstance(found, tuple) else vars(found).values()
        parts = [part for part in held if isinstance(part, np.ndarray)]
        for part in parts:
            if part.shape != (3, 3):
                assert len(part) == len(parts[0]), f"parts of {len(part)} and {len(parts[0])} rows"
                _check(part)

    return matches


# --- text --------------------------------------------------------------------------------------


def _written(*names: str) -> list[Files]:
    """Files that the package itself writes."""
    with tempfile.TemporaryDirectory() as folder:
        made = []
        for name in names:
            nio.write_cloud(Path(folder) / name, _ROWS[:, :3])
            made.append((Path(folder) / name).read_bytes())
    return [{name: content} for name, content in zip(names, made, strict=True)]


def _text(*contents: bytes) -> list[Files]:
    return [{"a.txt": content} for content in contents]


def _rows_of_text(width: int, separator: str = " ", rows: int = 12) -> bytes:
    return "".join(separator.join(f"{number:.6g}" for number in row[:width]) + "\n" for row in _ROWS[:rows]).encode()


def _clouds_of_text() -> list[Files]:
    """With every suffix, the words of the other files in each."""
    contents = [content for files in _contents_of_clouds() for content in files.values()]
    return [{f"a{TEXT_SUFFIXES[number % len(TEXT_SUFFIXES)]}": content} for number, content in enumerate(contents * 2)]


def _read_any_cloud(folder: Path) -> None:
    for path in folder.iterdir():
        _points(nio.read_cloud)(path)


def _contents_of_clouds() -> list[Files]:
    return [
        *_text(
            _rows_of_text(3), b"12\n" + _rows_of_text(3), b"# x y z\n" + _rows_of_text(6), b"x y z\n" + _rows_of_text(3)
        ),
        *_text(b"x,y,z,i\n" + _rows_of_text(4, ","), b"\xef\xbb\xbfid;y;x;z\r\n" + _rows_of_text(4, ";")),
        *_text(
            b"//X Y Z R G B\n" + _rows_of_text(6), b"X,Y,Z\n" + _rows_of_text(3, ", "), b"1 2 3 # near\n4 5 6 // far\n"
        ),
    ]


def _tables_of_text() -> list[Files]:
    return [
        *_text(b"x1,y1,x2,y2\n" + _rows_of_text(4, ","), b"x2,y2,x1,y1,weight\n" + _rows_of_text(5, ",")),
        *_text(b"u v X Y Z\n" + _rows_of_text(5), b"x1;y1;z1;x2;y2;z2\n" + _rows_of_text(6, ";"), _rows_of_text(4)),
        *_text(b"% x1 y1 x2 y2\n" + _rows_of_text(4), b'"id","x1","y1","x2","y2"\n' + _rows_of_text(5, ",")),
        *_text(b"name,x1,y1,x2,y2\na,1,2,3,4\nb,5,6,7,nan\n", _rows_of_text(6, "\t")),
    ]


def _transforms() -> list[Files]:
    return _text(
        b"1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", b"0,-1,0,2.5\n1,0,0,1e3\n0,0,1,-7\n0,0,0,1\n", b"# T\n1;0;0;0\n" * 4
    )


def _truths() -> list[Files]:
    whole = b'{"rows": 9, "T": [[1, 0, 0, 0], [0, 1, 0, 2.5], [0, 0, 1, -7e3], [0, 0, 0, 1]], "seed": 0}'
    return [{"a.json": whole}, {"a.json": whole.replace(b", ", b",\n ")}]


def _camera_files() -> list[Files]:
    return _text(
        b"500 0 320\n0 500 240\n0 0 1\n", b"1000,0,800\n0,1000,600\n0,0,1\n", b"# K\n5e2 0 3\n0 5e2 2\n0 0 1\n"
    )


def _read_camera_file(folder: Path) -> None:
    from nonsac.cli.options import camera_of

    camera_of(str(folder / "a.txt"))


def _camera_lines() -> list[Files]:
    lines = b"1 PINHOLE 640 480 500 510 320 240", b"OPENCV 640 480 500 510 320 240 0.1 0.01 0.001 0.002"
    return _text(*lines, b"SIMPLE_RADIAL 500 320 240 0.1", b"OPENCV_FISHEYE 500 500 320 240 0.1 0 0 0")


def _read_camera_line(folder: Path) -> None:
    text = (folder / "a.txt").read_bytes().decode(errors="replace")
    camera = nonsac.Camera.parse(text, name="a.txt")
    camera.project(camera.normalise(np.array([[0.0, 0], [320, 240], [1e5, -1e5], [np.nan, 0]])))


# --- clouds ------------------------------------------------------------------------------------


def _ply_ascii() -> list[Files]:
    body = b"3 0 1 2\n3 0 1 2\n1 2 3\n4 5 6\n"
    colours = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
    lists = f"element vertex 2\nproperty list uchar float w\n{XYZ}"
    contents = [
        ply_header("ascii", FACES, f"element vertex 2\n{XYZ}") + body,
        ply_header("ascii", colours) + b"1 2 3 4\n5 6 7 8\n",
        ply_header("ascii", lists) + b"2 7 8 1 2 3\n0 4 5 6\n",
    ]
    return [{"a.ply": content} for content in contents]


def _ply_binary(order: str) -> list[Files]:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    points = _ROWS[:2, :3].astype(order + "f8").tobytes()
    mixed = (
        "element vertex 2\nproperty short s\nproperty float x\nproperty double y\nproperty int z\nproperty uchar c\n"
    )
    contents = [
        ply_header(form, FACES, f"element vertex 2\n{XYZ}") + mixed_faces(order) + points,
        ply_header(form, f"element vertex 2\n{XYZ}", FACES) + points + mixed_faces(order),
        ply_header(form, f"element vertex 1\nproperty list uchar short w\n{XYZ}")
        + b"\x02\x01\x00\x01\x00"
        + points[:24],
        ply_header(form, mixed) + struct.pack(order + "hfdiB", 1, 2, 3, 4, 5) * 2,
        ply_header(form, f"element empty 5\nelement vertex 2\n{XYZ}") + points,
    ]
    return [{"a.ply": content} for content in contents] + (_written("a.ply") if order == "<" else [])


def _pcd(data: str) -> list[Files]:
    values = _ROWS[:2, :3]
    if data == "ascii":
        body = b"1 2 3\n4 5 6\n"
    elif data == "binary":
        body = values.tobytes()
    else:
        body = compressed(values.T.tobytes())
    organised = pcd_header(data, {"WIDTH": "1", "HEIGHT": "2"}) + body
    contents = [pcd_header(data) + body, organised]
    if data != "ascii":
        odd = {"FIELDS": "x _ y z rgb", "SIZE": "4 1 4 4 4", "TYPE": "F U F F U", "COUNT": "1 4 1 1 1"}
        body = bytes(range(40))
        contents.append(pcd_header(data, odd) + (body if data == "binary" else compressed(body)))
    if data == "binary_compressed":  # with matches, which repeat what was there
        matched = b"\x00\x01\xe0\x1d\x00\xe0\x00\x00"
        contents.append(pcd_header(data) + struct.pack("<II", len(matched), 48) + matched)
    return [{"a.pcd": content} for content in contents] + (_written("a.pcd") if data == "binary" else [])


def _las(suffix: str) -> list[Files]:
    import laspy

    made = []
    for kind, version in ((0, "1.2"), (3, "1.2"), (6, "1.4"), (7, "1.4")):
        header = laspy.LasHeader(point_format=kind, version=version)
        header.offsets, header.scales = [1000.0, 2000.0, 0.0], [0.01, 0.01, 0.001]
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = (_ROWS[:20, :3] * 10 + [1000, 2000, 5]).T
        buffer = io.BytesIO()
        cloud.write(buffer, do_compress=suffix == "laz")
        made.append({f"a.{suffix}": buffer.getvalue()})
    return made


# --- NumPy -------------------------------------------------------------------------------------

_DTYPES = ["<f8", "<f8", "<f4", ">f8", ">i4", "<i2", "|u1", "|i1", "<u8", "<f2"]
_DTYPES += ["|b1", "<c16", "|O", "|V8", "<M8[s]", "<U3", "|S4", "|S0", "<f16"]
_SIZES = (0, 1, 2, 3, 4, 5, 6, 7, 16, 40)


def _odd_array(rng: random.Random) -> Any:
    kind = rng.choice(_DTYPES[:10] if rng.random() < 0.7 else _DTYPES)
    shape = rng.choice(((40, 4), (40, 3), (40, 6), (40, 5), tuple(rng.choice(_SIZES) for _ in range(rng.randrange(4)))))
    size = int(np.prod(shape))
    if kind == "|O":
        return np.array([None] * size, object).reshape(shape)
    dtype = np.dtype(kind)
    array = np.frombuffer(rng.randbytes(size * dtype.itemsize), dtype, size).reshape(shape) if dtype.itemsize else None
    if array is None or dtype.kind not in "fiu":
        return np.zeros(shape, dtype)
    return array if rng.random() < 0.3 else rng.choice((np.asfortranarray, np.ascontiguousarray))(array)


def _fields(names: Sequence[str]) -> Any:
    array = np.zeros(
        12, [(name, kind) for name, kind in zip(names, ("<f8", ">f4", "<i4", "|u1", "<f8", "<f8"), strict=False)]
    )
    for name in names:
        array[name] = np.arange(12)
    return array


def _saved(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def _npy_seeds() -> list[Files]:
    arrays = [
        _ROWS[:, :3],
        _ROWS[:, :4].astype(">f4"),
        np.asfortranarray(_ROWS[:, :4]),
        _fields(["x1", "y1", "x2", "y2"]),
    ]
    contents = [*map(_saved, arrays), npy((5, 3), _ROWS[:5, :3].tobytes())]
    return [{"a.npy": content} for content in contents]


def _npy_build(rng: random.Random) -> Files:
    shape = rng.choice((f"({rng.choice(_ODD_LENGTHS)}, {rng.choice(_ODD_LENGTHS)})", f"({rng.choice(_ODD_LENGTHS)},)"))
    if rng.random() < 0.5:
        return {"a.npy": npy(shape, _ROWS.tobytes(), rng.choice(_DTYPES[:10]))}
    return {"a.npy": _saved(_odd_array(rng))}


_ODD_LENGTHS = (-5, -1, 0, 1, 3, 4, 40, 60, 10**4, 10**9, 10**15, 2**62, 2**63, 10**22, "True", "4.0", "None", "'3'")


_WARPED = {"W_A": 64, "H_A": 48, "W_B": 64, "H_B": 48}


def _npz_seeds() -> list[Files]:
    pairs = {"points1": _ROWS[:, :2], "points2": _ROWS[:, 2:4], "weights": np.ones(40)}
    cameras = {"K1": match_samples.K, "camera2": "PINHOLE 1 2 3 4"}
    archives = [pairs, pairs | cameras, {"source": _ROWS[:, :3], "target": _ROWS[:, 3:]}, {"a": _ROWS[:, :4]}]
    archives += [{"flow": _ROWS[:, :2].reshape(5, 8, 2), "valid": np.ones((5, 8))}]
    archives += [{"warp": _ROWS[:, :4].reshape(5, 8, 4), "certainty": np.ones((5, 8)), **_WARPED}]
    archives += [{"points": _ROWS[:, :3]}, {"xyz": _ROWS[:, :3]}, {"points2d": _ROWS[:, :2], "points3d": _ROWS[:, 2:5]}]
    deflated = io.BytesIO()
    np.savez_compressed(deflated, points1=np.zeros((5000, 2)), points2=np.zeros((5000, 2)))
    return [{"a.npz": npz(**archive)} for archive in archives] + [{"a.npz": deflated.getvalue()}]


_KEYS = ["points", "points1", "points2", "weights", "source", "target", "xyz", "keypoints0", "keypoints1", "matches"]
_KEYS += ["flow", "valid", "warp", "certainty", *_WARPED]
_KEYS += ["camera1", "K1", "K", "camera", "points2d", "points3d", "x", "X"]


def _npz_build(rng: random.Random) -> Files:
    members = {rng.choice(_KEYS): _odd_array(rng) for _ in range(rng.randrange(5))}
    return {"a.npz": npz(**members)}


def _flow_seeds() -> list[Files]:
    moves = _ROWS[:, :2].reshape(5, 8, 2)
    return [{"a.flo": match_samples.middlebury(each)} for each in (moves, moves[:1, :1], 1e10 * moves)]


def _flow_png_seeds() -> list[Files]:
    moves = _ROWS[:, :2].reshape(5, 8, 2)
    return [{"a.png": match_samples.kitti(moves, np.arange(40).reshape(5, 8) % 7)}]


def _read_raw(folder: Path) -> None:
    path = folder / "a.raw"
    exhaust(nonsac.RawSource(path, "<f8", 4))
    exhaust(nonsac.RawSource(path, ">f4", 3, offset=8, rows=5))


def _raw_seeds() -> list[Files]:
    return [{"a.raw": _ROWS[:, :4].tobytes()}, {"a.raw": _ROWS.astype(">f4").tobytes()}]


# --- HDF5 --------------------------------------------------------------------------------------

_STORAGE: dict[str, dict[str, Any]] = {
    "contiguous": {},
    "chunked": {"chunks": (16, 2)},
    "lzf": {"chunks": (16, 4), "compression": "lzf"},
    "gzip": {"chunks": (16, 4), "compression": "gzip", "shuffle": True, "fletcher32": True},
}


def _h5(fill: Callable[[Any], object], **options: Any) -> bytes:
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", **options) as file:
        fill(file)
    return buffer.getvalue()


def _hdf5_seeds(storage: str) -> list[Files]:
    options = _STORAGE[storage]
    columns = {key: ((16,) if key == "chunks" else value) for key, value in options.items()}

    def whole(file: Any) -> None:
        file.create_dataset("rows", data=_ROWS[:, :4], **options)

    def parts(file: Any) -> None:
        for name, column in zip(("x1", "y1", "x2", "y2"), _ROWS.T, strict=False):
            file.create_dataset(name, data=column.astype("<f4"), **columns)

    contents = [_h5(whole), _h5(whole, libver="latest"), _h5(whole, userblock_size=512), _h5(parts)]
    return [{"a.h5": content, "other.bin": _canary()} for content in contents]


def _canary() -> bytes:
    return np.full(640, CANARY).tobytes()


def _hdf5_build(rng: random.Random) -> Files:
    import h5py

    def fill(file: Any) -> None:
        for name in rng.sample(["rows", "x1", "y1", "x2", "y2", "g/rows"], rng.randrange(1, 4)):
            what = rng.randrange(7)
            if what < 3:
                array = _odd_array(rng)
                if array.dtype.kind in "fiu" and array.ndim:
                    options = rng.choice(list(_STORAGE.values())) if array.ndim == 2 and array.size else {}
                    chunks = options.get("chunks") and tuple(map(min, options["chunks"], array.shape))
                    file.create_dataset(name, data=array, **options | ({"chunks": chunks} if chunks else {}))
                else:
                    file[name] = np.zeros(array.shape, rng.choice(("i1", "c8", "S3", "?")))
            elif what == 3:  # no chunk of it is written
                shape, chunks = (
                    rng.choice(((40, 4), (10**6, 4), (10**12, 4))),
                    rng.choice(((16, 4), (2, 2), (10**5, 4))),
                )
                chunks = tuple(map(min, chunks, shape))
                filters = rng.choice((None, "gzip", "lzf"))
                empty = file.create_dataset(name, shape, "<f8", chunks=chunks, maxshape=(None, 4), compression=filters)
                if rng.random() < 0.5:
                    empty[0] = 1.0
            elif what == 4:
                file.create_dataset(name, (40, 4), "<f8", external=[("other.bin", 0, h5py.h5f.UNLIMITED)])
            elif what == 5:
                file[name] = rng.choice(
                    (h5py.ExternalLink("other.bin", "/rows"), h5py.SoftLink(rng.choice(("/", "/no"))))
                )
            else:
                _add_virtual(file, name, rng.choice((b".", b"other.h5")))

    try:
        return {"a.h5": _h5(fill), "other.bin": _canary()}
    except (ValueError, TypeError, OSError, RuntimeError):
        return {"a.h5": _h5(lambda file: file.create_group("x")), "other.bin": _canary()}


def _add_virtual(file: Any, name: str, source: bytes) -> None:
    """A dataset whose first half lies in another one; without the time at which it was made."""
    from h5py import h5d, h5p, h5s, h5t

    creation, space = h5p.create(h5p.DATASET_CREATE), h5s.create_simple((40, 4))
    creation.set_obj_track_times(False)
    creation.set_layout(h5d.VIRTUAL)
    space.select_hyperslab((0, 0), (20, 4))
    creation.set_virtual(space, source, b"g/rows", h5s.create_simple((20, 4)))
    h5d.create(file.id, name.rpartition("/")[2].encode(), h5t.IEEE_F64LE, h5s.create_simple((40, 4)), creation)


def _hdf5_reads() -> Sequence[Read]:
    return _source("a.h5"), _source("a.h5", dataset="rows"), _source("a.h5", columns=["x1", "y1", "x2", "y2"])


def _hloc_seeds() -> list[Files]:
    def features(file: Any) -> None:
        for image in ("db/1.jpg", "2.jpg"):
            file[f"{image}/keypoints"] = _ROWS[:, :2].astype("<f2")

    def matches(file: Any, name: str) -> None:
        file[f"{name}/matches0"] = np.arange(40)[::-1].astype("<i2")
        file[f"{name}/matching_scores0"] = np.linspace(0, 1, 40, dtype="<f2")

    names = ("db-1.jpg/2.jpg", "db-1.jpg_2.jpg", "2.jpg/db-1.jpg")
    return [{"f.h5": _h5(features), "m.h5": _h5(lambda file, name=name: matches(file, name))} for name in names]


def _read_hloc(folder: Path) -> None:
    found = nio.read_hloc(folder / "f.h5", folder / "m.h5", "db/1.jpg", "2.jpg")
    assert len(found.points1) == len(found.points2) == len(found.indices), "parts of unequal length"


# --- Zarr, Parquet, Arrow ----------------------------------------------------------------------


def _slurped(folder: Path) -> Files:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _zarr_seeds(version: int) -> list[Files]:
    import zarr

    made = []
    for compressed_too in (False, True):
        for grouped in (False, True):
            with tempfile.TemporaryDirectory() as name:
                codecs = {} if compressed_too else {"compressors": None}
                group = zarr.open_group(name, mode="w", zarr_format=version) if grouped else None
                place = {"name": "rows"} if group is not None else {"store": name, "zarr_format": version}
                create = zarr.create_array if group is None else group.create_array
                array = create(**place, shape=(40, 4), chunks=(16, 4), dtype="<f8", **codecs)
                array[:] = _ROWS[:, :4]
                made.append({f"a.zarr/{file}": content for file, content in _slurped(Path(name)).items()})
    return made


def _parquet_table(rng: random.Random | None = None) -> Any:
    import pyarrow as pa

    names = ["x1", "y1", "x2", "y2", "weight"]
    if rng is None:
        return pa.table(dict(zip(names, _ROWS.T, strict=False)))
    count, kinds = rng.choice((0, 1, 40, 40, 3000)), _kinds_of_columns()
    columns, chosen = [], []
    for place in range(rng.randrange(7)):
        columns.append(_column(count, rng.choice(kinds[:3] if rng.random() < 0.7 else kinds), rng.random() < 0.1))
        chosen.append(
            rng.choice((*names, "id", "Points:0", "", "a\nb")) if rng.random() < 0.2 else [*names, "z"][place]
        )
    return pa.Table.from_arrays(columns, chosen)


@cache
def _kinds_of_columns() -> list[Any]:
    import pyarrow as pa

    kinds = [
        pa.float64(),
        pa.float32(),
        pa.int8(),
        pa.uint64(),
        pa.string(),
        pa.bool_(),
        pa.list_(pa.float64()),
        pa.null(),
    ]
    kinds += [
        pa.decimal128(10, 2),
        pa.timestamp("s"),
        pa.dictionary(pa.int8(), pa.float64()),
        pa.float16(),
        pa.binary(),
    ]
    return kinds


@cache
def _column(count: int, kind: Any, with_gaps: bool) -> Any:
    import pyarrow as pa

    try:
        return pa.array([None if with_gaps and number % 3 else 1 for number in range(count)], pa.int64()).cast(kind)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return pa.nulls(count, kind)


def _parquet_bytes(table: Any, **options: Any) -> bytes:
    from pyarrow.parquet import write_table

    buffer = io.BytesIO()
    write_table(table, buffer, **options)
    return buffer.getvalue()


def _parquet_seeds() -> list[Files]:
    import pyarrow as pa

    table = _parquet_table()
    repeated = pa.table({name: np.zeros(100_000) for name in ("x1", "y1", "x2", "y2")})
    options: list[dict[str, Any]] = [{}, {"row_group_size": 7}, {"compression": "none", "use_dictionary": False}]
    options += [{"compression": "gzip", "data_page_version": "2.0"}, {"compression": "zstd"}]
    contents = [_parquet_bytes(table, **each) for each in options]
    return [{"a.parquet": content} for content in [*contents, _parquet_bytes(repeated, compression="zstd")]]


def _parquet_build(rng: random.Random) -> Files:
    table, compression = _parquet_table(rng), rng.choice(("none", "snappy", "gzip"))
    size = rng.choice((1, 7, 1000)) if len(table) < 100 else 1000
    try:
        return {"a.parquet": _parquet_bytes(table, row_group_size=size, compression=compression)}
    except Exception:  # not every type can be written
        return {"a.parquet": _parquet_bytes(_parquet_table())}


def _arrow_bytes(table: Any, feather: str = "") -> bytes:
    import pyarrow as pa
    from pyarrow import feather as feathers

    buffer = io.BytesIO()
    if feather:
        feathers.write_feather(table, buffer, compression=feather)
    else:
        with pa.ipc.new_file(buffer, table.schema) as writer:
            writer.write_table(table, max_chunksize=16)
    return buffer.getvalue()


def _arrow_seeds() -> list[Files]:
    table = _parquet_table()
    return [{"a.arrow": _arrow_bytes(table, feather)} for feather in ("", "uncompressed", "lz4", "zstd")]


def _arrow_build(rng: random.Random) -> Files:
    return {"a.arrow": _arrow_bytes(_parquet_table(rng))}


# --- COLMAP ------------------------------------------------------------------------------------


def _models(write: Callable[[Path], Path]) -> list[Files]:
    with tempfile.TemporaryDirectory() as folder:
        return [{f"m/{name}": content for name, content in _slurped(write(Path(folder) / "m")).items()}]


def _database_seeds() -> list[Files]:
    with tempfile.TemporaryDirectory() as folder:
        match_samples.fill_database(Path(folder) / "a.db")
        return [{"a.db": (Path(folder) / "a.db").read_bytes()}]


def _all_pairs(folder: Path) -> None:
    """What `nonsac verify` reads."""
    with DatabasePairs.open(folder / "a.db") as source:
        for pair in source.pairs:
            found = source.read(pair)
            assert len(found.points1) == len(found.points2) == len(found.indices)
            source.is_calibrated(pair)


def _write_geometry(folder: Path) -> None:
    nio.write_two_view_geometry(folder / "a.db", 3, "b.jpg", np.eye(4) + np.eye(4, k=3), np.array([[0, 0], [1, 1]]))


# --- manifests and journals --------------------------------------------------------------------

_CSV = b"""name,source,target,pairs,call,noise,refine,seed
one,a.ply,b.ply,,register-clouds,,,
two,,,p.csv,register-pairs,0.01,full,7
"""
_CSV_OF_POSES = b"""matches,camera1,camera2,image1,image2,samples,max-memory,rule
m.csv,"PINHOLE 640 480 500 510 320 240",,,,10,500 MB,
database.db,,,a.jpg,7,auto,,minimum_median
"""


def _manifest_csv() -> list[Files]:
    return [{"m.csv": _CSV}, {"m.csv": _CSV_OF_POSES}]


def _manifest_jsonl() -> list[Files]:
    rows: list[dict[str, Any]] = [
        {"name": "a", "call": "register-pairs", "pairs": "p.csv", "noise": 0.01, "scale": "free", "seed": 3},
        {"call": "relative-pose", "matches": "m.csv", "camera1": "500,510,320,240", "sample_size": "auto"},
        {"call": "absolute-pose", "points": "sparse/0", "image": "a.jpg", "time_limit": 2, "estimator": None},
        {"call": "register-clouds", "source": "a.ply", "target": "b.ply", "samples": 20},
    ]
    return [{"m.jsonl": "".join(json.dumps(row) + "\n" for row in rows).encode()}]


def _read_manifest(name: str) -> Read:
    def read(folder: Path) -> None:
        from nonsac.cli.manifest import Manifest

        manifest = Manifest.read(folder / name, "relative-pose")
        assert len([*manifest.jobs()]) == manifest.count, "other rows when read again"

    return read


_SETTINGS = {"manifest": "0123456789abcdef", "--call": None, "--time-limit": None, "version": "0.1.0"}
_RECORDS = (
    {"name": "1", "call": "register-pairs", "success": True, "status": "ok", "T": np.eye(4).tolist(), "error": None},
    {
        "name": "2",
        "call": "register-pairs",
        "success": False,
        "status": None,
        "T": None,
        "error": "a.csv: no such file",
    },
)


def _journal_seeds() -> list[Files]:
    from nonsac.running.journal import Journal

    with tempfile.TemporaryDirectory() as folder:
        with Journal(Path(folder) / "j.partial", _SETTINGS) as journal:
            for position, record in enumerate(_RECORDS * 2):
                journal.add(position, record)
        return [_slurped(Path(folder))]


def _read_journal(folder: Path) -> None:
    from nonsac.running.journal import Journal

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* are damaged; what is missing is done again", UserWarning)
        journal = Journal(folder / "j.partial", _SETTINGS, True, check=lambda position, record: record["success"])
    with journal:
        assert len([*journal.records()]) == journal.count, "other records than counted"


def _usage() -> tuple[type[BaseException], ...]:
    import typer

    return ValueError, typer.BadParameter


# --- all of them -------------------------------------------------------------------------------

_H5PY, _PYARROW, _LASPY = ("h5py",), ("pyarrow",), ("laspy", "lazrs")
_MATCHES = "x1 y1 | x2 y2"
_ZARR = (_source("a.zarr"), _source("a.zarr", dataset="rows"))

FORMATS: dict[str, Format] = {
    "ply-ascii": Format(_ply_ascii, [_cloud("a.ply")], TEXT),
    "ply-little": Format(lambda: _ply_binary("<"), [_cloud("a.ply")], TEXT),
    "ply-big": Format(lambda: _ply_binary(">"), [_cloud("a.ply")], TEXT),
    "pcd-ascii": Format(lambda: _pcd("ascii"), [_cloud("a.pcd")], TEXT),
    "pcd-binary": Format(lambda: _pcd("binary"), [_cloud("a.pcd")], TEXT),
    "pcd-compressed": Format(lambda: _pcd("binary_compressed"), [_cloud("a.pcd")], TEXT),
    "text-clouds": Format(_clouds_of_text, [_read_any_cloud], TEXT),
    "text-tables": Format(
        _tables_of_text,
        [_source("a.txt"), _matches(nio.read_matches, "a.txt"), _matches(nio.read_pairs, "a.txt")],
        TEXT,
    ),
    "transform": Format(_transforms, [lambda folder: nio.read_transform(folder / "a.txt")], TEXT, cost=0.5),
    "truth-json": Format(_truths, [lambda folder: nio.read_truth(folder / "a.json")], TEXT, cost=0.5),
    "camera-file": Format(_camera_files, [_read_camera_file], TEXT, cost=0.5, documented=_usage),
    "camera-line": Format(_camera_lines, [_read_camera_line], TEXT, documented=lambda: (ValueError, TypeError)),
    "npy": Format(
        _npy_seeds, [_cloud("a.npy"), _source("a.npy"), _matches(nio.read_matches, "a.npy")], TEXT, _npy_build
    ),
    "npz": Format(
        _npz_seeds,
        [_cloud("a.npz"), _source("a.npz"), _matches(nio.read_matches, "a.npz"), _matches(nio.read_points, "a.npz")],
        ARCHIVE,
        _npz_build,
        cost=3,
    ),
    "flow": Format(_flow_seeds, [_matches(nio.read_matches, "a.flo")], cost=0.5),
    "flow-png": Format(_flow_png_seeds, [_matches(nio.read_matches, "a.png")], cost=0.5, needs=("cv2",)),
    "raw": Format(_raw_seeds, [_read_raw], cost=0.5),
    "las": Format(lambda: _las("las"), [_cloud("a.las"), _source("a.las")], cost=3, needs=_LASPY),
    "laz": Format(lambda: _las("laz"), [_cloud("a.laz"), _source("a.laz")], cost=5, needs=_LASPY),
    **{
        f"hdf5-{storage}": Format(
            lambda storage=storage: _hdf5_seeds(storage), _hdf5_reads(), (), _hdf5_build, cost=6, needs=_H5PY
        )
        for storage in _STORAGE
    },
    "hloc": Format(_hloc_seeds, [_read_hloc], cost=4, needs=_H5PY),
    "zarr-2": Format(
        lambda: _zarr_seeds(2), [_source("a.zarr"), _source("a.zarr", dataset="rows")], JSON, cost=12, needs=("zarr",)
    ),
    "zarr-3": Format(
        lambda: _zarr_seeds(3), [_source("a.zarr"), _source("a.zarr", dataset="rows")], JSON, cost=12, needs=("zarr",)
    ),
    "parquet": Format(
        _parquet_seeds,
        [_source("a.parquet"), _source("a.parquet", layout=_MATCHES)],
        (),
        _parquet_build,
        cost=4,
        needs=_PYARROW,
    ),
    "arrow": Format(
        _arrow_seeds,
        [_source("a.arrow"), _matches(nio.read_matches, "a.arrow")],
        (),
        _arrow_build,
        cost=3,
        needs=_PYARROW,
    ),
    "colmap-text": Format(
        lambda: _models(match_samples.write_text_model),
        [
            _matches(nio.read_colmap_points, "m", "b.jpg"),
            lambda folder: nio.read_colmap_pose(folder / "m", 9),
            lambda folder: [read() for _, _, read in colmap_text.images_of(folder / "m" / "images.txt")],
        ],
        TEXT,
    ),
    "colmap-binary": Format(
        lambda: _models(match_samples.write_binary_model),
        [
            _matches(nio.read_colmap_points, "m", "b.jpg"),
            lambda folder: nio.read_colmap_pose(folder / "m", 9),
            lambda folder: [read() for _, _, read in colmap_binary.images_of(folder / "m" / "images.bin")],
        ],
    ),
    "colmap-database": Format(
        _database_seeds,
        [_matches(nio.read_colmap_pair, "a.db", 3, "b.jpg"), _all_pairs, _write_geometry],
        DATABASE,
        cost=3,
    ),
    "manifest-csv": Format(_manifest_csv, [_read_manifest("m.csv")], TEXT, documented=lambda: (ValueError,)),
    "manifest-jsonl": Format(_manifest_jsonl, [_read_manifest("m.jsonl")], JSON, documented=lambda: (ValueError,)),
    "bombs": Format(bombs.seeds, [_read_any], (), bombs.one, cost=200),
    "journal": Format(_journal_seeds, [_read_journal], JSON, documented=lambda: (ValueError,)),
}
