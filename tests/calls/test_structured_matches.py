"""Wrong matches that have structure, and data that determine little: nothing wrong is to be trusted."""

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.evaluation import rotation_error

SEEDS = pytest.mark.parametrize("seed", range(6))


def direction_error(t, truth):
    return np.degrees(np.arccos(np.clip(t @ truth / np.linalg.norm(truth), -1.0, 1.0)))


# --- few facts, repeated ----------------------------------------------------------------------------------------------


@SEEDS
@pytest.mark.parametrize("noise", [None, 0.3])
def test_eight_blobs_matched_at_random_are_no_views_of_a_scene(seed, noise):
    """In pixels: 1,500 matches, of blobs a third of a pixel wide."""
    camera = nonsac.Camera("PINHOLE", (1000.0, 1000.0, 800.0, 600.0))
    blobs = simulate.blobs_in_images(1500, 8, 0.3 / 1000.0, seed)
    points1, points2 = (1000.0 * points + [800.0, 600.0] for points in (blobs.points1, blobs.points2))
    result = nonsac.relative_pose(points1, points2, camera, noise=noise, workers=1)
    assert not result.success
    assert result.confidence < 0.5


@SEEDS
@pytest.mark.parametrize("noise", [None, 0.01])
def test_eight_blobs_matched_at_random_are_not_registered(seed, noise):
    blobs = simulate.blobs_in_space(1000, 8, 0.01, seed)
    result = nonsac.register_pairs(blobs.source, blobs.target, noise=noise, workers=1)
    assert not result.success
    assert result.confidence < 0.5


def test_blobs_that_a_motion_relates_are_registered():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        truth = simulate.registration(1, 0.0, 0.0, seed).T
        blobs = np.repeat(rng.standard_normal((40, 3)), 25, axis=0)
        source, target = (
            points + 0.01 * rng.standard_normal(points.shape) for points in (blobs, blobs @ truth[:3, :3].T)
        )
        result = nonsac.register_pairs(source, target, noise=0.01, workers=1)
        assert result.success
        assert rotation_error(result.R, truth[:3, :3]) < 1.0


# --- matches that are wrong by little ---------------------------------------------------------------------------------


@SEEDS
@pytest.mark.parametrize("displaced", [0.3, 0.6])
@pytest.mark.parametrize("reach", [0.01, 0.03])
def test_matches_displaced_by_some_pixels_make_no_baseline(seed, displaced, reach):
    views = simulate.local_displacements(600, displaced, reach, 5e-4, seed)
    result = nonsac.relative_pose(views.points1, views.points2, noise=5e-4, workers=1)
    assert not result.success
    if result.status is nonsac.Status.DEGENERATE and result.remarks:
        assert result.remarks[0].startswith("pure rotation")
        assert rotation_error(result.R, views.T[:3, :3]) < 2.0


@SEEDS
def test_a_baseline_among_displaced_matches_is_found(seed):
    """The same with a scene in depth, of which as many matches are right."""
    views = simulate.moving_object(600, 0.0, 0.0, 5e-4, seed)
    rng = np.random.default_rng(seed)
    wrong = rng.random(600) < 0.3
    views.points2[wrong] += rng.uniform(-0.03, 0.03, (wrong.sum(), 2))
    result = nonsac.relative_pose(views.points1, views.points2, noise=5e-4, workers=1)
    assert result.success
    assert rotation_error(result.R, views.T[:3, :3]) < 1.0
    assert direction_error(result.t, views.T[:3, 3]) < 5.0


# --- real ones --------------------------------------------------------------------------------------------------------


def real_files(data, folder, pattern="*.npz"):
    files = sorted((data / folder).glob(pattern))
    if not files:
        pytest.skip(f"no real matches: {data / folder} has none")
    return [np.load(path) for path in files]


def registered(matches, mutual):
    some = matches["mutual"] if mutual else slice(None)
    result = nonsac.register_pairs(
        matches["src"][some], matches["tgt"][some], noise=float(matches["tau"]) / 5, workers=1
    )
    return result, rotation_error(result.R, matches["T_tgt_src"][:3, :3])


MUTUAL = pytest.mark.parametrize("mutual", [False, True], ids=["all", "mutual"])


@MUTUAL
def test_statues_on_round_bases_are_not_trusted_where_they_are_wrong(data, mutual):
    outcomes = [registered(matches, mutual) for matches in real_files(data, "corr3d_statues")]
    assert not [error for result, error in outcomes if result.success and error > 10.0]
    assert sum(result.success and error < 5.0 for result, error in outcomes) >= 3


@MUTUAL
def test_all_of_the_matches_of_scans_are_trusted_and_right(data, mutual):
    for matches in real_files(data, "corr3d_fpfh"):
        result, error = registered(matches, mutual)
        assert result.success
        assert error < 5.0


@pytest.mark.parametrize("noise", [0.5, None])
@pytest.mark.parametrize("ratio", [0.7, 0.8, 0.9, 0.96])
def test_a_long_lens_is_not_trusted_where_it_is_wrong(data, ratio, noise):
    for matches in real_files(data, "narrow_view"):
        some = matches["ratio"] < ratio
        points, cameras = (matches["x1"][some], matches["x2"][some]), (matches["K1"], matches["K2"])
        result = nonsac.relative_pose(*points, *cameras, noise=noise, workers=1)
        errors = rotation_error(result.R, matches["R"]), direction_error(result.t, matches["t"])
        assert not result.success or max(errors) < 10.0
