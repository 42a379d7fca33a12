import numpy as np
import pytest

from nonsac import External, Pcr99, Ransac, simulate
from nonsac.estimators.any_noise import Octaves
from nonsac.evaluation import rotation_error
from nonsac.layouts import Rows
from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.problems.ladder import Ladder, Telling

RANSAC = Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=100)
CASES = {
    "relative pose": (RelativePose(), simulate.relative_pose, ("points1", "points2"), RANSAC, 0.7),
    "absolute pose": (AbsolutePose(), simulate.absolute_pose, ("points2d", "points3d"), RANSAC, 0.9),
    "registration": (Registration(), simulate.registration, ("source", "target"), Pcr99.for_pairs(), 0.97),
    "free scale": (Registration(None), simulate.registration, ("source", "target"), Pcr99(), 0.9),
    "pairs by ransac": (Registration(), simulate.registration, ("source", "target"), RANSAC, 0.9),
}


def estimated(case, rng, noise, n=1000, seed=0):
    problem, make, names, estimator, outliers = CASES[case]
    data = make(n, outliers, noise, rng)
    rows = np.hstack([getattr(data, name) for name in names])
    return data, rows, estimator.estimate_at_any_noise(problem, Rows(rows), np.random.default_rng(seed))


@pytest.mark.parametrize("noise", [3e-4, 0.003])
@pytest.mark.parametrize("case", CASES)
def test_model_and_noise_are_found_together(rng, case, noise):
    data, rows, found = estimated(case, rng, noise)
    turned = found.model[:, :3] / np.cbrt(np.linalg.det(found.model[:, :3]))
    assert rotation_error(turned, data.T[:3, :3]) < 3.0
    assert 1.0 < found.threshold / noise < 15.0
    assert found.log_chance < -40.0
    np.testing.assert_allclose(found.residuals, CASES[case][0].residuals(found.model[None], rows)[0])


@pytest.mark.parametrize("case", CASES)
def test_wrong_rows_alone_mean_little(rng, case):
    problem, make, names, estimator, _ = CASES[case]
    data = make(400, 1.0, 0.003, rng)
    rows = np.hstack([getattr(data, name) for name in names])
    found = estimator.estimate_at_any_noise(problem, Rows(rows), rng)
    assert found is None or found.log_chance > -np.log(max(found.tested, 10)) - 14.0


@pytest.mark.parametrize("case", ["relative pose", "registration"])
def test_the_same_seed_gives_the_same_bits(case):
    once, again = (estimated(case, np.random.default_rng(5), 0.003)[2] for _ in range(2))
    np.testing.assert_array_equal(once.model, again.model)
    assert (once.threshold, once.log_chance, once.tested) == (again.threshold, again.log_chance, again.tested)


def test_who_needs_a_noise_says_so(rng):
    problem, _, _, _, _ = CASES["registration"]
    data = simulate.registration(200, 0.5, 0.01, rng)
    rows = Rows(np.hstack([data.source, data.target]))
    weighted = Rows(rows.values, np.linspace(1, 2, 200))
    assert External(lambda values, threshold, seed: None).estimate_at_any_noise(problem, rows, rng) is None
    assert Ransac(500).estimate_at_any_noise(problem, rows, rng) is None
    for estimator in (RANSAC, Pcr99.for_pairs()):
        assert estimator.estimate_at_any_noise(problem, weighted, rng) is None
        assert estimator.estimate_at_any_noise(problem, Rows(np.zeros((50, 6))), rng) is None


def test_a_finer_model_is_taken_if_the_rows_are_likelier_with_it(rng):
    """Of the two, the coarse one was found less likely by chance; it is off by two thirds of its threshold."""
    problem, data = Registration(), simulate.registration(600, 0.8, 0.004, rng)
    rows = Rows(np.hstack([data.source, data.target]))
    octaves = Octaves(problem, rows, Ladder.of(problem, rows, rng), lambda model, threshold: model)
    right, off = data.T[:3], data.T[:3].copy()
    off[0, 3] += 0.05
    octaves.keep(right)
    coarse = float(octaves.ladder.thresholds[np.searchsorted(octaves.ladder.thresholds, 0.08)])
    telling = Telling(problem, rows)
    model, threshold = octaves._likeliest(telling, off, coarse)
    np.testing.assert_array_equal(model, right)
    assert threshold < 0.5 * coarse
    model, threshold = octaves._likeliest(telling, right, coarse)
    np.testing.assert_array_equal(model, right)
    assert threshold == coarse
