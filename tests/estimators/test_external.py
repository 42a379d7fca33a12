"""Functions that know nothing of this package as core estimators."""

import math
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import naive
import nonsac
from nonsac import ArraySource, External, Noise, Registration, Remark, Rows, Status
from nonsac.estimators.named import chosen_estimator

SIGMA = 0.02
NOISE = Noise.given(SIGMA)
PROBLEM = naive.Shift()


def nothing(values, threshold, seed):
    return None


def shifted(rng, n=300, shift=0.3, outliers=0.3):
    """Rows of a shift, some of them wrong."""
    rows = rng.uniform(-1, 1, (n, 2))
    right = int((1 - outliers) * n)
    rows[:right, 1] = rows[:right, 0] + rng.normal(shift, SIGMA, right)
    return rng.permutation(rows)


def found_by(call, rows, problem=PROBLEM, seed=0):
    rows = rows if isinstance(rows, Rows) else Rows(rows)
    return External(call).estimate(problem, rows, NOISE, np.random.default_rng(seed))


# --- one sample -------------------------------------------------------------------------------------------------------


def test_a_function_finds_the_model_and_says_nothing_of_how(rng):
    rows = shifted(rng)
    hypothesis = found_by(naive.median_shift, rows)
    assert hypothesis.model[0, 3] == pytest.approx(0.3, abs=0.1)
    np.testing.assert_array_equal(hypothesis.residuals, PROBLEM.residuals(hypothesis.model[None], rows)[0])
    assert hypothesis.threshold == NOISE.threshold
    assert hypothesis.tested is None
    assert hypothesis.promising is None
    assert hypothesis.fault == ""


def test_it_is_given_rows_without_weights_the_threshold_and_a_seed(rng):
    values, given = shifted(rng), []

    def asked(*arguments):
        given.append(arguments)
        return naive.shift_model(0.3)

    for seed in (0, 0, 1):
        found_by(asked, Rows(values, rng.uniform(0.5, 2, 300)), seed=seed)
    for some, threshold, seed in given:
        np.testing.assert_array_equal(some, values)
        assert some.dtype == np.float64
        assert threshold == NOISE.threshold
        assert type(seed) is int
        assert 0 <= seed < 2**31
    assert given[0][2] == given[1][2] != given[2][2]


def test_what_it_does_to_its_rows_harms_nobody(rng):
    rows = shifted(rng)
    before = rows.copy()

    def careless(values, threshold, seed):
        values[:, 1] -= values[:, 0]
        return naive.shift_model(np.median(values[:, 1]))

    hypothesis = found_by(careless, rows)
    np.testing.assert_array_equal(rows, before)
    np.testing.assert_array_equal(hypothesis.model, found_by(naive.median_shift, rows).model)


def test_of_several_models_the_one_that_fits_best_is_taken(rng):
    rows = shifted(rng)
    for order in ([0, 1, 2], [2, 1, 0]):
        models = np.stack([naive.shift_model(s) for s in (0.33, 0.3, -2.0)])[order]
        assert found_by(lambda *_, models=models: models, rows).model[0, 3] == 0.3
        assert found_by(lambda *_, models=models: list(models), rows).model[0, 3] == 0.3


def test_of_several_models_the_one_that_fits_the_heavier_rows_is_taken(rng):
    x = rng.uniform(-1, 1, 300)
    values = np.column_stack([x, x + np.repeat([0.3, -0.4], [200, 100])])
    models = np.stack([naive.shift_model(0.3), naive.shift_model(-0.4)])
    for weights, shift in ((None, 0.3), (np.repeat([1.0, 9.0], [200, 100]), -0.4)):
        assert found_by(lambda *_: models, Rows(values, weights)).model[0, 3] == shift


@pytest.mark.parametrize(
    "answer",
    [None, np.full((3, 4), np.nan), np.empty((0, 3, 4)), np.full((2, 3, 4), np.inf)],
    ids=["None", "NaN", "no models", "infinite models"],
)
def test_without_a_finite_model_there_is_none_and_no_error(rng, answer):
    hypothesis = found_by(lambda *_: answer, shifted(rng))
    assert not hypothesis.found
    assert hypothesis.model.shape == (3, 4)
    np.testing.assert_array_equal(hypothesis.residuals, np.full(300, np.inf))
    assert hypothesis.num_inliers == 0
    assert hypothesis.tested is None


def test_models_that_are_not_finite_are_passed_over(rng):
    models = np.stack([np.full((3, 4), np.nan), naive.shift_model(0.3), np.full((3, 4), np.inf)])
    assert found_by(lambda *_: models, shifted(rng)).model[0, 3] == 0.3


@pytest.mark.parametrize("shape", [(4, 4), (12,), (4, 3), (2, 4, 4), (1, 1, 3, 4), ()])
def test_a_model_of_the_wrong_shape_is_refused_with_the_right_one(rng, shape):
    with pytest.raises(ValueError, match=r"must have the shape \(3, 4\), or \(K, \*shape\)") as caught:
        found_by(lambda *_: np.zeros(shape), shifted(rng))
    assert str(caught.value).endswith(f"got {shape}")


def test_lists_and_whole_numbers_are_models_too(rng):
    assert found_by(lambda *_: [[0.0, 1, 0]], rng.uniform(-1, 1, (50, 2)), naive.Line()).model.shape == (3,)
    hypothesis = found_by(lambda *_: [0, 1, 0], rng.uniform(-1, 1, (50, 2)), naive.Line())
    assert hypothesis.model.dtype == np.float64
    assert hypothesis.model.tolist() == [0, 1, 0]


def test_several_models_may_be_as_many_as_a_model_has_rows(rng):
    """(3, 3, 4) is three models of (3, 4); (3, 3) are three lines, or one homography, as the problem says."""
    models = np.stack([naive.shift_model(s) for s in (-1.0, 0.3, 2.0)])
    assert found_by(lambda *_: models, shifted(rng)).model[0, 3] == 0.3
    lines = np.stack([naive.line_model(degrees, 5.0) for degrees in (10, 20, 30)])
    assert found_by(lambda *_: lines, rng.uniform(-1, 1, (50, 2)), naive.Line()).model.shape == (3,)


def test_an_exception_is_passed_on(rng):
    """The pipeline takes note of it; whoever calls the estimator itself wants to see it."""

    def failing(values, threshold, seed):
        raise FloatingPointError("no convergence")

    with pytest.raises(FloatingPointError, match="no convergence"):
        found_by(failing, shifted(rng))


# --- settings ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("call", [None, "magsac", 3, np.eye(3)])
def test_what_is_no_function_is_refused(call):
    with pytest.raises(TypeError, match=r"call must be a function of \(values, threshold, seed\), got"):
        External(call)


def test_it_has_one_budget_and_no_joint_search(rng):
    estimator, rows = External(naive.median_shift), Rows(shifted(rng))
    assert estimator.with_budget(10) == estimator
    found = estimator.estimate(PROBLEM, rows, NOISE, rng)
    assert estimator.search_jointly(PROBLEM, [found], rows, NOISE, rng) is None


def test_a_module_that_is_there_is_no_reason_to_complain():
    for needs in (None, "math", "numpy", "nonsac.io"):
        assert External(naive.median_shift, needs).check(PROBLEM) is None


def test_a_missing_module_is_reported_before_anything_is_read():
    class Unreadable(ArraySource):
        def take(self, indices):
            raise AssertionError("was read")

    estimator = External(naive.median_shift, needs="no_such_module")
    with pytest.raises(ValueError, match="needs the module no_such_module, which is not installed"):
        estimator.check(PROBLEM)
    with pytest.raises(ValueError, match="needs the module no_such_module, which is not installed"):
        nonsac.estimate(Unreadable(np.zeros((9, 2))), PROBLEM, estimator, noise=SIGMA)


def test_a_module_is_looked_for_but_not_imported(tmp_path, monkeypatch):
    (tmp_path / "loud_module.py").write_text("raise AssertionError('was imported')")
    monkeypatch.syspath_prepend(tmp_path)
    External(naive.median_shift, needs="loud_module").check(PROBLEM)
    assert "loud_module" not in sys.modules


def test_a_function_of_a_module_travels_to_another_process(rng):
    rows, estimator = shifted(rng), External(naive.median_shift, needs="math")
    copy = pickle.loads(pickle.dumps(estimator))
    assert copy == estimator
    found = [each.estimate(PROBLEM, Rows(rows), NOISE, np.random.default_rng(0)) for each in (copy, estimator)]
    np.testing.assert_array_equal(found[0].model, found[1].model)


# --- in the pipeline --------------------------------------------------------------------------------------------------


def solved(call, rows, **settings):
    settings = {"noise": SIGMA, "rng": 0, "workers": 1} | settings  # with threads, samples come in any order
    return nonsac.estimate(ArraySource(rows), PROBLEM, call, **settings)


def test_a_function_is_an_estimator_for_the_pipeline(rng):
    result = solved(naive.median_shift, shifted(rng, 20_000))
    assert result.status is Status.OK
    assert result.model[0, 3] == pytest.approx(0.3, abs=0.01)
    assert result.remarks == ()
    assert result.info["estimator"] == "External"
    assert all(h.tested is None for h in result.hypotheses)


def test_the_last_fit_is_the_pipelines(rng):
    """A function that is off by three standard deviations is good enough a start."""
    result = solved(lambda *_: naive.shift_model(0.3 + 3 * SIGMA), shifted(rng, 20_000))
    assert result.success
    assert result.model[0, 3] == pytest.approx(0.3, abs=0.1 * SIGMA)


def test_a_registration_by_kabsch_and_a_trimmed_refit(rng):
    """Anything that is no better than least squares on trimmed rows will do if few rows are wrong."""

    def trimmed(values, threshold, seed):
        kept = values
        for _ in range(10):
            model = naive.kabsch(kept, np.ones(len(kept)))
            distances = naive.residuals(model, values)
            kept = values[distances <= np.quantile(distances, 0.7)]
        return model

    data = nonsac.simulate.registration(3000, 0.2, SIGMA, rng)
    rows = np.hstack([data.source, data.target])
    result = nonsac.estimate(ArraySource(rows), Registration(), trimmed, noise=SIGMA, sample_size=300, samples=5, rng=0)
    assert result.success
    assert naive.angle_between(result.T, data.T) < 0.5


def test_a_problem_whose_models_are_no_motions_is_solved_too(rng):
    line, points = naive.line_model(40.0, 0.2), rng.uniform(-1, 1, (5000, 2))
    points[:2500] += (0.2 + SIGMA * rng.standard_normal((2500, 1)) - points[:2500] @ line[:2, None]) * line[:2]

    def best_of_many(values, threshold, seed):
        pairs = np.random.default_rng(seed).choice(len(values), (100, 2))
        return naive.Line().solve_minimal(values[pairs])

    result = nonsac.estimate(ArraySource(points), naive.Line(), best_of_many, noise=SIGMA, rng=0)
    assert result.success
    assert naive.Line().distance(result.model, line) < 0.3
    with pytest.raises(AttributeError, match="a model of Line is no motion"):
        result.T  # noqa: B018


class Sometimes:
    """The median shift, but an exception in every other sample."""

    def __init__(self):
        self.calls = 0

    def __call__(self, values, threshold, seed):
        self.calls += 1
        if self.calls % 2:
            raise np.linalg.LinAlgError("singular matrix")
        return naive.median_shift(values, threshold, seed)


def test_an_exception_costs_its_sample_and_the_result_says_so(rng):
    call = Sometimes()
    result = solved(call, shifted(rng, 20_000), samples=6)
    assert result.status is Status.OK
    assert call.calls == 6
    faults = [h.fault for h in result.hypotheses]
    assert faults == ["LinAlgError: singular matrix", ""] * 3
    assert [h.found for h in result.hypotheses] == [False, True] * 3
    assert result.remarks == (f"{Remark.ESTIMATOR_FAILED}: 3 of 6 (LinAlgError: singular matrix)",)


def test_a_wrong_shape_costs_its_sample_too(rng):
    calls = []

    def once_wrong(values, threshold, seed):
        calls.append(seed)
        return np.eye(4) if len(calls) == 1 else naive.median_shift(values, threshold, seed)

    result = solved(once_wrong, shifted(rng, 20_000), samples=3)
    assert result.success
    assert [bool(h.fault) for h in result.hypotheses] == [True, False, False]
    assert "must have the shape (3, 4)" in result.hypotheses[0].fault
    assert result.remarks[0].startswith("the estimator failed in some samples: 1 of 3 (ValueError: ")


def test_a_function_that_always_fails_ends_without_an_answer_and_says_why(rng):
    calls = []

    def failing(values, threshold, seed):
        calls.append(seed)
        raise RuntimeError("no licence")

    result = solved(failing, shifted(rng, 20_000))
    assert not result.found
    assert result.status is Status.LOW_SUPPORT
    assert result.remarks == ("the estimator failed in some samples: 8 of 8 (RuntimeError: no licence)",)
    assert "no licence" in repr(result)
    assert len(calls) == 8  # no more than it takes to see that it always fails


def test_a_function_that_finds_nothing_is_told(rng):
    result = solved(nothing, shifted(rng, 20_000), samples=4)
    assert not result.found
    assert result.status is Status.LOW_SUPPORT
    assert result.remarks == ("the estimator failed in some samples: 4 of 4 (the function gave None)",)
    assert [h.fault for h in result.hypotheses] == ["the function gave None"] * 4


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ((np.zeros((3, 4)), np.ones(9)), "TypeError: the function gave a tuple of 2 (a model and a mask?): return the"),
        (np.full((3, 4), 1j), "TypeError: the function gave complex numbers: return a model of real ones"),
        (np.full((3, 4), np.nan), "the function gave no finite model"),
    ],
)
def test_answers_that_are_no_models_are_told(answer, told, rng):
    result = solved(lambda values, threshold, seed: answer, shifted(rng, 20_000), samples=2)
    assert not result.found
    assert told in result.remarks[0]


def test_needs_is_a_name():
    with pytest.raises(TypeError, match=r'needs must be the name of a module, such as "cv2", got <module'):
        nonsac.External(nothing, needs=np)


def test_without_matches_no_function_is_trusted(rng):
    """Nobody knows how many models it compared: as many as RANSAC would have."""
    rows = rng.uniform(-1, 1, (20_000, 2))

    def best_of_many(values, threshold, seed):
        return np.stack([naive.shift_model(s) for s in np.linspace(-1, 1, 500)])

    for call in (best_of_many, naive.median_shift):
        assert not solved(call, rows).success


def test_threads_and_processes_find_the_same(rng):
    rows, settings = shifted(rng, 20_000), {"samples": 4}
    alone = solved(naive.median_shift, rows, workers=1, **settings)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for workers in (2, pool):
            other = solved(naive.median_shift, rows, workers=workers, **settings)
            np.testing.assert_array_equal(other.model, alone.model)
            assert [h.fault for h in other.hypotheses] == [""] * 4


def test_a_callable_object_is_a_function():
    assert chosen_estimator(math.hypot, PROBLEM) == External(math.hypot)
    call = Sometimes()
    assert chosen_estimator(call, PROBLEM) == External(call)
