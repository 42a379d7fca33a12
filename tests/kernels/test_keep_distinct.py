import numpy as np
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.nearest_field import keep_distinct


def kept(models, chord, distance):
    numbers = np.full(len(models), -1, np.int64)
    return numbers[: keep_distinct(models, chord**2, distance**2, numbers)].tolist()


def test_equals_the_definition(rng):
    models = np.stack([naive.random_model(rng) for _ in range(8)])[rng.integers(8, size=120)]
    models[:, :, :3] = [m @ Rotation.from_rotvec(0.1 * rng.standard_normal(3)).as_matrix() for m in models[:, :, :3]]
    models[:, :, 3] += 0.1 * rng.standard_normal((120, 3))
    expected = []
    for i, model in enumerate(models):
        differences = [model - models[k] for k in expected]
        if not any(np.linalg.norm(d[:, :3]) < 0.3 and np.linalg.norm(d[:, 3]) < 0.25 for d in differences):
            expected.append(i)
    assert 8 < len(expected) < 100
    assert kept(models, 0.3, 0.25) == expected


def test_the_first_of_equal_models_is_kept(rng):
    a, b = naive.random_model(rng), naive.random_model(rng)
    assert kept(np.stack([a, a, b, a, b]), 1e-3, 1e-3) == [0, 2]


def test_no_models_are_no_problem():
    assert kept(np.empty((0, 3, 4)), 1.0, 1.0) == []
