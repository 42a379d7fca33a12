"""Many jobs on processes and executors: order, failures, deaths, and the same bits as the calls."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from multiprocessing import get_context

import numpy as np
import pytest

import nonsac
from batch_samples import Trouble, by_ransac, call
from match_samples import K, fill_database, parquet
from nonsac import Job, estimate_many, simulate
from nonsac.calls.registry import CALLS, Call
from nonsac.io import read_colmap_pair
from nonsac.running.processes import CannotStart, WorkerDied, WorkerProcesses

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")

PAIRS = simulate.registration(300, 0.5, 0.01, 0)


def job(name, **settings):
    return Job("register_pairs", PAIRS.source, PAIRS.target, name=name, **{"noise": 0.01, "samples": 2} | settings)


def trouble(name, *what):
    return job(name, estimator=Trouble(*what))


def facts(result):
    return (
        result.T.tobytes(),
        result.status,
        result.confidence,
        result.num_inliers,
        result.covariance.tobytes(),
        [h.model.tobytes() + h.residuals.tobytes() for h in result.hypotheses],
    )


def a_job_of_each_call():
    views, scene = simulate.relative_pose(300, 0.5, 0.001, 1), simulate.absolute_pose(300, 0.5, 0.001, 1)
    return [
        Job("relative_pose", views.points1, views.points2, noise=0.001, samples=2, name="a"),
        Job("absolute_pose", scene.points2d, scene.points3d, noise=0.001, samples=2, name="b"),
        job("c", rng=5),
        job("d", scale=None, weights=np.where(PAIRS.inliers, 2.0, 1.0)),
        job("e", estimator=by_ransac),
    ]


def direct(job):
    return call(job.call, job.data, job.settings)


@pytest.fixture(scope="module")
def threads():
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.mark.parametrize("kind", [1, 2, "threads", "dask"])
def test_results_are_those_of_the_calls_in_order_for_any_workers(kind, threads, request):
    jobs = a_job_of_each_call()
    workers = {"threads": threads}.get(kind, kind)
    if kind == "dask":
        workers = request.getfixturevalue("dask_executor")
    seen = []
    outcomes = list(estimate_many(jobs, workers=workers, progress=lambda *done: seen.append(done)))
    assert [job for job, _ in outcomes] == jobs
    expected = [direct(job) for job in jobs]
    assert all(result.success for result in expected)
    for (_, result), alone in zip(outcomes, expected, strict=True):
        if alone.covariance is None:
            assert result.covariance is None
            assert result.T.tobytes() == alone.T.tobytes()
        else:
            assert facts(result) == facts(alone)
        assert (result.inliers == alone.inliers).all()
    assert seen == [(done, 5) for done in (1, 2, 3, 4, 5)]


@pytest.fixture
def dask_executor():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


def test_raw_clouds_are_registered_too():
    scans = simulate.demo_scans(0, points=1500)
    [(_, result)] = estimate_many([Job("register_clouds", scans.source, scans.target, samples=2)], workers=1)
    expected = nonsac.register_clouds(scans.source, scans.target, samples=2, workers=1)
    assert result.T.tobytes() == expected.T.tobytes()


@pytest.mark.parametrize("workers", [1, 2])
def test_what_fails_takes_its_own_place_only(workers, tmp_path):
    (tmp_path / "text.npy").write_text("no array")
    jobs = [
        job("good"),
        Job("register_pairs", tmp_path / "none.npy", name="no file"),
        Job("register_pairs", str(tmp_path / "text.npy"), name="no array"),
        job("too short", noise=-1.0),
        Job("register_pairs", PAIRS.source, PAIRS.target[:-1]),
        trouble("raises", "raise"),
        job("good, too"),
    ]
    outcomes = [outcome for _, outcome in estimate_many(iter(jobs), workers=workers)]
    assert facts(outcomes[0]) == facts(outcomes[6]) == facts(direct(jobs[0]))
    assert all(isinstance(outcome, Exception) for outcome in outcomes[1:6])
    for outcome, words in zip(
        outcomes[1:6], ("none.npy", "text.npy", "noise", "300 and 299 rows", "1 and 2"), strict=True
    ):
        assert words in str(outcome)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_estimator_that_fails_in_every_sample_gives_a_result_that_says_so(workers):
    [(_, result)] = estimate_many([trouble("fails", "fail")], workers=workers)
    assert not result.found
    assert not result.success
    [remark] = result.remarks
    assert remark.startswith("the estimator failed in some samples: ")
    assert "Stubborn: 1 and 2" in remark


@pytest.mark.slow
def test_a_worker_that_dies_costs_its_own_job_after_a_second_try(tmp_path):
    marker = tmp_path / "died"
    jobs = [
        job("a"),
        trouble("once", "die once", str(marker)),
        trouble("killed", "die"),
        trouble("exits", "exit"),
        job("b"),
    ]
    outcomes = dict(zip("abcde", (outcome for _, outcome in estimate_many(jobs, workers=2)), strict=True))
    assert marker.exists()
    for name in "abe":
        assert facts(outcomes[name]) == facts(direct(job("a")))
    assert isinstance(outcomes["c"], WorkerDied)
    assert "was killed, perhaps for want of memory, twice" in str(outcomes["c"])
    assert "ended with exit code 3, twice" in str(outcomes["d"])


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("kind", ["parquet", "h5", "laz"])
@pytest.mark.slow
def test_a_file_that_ends_the_process_costs_its_own_job(tmp_path, workers, kind):
    """Even if all runs in this process, which the test would end with."""
    path, rows = tmp_path / f"rows.{kind}", np.hstack([PAIRS.source, PAIRS.target])
    data = (path,)
    if kind == "parquet":
        path.write_bytes(pairs_in_parquet())
    elif kind == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["rows"] = rows
    else:
        clouds(path, PAIRS.source), clouds(tmp_path / "other.laz", PAIRS.target)
        data = (path, tmp_path / "other.laz")
    np.save(tmp_path / "rows.npy", rows)
    settings = {"noise": 0.01, "samples": 2}
    jobs = [
        Job("register_pairs", *data, estimator=Trouble("exit"), **settings),
        Job("register_pairs", *data, **settings),
    ]
    jobs.append(Job("register_pairs", tmp_path / "rows.npy", **settings))
    (_, first), (_, second), (_, third) = estimate_many(jobs, workers=workers)
    assert isinstance(first, WorkerDied)
    assert str(first) == "its worker process ended with exit code 3, twice"
    assert second.success
    assert facts(third) == facts(direct(job("a")))


def pairs_in_parquet():
    rows = np.hstack([PAIRS.source, PAIRS.target])
    return parquet(**dict(zip(("x1", "y1", "z1", "x2", "y2", "z2"), rows.T, strict=True)))


def clouds(path, points):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    data = laspy.create(point_format=0, file_version="1.2")
    data.header.scales = [1e-6, 1e-6, 1e-6]
    data.x, data.y, data.z = points.T
    data.write(path)


def test_a_script_without_a_guard_does_not_run_anew(tmp_path):
    (tmp_path / "rows.parquet").write_bytes(pairs_in_parquet())
    script = tmp_path / "script.py"
    script.write_text(
        "import nonsac\nprint('started')\n"
        "job = nonsac.Job('register_pairs', 'rows.parquet', noise=0.01, samples=2)\n"
        "for _, result in nonsac.estimate_many([job], workers=1):\n    print(result.success)\n"
    )
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert (done.stdout, done.returncode) == ("started\nTrue\n", 0), done.stderr


class Counted:
    """A generator of jobs that tells how many were taken."""

    def __init__(self, count):
        self.count, self.taken = count, 0

    def __iter__(self):
        for _ in range(self.count):
            self.taken += 1
            yield job(str(self.taken))


@pytest.mark.parametrize(("workers", "most"), [(1, 1), (2, 4)])
def test_jobs_are_taken_as_they_are_needed(workers, most):
    jobs = Counted(30)
    outcomes = estimate_many(iter(jobs), workers=workers)
    assert jobs.taken == 0
    for given in range(1, 6):
        next(outcomes)
        assert jobs.taken <= given + most
    outcomes.close()
    assert jobs.taken <= 5 + most


def test_a_result_that_is_there_does_not_wait_for_a_slow_generator():
    """Each job is made only after the outcome of the one before came back."""
    came = threading.Semaphore(0)

    def jobs():
        for name in "abc":
            yield job(name)
            assert came.acquire(timeout=30) or name == "c"

    class AtOnce(ThreadPoolExecutor):
        def submit(self, task, *arguments):
            future = Future()
            future.set_result(task(*arguments))
            return future

    with AtOnce(4) as pool:
        for _ in estimate_many(jobs(), workers=pool):
            came.release()


def test_processes_are_gone_when_the_iterator_is_closed():
    outcomes = estimate_many([job(str(k)) for k in range(20)], workers=2)
    next(outcomes)
    assert len(children()) >= 1
    outcomes.close()
    assert children() == []


def children():
    import multiprocessing

    return multiprocessing.active_children()


def test_an_executor_is_left_running(threads):
    list(estimate_many([job("a")], workers=threads))
    assert threads.submit(len, "abc").result() == 3


def test_an_executor_that_breaks_ends_the_run():
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

    jobs = [trouble("killed", "die"), job("a"), job("b")]
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(BrokenExecutor),
    ):
        list(estimate_many(jobs, workers=pool))


@dataclass(frozen=True)
class Recorded(Call):
    """A call that notes how it was called."""

    @property
    def function(self):
        def call(*data, workers=None, **settings):
            GIVEN.append((self.name, settings.get("time_limit"), workers))

        return call


GIVEN = []


def test_time_limit_goes_to_the_calls_that_take_it(monkeypatch):
    recorded = {
        name: Recorded(**{each.name: getattr(call, each.name) for each in fields(Call)}) for name, call in CALLS.items()
    }
    monkeypatch.setattr("nonsac.calls.jobs.CALLS", recorded)
    monkeypatch.setattr(sys.modules[__name__], "GIVEN", [])
    names = [name for name in CALLS if name != "register_clouds"]
    for name in names:
        monkeypatch.setitem(vars(recorded[name]), "arguments", CALLS[name].arguments)
    jobs = [
        *(Job(name, PAIRS.source, PAIRS.target) for name in names),
        Job("register_pairs", PAIRS.source, PAIRS.target, time_limit=9.0),
        Job("register_clouds", PAIRS.source, PAIRS.target),
    ]
    list(estimate_many(jobs, workers=1, time_limit=2.0))
    assert [*((name, 2.0, 1) for name in names), ("register_pairs", 9.0, 1), ("register_clouds", None, 1)] == GIVEN


def test_files_are_read_where_the_job_runs(tmp_path):
    views, K = simulate.relative_pose(300, 0.5, 0.001, 1), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    pixels = [points * 500 + (320, 240) for points in (views.points1, views.points2)]
    scene = simulate.absolute_pose(300, 0.5, 0.001, 1)
    weights = np.where(views.inliers, 1.0, 0.5)
    np.savez(tmp_path / "m.npz", points1=pixels[0], points2=pixels[1], K1=K, K2=K, weights=weights)
    np.save(tmp_path / "p.npy", np.hstack([scene.points2d, scene.points3d]))
    np.save(tmp_path / "s.npy", PAIRS.source)
    np.save(tmp_path / "t.npy", PAIRS.target)
    jobs = [
        Job("relative_pose", tmp_path / "m.npz", noise=0.5, samples=2),
        Job("absolute_pose", str(tmp_path / "p.npy"), noise=0.001, samples=2),
        Job("register_pairs", tmp_path / "s.npy", tmp_path / "t.npy", noise=0.01),
    ]
    expected = [
        nonsac.relative_pose(*pixels, K, K, noise=0.5, samples=2, weights=weights),
        nonsac.absolute_pose(scene.points2d, scene.points3d, noise=0.001, samples=2),
        nonsac.register_pairs(PAIRS.source, PAIRS.target, noise=0.01),
    ]
    for (_, result), alone in zip(estimate_many(jobs, workers=1), expected, strict=True):
        assert result.success
        assert result.T.tobytes() == alone.T.tobytes()


def as_parquet(rows, names, **more):
    return parquet(**dict(zip(names, rows.T, strict=True)), **more)


@pytest.mark.parametrize("weights", [None, np.where(PAIRS.inliers, 2.0, 1.0), np.full(300, 0.7)])
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.slow
def test_pairs_are_read_from_parquet(make_file, workers, weights):
    """And other tables; equal weights are none in files that are read whole, as in arrays."""
    rows, names = np.hstack([PAIRS.source, PAIRS.target]), ("x1", "y1", "z1", "x2", "y2", "z2")
    more = {} if weights is None else {"weight": weights}
    path = make_file("p.parquet", as_parquet(rows[:, ::-1], names[::-1], **more, other=["a"] * 300))
    np.savez(path.with_suffix(".npz"), source=rows[:, :3], target=rows[:, 3:], **({"weights": weights} if more else {}))
    np.save(path.with_suffix(".npy"), rows if weights is None else np.column_stack([rows, weights]))
    files = [str(path), path, path.with_suffix(".npz"), path.with_suffix(".npy")]
    jobs = [Job("register_pairs", file, noise=0.01, samples=2, name=str(file)) for file in files]
    expected = direct(job("arrays", weights=weights))
    assert expected.success
    for each, result in estimate_many(jobs, workers=workers):
        np.testing.assert_allclose(result.T, expected.T, atol=1e-9)
        if each.name.endswith(".npz") or np.ptp(more.get("weight", (1, 2))) > 0:
            assert result.T.tobytes() == expected.T.tobytes()
            assert (result.covariance is None) == (expected.covariance is None)


def test_points_and_matches_are_read_from_parquet(make_file):
    views, scene = simulate.relative_pose(300, 0.5, 0.001, 1), simulate.absolute_pose(300, 0.5, 0.001, 1)
    matches = as_parquet(np.hstack([views.points1, views.points2]), ("x1", "y1", "x2", "y2"))
    points = as_parquet(np.hstack([scene.points2d, scene.points3d]), ("u", "v", "X", "Y", "Z"))
    jobs = [
        Job("relative_pose", make_file("m.parquet", matches), noise=0.001, samples=2),
        Job("absolute_pose", make_file("p.parquet", points), noise=0.001, samples=2),
    ]
    expected = map(direct, a_job_of_each_call()[:2])
    for (_, result), alone in zip(estimate_many(jobs, workers=1), expected, strict=True):
        assert result.success
        assert facts(result) == facts(alone)


def test_weights_of_the_settings_replace_those_of_the_file(tmp_path):
    weights = np.where(PAIRS.inliers, 2.0, 1.0)
    np.savez(tmp_path / "p.npz", source=PAIRS.source, target=PAIRS.target, weights=weights[::-1])
    result = Job("register_pairs", tmp_path / "p.npz", noise=0.01, samples=2, weights=weights).run()
    assert result.T.tobytes() == direct(job("arrays", weights=weights)).T.tobytes()
    assert result.T.tobytes() != Job("register_pairs", tmp_path / "p.npz", noise=0.01, samples=2).run().T.tobytes()
    with pytest.raises(ValueError, match="weights must have one number for each match"):
        Job("register_pairs", tmp_path / "p.npz", weights=weights[1:]).run()


def test_cameras_and_images_of_files_are_used(tmp_path, monkeypatch):
    fill_database(tmp_path / "a.db")
    with pytest.raises(
        nonsac.InputError, match=r"a\.db: a database holds the matches of many images; name two, as ima"
    ):
        Job("relative_pose", tmp_path / "a.db").run()
    with pytest.raises(nonsac.InputError, match=r"a\.db: holds no image 'none'"):
        Job("relative_pose", tmp_path / "a.db", image1="none", image2="b.jpg").run()
    jobs = [
        Job("relative_pose", tmp_path / "a.db", image1=3, image2="b.jpg", **given) for given in ({}, {"camera2": K})
    ]
    called = []
    monkeypatch.setattr("nonsac.calls.poses.relative_pose", lambda *data, **settings: called.append((data, settings)))
    expected = read_colmap_pair(tmp_path / "a.db", 3, "b.jpg")
    for each in jobs:
        each.run()
    for (source,), settings in called:
        np.testing.assert_array_equal(source.take(np.arange(2)), np.hstack([expected.points1, expected.points2]))
        assert settings["camera1"] == expected.camera1
        assert set(settings) == {"camera1", "camera2", "workers"}
    assert called[0][1]["camera2"] == expected.camera2
    assert called[1][1]["camera2"] is K


def test_files_without_matches_are_no_error_of_the_job(tmp_path):
    """Of hloc and COLMAP, which may find none; in whatever way weights are given."""
    fill_database(tmp_path / "a.db")
    for weights in (None, np.empty(0)):
        result = Job("relative_pose", tmp_path / "a.db", image1=3, image2=11, weights=weights, noise=1.0).run()
        assert not result.found


@pytest.mark.parametrize("count", [2, 3])
def test_files_that_do_not_belong_together_are_refused(make_file, count):
    files = [make_file(f"{number}.csv", "1 2 3 4 5\n") for number in range(count)]
    message = "a second file is for pairs of images or of clouds" if count == 2 else "is one file too many"
    with pytest.raises(nonsac.InputError, match=message):
        Job("absolute_pose", *files).run()


def test_a_generator_of_random_numbers_is_drawn_from_in_the_order_of_the_jobs():
    rng = np.random.default_rng(3)
    jobs = [job("a", rng=rng), job("b", rng=rng)]
    rng = np.random.default_rng(3)
    alone = [direct(job("a", rng=rng)), direct(job("b", rng=rng))]
    outcomes = [outcome for _, outcome in estimate_many(jobs[::-1], workers=1)][::-1]
    assert [facts(outcome) for outcome in outcomes] == [facts(result) for result in alone]


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: Job("register", "a"), ValueError, "one of relative_pose, .*got 'register'"),
        (
            lambda: Job("register_pairs", "a", nois=1.0),
            TypeError,
            "no setting 'nois' in a job; it has target, scale, weights, noise, samples,",
        ),
        (lambda: Job("register_clouds", "a", "b", time_limit=1), TypeError, "no setting 'time_limit'"),
        (lambda: Job("register_pairs", "a", workers=4), TypeError, "no setting 'workers'"),
        (lambda: Job("register_pairs", "a", np.eye(3)), TypeError, "arrays or paths, not both"),
        (lambda: Job("register_pairs", "a", rng=-1), ValueError, "rng"),
        (lambda: estimate_many([], workers=0), ValueError, "workers must be"),
        (lambda: estimate_many([], workers=True), ValueError, "workers must be"),
        (lambda: list(estimate_many(["a.npy"], workers=1)), TypeError, "nonsac.Job, got str"),
        (lambda: list(estimate_many(["a.npy"], workers=2)), TypeError, "nonsac.Job, got str"),
    ],
)
def test_wrong_use_is_refused(make, error, words):
    with pytest.raises(error, match=words):
        make()


UNGUARDED = """
import numpy as np, nonsac
print("begins", flush=True)
jobs = [nonsac.Job("register_pairs", np.eye(3), np.eye(3), noise=1.0)]
print(list(nonsac.estimate_many(jobs, workers=2)))
"""


def test_a_script_without_a_guard_ends_with_the_fix(tmp_path):
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert done.stdout.splitlines() == ["begins", "begins"]  # itself and one worker, not one for each try
    assert "under `if __name__ == '__main__':`" in done.stderr.splitlines()[-1]


HANGING = """
import nonsac
from batch_samples import Trouble

if __name__ == "__main__":
    pairs = nonsac.simulate.registration(100, 0.5, 0.01, 0)
    jobs = [nonsac.Job("register_pairs", pairs.source, pairs.target, noise=0.01, estimator=Trouble("hang"))] * 4
    list(nonsac.estimate_many(jobs, workers=2))
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_parent(tmp_path, kind):
    (tmp_path / "script.py").write_text(HANGING)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    pipes = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(
        [sys.executable, tmp_path / "script.py"], **pipes, env=environment, text=True, start_new_session=True
    ) as parent:
        try:
            assert [parent.stdout.readline() for _ in range(2)] == ["at work\n"] * 2
            if kind == signal.SIGINT:
                os.killpg(parent.pid, kind)  # as a terminal does, to the workers, too
            else:
                parent.kill()
            assert parent.wait(timeout=20) == -kind
            assert parent.stdout.read() == ""  # which ends when the last process that holds it is gone
        finally:
            parent.kill()


def test_the_exception_of_a_process_comes_back_whole():
    with WorkerProcesses(1) as pool, pytest.raises(ZeroDivisionError):
        pool.submit(divmod, 1, 0).result()


def test_closed_workers_take_no_task():
    pool = WorkerProcesses(1)
    assert pool.submit(divmod, 7, 2).result() == (3, 1)
    pool.shutdown(cancel_futures=True)
    with pytest.raises(RuntimeError):
        pool.submit(divmod, 7, 2)


def test_a_process_that_may_start_none_says_so(monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(CannotStart, match=r"multiprocessing\.Pool are, and may start none; set workers=1 here"):
        next(estimate_many([job("a")], workers=2))
