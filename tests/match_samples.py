"""Sample files of matches, built from the definitions of their formats."""

import io
import sqlite3
import struct
import zlib
from contextlib import closing

import numpy as np
import pytest

PAIRS = np.array([[1.0, 2, 3, 4], [7, 8, np.nan, 10]])
POINTS = np.array([[1.0, 2, 3, 4, 5], [7, 8, np.nan, 10, 11]])
WEIGHTS = np.array([0.5, 0.25])
K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])


def parquet(**columns):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    buffer = io.BytesIO()
    write_table(pyarrow.table(columns), buffer)
    return buffer.getvalue()


def middlebury(moves):
    """A .flo file, as its page has it: a tag that is the float 202021.25, width, height, then u v of each pixel."""
    height, width, _ = moves.shape
    return struct.pack("<fii", 202021.25, width, height) + moves.astype("<f4").tobytes()


def png(channels, depth=16, colour=2):
    """A PNG of unfiltered rows, by its specification."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = channels.shape[:2]
    rows = b"".join(b"\0" + row.astype(">u2" if depth == 16 else "u1").tobytes() for row in channels)
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def kitti(moves, known):
    """A PNG of flow, as KITTI has it."""
    return png(np.dstack([moves * 64 + 2**15, known]).astype(np.uint16))


# With the distortion of real lenses, none of which folds over in the square |x|, |y| < 0.7.
LENSES = {
    "SIMPLE_PINHOLE": "SIMPLE_PINHOLE 640 480 530 342 234",
    "PINHOLE": "PINHOLE 640 480 533 534 342 234",
    "SIMPLE_RADIAL": "SIMPLE_RADIAL 640 480 530 342 234 -0.13",
    "RADIAL": "RADIAL 640 480 530 342 234 -0.28 0.09",
    "OPENCV": "OPENCV 640 480 533 534 342 234 -0.28 0.07 0.0012 -0.0023",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE 640 480 300 302 342 234 0.02 -0.015 0.004 -0.001",
    "FULL_OPENCV": "FULL_OPENCV 640 480 533 534 342 234 0.4 0.03 0.0012 -0.0023 0.002 0.7 0.06 -0.004",
    "FOV": "FOV 640 480 300 302 342 234 0.9",
    "SIMPLE_RADIAL_FISHEYE": "SIMPLE_RADIAL_FISHEYE 640 480 300 342 234 -0.02",
    "RADIAL_FISHEYE": "RADIAL_FISHEYE 640 480 300 342 234 0.03 -0.02",
    "THIN_PRISM_FISHEYE": "THIN_PRISM_FISHEYE 640 480 300 302 342 234 "
    "0.02 -0.015 0.001 -0.002 0.004 -0.001 0.002 -0.003",
    "RAD_TAN_THIN_PRISM_FISHEYE": "RAD_TAN_THIN_PRISM_FISHEYE 640 480 300 302 342 234 "
    "-0.02 0.09 -0.06 0.009 0.002 -0.0004 0.0011 -0.0007 -0.0005 0.0002 0.0009 -0.0001",
    "SIMPLE_DIVISION": "SIMPLE_DIVISION 640 480 530 342 234 -0.13",
    "DIVISION": "DIVISION 640 480 533 534 342 234 0.11",
    "SIMPLE_FISHEYE": "SIMPLE_FISHEYE 640 480 300 342 234",
    "FISHEYE": "FISHEYE 640 480 300 302 342 234",
    "EUCM": "EUCM 640 480 300 302 342 234 0.6 1.1",
}

# As in the documentation of COLMAP 3.
SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
"""
PINHOLE, RADIAL, FISHEYE, PANORAMA = 1, 3, 5, 17
DB_CAMERAS = {
    4: (PINHOLE, 640, 480, [500, 510, 320, 240]),
    6: (RADIAL, 800, 600, [700, 400, 300, 0.1, -0.02]),
    8: (FISHEYE, 640, 480, [500, 510, 320, 240, 0.1, 0.2, 0.3, 0.4]),
    9: (PANORAMA, 640, 320, [640, 320]),
}
# Number of an image: its name and camera.
DB_IMAGES = {7: ("b.jpg", 6), 3: ("sub/a b.jpg", 4), 11: ("fish.jpg", 8), 12: ("around.jpg", 9), 13: ("none.jpg", 4)}
DB_KEYPOINTS = {
    3: np.array([[1.5, 2.5], [10.25, 20.5], [30, 40], [50, 60]]),
    7: np.array([[5, 6, 1, 0, 0, 1], [7, 8, 1, 0, 0, 1], [9, 10.5, 2, 0, 0, 2]]),
    11: np.array([[1, 2, 3, 4]]),
    12: np.array([[1, 2]]),
}
DB_MATCHES = {3 * 2147483647 + 7: [[0, 2], [3, 1]], 3 * 2147483647 + 11: [], 3 * 2147483647 + 12: [[0, 0]]}


def fill_database(path, schema=SCHEMA):
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript(schema)
        for number, (model, width, height, params) in DB_CAMERAS.items():
            row = (number, model, width, height, np.array(params, "<f8").tobytes(), 1)
            database.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)", row)
        for number, (name, camera) in DB_IMAGES.items():
            database.execute("INSERT INTO images VALUES (?, ?, ?)", (number, name, camera))
        for number, points in DB_KEYPOINTS.items():
            row = (number, *points.shape, points.astype("<f4").tobytes())
            database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", row)
        for number, matches in DB_MATCHES.items():
            row = (number, len(matches), 2, np.array(matches, "<u4").tobytes())
            database.execute("INSERT INTO matches VALUES (?, ?, ?, ?)", row)


# By COLMAP's numbers: SIMPLE_RADIAL, EQUIRECTANGULAR (which nonsac does not know), PINHOLE.
MODEL_CAMERAS = {
    2: (2, "SIMPLE_RADIAL", 640, 480, [500, 320, 240, 0.1]),
    5: (17, "EQUIRECTANGULAR", 640, 320, [640, 320]),
    1: (1, "PINHOLE", 800, 600, [700, 710, 400.5, 300.25]),
}
SEEN = [(10.5, 20.5, 30), (1, 1, -1), (11, 21, 20), (12, 22, 2**40), (13, 23, 30)]
# Number, pose, camera, name, and the keypoints with the numbers of their points.
MODEL_IMAGES = [
    (9, [1, 0, 0, 0, 0, 0, 0], 2, "db/first.jpg", [(1.5, 2.5, -1), (3, 4, 20)]),
    (4, [0.8, 0, 0.6, 0, 1, 2, 3], 1, "b.jpg", SEEN),
    (6, [1, 0, 0, 0, 0, 0, 1], 5, "wide.jpg", [(1, 2, 20)]),
    (7, [1, 0, 0, 0, 0, 0, 2], 1, "empty.jpg", []),
    (8, [0, 0, 0, 0, 0, 0, 2], 1, "bad.jpg", [(1, 2, 99)]),
]
MODEL_POINTS = {20: [1, 2, 3], 2**40: [-4.5, 5, 6.25], 7: [0, 0, 0], 30: [7, 8, 9]}
TRACK = [(9, 1), (4, 2)]


def write_binary_model(folder):
    cameras, images, points = (struct.pack("<Q", len(rows)) for rows in (MODEL_CAMERAS, MODEL_IMAGES, MODEL_POINTS))
    for number, (model, _, width, height, params) in MODEL_CAMERAS.items():
        cameras += struct.pack(f"<IiQQ{len(params)}d", number, model, width, height, *params)
    for number, pose, camera, name, observations in MODEL_IMAGES:
        images += struct.pack("<I7dI", number, *pose, camera) + name.encode() + b"\0"
        images += struct.pack("<Q", len(observations))
        images += b"".join(struct.pack("<ddQ", x, y, point % 2**64) for x, y, point in observations)
    for number, xyz in MODEL_POINTS.items():
        points += struct.pack("<Q3d3Bd", number, *xyz, 1, 2, 3, 0.5) + struct.pack("<Q", len(TRACK))
        points += b"".join(struct.pack("<II", *entry) for entry in TRACK)
    return save(folder, ".bin", cameras=cameras, images=images, points3D=points)


def write_text_model(folder):
    cameras, images, points = "# Camera list\n", "# Image list\n# IMAGE_ID, QW, ...\n", "# 3D point list\n\n"
    for number, (_, name, width, height, params) in MODEL_CAMERAS.items():
        cameras += f"{number} {name} {width} {height} {join(params)}\n"
    for number, pose, camera, name, observations in MODEL_IMAGES:
        images += f"{number} {join(pose)} {camera} {name}\n{' '.join(map(join, observations))}\n"
    for number, xyz in MODEL_POINTS.items():
        points += f"{number} {join(xyz)} 1 2 3 0.5 {' '.join(map(join, TRACK))}\n"
    return save(folder, ".txt", cameras=cameras.encode(), images=images.encode(), points3D=points.encode())


def join(values):
    return " ".join(map(str, values))


def save(folder, suffix, **contents):
    folder.mkdir(exist_ok=True)
    for name, content in contents.items():
        (folder / f"{name}{suffix}").write_bytes(content)
    return folder
