from itertools import product

import numpy as np
import pytest

import naive
from nonsac import Registration, Rows, simulate
from nonsac.estimators.graph_cut import GraphCut, labels, neighbourhood
from nonsac.estimators.scores import Truncated
from nonsac.estimators.usac import Consensus
from nonsac.layouts import PAIRS, Layout

NOISE = 0.01


def published_energy(chosen, ratios, edges, coherence):
    """Eq. 4 to 6, pair by pair."""
    kernel = np.exp(-0.5 * ratios**2)
    energy = sum(1 - k if inlier else k for k, inlier in zip(kernel, chosen, strict=True))
    for p, q in edges:
        mean = 0.5 * (kernel[p] + kernel[q])
        energy += coherence * (1.0 if chosen[p] != chosen[q] else 1.0 - mean if chosen[p] else mean)
    return energy


@pytest.mark.parametrize("coherence", [0.0, 0.14, 0.6, 3.0])
def test_labels_have_the_least_energy_of_all(rng, coherence):
    for _ in range(10):
        ratios = rng.uniform(0.0, 2.5, 9)
        edges = np.array([(p, q) for p in range(9) for q in range(p + 1, 9) if rng.random() < 0.4])
        least = min(published_energy(each, ratios, edges, coherence) for each in product([False, True], repeat=9))
        found = labels(ratios, edges, coherence)
        assert published_energy(found, ratios, edges, coherence) == pytest.approx(least, abs=1e-3)


def test_without_neighbours_each_row_is_labelled_by_itself(rng):
    ratios = rng.uniform(0.0, 3.0, 500)
    found = labels(ratios, np.empty((0, 2), np.int64), 0.14)
    np.testing.assert_array_equal(found, ratios < np.sqrt(2 * np.log(2)))


def test_rows_that_are_infinitely_far_are_outliers_and_none_is_no_error():
    assert labels(np.array([np.inf, 0.0, np.nan]), np.array([[0, 1], [1, 2]]), 0.14).tolist() == [False, True, False]
    assert len(labels(np.empty(0), np.empty((0, 2), np.int64), 0.14)) == 0


def test_labels_of_many_rows_do_not_overflow(rng):
    ratios, edges = np.zeros(300_000), np.column_stack([np.arange(299_999), np.arange(1, 300_000)])
    assert labels(ratios, edges, 10.0).all()


def test_neighbours_make_labels_right_where_inliers_lie_together(rng):
    """What spatial coherence is for: outliers that are near by chance lie alone, inliers do not."""
    points = rng.uniform(0, 1, (2000, 2))
    right = points[:, 0] < 0.4
    ratios = np.where(right, np.abs(rng.normal(0, 0.7, 2000)), rng.uniform(0, 3, 2000))
    edges = neighbourhood(Rows(points), Layout("x y"), 6)
    mistakes = [np.count_nonzero(labels(ratios, edges, coherence) != right) for coherence in (0.0, 0.14, 0.5)]
    assert mistakes[2] < mistakes[1] < 0.8 * mistakes[0]


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_neighbours_are_the_nearest_rows_in_any_unit(rng, unit):
    values = rng.standard_normal((40, 6))
    found = {tuple(pair) for pair in neighbourhood(Rows(values * np.repeat([unit, 1.0], 3)), PAIRS, 3).tolist()}
    scaled = np.hstack([half / np.sqrt(half.var(axis=0).sum()) for half in np.hsplit(values, 2)])
    expected = set()
    for i, point in enumerate(scaled):
        for j in np.argsort(np.linalg.norm(scaled - point, axis=1))[1:4]:
            expected.add((min(i, int(j)), max(i, int(j))))
    assert found == expected


def test_rows_that_are_one_or_all_the_same_have_neighbours_without_error():
    assert len(neighbourhood(Rows(np.zeros((1, 6))), PAIRS, 3)) == 0
    assert len(neighbourhood(Rows(np.zeros((0, 6))), PAIRS, 3)) == 0
    assert len(neighbourhood(Rows(np.ones((9, 6))), PAIRS, 3)) > 0


def test_models_get_better_with_every_labelling(rng):
    pairs = simulate.registration(400, 0.6, NOISE, rng)
    rows = np.hstack([pairs.source, pairs.target])
    consensus = Consensus(Registration(), Rows(rows), 5 * NOISE, Truncated())
    start = naive.nudged(rng, pairs.T[:3], 1.0)
    models = GraphCut(samples=4).models(consensus, start, rng)
    assert len(models) % 5 == 0  # of four samples, and of all inliers
    scores = consensus.scores(models).reshape(-1, 5).max(axis=1)
    assert (np.diff(scores) > 0.0).all()
    assert scores[0] > consensus.scores(start[None])[0]
    assert naive.angle_between(models[np.argmax(consensus.scores(models))], pairs.T) < 0.5


@pytest.mark.parametrize(("size", "rows"), [(1.0, 3), (1.5, 5), (7.0, 21)])
def test_samples_are_multiples_of_minimal_ones(rng, size, rows):
    class Sized(Registration):
        def refit(self, model, rows, weights):
            sizes.append(len(rows))
            return super().refit(model, rows, weights)

    sizes, pairs = [], simulate.registration(200, 0.5, NOISE, rng)
    consensus = Consensus(Sized(), Rows(np.hstack([pairs.source, pairs.target])), 5 * NOISE, Truncated())
    GraphCut(sample_size=size, samples=4, rounds=1).models(consensus, pairs.T[:3], rng)
    assert sizes[1:] == [rows] * 4
    assert 90 <= sizes[0] <= 110


def test_wrong_settings_are_refused_by_name():
    for wrong in (-0.1, np.nan, np.inf, "much"):
        with pytest.raises(ValueError, match="coherence must be a number of at least 0, got"):
            GraphCut(coherence=wrong)
    for wrong in (0.9, np.nan, np.inf, "7"):
        with pytest.raises(ValueError, match="sample_size must be a number of at least 1, got"):
            GraphCut(sample_size=wrong)
    for name in ("neighbours", "samples", "rounds"):
        for number in (0, 1.5, True, "3"):
            with pytest.raises(ValueError, match=f"{name} must be a whole number of at least 1, got"):
                GraphCut(**{name: number})
