"""Databases of COLMAP with many pairs, from simulated photos."""

import sqlite3
from contextlib import closing
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from match_samples import SCHEMA
from nonsac.simulate.photos import Photos

MAX_IMAGES = 2147483647
PINHOLE = 1


def name_of(number):
    return f"{number:02}.jpg"


def pair_id(first, second):
    """Of two photos, which are numbered from 0; images are from 1."""
    return (first + 1) * MAX_IMAGES + second + 1


def write_photos(path, photos, matches, prior=1):
    """A database of photos, and of matches by the numbers of two of them."""
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript(SCHEMA)
        params = np.array(photos.camera.params, "<f8").tobytes()
        row = (1, PINHOLE, photos.camera.width, photos.camera.height, params, prior)
        database.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)", row)
        for number, points in enumerate(photos.keypoints):
            database.execute("INSERT INTO images VALUES (?, ?, 1)", (number + 1, name_of(number)))
            row = (number + 1, len(points), 2, points.astype("<f4").tobytes())
            database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", row)
        for (first, second), indices in matches.items():
            row = (pair_id(first, second), len(indices), 2, indices.astype("<u4").tobytes())
            database.execute("INSERT INTO matches VALUES (?, ?, ?, ?)", row)
    return path


def many_pairs(path, count=9, points=600, noise=0.7, seed=0):
    """All pairs of some photos: a third of them with 80 % wrong matches, every tenth with wrong ones only."""
    photos, rng = Photos.taken(count, points, noise, seed), np.random.default_rng(seed)
    pairs = list(combinations(range(count), 2))
    wrong = {pair: 1.0 if k % 10 == 9 else 0.8 if k % 3 == 2 else 0.3 for k, pair in enumerate(pairs)}
    matches = {pair: photos.matches(*pair, wrong[pair], rng) for pair in pairs}
    write_photos(path, photos, matches)
    return photos, wrong


def rows_of(path):
    """The geometries of two views, by the numbers of two photos."""
    with closing(sqlite3.connect(path)) as database:
        database.row_factory = sqlite3.Row
        rows = list(map(dict, database.execute("SELECT * FROM two_view_geometries")))
    return {tuple(number - 1 for number in divmod(row.pop("pair_id"), MAX_IMAGES)): row for row in rows}


def hloc_files(folder, photos, wrong, seed=0):
    """The same photos as files of hloc, whose list has the images of a pair in reverse; and the matches."""
    import h5py

    rng = np.random.default_rng(seed)
    matches = {pair: photos.matches(*pair, share, rng) for pair, share in wrong.items()}
    with h5py.File(folder / "features.h5", "w") as file:
        for number, points in enumerate(photos.keypoints):
            file[f"{name_of(number)}/keypoints"] = points - 0.5
    with h5py.File(folder / "matches.h5", "w") as file:
        for (first, second), indices in matches.items():
            partners = np.full(len(photos.keypoints[first]), -1)
            partners[indices[:, 0]] = indices[:, 1]
            file[f"{name_of(first)}/{name_of(second)}/matches0"] = partners
    listed = folder / "pairs.txt"
    listed.write_text("".join(f"{name_of(second)} {name_of(first)}\n" for first, second in matches))
    return photos, matches, folder / "features.h5", folder / "matches.h5", listed


def write_model(folder, photos, count):
    """A COLMAP model in text of the first photos, whose points are numbered from 1."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"1 {photos.camera}\n")
    images = ""
    for number in range(count):
        quaternion = np.roll(Rotation.from_matrix(photos.poses[number][:, :3]).as_quat(), 1)
        pose = " ".join(map(str, (*quaternion, *photos.poses[number][:, 3])))
        rows = zip(photos.keypoints[number], photos.shown[number], strict=False)
        observations = " ".join(f"{x} {y} {point + 1}" for (x, y), point in rows)
        images += f"{number + 1} {pose} 1 {name_of(number)}\n{observations}\n"
    (folder / "images.txt").write_text(images)
    points = "".join(f"{k} {x} {y} {z} 0 0 0 0\n" for k, (x, y, z) in enumerate(photos.points, 1))
    (folder / "points3D.txt").write_text(points)
    return folder
