"""PoseLib as a core."""

import numpy as np
import pytest

from nonsac.testing import check_estimator
from others_samples import NOISE, PROBLEMS, SEEDS, chosen_estimator, found, planted, solved

poselib = pytest.importorskip("poselib", reason="needs the extra poselib")
KINDS = ["RelativePose", "AbsolutePose"]
OUTLIERS = {"RelativePose": 0.5, "AbsolutePose": 0.8}


def directly(kind, rows, seed):
    """PoseLib as its users call it, in pixels, with our five standard deviations."""
    problem, bound = PROBLEMS[kind], 5.0 * NOISE[kind]
    focals = (problem.focal1, problem.focal2) if kind == "RelativePose" else (problem.focal,)
    cameras = [{"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [f, 0.0, 0.0]} for f in focals]
    options = {"max_epipolar_error": bound, "max_reproj_error": bound, "seed": seed, "success_prob": 0.9999}
    if kind == "RelativePose":
        pose, _ = poselib.estimate_relative_pose(
            rows[:, :2] * focals[0], rows[:, 2:] * focals[1], *cameras, options, {}
        )
    else:
        pose, _ = poselib.estimate_absolute_pose(rows[:, :2] * focals[0], rows[:, 2:], *cameras, options, {})
    return np.asarray(pose.Rt)


@pytest.mark.parametrize("kind", KINDS)
def test_it_solves_as_much_as_the_library_itself(kind):
    own = others = 0
    for seed in range(SEEDS):
        rows, truth = planted(kind, OUTLIERS[kind], seed)
        own += solved(found("poselib", kind, rows, seed=seed).model, kind, truth)
        others += solved(directly(kind, rows, seed), kind, truth)
    assert own >= others
    assert own == SEEDS


@pytest.mark.parametrize("kind", KINDS)
def test_it_does_what_the_contract_says(kind):
    check_estimator(chosen_estimator("poselib", PROBLEMS[kind]), PROBLEMS[kind], planted(kind, 0.5, 1)[0], NOISE[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_the_threshold_is_in_pixels(kind, monkeypatch):
    """PoseLib ignores names that it does not know: the right one must have reached it."""
    given, name = [], "estimate_relative_pose" if kind == "RelativePose" else "estimate_absolute_pose"
    original = getattr(poselib, name)
    monkeypatch.setattr(poselib, name, lambda *arguments: given.append(arguments[-2]) or original(*arguments))
    found("poselib", kind, planted(kind, 0.5, 0)[0], seed=3)
    (options,) = given
    assert options.keys() <= poselib.RansacOptions().keys()
    expected = 5.0 * np.mean([1 / 800, 1 / 1000]) if kind == "RelativePose" else 5.0 / 900
    assert options["max_epipolar_error" if kind == "RelativePose" else "max_reproj_error"] == pytest.approx(expected)


def test_a_world_far_away_is_no_trouble():
    rows, truth = planted("AbsolutePose", 0.5, 0)
    rows[:, 2:] = 1000.0 * rows[:, 2:] + [5e6, 6e6, 100.0]
    assert solved(found("poselib", "AbsolutePose", rows).model, "AbsolutePose", truth, 0.5)
