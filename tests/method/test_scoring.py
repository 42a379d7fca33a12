import inspect
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive
from nonsac import Estimator
from nonsac.method import scoring
from nonsac.method.scoring import (
    ClosestPair,
    ClosestTriplet,
    FixedSample,
    Ideal,
    MinimumMean,
    MinimumQuantile,
    MostInliers,
    NearestToAverage,
    PairCost,
    ScoringRule,
    TruncatedLp,
    by_name,
    paper_rules,
    scored,
    select,
)
from nonsac.result import Hypothesis
from nonsac.testing import check_rule

NAMES = [
    *("most_inliers", "closest_pair", "closest_triplet", "minimum_mean", "minimum_median", "minimum_q3"),
    *("pair_0.02", "pair_0.05", "pair_0.1", "pair_0.2", "pair_0.5", "pair_1"),
    *("tlp_0.01", "tlp_0.1", "tlp_0.2", "tlp_0.3", "tlp_0.5", "tlp_1", "tlp_2"),
]
AVERAGES = [NearestToAverage(kind) for kind in ("l1", "trimmed", "truncated")]
RULES = [*paper_rules(), FixedSample(), *AVERAGES, Ideal(naive.shift_model(0.0))]
rules = pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
problem = naive.Shift()


def hypothesis(shift, residuals, threshold=1.0):
    return Hypothesis(naive.shift_model(shift), np.array(residuals, float), threshold)


def nothing(rows=5, threshold=1.0):
    return Hypothesis(np.full((3, 4), np.nan), np.full(rows, np.inf), threshold)


def winner(rule, hypotheses):
    return select(rule, hypotheses, problem)[0]


def random_hypotheses(seed, m=6, n=12):
    rng = np.random.default_rng(seed)
    return [hypothesis(rng.normal(scale=30), np.abs(rng.standard_cauchy(n)) + 1e-3) for _ in range(m)]


# Five models on a line, inlier threshold 1:
#
#           place   inliers   mean   median   upper quartile
#   0        -100         5    .2      .2      .2
#   1          50         2    .11     .11     .05 + .75 * .12 = .14
#   2          51         3    .13     .13     .13
#   3          20         4    .5      .5      .5
#   4          24         4    .24     .02     .02 + .25 * .88 = .24
FIVE = [
    hypothesis(-100, [0.2, 0.2, 0.2, 0.2, 0.2]),
    hypothesis(50, [0.05, 0.17, 2, 2, 2]),
    hypothesis(51, [0.13, 0.13, 0.13, 3, 3]),
    hypothesis(20, [0.5, 0.5, 0.5, 0.5, 9]),
    hypothesis(24, [0.02, 0.02, 0.02, 0.9, 9]),
]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("most_inliers", 0),
        ("closest_pair", 2),  # 1 and 2 are 1 apart; 2 has more inliers
        ("closest_triplet", 4),  # 1, 2 and 4: at most 27 apart; next is 1, 3 and 4 with 30
        ("minimum_mean", 1),
        ("minimum_median", 4),
        ("minimum_q3", 2),
        # max(n_i, n_j) / d^k of (1, 2), (3, 4) and (0, 3):
        ("pair_1", 2),  # 3, 4 / 4 = 1, 5 / 120 = .04
        ("pair_0.5", 2),  # 3, 4 / 2 = 2, .46
        ("pair_0.2", 3),  # 3, 4 / 1.32 = 3.03, 1.92; of 3 and 4, with 4 inliers each, the earlier
        ("pair_0.1", 3),  # 3, 3.48, 3.10
        ("pair_0.05", 0),  # 3, 3.73, 3.94
        ("pair_0.02", 0),  # 3, 3.89, 4.54
        ("fixed", 0),
        ("l1_average", 4),  # sums of distances 645, 207, 209, 181, 177
        ("truncated_average", 1),  # each at most 10: 40, 31, 31, 34, 34; of 50 and 51 the earlier
    ],
)
def test_rules_on_five_models_worked_by_hand(name, expected):
    assert winner(by_name(name), FIVE) == expected


def test_scores_worked_by_hand():
    minus = -np.inf
    expected = {
        "most_inliers": [5, 2, 3, 4, 4],
        "closest_pair": [minus, 2, 3, minus, minus],
        "closest_triplet": [minus, 2, 3, minus, 4],
        "minimum_mean": [-0.2, -0.11, -0.13, -0.5, -0.24],
        "minimum_median": [-0.2, -0.11, -0.13, -0.5, -0.02],
        "minimum_q3": [-0.2, -0.14, -0.13, -0.5, -0.24],
        "pair_1": [minus, 2, 3, minus, minus],
        "tlp_1": [-1.0, -3.22, -2.39, -3.0, -1.96],
        "tlp_2": [-0.2, -3.0314, -2.0507, -2.0, -1.8112],
    }
    for name, scores in expected.items():
        np.testing.assert_allclose(select(by_name(name), FIVE, problem)[1], scores, rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("p", "costs"),
    [
        (2.0, [8.0002, 7.0]),  # 2 * .01^2 + 2 * 2^2, 3 * 1 + 2^2
        (1.0, [4.02, 5.0]),  # 2 * .01 + 2 * 2, 3 + 2
        (0.1, [3.4055, 4.0718]),  # 2 * .63096 + 2 * 1.07177, 3 + 1.07177
    ],
)
def test_truncated_lp_worked_by_hand(p, costs):
    two = [hypothesis(0, [0.01, 0.01, 2.5, 9.0], threshold=2.0), hypothesis(5, [1, 1, 1, np.inf], threshold=2.0)]
    index, scores = select(TruncatedLp(p), two, problem)
    np.testing.assert_allclose(scores, -np.array(costs), atol=1e-4)
    assert index == int(np.argmin(costs))


def test_ideal_is_closest_to_the_truth():
    index, scores = select(Ideal(naive.shift_model(22.5)), FIVE, problem)
    assert index == 4
    np.testing.assert_allclose(scores, [-122.5, -27.5, -28.5, -2.5, -1.5])


def test_ideal_takes_a_4x4_truth():
    assert winner(Ideal(np.vstack([naive.shift_model(50.2), [0, 0, 0, 1]])), FIVE) == 1


def test_a_residual_equal_to_the_threshold_is_no_inlier():
    assert winner(MostInliers(), [hypothesis(0, [1.0, 1.0, 1.0]), hypothesis(9, [0.5, 5, 5])]) == 1


@rules
def test_ties_go_to_the_earlier_sample(rule):
    same = [hypothesis(3.0, [0.5, 0.5, 2.0]) for _ in range(4)]
    assert winner(rule, same) == 0
    assert winner(rule, [hypothesis(800.0, [0.9, 3, 3]), *same]) == 1


def test_closest_pair_prefers_the_earlier_of_two_equally_close_pairs():
    places = [hypothesis(x, [0.5, 2]) for x in (0.0, 10.0, 1.0, 11.0)]
    assert winner(ClosestPair(), places) == 0


@rules
@pytest.mark.parametrize("m", [1, 2])
def test_one_or_two_hypotheses_are_enough(rule, m):
    hypotheses = [hypothesis(0.0, [0.5, 0.5, 2]), hypothesis(7.0, [0.6, 2, 2])][:m]
    assert winner(rule, hypotheses) == 0


def test_two_models_for_the_closest_triplet_are_compared_by_inliers():
    assert winner(ClosestTriplet(), [hypothesis(0, [0.5, 2]), hypothesis(7, [0.5, 0.5])]) == 1


@rules
@pytest.mark.parametrize("found", [[0], [2], [4], [1, 3], [3, 4], [0, 2, 4], [1, 2, 3, 4]])
def test_a_hypothesis_without_a_model_never_beats_one_with(rule, found):
    hypotheses = [FIVE[i] if i in found else nothing() for i in range(5)]
    index, scores = select(rule, hypotheses, problem)
    assert index in found
    assert all(scores[i] == -np.inf for i in range(5) if i not in found)


@rules
def test_a_model_without_inliers_still_beats_no_model(rule):
    assert winner(rule, [nothing(3), hypothesis(0, [5.0, 5, 5]), nothing(3)]) == 1


@rules
@pytest.mark.parametrize("m", [1, 2, 5])
def test_no_model_at_all_is_no_error(rule, m):
    index, scores = select(rule, [nothing()] * m, problem)
    assert 0 <= index < m
    assert (scores == -np.inf).all()


@pytest.mark.parametrize("k", [0.02, 0.1, 1.0, 2.0])
def test_equal_models_beat_all_unequal_pairs(k):
    hypotheses = [
        hypothesis(0, [0.1] * 50),
        hypothesis(1e-6, [0.1] * 49 + [2]),
        hypothesis(9, [0.5] * 9 + [2] * 41),
        hypothesis(9, [0.5] * 12 + [2] * 38),
    ]
    assert winner(PairCost(k), hypotheses[1:]) == 2
    assert winner(ClosestPair(), hypotheses) == 3


@pytest.mark.parametrize("k", [0.02, 0.1, 1.0, 2.0])
def test_among_equal_pairs_the_inliers_decide(k):
    few, many = [0.5] * 5 + [2] * 5, [0.5] * 8 + [2] * 2
    hypotheses = [hypothesis(3, few), hypothesis(3, few), hypothesis(9, many), hypothesis(9, many)]
    assert winner(PairCost(k), hypotheses) == 2


@rules
def test_a_residual_of_nan_counts_as_an_outlier(rule):
    broken = hypothesis(800.0, [np.nan, np.nan, np.nan, 0.9])
    good = [hypothesis(x, [0.1, 0.1, 0.1, 0.1]) for x in (0.0, 1.0, 2.0)]
    assert winner(rule, [broken, *good]) != 0


@pytest.mark.parametrize("name", NAMES)
def test_rules_equal_their_formulas_on_random_cases(name):
    for seed in range(60):
        hypotheses = random_hypotheses(seed, m=3 + seed % 6)
        assert winner(by_name(name), hypotheses) == naive.scoring_rules()[name](hypotheses, problem.distance)


def test_there_is_an_oracle_for_every_rule_of_the_paper():
    assert [rule.name for rule in paper_rules()] == NAMES == list(naive.scoring_rules())


@rules
@given(seed=st.integers(0, 2**32), order=st.permutations(range(6)))
def test_permuting_the_hypotheses_permutes_the_scores(rule, seed, order):
    hypotheses = random_hypotheses(seed)
    scores = select(rule, hypotheses, problem)[1]
    permuted = select(rule, [hypotheses[i] for i in order], problem)[1]
    np.testing.assert_allclose(permuted, scores[order])


@given(seed=st.integers(0, 2**32), factor=st.floats(1e-3, 1e3))
def test_the_unit_of_the_residuals_does_not_matter(seed, factor):
    hypotheses = random_hypotheses(seed)
    scaled = [replace(h, residuals=factor * h.residuals, threshold=factor) for h in hypotheses]
    for name in NAMES:
        assert winner(by_name(name), hypotheses) == winner(by_name(name), scaled)


def test_pair_cost_is_maximised():
    """The paper's text says minimum; with it the farthest pair with the fewest inliers would win."""
    hypotheses = [hypothesis(0, [0.1] * 9), hypothesis(1, [0.1] * 8 + [2]), hypothesis(90, [0.1] + [2] * 8)]
    assert winner(PairCost(0.5), hypotheses) == 0


@given(seed=st.integers(0, 2**32))
def test_a_small_p_sums_logarithms(seed):
    """min(r, t)^p = 1 + p ln min(r, t) + O(p^2)."""
    hypotheses = random_hypotheses(seed)
    logs = [np.log(np.minimum(h.residuals, h.threshold)).sum() for h in hypotheses]
    assert winner(TruncatedLp(1e-6), hypotheses) == int(np.argmin(logs))


@given(seed=st.integers(0, 2**32))
def test_a_large_p_counts_inliers(seed):
    """(r / t)^p is 0 for inliers and 1 for outliers in the limit."""
    hypotheses = [replace(h, residuals=np.where(h.residuals < 0.95, h.residuals, 2.0)) for h in random_hypotheses(seed)]
    costs = -select(TruncatedLp(1000.0), hypotheses, problem)[1]
    np.testing.assert_allclose(costs, [12 - h.num_inliers for h in hypotheses], atol=1e-9)


def test_a_sample_with_fewer_rows_has_no_advantage():
    """Rows that are not finite are dropped before estimation, so samples differ in size."""
    whole, rest = hypothesis(0, [0.1] * 90 + [2] * 10), hypothesis(50, [0.1, 0.9] + [2] * 3)
    assert winner(TruncatedLp(0.1), [whole, rest]) == 0


@rules
def test_scoring_changes_nothing(rule):
    before = pickle.dumps(FIVE)
    select(rule, FIVE, problem)
    assert pickle.dumps(FIVE) == before


def test_scored_hypotheses_hold_their_scores():
    result = scored(FIVE, np.arange(5.0))
    assert [h.score for h in result] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert all(new.model is old.model for new, old in zip(result, FIVE, strict=True))
    assert np.isnan(FIVE[0].score)


@pytest.mark.parametrize("name", [*NAMES, "fixed", "l1_average", "pair_0.3", "pair_2", "tlp_0.25", "tlp_1.5"])
def test_names_find_their_rules(name):
    assert by_name(name).name == name


@pytest.mark.parametrize(
    "rule", [*paper_rules(), FixedSample(), *AVERAGES, PairCost(0.3), TruncatedLp(3.0)], ids=lambda r: r.name
)
def test_rules_are_found_by_their_names(rule):
    assert by_name(rule.name) == rule


@pytest.mark.parametrize("p", ["pair", "tlp"])
def test_different_spellings_of_a_number_are_one_rule(p):
    assert by_name(f"{p}_1e-1") == by_name(f"{p}_0.10") == by_name(f"{p}_0.1")


@pytest.mark.parametrize(
    "wrong",
    [*("", "l2_average", "TLP_0.1", "pair", "pair_", "pair_x", "pair_0", "pair_-1", "pair_nan", "pair_inf"),
     *("tlp_", "tlp_x", "tlp_0", "tlp_-0.1", "tlp_nan", "tlp_inf", "ideal", "most-inliers")],
)  # fmt: skip
def test_unknown_names_are_refused_and_the_known_ones_listed(wrong):
    with pytest.raises(ValueError, match="rule must be one of") as caught:
        by_name(wrong)
    for name in (*NAMES, "fixed", repr(wrong)):
        assert name in str(caught.value)


def test_the_average_has_to_be_known():
    with pytest.raises(ValueError, match='kind must be one of "l1", "trimmed", "truncated", got \'l2\''):
        NearestToAverage("l2")


class Budgeted(Estimator):
    """Tells its budget, and never works."""

    def with_budget(self, factor):
        return f"{factor} times the budget"

    def estimate(self, problem, rows, noise, rng):
        raise AssertionError


def test_fixed_plans_one_sample_with_the_budget_of_all():
    assert FixedSample().plan(30, Budgeted()) == (1, "30 times the budget")


def test_fixed_needs_a_number_of_samples():
    with pytest.raises(ValueError, match="samples must be a number with the rule fixed"):
        FixedSample().plan(None, Budgeted())


@pytest.mark.parametrize("rule", [rule for rule in RULES if rule.name != "fixed"], ids=lambda rule: rule.name)
@pytest.mark.parametrize("samples", [None, 30])
def test_all_other_rules_leave_the_samples_as_they_are(rule, samples):
    estimator = Budgeted()
    assert rule.plan(samples, estimator) == (samples, estimator)


@pytest.mark.parametrize(
    ("quantile", "name"), [(0.5, "minimum_median"), (0.75, "minimum_q3"), (0.9, "minimum_quantile_0.9")]
)
def test_a_quantile_has_a_name_of_its_own(quantile, name):
    assert MinimumQuantile(quantile).name == name


# What every rule must do; a new class in `nonsac.method.scoring` that needs settings has to be added here.
SETTINGS = {
    Ideal: (naive.shift_model(0.0),),
    MinimumQuantile: (0.5,),
    PairCost: (0.1,),
    TruncatedLp: (0.1,),
}
CLASSES = [
    c
    for _, c in inspect.getmembers(scoring, inspect.isclass)
    if c.__module__ == "nonsac.method.scoring" and issubclass(c, ScoringRule) and c is not ScoringRule
]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_conformance(kind):
    rule = kind(*SETTINGS.get(kind, ()))
    check_rule(rule, problem)
    for seed in range(20):
        scores = rule.scores(random_hypotheses(seed), problem)
        assert not np.isnan(scores).any()
        assert np.isfinite(scores).any()


def test_all_rules_are_tested():
    assert {type(rule) for rule in RULES} == set(CLASSES)
    assert MinimumMean in CLASSES
