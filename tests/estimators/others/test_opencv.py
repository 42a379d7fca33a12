"""OpenCV's estimators as cores."""

import numpy as np
import pytest

from nonsac import AbsolutePose
from nonsac.estimators.named import ESTIMATORS, chosen_estimator
from others_samples import NOISE, SEEDS, found, planted, solved

cv2 = pytest.importorskip("cv2", reason="needs the extra opencv")
OUTLIERS = {"RelativePose": 0.5, "AbsolutePose": 0.7}
FLAGS = {"opencv": "USAC_DEFAULT", "opencv-accurate": "USAC_ACCURATE", "opencv-magsac": "USAC_MAGSAC"}
EVERY = [(name, kind) for name, each in ESTIMATORS.items() if each.needs == "cv2" for kind in each.problems]


def directly(name, kind, rows):
    """OpenCV as its users call it, at the threshold that the adapter passes on."""
    if kind == "RelativePose":
        bound, settings = 2.0 * NOISE[kind] * np.mean([1 / 800, 1 / 1000]), {"method": getattr(cv2, FLAGS[name])}
        first, second = (np.ascontiguousarray(half) for half in np.hsplit(rows, 2))
        matrix, mask = cv2.findEssentialMat(
            first, second, np.eye(3), prob=0.9999, threshold=bound, maxIters=100_000, **settings
        )
        _, rotation, shift, _ = cv2.recoverPose(matrix, first, second, np.eye(3), mask=mask)
        return np.column_stack([rotation, shift])
    flag = {"opencv-p3p": cv2.SOLVEPNP_P3P, "opencv-sqpnp": cv2.SOLVEPNP_SQPNP}.get(name)
    K = np.diag([900.0, 900.0, 1.0])
    ok, turn, shift, _ = cv2.solvePnPRansac(
        np.ascontiguousarray(rows[:, 2:]),
        900.0 * rows[:, :2],
        K,
        None,
        iterationsCount=20_000,
        reprojectionError=5.0 * NOISE[kind],
        confidence=0.9999,
        flags=cv2.SOLVEPNP_P3P if flag is None else flag,
    )
    return np.column_stack([cv2.Rodrigues(turn)[0], shift]) if ok else np.full((3, 4), np.nan)


@pytest.mark.parametrize(("name", "kind"), EVERY)
def test_it_solves_as_much_as_the_library_itself(name, kind):
    own = others = 0
    for seed in range(SEEDS):
        rows, truth = planted(
            kind, 0.5 if name == "opencv-sqpnp" else OUTLIERS[kind], seed
        )  # OpenCV's own draws five rows
        own += solved(found(name, kind, rows, seed=seed).model, kind, truth)
        others += solved(directly(name, kind, rows), kind, truth)
    assert own >= others
    assert own == SEEDS


@pytest.mark.parametrize("name", FLAGS)
def test_parameters_stand_for_the_flag(name):
    """A flag has the seed 0; with that, parameters give the same essential matrix."""
    from nonsac.estimators.others import opencv

    rows, _ = planted("RelativePose", 0.5, 0)
    first, second = (np.ascontiguousarray(half) for half in np.hsplit(np.round(rows, 9), 2))
    by_flag, _ = cv2.findEssentialMat(
        first, second, np.eye(3), getattr(cv2, FLAGS[name]), prob=0.9999, threshold=0.002, maxIters=1000
    )
    poses = opencv.two_views(np.hstack([first, second]), opencv._settings(FLAGS[name][5:].lower(), 0.002, 0, 1000))
    expected = np.concatenate([each[None] for each in cv2.decomposeEssentialMat(by_flag)[:2]])
    np.testing.assert_allclose(poses[[0, 2], :, :3], expected, atol=1e-9)


def test_the_baseline_points_to_where_points_are_in_front():
    for seed in range(5):
        rows, truth = planted("RelativePose", 0.3, seed)
        model = found("opencv", "RelativePose", rows).model
        assert model[:, 3] @ truth[:3, 3] > 0.9
        assert np.linalg.det(model[:, :3]) == pytest.approx(1.0)


def test_another_seed_is_another_search():
    rows, _ = planted("RelativePose", 0.6, 0)
    models = [found("opencv", "RelativePose", rows, seed=seed).model for seed in (0, 0, 1)]
    np.testing.assert_array_equal(models[0], models[1])
    assert not np.array_equal(models[0], models[2])


@pytest.mark.parametrize("name", ["opencv", "opencv-p3p", "opencv-sqpnp"])
def test_single_precision_bears_a_world_far_away(name):
    rows, truth = planted("AbsolutePose", 0.5, 0)
    rows[:, 2:] = 1000.0 * rows[:, 2:] + [5e6, 6e6, 100.0]
    assert solved(found(name, "AbsolutePose", rows).model, "AbsolutePose", truth, 0.5)


def test_three_rows_are_too_few_for_p3p_and_a_fourth_point():
    rows = planted("AbsolutePose", 0.0, 0)[0][:3]
    assert not found("opencv-p3p", "AbsolutePose", rows).found


def test_magsac_is_not_for_one_view():
    with pytest.raises(TypeError, match=r"^opencv-magsac is for relative poses, got AbsolutePose$"):
        chosen_estimator("opencv-magsac", AbsolutePose())
