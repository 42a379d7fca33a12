import dataclasses
import json
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.io import InputError
from nonsac.result import (
    Alternative,
    FailedEstimation,
    Hypothesis,
    Result,
    Status,
    failed,
    homogeneous,
    threshold_of,
)

ANGLES = pytest.mark.parametrize("degrees", [0.0, 30.0, 180.0])


def a_result(T=None, status=Status.OK, **settings):
    T = homogeneous(naive.random_model(np.random.default_rng(0))) if T is None else T
    hypothesis = Hypothesis(T[:3], np.array([0.1, 0.2, 9.0, np.inf]), 1.0, sample=2, score=3.5)
    nothing = Hypothesis(np.full((3, 4), np.nan), np.full(4, np.inf), 1.0, sample=3, score=-np.inf)
    defaults = {
        "T": T,
        "status": status,
        "confidence": 0.99,
        "num_inliers": 12,
        "num_rows": 48,
        "noise": 0.2,
        "threshold": 1.0,
        "hypotheses": (hypothesis, nothing),
        "alternatives": (Alternative(np.eye(4), 0.4),),
        "info": {"seed": 3, "seconds": {"hypotheses": 0.1}, "spacing": np.float64(0.5), "counts": np.array([1, 2])},
    }
    return Result(**(defaults | settings))


def a_failure():
    return failed(Status.TOO_FEW, float("nan"), {"seed": 3})


def strict_json(text):
    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_json_is_valid_and_complete():
    result = a_result()
    told = strict_json(result.to_json())
    assert told["success"] is True
    assert told["status"] == "ok"
    assert told["explanation"] == Status.OK.explanation
    np.testing.assert_array_equal(told["T"], result.T)
    assert (told["confidence"], told["num_inliers"], told["num_rows"], told["inlier_ratio"]) == (0.99, 12, 48, 0.25)
    assert (told["noise"], told["threshold"]) == (0.2, 1.0)
    assert told["scale"] == pytest.approx(1.0)
    assert told["alternatives"] == [{"T": np.eye(4).tolist(), "support": 0.4}]
    assert [(h["sample"], h["num_inliers"], h["score"]) for h in told["hypotheses"]] == [(2, 2, 3.5), (3, 0, None)]
    assert told["hypotheses"][1]["model"] == [[None] * 4] * 3
    assert told["info"] == {"seed": 3, "seconds": {"hypotheses": 0.1}, "spacing": 0.5, "counts": [1, 2]}


def test_json_of_a_failure_has_null_for_nan():
    told = strict_json(a_failure().to_json())
    assert told["T"] == [[None] * 4] * 4
    assert told["scale"] is None
    assert told["noise"] is None
    assert told["success"] is False
    assert (told["status"], told["confidence"]) == ("too_few", 0.0)


def test_json_may_be_indented():
    assert "\n" not in a_result().to_json()
    assert strict_json(a_result().to_json(indent=2)) == strict_json(a_result().to_json())


def test_save_writes_the_json_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    a_result().save(path)
    assert strict_json(path.read_text(encoding="utf-8")) == a_result().to_dict()
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]

    def full_disk(*args):
        raise OSError(28, "No space left on device")

    before = path.read_bytes()
    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(InputError, match="No space left"):
        a_failure().save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_save_replaces_an_older_file(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old " * 100_000)
    a_failure().save(str(path))
    assert strict_json(path.read_text())["status"] == "too_few"


@pytest.mark.parametrize("status", Status)
@pytest.mark.parametrize("found", [True, False])
def test_repr_fits_six_lines_and_names_the_status(status, found):
    text = repr(a_result(np.eye(4) if found else np.full((4, 4), np.nan), status))
    lines = text.splitlines()
    assert len(lines) <= 6
    assert max(map(len, lines)) <= 120
    assert str(status) in lines[0]
    if status is not Status.OK:
        assert status.explanation in text
    if found:
        assert "12 of 48 (25 %)" in text


@ANGLES
def test_repr_tells_the_angle_and_the_scale(degrees):
    R = Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
    text = repr(a_result(homogeneous(np.column_stack([2.5 * R, [1.0, 2.0, 3.0]]))))
    assert f"rotation {degrees:.3f} deg, translation [1, 2, 3], scale 2.5" in text


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.OK])
def test_a_failure_raises_on_demand(status):
    with pytest.raises(FailedEstimation, match=f"{status}: ") as caught:
        a_result(status=status).raise_if_failed()
    assert status.explanation in str(caught.value)


def test_a_success_returns_itself():
    result = a_result()
    assert result.raise_if_failed() is result


def test_only_ok_is_success():
    assert [s for s in Status if a_result(status=s).success] == [Status.OK]


def test_every_status_explains_itself():
    assert len({status.explanation for status in Status}) == len(Status)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
def test_parts_of_a_similarity(rng, scale):
    model = naive.random_model(rng, scale)
    result = a_result(homogeneous(model))
    assert result.scale == pytest.approx(scale)
    np.testing.assert_allclose(result.R, model[:, :3] / scale, atol=1e-12)
    np.testing.assert_allclose(result.rotation.as_matrix(), model[:, :3] / scale, atol=1e-12)
    np.testing.assert_array_equal(result.t, model[:, 3])
    points = rng.standard_normal((7, 3))
    np.testing.assert_allclose(result.apply(points), naive.moved(model, points), atol=1e-12)
    np.testing.assert_allclose(result.apply(points.tolist()), naive.moved(model, points), atol=1e-12)


def test_parts_of_a_failure_are_nan_without_a_warning():
    result = a_failure()
    assert np.isnan(result.T).all()
    assert np.isnan(result.scale)
    assert np.isnan(result.R).all()
    assert np.isnan(result.t).all()
    assert np.isnan(result.apply(np.zeros((2, 3)))).all()
    assert result.inlier_ratio == 0.0


def test_parts_do_not_alias_the_motion():
    result = a_result()
    before = result.T.copy()
    result.t[:] = 9.0
    result.R[:] = 9.0
    np.testing.assert_array_equal(result.T, before)


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Result)])
def test_results_are_frozen(name):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(a_result(), name, None)


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Hypothesis)])
def test_hypotheses_are_frozen(name):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(a_result().hypotheses[0], name, None)


def test_results_pickle():
    copy = pickle.loads(pickle.dumps(a_result()))
    assert copy.to_json() == a_result().to_json()


def test_a_hypothesis_counts_residuals_below_the_threshold():
    hypothesis = Hypothesis(np.eye(4)[:3], np.array([0.5, 1.0, 1.5, np.nan, np.inf, 0.0]), 1.0)
    assert hypothesis.found
    assert hypothesis.num_inliers == 2
    np.testing.assert_array_equal(hypothesis.inlier_residuals, [0.5, 0.0])


def test_a_hypothesis_with_any_nan_is_not_found():
    model = np.eye(4)[:3].copy()
    model[2, 3] = np.nan
    assert not Hypothesis(model, np.zeros(3), 1.0).found


def test_homogeneous_adds_the_last_row(rng):
    model = rng.standard_normal((3, 4))
    np.testing.assert_array_equal(homogeneous(model), np.vstack([model, [0, 0, 0, 1]]))


def test_the_threshold_is_five_standard_deviations():
    assert threshold_of(0.01) == 0.05
    assert type(threshold_of(1)) is float


def test_the_text_of_a_model_of_the_users_own_kind_is_its_numbers():
    T = np.eye(4)
    T[:3] = 0.0
    T[0, :3] = [0.5, -1.0, 0.25]
    text = repr(Result(T, Status.OK, 0.9, 3, 4, 0.1, 0.5))
    assert "model [ 0.5  -1.    0.25" in text
