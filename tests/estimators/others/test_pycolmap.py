"""COLMAP's estimators as cores."""

import numpy as np
import pytest

from others_samples import NOISE, PROBLEMS, SEEDS, found, planted, solved

pycolmap = pytest.importorskip("pycolmap", reason="needs the extra pycolmap")
KINDS = ["RelativePose", "AbsolutePose"]
OUTLIERS = {"RelativePose": 0.5, "AbsolutePose": 0.7}


def directly(kind, rows, seed):
    """COLMAP as its users call it, in pixels, with our five standard deviations."""
    problem = PROBLEMS[kind]
    focals = (problem.focal1, problem.focal2) if kind == "RelativePose" else (problem.focal,)
    cameras = [pycolmap.Camera(model="SIMPLE_PINHOLE", width=1, height=1, params=[f, 0, 0]) for f in focals]
    options = pycolmap.RANSACOptions(max_error=5.0 * NOISE[kind], random_seed=seed, confidence=0.9999)
    if kind == "RelativePose":
        scaled = rows[:, :2] * focals[0], rows[:, 2:] * focals[1]
        return pycolmap.estimate_essential_matrix(*scaled, *cameras, options)["cam2_from_cam1"].matrix()
    settings = pycolmap.AbsolutePoseEstimationOptions()
    settings.ransac = options
    answer = pycolmap.estimate_absolute_pose(rows[:, :2] * focals[0], rows[:, 2:], *cameras, settings)
    return answer["cam_from_world"].matrix()


@pytest.mark.parametrize("kind", KINDS)
def test_it_solves_as_much_as_the_library_itself(kind):
    own = others = 0
    for seed in range(SEEDS):
        rows, truth = planted(kind, OUTLIERS[kind], seed)
        own += solved(found("pycolmap", kind, rows, seed=seed).model, kind, truth)
        others += solved(directly(kind, rows, seed), kind, truth)
    assert own >= others
    assert own == SEEDS


def test_a_world_far_away_is_no_trouble():
    rows, truth = planted("AbsolutePose", 0.5, 0)
    rows[:, 2:] = 1000.0 * rows[:, 2:] + [5e6, 6e6, 100.0]
    assert solved(found("pycolmap", "AbsolutePose", rows).model, "AbsolutePose", truth, 0.5)


def test_few_iterations_are_possible():
    from dataclasses import replace

    from nonsac import Noise, Rows
    from nonsac.estimators.named import chosen_estimator

    few = replace(chosen_estimator("pycolmap", PROBLEMS["RelativePose"]), iterations=50)
    rows, truth = planted("RelativePose", 0.0, 0)
    hypothesis = few.estimate(PROBLEMS["RelativePose"], Rows(rows), Noise.given(1.0), np.random.default_rng(0))
    assert solved(hypothesis.model, "RelativePose", truth)
