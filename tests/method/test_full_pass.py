"""refine="full": the fit to all rows, against the same fit of everything at once in memory."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import naive
import nonsac
from nonsac import simulate
from nonsac.clouds.problem import OrientedRegistration
from nonsac.layouts import Rows
from nonsac.method.full_pass import FullFit, SumTask, _at_work, first_pass, piece_bounds
from nonsac.method.mixture import Mixture
from nonsac.method.refine import Refinement
from nonsac.method.residuals import Residuals, measured_noise
from nonsac.method.search import SampleTask, Search
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.problems.normal_equations import weighted
from nonsac.result import Status
from nonsac.sources import ArraySource
from nonsac.sources.blocks import BlockSource

PROBLEMS = {
    "relative pose": (RelativePose(), simulate.relative_pose, ("points1", "points2"), 0.0025),
    "relative pose in pixels": (RelativePose(800.0, 900.0), simulate.relative_pose, ("points1", "points2"), 0.0025),
    "absolute pose": (AbsolutePose(700.0), simulate.absolute_pose, ("points2d", "points3d"), 0.01),
    "registration": (Registration(), simulate.registration, ("source", "target"), 0.01),
    "free scale": (Registration(None), simulate.registration, ("source", "target"), 0.01),
}


def rows_of(case, n, outlier_ratio, rng, share=1.0):
    """Problem, rows, the true model, and the noise in the unit of the residuals."""
    problem, simulated, names, noise = PROBLEMS[case]
    data = simulated(n, outlier_ratio, share * noise, rng)
    unit = getattr(problem, "focal", getattr(problem, "focal1", 1.0))
    rows = np.hstack([getattr(data, name) for name in names])
    return problem, rows, data.T[:3], share * noise * unit


def searched(problem, source, noise):
    """A search as the pipeline has it before the passes."""
    return Search(
        SampleTask(source, problem, nonsac.Ransac(1), Noise.given(noise), 2000, seed=0), 2, 1, None, None, None
    )


def trusted(model, status=Status.OK):
    return Refinement(model, status, 1.0, 0, 0)


def fitted_to_all(problem, rows, model, noise):
    return FullFit().finish(searched(problem, ArraySource(rows), noise), trusted(model))


def weigher_of(problem, rows, model, threshold):
    residuals = Residuals.of(problem, model, Rows(rows))
    noise = measured_noise(residuals, threshold, problem.residual_dimension)
    return Mixture.seen_in(residuals, noise, problem.residual_dimension).weigher


@pytest.mark.parametrize("case", PROBLEMS)
def test_the_gradient_is_that_of_the_weighted_squares(case, rng):
    problem, rows, model, noise = rows_of(case, 400, 0.3, rng)
    weigher, pivot = weigher_of(problem, rows, model, 5 * noise), problem.pivot(rows)
    equations, residuals = problem.normal_equations(model, rows, weigher, pivot)
    weights = weigher(residuals)[0]
    np.testing.assert_allclose(residuals, problem.residuals(model[None], rows)[0], rtol=1e-12)
    near = weights > 0

    def half_squares(step):
        moved = problem.moved(model, step, pivot)
        return 0.5 * weights[near] @ problem.residuals(moved[None], rows[near])[0] ** 2

    numeric = naive.gradient(half_squares, np.zeros(len(equations.gradient)), 1e-6)
    np.testing.assert_allclose(equations.gradient, numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())


@pytest.mark.parametrize("case", PROBLEMS)
def test_the_matrix_is_the_second_derivative_where_rows_fit(case, rng):
    problem, rows, model, _ = rows_of(case, 300, 0.0, rng, share=1e-7)
    pivot = problem.pivot(rows)
    factors = rng.uniform(0.5, 2.0, len(rows))
    equations, _ = problem.normal_equations(model, rows, lambda residuals: (np.ones(len(rows)), factors), pivot)

    def half_squares(step):
        return 0.5 * factors @ problem.residuals(problem.moved(model, step, pivot)[None], rows)[0] ** 2

    origin = np.zeros(len(equations.gradient))
    numeric = naive.gradient(lambda step: naive.gradient(half_squares, step, 1e-4), origin, 1e-4)
    scale = np.sqrt(np.outer(np.diagonal(numeric), np.diagonal(numeric)))
    np.testing.assert_allclose(equations.hessian / scale, numeric / scale, atol=2e-3)
    np.testing.assert_array_equal(equations.hessian, equations.hessian.T)


def test_curvatures_are_the_derivative_of_the_pull():
    weigher = Mixture(0.02, 1, 100, 50).weigher
    residuals, step = np.linspace(0.0, 0.21, 60), 1e-7
    pulls = [weigher(r)[0] * r for r in (residuals - step, residuals + step)]
    np.testing.assert_allclose(weigher(residuals)[1], (pulls[1] - pulls[0]) / (2 * step), atol=1e-5)


@pytest.mark.parametrize("case", PROBLEMS)
def test_the_fit_is_that_of_all_rows_at_once(case, rng):
    """Least squares on everything in memory, weights and fit in turn to the end, gives the same to 1e-9.

    Poses are compared to 2e-8 only, as their fit in memory stops there.
    """
    problem, rows, truth, noise = rows_of(case, 60_000, 0.6, rng)
    some = rows[:5000]
    start = problem.refit(truth, some, (problem.residuals(truth[None], some)[0] < 2 * noise).astype(float))
    fitted = fitted_to_all(problem, rows, start, noise)
    weigher, model = first_pass(searched(problem, ArraySource(rows), noise), start).weigher, start
    for _ in range(300):
        previous = model
        model = problem.refit(model, rows, weigher(problem.residuals(model[None], rows)[0])[0])
        if np.abs(model - previous).max() < 1e-14:
            break
    assert fitted.info["passes"] <= 4
    assert np.abs(fitted.model - start).max() > 1e-6
    assert np.abs(fitted.model - model).max() < (1e-9 if isinstance(problem, Registration) else 2e-8)
    step = problem.normal_equations(fitted.model, rows, weigher, problem.pivot(rows))[0].step()
    assert np.abs(step).max() < 1e-9
    assert fitted.num_rows == len(rows)
    assert fitted.num_inliers == np.count_nonzero(problem.residuals(fitted.model[None], rows)[0] < 5 * noise)


def test_a_pass_equals_least_squares_with_the_same_weights(rng):
    problem, rows, model, noise = rows_of("registration", 5000, 0.5, rng)
    weigher, pivot = weigher_of(problem, rows, model, 5 * noise), problem.pivot(rows)
    weights = weigher(problem.residuals(model[None], rows)[0])[0]
    equations, _ = problem.normal_equations(model, rows, lambda residuals: (weights, weights), pivot)
    stepped = problem.moved(model, equations.step(), pivot)
    assert np.abs(stepped - problem.refit(model, rows, weights)).max() < 1e-6
    again, _ = problem.normal_equations(stepped, rows, lambda residuals: (weights, weights), pivot)
    assert np.abs(problem.moved(stepped, again.step(), pivot) - problem.refit(model, rows, weights)).max() < 1e-9


def test_far_from_the_origin_nothing_is_lost(rng):
    problem, rows, model, noise = rows_of("registration", 30_000, 0.5, rng)
    far = np.array([5e6, -4e6, 300.0])
    moved = model.copy()
    moved[:, 3] -= model[:, :3] @ far
    near = fitted_to_all(problem, rows, model, noise).model
    away = rows + np.r_[far, np.zeros(3)]
    other = fitted_to_all(problem, away, moved, noise).model
    assert np.abs(other[:, :3] - near[:, :3]).max() < 1e-9
    assert np.abs(naive.moved(other, away[:10, :3]) - naive.moved(near, rows[:10, :3])).max() < 1e-7


def test_more_rows_more_accuracy(rng):
    errors = {"union": [], "full": []}
    for seed in range(5):
        views = simulate.relative_pose(300_000, 0.8, 0.0025, rng)
        for refine, found in errors.items():
            result = nonsac.relative_pose(views.points1, views.points2, noise=0.0025, refine=refine, rng=seed)
            found.append(nonsac.evaluation.rotation_error(result.R, views.T[:3, :3]))
    assert np.mean(errors["full"]) < 0.4 * np.mean(errors["union"])


@pytest.mark.parametrize("noise", [None, 0.01])
def test_the_covariance_shrinks_with_the_number_of_inliers(noise, rng):
    pairs = simulate.registration(200_000, 0.7, 0.01, rng)
    union, full = (
        nonsac.register_pairs(pairs.source, pairs.target, noise=noise, refine=refine) for refine in ("union", "full")
    )
    assert (full.num_rows, full.success) == (200_000, True)
    assert full.num_inliers == pytest.approx(np.count_nonzero(pairs.inliers), rel=0.02)
    ratio = union.num_inliers / full.num_inliers
    np.testing.assert_allclose(np.trace(full.covariance), np.trace(union.covariance) * ratio, rtol=0.5)
    assert full.info["measured_noise"] == pytest.approx(0.01, rel=0.1)
    assert full.num_inliers == np.count_nonzero(full.inliers)
    assert "all rows" in full.info["seconds"]
    assert "all rows" not in union.info["seconds"]


def test_any_workers_give_the_same_bits(rng):
    pairs = simulate.registration(2_200_000, 0.5, 0.01, rng)

    def run(workers):
        return nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, refine="full", workers=workers)

    alone = run(1)
    assert len(piece_bounds(alone.evidence.source)) == 4
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as processes:
        for other in (run(3), run(processes)):
            np.testing.assert_array_equal(other.T, alone.T)
            assert other.num_inliers == alone.num_inliers


def test_rows_that_are_not_finite_are_not_counted(rng):
    problem, rows, model, noise = rows_of("registration", 20_000, 0.5, rng)
    clean = fitted_to_all(problem, rows, model, noise)
    rows = np.vstack([rows, np.full((50, 6), np.nan), np.full((50, 6), np.inf), -np.full((50, 6), np.inf)])
    dirty = fitted_to_all(problem, rows, model, noise)
    assert (clean.num_rows, dirty.num_rows, dirty.num_inliers) == (20_000, 20_000, clean.num_inliers)
    np.testing.assert_array_equal(dirty.model, clean.model)


def test_weights_count(rng):
    """Rows of weight 2 are like rows that are there twice."""
    problem, rows, model, noise = rows_of("relative pose", 20_000, 0.5, rng)
    weights = rng.integers(0, 3, len(rows))
    repeated = np.repeat(rows, weights, axis=0)
    weigher, pivot = weigher_of(problem, rows, model, 5 * noise), problem.pivot(rows)
    first, _ = problem.normal_equations(model, rows, weighted(weigher, weights), pivot)
    second, _ = problem.normal_equations(model, repeated, weigher, pivot)
    np.testing.assert_allclose(first.hessian, second.hessian, rtol=1e-9)
    np.testing.assert_allclose(first.gradient, second.gradient, rtol=1e-6, atol=1e-9)
    of_source, of_repeated = (
        SumTask(ArraySource(table), problem, problem, model, 5 * noise, weigher, pivot, np.array([0, len(table)]))(0)
        for table in (np.column_stack([rows, weights]), repeated)
    )
    np.testing.assert_allclose(of_source.equations.hessian, of_repeated.equations.hessian, rtol=1e-9)
    np.testing.assert_allclose(of_source.equations.gradient, of_repeated.equations.gradient, rtol=1e-6, atol=1e-9)
    assert of_source.rows == np.count_nonzero(weights)
    result = nonsac.relative_pose(rows[:, :2], rows[:, 2:], noise=noise, weights=weights, refine="full")
    assert result.success
    assert result.num_rows == np.count_nonzero(weights)


@pytest.mark.filterwarnings("ignore:dropped")
@pytest.mark.parametrize("useless", [np.nan, np.inf, 0.0, -1.0])
def test_rows_whose_weight_is_useless_are_left_out(useless, rng):
    _, rows, _, noise = rows_of("relative pose", 20_000, 0.5, rng)
    table = np.column_stack([rows, rng.uniform(0.5, 1.0, len(rows))])
    table[1000::7, -1] = useless  # the first thousand rows are looked at, and refused if negative
    result = nonsac.relative_pose(ArraySource(table), noise=noise, refine="full", samples=4, sample_size=1000)
    assert result.success
    assert "passes" in result.info
    assert result.num_rows == len(rows) - len(rows[1000::7])


class Counting(ArraySource):
    """Counts the rows that are read in order."""

    def __init__(self, rows):
        super().__init__(rows)
        self.read = 0

    def chunks(self, rows, start=0, stop=None):
        for chunk in super().chunks(rows, start, stop):
            self.read += len(chunk)
            yield chunk


@pytest.mark.parametrize("refine", ["union", "polish", "none"])
def test_only_full_reads_all_rows(refine, rng):
    _, rows, _, noise = rows_of("registration", 400_000, 0.5, rng)
    source = Counting(rows)
    nonsac.estimate(source, Registration(), nonsac.Pcr99.for_pairs(), noise=noise, refine=refine)
    assert source.read == 0


def test_an_answer_that_is_not_trusted_is_not_worth_a_pass(rng):
    source = Counting(rng.uniform(-1, 1, (50_000, 6)))
    result = nonsac.estimate(source, Registration(), nonsac.Pcr99.for_pairs(), noise=0.01, refine="full", max_samples=4)
    assert (result.status, source.read) == (Status.LOW_SUPPORT, 0)


@pytest.mark.parametrize("status", Status)
def test_only_what_is_trusted_or_ambiguous_is_fitted(status, rng):
    problem, rows, model, noise = rows_of("registration", 5000, 0.5, rng)
    before = trusted(model, status)
    after = FullFit().finish(searched(problem, ArraySource(rows), noise), before)
    assert (after is before) is (status not in (Status.OK, Status.AMBIGUOUS))
    assert after.status is status


def test_exact_rows_are_left_alone(rng):
    problem, rows, model, _ = rows_of("registration", 1000, 0.0, rng, share=0.0)
    result = nonsac.estimate(ArraySource(rows), problem, nonsac.Pcr99.for_pairs(), noise=1e-6, refine="full")
    assert result.success
    np.testing.assert_allclose(result.model, model, atol=1e-9)


def test_inliers_without_any_error_are_not_fitted(rng):
    rows = rng.integers(-5, 5, (1000, 3)).astype(float)
    before = trusted(np.eye(4)[:3])
    after = FullFit().finish(searched(Registration(), ArraySource(np.hstack([rows, rows])), 0.01), before)
    assert after.remarks == ("not fitted to all rows: the inliers fit exactly",)
    assert after.model is before.model


def test_rows_that_determine_no_step_are_not_fitted(rng):
    """All on one line: a turn about it changes nothing."""
    source = rng.uniform(-1, 1, (5000, 1)) * np.array([1.0, 0.0, 0.0])
    before = trusted(np.eye(4)[:3])
    rows = np.hstack([source, source + 0.01 * rng.standard_normal((5000, 1)) * np.array([1.0, 0.0, 0.0])])
    after = FullFit().finish(searched(Registration(), ArraySource(rows), 0.01), before)
    assert after.remarks == ("not fitted to all rows: they do not determine a step",)
    assert after.model is before.model


def test_a_problem_without_normal_equations_is_refused_at_the_door(rng):
    source = ArraySource(rng.uniform(-1, 1, (100, 12)))
    with pytest.raises(
        ValueError, match='refine="full" needs a problem with `streaming`, OrientedRegistration has none'
    ):
        nonsac.estimate(source, OrientedRegistration(), nonsac.Ransac(10), noise=0.1, refine="full")


class Blocks(BlockSource):
    def __init__(self, starts):
        super().__init__(np.array(starts), 6)

    def read_block(self, block):
        return np.zeros((int(np.diff(self.block_starts)[block]), 6))


@pytest.mark.parametrize("starts", [(0, 5), (0, 2**21), (0, 2**20, 2**21), (0, *range(1000, 2_500_000, 1000))])
def test_pieces_do_not_cut_blocks(starts):
    source = Blocks(starts)
    bounds = piece_bounds(source)
    assert set(bounds) <= set(starts)
    assert (bounds[0], bounds[-1]) == (0, len(source))
    assert (np.diff(bounds) > 0).all()
    assert np.diff(bounds).max() < 2**20 + max(np.diff(starts))


def test_sums_of_pieces_are_the_sum_of_all(rng):
    problem, rows, model, noise = rows_of("absolute pose", 30_000, 0.5, rng)
    weigher, pivot = weigher_of(problem, rows, model, 5 * noise), problem.pivot(rows)
    whole, cut = (
        SumTask(ArraySource(rows), problem, problem, model, 5 * noise, weigher, pivot, np.array(bounds))
        for bounds in ([0, 30_000], [0, 7, 20_000, 30_000])
    )
    total, parts = whole(0), cut(0) + cut(1) + cut(2)
    np.testing.assert_allclose(parts.equations.hessian, total.equations.hessian, rtol=1e-10)
    assert (parts.inliers, parts.rows) == (total.inliers, total.rows)


def test_inliers_are_written_without_reading_all_rows_at_once(rng, tmp_path):
    pairs = simulate.registration(50_000, 0.5, 0.01, rng)
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=0.01)
    result.write_inliers(tmp_path / "inliers.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "inliers.npy"), result.inliers)
    assert result.inliers.sum() == result.num_inliers


def test_a_fit_that_is_late_stays_as_it_is_and_says_so(rng, monkeypatch):
    problem, rows, model, noise = rows_of("registration", 20_000, 0.5, rng)
    late = iter([False, True])
    monkeypatch.setattr(Search, "is_late", lambda search: next(late))
    refinement = fitted_to_all(problem, rows, model, noise)
    assert next(late, None) is None
    assert refinement.remarks == ("not fitted to all rows: the time limit was reached",)
    np.testing.assert_array_equal(refinement.model, model)


def test_a_time_limit_holds_for_the_passes(rng):
    pairs = simulate.registration(50_000, 0.5, 0.01, rng)
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, refine="full", time_limit=1e-9)
    assert result.success
    assert "not fitted to all rows: the time limit was reached" in result.remarks
    assert "passes" not in result.info


@pytest.mark.parametrize(("limit", "threads"), [(None, 8), (10**9, 8), (400 * 10**6, 2), (1, 1)])
def test_workers_are_fewer_where_blocks_would_not_fit(limit, threads):
    source = Blocks((0, 10**6, 2 * 10**6))  # 144 MB each while it is read
    assert _at_work(source, 8, limit) == (6 if limit == 10**9 else threads)
