import dataclasses
import json
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.io import InputError
from nonsac.problems import Registration
from nonsac.problems.pose import homogeneous
from nonsac.result import (
    Alternative,
    Evidence,
    FailedEstimation,
    Hypothesis,
    Remark,
    Result,
    Status,
    Uncertainty,
    failed,
)
from nonsac.sources import ArraySource

ANGLES = pytest.mark.parametrize("degrees", [0.0, 30.0, 180.0])


def a_result(model=None, status=Status.OK, **settings):
    model = naive.random_model(np.random.default_rng(0)) if model is None else model
    hypothesis = Hypothesis(model, np.array([0.1, 0.2, 9.0, np.inf]), 1.0, sample=2, score=3.5)
    nothing = Hypothesis(np.full((3, 4), np.nan), np.full(4, np.inf), 1.0, sample=3, score=-np.inf)
    defaults = {
        "model": model,
        "status": status,
        "confidence": 0.99,
        "num_inliers": 12,
        "num_rows": 48,
        "noise": 0.2,
        "threshold": 1.0,
        "hypotheses": (hypothesis, nothing),
        "alternatives": (Alternative(np.eye(4)[:3], 0.4, np.eye(4)),),
        "info": {"seed": 3, "seconds": {"hypotheses": 0.1}, "spacing": np.float64(0.5), "counts": np.array([1, 2])},
        "evidence": Evidence(Registration()),
    }
    return Result(**(defaults | settings))


def a_line(**settings):
    """A result whose model is no motion."""
    line = naive.line_model(30.0, 2.0)
    own = {"evidence": Evidence(naive.Line()), "alternatives": (Alternative(2.0 * line, 0.4),), "hypotheses": ()}
    return a_result(line, **(own | settings))


def a_failure(problem=None, **info):
    return failed(Status.TOO_FEW, Evidence(problem or Registration()), {"seed": 3, **info})


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
    assert "model" not in told
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


@pytest.mark.parametrize("result", [a_line(), a_failure(naive.Line())], ids=["found", "failed"])
def test_json_of_a_model_that_is_no_motion_has_the_model(result):
    told = strict_json(result.to_json())
    assert told["model"] == (result.model.tolist() if result.found else [None] * 3)
    assert not {"T", "scale"} & set(told)
    assert told["alternatives"] == [{"model": a.model.tolist(), "support": 0.4} for a in result.alternatives]


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
    text = repr(a_result(np.eye(4)[:3] if found else np.full((3, 4), np.nan), status))
    lines = text.splitlines()
    assert len(lines) <= 6
    assert max(map(len, lines)) <= 120
    assert str(status) in lines[0]
    if status is not Status.OK:
        assert status.explanation in text
    if found:
        assert "12 of 48 (25 %)" in text


def test_repr_tells_how_uncertain_the_answer_is():
    sure = a_result(np.eye(4)[:3], uncertainty=Uncertainty(0.1234, 7.0, 2.5))
    assert "  95 % within 0.12 deg of rotation, 7 of translation" in repr(sure).splitlines()
    direction = a_result(np.eye(4)[:3], uncertainty=Uncertainty(0.1234, 2.5, 2.5))
    assert "  95 % within 0.12 deg of rotation, 2.5 deg of translation" in repr(direction).splitlines()
    assert "95 %" not in repr(a_result(np.eye(4)[:3]))


@ANGLES
def test_repr_tells_the_angle_and_the_scale(degrees):
    R = Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
    text = repr(a_result(np.column_stack([2.5 * R, [1.0, 2.0, 3.0]])))
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


@pytest.mark.parametrize("kind", [Status, Remark])
def test_every_status_and_every_remark_explains_itself(kind):
    assert len({each.explanation for each in kind}) == len(kind)
    assert all(":" not in each for each in kind)


def test_remarks_are_told():
    remarks = (Remark.PLANAR, Remark.NOISE_LARGER.detailed("by a factor of 4.2"))
    assert remarks[1] == "noise is larger than given: by a factor of 4.2"
    for result in (a_result(info={"remarks": remarks}), a_failure(remarks=remarks)):
        assert result.remarks == remarks
        assert strict_json(result.to_json())["info"]["remarks"] == list(remarks)
        assert repr(result).splitlines()[-2:] == [f"  remark: {remark}" for remark in remarks]
    assert a_result().remarks == ()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
def test_parts_of_a_similarity(rng, scale):
    model = naive.random_model(rng, scale)
    result = a_result(model)
    np.testing.assert_array_equal(result.T, np.vstack([model, [0, 0, 0, 1]]))
    assert result.scale == pytest.approx(scale)
    np.testing.assert_allclose(result.R, model[:, :3] / scale, atol=1e-12)
    np.testing.assert_allclose(result.rotation.as_matrix(), model[:, :3] / scale, atol=1e-12)
    np.testing.assert_array_equal(result.t, model[:, 3])
    points = rng.standard_normal((7, 3))
    np.testing.assert_allclose(result.apply(points), naive.moved(model, points), atol=1e-12)
    np.testing.assert_allclose(result.apply(points.tolist()), naive.moved(model, points), atol=1e-12)


def test_parts_of_a_failure_are_nan_without_a_warning():
    result = a_failure()
    assert not result.found
    assert np.isnan(result.model).all()
    assert result.T.shape == (4, 4)
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
    np.testing.assert_array_equal(result.model, before[:3])


@pytest.mark.parametrize("name", ["T", "R", "t", "scale", "rotation"])
@pytest.mark.parametrize("result", [a_line(), a_failure(naive.Line())], ids=["found", "failed"])
def test_a_model_that_is_no_motion_has_no_parts_of_one(name, result):
    assert not result.is_motion
    with pytest.raises(AttributeError, match=r"a model of Line is no motion, .* see result\.model"):
        getattr(result, name)


def test_what_is_a_motion_says_so():
    assert a_result().is_motion
    assert a_failure().is_motion


@pytest.mark.parametrize("problem", [Registration(), naive.Shift(), naive.Line()])
def test_a_failure_has_a_model_of_the_problems_own_shape(problem):
    assert a_failure(problem).model.shape == problem.model_shape


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


def test_the_text_of_a_model_of_the_users_own_kind_is_its_numbers():
    text = repr(a_line())
    assert "  model [0.866025 0.5      2.      ]" in text.splitlines()


def test_a_problem_may_put_its_models_in_words():
    class Told(naive.Line):
        def describe(self, model):
            return f"a line {model[2]:g} from the origin"

    assert "  a line 2 from the origin" in repr(a_line(evidence=Evidence(Told()))).splitlines()


@pytest.mark.parametrize("weights", [0, 1])
def test_residuals_are_those_of_all_rows_of_the_source(rng, weights):
    rows = np.column_stack([rng.uniform(-3, 3, (20_000, 2)), *[np.ones(20_000)] * weights])
    rows[::1000, 1] = np.nan
    result = a_line(evidence=Evidence(naive.Line(), ArraySource(rows)))
    expected = np.abs(rows[:, :2] @ result.model[:2] - result.model[2])
    np.testing.assert_allclose(result.residuals, expected, atol=1e-12)
    np.testing.assert_array_equal(result.inliers, result.residuals < 1.0)
    assert np.isnan(result.residuals[::1000]).all()


def test_what_a_result_was_not_given_it_says():
    for name in ("residuals", "inliers"):
        with pytest.raises(AttributeError, match="there are no rows to give residuals of: the data were raw clouds"):
            getattr(a_result(), name)
        with pytest.raises(AttributeError, match="made by hand"):
            getattr(a_result(evidence=None), name)
    with pytest.raises(AttributeError, match="made by hand"):
        _ = a_result(evidence=None).T
