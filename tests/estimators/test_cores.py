"""The cores by name in the pipeline: what they find is trusted, and not where there is nothing to find."""

import numpy as np
import pytest

import naive
import nonsac
from nonsac import simulate

NAMES = ("msac", "lo-ransac", "prosac", "magsac", "gc-ransac", "gnc-tls", "gnc-gm", "irls", "hough")
names = pytest.mark.parametrize("name", NAMES)


def weights_for(name, right, rng):
    """Only one needs them; right rows have higher ones in the mean."""
    return np.where(right, rng.beta(4, 2, len(right)), rng.beta(2, 4, len(right))) if name == "prosac" else None


@names
@pytest.mark.parametrize("noise", [0.01, None])
def test_a_registration_is_found_and_trusted(rng, name, noise):
    pairs = simulate.registration(2000, 0.6, 0.01, rng)
    weights = weights_for(name, pairs.inliers, rng)
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=noise, estimator=name, weights=weights)
    assert result.success
    assert naive.angle_between(result.T, pairs.T) < 0.5


@names
def test_wrong_pairs_are_not_trusted(rng, name):
    """The verdict goes by how many models were compared."""
    for _ in range(3):
        source, target = rng.uniform(-1, 1, (2, 600, 3))
        weights = weights_for(name, np.zeros(600, bool), rng)
        result = nonsac.register_pairs(source, target, noise=0.02, estimator=name, samples=2, weights=weights)
        assert not result.success
