import inspect
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import get_type_hints

import numpy as np
import pytest

import naive
import nonsac
from nonsac.clouds.problem import OrientedRegistration
from nonsac.estimators.external import Call
from nonsac.method import refiners, scoring
from nonsac.method.settings import Keywords, KeywordsAndEstimator, Settings, default_of, descriptions
from nonsac.problems import AbsolutePose, Registration
from nonsac.running.executors import Workers

NAMES = [each.name for each in fields(Settings)]
CALLS = [nonsac.estimate, nonsac.register_pairs, nonsac.relative_pose, nonsac.absolute_pose]


def test_keywords_are_the_settings():
    """And their types are what the names in their annotations stand for."""
    known = {kind.__name__: kind for kind in (nonsac.Estimator, nonsac.Refiner, nonsac.ScoringRule)}
    known |= {"np": np, "Call": Call, "Workers": Workers}
    hints = [get_type_hints(each, localns=known) for each in (Keywords, KeywordsAndEstimator)]
    assert set(hints[1]) == set(NAMES) == {*hints[0], "estimator"}


@pytest.mark.parametrize("name", NAMES)
def test_every_setting_is_described_and_its_default_is_valid(name):
    description = descriptions()[name]
    assert description.kind
    assert description.doc.endswith(".")
    assert (description.read is None) or (description.form and description.help.endswith("."))
    description.check(default_of(name))


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)
def test_calls_show_all_settings_with_their_defaults(call):
    shown = inspect.signature(call).parameters
    assert set(NAMES) <= set(shown)
    assert not any(p.kind is p.VAR_KEYWORD for p in shown.values())
    refine = "union" if call is nonsac.estimate else "polish"
    for name in NAMES:
        assert shown[name].default == (refine if name == "refine" else default_of(name))
        assert re.search(rf"^    (\w+, )*{name}(, \w+)*( : .*)?$", call.__doc__, re.MULTILINE)
    assert "{" not in call.__doc__


def test_what_is_not_given_is_the_default():
    settings = Settings.of("call", {})
    assert settings == Settings.of("call", {"noise": None, "samples": "auto", "rule": "tlp_0.1", "rng": 0})
    assert (settings.rule, settings.refine) == (scoring.TruncatedLp(0.1), refiners.by_name("polish"))
    assert Settings.of("call", {}, refine="none").refine == refiners.by_name("none")
    assert Settings.of("call", {"refine": "union"}, refine="none").refine == refiners.by_name("union")


@pytest.mark.parametrize(
    ("name", "given", "used"),
    [
        ("noise", np.float32(0.5), 0.5),
        ("noise", 2, 2.0),
        ("samples", np.int64(7), 7),
        ("sample_size", 10**9, 10**9),
        ("max_samples", 10**6, 10**6),
        ("max_memory", "500 MB", 500_000_000),
        ("max_memory", 10**6, 10**6),
        ("rule", "most_inliers", scoring.MostInliers()),
        ("rule", scoring.PairCost(0.3), scoring.PairCost(0.3)),
        ("refine", refiners.AsSelected(), refiners.by_name("none")),
        ("rng", np.int32(4), 4),
        ("time_limit", 3, 3.0),
    ],
)
def test_what_is_used_is_of_one_type(name, given, used):
    value = getattr(Settings.of("call", {name: given}), name)
    assert value == used
    assert type(value) is type(used)


@pytest.mark.parametrize("name", ["noise", "samples", "sample_size", "max_samples", "time_limit", "workers", "rng"])
def test_truth_is_no_number(name):
    with pytest.raises((ValueError, TypeError), match=f"^{name} must be .*True"):
        Settings.of("call", {name: True})


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("noise", -1.0, "noise must be a positive number, the standard deviation of an inlier, or None, got -1.0"),
        ("noise", 1e300, r"noise must be from 1e-100 to 1e\+100, or None, got 1e\+300"),
        ("time_limit", "3", "time_limit must be a positive number of seconds, or None, got '3'"),
        ("draw", "chunks", 'draw must be "rows" or "blocks", got \'chunks\''),
        ("samples", 10**7, "samples must be at most 1,000,000, got 10000000"),
        ("max_samples", "auto", "max_samples must be an integer of at least 1, got 'auto'"),
        ("sample_size", "all", "sample_size must be \"auto\" or an integer of at least 1, got 'all'"),
        ("progress", 5, r"progress must be a function of \(done, samples\), got 5"),
        ("max_memory", "much", "max_memory"),
    ],
)
def test_messages_say_what_is_meant_and_what_came(name, wrong, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Settings.of("call", {name: wrong})


@pytest.mark.parametrize(("name", "hint"), [("sample", "; did you mean samples?"), ("xyz", "")])
def test_unknown_settings_are_refused_in_the_name_of_the_call(name, hint):
    with pytest.raises(TypeError) as caught:
        Settings.of("register_pairs", {name: 1})
    assert str(caught.value) == f"register_pairs() got an unexpected keyword argument {name!r}{hint}"


TEXTS = [
    ("noise", "0.25", 0.25),
    ("samples", "auto", "auto"),
    ("samples", "12", 12),
    ("sample_size", "300", 300),
    ("draw", "blocks", "blocks"),
    ("max_samples", "50", 50),
    ("max_uncertainty", "2.5", 2.5),
    ("time_limit", "1.5", 1.5),
    ("max_memory", "500 MB", 500_000_000),
    ("max_memory", "1000000", 10**6),
    ("estimator", "pcr99", "pcr99"),
    ("rule", "pair_0.10", scoring.PairCost(0.1)),
    ("refine", "full", refiners.by_name("full")),
    ("workers", "3", 3),
    ("rng", "17", 17),
]


@pytest.mark.parametrize(("name", "text", "used"), TEXTS)
def test_text_is_read_as_what_may_be_given(name, text, used):
    description = descriptions()[name]
    assert description.check(description.read(text)) == used


def test_all_that_text_can_say_is_tested():
    assert {name for name, _, _ in TEXTS} == {name for name, each in descriptions().items() if each.read is not None}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *(("noise", text) for text in ("0", "-1", "nan", "inf", "a lot", "")),
        *(("samples", text) for text in ("0", "-1", "2.5", "automatic", "")),
        *(("max_samples", text) for text in ("0", "auto", "1e3")),
        *(("draw", text) for text in ("", "Blocks")),
        *(("time_limit", text) for text in ("0", "soon")),
        *(("max_memory", text) for text in ("much", "")),
        *(("estimator", text) for text in ("no-such", "Ransac")),
        *(("rule", text) for text in ("best", "tlp_", "ideal")),
        *(("refine", text) for text in ("icp", "Union")),
        *(("workers", text) for text in ("0", "-2", "many")),
        *(("rng", text) for text in ("-1", "0.5", "seed")),
    ],
)
def test_text_that_means_nothing_is_refused_with_itself(name, text):
    with pytest.raises(ValueError, match="'") as caught:
        descriptions()[name].read(text)
    assert repr(text) in str(caught.value)
    assert "object" not in str(caught.value)


def test_executors_are_taken_as_workers():
    with ThreadPoolExecutor(1) as pool:
        assert Settings.of("call", {"workers": pool}).workers is pool


@pytest.mark.parametrize(("problem", "least"), [(naive.Shift(), 1), (Registration(), 3), (AbsolutePose(), 3)])
def test_a_sample_holds_at_least_a_minimal_one(problem, least):
    settings = Settings.of("call", {"sample_size": least})
    assert settings.fitting(problem) is settings
    if least > 1:
        with pytest.raises(ValueError, match=f'sample_size must be "auto" or an integer of at least {least}, got 2'):
            Settings.of("call", {"sample_size": 2}).fitting(problem)


def test_a_refiner_must_fit_the_problem():
    settings = Settings.of("call", {"refine": "full"})
    assert settings.fitting(Registration()) is settings
    for problem in (naive.Line(), OrientedRegistration()):
        name = type(problem).__name__
        with pytest.raises(ValueError, match=f'refine="full" needs a problem with `streaming`, {name} has none'):
            settings.fitting(problem)
