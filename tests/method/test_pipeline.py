import math
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.metadata import version
from multiprocessing import get_context

import numpy as np
import pytest

import naive
import nonsac
from nonsac import Hypothesis, Pcr99, Registration, Status, estimate, simulate
from nonsac.method.refine import AsSelected, Refinement
from nonsac.method.sampling import sample_rows, sample_start
from nonsac.method.scoring import MostInliers, TruncatedLp
from nonsac.sources import ArraySource

SEED, NOISE = 7, 0.2


class TableSource(ArraySource):
    """Remembers which rows were asked for."""

    def __init__(self, rows):
        super().__init__(rows)
        self.taken = []

    def take(self, indices):
        self.taken.append(np.array(indices))
        return super().take(indices)


@dataclass
class MockEstimator:
    """The median shift of the sample's rows, or what `answers` says for the sample; remembers what it was given."""

    answers: dict = field(default_factory=dict)
    calls: list = field(default_factory=list)
    budget: int = 1
    lock: threading.Lock = field(default_factory=threading.Lock)

    def with_budget(self, factor):
        return MockEstimator(self.answers, self.calls, self.budget * factor, self.lock)

    def estimate(self, problem, rows, threshold, rng):
        with self.lock:
            number = len(self.calls)
            self.calls.append({"rows": rows, "threshold": threshold, "draw": rng.random(), "budget": self.budget})
        shift = self.answers.get(number, np.median(rows[:, 1] - rows[:, 0]))
        model = naive.shift_model(shift)
        residuals = problem.residuals(model[None], rows)[0] if np.isfinite(shift) else np.full(len(rows), np.inf)
        return Hypothesis(model if np.isfinite(shift) else np.full((3, 4), np.nan), residuals, threshold, tested=3)


class SpyRefiner:
    """Returns the winner as it is and remembers what it was given."""

    def refine(self, problem, hypotheses, winner, union, threshold):
        self.problem, self.hypotheses, self.winner = problem, hypotheses, winner
        self.rows, self.threshold = union(), threshold
        return Refinement(hypotheses[winner].model, Status.OK, 0.75, 12, 34)


def shifted_rows(n=1000, shift=3.0, outliers=0.3):
    """Row i starts with i, so that rows tell their own number."""
    rng = np.random.default_rng(0)
    x = np.arange(float(n))
    y = x + shift + NOISE * rng.standard_normal(n)
    y[rng.permutation(n)[: int(outliers * n)]] += rng.uniform(5, 500, int(outliers * n))
    return np.column_stack([x, y])


def run(rows=None, estimator=None, **settings):
    source = (
        rows
        if hasattr(rows, "take") and hasattr(rows, "chunks")
        else ArraySource(shifted_rows() if rows is None else rows)
    )
    settings = {"noise": NOISE, "samples": 5, "sample_size": 40, "workers": 1, "rng": SEED} | settings
    return estimate(source, naive.Shift(), estimator or MockEstimator(), **settings)


def sample_of(n, i, size):
    return sample_rows(n, sample_start(n, 0, i, size), size, SEED)


def numbers(rows):
    return rows[:, 0].astype(int)


# --- sampling -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "samples", "size"), [(1000, 5, 40), (100, 5, 40), (200, 5, 40)])
def test_the_estimator_gets_the_rows_of_each_sample(n, samples, size):
    estimator = MockEstimator()
    run(shifted_rows(n), estimator, samples=samples, sample_size=size)
    assert len(estimator.calls) == samples
    for i, call in enumerate(estimator.calls):
        np.testing.assert_array_equal(numbers(call["rows"]), sample_of(n, i, size))


@pytest.mark.parametrize("n", [30, 40])
def test_samples_that_would_all_be_the_same_rows_are_one_with_the_budget_of_all(n):
    estimator = MockEstimator()
    result = run(shifted_rows(n), estimator, samples=3, sample_size=40)
    assert [call["budget"] for call in estimator.calls] == [3]
    np.testing.assert_array_equal(numbers(estimator.calls[0]["rows"]), np.arange(n))
    assert result.info["samples"] == 1


@pytest.mark.parametrize("name", ["estimator", "problem", "source"])
def test_a_class_is_no_object(name):
    arguments = {"source": ArraySource(shifted_rows()), "problem": naive.Shift(), "estimator": MockEstimator()}
    arguments[name] = type(arguments[name])
    with pytest.raises(TypeError, match=name):
        estimate(**arguments, noise=NOISE)


def test_the_threshold_is_five_times_the_noise():
    estimator = MockEstimator()
    result = run(estimator=estimator)
    assert all(call["threshold"] == 5 * NOISE for call in estimator.calls)
    assert (result.threshold, result.noise) == (5 * NOISE, NOISE)


def test_each_sample_has_random_numbers_of_its_own_that_repeat():
    first, second, other = MockEstimator(), MockEstimator(), MockEstimator()
    run(estimator=first)
    run(estimator=second)
    run(estimator=other, rng=SEED + 1)
    draws = [call["draw"] for call in first.calls]
    assert len(set(draws)) == 5
    assert draws == [call["draw"] for call in second.calls]
    assert not set(draws) & {call["draw"] for call in other.calls}


def test_only_sampled_rows_are_read():
    source = TableSource(shifted_rows(100_000))
    run(source)
    assert len(np.unique(np.concatenate(source.taken))) == 5 * 40


def test_a_source_of_a_trillion_rows_is_no_problem():
    class Virtual:
        width = 2

        def __len__(self):
            return 10**12

        def take(self, indices):
            return np.column_stack([indices, indices + 3.0])

        def chunks(self, rows):
            raise AssertionError("the whole source must not be read")

    result = run(Virtual())
    assert result.success
    assert result.t[0] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("n", [1000, 200, 100])
def test_the_refiner_gets_the_union_of_the_samples_each_row_once(n):
    spy = SpyRefiner()
    run(shifted_rows(n), refine=spy)
    drawn = np.unique(np.concatenate([sample_of(n, i, 40) for i in range(5)]))
    np.testing.assert_array_equal(numbers(spy.rows), drawn if n >= 200 else np.arange(n))
    assert spy.threshold == 5 * NOISE


# --- selection, refinement and what comes back ------------------------------------------------------------------------


def test_the_rule_selects_and_the_refiner_has_the_last_word():
    spy = SpyRefiner()
    result = run(estimator=MockEstimator({3: 2.95, 0: 90.0, 1: 91.0, 2: 92.0, 4: 93.0}), refine=spy)
    assert spy.winner == 3
    assert result.t[0] == 2.95
    assert (result.status, result.confidence, result.num_inliers, result.num_rows) == (Status.OK, 0.75, 12, 34)
    np.testing.assert_array_equal(result.T, np.vstack([naive.shift_model(2.95), [0, 0, 0, 1]]))


def test_hypotheses_come_back_in_order_with_their_scores():
    result = run(rule="most_inliers")
    assert [h.sample for h in result.hypotheses] == [0, 1, 2, 3, 4]
    assert [h.score for h in result.hypotheses] == [h.num_inliers for h in result.hypotheses]


def test_a_rule_may_be_named_or_given():
    by_name, given = run(rule="most_inliers"), run(rule=MostInliers())
    np.testing.assert_array_equal(by_name.T, given.T)
    assert by_name.info["rule"] == given.info["rule"] == "most_inliers"


def test_a_rule_of_ones_own():
    class Third:
        name = "third"

        def scores(self, hypotheses, problem):
            return [0.0, 0.0, 1.0, 0.0, 0.0]

    result = run(rule=Third(), refine="none", estimator=MockEstimator({2: 77.0}))
    assert result.t[0] == 77.0
    assert result.info["rule"] == "third"


def test_refine_none_returns_the_selected_model_and_union_improves_it():
    rows = shifted_rows(outliers=0.0)
    selected, refined = run(rows, refine="none"), run(rows, refine="union")
    assert any(np.array_equal(selected.T[:3], h.model) for h in selected.hypotheses)
    assert abs(refined.t[0] - 3.0) < 4 * NOISE / math.sqrt(200)
    np.testing.assert_array_equal(run(rows, refine=AsSelected()).T, selected.T)


def test_inliers_belong_to_the_model_returned():
    result = run()
    drawn = np.concatenate([sample_of(1000, i, 40) for i in range(5)])
    residuals = naive.Shift().residuals(result.T[None, :3], shifted_rows()[drawn])[0]
    assert result.num_rows == 200
    assert result.num_inliers == (residuals < result.threshold).sum()


def test_fixed_draws_one_sample_with_the_budget_of_all():
    estimator = MockEstimator()
    result = run(estimator=estimator, rule="fixed", samples=30)
    assert [call["budget"] for call in estimator.calls] == [30]
    assert len(estimator.calls[0]["rows"]) == 40
    assert (len(result.hypotheses), result.info["samples"]) == (1, 1)


def test_info_says_how_the_answer_came_about():
    info = run().info
    assert info["seed"] == SEED
    assert info["version"] == version("nonsac") == nonsac.__version__
    assert (info["samples"], info["sample_size"]) == (5, 40)
    assert info["rule"] == "tlp_0.1"
    assert info["dropped_rows"] == 0
    assert list(info["seconds"]) == ["hypotheses", "selection", "refinement"]
    assert all(seconds >= 0 for seconds in info["seconds"].values())


def test_progress_is_told_after_each_sample():
    told = []
    run(progress=lambda done, samples: told.append((done, samples)))
    assert told == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


def test_a_seed_from_entropy_is_recorded_and_replays():
    first = run(rng=None)
    np.testing.assert_array_equal(run(rng=first.info["seed"]).T, first.T)
    assert first.info["seed"] != run(rng=None).info["seed"]


def test_a_generator_gives_the_seed():
    seed = run(rng=np.random.default_rng(3)).info["seed"]
    assert seed == run(rng=np.random.default_rng(3)).info["seed"] != run(rng=np.random.default_rng(4)).info["seed"]


# --- stopping ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [1, 3])
def test_stop_sees_every_prefix_and_ends_the_sampling(workers):
    seen = []

    def stop(hypotheses, problem):
        assert isinstance(problem, naive.Shift)
        seen.append([h.sample for h in hypotheses])
        return len(hypotheses) == 3

    spy = SpyRefiner()
    result = run(samples=20, stop=stop, workers=workers, refine=spy)
    assert seen == [[0], [0, 1], [0, 1, 2]]
    assert [h.sample for h in result.hypotheses] == [0, 1, 2]
    assert result.info["samples"] == 3
    expected = np.sort(np.concatenate([sample_of(1000, i, 40) for i in range(3)]))
    np.testing.assert_array_equal(numbers(spy.rows), expected)


def test_stopping_early_gives_the_same_first_samples():
    whole, part = run(), run(stop=lambda hypotheses, problem: len(hypotheses) == 2)
    for h, g in zip(part.hypotheses, whole.hypotheses, strict=False):
        np.testing.assert_array_equal(h.model, g.model)


def test_stopping_leaves_no_samples_running():
    estimator = MockEstimator()
    run(estimator=estimator, samples=25, stop=lambda hypotheses, problem: True)
    assert len(estimator.calls) == 1


def test_a_stop_that_never_stops_changes_nothing():
    np.testing.assert_array_equal(run(stop=lambda hypotheses, problem: False).T, run().T)


# --- as many samples as it takes --------------------------------------------------------------------------------------


class Judge(SpyRefiner):
    """Gives one verdict after the other, and remembers after how many samples it was asked."""

    def __init__(self, *verdicts, support=0.5):
        self.verdicts, self.support, self.asked = list(verdicts), support, []

    def refine(self, problem, hypotheses, winner, union, threshold):
        self.asked.append(len(hypotheses))
        self.sizes = [len(h.residuals) for h in hypotheses]
        status, confidence = self.verdicts[min(len(self.asked), len(self.verdicts)) - 1]
        rows = len(union())
        return Refinement(hypotheses[winner].model, status, confidence, int(self.support * rows), rows)


CLEAR, UNCLEAR, NOTHING = (Status.OK, 0.995), (Status.OK, 0.98), (Status.LOW_SUPPORT, 0.0)


def test_the_first_two_samples_may_be_enough():
    judge = Judge(CLEAR)
    result = run(samples="auto", refine=judge)
    assert (judge.asked, result.info["samples"]) == ([2], 2)
    assert result.success


@pytest.mark.parametrize("first", [UNCLEAR, NOTHING])
def test_rounds_double_until_the_answer_is_clear(first):
    judge = Judge(first, first, NOTHING, CLEAR)
    assert run(samples="auto", refine=judge).info["samples"] == 16
    assert judge.asked == [2, 4, 8, 16]


def test_max_samples_end_the_search():
    judge = Judge(NOTHING)
    result = run(samples="auto", max_samples=11, refine=judge)
    assert judge.asked == [2, 4, 8, 11]
    assert result.status is Status.LOW_SUPPORT


@pytest.mark.parametrize("status", [Status.DEGENERATE, Status.AMBIGUOUS])
def test_what_is_special_about_the_data_is_believed_after_eight_samples(status):
    judge = Judge((status, 0.0))
    run(samples="auto", refine=judge)
    assert judge.asked == [2, 4, 8]


@pytest.mark.parametrize("workers", [1, 3])
def test_rounds_see_the_samples_that_a_given_number_sees(workers):
    automatic = run(samples="auto", refine=Judge(NOTHING, NOTHING, CLEAR), workers=workers)
    given = run(samples=8)
    for h, g in zip(automatic.hypotheses, given.hypotheses, strict=True):
        assert (h.sample, h.model.tobytes()) == (g.sample, g.model.tobytes())


@pytest.mark.parametrize(("support", "size"), [(0.5, 2000), (0.004, 5000), (0.0001, 16_000), (0.0, 16_000)])
def test_samples_grow_where_they_hold_too_few_inliers(support, size):
    judge = Judge(NOTHING, NOTHING, CLEAR, support=support)
    result = run(shifted_rows(200_000), samples="auto", sample_size="auto", refine=judge)
    assert judge.sizes[:2] == [2000, 2000]
    assert judge.sizes[2:] == pytest.approx([size] * 6, rel=0.01)
    assert result.info["sample_size"] == judge.sizes[-1]


def test_samples_of_different_sizes_share_no_row():
    estimator = MockEstimator()
    judge = Judge(NOTHING, NOTHING, CLEAR, support=0.004)
    run(shifted_rows(200_000), estimator, samples="auto", sample_size="auto", refine=judge)
    drawn = np.concatenate([numbers(call["rows"]) for call in estimator.calls])
    assert len(np.unique(drawn)) == len(drawn) > 30_000


def test_automatic_samples_of_all_rows_are_one_with_ten_times_the_budget():
    estimator = MockEstimator()
    run(shifted_rows(40), estimator, samples="auto", sample_size="auto")
    assert [call["budget"] for call in estimator.calls] == [10]


def test_automatic_samples_end_after_ten_passes():
    judge = Judge(NOTHING)
    run(shifted_rows(100), samples="auto", max_samples=10**6, sample_size=40, refine=judge)
    assert judge.asked[-1] == 25


def test_a_time_limit_after_the_last_sample_is_none():
    assert run(samples=1, time_limit=1e-9, refine=Judge(NOTHING)).status is Status.LOW_SUPPORT


def test_the_time_limit_ends_the_search():
    result = run(samples="auto", max_samples=10**6, time_limit=1e-9, refine=Judge(NOTHING))
    assert result.status is Status.TIME_LIMIT
    assert len(result.hypotheses) == 1
    assert np.isfinite(result.T).all()
    assert run(samples=3, time_limit=1e-9, refine=Judge(CLEAR)).success
    assert run(estimator=MockEstimator({0: np.nan}), time_limit=1e-9).status is Status.TIME_LIMIT


def test_a_rule_with_its_own_plan_needs_a_number():
    with pytest.raises(ValueError, match="samples must be a number with the rule fixed"):
        run(samples="auto", rule="fixed")


# --- the joint search -------------------------------------------------------------------------------------------------


class Together(MockEstimator):
    """Finds the right shift only when it sees all samples."""

    def with_budget(self, factor):
        return self

    def search_jointly(self, problem, hypotheses, rows, threshold, rng):
        self.seen = len(hypotheses), len(rows)
        model = naive.shift_model(3.0)
        return Hypothesis(model, problem.residuals(model[None], rows)[0], threshold, tested=100)


def test_a_joint_search_may_find_what_no_sample_holds():
    estimator = Together(dict.fromkeys(range(5), 500.0))
    result = run(estimator=estimator)
    assert estimator.seen == (5, 200)
    assert result.t[0] == pytest.approx(3.0, abs=0.1)
    assert len(result.hypotheses) == 5


def test_without_refinement_there_is_no_joint_search():
    estimator = Together(dict.fromkeys(range(5), 500.0))
    assert run(estimator=estimator, refine="none").t[0] == 500.0
    assert not hasattr(estimator, "seen")


# --- bad data end in a status -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rows_that_are_not_finite_are_dropped_and_counted(bad):
    rows = shifted_rows(100)
    rows[::4, 1] = bad
    estimator, spy = MockEstimator(), SpyRefiner()
    result = run(rows, estimator, samples=2, sample_size=40, refine=spy)
    drawn = np.concatenate([sample_of(100, i, 40) for i in range(2)])
    assert result.info["dropped_rows"] == (drawn % 4 == 0).sum() > 0
    assert all(np.isfinite(call["rows"]).all() for call in estimator.calls)
    np.testing.assert_array_equal(numbers(spy.rows), np.sort(drawn[drawn % 4 != 0]))


def test_no_rows_are_too_few():
    result = run(np.empty((0, 2)))
    assert result.status is Status.TOO_FEW
    assert np.isnan(result.T).all()
    assert result.info["samples"] == 0
    assert result.hypotheses == ()


@pytest.mark.parametrize("noise", [NOISE, None])
def test_a_single_row_supports_nothing(noise):
    result = run(np.array([[1.0, 4.0]]), noise=noise)
    assert result.status is Status.LOW_SUPPORT


def test_rows_without_a_finite_one_are_too_few():
    estimator = MockEstimator()
    result = run(np.full((50, 2), np.nan), estimator)
    assert result.status is Status.TOO_FEW
    assert np.isnan(result.T).all()
    assert estimator.calls == []


@pytest.mark.parametrize(("determined", "status"), [(True, Status.LOW_SUPPORT), (False, Status.DEGENERATE)])
def test_nothing_found(determined, status, monkeypatch):
    monkeypatch.setattr(naive.Shift, "determined", lambda self, model, inliers, threshold: determined)
    result = run(estimator=MockEstimator(dict.fromkeys(range(5), np.nan)))
    assert result.status is status
    assert np.isnan(result.T).all()
    assert (result.confidence, result.num_inliers, len(result.hypotheses)) == (0.0, 0, 5)


@pytest.mark.parametrize("found", range(5))
@pytest.mark.parametrize("rule", ["most_inliers", "closest_pair", "closest_triplet", "pair_0.1", "tlp_0.1"])
def test_one_found_model_is_enough(found, rule):
    nothing = dict.fromkeys(set(range(5)) - {found}, np.nan)
    result = run(estimator=MockEstimator(nothing), rule=rule)
    assert result.success
    assert result.t[0] == pytest.approx(3.0, abs=0.2)


def test_random_rows_support_nothing():
    rows = np.random.default_rng(0).uniform(0, 1000, (1000, 2))
    result = run(rows, noise=0.1)
    assert result.status is Status.LOW_SUPPORT
    assert np.isfinite(result.T).all()


def test_an_error_in_the_estimator_reaches_the_caller():
    class Broken(MockEstimator):
        def estimate(self, problem, rows, threshold, rng):
            raise ZeroDivisionError("mine")

    for workers in (1, 2):
        with pytest.raises(ZeroDivisionError, match="mine"):
            run(estimator=Broken(), workers=workers)


# --- wrong arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *(("noise", x) for x in (0, -1.0, math.nan, math.inf, "0.1", [0.1, 0.2])),
        *(("samples", x) for x in (0, -3, 2.5, "3", None, 10**20)),
        *(("sample_size", x) for x in (0, -1, 10.5, "10", None)),
        *(("rule", x) for x in ("best", "tlp_", 3)),
        *(("refine", x) for x in ("icp", "", 3)),
        *(("max_samples", x) for x in (0, 1.5, "auto", None, 10**15)),
        *(("time_limit", x) for x in (0, -1.0, "1", math.nan)),
        *(("workers", x) for x in (0, -1, 1.5, "all")),
        *(("rng", x) for x in (-1, 0.5, "seed")),
    ],
)
def test_wrong_arguments_are_refused_by_name(name, wrong):
    with pytest.raises((ValueError, TypeError), match=rf"^{name} must be"):
        run(**{name: wrong})


def test_a_source_of_the_wrong_width_is_refused():
    with pytest.raises(ValueError, match="source has rows of 3 columns, Shift needs 2"):
        run(np.zeros((10, 3)))


def test_settings_are_keyword_only():
    with pytest.raises(TypeError):
        estimate(ArraySource(shifted_rows()), naive.Shift(), MockEstimator(), NOISE)


# --- a problem and an estimator of a user's own -----------------------------------------------------------------------


class Line:
    """Lines in the plane, as the motion [R | t] that takes the x axis to the line; rows are points (x, y)."""

    width, minimal_size, split = 2, 2, 1

    def solve_minimal(self, samples):
        return np.stack([self._through(first, second - first) for first, second in samples])

    def residuals(self, models, rows):
        offsets = rows[None] - models[:, None, :2, 3]
        return np.abs((offsets * models[:, None, :2, 1]).sum(axis=2))

    def count_inliers(self, models, rows, threshold):
        return (self.residuals(models, rows) < threshold).sum(axis=1)

    def refit(self, model, rows, weights):
        mean = np.average(rows, axis=0, weights=weights)
        _, _, directions = np.linalg.svd(np.sqrt(weights)[:, None] * (rows - mean), full_matrices=False)
        return self._through(mean, directions[0])

    def determined(self, model, inliers, threshold):
        return bool(np.ptp(inliers @ model[:2, 0]) > threshold)

    def distance(self, a, b):
        cosines = (np.asarray(a)[..., :2, 0] * np.asarray(b)[..., :2, 0]).sum(axis=-1)
        return np.degrees(np.arccos(np.minimum(np.abs(cosines), 1.0)))

    @staticmethod
    def _through(point, direction):
        c, s = direction / np.linalg.norm(direction)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return np.column_stack([R, [*point, 0.0]])


@dataclass(frozen=True)
class TinyRansac:
    iterations: int = 200

    def with_budget(self, factor):
        return TinyRansac(self.iterations * factor)

    def estimate(self, problem, rows, threshold, rng):
        k = problem.minimal_size
        samples = np.stack([rows[rng.choice(len(rows), k, replace=False)] for _ in range(self.iterations)])
        models = problem.solve_minimal(samples)
        best = models[np.argmax(problem.count_inliers(models, rows, threshold))]
        return Hypothesis(best, problem.residuals(best[None], rows)[0], threshold, tested=len(models))


def points_on_a_line(rng, n, outliers):
    along, across = rng.uniform(-10, 10, n), 0.02 * rng.standard_normal(n)
    points = np.column_stack([1 + 0.8 * along - 0.6 * across, 2 + 0.6 * along + 0.8 * across])
    points[: int(outliers * n)] = rng.uniform(-12, 12, (int(outliers * n), 2))
    return points


@pytest.mark.parametrize("rule", ["tlp_0.1", "closest_pair", "fixed"])
def test_a_users_own_problem_works_end_to_end(rng, rule):
    points = points_on_a_line(rng, 20_000, 0.8)
    settings = {"noise": 0.02, "samples": 6, "sample_size": 300, "rule": rule}
    result = estimate(ArraySource(points), Line(), TinyRansac(), **settings)
    assert result.success
    direction, point = result.T[:2, 0], result.T[:2, 3]
    assert abs(direction @ [-0.6, 0.8]) < 0.005
    assert abs((point - [1.0, 2.0]) @ [-0.6, 0.8]) < 0.02
    assert result.num_inliers == pytest.approx(0.2 * result.num_rows, rel=0.3)


def test_a_users_own_problem_without_a_line_is_not_claimed(rng):
    points = rng.uniform(-12, 12, (20_000, 2))
    assert not estimate(ArraySource(points), Line(), TinyRansac(), noise=0.02, samples=6, sample_size=300).success


# --- the same bits for any workers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("estimator", "scale"),
    [
        (Pcr99.for_pairs(), 1.0),
        (Pcr99("distance", order="random", tolerance=0.6, max_valid=300, max_drawn=50_000), 1.0),
        (Pcr99(max_drawn=5000), None),
    ],
    ids=["ranked", "random", "free scale"],
)
def test_any_workers_give_the_same_bits(estimator, scale):
    pairs = simulate.registration(4000, 0.9, 0.01, rng=1)
    source = ArraySource(np.hstack([pairs.source, pairs.target]))

    def answer(workers):
        result = estimate(
            source, Registration(scale), estimator, noise=0.01, samples=6, sample_size=400, workers=workers, rng=5
        )
        scores = [h.score for h in result.hypotheses]
        residuals = [h.residuals.tobytes() for h in result.hypotheses]
        return result.T.tobytes(), scores, residuals, result.status, result.confidence, result.num_inliers

    expected = answer(1)
    assert expected[3] is Status.OK
    assert answer(2) == answer(None) == expected
    with ThreadPoolExecutor(3) as pool:
        assert answer(pool) == expected
    if estimator.order == "ranked" and scale == 1.0:
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            assert answer(pool) == expected


def test_the_default_rule_is_the_one_the_paper_recommends():
    np.testing.assert_array_equal(run().T, run(rule=TruncatedLp(0.1)).T)
