"""Odd arguments for every public call."""

from __future__ import annotations

import datetime
import decimal
import fractions
import json
import math
import os
import random
import sqlite3
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import nonsac
from fuzz import judge
from fuzz.folders import remove_files
from nonsac import evaluation, plot, scoring, simulate
from nonsac import io as nio
from nonsac.values.numeric import printable

Arguments = dict[str, Any]


class Planted(Exception):
    """What an odd object raises: it is its owner's business, and may pass."""


class Raising:
    """An object of which one method raises, and the others are missing."""

    def __init__(self, method: str) -> None:
        self.method = method

    def __getattribute__(self, name: str) -> Any:
        if name == object.__getattribute__(self, "method"):
            raise Planted(name)
        return object.__getattribute__(self, name)


def _raising(method: str) -> Any:
    """An object with a special method that raises."""

    def refuse(self: Any, *_: Any, **__: Any) -> Any:
        raise Planted(method)

    return type("Odd", (), {method: refuse})()


_ROWS_READ = 10**6


class OddSource(nonsac.Source):
    """A source that breaks its contract in one way."""

    def __init__(self, flaw: str) -> None:
        self.flaw = flaw

    def __len__(self) -> int:
        if self.flaw == "len raises":
            raise Planted("len")
        return 2**62 if self.flaw == "long" else 0 if self.flaw == "empty" else 60

    def take(self, indices: Any) -> Any:
        if self.flaw == "take raises" and len(indices):
            raise Planted("take")
        rows = np.random.default_rng(0).normal(size=(len(indices), 6))
        rows = {"short": rows[:-1], "flat": rows.ravel(), "list": rows.tolist(), "nan": rows * np.nan}.get(
            self.flaw, rows
        )
        return rows


# --- odd values --------------------------------------------------------------------------------

_NUMBERS: list[Any] = [-1, 0, 1, 2, 3, 7, 2**31, 2**63, -(2**63), 10**30, -0.0, 0.5, 1.0, 1e300, -1e300, 1e-300, 5e-324]
_NUMBERS += [math.nan, math.inf, -math.inf, True, False, np.int8(7), np.int8(-1), np.uint8(200), np.uint64(2**64 - 1)]
_NUMBERS += [np.int64(3), np.float16(1), np.float32("nan"), np.float64(0.5), np.bool_(True), 1j, np.complex128(1)]
_NUMBERS += [
    fractions.Fraction(1, 2),
    decimal.Decimal("0.5"),
    decimal.Decimal("sNaN"),
    np.array(5),
    np.array([5]),
    10**400,
]
_TEXTS: list[Any] = [
    "",
    "x",
    "auto",
    "nan",
    "1",
    "none",
    "full",
    "minimum_median",
    "ransac",
    "a\0b",
    "é" * 300,
    "x" * 5000,
    "\x1b[2J",
]
_TEXTS += [
    "a\nb",
    b"x",
    bytearray(b"x"),
    np.str_("x"),
    Path("x"),
    Path(""),
    Path("/dev/null"),
    "/nowhere/x.npy",
    "x.npy",
    ".",
]
_OTHERS: list[Any] = [
    None,
    [],
    (),
    {},
    set(),
    [1],
    ["x"],
    [None],
    [[1, 2], [3]],
    {"x": 1},
    {1: 2},
    object(),
    int,
    range(3),
]
_OTHERS += [
    nonsac.Registration,
    nonsac.Ransac,
    Ellipsis,
    NotImplemented,
    slice(3),
    lambda *_, **__: None,
    len,
    (x for x in ()),
]
_OTHERS += [datetime.datetime(2020, 1, 1), np.datetime64("NaT"), np.ma.masked, np.array([]), np.array([], dtype=object)]
_OTHERS += [np.array(["a"]), np.zeros((0, 3)), np.zeros((3, 0)), np.zeros((2, 2, 2)), memoryview(b"abc"), np.random]
_OTHERS += [np.random.default_rng(0), np.random.RandomState(0), float, "", math]
_METHODS = (
    "__array__ __len__ __iter__ __float__ __index__ __getitem__ __eq__ __repr__ __str__ __bool__ __fspath__ __call__"
)
_METHODS += " __lt__ __hash__ detach params model shape dtype"
_FLAWS = ("none", "len raises", "long", "empty", "take raises", "short", "flat", "list", "nan")


def odd_value(rng: random.Random) -> Any:
    what = rng.randrange(12)
    if what < 5:
        return rng.choice(_NUMBERS)
    if what < 7:
        return rng.choice(_TEXTS)
    if what < 10:
        return rng.choice(_OTHERS)
    if what == 10:
        method = rng.choice(_METHODS.split())
        return _raising(method) if method.startswith("__") else Raising(method)
    return OddSource(rng.choice(_FLAWS))


def odd_array(rng: random.Random, array: Any) -> Any:
    """An array that differs a little, or much, from a good one."""
    array = np.array(array)
    what = rng.randrange(16)
    if what < 5 and array.size and array.dtype.kind == "f":
        count = rng.choice((1, 1, 3, array.size // 2 + 1, array.size))
        flat = array.reshape(-1)
        odd = rng.choice((np.nan, np.inf, -np.inf, 1e300, -1e300, 1e154, 1e-300, 5e-324, 0.0, -0.0, 1.0, 1e16))
        flat[np.random.default_rng(rng.randrange(2**32)).choice(array.size, min(count, array.size), replace=False)] = (
            odd
        )
        return array
    if what == 5:
        with np.errstate(all="ignore"):
            return array * rng.choice((0, 1e300, 1e-300, 1e-160, 1e150, 1e12, -1, np.nan)) + rng.choice(
                (0, 0, 1e9, 1e300)
            )
    if what == 6:
        kinds = [
            "f2",
            "f4",
            ">f8",
            "f16",
            "i1",
            "i2",
            ">i4",
            "i8",
            "u1",
            "u8",
            "?",
            "c16",
            "U8",
            "S8",
            "O",
            "M8[s]",
            "m8[s]",
        ]
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return array.astype(rng.choice(kinds))
            except (ValueError, TypeError):
                return array.astype(object)
    if what == 7:
        return rng.choice(
            (array.T, array[None], array[..., None], array.ravel(), array[:0], array[:1], array[:2], array[:4])
        )
    if what == 8:
        return np.repeat(array, rng.choice((1, 2, 5)), axis=rng.randrange(max(array.ndim, 1))) if array.ndim else array
    if what == 9:
        return rng.choice((array.tolist(), tuple(array.tolist()), np.asfortranarray(array), array[::-1], array[::2]))
    if what == 10:
        return np.ma.masked_array(
            array, mask=np.random.default_rng(rng.randrange(2**32)).random(array.shape) < rng.random()
        )
    if what == 11:
        return np.broadcast_to(array[:1], array.shape) if array.ndim else array
    if what == 12:
        return np.zeros(
            rng.choice(((0,), (0, 2), (0, 3), (60,), (60, 1), (60, 2), (60, 3), (60, 4), (60, 7), (2, 60), (1, 3, 3)))
        )
    if what == 13:
        return array.astype(object) if rng.random() < 0.5 else [*map(list, np.atleast_2d(array)[:-1]), None]
    if what == 14:
        fields = np.zeros(len(array) if array.ndim else 1, [("x", "f8"), ("y", "f4"), ("z", "i2")])
        return rng.choice((fields, fields.view(np.recarray), memoryview(np.ascontiguousarray(array))))
    return odd_value(rng)


# --- calls -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Call:
    """A public call.

    Attributes
    ----------
    function
        Takes all by keyword.
    valid
        Good arguments, which have to be accepted.
    cost
        Milliseconds, about.
    sizes
        Arguments that ask for so much memory or work, which is then taken: they get no huge numbers.
    foreign
        Arguments that may be functions of the user, which may raise anything.
    names
        Words that may name what is at fault, besides the arguments.
    check
        Of the answer.
    """

    function: Callable[..., Any]
    valid: Callable[[], Arguments]
    cost: float = 1.0
    sizes: Sequence[str] = ()
    foreign: Sequence[str] = ()
    names: Sequence[str] = ()
    check: Callable[[Any], object] = lambda answer: repr(answer)


class CallCase:
    def __init__(self, call: Call, arguments: Arguments, changed: Sequence[str]) -> None:
        self.call, self.arguments, self.changed = call, arguments, changed

    def run(self) -> judge.Failure | None:
        try:
            self.call.check(self.call.function(**self.arguments))
        except Planted:
            return None
        except BaseException as error:
            if isinstance(error, FileNotFoundError) and error.filename:
                return None
            if _is_planted(error) or any(callable(self.arguments[name]) for name in self.call.foreign):
                return None
            paths = (os.fspath(value) for value in self.arguments.values() if isinstance(value, (str, Path)))
            words = (printable(path) or "is a folder" for path in paths)
            names = (*self.call.valid(), *self.call.names, *words)
            return judge.judged(error, (ValueError, TypeError, FileNotFoundError), names, hostile=False)
        return None

    def __str__(self) -> str:
        return "\n".join(f"{name} = {_described(self.arguments[name])}" for name in self.changed)


def _is_planted(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, Planted):
            return True
        error = error.__cause__ or error.__context__
    return False


def _described(value: Any) -> str:
    try:
        return f"{type(value).__name__} {value!r}"[:2000]
    except BaseException:
        return f"an object of type {type(value)} with {[name for name in vars(type(value)) if name.startswith('__')]}"


class CallKind:
    def __init__(self, call: Call) -> None:
        self.call, self.cost, self.missing = call, call.cost, ()
        self.folder: Path | None = None

    def warm_up(self) -> None:
        """Call it with good arguments, which must be accepted."""
        with self._here():
            self.call.check(self.call.function(**self.call.valid()))

    @contextmanager
    def case(self, name: str, seed: int, number: int) -> Iterator[CallCase]:
        with self._here():
            yield self._made(name, seed, number)

    def _made(self, name: str, seed: int, number: int) -> CallCase:
        rng = random.Random(f"{name}/{seed}/{number}")
        arguments = dict(self.call.valid())
        changed = rng.sample(sorted(arguments), min(rng.choice((1, 1, 1, 2, 3)), len(arguments)))
        for name in changed:
            value = arguments[name]
            new = odd_array(rng, value) if isinstance(value, np.ndarray) and rng.random() < 0.75 else odd_value(rng)
            while name in self.call.sizes and _is_huge(new):
                new = odd_value(rng)
            arguments[name] = new
        return CallCase(self.call, arguments, changed)

    @contextmanager
    def _here(self) -> Iterator[None]:
        """In an empty folder, as some calls write files."""
        before = os.getcwd()
        self.folder = self.folder or Path(tempfile.mkdtemp())
        os.chdir(self.folder)
        try:
            yield
        finally:
            os.chdir(before)
            remove_files(self.folder)

    def may_warn(self, warning: warnings.WarningMessage) -> bool:
        """Whether the docstrings promise this warning."""
        message = str(warning.message)
        known = message.startswith(("dropped", "Glyph ")) or " look like " in message  # fonts lack letters
        return warning.category is UserWarning and known

    def save(self, name: str, seed: int, number: int, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "arguments.txt").write_text(str(self._made(name, seed, number)) + "\n")

    def replayed(self, name: str, seed: int, number: int, folder: Path) -> CallCase:
        return self._made(name, seed, number)


def _is_huge(value: Any) -> bool:
    try:
        return abs(float(value)) > 500
    except BaseException:
        return False


# --- answers -----------------------------------------------------------------------------------


def _check_result(result: Any) -> None:
    """Whatever the answer, it says so, and as JSON."""
    assert isinstance(result, nonsac.Result), f"a {type(result).__name__}"
    assert isinstance(result.status, nonsac.Status), f"status {result.status!r}"
    assert 0.0 <= result.confidence <= 1.0, f"confidence {result.confidence!r}"
    if result.success:
        assert np.isfinite(result.model).all(), f"trusted, but {result.model}"
    repr(result), str(result)
    json.loads(result.to_json(), parse_constant=_not_json)


def _check_matched(result: Any) -> None:
    _check_result(result)
    if result.evidence.source is not None and len(result.evidence.source) > _ROWS_READ:
        return  # all of its rows are asked for one after the other
    inliers = result.inliers
    assert inliers.dtype == bool, f"inliers of type {inliers.dtype}"
    assert inliers.ndim == 1, f"inliers of shape {inliers.shape}"


def _not_json(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


def _check_points(points: Any) -> None:
    assert isinstance(points, np.ndarray), f"a {type(points).__name__}"
    assert points.dtype == np.float64, f"points of type {points.dtype}"


def _exhaust(source: Any) -> None:
    from fuzz.formats import exhaust

    if source.width:
        exhaust(source)


# --- good arguments ----------------------------------------------------------------------------


@cache
def _views() -> Any:
    return simulate.relative_pose(60, 0.3, 0.001, 0)


@cache
def _scene() -> Any:
    return simulate.absolute_pose(60, 0.3, 0.001, 0)


@cache
def _pairs() -> Any:
    return simulate.registration(60, 0.3, 0.01, 0)


@cache
def _clouds() -> Any:
    return simulate.demo_scans(rng=0, points=400)


def _settings(**others: Any) -> Arguments:
    settings = {"noise": 0.01, "samples": "auto", "sample_size": "auto", "max_samples": 20, "time_limit": 1.0}
    settings |= {
        "draw": "blocks",
        "max_memory": "100 MB",
        "rule": "minimum_median",
        "refine": "union",
        "workers": 1,
        "rng": 0,
        "progress": None,
    }
    return settings | {"estimator": "ransac"} | others


def _poses() -> Arguments:
    views = _views()
    given = {"points1": views.points1, "points2": views.points2, "camera1": None, "camera2": None, "weights": None}
    return given | _settings()


def _poses_of_pixels() -> Arguments:
    camera = nonsac.Camera("PINHOLE", (500, 510, 495, 505), 1000, 1020)
    views = _views()
    given = {"points1": camera.project(views.points1), "points2": camera.project(views.points2)}
    cameras = {"camera1": camera.K, "camera2": "PINHOLE 1000 1020 500 510 495 505"}
    return given | cameras | {"weights": np.linspace(0.1, 1, 60)} | _settings(noise=None)


def _absolute() -> Arguments:
    scene = _scene()
    given = {"points2d": scene.points2d, "points3d": scene.points3d, "camera": None, "weights": None}
    return given | _settings()


def _registration() -> Arguments:
    pairs = _pairs()
    return {"source": pairs.source, "target": pairs.target, "scale": 1.0, "weights": None} | _settings()


def _raw_clouds() -> Arguments:
    clouds = _clouds()
    settings = {"samples": 4, "sample_size": 300, "workers": 1, "rng": 0, "progress": None}
    return {"source": clouds.source, "target": clouds.target} | settings


def _rows() -> Any:
    pairs = _pairs()
    return np.hstack([pairs.source, pairs.target])


def _estimate() -> Arguments:
    return {"source": nonsac.ArraySource(_rows()), "problem": nonsac.Registration(), "stop": None} | _settings()


def _job(**given: Any) -> Any:
    return [
        *nonsac.estimate_many(
            [nonsac.Job(given.pop("call"), given.pop("source"), given.pop("target"), **given)], workers=1
        )
    ]


def _job_arguments() -> Arguments:
    pairs = _pairs()
    return {
        "call": "register_pairs",
        "source": pairs.source,
        "target": pairs.target,
        "name": "a",
        "noise": 0.01,
        "rng": 0,
    }


def _many(jobs: Any, workers: Any, time_limit: Any, progress: Any) -> Any:
    return [*nonsac.estimate_many(jobs, workers=workers, time_limit=time_limit, progress=progress)]


def _many_arguments() -> Arguments:
    pairs = _pairs()
    jobs = [nonsac.Job("register_pairs", pairs.source, pairs.target)]
    return {"jobs": jobs, "workers": 1, "time_limit": None, "progress": None}


def _opened(layout: Any, columns: Any, dataset: Any) -> Any:
    np.savez("a.npz", rows=_rows())
    return nonsac.open_source("a.npz", layout=layout, columns=columns, dataset=dataset)


def _npy(columns: Any) -> Any:
    np.save("a.npy", _rows())
    return nonsac.NpySource("a.npy", columns)


def _raw(dtype: Any, width: Any, offset: Any, rows: Any) -> Any:
    _rows().tofile("a.raw")
    return nonsac.RawSource("a.raw", dtype, width, offset=offset, rows=rows)


def _example(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def call(path: Any) -> Any:
        np.save("a.npy", _pairs().source)
        return read(path)

    return call


def _open_matches(files: Any, images: Any, columns: Any, dataset: Any) -> Any:
    np.savetxt("a.txt", _rows())
    from nonsac.layouts import PAIRS

    return nio.open_matches(PAIRS, files, images, columns, dataset)


def _write_cloud(path: Any, points: Any) -> None:
    nio.write_cloud(path, points)


def _geometry(**given: Any) -> None:
    import match_samples

    if not os.path.exists("a.db"):
        match_samples.fill_database("a.db")
    nio.write_two_view_geometry("a.db", **given)


def _verified(**given: Any) -> Any:
    """Of a database of one pair that has no matches, so that nothing is estimated."""
    import match_samples

    if not os.path.exists("a.db"):
        match_samples.fill_database("a.db")
        Path("pairs.txt").write_text("fish.jpg sub/a_b.jpg\n")
        with closing(sqlite3.connect("a.db")) as database, database:
            database.execute("UPDATE images SET name = 'sub/a_b.jpg' WHERE image_id = 3")
    return nonsac.verify("a.db", **given)


def _verified_arguments() -> Arguments:
    given = {"output": "out.db", "pairs": "pairs.txt", "cameras": None, "trust_focal_lengths": False}
    return given | {"fallback": "skip", "overwrite": True, "resume": False} | _settings()


def _localized(**given: Any) -> Any:
    """Of a folder of one table that holds one row."""
    os.makedirs("tables", exist_ok=True)
    Path("tables/a.csv").write_text("u,v,X,Y,Z\n1,2,3,4,5\n")
    return nonsac.localize("tables", **given)


def _localized_arguments() -> Arguments:
    given = {"output": "out.txt", "cameras": "PINHOLE 9 9 5 5 4 4", "overwrite": True, "resume": False}
    return given | {"pairs": None} | _settings()


def _moved(**given: Any) -> Any:
    result = _answer()
    return result.apply(**given)


@cache
def _answer() -> Any:
    return nonsac.register_pairs(_pairs().source, _pairs().target, noise=0.01, workers=1)


def _picture(function: Callable[..., Any], suffix: str = ".png") -> Callable[..., Any]:
    return lambda **given: function(f"a{suffix}", **given)


def _matched_pixels() -> Arguments:
    views = _views()
    given = {"points1": views.points1 * 100 + 200, "points2": views.points2 * 100 + 200, "inliers": views.inliers}
    return given | {"size1": (400, 400), "size2": (400, 400), "image1": None, "image2": None, "title": "a title"}


@cache
def _drawn_result() -> nonsac.Result:
    return nonsac.register_pairs(_pairs().source, _pairs().target, noise=0.01)


def _warp() -> Arguments:
    warp = np.random.default_rng(0).uniform(-1, 1, (6, 8, 4))
    return {
        "warp": warp,
        "certainty": np.full((6, 8), 0.5),
        "size1": (80, 60),
        "size2": (80, 60),
        "count": 10,
        "rng": 0,
    }


_PCR = {"compare": "distance", "tolerance": 0.4, "enough_inliers": None, "max_valid": 100, "max_drawn": 1000}

CALLS: dict[str, Call] = {
    "relative_pose": Call(
        nonsac.relative_pose, _poses, 25, ("max_samples",), ("progress", "estimator"), check=_check_matched
    ),
    "relative_pose-pixels": Call(
        nonsac.relative_pose, _poses_of_pixels, 25, ("max_samples",), ("progress", "estimator"), check=_check_matched
    ),
    "absolute_pose": Call(
        nonsac.absolute_pose, _absolute, 20, ("max_samples",), ("progress", "estimator"), check=_check_matched
    ),
    "register_pairs": Call(
        nonsac.register_pairs, _registration, 15, ("max_samples",), ("progress", "estimator"), check=_check_matched
    ),
    "register_clouds": Call(nonsac.register_clouds, _raw_clouds, 20, ("samples",), ("progress",), check=_check_result),
    "estimate": Call(
        nonsac.estimate, _estimate, 15, ("max_samples",), ("progress", "estimator", "stop"), check=_check_matched
    ),
    "Job": Call(_job, _job_arguments, 15, names=("data",)),
    "estimate_many": Call(_many, _many_arguments, 15, ("workers",), ("progress",)),
    "verify": Call(
        _verified,
        _verified_arguments,
        20,
        ("workers", "max_samples"),
        ("progress", "estimator"),
        names=("out.db", "a.db", "pairs.txt", "partial", "folder"),
    ),
    "localize": Call(
        _localized,
        _localized_arguments,
        20,
        ("workers", "max_samples"),
        ("progress", "estimator"),
        names=("out.txt", "tables", "partial", "folder"),
    ),
    "plan": Call(
        nonsac.plan,
        lambda: {"source": nonsac.ArraySource(_rows()), "samples": 10, "sample_size": 20, "draw": "rows"},
        check=str,
    ),
    "Camera": Call(
        lambda **given: nonsac.Camera(**given).normalise([[1.0, 2]]),
        lambda: {
            "model": "OPENCV",
            "params": np.array([500, 510, 320, 240, 0.1, 0.01, 0, 0]),
            "width": 640,
            "height": 480,
        },
        names=("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    ),
    "Camera.parse": Call(
        lambda value: nonsac.Camera.parse(value, "value").normalise(np.zeros((2, 2))),
        lambda: {"value": np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])},
    ),
    "Camera.parse-dict": Call(
        lambda **fields: nonsac.Camera.parse(fields, "value"),
        lambda: {"model": "PINHOLE", "params": np.array([500.0, 500, 320, 240]), "width": 640, "height": 480},
        names=("value",),
    ),
    "Camera.normalise": Call(
        lambda pixels: nonsac.Camera("OPENCV", (500, 510, 320, 240, -0.3, 0.1, 0.01, 0.01)).normalise(pixels),
        lambda: {"pixels": np.random.default_rng(0).normal(size=(9, 2)) * 400},
        check=_check_points,
    ),
    "Camera.project": Call(
        lambda normalised: nonsac.Camera("OPENCV_FISHEYE", (500, 510, 320, 240, 0.1, 0, 0, 0)).project(normalised),
        lambda: {"normalised": np.random.default_rng(0).normal(size=(9, 2))},
        check=_check_points,
    ),
    "Result.apply": Call(_moved, lambda: {"points": _pairs().source}, check=_check_points),
    "ArraySource": Call(
        nonsac.ArraySource, lambda: {"rows": _rows(), "names": ["a", "b", "c", "d", "e", "f"]}, check=_exhaust
    ),
    "JoinedSource": Call(
        nonsac.JoinedSource,
        lambda: {"arrays": [_pairs().source, _pairs().target], "maps": [None, None]},
        foreign=("maps",),
        names=("rows",),
        check=_exhaust,
    ),
    "StreamSource": Call(
        lambda chunks, rows, rng: nonsac.StreamSource(chunks, rows, rng),
        lambda: {"chunks": [_rows(), _rows()], "rows": 50, "rng": 0},
        sizes=("rows",),
        check=_exhaust,
    ),
    "AllPairsSource": Call(nonsac.AllPairsSource, lambda: {"a": _pairs().source, "b": _pairs().target}, check=repr),
    "MappedSource": Call(
        nonsac.MappedSource,
        lambda: {"source": nonsac.ArraySource(_rows()), "map": abs},
        foreign=("map",),
        check=_exhaust,
    ),
    "NpySource": Call(_npy, lambda: {"columns": [0, 1, 2]}, names=("a.npy",), check=_exhaust),
    "RawSource": Call(
        _raw, lambda: {"dtype": "<f8", "width": 6, "offset": 0, "rows": None}, check=_exhaust, names=("a.raw",)
    ),
    "open_source": Call(
        _opened,
        lambda: {"layout": "x1 y1 z1 | x2 y2 z2", "columns": None, "dataset": None},
        names=("a.npz",),
        check=_exhaust,
    ),
    "open_source-path": Call(_example(nonsac.open_source), lambda: {"path": "a.npy"}, check=_exhaust),
    "open_matches": Call(
        _open_matches,
        lambda: {"files": ["a.txt"], "images": (), "columns": None, "dataset": None},
        names=("a.txt", "no such file", "is a folder"),
    ),
    "read_cloud": Call(_example(nio.read_cloud), lambda: {"path": "a.npy"}, names=("the file name",)),
    "write_cloud": Call(
        _write_cloud, lambda: {"path": "a.ply", "points": _pairs().source}, names=("suffix", "a.ply", "folder")
    ),
    "write_transform": Call(
        nio.write_transform, lambda: {"path": "T.txt", "transform": np.eye(4)}, names=("T.txt", "folder")
    ),
    "write_two_view_geometry": Call(
        _geometry,
        lambda: {
            "image1": 3,
            "image2": "b.jpg",
            "transform": np.eye(4) + np.eye(4, k=3),
            "matches": np.array([[0, 0], [1, 1]]),
        },
        names=("a.db",),
    ),
    "from_flow": Call(
        nio.from_flow,
        lambda: {"flow": _warp()["warp"][:, :, :2], "certainty": np.full((6, 8), 0.5), "count": 10, "rng": 0},
    ),
    "from_warp": Call(nio.from_warp, _warp, sizes=("size1", "size2")),
    "Layout": Call(nonsac.Layout, lambda: {"columns": "x1 y1 | x2 y2"}),
    "Ransac": Call(
        nonsac.Ransac, lambda: {"iterations": 10, "confidence": 0.9, "local_optimisation": True, "least_iterations": 1}
    ),
    "Pcr99": Call(nonsac.Pcr99, lambda: dict(_PCR)),
    "External": Call(nonsac.External, lambda: {"call": len, "needs": None}),
    "Registration": Call(nonsac.Registration, lambda: {"scale": 1.0}),
    "RelativePose": Call(nonsac.RelativePose, lambda: {"focal1": 1.0, "focal2": 1.0}),
    "AbsolutePose": Call(nonsac.AbsolutePose, lambda: {"focal": 1.0}),
    "scoring.by_name": Call(lambda rule: scoring.by_name(rule), lambda: {"rule": "minimum_median"}),
    "simulate.registration": Call(
        simulate.registration,
        lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0, "scale": 1.0},
        sizes=("n",),
    ),
    "simulate.relative_pose": Call(
        simulate.relative_pose, lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0}, sizes=("n",)
    ),
    "simulate.absolute_pose": Call(
        simulate.absolute_pose, lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0}, sizes=("n",)
    ),
    "simulate.blobs_in_images": Call(
        simulate.blobs_in_images, lambda: {"n": 60, "blobs": 5, "spread": 0.01, "rng": 0}, sizes=("n", "blobs")
    ),
    "simulate.blobs_in_space": Call(
        simulate.blobs_in_space, lambda: {"n": 60, "blobs": 5, "spread": 0.01, "rng": 0}, sizes=("n", "blobs")
    ),
    "simulate.statue": Call(
        simulate.statue,
        lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0, "base": 0.5},
        sizes=("n",),
    ),
    "simulate.periodic_texture": Call(
        simulate.periodic_texture,
        lambda: {"n": 60, "slipped": 0.3, "noise": 0.01, "rng": 0, "scattered": True},
        sizes=("n",),
    ),
    "simulate.narrow_view": Call(
        simulate.narrow_view,
        lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0, "degrees": 11.0},
        sizes=("n",),
    ),
    "simulate.local_displacements": Call(
        simulate.local_displacements,
        lambda: {"n": 60, "displaced": 0.3, "reach": 0.02, "noise": 0.01, "rng": 0},
        sizes=("n",),
    ),
    "simulate.moving_object": Call(
        simulate.moving_object,
        lambda: {"n": 60, "moving": 0.3, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0},
        sizes=("n",),
    ),
    "simulate.two_planes": Call(
        simulate.two_planes, lambda: {"n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0}, sizes=("n",)
    ),
    "simulate.cloud_pair": Call(
        simulate.cloud_pair,
        lambda: {"cloud": _clouds().source, "rng": 0, "points": 50, "overlap": 0.5, "noise": 0.01},
        sizes=("points",),
    ),
    "simulate.demo_scans": Call(
        simulate.demo_scans, lambda: {"rng": 0, "points": 50, "noise": 0.002}, 10, sizes=("points",)
    ),
    "simulate.random_rotation": Call(simulate.random_rotation, lambda: {"rng": 0}),
    "simulate.to_file": Call(
        simulate.to_file,
        lambda: (
            {"path": "a.npy", "problem": "registration", "n": 60, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0}
            | {"dtype": "float64", "row_group": 1000}
        ),
        sizes=("n",),
        names=("a.npy", "suffix", "folder"),
        cost=3,
    ),
    "evaluation.rotation_error": Call(evaluation.rotation_error, lambda: {"A": np.eye(3), "B": np.eye(3)}),
    "evaluation.translation_error": Call(evaluation.translation_error, lambda: {"A": np.ones(3), "B": np.ones(3)}),
    "evaluation.mean_average_accuracy": Call(
        evaluation.mean_average_accuracy, lambda: {"errors": np.arange(9.0), "maximum": 10}, sizes=("maximum",)
    ),
    "plot.matches": Call(_picture(plot.matches), _matched_pixels, 200),
    "plot.clouds": Call(
        _picture(plot.clouds),
        lambda: {"source": _pairs().source, "target": _pairs().target, "T": np.eye(4), "title": None},
        250,
    ),
    "plot.epipolar_lines": Call(_picture(plot.epipolar_lines), lambda: _matched_pixels() | {"F": np.eye(3)}, 200),
    "plot.two_views": Call(_picture(plot.two_views), lambda: _matched_pixels() | {"F": np.eye(3)}, 250),
    "plot.reprojections": Call(
        _picture(plot.reprojections),
        lambda: (
            {"points2d": _views().points1 * 100, "projected": _views().points2 * 100, "inliers": _views().inliers}
            | {"size": (400, 400), "image": None, "title": None}
        ),
        150,
    ),
    "plot.match_graph": Call(
        _picture(plot.match_graph),
        lambda: {"images1": ["a", "b"], "images2": ["b", "c"], "inliers": np.array([3, 0])},
        150,
    ),
    "plot.hypotheses": Call(_picture(plot.hypotheses), lambda: {"result": _drawn_result(), "title": "a title"}, 250),
    "plot.comparison": Call(
        _picture(plot.comparison),
        lambda: {
            "names": ["a", "b"],
            "kinds": ["alone", "core"],
            "seconds": np.array([0.1, 2.0]),
            "values": np.array([0.5, 0.9]),
            "best": 1,
            "label": "mAA",
            "title": "data",
        },
        150,
    ),
    "plot.boxplot": Call(
        _picture(plot.boxplot),
        lambda: {"errors": {"median": np.ones(5)}, "times": {"median": np.ones(5)}, "paper": None, "label": "paper"},
        200,
    ),
}
