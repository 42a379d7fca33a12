"""Open3D's estimators as cores."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from nonsac import Registration
from others_samples import NOISE, SEEDS, found, planted, solved

open3d = pytest.importorskip("open3d", reason="needs the extra open3d, and its system libraries", exc_type=ImportError)
NAMES = ["open3d-ransac", "open3d-fgr"]


def directly(name, rows):
    """Open3D as its users call it, with our five standard deviations."""
    registration, bound = open3d.pipelines.registration, 5.0 * NOISE["Registration"]
    clouds = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(half)) for half in np.hsplit(rows, 2)]
    matches = open3d.utility.Vector2iVector(np.repeat(np.arange(len(rows), dtype=np.int32)[:, None], 2, axis=1))
    open3d.utility.random.seed(0)
    if name == "open3d-ransac":
        criteria = registration.RANSACConvergenceCriteria(100_000, 0.9999)
        checkers = [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9)]
        answer = registration.registration_ransac_based_on_correspondence(
            *clouds, matches, bound, ransac_n=3, checkers=checkers, criteria=criteria
        )
    else:
        option = registration.FastGlobalRegistrationOption(
            use_absolute_scale=True, decrease_mu=True, maximum_correspondence_distance=bound
        )
        answer = registration.registration_fgr_based_on_correspondence(*clouds, matches, option)
    return np.array(answer.transformation)[:3]


@pytest.mark.parametrize("name", NAMES)
def test_it_solves_as_much_as_the_library_itself(name):
    own = others = 0
    for seed in range(SEEDS):
        rows, truth = planted("Registration", 0.7, seed)
        own += solved(found(name, "Registration", rows, seed=seed).model, "Registration", truth)
        others += solved(directly(name, rows), "Registration", truth)
    assert own >= others
    assert own == SEEDS


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_unit_does_not_matter(name, unit):
    rows, truth = planted("Registration", 0.7, 0)
    model = found(name, "Registration", unit * rows, sigma=0.01 * unit).model
    assert solved(model, "Registration", truth)
    np.testing.assert_allclose(model[:, 3], unit * truth[:3, 3], atol=0.2 * unit)


@pytest.mark.parametrize(
    ("name", "problem"), [*((name, Registration(2.5)) for name in NAMES), (NAMES[0], Registration(None))]
)
def test_a_scale_is_known_or_estimated(name, problem):
    rows, truth = planted("Registration", 0.6, 0)
    rows[:, :3] /= 2.5
    model = found(name, "Registration", rows, problem=problem).model
    assert solved(model, "Registration", truth)
    assert np.cbrt(np.linalg.det(model[:, :3])) == pytest.approx(2.5, rel=0.05)


def test_threads_take_turns_with_the_generator():
    samples = [planted("Registration", 0.7, seed)[0] for seed in range(4)]
    alone = [found("open3d-fgr", "Registration", rows, seed=seed).model for seed, rows in enumerate(samples)]
    with ThreadPoolExecutor(4) as pool:
        there = pool.map(lambda i: found("open3d-fgr", "Registration", samples[i % 4], seed=i % 4).model, range(24))
    for number, model in enumerate(there):
        np.testing.assert_array_equal(model, alone[number % 4])
