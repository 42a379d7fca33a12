"""Which pairs measure the noise of a scene, what they share, and who is tried without it."""

import pytest

from nonsac import Job, simulate
from nonsac.calls.pooling import FIRST_PAIRS, PooledRun, first_of_scenes, pooled_noise


def test_the_median_of_enough():
    assert pooled_noise([3.0, 1.0, 2.0, 9.0, 2.5]) == 2.5
    assert pooled_noise(iter([1.0, 1.0, 1.0, 1.0])) is None
    assert pooled_noise([]) is None


def test_the_first_pairs_of_each_scene():
    scenes = dict.fromkeys(range(0, 60, 2), "hall") | dict.fromkeys(range(1, 9, 2), "yard")
    first = first_of_scenes(dict(sorted(scenes.items())))
    assert first == {"hall": list(range(0, 2 * FIRST_PAIRS, 2)), "yard": [1, 3, 5, 7]}


@pytest.fixture
def runs(monkeypatch):
    """The noises that jobs are run with."""
    noises, run = [], Job.run

    def noted(job, time_limit=None):
        noises.append(job.settings.get("noise"))
        return run(job, time_limit)

    monkeypatch.setattr(Job, "run", noted)
    return noises


def job(outliers=0.3, noise=0.001):
    views = simulate.relative_pose(300, outliers, noise, 2)
    return Job("relative_pose", views.points1, views.points2)


def test_a_pair_that_fits_the_noise_is_run_once(runs):
    assert PooledRun(0.001)(job()).success
    assert runs == [0.001]


def test_a_pair_without_support_is_not_tried_again(runs):
    assert not PooledRun(0.001)(job(outliers=1.0)).success
    assert runs == [0.001]


def test_a_pair_that_is_doubted_with_the_noise_is_tried_without_it(runs):
    result = PooledRun(0.0004)(job(noise=0.004))
    assert runs == [0.0004, None]
    assert result.success
    assert result.noise == pytest.approx(0.004, rel=0.3)


def test_without_a_shared_noise_each_measures_its_own(runs):
    assert PooledRun()(job()).success
    assert runs == [None]
