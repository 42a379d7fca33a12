"""A real cluster: processes of their own, one of which is killed in the middle."""

import os
import pickle
import signal
import socket
import threading
import time
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.method.search import SampleTask
from nonsac.running.executors import are_elsewhere, ordered_map, parsed

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=None
    ) as cluster:
        yield cluster


@pytest.fixture
def client(cluster):
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2, timeout=60)
        yield client


def same(a, b):
    np.testing.assert_array_equal(a.T, b.T)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert [h.score for h in a.hypotheses] == [h.score for h in b.hypotheses]
    assert (a.num_inliers, a.num_rows, a.confidence) == (b.num_inliers, b.num_rows, b.confidence)


@pytest.fixture
def rows_on_disk(tmp_path, rng):
    pairs = simulate.registration(40_000, 0.95, 0.01, rng)
    np.save(tmp_path / "rows.npy", np.hstack([pairs.source, pairs.target]))
    return tmp_path / "rows.npy"


def registered(rows, workers, **settings):
    source = nonsac.ArraySource(rows)
    estimator = nonsac.Pcr99.for_pairs()
    return nonsac.estimate(source, nonsac.Registration(), estimator, noise=0.01, workers=workers, **settings)


@pytest.mark.parametrize("refine", ["union", "full"])
def test_a_cluster_gives_the_same_bits(client, rows_on_disk, refine):
    rows = np.load(rows_on_disk)
    alone = registered(rows, 1, samples=12, refine=refine)
    same(registered(rows, client.get_executor(), samples=12, refine=refine), alone)
    same(registered(rows, client, samples=12, refine=refine), alone)
    same(registered(np.load(rows_on_disk, mmap_mode="r"), client, samples=12, refine=refine), alone)


@pytest.mark.parametrize("refine", ["union", "full"])
def test_a_cluster_draws_the_same_blocks(client, rows_on_disk, monkeypatch, refine):
    monkeypatch.setattr("nonsac.method.budget.LARGEST_SIZE", 100)
    monkeypatch.setattr("nonsac.method.budget._READ_AT_ONCE", 5000)
    monkeypatch.setattr("nonsac.sources.records._RUN", 48 * 500)
    settings = {"noise": 0.01, "samples": 12, "sample_size": 400, "refine": refine, "draw": "blocks"}
    alone = nonsac.register_pairs(nonsac.open_source(rows_on_disk), workers=1, **settings)
    assert alone.info["blocks"] == 16
    assert alone.num_rows == (40_000 if refine == "full" else 4800)
    same(alone, nonsac.register_pairs(nonsac.open_source(rows_on_disk), workers=client, **settings))


def test_samples_of_rows_in_memory_travel_together(client, rng):
    views = simulate.relative_pose(30_000, 0.8, 0.0025, rng)
    settings = {"noise": 0.0025, "samples": 40, "sample_size": 500}
    alone = nonsac.relative_pose(views.points1, views.points2, workers=1, **settings)
    same(alone, nonsac.relative_pose(views.points1, views.points2, workers=client, **settings))


def test_a_cluster_by_its_address(client, rows_on_disk):
    rows = np.load(rows_on_disk)
    alone = registered(rows, 1, samples=4)
    address = client.scheduler.address
    same(registered(rows, address, samples=4), alone)
    same(registered(rows, "dask", samples=4), alone)
    assert parsed(address)._client is parsed(address)._client
    parsed(address)._client.close()
    same(registered(rows, address, samples=4), alone)
    parsed(address)._client.close()


def test_a_killed_worker_costs_time_only(client, rows_on_disk):
    rows = np.load(rows_on_disk)
    alone = registered(rows, 1, samples=40)
    victims = list(client.run(os.getpid).values())
    hit = threading.Event()

    def progress(done, most):
        if done == 5:
            os.kill(victims[0], signal.SIGKILL)
            hit.set()

    result = registered(rows, client, samples=40, progress=progress)
    assert hit.is_set()
    same(result, alone)
    assert victims[0] not in client.run(os.getpid).values()


def test_what_travels_is_small(client, rng):
    """The rows of a sample, not those of the source, which are a hundred times as many."""
    source = nonsac.ArraySource(rng.random((200_000, 6)))
    task = SampleTask(source, nonsac.Registration(), nonsac.Pcr99.for_pairs(), nonsac.Noise.given(0.01), 2000, 0)
    assert len(pickle.dumps(task.packed(3))) < 110_000
    assert are_elsewhere(client)
    hypothesis = next(iter(ordered_map(task, 1, client, task.packed)))
    np.testing.assert_array_equal(hypothesis.residuals, task(0).residuals)


def test_a_cluster_without_workers_does_not_hang(rng, monkeypatch):
    monkeypatch.setattr("nonsac.running.dask.PATIENCE", 0.1)
    rows = rng.random((5000, 6))
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        distributed.Client(empty) as client,
        pytest.warns(UserWarning, match="the Dask cluster has no workers left"),
    ):
        result = registered(rows, client, samples=3)
    same(result, registered(rows, 1, samples=3))


def test_many_jobs_on_a_cluster_without_workers_do_not_hang(rng, monkeypatch):
    monkeypatch.setattr("nonsac.running.dask.PATIENCE", 0.1)
    points = rng.random((60, 3))
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        distributed.Client(empty) as client,
        pytest.raises(BrokenExecutor, match="the Dask cluster has no workers left"),
    ):
        list(nonsac.estimate_many([nonsac.Job("register_pairs", points, points)], workers=client))


def test_no_scheduler_is_said_at_once(monkeypatch):
    monkeypatch.setattr("nonsac.running.dask.PATIENCE", 0.5)
    with pytest.raises(ValueError, match=r"workers='tcp://127.0.0.1:1': no Dask scheduler answers there; check that"):
        list(ordered_map(abs, 3, "tcp://127.0.0.1:1"))
    with pytest.raises(ValueError, match=r'workers="dask" needs a distributed.Client; make one, or give the address'):
        list(ordered_map(abs, 3, "dask"))


def test_an_address_that_accepts_and_says_nothing(monkeypatch):
    monkeypatch.setattr("nonsac.running.dask.PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # the system accepts, nobody reads
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        start = time.monotonic()
        with pytest.raises(ValueError, match=rf"workers='{address}': no Dask scheduler answers there; check that"):
            parsed(address)
        assert time.monotonic() - start < 20


def use(address):
    return list(ordered_map(abs, 5, address))


def test_a_call_in_a_task_of_its_own_cluster():
    """It would wait for a worker while it occupies the only one."""
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        assert client.submit(use, client.scheduler.address, pure=False).result(timeout=30) == list(range(5))
        assert list(ordered_map(abs, 5, client)) == list(range(5))
        assert parsed(client) != 1


class Mute:
    """A client of a scheduler that has stopped answering."""

    status = "running"

    def nthreads(self):
        raise TimeoutError("timed out")


def test_a_scheduler_that_stops_answering_is_left(monkeypatch):
    monkeypatch.setattr("nonsac.running.dask.PATIENCE", 0.05)

    class Swallows(ThreadPoolExecutor):
        _client = Mute()

        def submit(self, task, /, *arguments):
            return Future()

    with pytest.warns(UserWarning, match="has no workers left, or does not answer"):
        assert list(ordered_map(abs, 3, Swallows(1))) == [0, 1, 2]
