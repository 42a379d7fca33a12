"""What the tests of other people's estimators share: rows of planted motions, and rows that nobody can solve."""

import numpy as np

import naive
from nonsac import AbsolutePose, Noise, Registration, RelativePose, Rows, simulate
from nonsac.estimators.named import chosen_estimator

SEEDS = 20
NOISE = {"RelativePose": 1.0, "AbsolutePose": 1.0, "Registration": 0.01}
PROBLEMS = {
    "RelativePose": RelativePose(800.0, 1000.0),
    "AbsolutePose": AbsolutePose(900.0),
    "Registration": Registration(),
}
_SIMULATE = {
    "RelativePose": (simulate.relative_pose, "points1", "points2"),
    "AbsolutePose": (simulate.absolute_pose, "points2d", "points3d"),
    "Registration": (simulate.registration, "source", "target"),
}


def planted(kind, outliers, seed, n=1000):
    """Rows (n, D) of a motion, and that motion (4, 4)."""
    make, first, second = _SIMULATE[kind]
    noise = 0.01 if kind == "Registration" else 0.001
    data = make(n, outliers, noise, rng=seed)
    return np.hstack([getattr(data, first), getattr(data, second)]), data.T


def found(name, kind, rows, sigma=None, seed=0, problem=None):
    """What an estimator finds in rows."""
    problem = problem or PROBLEMS[kind]
    estimator, noise = chosen_estimator(name, problem), Noise.given(sigma or NOISE[kind])
    return estimator.estimate(problem, Rows(np.ascontiguousarray(rows)), noise, np.random.default_rng(seed))


def solved(model, kind, truth, degrees=5.0):
    """Whether a model is a motion, about; of two views also the direction of the baseline."""
    if not np.isfinite(model).all() or naive.angle_between(model, truth) > degrees:
        return False
    if kind == "RelativePose":
        baseline = model[:, 3] / np.linalg.norm(model[:, 3])
        return bool(truth[:3, 3] @ baseline > np.cos(np.radians(2 * degrees)))
    return True
