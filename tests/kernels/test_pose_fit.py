from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.pose_fit import fit_pose, move, normal_equations
from nonsac.kernels.reprojection import reprojection_jacobian
from nonsac.kernels.sampson import sampson_jacobian

NOISE = 1e-3  # in normalised coordinates


def angular_pose(p):
    """[R | t] from a rotation vector and the two angles of a direction."""
    sine = np.sin(p[3])
    t = [sine * np.cos(p[4]), sine * np.sin(p[4]), np.cos(p[3])]
    return np.column_stack([Rotation.from_rotvec(p[:3]).as_matrix(), t])


def angles_of(model):
    t = model[:, 3]
    return np.r_[Rotation.from_matrix(model[:, :3]).as_rotvec(), np.arccos(t[2]), np.arctan2(t[1], t[0])]


RELATIVE = SimpleNamespace(
    size=5,
    least_rows=5,
    make_model=naive.random_pose,
    make_rows=naive.two_view_rows,
    nudge=lambda rng, model, degrees: naive.nudged(rng, model, degrees, direction=True),
    pixels=lambda rows, f: rows * [f[0], f[0], f[1], f[1]],
    errors=lambda model, rows, f: naive.signed_sampson(model, rows, *f)[:, None],  # (n, residuals of a row)
    parameters=angles_of,  # another parametrisation, and its inverse
    model_of=angular_pose,
)
ABSOLUTE = SimpleNamespace(
    size=6,
    least_rows=3,
    make_model=naive.random_model,
    make_rows=naive.one_view_rows,
    nudge=naive.nudged,
    pixels=lambda rows, f: rows * [f[0], f[0], 1, 1, 1],
    errors=lambda model, rows, f: naive.image_errors(model, rows, f[0]),
    parameters=lambda model: np.r_[Rotation.from_matrix(model[:, :3]).as_rotvec(), model[:, 3]],
    model_of=lambda p: np.column_stack([Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]]),
)
kinds = pytest.mark.parametrize("kind", [RELATIVE, ABSOLUTE], ids=["relative", "absolute"])
focals = pytest.mark.parametrize("f", [(1.0, 1.0), (700.0, 1100.0)], ids=["normalised", "pixels"])


def columns_of(kind, rows, f):
    return np.ascontiguousarray(kind.pixels(rows, f).T)


def fit(kind, rows, start, weights=None, threshold=np.inf, iterations=50, f=(1.0, 1.0)):
    """Whether the rows determine a pose, and where the search ended."""
    model = start.copy()
    weights = np.ones(len(rows)) if weights is None else weights
    return fit_pose(columns_of(kind, rows, f), weights, threshold, iterations, np.array(f), model), model


def stepped(model, step):
    result = np.full((3, 4), np.nan)
    move(model, np.asarray(step, float), result)
    return result


def jacobian(kind, model, rows, f):
    """Residuals (n, d) and derivatives (n, d, p) by the kernels."""
    n, d = len(rows), kind.size - 4
    residuals, derivatives = np.full((n, d), np.nan), np.full((n, d, kind.size), np.nan)
    if kind is RELATIVE:
        sampson_jacobian(columns_of(kind, rows, f), np.array(f), model, residuals[:, 0], derivatives[:, 0])
    else:
        reprojection_jacobian(columns_of(kind, rows, f), f[0], model, residuals, derivatives)
    return residuals, derivatives


def equations(kind, model, rows, weights, threshold, f):
    hessian, gradient = np.full((kind.size, kind.size), np.nan), np.full(kind.size, np.nan)
    columns, work = columns_of(kind, rows, f), np.empty((6, 3, 3) if kind.size == 5 else (2, 6))
    cost = normal_equations(columns, weights, threshold, np.array(f), model, work, hessian, gradient)
    return cost, hessian, gradient


# --- steps on the manifold --------------------------------------------------------------------------------------------


@kinds
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-5, 1e-3, 0.3, 3.0])
def test_a_step_turns_the_rotation_from_the_left(rng, kind, size):
    model, step = kind.make_model(rng), np.zeros(kind.size)
    step[:3] = size * rng.standard_normal(3)
    there = stepped(model, step)
    expected = Rotation.from_rotvec(step[:3]).as_matrix() @ model[:, :3]
    np.testing.assert_allclose(there[:, :3], expected, atol=1e-14)
    np.testing.assert_allclose(there[:, 3], model[:, 3], atol=1e-15)


def test_a_step_of_an_absolute_pose_adds_to_t(rng):
    model, d = naive.random_model(rng), rng.standard_normal(3)
    np.testing.assert_allclose(stepped(model, [0, 0, 0, *d]), model + np.column_stack([np.zeros((3, 3)), d]))


@pytest.mark.parametrize("t", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.8, 0), (-0.6, 0, 0.8), (1, -2, 3)])
def test_a_step_of_a_relative_pose_moves_t_on_the_sphere(t):
    t = np.array(t) / np.linalg.norm(t)
    model = np.column_stack([np.eye(3), t])
    first, second = (stepped(model, np.eye(5)[k])[:, 3] for k in (3, 4))
    for moved in (first, second):  # by a unit vector in the tangent plane, and back to the sphere
        assert np.linalg.norm(moved) == pytest.approx(1)
        assert moved @ t == pytest.approx(np.sqrt(0.5))
    assert (first * np.sqrt(2) - t) @ (second * np.sqrt(2) - t) == pytest.approx(0, abs=1e-12)


# --- derivatives ------------------------------------------------------------------------------------------------------


@kinds
@focals
def test_derivatives_equal_central_differences(rng, kind, f):
    for _ in range(10):
        truth = kind.make_model(rng)
        rows, model = kind.make_rows(rng, 12, truth, NOISE), kind.nudge(rng, truth, 3.0)
        residuals, derivatives = jacobian(kind, model, rows, f)
        np.testing.assert_allclose(residuals, kind.errors(model, rows, f), rtol=1e-9, atol=1e-12 * f[0])
        h = 1e-6
        for k in range(kind.size):
            step = h * np.eye(kind.size)[k]
            ahead, behind = (kind.errors(stepped(model, s), rows, f) for s in (step, -step))
            np.testing.assert_allclose(derivatives[..., k], (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-7 * f[0])


def test_a_point_behind_the_camera_has_no_derivatives(rng):
    model = naive.random_model(rng)
    rows = naive.one_view_rows(rng, 5, model)
    rows[2, 2:] = naive.one_view_rows(rng, 1, model, near=-3, far=-2)[0, 2:]
    residuals, derivatives = jacobian(ABSOLUTE, model, rows, (1.0, 1.0))
    np.testing.assert_array_equal(residuals[2], np.inf)
    np.testing.assert_array_equal(derivatives[2], 0)
    assert (derivatives[[0, 1, 3, 4]] != 0).any(axis=(1, 2)).all()


@kinds
@focals
@pytest.mark.parametrize("threshold", [2.5 * NOISE, 40 * NOISE, np.inf])
def test_normal_equations_equal_their_definition(rng, kind, f, threshold):
    truth = kind.make_model(rng)
    rows, weights = kind.make_rows(rng, 40, truth, NOISE), rng.uniform(0, 2, 40)
    rows[:5, :2] += 0.2
    weights[7] = 0
    model, threshold = kind.nudge(rng, truth, 0.05), threshold * f[0]
    residuals, derivatives = jacobian(kind, model, rows, f)
    cost, hessian, gradient, counted = 0.0, np.zeros((kind.size,) * 2), np.zeros(kind.size), 0
    for weight, r, J in zip(weights, residuals, derivatives, strict=True):
        size = np.linalg.norm(r)
        loss, share = (size**2, 1.0) if threshold == np.inf else naive.tukey(size, threshold)
        cost += weight * loss
        hessian += weight * share * J.T @ J
        gradient += weight * share * J.T @ r
        counted += weight * share > 0
    assert counted == 39 if threshold == np.inf else 10 < counted < 39
    got = equations(kind, model, rows, weights, threshold, f)
    assert got[0] == pytest.approx(cost)
    np.testing.assert_allclose(got[1], hessian, rtol=1e-9, atol=1e-9 * np.abs(hessian).max())
    np.testing.assert_allclose(got[2], gradient, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())


# --- fits -------------------------------------------------------------------------------------------------------------


@kinds
@focals
@pytest.mark.parametrize("threshold", [np.inf, 2.0])
def test_exact_rows_lead_to_the_truth(rng, kind, f, threshold):
    for _ in range(50):
        truth = kind.make_model(rng)
        ok, model = fit(
            kind, kind.make_rows(rng, 30, truth), kind.nudge(rng, truth, 3.0), threshold=threshold * f[0], f=f
        )
        assert ok
        np.testing.assert_allclose(model, truth, atol=1e-10)


@kinds
def test_a_minimal_number_of_exact_rows_leads_to_a_pose_that_explains_them(rng, kind):
    good = 0
    for _ in range(100):
        truth = kind.make_model(rng)
        rows = kind.make_rows(rng, kind.least_rows, truth)
        ok, model = fit(kind, rows, kind.nudge(rng, truth, 0.5))
        good += ok and np.abs(kind.errors(model, rows, (1.0, 1.0))).max() < 1e-9
    assert good >= 95


@kinds
@focals
def test_noisy_rows_lead_where_scipy_gets_to(rng, kind, f):
    for _ in range(5):
        truth = kind.make_model(rng)
        rows, weights = kind.make_rows(rng, 40, truth, NOISE), rng.uniform(0.2, 2, 40)

        def errors(p, rows=rows, weights=weights):
            return (np.sqrt(weights)[:, None] * kind.errors(kind.model_of(p), rows, f)).ravel()

        theirs = least_squares(errors, kind.parameters(truth), xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
        ok, model = fit(kind, rows, kind.nudge(rng, truth, 2.0), weights, f=f)
        assert ok
        np.testing.assert_allclose(model, kind.model_of(theirs.x), atol=1e-7)
        assert np.abs(model - truth).max() > 1e-5


@kinds
@focals
def test_a_robust_fit_is_where_the_robust_cost_is_least(rng, kind, f):
    threshold = 4 * NOISE * f[0]
    truth = kind.make_model(rng)
    rows = kind.make_rows(rng, 60, truth, NOISE)
    rows[:15, :2] += rng.uniform(-5, 5, (15, 2)) * NOISE  # among them some near the threshold
    ok, model = fit(kind, rows, truth, threshold=threshold, f=f)
    assert ok

    def cost(p):
        sizes = np.linalg.norm(kind.errors(kind.model_of(p), rows, f), axis=1)
        return sum(naive.tukey(r, threshold)[0] for r in sizes) / threshold**2

    p = kind.parameters(model)
    for k in range(kind.size):
        step = 1e-5 * np.eye(kind.size)[k]
        ahead, here, behind = (cost(p + s) for s in (step, 0, -step))
        assert ahead + behind > 2 * here  # a minimum, reached to a thousandth of this step
        assert abs(ahead - behind) / 2 < 2e-3 * (ahead - 2 * here + behind)


@kinds
def test_gross_outliers_do_not_matter_with_a_threshold(rng, kind):
    for _ in range(20):
        truth = kind.make_model(rng)
        rows = np.vstack([kind.make_rows(rng, 40, truth), kind.make_rows(rng, 40, truth)])
        rows[40:, :2] = rng.uniform(-1, 1, (40, 2))
        wrong = np.linalg.norm(kind.errors(truth, rows, (1.0, 1.0)), axis=1) > 0.1
        rows = rows[wrong | (np.arange(80) < 40)]
        assert wrong.sum() > 10
        start = kind.nudge(rng, truth, 0.3)
        ok, model = fit(kind, rows, start, threshold=0.05)
        assert ok
        np.testing.assert_allclose(model, truth, atol=1e-9)
        assert np.abs(fit(kind, rows, start)[1] - truth).max() > 1e-2  # without a threshold they do


@kinds
def test_rows_of_weight_zero_do_not_count(rng, kind):
    truth = kind.make_model(rng)
    rows = kind.make_rows(rng, 60, truth)
    rows[40:, :2] = rng.uniform(-1, 1, (20, 2))
    rows[50], rows[51] = np.nan, np.inf
    ok, model = fit(kind, rows, kind.nudge(rng, truth, 2.0), np.r_[np.ones(40), np.zeros(20)])
    assert ok
    np.testing.assert_allclose(model, truth, atol=1e-10)


@kinds
@pytest.mark.parametrize("threshold", [np.inf, 3 * NOISE])
def test_a_weight_of_two_is_a_row_given_twice(rng, kind, threshold):
    truth = kind.make_model(rng)
    rows, weights = kind.make_rows(rng, 40, truth, NOISE), rng.integers(0, 4, 40)
    _, weighted = fit(kind, rows, truth, weights.astype(float), threshold)
    _, repeated = fit(kind, np.repeat(rows, weights, axis=0), truth, threshold=threshold)
    _, equal = fit(kind, rows, truth, threshold=threshold)
    np.testing.assert_allclose(weighted, repeated, atol=1e-8)
    assert np.abs(weighted - equal).max() > 1e-5


@kinds
@pytest.mark.parametrize("threshold", [np.inf, 3 * NOISE])
def test_only_the_proportions_of_weights_matter(rng, kind, threshold):
    truth = kind.make_model(rng)
    rows, weights = kind.make_rows(rng, 40, truth, NOISE), rng.uniform(0, 1, 40)
    models = [fit(kind, rows, truth, unit * weights, threshold)[1] for unit in (1e-9, 1.0, 1e9)]
    np.testing.assert_allclose(models[0], models[1], atol=1e-8)
    np.testing.assert_allclose(models[2], models[1], atol=1e-8)


@pytest.mark.parametrize("threshold", [np.inf, 3 * NOISE])
def test_points_behind_the_camera_do_not_count(rng, threshold):
    truth = naive.random_model(rng)
    front, behind = (naive.one_view_rows(rng, 40, truth, NOISE, near, far) for near, far in ((2, 8), (-8, -2)))
    _, without = fit(ABSOLUTE, front, truth, threshold=threshold)
    ok, model = fit(ABSOLUTE, np.vstack([behind, front]), truth, threshold=threshold)
    assert ok
    np.testing.assert_allclose(model, without, atol=1e-9)


@pytest.mark.parametrize("threshold", [np.inf, 3 * NOISE])
def test_a_match_at_both_epipoles_pulls_at_nothing(rng, threshold):
    model = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])
    rows = naive.two_view_rows(rng, 20, model, NOISE)
    with_it = np.vstack([np.zeros((1, 4)), rows])
    _, expected, slope = equations(RELATIVE, model, rows, np.ones(20), threshold, (1.0, 1.0))
    _, hessian, gradient = equations(RELATIVE, model, with_it, np.ones(21), threshold, (1.0, 1.0))
    np.testing.assert_allclose(hessian, expected, rtol=1e-12)
    np.testing.assert_allclose(gradient, slope, rtol=1e-9)


def test_both_focal_lengths_matter(rng):
    truth = naive.random_pose(rng)
    rows = naive.two_view_rows(rng, 40, truth, NOISE)
    fits = [fit(RELATIVE, rows, truth, f=f)[1] for f in ((700.0, 1100.0), (1100.0, 700.0), (1.4, 2.2))]
    assert np.abs(fits[0] - fits[1]).max() > 1e-6
    np.testing.assert_allclose(fits[2], fits[0], atol=1e-8)


@kinds
def test_a_fit_never_costs_more_than_the_start(rng, kind):
    for threshold in (np.inf, 20 * NOISE):
        for _ in range(100):
            truth = kind.make_model(rng)
            rows = kind.make_rows(rng, 15, truth, 10 * NOISE)
            start = kind.nudge(rng, truth, 20.0)
            before, *_ = equations(kind, start, rows, np.ones(15), threshold, (1.0, 1.0))
            for iterations in (1, 3, 50):
                _, model = fit(kind, rows, start, threshold=threshold, iterations=iterations)
                after, *_ = equations(kind, model, rows, np.ones(15), threshold, (1.0, 1.0))
                assert after <= before * (1 + 1e-12)


@kinds
def test_the_fit_is_a_pose(rng, kind):
    for _ in range(20):
        truth = kind.make_model(rng)
        start = kind.nudge(rng, truth, 2.0)
        start[:, :3] *= 1.001  # models come with rounding errors
        _, model = fit(kind, kind.make_rows(rng, 30, truth, 20 * NOISE), start)
        np.testing.assert_allclose(model[:, :3] @ model[:, :3].T, np.eye(3), atol=1e-13)
        assert np.linalg.det(model[:, :3]) == pytest.approx(1)
        if kind is RELATIVE:
            assert np.linalg.norm(model[:, 3]) == pytest.approx(1, abs=1e-13)


@kinds
def test_rows_and_weights_are_left_alone(rng, kind):
    truth = kind.make_model(rng)
    columns, weights = columns_of(kind, kind.make_rows(rng, 20, truth, NOISE), (1.0, 1.0)), rng.uniform(0, 1, 20)
    before = columns.copy(), weights.copy()
    fit_pose(columns, weights, 1.0, 10, np.ones(2), truth.copy())
    np.testing.assert_array_equal(columns, before[0])
    np.testing.assert_array_equal(weights, before[1])


# --- rows that determine nothing --------------------------------------------------------------------------------------


@kinds
@pytest.mark.parametrize(("weight", "threshold"), [(0.0, np.inf), (0.0, 1.0), (1.0, 1e-12)])
def test_without_any_weight_the_pose_stays_and_is_not_determined(rng, kind, weight, threshold):
    truth = kind.make_model(rng)
    start = kind.nudge(rng, truth, 5.0)
    ok, model = fit(kind, kind.make_rows(rng, 30, truth), start, np.full(30, weight), threshold)
    assert not ok
    np.testing.assert_allclose(model, start, atol=1e-14)


def points_on_a_line(rng, truth):
    ends = naive.one_view_rows(rng, 2, truth)[:, 2:]
    points = ends[0] + rng.uniform(0, 1, (20, 1)) * (ends[1] - ends[0])
    return np.hstack([naive.projected(naive.moved(truth, points)), points])


def too_few(kind):
    return lambda rng, truth: kind.make_rows(rng, kind.least_rows - 1, truth)


def too_few_different_ones(kind):
    return lambda rng, truth: np.repeat(kind.make_rows(rng, kind.least_rows - 1, truth), 20, axis=0)


@pytest.mark.parametrize(
    ("kind", "make_rows"),
    [
        (RELATIVE, lambda rng, truth: np.empty((0, 4))),
        (ABSOLUTE, lambda rng, truth: np.empty((0, 5))),
        (RELATIVE, lambda rng, truth: np.repeat(naive.two_view_rows(rng, 1, truth), 20, axis=0)),
        (ABSOLUTE, lambda rng, truth: np.repeat(naive.one_view_rows(rng, 1, truth), 20, axis=0)),
        (RELATIVE, too_few(RELATIVE)),
        (ABSOLUTE, too_few(ABSOLUTE)),
        (RELATIVE, too_few_different_ones(RELATIVE)),
        (ABSOLUTE, too_few_different_ones(ABSOLUTE)),
        (ABSOLUTE, points_on_a_line),
    ],
    ids=["none", "none 3D", "one", "one 3D", "four", "two 3D", "four different", "two different 3D", "on a line 3D"],
)
@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_too_little_determines_nothing(rng, kind, make_rows, degrees):
    """Among 300 draws some are near a further degeneracy, where rounding errors are large."""
    determined = 0
    for _ in range(300):
        truth = kind.make_model(rng)
        ok, model = fit(kind, make_rows(rng, truth), kind.nudge(rng, truth, degrees))
        assert np.isfinite(model).all()
        determined += ok
    assert determined == 0


def test_a_rotation_without_a_baseline_determines_nothing(rng):
    """Every t explains it."""
    for _ in range(20):
        truth = naive.random_pose(rng)
        image = rng.uniform(-1, 1, (50, 2))
        rows = np.hstack([image, naive.projected(naive.lifted(image, np.ones(50)) @ truth[:, :3].T)])
        assert not fit(RELATIVE, rows, truth)[0]


@kinds
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_rows_that_are_not_finite_are_outliers(rng, kind, bad):
    truth = kind.make_model(rng)
    rows = kind.make_rows(rng, 40, truth)
    for column in range(rows.shape[1]):
        rows[column, column] = bad
    ok, model = fit(kind, rows, kind.nudge(rng, truth, 1.0), threshold=1.0)
    assert ok
    np.testing.assert_allclose(model, truth, atol=1e-10)
