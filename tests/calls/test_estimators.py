"""The estimators that the calls take: by name, as a function, or as an object."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import nonsac
from batch_samples import by_ransac
from nonsac import External, Noise, Pcr99, Ransac, Registration, RelativePose, Rows, simulate
from nonsac.estimators.ransac import default as ransac

PAIRS = simulate.registration(4000, 0.6, 0.01, rng=1)
VIEWS = simulate.relative_pose(4000, 0.3, 0.001, rng=1)
CAMERA = nonsac.Camera("PINHOLE", (800, 800, 640, 480), 1280, 960)


def registered(**settings):
    return nonsac.register_pairs(PAIRS.source, PAIRS.target, **({"noise": 0.01} | settings))


def posed(**settings):
    pixels = CAMERA.project(VIEWS.points1), CAMERA.project(VIEWS.points2)
    return nonsac.relative_pose(*pixels, CAMERA, **({"noise": 0.8} | settings))


def same(a, b):
    assert a.T.tobytes() == b.T.tobytes()
    assert [h.score for h in a.hypotheses] == [h.score for h in b.hypotheses]


def test_an_estimator_may_be_named():
    same(registered(estimator="pcr99"), registered())
    same(registered(estimator="pcr99", scale=None), registered(estimator=Pcr99(), scale=None))
    same(registered(estimator="ransac"), registered(estimator=ransac(Registration())))
    same(posed(estimator="ransac"), posed())
    assert posed().info["estimator"] == registered(estimator="ransac").info["estimator"] == "Ransac"


def test_the_pipeline_has_the_estimators_of_the_calls():
    rows = nonsac.ArraySource(np.hstack([PAIRS.source, PAIRS.target]))
    same(nonsac.estimate(rows, Registration(), noise=0.01, refine="polish"), registered())
    same(nonsac.estimate(rows, Registration(), "ransac", noise=0.01), registered(estimator="ransac", refine="union"))


@pytest.mark.parametrize("weights", [None, np.linspace(0.1, 1.0, 4000)])
def test_a_function_gets_normalised_rows_and_the_threshold_of_the_residual(weights):
    told = []

    def found(values, threshold, seed):
        told.append((values.shape, float(np.abs(values).max()), threshold))
        problem, own = RelativePose(800.0, 800.0), Ransac(500, local_optimisation=True)
        return own.estimate(problem, Rows(values), Noise.within(threshold), np.random.default_rng(seed)).model

    result = posed(estimator=found, samples=3, sample_size=800, workers=1, weights=weights)
    assert result.success
    assert result.info["estimator"] == "External"
    assert nonsac.evaluation.rotation_error(result.R, VIEWS.T[:3, :3]) < 0.3
    shapes, largest, thresholds = zip(*told, strict=True)
    assert shapes == ((800, 4),) * 3
    assert max(largest) < 5.0
    assert thresholds == (5 * 0.8,) * 3  # pixels


def test_a_function_of_a_module_travels():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = registered(estimator=by_ransac, workers=pool, samples=3, sample_size=500)
    assert there.success
    same(there, registered(estimator=by_ransac, workers=1, samples=3, sample_size=500))


def test_a_function_that_fails_costs_its_samples_and_is_told_of():
    calls = []

    def found(values, threshold, seed):
        calls.append(seed)
        return 1 / 0 if len(calls) == 2 else by_ransac(values, threshold, seed)

    result = registered(estimator=found, samples=4, sample_size=900, workers=1)
    assert result.success
    assert [h.found for h in result.hypotheses] == [True, False, True, True]
    [remark] = result.remarks
    assert remark == "the estimator failed in some samples: 1 of 4 (ZeroDivisionError: division by zero)"
    assert f"remark: {remark}" in repr(result)


@pytest.mark.parametrize(
    ("estimator", "error", "message"),
    [
        ("no-such", ValueError, "estimator must be one of ransac, .*, or an object, got 'no-such'"),
        (Ransac, TypeError, "derived from nonsac.Estimator, got the class Ransac"),
        ("pcr99", TypeError, "pcr99 is for 3D registrations, got RelativePose"),
        (External(by_ransac, needs="no_such_module"), ValueError, "needs the module no_such_module, which is not inst"),
    ],
)
def test_other_estimators_are_refused(estimator, error, message):
    with pytest.raises(error, match=message):
        posed(estimator=estimator)


def test_settings_are_refused_before_the_data_are_looked_at():
    with pytest.raises(ValueError, match="rule must be one of"):
        nonsac.register_pairs("no array", None, rule="best")
    with pytest.raises(TypeError, match=r"absolute_pose\(\) got an unexpected .* 'nosie'; did you mean noise\?"):
        nonsac.absolute_pose("no array", None, nosie=1)
