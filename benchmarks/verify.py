"""`nonsac verify` beside COLMAP's own geometric verification, on the same database in the same run.

    python benchmarks/verify.py [--seeds 5] [--workers 2]

Databases are made with pycolmap from simulated photos: a third of the pairs has 80 % wrong matches, 30 pairs have none
that is right. Both verify them, pycolmap's incremental mapper goes on, and its cameras are compared with the truth.

Writes benchmarks/results/verify.json; `python benchmarks/report.py` writes the block of docs/benchmarks.md from it.
"""

from __future__ import annotations

import argparse
import json
import resource
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, say, write

import nonsac  # before pycolmap, whose zlib would take the place of Python's
from nonsac.evaluation import rotation_error
from nonsac.simulate.photos import Photos

_PHOTOS, _POINTS, _NOISE = 23, 1500, 0.7
_WRONG_PAIRS, _HARD, _EASY = 30, 0.8, 0.3
_MAX_IMAGES = 2147483647


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.seeds):
        with tempfile.TemporaryDirectory() as folder:
            rows += compared(Path(folder), seed, arguments.workers)
    settings = {"photos": _PHOTOS, "noise": _NOISE, "wrong_pairs": _WRONG_PAIRS, "workers": arguments.workers}
    write(RESULTS / "verify.json", "verify", settings=settings, results=rows)


def compared(folder: Path, seed: int, workers: int) -> list[dict[str, Any]]:
    database = folder / "database.db"
    photos, wrong = make_database(database, seed)
    methods = {"pycolmap": by_pycolmap, "nonsac": by_nonsac}
    rows = []
    for method in sorted(methods, reverse=seed % 2 == 0):
        output = folder / f"{method}.db"
        spent = processor_time()
        start = time.perf_counter()
        methods[method](database, output, workers)
        seconds, spent = time.perf_counter() - start, processor_time() - spent
        kept = kept_pairs(output)
        row = {"method": method, "seed": seed, "pairs": len(wrong), "wall_s": seconds, "cpu_s": spent}
        row["kept"] = {str(share): sum(wrong[pair] == share for pair in kept) for share in (_EASY, _HARD, 1.0)}
        row["of"] = {str(share): sum(each == share for each in wrong.values()) for share in (_EASY, _HARD, 1.0)}
        rows.append(row | mapped(output, folder / method, photos))
        say(json.dumps(rows[-1]))
    return rows


def by_pycolmap(database: Path, output: Path, workers: int) -> None:
    import pycolmap

    with closing(sqlite3.connect(database)) as source, closing(sqlite3.connect(output)) as copy:
        source.backup(copy)
    options = pycolmap.GeometricVerifierOptions()
    options.num_threads = workers
    pycolmap.geometric_verification(output, options)


def by_nonsac(database: Path, output: Path, workers: int) -> None:
    nonsac.verify(database, output, workers=workers)


def make_database(path: Path, seed: int) -> tuple[Photos, dict[tuple[int, int], float]]:
    """Photos, and the share of wrong matches of each pair; those that look least alike have wrong ones only."""
    import pycolmap

    photos, rng = Photos.taken(_PHOTOS, _POINTS, _NOISE, seed), np.random.default_rng(seed)
    pairs = sorted(combinations(range(_PHOTOS), 2), key=lambda pair: pair[1] - pair[0])
    wrong = dict.fromkeys(pairs, _EASY) | dict.fromkeys(pairs[-_WRONG_PAIRS:], 1.0)
    hard = rng.permutation(len(pairs) - _WRONG_PAIRS)[: len(pairs) // 3]
    wrong |= {pairs[k]: _HARD for k in hard}
    with closing(pycolmap.Database.open(path)) as database:
        width, height = photos.camera.width, photos.camera.height
        camera = pycolmap.Camera(model="PINHOLE", width=width, height=height, params=photos.camera.params)
        camera.has_prior_focal_length = True
        number = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
        rig_number = database.write_rig(rig)
        for k, keypoints in enumerate(photos.keypoints):
            image = pycolmap.Image(name=f"{k:03}.jpg", camera_id=number)
            image.image_id = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig_number
            frame.add_data_id(image.data_id)
            database.write_frame(frame)
            database.write_keypoints(image.image_id, keypoints.astype(np.float32))
        for (first, second), share in wrong.items():
            matches = photos.matches(first, second, share, rng).astype(np.uint32)
            database.write_matches(first + 1, second + 1, matches)
    return photos, wrong


def kept_pairs(path: Path) -> set[tuple[int, int]]:
    """The pairs of photos that have enough inliers for COLMAP's mapper, which asks for 15."""
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT pair_id FROM two_view_geometries WHERE config > 1 AND rows >= 15").fetchall()
    return {(number // _MAX_IMAGES - 1, number % _MAX_IMAGES - 1) for (number,) in rows}


def mapped(database: Path, folder: Path, photos: Photos) -> dict[str, Any]:
    """What the mapper makes of it: cameras that are there, and their errors after alignment; the scene is 2 wide."""
    import pycolmap

    folder.mkdir()
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = 0
    models = pycolmap.incremental_mapping(database, folder, folder, options)
    if not models:
        return {"registered": 0}
    model = max(models.values(), key=lambda each: each.num_reg_images())
    images = [image for image in model.images.values() if image.has_pose]
    poses = [photos.poses[int(image.name[:3])] for image in images]
    true = np.array([-pose[:, :3].T @ pose[:, 3] for pose in poses])
    aligned = nonsac.register_pairs(np.array([image.projection_center() for image in images]), true, scale=None)
    errors = np.linalg.norm(aligned.apply(np.array([image.projection_center() for image in images])) - true, axis=1)
    turns = [
        rotation_error(image.cam_from_world().rotation.matrix() @ aligned.R.T, pose[:, :3])
        for image, pose in zip(images, poses, strict=True)
    ]
    facts = {"models": len(models), "registered": len(images), "points": model.num_points3D()}
    return facts | {
        "position": float(np.median(errors)),
        "worst_position": float(errors.max()),
        "rotation": float(np.median(turns)),
    }


def processor_time() -> float:
    """Of this process, and of those that it has started and that have ended."""
    used: Callable[[int], Any] = resource.getrusage
    parts = used(resource.RUSAGE_SELF), used(resource.RUSAGE_CHILDREN)
    return sum(part.ru_utime + part.ru_stime for part in parts)


if __name__ == "__main__":
    sys.exit(main())
