"""The checks that users run on their own parts: whatever is wrong with one, they say so, and name its class."""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest

import naive
import nonsac
from nonsac import ArraySource, Hypothesis, SpecialCase
from nonsac.method.refine import AsSelected
from nonsac.method.scoring import MostInliers
from nonsac.testing import check_estimator, check_problem, check_refiner, check_rule, check_source

TRUTH = naive.line_model(50.0, 0.3)
NOISE = 0.02


def exact_rows(n=60):
    along = np.random.default_rng(0).standard_normal((n, 1))
    return TRUTH[2] * TRUTH[:2] + along * [-TRUTH[1], TRUTH[0]]


def noisy_rows(n=600):
    """Of which half belong to the line."""
    rng = np.random.default_rng(1)
    rows = rng.uniform(-2, 2, (n, 2))
    rows[: n // 2] = exact_rows(n // 2) + NOISE * rng.standard_normal((n // 2, 2))
    return rng.permutation(rows)


def refusal(check, part, *rest):
    """What a check says of a part."""
    with pytest.raises(AssertionError) as caught:
        check(part, *rest)
    message = str(caught.value)
    assert "\n" not in message
    return message


# --- problems ---------------------------------------------------------------------------------------------------------


class Line(naive.Line):
    """A right one, of which single parts can be broken."""

    def solve_minimal(self, samples):
        return np.array([naive.Line.refit(self, None, sample, np.ones(2)) for sample in samples])


class Other:
    """Derived from nothing."""


class WrongShape(Line):
    def solve_minimal(self, samples):
        return super().solve_minimal(samples)[:, :2]


class OneModelForEach(Line):
    """Gives models that are not stacked."""

    def solve_minimal(self, samples):
        return super().solve_minimal(samples)[0]


class NoModels(Line):
    def solve_minimal(self, samples):
        return np.empty((0, 3))


class NanModels(Line):
    def solve_minimal(self, samples):
        return np.full((len(samples), 3), np.nan)


class OtherLines(Line):
    """Does not explain its rows."""

    def solve_minimal(self, samples):
        return super().solve_minimal(samples) + np.array([0.0, 0.0, 0.1])


class ChangesSamples(Line):
    def solve_minimal(self, samples):
        models = super().solve_minimal(samples)
        samples += 1.0
        return models


class FailingSolver(Line):
    def solve_minimal(self, samples):
        raise ZeroDivisionError("by zero")


class Signed(Line):
    """Gives distances with a sign."""

    def residuals(self, models, rows):
        return models[:, :1] * rows[:, 0] + models[:, 1:2] * rows[:, 1] - models[:, 2:]


class Transposed(Line):
    def residuals(self, models, rows):
        return super().residuals(models, rows).T


class FirstModelOnly(Line):
    def residuals(self, models, rows):
        return super().residuals(models[:1], rows)


class Flat(Line):
    """Forgets the models of which there is one."""

    def residuals(self, models, rows):
        return super().residuals(models, rows)[0]


class ComparedToTheFirst(Line):
    def residuals(self, models, rows):
        return super().residuals(np.broadcast_to(models[:1], models.shape), rows)


class Squared(Line):
    """Gives squares of distances."""

    def residuals(self, models, rows):
        return super().residuals(models, rows) ** 2


class Misspelt(Line):
    def special_case(self, model, inliers, noise):
        return ()


class ChangesRows(Line):
    def residuals(self, models, rows):
        residuals = super().residuals(models, rows)
        if len(models) > 1:
            rows *= 2.0
        return residuals


class NeedsRows(Line):
    def residuals(self, models, rows):
        return super().residuals(models, rows) + 0.0 * rows.max()


class ListOfResiduals(Line):
    def residuals(self, models, rows):
        return super().residuals(models, rows).tolist()


class CountsOutliers(Line):
    def count_inliers(self, models, rows, threshold, weights=None):
        return len(rows) - super().count_inliers(models, rows, threshold, weights)


class IgnoresWeights(Line):
    def count_inliers(self, models, rows, threshold, weights=None):
        return super().count_inliers(models, rows, threshold)


class CountsAll(Line):
    """One number for all models."""

    def count_inliers(self, models, rows, threshold, weights=None):
        return super().count_inliers(models, rows, threshold, weights).sum()


class OffRefit(Line):
    def refit(self, model, rows, weights):
        return super().refit(model, rows, weights) + np.array([0.0, 0.0, 0.01])


class NoRefit(Line):
    def refit(self, model, rows, weights):
        return self.no_model


class FlatRefit(Line):
    def refit(self, model, rows, weights):
        return super().refit(model, rows, weights)[:2]


class EqualRefit(Line):
    """Fits rows without a weight, too."""

    def refit(self, model, rows, weights):
        return super().refit(model, rows, np.ones(len(rows)))


class OffRobustFit(Line):
    def fit_robustly(self, model, rows, weights, threshold, iterations):
        return super().fit_robustly(model, rows, weights, threshold, iterations) + np.array([0.0, 0.0, 0.01])


class NeverDetermined(Line):
    def determined(self, model, inliers, noise):
        return False


class UndeterminedWithoutModel(Line):
    def determined(self, model, inliers, noise):
        return bool(np.isfinite(model).all())


class FlatDistance(Line):
    def distance(self, a, b):
        return float(np.abs(a - b).max())


class DirectedDistance(Line):
    def distance(self, a, b):
        return np.maximum(np.asarray(a) - b, 0.0).sum(axis=-1)


class NoDistance(Line):
    def distance(self, a, b):
        return 0.0 * super().distance(a, b)


class FarFromItself(Line):
    def distance(self, a, b):
        return 1.0 + np.abs(np.asarray(a) - b).max(axis=-1)


class NearNothing(Line):
    def distance(self, a, b):
        return np.nan_to_num(np.abs(np.asarray(a) - b).max(axis=-1))


class LoudDistance(Line):
    def distance(self, a, b):
        if not np.isfinite(b).all():
            warnings.warn("no model", stacklevel=2)
        return np.abs(np.asarray(a) - b).max(axis=-1)


class OtherAverage(Line):
    def average(self, models, rows):
        return models[0] + [0.0, 0.0, 0.1]


class AverageOfRows(Line):
    def average(self, models, rows):
        return models[0] if len(rows) else models


class ShortBackground(Line):
    def background(self, rows, size, rng):
        return super().background(rows, size // 2, rng)


class EndlessBackground(Line):
    def background(self, rows, size, rng):
        return super().background(rows, size, rng) + np.where(np.arange(size) == 7, np.inf, 0.0)[:, None]


class OtherBackground(Line):
    """Uses random numbers of its own."""

    own = np.random.default_rng(0)

    def background(self, rows, size, rng):
        return super().background(rows, size, self.own)


class WordCase(Line):
    def special_cases(self, model, inliers, noise):
        return ["planar"]


class ShortCase(Line):
    def special_cases(self, model, inliers, noise):
        return [SpecialCase("planar", np.ones(3, bool), True)]


class FlatTransform(Line):
    def transform(self, model):
        return np.eye(3)


class FlatCovariance(Line):
    def covariance(self, model, inliers, noise):
        return np.ones(3)


class SaysNothing(Line):
    def describe(self, model):
        return None


class Stays(Line):
    """Does not travel."""

    def __init__(self):
        self.function = lambda: None


class Forgetful(Line):
    """Arrives as another one."""

    def __init__(self, offset=0.0):
        self.offset = offset

    def __reduce__(self):
        return Forgetful, (1.0,)

    def residuals(self, models, rows):
        return super().residuals(models, rows + self.offset) if self.offset else super().residuals(models, rows)


PROBLEMS = {
    Other: "is not derived from nonsac.Problem",
    WrongShape: ".solve_minimal gave models of the shape (2,) instead of (3,): return (M, *model_shape)",
    OneModelForEach: ".solve_minimal gave models of the shape () instead of (3,): return (M, *model_shape)",
    NoModels: ".solve_minimal gives no model for samples of rows of one model",
    NanModels: ".solve_minimal gives models of NaN or infinity only",
    OtherLines: "explains all rows: the best one has residuals up to 0.1, rows that do not belong to it have",
    ChangesSamples: ".solve_minimal changes the samples that it is given",
    FailingSolver: " raised ZeroDivisionError: by zero",
    Signed: ".residuals gave negative numbers; they are lengths",
    Transposed: ".residuals gave (60, 20) for 20 models and 60 rows",
    FirstModelOnly: ".residuals gave (1, 60) for 20 models and 60 rows",
    Flat: ".residuals gave (60,) for 20 models and 60 rows",
    ComparedToTheFirst: ".residuals of several models are not those of each by itself",
    Squared: ".residuals grow by a factor of 4 if rows go twice as far from a model; they are lengths, no squares",
    Misspelt: ".special_case is not part of nonsac.Problem: was `special_cases` meant?",
    ChangesRows: ".residuals changes the rows that it is given",
    NeedsRows: ".residuals fails for no rows: it raised ValueError: zero-size array",
    ListOfResiduals: ".residuals gave a list, not an array",
    CountsOutliers: ".count_inliers is not the number of small residuals",
    IgnoresWeights: ".count_inliers does not add up the weights",
    CountsAll: ".count_inliers is not the number of small residuals",
    OffRefit: ".refit to weighted rows leaves residuals up to 0.01",
    NoRefit: ".refit to exact rows gives no model",
    FlatRefit: ".refit gave a model of the shape (2,)",
    EqualRefit: ".refit to rows beside others without a weight leaves residuals up to",
    OffRobustFit: ".fit_robustly leaves residuals up to 0.01",
    NeverDetermined: ".determined is false for many exact rows",
    UndeterminedWithoutModel: ".determined is false for a model of NaN",
    FlatDistance: ".distance does not broadcast",
    DirectedDistance: ".distance is not symmetric",
    NoDistance: ".distance of different models is 0",
    FarFromItself: ".distance of a model to itself is not 0",
    NearNothing: ".distance to no model must be NaN",
    LoudDistance: ".distance raised UserWarning: no model",
    OtherAverage: ".average of three equal models is another one",
    AverageOfRows: ".average gave a model of the shape (3, 3)",
    ShortBackground: ".background gave (250, 2) instead of (500, D)",
    EndlessBackground: ".background gave rows that are not finite",
    OtherBackground: ".background gives other rows for the same random numbers",
    WordCase: ".special_cases gave a str",
    ShortCase: ".special_cases: `explains` must have one value for each row",
    FlatTransform: ".transform gave (3, 3) instead of (4, 4)",
    FlatCovariance: ".covariance gave (3,) instead of (p, p)",
    SaysNothing: ".describe must give a string",
    Stays: "does not travel to other processes (pickle): it raised",
    Forgetful: "gives other residuals after a journey to another process (pickle)",
}


@pytest.mark.parametrize("kind", PROBLEMS, ids=lambda kind: kind.__name__)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_broken_problem_is_refused(kind):
    message = refusal(check_problem, kind(), exact_rows())
    assert kind.__name__ in message
    assert PROBLEMS[kind] in message


def test_a_right_problem_is_not():
    check_problem(Line(), exact_rows())
    check_problem(Line(), exact_rows(12).tolist())


@pytest.mark.parametrize("rows", [exact_rows(11), exact_rows()[:, :1], exact_rows()[0], np.ones((60, 3))])
def test_rows_that_do_not_serve_to_check_a_problem_are_refused(rows):
    message = refusal(check_problem, Line(), rows)
    assert message == f"rows must have the shape (n, 2) with n of at least 12, got {rows.shape}"


def test_what_counts_as_zero_can_be_told():
    """A solver that is right to three digits."""

    class Rough(Line):
        def solve_minimal(self, samples):
            return super().solve_minimal(samples) + np.array([0.0, 0.0, 1e-4])

    assert "explains all rows" in refusal(check_problem, Rough(), exact_rows())
    assert "does not travel" in refusal(lambda problem: check_problem(problem, exact_rows(), tolerance=0.01), Rough())


# --- estimators -------------------------------------------------------------------------------------------------------


class Search(nonsac.Estimator):
    """A right one, of which single parts can be broken."""

    def estimate(self, problem, rows, noise, rng):
        samples = np.stack([rng.choice(len(rows), 2) for _ in range(200)])
        samples = rows.values[samples[(rows.values[samples[:, 0]] != rows.values[samples[:, 1]]).any(axis=1)]]
        if not len(samples):
            return Hypothesis(problem.no_model, np.full(len(rows), np.inf), noise.threshold, tested=200)
        models = problem.solve_minimal(samples)
        best = models[np.argmax(problem.count_inliers(models, rows.values, noise.threshold))]
        return Hypothesis(best, problem.residuals(best[None], rows.values)[0], noise.threshold, tested=200)


class FlatModel(Search):
    def estimate(self, problem, rows, noise, rng):
        found = super().estimate(problem, rows, noise, rng)
        return replace(found, model=found.model[:2])


class ModelOnly(Search):
    def estimate(self, problem, rows, noise, rng):
        return super().estimate(problem, rows, noise, rng).model


class FindsNothing(Search):
    def estimate(self, problem, rows, noise, rng):
        return Hypothesis(problem.no_model, np.full(len(rows), np.inf), noise.threshold)


class SortsRows(Search):
    def estimate(self, problem, rows, noise, rng):
        rows.values.sort(axis=0)
        return super().estimate(problem, rows, noise, rng)


class OtherThreshold(Search):
    def estimate(self, problem, rows, noise, rng):
        return replace(super().estimate(problem, rows, noise, rng), threshold=2 * noise.threshold)


class WithoutSupport(Search):
    def estimate(self, problem, rows, noise, rng):
        found = super().estimate(problem, rows, noise, rng)
        return replace(found, residuals=np.full(len(rows), 2 * noise.threshold))


class TwiceAsManyResiduals(Search):
    def estimate(self, problem, rows, noise, rng):
        found = super().estimate(problem, rows, noise, rng)
        return replace(found, residuals=np.repeat(found.residuals, 2))


class TestedNothing(Search):
    def estimate(self, problem, rows, noise, rng):
        return replace(super().estimate(problem, rows, noise, rng), tested=0)


class OwnNumbers(Search):
    """Uses random numbers of its own."""

    own = np.random.default_rng(0)

    def estimate(self, problem, rows, noise, rng):
        return super().estimate(problem, rows, noise, self.own)


class Homesick(Search):
    """Finds another model elsewhere."""

    def __init__(self, is_home=True):
        self.is_home = is_home

    def __reduce__(self):
        return Homesick, (False,)

    def estimate(self, problem, rows, noise, rng):
        return super().estimate(problem, rows, noise, rng if self.is_home else np.random.default_rng(9))


class StaysHere(Search):
    def __init__(self):
        self.function = lambda: None


class Credulous(Search):
    """Finds a model in anything."""

    def estimate(self, problem, rows, noise, rng):
        model = problem.refit(None, rows.values, np.ones(len(rows)))
        found = super().estimate(problem, rows, noise, rng)
        return found if found.found else Hypothesis(model, np.zeros(len(rows)), noise.threshold)


class NeedsManyRows(Search):
    def estimate(self, problem, rows, noise, rng):
        if len(rows) < 10:
            raise ValueError("ten rows are needed")
        return super().estimate(problem, rows, noise, rng)


class WithoutWeights(Search):
    def estimate(self, problem, rows, noise, rng):
        if rows.weights is None:
            return super().estimate(problem, rows, noise, rng)
        return Hypothesis(problem.no_model, np.full(len(rows), np.inf), noise.threshold)


class NoBudget(Search):
    def with_budget(self, factor):
        return None


class Refusing(Search):
    def check(self, problem):
        raise TypeError("Refusing needs another problem")


ESTIMATORS = {
    Other: "is not derived from nonsac.Estimator",
    FlatModel: ".estimate gave a model of (2,), not (3,)",
    ModelOnly: ".estimate gave a ndarray, not a nonsac.Hypothesis",
    FindsNothing: ".estimate finds no model in these rows",
    SortsRows: ".estimate changes the rows that it is given",
    OtherThreshold: ".estimate gives another threshold than noise.threshold",
    WithoutSupport: ".estimate finds a model without support",
    TwiceAsManyResiduals: ".estimate gives residuals of the shape (1200,) for 600 rows",
    TestedNothing: " tells that it tested 0 models",
    OwnNumbers: " gives another model for the same random numbers",
    Homesick: " gives another model in another process (pickle)",
    StaysHere: " does not travel to other processes (pickle): it raised",
    Credulous: " finds a model in copies of one row, which determine none",
    NeedsManyRows: " raised ValueError: ten rows are needed",
    WithoutWeights: " finds no model if rows have weights",
    NoBudget: ".with_budget gives a NoneType",
    Refusing: " raised TypeError: Refusing needs another problem",
}


@pytest.mark.parametrize("kind", ESTIMATORS, ids=lambda kind: kind.__name__)
def test_a_broken_estimator_is_refused(kind):
    message = refusal(check_estimator, kind(), Line(), noisy_rows(), NOISE)
    assert kind.__name__ in message
    assert ESTIMATORS[kind] in message


def test_a_right_estimator_is_not():
    check_estimator(Search(), Line(), noisy_rows(), NOISE)
    check_estimator(Search(), Line(), noisy_rows().tolist(), NOISE)


# --- rules ------------------------------------------------------------------------------------------------------------


class MostRows(nonsac.ScoringRule):
    """A right one, of which single parts can be broken."""

    name = "most_rows"

    def scores(self, hypotheses, problem):
        return np.array([h.num_inliers if h.found else -np.inf for h in hypotheses], float)


class Nameless(MostRows):
    name = ""


class Numbered(MostRows):
    name = 7


class GivesNan(MostRows):
    """The mean of no inliers."""

    def scores(self, hypotheses, problem):
        return np.array([np.mean([r for r in h.residuals if r < h.threshold] or [np.nan]) for h in hypotheses])


class OneScore(MostRows):
    def scores(self, hypotheses, problem):
        return max(super().scores(hypotheses, problem))


class FoundOnly(MostRows):
    def scores(self, hypotheses, problem):
        return super().scores([h for h in hypotheses if h.found], problem)


class NobodyWins(MostRows):
    def scores(self, hypotheses, problem):
        return np.full(len(hypotheses), -np.inf)


class NeedsInliers(MostRows):
    def scores(self, hypotheses, problem):
        return np.array([-min(r for r in h.residuals if r < h.threshold) for h in hypotheses])


class Renamed(MostRows):
    def __init__(self, name="here"):
        self.name = name

    def __reduce__(self):
        return Renamed, ("there",)


class RuleThatStays(MostRows):
    def __init__(self):
        self.function = lambda: None


RULES = {
    Other: "is not derived from nonsac.ScoringRule",
    Nameless: ".name must be a string, got ''",
    Numbered: ".name must be a string, got 7",
    GivesNan: ".scores gave NaN; use -inf for what must not win",
    OneScore: ".scores gave () for 6 of them",
    FoundOnly: ".scores gave (5,) for 6 of them",
    NobodyWins: ".scores lets no hypothesis win",
    NeedsInliers: " raised ValueError: min() ",
    Renamed: " has another name after a journey to another process (pickle)",
    RuleThatStays: " does not travel to other processes (pickle): it raised",
}


@pytest.mark.parametrize("kind", RULES, ids=lambda kind: kind.__name__)
def test_a_broken_rule_is_refused(kind):
    message = refusal(check_rule, kind(), Line())
    assert kind.__name__ in message
    assert RULES[kind] in message


def test_a_right_rule_is_not():
    check_rule(MostRows(), Line())
    check_rule(MostInliers(), naive.Shift())


# --- refiners ---------------------------------------------------------------------------------------------------------


class Winner(nonsac.Refiner):
    """A right one, of which single parts can be broken."""

    def refine(self, search, winner):
        return nonsac.Refinement.of(search, search.hypotheses[winner].model)


class FarOff(Winner):
    def refine(self, search, winner):
        return nonsac.Refinement.of(search, naive.line_model(140.0, 5.0))


class FlatAnswer(Winner):
    def refine(self, search, winner):
        refined = super().refine(search, winner)
        return replace(refined, model=refined.model[:2])


class CountsRounds(Winner):
    """Gives another model each time."""

    rounds = 0

    def refine(self, search, winner):
        CountsRounds.rounds += 1
        return nonsac.Refinement.of(
            search, search.hypotheses[winner].model + np.array([0, 0, 1e-4 * CountsRounds.rounds])
        )


class TooSure(Winner):
    def refine(self, search, winner):
        return replace(super().refine(search, winner), confidence=2.0)


class CountsTooMany(Winner):
    def refine(self, search, winner):
        return replace(super().refine(search, winner), num_inliers=10**6)


class FindsNoInliers(Winner):
    def refine(self, search, winner):
        return replace(super().refine(search, winner), num_inliers=0)


class GivesModel(Winner):
    def refine(self, search, winner):
        return search.hypotheses[winner].model


class FailingRefiner(Winner):
    def refine(self, search, winner):
        raise ZeroDivisionError("by zero")


class PickyRefiner(Winner):
    def check(self, problem):
        raise ValueError("another problem is needed")


REFINERS = {
    Other: "is not derived from nonsac.Refiner",
    FarOff: " gives an answer that is not trusted: low_support, with a confidence of 0",
    FlatAnswer: ".refine gave a model of the shape (2,)",
    CountsRounds: " gives another model for another number of workers",
    TooSure: " gives a confidence of 2.0",
    CountsTooMany: ": 1000000 inliers of 600 rows",
    FindsNoInliers: ": 0 inliers of 600 rows",
    GivesModel: ".refine must give a nonsac.Refinement, got ndarray",
    FailingRefiner: " raised ZeroDivisionError: by zero",
    PickyRefiner: " raised ValueError: another problem is needed",
}


@pytest.mark.parametrize("kind", REFINERS, ids=lambda kind: kind.__name__)
def test_a_broken_refiner_is_refused(kind):
    message = refusal(check_refiner, kind(), Line(), noisy_rows(), NOISE)
    assert kind.__name__ in message
    assert REFINERS[kind] in message


def test_a_right_refiner_is_not():
    check_refiner(Winner(), Line(), noisy_rows(), NOISE)
    check_refiner(AsSelected(), Line(), noisy_rows().tolist(), NOISE)


# --- sources ----------------------------------------------------------------------------------------------------------

TABLE = np.arange(60.0).reshape(20, 3)


class Table(nonsac.Source):
    """A right one, of which single parts can be broken."""

    def __init__(self, rows=TABLE):
        self.rows = rows

    def __len__(self):
        return len(self.rows)

    def take(self, indices):
        return self.rows[self.checked(indices)]


class TooShort(Table):
    def __len__(self):
        return 19


class TooWide(Table):
    width = 4


class NextRows(Table):
    def take(self, indices):
        return super().take(np.minimum(self.checked(indices) + 1, 19))


class SortedRows(Table):
    """Does not keep to the order that is asked for."""

    def take(self, indices):
        return super().take(np.sort(indices))


class NoRowsFails(Table):
    width = 3

    def take(self, indices):
        return np.vstack([Table.take(self, np.array([number])) for number in indices])


class SingleRows(Table):
    def take(self, indices):
        return super().take(indices).astype(np.float32)


class Sideways(Table):
    def take(self, indices):
        return np.asfortranarray(super().take(indices))


class ReadOnly(Table):
    def take(self, indices):
        rows = super().take(indices)
        rows.flags.writeable = False
        return rows


class ItsOwnRows(Table):
    """Gives rows that are not fresh."""

    def __init__(self):
        super().__init__(TABLE.copy())

    def take(self, indices):
        indices = self.checked(indices)
        if len(indices) == 2 and indices[1] == indices[0] + 1:
            return self.rows[indices[0] : indices[0] + 2]
        return super().take(indices)


class WrapsAround(Table):
    def take(self, indices):
        return self.rows[np.asarray(indices) % 20]


class CountsFromTheEnd(Table):
    def take(self, indices):
        return self.rows[np.asarray(indices)].copy()


class GivesNanRows(Table):
    """For rows that do not exist."""

    def take(self, indices):
        indices = np.asarray(indices)
        inside = (indices >= 0) & (indices < 20)
        return np.where(inside[:, None], self.rows[np.where(inside, indices, 0)], np.nan)


class OtherError(Table):
    def take(self, indices):
        if len(indices) and max(np.abs(indices)) >= 20:
            raise ValueError("no such row")
        return super().take(indices)


class UnevenChunks(Table):
    def chunks(self, rows, start=0, stop=None):
        for chunk in super().chunks(rows, start, stop):
            yield from np.array_split(chunk, 2) if len(chunk) > 1 else [chunk]


class WholeChunks(Table):
    """Forgets from where to where."""

    def chunks(self, rows, start=0, stop=None):
        return super().chunks(rows)


class LosesTheRest(Table):
    def chunks(self, rows, start=0, stop=None):
        return (chunk for chunk in super().chunks(rows, start, stop) if len(chunk) == rows)


class OpenEnd(Table):
    """Takes the end at its word."""

    def chunks(self, rows, start=0, stop=None):
        stop = 20 if stop is None else stop
        for first in range(start, stop, rows):
            yield self.take(np.arange(first, min(first + rows, stop)))


class SingleChunks(Table):
    def chunks(self, rows, start=0, stop=None):
        return (chunk.astype(np.float32) for chunk in super().chunks(rows, start, stop))


class ArrivesEmpty(Table):
    def __reduce__(self):
        return ArrivesEmpty, (np.zeros((20, 3)),)


class SourceThatStays(Table):
    def __init__(self):
        super().__init__()
        self.file = open(__file__)  # noqa: SIM115

    def __del__(self):
        self.file.close()


SOURCES = {
    Other: "is not derived from nonsac.Source",
    TooShort: " has 19 x 3, not (20, 3)",
    TooWide: " has 20 x 4, not (20, 3)",
    NextRows: " takes other rows than asked for",
    SortedRows: " takes other rows than asked for",
    NoRowsFails: " raised ValueError: need at least one array to concatenate",
    SingleRows: ".take must give a fresh, writable, C-order float64 array",
    Sideways: ".take must give a fresh, writable, C-order float64 array",
    ReadOnly: ".take must give a fresh, writable, C-order float64 array",
    ItsOwnRows: " takes other rows than asked for",
    WrapsAround: ".take must raise IndexError for row 20",
    CountsFromTheEnd: ".take must raise IndexError for row -1",
    GivesNanRows: ".take must raise IndexError for row 20",
    OtherError: " raised ValueError: no such row",
    UnevenChunks: ".chunks(4) gives chunks of other sizes",
    WholeChunks: ".chunks are not all rows in order",
    LosesTheRest: ".chunks are not all rows in order",
    OpenEnd: " raised IndexError: there is no row",
    SingleChunks: ".chunks must give fresh, writable, C-order float64 arrays",
    ArrivesEmpty: ", after a journey to another process (pickle), takes other rows than asked for",
    SourceThatStays: " does not travel to other processes (pickle): it raised TypeError",
}


@pytest.mark.parametrize("kind", SOURCES, ids=lambda kind: kind.__name__)
def test_a_broken_source_is_refused(kind):
    message = refusal(check_source, kind(), TABLE)
    assert kind.__name__ in message
    assert SOURCES[kind] in message


def test_a_right_source_is_not():
    check_source(Table(), TABLE)
    check_source(Table(), TABLE.tolist())
    check_source(ArraySource(TABLE[:3]), TABLE[:3])


# --- what is common to them -------------------------------------------------------------------------------------------


class Asserting(Table):
    """Has an assertion of its own."""

    def take(self, indices):
        if len(indices):
            raise AssertionError("a thought\nof several lines")
        return TABLE[:0]


@dataclass(frozen=True)
class Broken(MostRows):
    limit: float = 0.5

    def scores(self, hypotheses, problem):
        raise KeyError(self.limit)


def test_what_a_part_raises_is_the_cause():
    with pytest.raises(AssertionError, match=r"^Broken raised KeyError: 0\.5$") as caught:
        check_rule(Broken(), Line())
    assert isinstance(caught.value.__cause__, KeyError)
    assert refusal(check_source, Asserting(), TABLE) == "Asserting raised AssertionError: a thought of several lines"


@pytest.mark.parametrize("check", [check_problem, check_estimator, check_rule, check_refiner, check_source])
def test_classes_are_told_from_objects(check):
    rest = {check_problem: (exact_rows(),), check_rule: (Line(),), check_source: (TABLE,)}
    message = refusal(check, Table, *rest.get(check, (Line(), noisy_rows(), NOISE)))
    assert "is not derived from nonsac." in message


def test_checks_are_documented_under_their_own_names():
    assert nonsac.testing.__all__ == sorted(check.__name__ for check in (
        check_problem, check_estimator, check_rule, check_refiner, check_source))  # fmt: skip
    assert all("AssertionError" in check.__doc__ for check in (check_problem, check_source))
