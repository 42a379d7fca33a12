"""What all estimators of other libraries have in common."""

import os
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import nonsac
from nonsac import Registration, RelativePose, simulate
from nonsac.estimators import named
from nonsac.estimators.named import ESTIMATORS, chosen_estimator
from nonsac.testing import check_estimator
from others_samples import NOISE, PROBLEMS, found, planted

TESTS = Path(__file__).resolve().parents[2]
OTHERS = {name: each for name, each in ESTIMATORS.items() if each.where.startswith("others.")}
EVERY = [(name, kind) for name, each in OTHERS.items() for kind in each.problems]
BY_EXTRA = {each.extra: each.needs for each in OTHERS.values()}


def usable(name):
    """Skip the test if a library is not here, or does not run here."""
    return pytest.importorskip(OTHERS[name].needs, reason=f"needs the extra {OTHERS[name].extra}", exc_type=ImportError)


@pytest.mark.parametrize(("name", "kind"), EVERY)
def test_it_does_what_the_contract_says(name, kind):
    usable(name)
    if name == "open3d-ransac":
        pytest.skip("its threads race for random numbers: the same seed may give another model")
    check_estimator(chosen_estimator(name, PROBLEMS[kind]), PROBLEMS[kind], planted(kind, 0.5, 1)[0], NOISE[kind])


@pytest.mark.parametrize(("name", "kind"), EVERY)
def test_it_travels(name, kind):
    usable(name)
    estimator = chosen_estimator(name, PROBLEMS[kind])
    assert pickle.loads(pickle.dumps(estimator)) == estimator


@pytest.mark.parametrize(("name", "kind"), EVERY)
def test_a_larger_budget_is_more_iterations(name, kind):
    usable(name)
    estimator = chosen_estimator(name, PROBLEMS[kind])
    assert estimator.with_budget(1) == estimator
    assert estimator.with_budget(3).iterations == 3 * estimator.iterations
    assert estimator.with_budget(10**9).iterations < 2**31


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_what_nobody_can_solve_does_not_end_the_process(name):
    usable(name)
    command = [sys.executable, "-W", "error", str(TESTS / "others_hopeless.py"), name]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, timeout=180)
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines() if line.split()[0] in PROBLEMS] == sorted(
        OTHERS[name].problems, key=[*PROBLEMS].index
    )


@pytest.mark.parametrize("name", OTHERS)
def test_an_absent_library_is_told_in_one_sentence(name, monkeypatch):
    monkeypatch.setattr(named, "find_spec", lambda module: None if module == OTHERS[name].needs else find_spec(module))
    problem, extra = PROBLEMS[OTHERS[name].problems[0]], OTHERS[name].extra
    message = rf'^{name} needs {OTHERS[name].needs}, which is not installed: pip install "nonsac\[{extra}\]"$'
    with pytest.raises(ValueError, match=message):
        chosen_estimator(name, problem)


def test_no_library_is_imported_before_it_is_asked_for():
    code = "import sys, nonsac.estimators.named; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, check=True)
    assert not {each.needs for each in OTHERS.values()} & set(done.stdout.split())


@pytest.mark.parametrize("name", ["kiss-matcher", "open3d-fgr"])
def test_a_scale_that_is_to_be_estimated_is_refused(name):
    usable(name)
    name_of_file = OTHERS[name].where.split(".")[1].split(":")[0].replace("_", "-")
    with pytest.raises(
        ValueError,
        match=f"^{name_of_file} needs a known scale, and the scale is to be estimated: use pcr99, teaser or ransac$",
    ):
        chosen_estimator(name, Registration(None))


# --- in calls -------------------------------------------------------------------------------------------------------


def test_calls_take_them_by_name():
    """With a noise and without, in pixels, by threads and by processes."""
    usable("poselib")
    views = simulate.relative_pose(3000, 0.4, 0.001, rng=1)
    camera = nonsac.Camera("PINHOLE", (800, 800, 640, 480), 1280, 960)
    pixels = camera.project(views.points1), camera.project(views.points2)
    settings = {"estimator": "poselib", "samples": 2, "sample_size": 600}
    for noise in (0.8, None):
        result = nonsac.relative_pose(*pixels, camera, noise=noise, workers=1, **settings)
        assert result.success
        assert not [remark for remark in result.remarks if "the estimator failed" in remark]
        assert nonsac.evaluation.rotation_error(result.R, views.T[:3, :3]) < 0.3
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = nonsac.relative_pose(*pixels, camera, noise=0.8, workers=pool, **settings)
    here = nonsac.relative_pose(*pixels, camera, noise=0.8, workers=1, **settings)
    assert there.T.tobytes() == here.T.tobytes()


def test_samples_of_copies_have_no_model():
    for name, each in OTHERS.items():
        if find_spec(each.needs) is not None and each.needs != "open3d":
            kind = each.problems[0]
            assert not found(name, kind, np.repeat(planted(kind, 0.5, 0)[0][:2], 50, axis=0)).found


def test_a_threshold_is_shared_by_two_focal_lengths():
    from nonsac.estimators.others.library import normalised

    assert normalised(RelativePose(500.0, 1000.0), 1.0) == pytest.approx(1.5e-3)
    assert normalised(PROBLEMS["AbsolutePose"], 9.0) == pytest.approx(0.01)
