"""Methods compared on data whose truth is known, and on junk; those that misbehave are outcomes."""

import json
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import misbehaving
import nonsac
from line import Line
from nonsac import simulate
from nonsac.calls import compare as module
from nonsac.calls import compared_data
from nonsac.calls.compare import compare
from nonsac.calls.compared_data import split, truth_of
from nonsac.calls.comparison import Compared, Comparison
from nonsac.estimators import named
from nonsac.estimators.named import ESTIMATORS, Named
from nonsac.problems import Registration, RelativePose
from nonsac.running.metered import process_memory

NOISE = 0.01


@pytest.fixture(scope="module")
def pairs():
    return simulate.registration(3000, 0.5, NOISE, 1)


def by_name(comparison):
    return {row.method: row for row in comparison.rows}


def name_of(row):
    return row.name


def ours(pairs, **settings):
    return compare("register_pairs", pairs.source, pairs.target, noise=NOISE, repeats=2, **settings)


def test_what_is_recommended_is_best_or_nearly_and_quick(pairs):
    comparison = ours(pairs, truth=pairs.T, methods={"ours": "ransac", "none": misbehaving.identity})
    assert [row.method for row in comparison.rows[:2]] == ["ours", "ours"]
    best = comparison.best
    assert best.accuracy >= 0.9 * max(row.accuracy for row in comparison.rows)
    assert best.cpu_seconds == min(row.cpu_seconds for row in comparison.rows if row.accuracy > 0.9)
    assert comparison.recommendation.startswith(f"take {best.name}: mAA ")
    wrong = by_name(comparison)["none"]
    assert (wrong.outcome, wrong.accuracy, wrong.trusted, wrong.status) == ("ok", 0.0, 0.0, "low_support")
    assert wrong.rotation_error > 10.0
    for row in comparison.rows[:2]:
        assert row.rotation_error < 1.0
        assert row.translation_error < 0.05
        assert row.held_out == pytest.approx(0.5, abs=0.05)
        assert (row.trusted, row.status, row.runs, row.repeats) == (1.0, "ok", 2, 2)
        assert 0.0 < row.cpu_seconds < 60.0
    assert (comparison.num_rows, comparison.num_held_out) == (3000, 600)


def test_without_a_truth_the_held_out_rows_and_the_verdict_decide(pairs):
    comparison = compare(
        "register_pairs",
        np.hstack([pairs.source, pairs.target])[:, :3],
        pairs.target,
        methods={"ours": "ransac", "none": misbehaving.identity},
        uses=("alone",),
        repeats=2,
    )
    assert comparison.best.method == "ours"
    assert comparison.noise == pytest.approx(NOISE, rel=0.2)  # measured
    assert "of the held-out rows fit" in comparison.recommendation
    row, wrong = (by_name(comparison)[name] for name in ("ours", "none"))
    assert row.merit == row.held_out
    assert (row.accuracy, row.rotation_error) == (None, None)
    assert row.agreement < 1.0 < wrong.agreement
    assert wrong.merit == 0.0


def test_what_the_verdict_does_not_trust_has_no_merit(pairs):
    comparison = ours(pairs, methods={"ours": "ransac", "nearly": misbehaving.nearly}, uses=("alone",))
    assert comparison.best.method == "ours"
    row = by_name(comparison)["nearly"]
    assert row.trusted == 0.0
    assert row.held_out > 0.1
    assert row.merit == 0.0


def test_junk_ends_without_a_recommendation(rng):
    junk, few = (rng.random((2000, 3)), rng.random((2000, 3))), {"methods": ["ransac", "pcr99"], "repeats": 2}
    comparison = compare("register_pairs", *junk, **few)
    assert comparison.best is None
    assert comparison.recommendation == "take none: no method gave an answer to be trusted on these data"
    assert {row.trusted for row in comparison.rows} == {0.0}
    assert any("not trusted" in remark or "nothing was found" in remark for remark in comparison.remarks)


@pytest.mark.slow
def test_misbehaviour_is_an_outcome(pairs, monkeypatch):
    monkeypatch.setattr(module, "_FIRST_CALL", 3.0)
    bad = {
        "greedy": misbehaving.greedy,
        "outside": misbehaving.greedy_outside,
        "sleepy": misbehaving.sleepy,
        "crashing": misbehaving.crashing,
        "leaving": misbehaving.leaving,
        "failing": misbehaving.failing,
    }
    told = []
    comparison = ours(
        pairs,
        methods={"honest": misbehaving.honest, **bad},
        uses=("alone",),
        time_limit=3.0,
        max_memory="1 GB",
        progress=lambda done, total: told.append((done, total)),
    )
    found = {name: (row.outcome, row.detail) for name, row in by_name(comparison).items()}
    assert found["honest"] == ("ok", "")
    if process_memory("VmSize") is not None:
        assert found["greedy"][0] == "out of memory"
    assert found["outside"][0] == "out of memory"
    assert found["sleepy"] == ("over the time limit", "more than 3 s (in the first call, on few rows)")
    assert found["crashing"] == ("crashed", "signal 11 (in the first call, on few rows)")
    assert found["leaving"] == ("crashed", "exit code 7: I have had enough (in the first call, on few rows)")
    assert found["failing"] == ("failed", "RuntimeError: no such luck [today]")
    assert comparison.best.method == "honest"
    assert comparison.rows[0].method == "honest"
    assert told[-1] == (14, 14)
    assert "no such luck [today]" in str(comparison)
    assert not multiprocessing.active_children()


def test_runs_that_are_lost_count_as_wrong(pairs):
    comparison = compare(
        "register_pairs",
        pairs.source,
        pairs.target,
        methods={"sometimes": misbehaving.sometimes},
        uses=("alone",),
        noise=NOISE,
        repeats=12,
        truth=pairs.T,
    )
    (row,) = comparison.rows
    assert 0 < row.runs < row.repeats == 12
    assert row.outcome == "ok"
    assert row.accuracy <= row.runs / 12
    assert row.held_out == pytest.approx(0.5 * row.runs / 12, abs=0.05)
    assert row.detail == "RuntimeError: not today"
    assert f"({12 - row.runs} of 12 runs lost: RuntimeError: not today)" in " ".join(str(comparison).split())
    assert f"our verdict trusts {round(12 * row.trusted)} of its 12 runs" in comparison.recommendation


@pytest.mark.slow
def test_a_method_that_was_too_slow_is_not_run_on_larger_samples(pairs, tmp_path, monkeypatch):
    monkeypatch.setenv("SLOW_ON", str(tmp_path / "rows.txt"))
    start = time.perf_counter()
    comparison = ours(
        pairs, methods={"slow": misbehaving.slow_on_many}, uses=("alone",), sizes=(50, 1000, 2000), time_limit=3.0
    )
    assert time.perf_counter() - start < 40.0
    outcomes = {row.sample_size: row.outcome for row in comparison.rows}
    assert outcomes == {50: "ok", 1000: "over the time limit", 2000: "over the time limit"}
    assert (tmp_path / "rows.txt").read_text() == "1000\n"


def test_what_is_not_installed_is_told_with_how_to_get_it(pairs, monkeypatch):
    monkeypatch.setitem(ESTIMATORS, "elsewhere", Named("x:y", "of others", (), "no_such_module", "others"))
    comparison = ours(pairs, methods=["elsewhere"])
    (row,) = comparison.rows
    assert (row.outcome, row.detail, row.runs) == ("not installed", 'pip install "nonsac[others]"', 0)
    assert comparison.recommendation == "take none: no method gave an answer on these data"
    assert 'pip install "nonsac[others]"' in str(comparison)


@pytest.mark.slow
def test_an_interrupt_ends_the_processes(pairs, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    timer = threading.Timer(6.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    start = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        ours(pairs, methods={"sleepy": misbehaving.sleepy, "b": misbehaving.sleepy}, uses=("alone",), time_limit=60.0)
    assert time.perf_counter() - start < 40.0
    assert not multiprocessing.active_children()
    assert not list(tmp_path.iterdir())  # what they said
    timer.join()


@pytest.mark.slow
def test_each_noise_and_size_has_a_row(pairs):
    comparison = compare(
        "register_pairs",
        pairs.source,
        pairs.target,
        methods=["ransac"],
        noise=[0.01, 0.02],
        sizes=[200, 400],
        repeats=1,
        workers=2,
    )
    cells = {(row.use, row.sample_size, row.noise) for row in comparison.rows}
    assert cells == {(use, size, noise) for use in ("alone", "core") for size in (200, 400) for noise in (0.01, 0.02)}
    assert "noise" in str(comparison)
    assert comparison.noise == pytest.approx(NOISE, rel=0.2)


@pytest.mark.slow
def test_same_seed_same_answers(pairs):
    first, second = (ours(pairs, methods=["pcr99"], truth=pairs.T, rng=5) for _ in range(2))
    for row, again in zip(sorted(first.rows, key=name_of), sorted(second.rows, key=name_of), strict=True):
        assert (row.use, row.rotation_error, row.held_out) == (again.use, again.rotation_error, again.held_out)


@pytest.mark.slow
def test_relative_poses_in_pixels_from_a_file(tmp_path):
    views = simulate.relative_pose(2000, 0.4, 0.001, 3)
    camera = nonsac.Camera("PINHOLE", (800, 800, 640, 480), 1280, 960)
    K = camera.K
    np.savez(
        tmp_path / "a.npz",
        x1=camera.project(views.points1),
        x2=camera.project(views.points2),
        K1=K,
        K2=K,
        R=views.T[:3, :3],
        t=views.T[:3, 3],
    )
    path = tmp_path / "a.npz"
    comparison = compare("relative_pose", path, truth=path, methods=["ransac"], repeats=2)
    assert comparison.noise == pytest.approx(0.8, rel=0.3)  # pixels
    for row in comparison.rows:
        assert row.rotation_error < 1.0
        assert row.translation_error < 5.0
        assert row.trusted == 1.0
    comparison = compare(
        "relative_pose", np.load(path)["x1"], np.load(path)["x2"], camera1=K, methods=["ransac"], repeats=1
    )
    assert comparison.best is not None


@pytest.mark.slow
def test_a_problem_of_ones_own(rng):
    points = rng.uniform(-1, 1, (3000, 2))
    points[:1500, 1] = 0.3 + 0.5 * points[:1500, 0] + rng.normal(scale=0.005, size=1500)
    true = np.array([-0.5, 1.0, 0.3]) / np.hypot(0.5, 1.0)
    comparison = compare(Line(), nonsac.ArraySource(points), methods=["ransac"], repeats=2, truth=true)
    assert comparison.call == "Line"
    assert all(row.accuracy > 0.85 for row in comparison.rows)
    assert comparison.best is not None


@pytest.mark.slow
def test_rules(pairs):
    comparison = ours(pairs, rules=True, samples=(3, 5), sizes=(200,), truth=pairs.T)
    assert comparison.by_rule
    rules = {row.use for row in comparison.rows}
    assert len(rules) == 22
    assert {"ideal", "fixed", "most_inliers", "tlp_0.1", "pair_0.1", "refined"} <= rules
    assert {row.samples for row in comparison.rows} == {3, 5}
    assert all(row.accuracy is not None and row.runs == 2 for row in comparison.rows)
    by_rule = {(row.use, row.samples): row for row in comparison.rows}
    assert by_rule["ideal", 5].rotation_error <= by_rule["most_inliers", 5].rotation_error
    assert by_rule["most_inliers", 3].cpu_seconds <= by_rule["most_inliers", 5].cpu_seconds
    assert comparison.best.use != "ideal"
    assert "the rule" in comparison.recommendation
    without = ours(pairs, rules=True, samples=(3,), sizes=(200,))
    assert len(without.rows) == 21
    assert "trusted" not in without.title


# --- the rows that no method sees ------------------------------------------------------------


class Sorted(nonsac.ArraySource):
    blocks = np.arange(0, 4001, 50)

    @property
    def about(self):
        return nonsac.About(blocks=self.blocks)


@pytest.mark.parametrize("source", [nonsac.ArraySource, Sorted])
def test_no_method_sees_the_rows_it_is_judged_on(rng, source):
    rows = np.hstack([np.arange(4000.0)[:, None], rng.random((4000, 5))])
    data = split(source(rows), Registration(), 3)
    seen = data.seen.take(np.arange(len(data.seen)))
    held_out = data.held_out.values
    assert len(held_out) in (400, 800)
    assert not set(seen[:, 0]) & set(held_out[:, 0])
    assert set(seen[:, 0]) | set(held_out[:, 0]) == set(range(4000))
    assert len({int(number) // 50 for number in held_out[:, 0]}) == (16 if source is Sorted else 80)


def test_few_rows_of_many_are_held_out():
    rows = nonsac.ArraySource(np.random.default_rng(0).random((200_000, 6)))
    assert len(split(rows, Registration(), 0).held_out) == 20_000


def test_much_data_in_memory_is_shared_as_a_file(tmp_path, monkeypatch, rng):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rows = rng.random((500, 6))
    source = nonsac.ArraySource(rows)
    with compared_data.shareable(source) as shared:
        assert shared is source
    monkeypatch.setattr(compared_data, "_MUCH", 1000)
    monkeypatch.setattr(compared_data, "_AT_ONCE", 64)
    with compared_data.shareable(source) as shared:
        assert not shared.about.in_memory
        np.testing.assert_array_equal(shared.take(np.arange(500)), rows)
        assert len(list(tmp_path.glob("*/rows.npy"))) == 1
    assert not list(tmp_path.iterdir())


# --- the truth -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        (np.eye(3), r"truth must be a matrix of the shape \(4, 4\), got the shape \(3, 3\)"),
        (np.full((4, 4), np.nan), "truth must be finite"),
        (np.diag([1.0, 2.0, 3.0, 1.0]), "truth must hold a rotation"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "truth must hold a rotation"),
        ("no such file.txt", "no such file"),
        (object(), "truth must be a matrix or the name of a file"),
    ],
)
def test_truths_that_are_none(truth, message):
    with pytest.raises((ValueError, TypeError, OSError), match=message):
        truth_of(truth, RelativePose())


def test_truths_may_have_a_scale():
    np.testing.assert_array_equal(truth_of(np.diag([2.0, 2.0, 2.0, 1.0]), Registration(None))[:, :3], 2.0 * np.eye(3))


# --- at the door -----------------------------------------------------------------------------

DATA = np.random.default_rng(0).random((50, 3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"call": "register_clouds"}, "call must be one of relative_pose, absolute_pose, register_pairs, or a problem"),
        ({"methods": ["ransack"]}, "methods must be of ransac, pcr99.* for Registration, got 'ransack'"),
        ({"methods": []}, "methods must hold at least one"),
        ({"methods": "ransac"}, "methods must be a sequence of names"),
        ({"methods": {"a": lambda rows, threshold, seed: None}}, r"methods\['a'\] does not travel"),
        ({"methods": {"a": 3}}, "estimator must be a name"),
        ({"uses": ("both",)}, 'uses must hold "alone", "core" or both'),
        ({"sizes": (2,)}, "sizes is 2; expected an integer"),
        ({"sizes": ()}, "sizes must hold at least one"),
        ({"noise": -1.0}, "noise must be a positive number"),
        ({"noise": (0.1, "a")}, "noise must be a positive number"),
        ({"repeats": 0}, "repeats is 0; expected an integer"),
        ({"time_limit": 0}, "time_limit must be a positive number of seconds"),
        ({"max_memory": "much"}, "max_memory must be a positive number of bytes"),
        ({"workers": 0}, "workers is 0; expected"),
        ({"rules": 1}, "rules is 1; expected True or False"),
        ({"rules": True, "samples": ()}, "samples must hold at least one"),
        ({"rng": -1}, "rng must be a non-negative integer"),
        ({"progress": 3}, "progress must be a function"),
        ({"truth": np.eye(2)}, "truth must be a matrix of the shape"),
        ({"camera1": (1, 1, 0, 0)}, "compare has no setting 'camera1' for register_pairs"),
        ({"columns": [0]}, "columns and dataset are for a file"),
    ],
)
def test_wrong_arguments_are_refused(change, message):
    call = change.pop("call", "register_pairs")
    with pytest.raises((ValueError, TypeError), match=message):
        compare(call, DATA, DATA, **change)


def test_wrong_data_are_refused():
    with pytest.raises(TypeError, match="compare needs data"):
        compare("register_pairs")
    with pytest.raises(TypeError, match="compare takes source and target for register_pairs"):
        compare("register_pairs", DATA)
    with pytest.raises(ValueError, match="compare needs source"):
        compare("register_pairs", DATA, DATA[1:])
    with pytest.raises(ValueError, match="the points look like pixels"):
        compare("relative_pose", 1000 * DATA[:, :2], 1000 * DATA[:, :2])
    with pytest.raises(ValueError, match="camera1 must be given"):
        compare("relative_pose", DATA[:, :2], DATA[:, :2], camera2=(1, 1, 0, 0))
    with pytest.raises(TypeError, match="data must be one source of rows"):
        compare(Line(), DATA, DATA)
    with pytest.raises(nonsac.InputError, match="nothing"):
        compare("register_pairs", "nothing.npz")


# --- what comes back -------------------------------------------------------------------------


def row(method, merit, cpu, use="alone", trusted=1.0, **more):
    return Compared(method, use, merit=merit, held_out=merit, cpu_seconds=cpu, trusted=trusted, repeats=3, **more)


def comparison(*rows, truth=False):
    return Comparison("register_pairs", rows, 100, 20, 0.1, truth, 0)


def test_the_quickest_of_those_within_a_tenth_is_recommended():
    found = comparison(row("best", 0.50, 1.0), row("quick", 0.46, 0.1), row("poor", 0.44, 0.01))
    assert found.best.method == "quick"
    assert found.recommendation == (
        "take quick alone: 46.0 % of the held-out rows fit, 100 ms of CPU time; the best is best alone (50.0 %, 1 s)"
    )


def test_a_best_that_is_hardly_better_is_not_told():
    told = comparison(row("best", 0.500, 1.0), row("quick", 0.499, 0.1)).recommendation
    assert told == "take quick alone: 49.9 % of the held-out rows fit, 100 ms of CPU time"


def test_none_is_recommended_if_trust_is_rare():
    assert comparison(row("a", 0.1, 1.0, trusted=1 / 3)).best is None
    assert comparison(row("a", 0.1, 1.0, trusted=2 / 3)).best is not None
    assert comparison(row("a", 0.0, 1.0)).best is None
    assert "no method came near the truth" in comparison(row("a", 0.3, 1.0), truth=True).recommendation


def test_none_is_recommended_if_the_default_method_explains_clearly_more():
    found = replace(comparison(row("a", 0.25, 1.0), row("b", 0.2, 0.1)), default_held_out=0.75)
    assert found.best is None
    assert found.recommendation == (
        "take none: the default method explains 75.0 % of the held-out rows, and none of these more than 25.0 %"
    )
    assert replace(found, default_held_out=0.27).best.method == "a"


def test_answers_that_agree_with_each_other_and_not_with_the_truth_are_told():
    rows = [row(name, 0.0, 1.0, agreement=0.1) for name in ("a", "b")]
    assert "is it the truth, or its inverse?" in comparison(*rows, truth=True).recommendation
    assert "inverse" not in comparison(rows[0], truth=True).recommendation


@pytest.mark.parametrize("wrong", ["shift", "scale"])
def test_a_wrong_translation_or_scale_is_as_wrong_as_a_rotation(pairs, wrong):
    truth = pairs.T.copy()
    if wrong == "shift":
        truth[:3, 3] += 3.0
    else:
        truth[:3] *= 2.0
    found = compare(
        "register_pairs",
        pairs.source,
        pairs.target,
        methods=["pcr99"],
        uses=["alone"],
        noise=NOISE,
        repeats=1,
        truth=truth,
    )
    assert found.rows[0].rotation_error < 2.0
    assert found.rows[0].accuracy == 0.0
    assert found.best is None


def test_dissent_is_told():
    near, far = row("a", 0.5, 1.0, agreement=0.1), row("b", 0.4, 1.0, agreement=90.0)
    assert comparison(near, far).recommendation.endswith(
        "; but b alone, trusted as well, gives an answer 90 degrees away"
    )
    distrusted = replace(far, trusted=0.0)
    assert "degrees away" not in comparison(near, distrusted).recommendation
    assert "look at both" in comparison(replace(near, agreement=60.0), far).recommendation


def test_json_goes_round(tmp_path):
    found = comparison(row("a", 0.5, 1.0, agreement=0.1), Compared("b", "core", outcome="crashed", detail="signal 11"))
    found.save(tmp_path / "a.json")
    assert Comparison.load(tmp_path / "a.json") == found
    held = json.loads((tmp_path / "a.json").read_text())
    assert held["best"] == 0
    assert held["recommendation"] == found.recommendation
    assert held["rows"][1]["outcome"] == "crashed"
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(nonsac.InputError, match="the file holds no comparison"):
        Comparison.load(tmp_path / "b.json")


def test_every_named_method_is_compared_by_default():
    assert set(named.estimators_for(Registration())) >= {"ransac", "pcr99"}


def test_real_matches(data):
    path = data / "strecha" / "rel_fountain-P11_00_04.npz"
    found = compare("relative_pose", path, truth=path, methods=["ransac"], repeats=2)
    assert found.best.accuracy == 1.0
