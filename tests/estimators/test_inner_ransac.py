import numpy as np
import pytest

import naive
from nonsac import Noise, Registration, Rows, simulate
from nonsac.estimators.inner_ransac import InnerRansac
from nonsac.estimators.scores import Inliers
from nonsac.estimators.usac import Consensus, Usac

NOISE = 0.01


def two_clouds(rng, n=400, outliers=0.5):
    pairs = simulate.registration(n, outliers, NOISE, rng)
    return np.hstack([pairs.source, pairs.target]), pairs.T[:3]


def consensus_of(rows, problem=None, threshold=5 * NOISE):
    return Consensus(problem or Registration(), Rows(rows), threshold, Inliers())


class Recorded(Registration):
    """Takes down how many rows each fit is to, and how far they are from the model before."""

    def refit(self, model, rows, weights):
        self.fits.append((len(rows), self.residuals(model[None], rows)[0].max()))
        return super().refit(model, rows, weights)


def recorded():
    problem = Recorded()
    object.__setattr__(problem, "fits", [])
    return problem


def test_samples_are_of_inliers_and_of_the_published_size(rng):
    """Ten samples of min(I / 2, 14), each followed by fits within a threshold that shrinks to the given one."""
    rows, T = two_clouds(rng)
    problem = recorded()
    models = InnerRansac().models(consensus_of(rows, problem), T, rng)
    assert len(models) == 10
    assert len(problem.fits) == 10 * 5
    for start in range(0, 50, 5):
        size, farthest = problem.fits[start]
        assert size == 14
        assert farthest < 5 * NOISE
        widths = [farthest / (5 * NOISE) for _, farthest in problem.fits[start + 1 : start + 5]]
        assert (np.array(widths) < np.geomspace(2.0, 1.0, 4)).all()


@pytest.mark.parametrize(("inliers", "size"), [(6, 3), (11, 5), (27, 13), (29, 14), (100, 14)])
def test_a_sample_is_half_of_few_inliers(rng, inliers, size):
    rows, T = two_clouds(rng, inliers, 0.0)
    problem = recorded()
    InnerRansac(samples=1).models(consensus_of(rows, problem, 1e6), T, rng)
    assert problem.fits[0][0] == size


def test_less_than_two_minimal_samples_of_inliers_are_left_alone(rng):
    rows, T = two_clouds(rng, 5, 0.0)
    assert InnerRansac().models(consensus_of(rows, threshold=1e6), T, rng).shape == (0, 3, 4)


def test_fits_are_those_of_the_shrinking_thresholds(rng):
    """Beside a slow and obvious one; many rows are between the thresholds."""
    rows, T = two_clouds(rng)
    model = naive.kabsch(rows[np.flatnonzero(naive.residuals(T, rows) < 5 * NOISE)[:8]], np.ones(8))
    expected = model
    for width in NOISE * np.array([2.0, np.sqrt(2.0), 1.0]):
        expected = naive.kabsch(rows, (naive.residuals(expected, rows) < width).astype(float))
    found = InnerRansac(widest=2.0, steps=3)._drawn_in(consensus_of(rows, threshold=NOISE), model)
    np.testing.assert_allclose(found, expected, atol=1e-9)


class Counted(Registration):
    """Counts the minimal samples."""

    def solve_minimal(self, samples):
        self.drawn.append(len(samples))
        return super().solve_minimal(samples)


def test_needs_fewer_samples_than_ransac_and_is_nearer(rng):
    """What Chum, Matas and Kittler 2003 found: a model of inliers alone gets all inliers only if it is improved.

    They save a half to two thirds with seven points to a sample; with three it is less.
    """
    drawn, errors = [[], []], np.zeros(2)
    for seed in range(20):
        rows, T = two_clouds(np.random.default_rng(seed), 400, 0.75)
        for i, optimiser in enumerate((None, InnerRansac())):
            problem = Counted()
            object.__setattr__(problem, "drawn", drawn[i])
            estimator, noise = Usac(20_000, 0.999, optimiser=optimiser), Noise.within(2.5 * NOISE)
            found = estimator.estimate(problem, Rows(rows), noise, np.random.default_rng(seed))
            errors[i] += naive.angle_between(found.model, T)
    assert errors[1] < 0.5 * errors[0]
    assert sum(drawn[1]) < 0.85 * sum(drawn[0])


@pytest.mark.parametrize("name", ["samples", "sample_size", "steps"])
@pytest.mark.parametrize("wrong", [0, 1.5, True, "3"])
def test_wrong_numbers_are_refused_by_name(name, wrong):
    with pytest.raises(ValueError, match=f"{name} must be a whole number of at least 1, got"):
        InnerRansac(**{name: wrong})


@pytest.mark.parametrize("wrong", [0.5, np.inf, np.nan, "2"])
def test_a_wrong_width_is_refused_by_name(wrong):
    with pytest.raises(ValueError, match="widest must be a number of at least 1, got"):
        InnerRansac(widest=wrong)
