"""What the tests of the command line share: simulated matches in pixels, and the files they are kept in."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import nonsac
from match_samples import SCHEMA, parquet
from nonsac import simulate

# Noise of 0.001 in normalised coordinates is half a pixel in the first one.
FIRST = nonsac.Camera("PINHOLE", (500, 510, 495, 505), 1000, 1020)
SECOND = nonsac.Camera("PINHOLE", (600, 610, 640, 615), 1280, 1240)
BENT = nonsac.Camera("OPENCV", (500, 510, 495, 505, -0.1, 0.02, 0.002, -0.001), 1000, 1020)
IMAGES = ("db/one.jpg", "two.jpg")
NUMBERS = (9, 4)


def said(err):
    """What stderr says beside the note on compiling, which depends on the tests that ran before."""
    return [line for line in err.splitlines() if "compiling kernels" not in line]


def subprocess_nonsac(*arguments, **options):
    command = [sys.executable, "-m", "nonsac", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, **options)


def matrix(camera):
    return "\n".join(" ".join(map(str, row)) for row in camera.K)


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Matched pixels, half of them right; the answers of the library to them."""

    points1: np.ndarray
    points2: np.ndarray
    T: np.ndarray
    inliers: np.ndarray
    weights: np.ndarray

    @property
    def rows(self):
        return np.hstack([self.points1, self.points2])

    def solved(self, camera1=FIRST, camera2=SECOND, **options):
        return nonsac.relative_pose(self.points1, self.points2, camera1, camera2, **options)

    def in_single_precision(self):
        return replace(self, points1=_single(self.points1), points2=_single(self.points2))


def two_views(outliers=0.5, camera1=FIRST, camera2=SECOND, n=400):
    views = simulate.relative_pose(n, outliers, 0.001, 1)
    weights = np.where(views.inliers, 1.0, 0.25)
    return TwoViews(camera1.project(views.points1), camera2.project(views.points2), views.T, views.inliers, weights)


@dataclass(frozen=True, eq=False)
class Scene:
    """Pixels and points of the world, half of them matched rightly."""

    points2d: np.ndarray
    points3d: np.ndarray
    T: np.ndarray
    inliers: np.ndarray

    @property
    def rows(self):
        return np.hstack([self.points2d, self.points3d])

    def solved(self, camera=FIRST, **options):
        return nonsac.absolute_pose(self.points2d, self.points3d, camera, **options)


def scene(outliers=0.5, camera=FIRST, n=400):
    points = simulate.absolute_pose(n, outliers, 0.001, 1)
    return Scene(camera.project(points.points2d), points.points3d, points.T, points.inliers)


def write_table(name, rows, header):
    """Rows of numbers as the suffix says; text with all digits."""
    path = Path(name)
    if path.suffix == ".npy":
        np.save(path, rows)
    elif path.suffix == ".parquet":
        path.write_bytes(parquet(**dict(zip(header.split(), rows.T, strict=True))))
    elif path.suffix == ".csv":
        np.savetxt(path, rows, "%.17g", ",", header=header.replace(" ", ","), comments="")
    else:
        np.savetxt(path, rows, "%.17g")
    return name


def write_hloc(views):
    """`features.h5` and `matches.h5`: the keypoints of the first image are the points, those of the second reversed."""
    h5py = pytest.importorskip("h5py")
    n = len(views.points1)
    with h5py.File("features.h5", "w") as file:
        file[f"{IMAGES[0]}/keypoints"] = views.points1
        file[f"{IMAGES[1]}/keypoints"] = views.points2[::-1]
    with h5py.File("matches.h5", "w") as file:
        group = file.create_group("/".join(name.replace("/", "-") for name in IMAGES))
        group["matches0"] = np.arange(n)[::-1]
        group["matching_scores0"] = views.weights
    return "features.h5", "matches.h5"


def write_database(views, cameras=(FIRST, SECOND)):
    """`database.db`; the first image has the larger number. A third image, 5, has no matches with the first one."""
    pair_id = min(NUMBERS) * 2147483647 + max(NUMBERS)
    matches = np.column_stack([np.arange(len(views.points1))] * 2).astype("<u4")
    with closing(sqlite3.connect("database.db")) as database, database:
        database.executescript(SCHEMA)
        for number, camera in enumerate(cameras, start=1):
            params = np.array(camera.params, "<f8").tobytes()
            model = {"PINHOLE": 1, "OPENCV": 4}[camera.model]
            row = (number, model, camera.width, camera.height, params, 1)
            database.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)", row)
        images = zip((*NUMBERS, 5), (*IMAGES, "three.jpg"), (1, 2, 2), strict=True)
        database.executemany("INSERT INTO images VALUES (?, ?, ?)", images)
        for number, points in zip((*NUMBERS, 5), (views.points1, views.points2, views.points2), strict=True):
            row = (number, len(points), 2, points.astype("<f4").tobytes())
            database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", row)
        database.execute("INSERT INTO matches VALUES (?, ?, 2, ?)", (pair_id, len(matches), matches.tobytes()))
        database.execute("INSERT INTO matches VALUES (?, 0, 2, NULL)", (5 * 2147483647 + NUMBERS[0],))
    return "database.db"


def read_geometry():
    """The two-view geometry that the database holds, by column; None if there is none."""
    with closing(sqlite3.connect("database.db")) as database:
        database.row_factory = sqlite3.Row
        row = database.execute("SELECT * FROM two_view_geometries").fetchone()
    return None if row is None else dict(row)


def write_model(points, camera=FIRST):
    """The folder `sparse` of a COLMAP model in text; its only image is `one.jpg`, number 3."""
    folder = Path("sparse")
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"1 {camera}\n")
    keypoints = " ".join(f"{x!r} {y!r} {k}" for k, (x, y) in enumerate(points.points2d.tolist()))
    (folder / "images.txt").write_text(f"3 1 0 0 0 0 0 0 1 one.jpg\n{keypoints}\n")
    lines = [f"{k} {x!r} {y!r} {z!r} 0 0 0 0\n" for k, (x, y, z) in enumerate(points.points3d.tolist())]
    (folder / "points3D.txt").write_text("".join(lines))
    return "sparse"


def write_photo(name, width, height):
    from matplotlib.image import imsave

    imsave(name, np.linspace(0, 1, width * height).reshape(height, width), cmap="gray")
    return name


def _single(points):
    return points.astype(np.float32).astype(np.float64)
