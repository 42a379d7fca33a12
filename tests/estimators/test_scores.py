import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma
from scipy.stats import chi2

import naive
from nonsac import Rows
from nonsac.estimators.scores import Inliers, Marginalised, Truncated

SCORES = [Inliers(), Truncated(), Marginalised(), Marginalised(2)]
scores = pytest.mark.parametrize("score", SCORES, ids=str)


def marginal_weight(ratio, dimension):
    """The likelihood of a residual, averaged over all noise levels that are large enough for it to be an inlier."""
    k = np.sqrt(chi2.ppf(0.99, dimension))
    largest = 1.0 / k
    constant = 2.0 / (2 ** (dimension / 2) * gamma(dimension / 2))

    def density(sigma):
        return constant * sigma**-dimension * np.exp(-0.5 * (ratio / sigma) ** 2) * ratio ** (dimension - 1) / largest

    return quad(density, ratio / k, largest)[0]


def marginal_loss(ratio, dimension):
    return quad(lambda r: r * marginal_weight(r, dimension), 0.0, min(ratio, 1.0))[0]


@pytest.mark.parametrize("dimension", [2, 3, 4, 6])
def test_magsac_is_the_loss_averaged_over_noise_levels(dimension):
    score, ratios = Marginalised(dimension), np.array([0.05, 0.3, 0.5, 0.77, 0.95])
    whole = marginal_loss(1.0, dimension)
    expected = [1.0 - marginal_loss(ratio, dimension) / whole for ratio in ratios]
    np.testing.assert_allclose(score.gains(ratios), expected, atol=1e-5)
    weights = np.array([marginal_weight(ratio, dimension) for ratio in ratios])
    np.testing.assert_allclose(score.weights(ratios) / score.weights(ratios[:1]), weights / weights[0], atol=1e-4)


@pytest.mark.parametrize("dimension", [2, 4])
def test_the_weights_of_magsac_are_the_slope_of_its_loss(dimension):
    """w = (d loss / d r) / r but for a factor: what makes the reweighted fit go down."""
    score, ratios = Marginalised(dimension), np.linspace(0.1, 0.95, 18)
    step = 0.01
    slopes = (score.gains(ratios - step) - score.gains(ratios + step)) / ratios
    np.testing.assert_allclose(slopes / slopes[0], score.weights(ratios) / score.weights(ratios[0]), rtol=0.01)


@scores
def test_gains_fall_from_one_to_nothing(score):
    ratios = np.linspace(0.0, 1.0, 200)
    gains = score.gains(ratios)
    assert gains[0] == 1.0
    assert gains[-1] == 0.0
    assert (np.diff(gains) <= 1e-12).all()
    assert (score.gains(np.array([1.0, 1.5, 1e9])) == 0.0).all()


def test_msac_is_the_published_loss():
    residuals, threshold = np.array([0.0, 0.5, 1.9, 2.0, 7.0]), 2.0
    published = np.where(residuals**2 < threshold**2, residuals**2, threshold**2)
    np.testing.assert_allclose(1.0 - Truncated().gains(residuals / threshold), published / threshold**2)


@scores
@pytest.mark.parametrize("weighted", [False, True])
def test_scores_are_sums_over_rows_and_the_best_is_the_highest(rng, score, weighted):
    problem = naive.Line()
    values = rng.uniform(-1, 1, (300, 2))
    values[0] = np.nan if score == Truncated() else 0.0  # a residual that is no number gains nothing
    rows = Rows(values, rng.uniform(0.0, 2.0, 300) if weighted else None)
    models = np.array([naive.line_model(*pair) for pair in rng.uniform([0, -1], [180, 1], (200, 2))])
    found = score.of(problem, models, rows, 0.2)
    weights = rows.weights / rows.weights.mean() if weighted else np.ones(300)
    for model, value in zip(models[:20], found[:20], strict=True):
        ratios = np.nan_to_num(problem.residuals(model[None], values)[0] / 0.2, nan=9.0)
        expected = sum(w * score.gains(np.array([r]))[0] for w, r in zip(weights, ratios, strict=True))
        assert value == pytest.approx(expected)
    best, highest = score.best(problem, models, rows, 0.2)
    assert best == np.argmax(found)
    assert highest == pytest.approx(found.max())
    assert score.best(problem, models, rows, 0.2, floor=highest) is None
    assert score.best(problem, models, rows, 0.2, floor=0.999 * highest)[0] == best


@scores
def test_a_model_of_nan_never_wins(rng, score):
    rows, models = Rows(rng.uniform(-1, 1, (50, 2))), np.full((3, 3), np.nan)
    assert score.best(naive.Line(), models, rows, 0.5) is None
    assert (score.of(naive.Line(), models, rows, 0.5) == 0.0).all()


@pytest.mark.parametrize("dimension", [0, 1, 2.5, True, "4"])
def test_a_wrong_dimension_is_refused_by_name(dimension):
    with pytest.raises(ValueError, match="dimension must be a whole number of at least 2, got"):
        Marginalised(dimension)
