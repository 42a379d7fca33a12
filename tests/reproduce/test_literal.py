from dataclasses import replace

import numpy as np
import pytest

from nonsac import RelativePose, simulate
from nonsac.reproduce import table2
from nonsac.reproduce.experiments import EXPERIMENTS, chosen
from nonsac.reproduce.literal import LITERAL, PlainSampson


def plain_sampson(model, row):
    """Sampson's distance of one match (Hartley and Zisserman, Eq. 11.9)."""
    t, R = model[:, 3], model[:, :3]
    E = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]) @ R
    first, second = np.append(row[:2], 1.0), np.append(row[2:], 1.0)
    line2, line1 = E @ first, E.T @ second
    return abs(second @ line2) / np.sqrt(line2[0] ** 2 + line2[1] ** 2 + line1[0] ** 2 + line1[1] ** 2)


def test_the_residual_is_that_of_sampson_wherever_rays_meet(rng):
    rows = rng.uniform(-1, 1, (50, 4))
    models = np.stack([simulate.relative_pose(1, 0.0, 0.0, seed).T[:3] for seed in range(4)])
    residuals = PlainSampson().residuals(models, rows)
    expected = [[plain_sampson(model, row) for row in rows] for model in models]
    np.testing.assert_allclose(residuals, expected, rtol=1e-9)
    usual = RelativePose().residuals(models, rows)
    assert (usual > residuals + 1e-9).any()  # of rays that meet behind a camera
    assert (usual >= residuals - 1e-12).all()


def test_its_counts_are_those_of_its_residuals(rng):
    rows = rng.uniform(-1, 1, (200, 4))
    models = np.stack([simulate.relative_pose(1, 0.0, 0.0, seed).T[:3] for seed in range(6)])
    residuals = PlainSampson().residuals(models, rows)
    counts = PlainSampson().count_inliers(models, rows, 0.05)
    np.testing.assert_array_equal(counts, (residuals < 0.05).sum(axis=1))
    on_ladder = PlainSampson().count_on_ladder(models, rows, 0.05 * 2.0 ** (0.5 * np.arange(5)))
    np.testing.assert_array_equal(on_ladder[:, 0], counts)


def test_a_match_at_both_epipoles_fits_nothing():
    model = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])
    assert PlainSampson().residuals(model[None], np.zeros((1, 4)))[0, 0] == np.inf


def test_what_is_literal_differs_in_what_the_text_says_only():
    assert list(LITERAL) == list(EXPERIMENTS)
    for name, literal in LITERAL.items():
        usual = EXPERIMENTS[name]
        assert (literal.outlier_ratios, literal.noises) == (usual.outlier_ratios, usual.noises)
        assert literal.sample_size == usual.sample_size
    assert LITERAL["registration"].estimator.rank == "sum"
    assert LITERAL["registration"].estimator.refit == "once"
    for name in ("relative-pose", "absolute-pose"):
        T = LITERAL[name].simulate(10, 0.5, 0.01, np.random.default_rng(0))[1]
        centre = -T[:3, :3].T @ T[:3, 3]
        assert centre[2] < -0.5  # behind the first camera


@pytest.mark.parametrize("problem", list(EXPERIMENTS))
def test_the_table_says_that_it_is_literal(monkeypatch, problem):
    monkeypatch.setattr(table2, "chosen", lambda names, literal: _small(chosen(names, literal)))
    usual, literal = (table2.run([problem], [2], trials=1, workers=1, literal=literal) for literal in (False, True))
    assert "literal" not in usual["settings"]
    assert literal["settings"]["literal"]
    assert literal["percentiles"] != usual["percentiles"]
    assert 0.0 <= literal[problem]["2"]["ideal"] <= 1.0


def _small(experiments):
    return tuple(
        replace(each, outlier_ratios=each.outlier_ratios[-1:], noises=each.noises[-1:]) for each in experiments
    )
