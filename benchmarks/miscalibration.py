"""What the verdict says if the cameras are not those that the user believes: further kinds of data for verdict.py.

    python benchmarks/verdict.py --miscalibrated [--seeds 200]

Two views of 600 points between 4 and 12 units away, in images of 1,280 x 720 pixels with a focal length of 1,000,
turned by 5 to 15 degrees; 0.5 pixels of noise, 30 % of the matches wrong, the noise not given. One thing is wrong with
the calibration, or nothing. The answer is right if the rotation is within 10 degrees and the translation within 20;
without a translation none is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, commit, renewed, say, write
from reproduction import markdown, paragraph
from scipy.spatial.transform import Rotation

import nonsac
from nonsac.evaluation import rotation_error
from nonsac.layouts import Array

JSON = RESULTS / "verdict_miscalibrated.json"
PAGE = Path(__file__).parents[1] / "docs" / "verdict.md"
BEGIN, END = "<!-- miscalibration study -->", "<!-- end of miscalibration study -->"
FOCAL, SIZE, POINTS, NOISE, OUTLIERS = 1000.0, np.array([1280.0, 720.0]), 600, 0.5, 0.3
RIGHT_ROTATION, RIGHT_TRANSLATION = 10.0, 20.0  # degrees
MISTAKES = ("pure rotation", "mirrored", "points do not lie")  # how remarks on the calibration begin


@dataclass(frozen=True)
class Kind:
    """What the views are, and what is wrong with what is said of them."""

    name: str
    translates: bool = True
    focal: float = FOCAL  # that is told
    distortion: float = 0.0  # that is not told
    spoil: Callable[[Array, Array], tuple[Array, Array]] = lambda first, second: (first, second)


def mirrored(pixels: Array) -> Array:
    return np.column_stack([SIZE[0] - pixels[:, 0], pixels[:, 1]])


def exchanged(pixels: Array) -> Array:
    return np.ascontiguousarray(pixels[:, ::-1])


KINDS = (
    Kind("pure rotation, nothing wrong", translates=False),
    Kind("pure rotation, focal length 20 % too long", translates=False, focal=1.2 * FOCAL),
    Kind("pure rotation, focal length 20 % too short", translates=False, focal=0.8 * FOCAL),
    Kind("pure rotation, radial distortion of -0.2 ignored", translates=False, distortion=-0.2),
    Kind("translation, nothing wrong"),
    Kind("translation, focal length 20 % too long", focal=1.2 * FOCAL),
    Kind("translation, focal length 20 % too short", focal=0.8 * FOCAL),
    Kind("translation, radial distortion of -0.2 ignored", distortion=-0.2),
    Kind("second image mirrored", spoil=lambda first, second: (first, mirrored(second))),
    Kind("second image with x and y exchanged", spoil=lambda first, second: (first, exchanged(second))),
    Kind("second image of half the size", spoil=lambda first, second: (first, 0.5 * second)),
    Kind("both images mirrored", spoil=lambda first, second: (mirrored(first), mirrored(second))),
    Kind("both images with x and y exchanged", spoil=lambda first, second: (exchanged(first), exchanged(second))),
)


def views(kind: Kind, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Pixels in both images, and the true rotation and translation."""
    depth = rng.uniform(4.0, 12.0, POINTS)
    points = np.column_stack([*(rng.uniform(-0.5, 0.5, (2, POINTS)) * SIZE[:, None] / FOCAL * depth), depth])
    axis, way = (vector / np.linalg.norm(vector) for vector in rng.standard_normal((2, 3)))
    rotation = Rotation.from_rotvec(np.radians(rng.uniform(5.0, 15.0)) * axis).as_matrix()
    shift = kind.translates * rng.uniform(0.5, 1.5) * way
    moved = points @ rotation.T + shift
    first, second = (projected(cloud, kind.distortion, rng) for cloud in (points, moved))
    seen = (moved[:, 2] > 0.5) & (np.abs(second - 0.5 * SIZE) < 0.5 * SIZE).all(axis=1)
    first, second = first[seen], second[seen]
    wrong = rng.random(len(first)) < OUTLIERS
    second[wrong] = rng.uniform(0.0, SIZE, (np.count_nonzero(wrong), 2))
    return (*kind.spoil(first, second), rotation, shift)


def projected(points: Array, distortion: float, rng: np.random.Generator) -> Array:
    rays = points[:, :2] / points[:, 2:]
    rays = rays * (1.0 + distortion * (rays**2).sum(axis=1, keepdims=True))
    return FOCAL * rays + 0.5 * SIZE + rng.normal(scale=NOISE, size=rays.shape)


def outcome(kind: Kind, seed: int) -> dict[str, Any]:
    """What is said of one trial, and how far off it is."""
    first, second, rotation, shift = views(kind, np.random.default_rng([seed, KINDS.index(kind)]))
    camera = nonsac.Camera("PINHOLE", (kind.focal, kind.focal, *(0.5 * SIZE)))
    result = nonsac.relative_pose(first, second, camera, rng=seed)
    turned = float(rotation_error(result.R, rotation))
    moved = float(np.degrees(np.arccos(np.clip(result.t @ shift / max(np.linalg.norm(shift), 1e-300), -1.0, 1.0))))
    right = kind.translates and turned < RIGHT_ROTATION and moved < RIGHT_TRANSLATION
    said = any(str(remark).startswith(MISTAKES) for remark in result.info["remarks"])
    return {"trusted": result.success, "right": bool(right), "said": said, "rotation": turned, "translation": moved}


def measure(seeds: int) -> None:
    """Run all kinds, write the JSON and the page."""
    rows = []
    for kind in KINDS:
        found = [outcome(kind, seed) for seed in range(seeds)]
        wrong = [each for each in found if each["trusted"] and not each["right"]]
        rows.append({
            "kind": kind.name,
            "trials": seeds,
            "trusted_right": sum(each["trusted"] and each["right"] for each in found),
            "trusted_wrong": len(wrong),
            "trusted_wrong_in_silence": sum(not each["said"] for each in wrong),
            "remarks_on_right": sum(each["trusted"] and each["right"] and each["said"] for each in found),
            "median_rotation_error": float(np.nanmedian([each["rotation"] for each in found])),
            "median_translation_error": float(np.nanmedian([each["translation"] for each in found])),
            "translates": kind.translates,
        })  # fmt: skip
        say(str(rows[-1]))
    write(JSON, "verdict_miscalibrated", results=rows, commit=commit())
    write_page(rows)


def write_page(rows: Sequence[dict[str, Any]]) -> None:
    """Write the block of docs/verdict.md."""
    PAGE.write_text(renewed(PAGE.read_text(), BEGIN, END, block(rows)))


def block(rows: Sequence[dict[str, Any]]) -> str:
    """All between the markers."""
    header = ["two views", "trials", "trusted, right", "trusted, wrong", "of these without a remark", "median error"]
    lines = (
        [row["kind"], f"{row['trials']}", f"{row['trusted_right']}", f"{row['trusted_wrong']}",
         f"{row['trusted_wrong_in_silence']}", errors(row)] for row in rows
    )  # fmt: skip
    intro = paragraph("""
        600 points between 4 and 12 units away, in images of 1,280 x 720 pixels with a focal length of 1,000; the camera
        turned by 5 to 15 degrees; 0.5 pixels of noise, which is not given, 30 % of the matches wrong. Right is a
        rotation within 10 degrees and a translation within 20. Written by `benchmarks/verdict.py --miscalibrated` from
        `benchmarks/results/verdict_miscalibrated.json`.
    """)
    return f"{intro}\n\n{markdown(header, lines)}"


def errors(row: dict[str, Any]) -> str:
    """Of rotation and translation."""
    rotation = f"{row['median_rotation_error']:.2f} deg"
    return f"{rotation}, t {row['median_translation_error']:.1f} deg" if row["translates"] else rotation
