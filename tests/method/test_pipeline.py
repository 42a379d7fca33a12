import math
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from multiprocessing import get_context

import numpy as np
import pytest

import naive
import nonsac
from nonsac import Estimator, Hypothesis, Pcr99, Refinement, Refiner, Registration, Status, estimate, simulate
from nonsac.method.refine import AsSelected
from nonsac.method.sampling import sample_rows, sample_start
from nonsac.method.scoring import MostInliers, ScoringRule, TruncatedLp
from nonsac.problems import ContractBroken
from nonsac.result import Uncertainty
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
class MockEstimator(Estimator):
    """The median shift of the sample's rows, or what `answers` says for the sample; remembers what it was given.

    An answer that is an exception is raised.
    """

    answers: dict = field(default_factory=dict)
    calls: list = field(default_factory=list)
    budget: int = 1
    lock: threading.Lock = field(default_factory=threading.Lock)

    def with_budget(self, factor):
        return MockEstimator(self.answers, self.calls, self.budget * factor, self.lock)

    def estimate(self, problem, rows, noise, rng):
        with self.lock:
            number = len(self.calls)
            self.calls.append({"rows": rows, "noise": noise, "draw": rng.random(), "budget": self.budget})
        shift = self.answers.get(number, np.median(rows.values[:, 1] - rows.values[:, 0]))
        if isinstance(shift, Exception):
            raise shift
        if not np.isfinite(shift):
            return Hypothesis(problem.no_model, np.full(len(rows), np.inf), noise.threshold, tested=3)
        model = naive.shift_model(shift)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], noise.threshold, tested=3)


class SpyRefiner(Refiner):
    """Returns the winner as it is and remembers what it was given."""

    def refine(self, search, winner):
        self.problem, self.hypotheses, self.winner = search.problem, list(search.hypotheses), winner
        self.rows, self.noise = search.union(), search.noise
        return Refinement(search.hypotheses[winner].model, Status.OK, 0.75, 12, 34)


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


def shift_of(result):
    return result.model[0, 3]


def sample_of(n, i, size):
    return sample_rows(n, sample_start(n, 0, i, size), size, SEED)


def numbers(rows):
    return rows.values[:, 0].astype(int)


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
@pytest.mark.parametrize("wrong", [type, lambda _: object()], ids=["class", "object"])
def test_only_objects_of_the_contracts_are_taken(name, wrong):
    arguments = {"source": ArraySource(shifted_rows()), "problem": naive.Shift(), "estimator": MockEstimator()}
    arguments[name] = wrong(arguments[name])
    with pytest.raises(TypeError, match=f"^{name} must be"):
        estimate(**arguments, noise=NOISE)


@pytest.mark.parametrize(
    ("contract", "missing"),
    [
        (nonsac.Problem, {"layout", "minimal_size", "solve_minimal", "residuals", "refit"}),
        (nonsac.Estimator, {"estimate"}),
        (nonsac.ScoringRule, {"name", "scores"}),
        (nonsac.Refiner, {"refine"}),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_class_that_lacks_a_needed_method_makes_no_object(contract, missing):
    own = type("Own", (contract,), {})
    for name in missing:
        with pytest.raises(TypeError, match=rf"abstract class Own .*\b{name}\b"):
            own()
    complete = type("Own", (contract,), dict.fromkeys(missing))
    assert isinstance(complete(), contract)


def test_the_threshold_is_five_times_the_noise():
    estimator = MockEstimator()
    result = run(estimator=estimator)
    assert all(call["noise"] == nonsac.Noise(NOISE, 5 * NOISE, known=True) for call in estimator.calls)
    assert (result.threshold, result.noise) == (5 * NOISE, NOISE)


def test_a_noise_that_is_measured_is_not_known():
    estimator, spy = MockEstimator(), SpyRefiner()
    run(estimator=estimator, refine=spy, noise=None)
    assert not any(noise.known for noise in [spy.noise, *(call["noise"] for call in estimator.calls)])


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
    class Virtual(nonsac.Source):
        width = 2

        def __len__(self):
            return 10**12

        def take(self, indices):
            return np.column_stack([indices, indices + 3.0])

        def chunks(self, rows):
            raise AssertionError("the whole source must not be read")

    result = run(Virtual())
    assert result.success
    assert shift_of(result) == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("n", [1000, 200, 100])
def test_the_refiner_gets_the_union_of_the_samples_each_row_once(n):
    spy = SpyRefiner()
    run(shifted_rows(n), refine=spy)
    drawn = np.unique(np.concatenate([sample_of(n, i, 40) for i in range(5)]))
    np.testing.assert_array_equal(numbers(spy.rows), drawn if n >= 200 else np.arange(n))
    assert spy.noise.threshold == 5 * NOISE


# --- selection, refinement and what comes back ------------------------------------------------------------------------


def test_the_rule_selects_and_the_refiner_has_the_last_word():
    spy = SpyRefiner()
    result = run(estimator=MockEstimator({3: 2.95, 0: 90.0, 1: 91.0, 2: 92.0, 4: 93.0}), refine=spy)
    assert spy.winner == 3
    assert (result.status, result.confidence, result.num_inliers, result.num_rows) == (Status.OK, 0.75, 12, 34)
    np.testing.assert_array_equal(result.model, naive.shift_model(2.95))


def test_a_refiner_may_have_a_noise_of_its_own_and_more_to_tell():
    class Own(SpyRefiner):
        def refine(self, search, winner):
            found = super().refine(search, winner)
            own = {"noise": 0.3, "threshold": 0.7, "measured_noise": 0.25, "remarks": ("own",), "info": {"mine": 5}}
            return replace(found, **own)

    result = run(refine=Own())
    assert (result.noise, result.threshold, result.remarks) == (0.3, 0.7, ("own",))
    assert (result.info["measured_noise"], result.info["mine"]) == (0.25, 5)


def test_a_refiner_has_a_last_step_after_all_samples():
    class Own(Judge):
        def finish(self, search, refinement):
            self.seen = len(search.hypotheses)
            return replace(refinement, model=refinement.model + 1.0)

    last = Own(NOTHING, CLEAR)
    result = run(samples="auto", refine=last)
    assert (last.asked, last.seen) == ([2, 4], 4)
    np.testing.assert_array_equal(result.model, result.hypotheses[last.winner].model + 1.0)
    assert list(result.info["seconds"]) == ["hypotheses", "selection", "refinement", "all rows"]


def test_a_refiner_may_refuse_a_problem():
    class Own(SpyRefiner):
        def check(self, problem):
            raise ValueError(f"not for {type(problem).__name__}")

    estimator = MockEstimator()
    with pytest.raises(ValueError, match="not for Shift"):
        run(estimator=estimator, refine=Own())
    assert estimator.calls == []


def test_an_estimator_may_refuse_a_problem():
    class Own(MockEstimator):
        def check(self, problem):
            raise ValueError(f"not for {type(problem).__name__}")

    with pytest.raises(ValueError, match="not for Shift"):
        run(estimator=Own())


def test_hypotheses_come_back_in_order_with_their_scores():
    result = run(rule="most_inliers")
    assert [h.sample for h in result.hypotheses] == [0, 1, 2, 3, 4]
    assert [h.score for h in result.hypotheses] == [h.num_inliers for h in result.hypotheses]


def test_a_rule_may_be_named_or_given():
    by_name, given = run(rule="most_inliers"), run(rule=MostInliers())
    np.testing.assert_array_equal(by_name.model, given.model)
    assert by_name.info["rule"] == given.info["rule"] == "most_inliers"


def test_a_rule_of_ones_own():
    class Third(ScoringRule):
        name = "third"

        def scores(self, hypotheses, problem):
            return [0.0, 0.0, 1.0, 0.0, 0.0]

    result = run(rule=Third(), refine="none", estimator=MockEstimator({2: 77.0}))
    assert shift_of(result) == 77.0
    assert result.info["rule"] == "third"


def test_what_only_looks_like_a_rule_or_a_refiner_is_refused():
    class Alike:
        name = "alike"

        def scores(self, hypotheses, problem):
            return [0.0] * len(hypotheses)

        def refine(self, search, winner):
            raise AssertionError

    for name in ("rule", "refine"):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            run(**{name: Alike()})


def test_refine_none_returns_the_selected_model_and_union_improves_it():
    rows = shifted_rows(outliers=0.0)
    selected, refined = run(rows, refine="none"), run(rows, refine="union")
    assert any(np.array_equal(selected.model, h.model) for h in selected.hypotheses)
    assert abs(shift_of(refined) - 3.0) < 4 * NOISE / math.sqrt(200)
    np.testing.assert_array_equal(run(rows, refine=AsSelected()).model, selected.model)


def test_inliers_belong_to_the_model_returned():
    result = run()
    drawn = np.concatenate([sample_of(1000, i, 40) for i in range(5)])
    residuals = naive.Shift().residuals(result.model[None], shifted_rows()[drawn])[0]
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
    assert (info["estimator"], info["rule"]) == ("MockEstimator", "tlp_0.1")
    assert (info["dropped_rows"], info["remarks"]) == (0, ())
    assert list(info["seconds"]) == ["hypotheses", "selection", "refinement"]
    assert all(seconds >= 0 for seconds in info["seconds"].values())


def test_progress_is_told_after_each_sample():
    told = []
    run(progress=lambda done, samples: told.append((done, samples)))
    assert told == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


def test_a_seed_from_entropy_is_recorded_and_replays():
    first = run(rng=None)
    np.testing.assert_array_equal(run(rng=first.info["seed"]).model, first.model)
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
    np.testing.assert_array_equal(run(stop=lambda hypotheses, problem: False).model, run().model)


# --- as many samples as it takes --------------------------------------------------------------------------------------


class Judge(SpyRefiner):
    """Gives one verdict after the other, and remembers after how many samples it was asked."""

    def __init__(self, *verdicts, support=0.5):
        self.verdicts, self.support, self.asked = list(verdicts), support, []

    def refine(self, search, winner):
        self.winner = winner
        self.asked.append(len(search.hypotheses))
        self.sizes = [len(h.residuals) for h in search.hypotheses]
        status, confidence = self.verdicts[min(len(self.asked), len(self.verdicts)) - 1]
        rows = len(search.union())
        return Refinement(search.hypotheses[winner].model, status, confidence, int(self.support * rows), rows)


CLEAR, NEARLY_CLEAR, NOTHING = (Status.OK, 0.995), (Status.OK, 0.98), (Status.LOW_SUPPORT, 0.0)
UNCLEAR = (Status.OK, 0.85)


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


def test_nearly_clear_from_half_as_many_samples_is_clear():
    """A scene that has no more places to tell would be drawn from to the end."""
    judge = Judge(NEARLY_CLEAR, UNCLEAR, NEARLY_CLEAR, NEARLY_CLEAR, NOTHING)
    assert run(samples="auto", refine=judge).info["samples"] == 16
    assert judge.asked == [2, 4, 8, 16]


def test_max_samples_end_the_search():
    judge = Judge(NOTHING)
    result = run(samples="auto", max_samples=11, refine=judge)
    assert judge.asked == [2, 4, 8, 11]
    assert result.status is Status.LOW_SUPPORT


class Thorough(MockEstimator):
    """Says that it tested so many models in each sample."""

    def __init__(self, tested):
        super().__init__()
        self.tested = tested

    def estimate(self, problem, rows, noise, rng):
        return replace(super().estimate(problem, rows, noise, rng), tested=self.tested)


@pytest.mark.parametrize(("most", "samples"), [(100, 16), (20, 16), (200, 32)])
def test_a_long_search_that_finds_nothing_ends_sooner(most, samples):
    judge = Judge(NOTHING)
    result = run(np.zeros((5000, 2)), Thorough(8000), samples="auto", max_samples=most, refine=judge)
    assert (result.info["samples"], result.status) == (samples, Status.LOW_SUPPORT)


def test_a_long_search_that_finds_something_goes_on():
    class Doubter(Judge):
        def refine(self, search, winner):
            return replace(super().refine(search, winner), remarks=("partly right",))

    result = run(np.zeros((5000, 2)), Thorough(8000), samples="auto", max_samples=50, refine=Doubter(NOTHING))
    assert result.info["samples"] == 50


def test_samples_that_were_asked_for_are_drawn_though_nothing_is_found():
    assert run(estimator=Thorough(10**6), samples=20, refine=Judge(NOTHING)).info["samples"] == 20


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


class Unsure(SpyRefiner):
    """Trusts its answers, and says how uncertain each is: by so many degrees of rotation, and twice as many of t."""

    def __init__(self, *degrees, confidence=1.0, status=Status.OK):
        self.degrees, self.verdict, self.asked = list(degrees), (status, confidence), []

    def refine(self, search, winner):
        self.asked.append(len(search.hypotheses))
        degrees = self.degrees[min(len(self.asked), len(self.degrees)) - 1]
        uncertainty = None if degrees is None else Uncertainty(degrees, 99.0, 2.0 * degrees)
        return Refinement(search.hypotheses[winner].model, *self.verdict, 12, 34, uncertainty=uncertainty)


@pytest.mark.parametrize(
    ("degrees", "status", "confidence"),
    [
        (0.0, Status.OK, 1.0),
        (2.5, Status.OK, 1.0 - 1.0 / 32.0),
        (5.0, Status.OK, 0.5),
        (5.01, Status.UNCERTAIN, 0.496),
        (5.5, Status.UNCERTAIN, 0.26795),
        (90.0, Status.UNCERTAIN, 0.0),
        (math.inf, Status.UNCERTAIN, 0.0),
        (None, Status.OK, 1.0),
    ],
)
def test_an_answer_that_is_more_uncertain_than_allowed_is_not_trusted(degrees, status, confidence):
    result = run(refine=Unsure(degrees))
    assert result.status is status
    assert result.confidence == pytest.approx(confidence, abs=1e-4)
    assert result.uncertainty == (None if degrees is None else Uncertainty(degrees, 99.0, 2.0 * degrees))


def test_the_uncertainty_and_what_else_speaks_against_an_answer_add_up():
    certain, unsure = (run(refine=Unsure(degrees, confidence=0.6)) for degrees in (0.0, 4.0))
    assert (certain.status, certain.confidence) == (Status.OK, 0.6)
    assert unsure.status is Status.UNCERTAIN
    assert unsure.confidence == pytest.approx(0.6 - 0.5 * 0.8**4)


def test_how_much_uncertainty_is_allowed_can_be_set():
    statuses = [run(refine=Unsure(4.0), max_uncertainty=most).status for most in (3.0, 4.0, 40.0, None)]
    assert statuses == [Status.UNCERTAIN, Status.OK, Status.OK, Status.OK]
    assert run(refine=Unsure(math.inf), max_uncertainty=None).confidence == 1.0


@pytest.mark.parametrize("status", [Status.AMBIGUOUS, Status.DEGENERATE, Status.LOW_SUPPORT])
def test_what_is_not_trusted_for_another_reason_is_not_called_uncertain(status):
    result = run(refine=Unsure(90.0, confidence=0.3, status=status))
    assert (result.status, result.confidence) == (status, 0.3)


def test_an_uncertain_answer_may_become_certain_with_more_samples():
    judge = Unsure(90.0, 90.0, 90.0, 1.0)
    assert run(samples="auto", refine=judge).success
    assert judge.asked == [2, 4, 8, 16]
    judge = Unsure(90.0)
    assert run(samples="auto", max_samples=11, refine=judge).status is Status.UNCERTAIN
    assert judge.asked == [2, 4, 8, 11]


def test_a_time_limit_after_the_last_sample_is_none():
    assert run(samples=1, time_limit=1e-9, refine=Judge(NOTHING)).status is Status.LOW_SUPPORT


def test_the_time_limit_ends_the_search():
    result = run(samples="auto", max_samples=10**6, time_limit=1e-9, refine=Judge(NOTHING))
    assert result.status is Status.TIME_LIMIT
    assert len(result.hypotheses) == 1
    assert result.found
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

    def search_jointly(self, problem, hypotheses, rows, noise, rng):
        self.seen = len(hypotheses), len(rows)
        model = naive.shift_model(3.0)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], noise.threshold, tested=100)


def test_a_joint_search_may_find_what_no_sample_holds():
    estimator = Together(dict.fromkeys(range(5), 500.0))
    result = run(estimator=estimator)
    assert estimator.seen == (5, 200)
    assert shift_of(result) == pytest.approx(3.0, abs=0.1)
    assert len(result.hypotheses) == 5


def test_without_refinement_there_is_no_joint_search():
    estimator = Together(dict.fromkeys(range(5), 500.0))
    assert shift_of(run(estimator=estimator, refine="none")) == 500.0
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
    assert all(np.isfinite(call["rows"].values).all() for call in estimator.calls)
    np.testing.assert_array_equal(numbers(spy.rows), np.sort(drawn[drawn % 4 != 0]))


def test_no_rows_are_too_few():
    result = run(np.empty((0, 2)))
    assert result.status is Status.TOO_FEW
    assert np.isnan(result.model).all()
    assert (result.noise, result.threshold) == (NOISE, 5 * NOISE)
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
    assert np.isnan(result.model).all()
    assert estimator.calls == []


@pytest.mark.parametrize(("determined", "status"), [(True, Status.LOW_SUPPORT), (False, Status.DEGENERATE)])
def test_nothing_found(determined, status, monkeypatch):
    monkeypatch.setattr(naive.Shift, "determined", lambda self, model, inliers, noise: determined)
    result = run(estimator=MockEstimator(dict.fromkeys(range(5), np.nan)))
    assert result.status is status
    assert np.isnan(result.model).all()
    assert result.model.shape == (3, 4)
    assert (result.confidence, result.num_inliers, len(result.hypotheses)) == (0.0, 0, 5)


@pytest.mark.parametrize("found", range(5))
@pytest.mark.parametrize("rule", ["most_inliers", "closest_pair", "closest_triplet", "pair_0.1", "tlp_0.1"])
def test_one_found_model_is_enough(found, rule):
    nothing = dict.fromkeys(set(range(5)) - {found}, np.nan)
    result = run(estimator=MockEstimator(nothing), rule=rule)
    assert result.success
    assert shift_of(result) == pytest.approx(3.0, abs=0.2)


def test_random_rows_support_nothing():
    rows = np.random.default_rng(0).uniform(0, 1000, (1000, 2))
    result = run(rows, noise=0.1)
    assert result.status is Status.LOW_SUPPORT
    assert result.found


# --- estimators that fail ---------------------------------------------------------------------------------------------

MINE = ZeroDivisionError("mine")


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_the_estimator_costs_its_sample_only(workers):
    result = run(estimator=MockEstimator({0: MINE, 1: MINE}), workers=workers)
    failed = [h for h in result.hypotheses if h.fault]
    assert result.success
    assert shift_of(result) == pytest.approx(3.0, abs=0.2)
    assert result.remarks == ("the estimator failed in some samples: 2 of 5 (ZeroDivisionError: mine)",)
    assert [(h.fault, h.found, h.num_inliers, h.tested) for h in failed] == [
        ("ZeroDivisionError: mine", False, 0, 0)
    ] * 2
    assert [h.sample for h in result.hypotheses] == [0, 1, 2, 3, 4]


def test_the_remark_on_failures_comes_after_those_of_the_refiner():
    class Remarking(SpyRefiner):
        def refine(self, search, winner):
            return replace(super().refine(search, winner), remarks=("planar",))

    result = run(estimator=MockEstimator({0: MINE}), refine=Remarking())
    assert result.remarks == ("planar", "the estimator failed in some samples: 1 of 5 (ZeroDivisionError: mine)")


@pytest.mark.parametrize("workers", [1, 3])
def test_an_estimator_that_always_fails_is_not_asked_more_than_eight_times(workers):
    result = run(estimator=MockEstimator(dict.fromkeys(range(100), MINE)), samples="auto", workers=workers)
    assert (len(result.hypotheses), result.status) == (8, Status.LOW_SUPPORT)
    assert not result.found
    assert result.remarks == ("the estimator failed in some samples: 8 of 8 (ZeroDivisionError: mine)",)


def test_samples_that_hold_nothing_are_no_failures():
    result = run(estimator=MockEstimator(dict.fromkeys(range(100), np.nan)), samples="auto", max_samples=20)
    assert (len(result.hypotheses), result.remarks) == (20, ())


def test_an_estimator_that_fails_while_the_noise_is_guessed_is_asked_again():
    """There are six guesses of the noise, each with an estimate; only after them come the samples."""
    result = run(estimator=MockEstimator({0: MINE, 3: MINE, 6: MINE}), noise=None)
    assert result.success
    assert result.noise == pytest.approx(NOISE, rel=0.3)
    assert not run(estimator=MockEstimator(dict.fromkeys(range(1000), MINE)), noise=None).found


class Gives(MockEstimator):
    """Gives something else than a hypothesis, or one of something else than a model."""

    def estimate(self, problem, rows, noise, rng):
        return self.answers


@pytest.mark.parametrize("noise", [NOISE, None])
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "Gives.estimate must give a nonsac.Hypothesis, got NoneType"),
        (naive.shift_model(3.0), "Gives.estimate must give a nonsac.Hypothesis, got ndarray"),
        (
            Hypothesis(np.eye(3), np.zeros(40), 1.0),
            r"a model of the shape \(3, 3\); Shift has models of the shape \(3, 4\)",
        ),
    ],
)
def test_an_estimator_that_breaks_its_contract_ends_the_call(answer, message, noise):
    with pytest.raises(ContractBroken, match=message):
        run(estimator=Gives(answer), noise=noise)


class Flat(naive.Shift):
    """Solves and fits in another shape than it says."""

    model_shape = (2,)


@pytest.mark.parametrize("noise", [NOISE, None])
def test_a_problem_that_breaks_its_contract_ends_the_call(noise):
    with pytest.raises(ContractBroken, match=r"Flat.solve_minimal gave models of the shape \(3, 4\) instead of \(2,\)"):
        estimate(ArraySource(shifted_rows()), Flat(), nonsac.Ransac(50), noise=noise, samples=2, sample_size=40)


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


@pytest.mark.parametrize("width", [1, 4])
def test_a_source_of_the_wrong_width_is_refused(width):
    names = " ".join(naive.Shift().layout.names)
    message = rf"source is a source with rows of {width} columns, not of 2 \({names}\), or 3 with a weight; choose col"
    with pytest.raises(ValueError, match=message):
        run(np.zeros((10, width)))


def test_columns_are_found_by_their_names(rng):
    rows = points_on_a_line(rng, 2000, 0.5)
    expected = estimate(ArraySource(rows), naive.Line(), noise=0.02)
    names = naive.Line().layout.names
    turned = np.column_stack([rng.uniform(size=2000), rows[:, ::-1]])
    for source in (ArraySource(turned, ("other", *names[::-1])), ArraySource(rows, [name.upper() for name in names])):
        np.testing.assert_array_equal(estimate(source, naive.Line(), noise=0.02).model, expected.model)
    with pytest.raises(
        ValueError, match=rf"source is a source with rows of 2 columns \(u v\), of which none .* {names[0]}"
    ):
        estimate(ArraySource(rows, ("u", "v")), naive.Line(), noise=0.02)


def test_a_last_column_that_is_no_weight_is_told(rng):
    table = np.column_stack([points_on_a_line(rng, 100, 0.5), rng.uniform(-1, 1, 100)])
    with pytest.raises(
        ValueError, match=r"^weights must not be negative, got -.*the last column of source is taken as"
    ):
        estimate(ArraySource(table), naive.Line(), noise=0.02)


@pytest.mark.parametrize("stop", [3, "never"])
def test_stop_is_a_function(stop):
    with pytest.raises(TypeError, match=r"^stop must be a function of \(hypotheses, problem\), or None, got"):
        run(np.zeros((10, 2)), stop=stop)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (lambda rows: rows[:-1], r"Short\.take gave float64 \(\d+, 2\) for \d+ rows of 2 columns: return a float64"),
        (lambda rows: rows.tolist(), r"Short\.take gave list for \d+ rows"),
        (lambda rows: rows.astype(np.float32), r"Short\.take gave float32"),
    ],
)
def test_a_source_that_gives_something_else_is_refused(answer, told):
    class Short(ArraySource):
        def take(self, indices):
            return answer(super().take(indices))

    with pytest.raises(nonsac.ContractBroken, match=told):
        estimate(Short(shifted_rows()), naive.Shift(), MockEstimator(), noise=0.1)


@pytest.mark.parametrize(
    ("scores", "told"),
    [
        (lambda found: [1.0], r"\(1,\)"),
        (lambda found: 1.0, r"\(\)"),
        (lambda found: np.zeros((len(found), 2)), r", 2\)"),
    ],
)
def test_a_rule_that_gives_something_else_is_refused(scores, told):
    class Odd(nonsac.ScoringRule):
        name = "odd"

        def scores(self, hypotheses, problem):
            return scores(hypotheses)

    with pytest.raises(nonsac.ContractBroken, match=rf"Odd\.scores gave the shape .*{told} for 2 hypotheses"):
        run(rule=Odd(), samples=2)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (None, r"must give a nonsac\.Refinement, got NoneType"),
        (np.zeros((3, 4)), r"must give a nonsac\.Refinement, got ndarray"),
        (
            Refinement(np.zeros((9, 9)), Status.OK, 1.0, 10, 20),
            r"gave a model of the shape \(9, 9\); Shift has models of",
        ),
        (Refinement(np.zeros((3, 4)), "ok", 1.0, 10, 20), r"gave the status 'ok', which is no nonsac\.Status"),
    ],
)
def test_a_refiner_that_gives_something_else_is_refused(answer, told):
    class Odd(nonsac.Refiner):
        def refine(self, search, winner):
            return answer

    with pytest.raises(nonsac.ContractBroken, match=rf"Odd\.refine {told}"):
        run(refine=Odd(), samples=2)


@pytest.mark.parametrize(("name", "meant"), [("worker", "workers"), ("nois", "noise"), ("sample_sizes", "sample_size")])
def test_an_unknown_setting_is_refused_with_the_one_that_was_meant(name, meant):
    with pytest.raises(
        TypeError, match=rf"estimate\(\) got an unexpected keyword argument '{name}'; did you mean {meant}"
    ):
        run(**{name: 1})


def test_settings_are_keyword_only():
    with pytest.raises(TypeError):
        estimate(ArraySource(shifted_rows()), naive.Shift(), MockEstimator(), NOISE)


# --- a problem and an estimator of a user's own -----------------------------------------------------------------------


@dataclass(frozen=True)
class TinyRansac(Estimator):
    iterations: int = 200

    def with_budget(self, factor):
        return TinyRansac(self.iterations * factor)

    def estimate(self, problem, rows, noise, rng):
        k = problem.minimal_size
        samples = np.stack([rows.values[rng.choice(len(rows), k, replace=False)] for _ in range(self.iterations)])
        models = problem.solve_minimal(samples)
        best = models[np.argmax(problem.count_inliers(models, rows.values, noise.threshold))]
        residuals = problem.residuals(best[None], rows.values)[0]
        return Hypothesis(best, residuals, noise.threshold, tested=len(models))


def best_line(values, threshold, seed):
    """The line with the most inliers, as a plain function that knows nothing of this library."""
    rng, lines = np.random.default_rng(seed), []
    for _ in range(200):
        a, b = values[rng.choice(len(values), 2, replace=False)]
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        lines.append(np.append(normal, normal @ a))
    return max(lines, key=lambda line: np.count_nonzero(np.abs(values @ line[:2] - line[2]) < threshold))


def points_on_a_line(rng, n, outliers):
    along, across = rng.uniform(-10, 10, n), 0.02 * rng.standard_normal(n)
    points = np.column_stack([1 + 0.8 * along - 0.6 * across, 2 + 0.6 * along + 0.8 * across])
    points[: int(outliers * n)] = rng.uniform(-12, 12, (int(outliers * n), 2))
    return points


@pytest.mark.parametrize("rule", ["tlp_0.1", "closest_pair", "fixed"])
@pytest.mark.parametrize("estimator", [TinyRansac(), best_line], ids=["object", "function"])
def test_a_users_own_problem_works_end_to_end(rng, rule, estimator):
    points = points_on_a_line(rng, 20_000, 0.8)
    settings = {"noise": 0.02, "samples": 6, "sample_size": 300, "rule": rule}
    result = estimate(ArraySource(points), naive.Line(), estimator, **settings)
    assert result.success
    assert_is_the_line(result)
    assert result.num_inliers == pytest.approx(0.2 * result.num_rows, rel=0.3)


def assert_is_the_line(result):
    a, b, c = result.model
    assert abs(a * 0.8 + b * 0.6) < 0.005
    assert abs(a * 1.0 + b * 2.0 - c) < 0.02


@pytest.mark.parametrize("noise", [0.02, None])
@pytest.mark.parametrize("refine", ["none", "union", "polish"])
def test_a_users_own_problem_needs_no_estimator(rng, refine, noise):
    result = estimate(ArraySource(points_on_a_line(rng, 20_000, 0.8)), naive.Line(), noise=noise, refine=refine)
    assert (result.success, result.info["estimator"]) == (True, "Ransac")
    assert_is_the_line(result)
    assert result.noise == pytest.approx(0.02, rel=0.3)
    assert result.inliers.sum() == pytest.approx(0.2 * 20_000, rel=0.1)
    assert not result.is_motion


@pytest.mark.slow
def test_a_users_own_problem_without_a_line_is_not_claimed(rng):
    points = rng.uniform(-12, 12, (20_000, 2))
    assert not estimate(ArraySource(points), naive.Line(), TinyRansac(), noise=0.02, samples=6, sample_size=300).success
    assert not estimate(ArraySource(points), naive.Line(), noise=0.02, max_samples=8).success


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.full((50, 2), np.nan), np.ones((50, 2))])
def test_what_stands_for_no_model_has_the_problems_own_shape(points):
    result = estimate(ArraySource(points), naive.Line(), noise=0.02, max_samples=2)
    assert not result.found
    assert result.model.shape == (3,)


def test_full_needs_a_problem_that_has_sums_for_it(rng):
    with pytest.raises(ValueError, match='refine="full" needs a problem with `streaming`, Line has none'):
        estimate(ArraySource(points_on_a_line(rng, 100, 0.5)), naive.Line(), noise=0.02, refine="full")


# --- rows with weights ------------------------------------------------------------------------------------------------


def test_one_column_more_than_the_layout_is_a_weight():
    weights = np.random.default_rng(1).uniform(0.5, 2.0, 1000)
    weights[::10] = 0.0
    estimator, spy = MockEstimator(), SpyRefiner()
    run(np.column_stack([shifted_rows(), weights]), estimator, refine=spy)
    for i, call in enumerate(estimator.calls):
        kept = sample_of(1000, i, 40)
        kept = kept[kept % 10 > 0]
        np.testing.assert_array_equal(numbers(call["rows"]), kept)
        np.testing.assert_array_equal(call["rows"].values, shifted_rows()[kept])
        np.testing.assert_array_equal(call["rows"].weights, weights[kept])
    np.testing.assert_array_equal(spy.rows.weights, weights[numbers(spy.rows)])


def test_weights_decide_between_two_answers(rng):
    rows = np.tile(rng.uniform(-10, 10, (2000, 1)), 2) + 0.02 * rng.standard_normal((2000, 2))
    rows[:1000, 1] += 3.0
    rows[1000:, 1] -= 4.0
    for heavy, shift in ((slice(0, 1000), 3.0), (slice(1000, 2000), -4.0)):
        weights = np.ones(2000)
        weights[heavy] = 10.0
        result = estimate(ArraySource(np.column_stack([rows, weights])), naive.Shift(), noise=0.03)
        assert shift_of(result) == pytest.approx(shift, abs=0.05)
        assert result.covariance is None


@pytest.mark.parametrize("useless", [0.0, np.nan])
def test_rows_without_a_weight_change_nothing(useless):
    """They take a place in the samples, but nobody sees them."""
    rows = np.column_stack([shifted_rows(), np.ones(1000)])
    rows[::7, 2] = useless
    result = run(rows, samples=2, sample_size=500)
    rows[::7, 1] = 1e6
    other = run(rows, samples=2, sample_size=500)
    np.testing.assert_array_equal(other.model, result.model)
    assert (other.num_rows, other.num_inliers) == (result.num_rows, result.num_inliers)
    assert result.num_rows == 1000 - len(rows[::7])


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
    np.testing.assert_array_equal(run().model, run(rule=TruncatedLp(0.1)).model)
