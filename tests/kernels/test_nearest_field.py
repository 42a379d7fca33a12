import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.nearest_field import (
    align_to_field,
    fill_cost,
    fill_nearest,
    nearest_distances,
    score_models,
    surface_distances,
)


class Field:
    """A filled grid around a cloud."""

    def __init__(self, points, reach, cell, normals=None):
        margin = reach + cell
        self.points, self.normals, self.reach, self.cells_per_unit = points, normals, reach, 1.0 / cell
        self.corner = points.min(axis=0) - margin
        shape = np.ceil((points.max(axis=0) + margin - self.corner) / cell).astype(int)
        self.nearest, self.cost = np.full(shape, 99, np.int32), np.full(shape, 77, np.uint8)
        fill_nearest(points, self.corner, self.cells_per_unit, reach, self.nearest)
        fill_cost(points, self.corner, self.cells_per_unit, reach, self.nearest, self.cost)

    def cells(self, positions):
        return np.floor((positions - self.corner) * self.cells_per_unit).astype(int)

    def inside(self, positions):
        cells = self.cells(positions)
        return ((cells >= 0) & (cells < self.nearest.shape)).all(axis=1)

    def nearest_of(self, positions):
        """The number stored under each position, -1 outside."""
        numbers = np.full(len(positions), -1)
        inside = self.inside(positions)
        numbers[inside] = self.nearest[tuple(self.cells(positions[inside]).T)]
        return numbers

    def distances(self, model, points):
        result = np.full(len(points), -1.0)
        nearest_distances(
            model, points, self.points, self.corner, self.cells_per_unit, self.reach, self.nearest, result
        )
        return result

    def align(self, models, points, iterations=60):
        models = models.copy()
        align_to_field(
            models,
            points,
            self.points,
            self.normals,
            self.corner,
            self.cells_per_unit,
            self.reach,
            self.nearest,
            iterations,
        )
        return models

    def surface_distances(self, model, points, normals, flat, cosine):
        result = np.full(len(points), -1.0)
        surface_distances(
            model,
            points,
            normals,
            self.points,
            self.normals,
            self.corner,
            self.cells_per_unit,
            self.reach,
            self.nearest,
            flat,
            cosine,
            result,
        )
        return result


def curved_surface(rng, n=700):
    """Points of z = f(x, y) with the exact unit normals: no motion slides it along itself."""
    x, y = rng.uniform(-1, 1, (2, n))
    z = 0.4 * np.sin(2.5 * x) + 0.3 * np.cos(2 * y + 0.5) + 0.2 * x * y
    normals = np.column_stack([-(np.cos(2.5 * x) + 0.2 * y), 0.6 * np.sin(2 * y + 0.5) - 0.2 * x, np.ones(n)])
    return np.column_stack([x, y, z]), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def small_motion(rng, degrees, shift):
    axis, direction = rng.standard_normal((2, 3))
    R = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    return np.column_stack([R, shift * direction / np.linalg.norm(direction)])


@pytest.fixture
def cloud(rng):
    return rng.uniform(-1, 1, (60, 3))


@pytest.mark.parametrize(("reach", "cell"), [(0.3, 0.1), (0.25, 0.4), (0.5, 0.11)])
def test_the_grid_equals_brute_force(cloud, reach, cell):
    field = Field(cloud, reach, cell)
    distance, number = naive.nearest_to_cells(cloud, field.nearest.shape, field.corner, field.cells_per_unit)
    clear = np.abs(distance - reach) > 1e-6
    within = distance < reach
    assert 0.02 < within.mean() < 0.98
    np.testing.assert_array_equal(field.nearest[clear & within], number[clear & within])
    assert (field.nearest[clear & ~within] == -1).all()
    np.testing.assert_allclose(field.cost, np.minimum(255, 255 * distance / reach), atol=1.01)
    assert (field.cost[clear & ~within] == 255).all()


def test_scores_are_the_sums_of_the_costs_under_the_points(rng, cloud):
    field = Field(cloud, 0.3, 0.1)
    points = rng.uniform(-1, 1, (80, 3))
    models = np.stack([np.eye(4)[:3], *(naive.random_model(rng, spread=0.3) for _ in range(20))])
    scores = np.full(len(models), -1, np.int32)
    columns = np.ascontiguousarray(points.T, np.float32)
    score_models(models, columns, field.corner, field.cells_per_unit, field.cost, scores)
    for model, score in zip(models, scores, strict=True):
        positions = naive.moved(model, points)
        inside = field.inside(positions)
        expected = 255 * (~inside).sum() + field.cost[tuple(field.cells(positions[inside]).T)].sum(dtype=int)
        assert abs(int(score) - expected) <= 2 * 255 * 0.1  # a point near a cell's wall may fall into the next one


@pytest.mark.parametrize("shift", [100.0, -100.0, 1e9, -1e9, np.nan])
def test_points_outside_the_grid_cost_most(cloud, shift):
    field = Field(cloud, 0.3, 0.1)
    scores = np.empty(1, np.int32)
    away = np.eye(4)[None, :3].copy()
    away[0, :, 3] = shift
    columns = np.ascontiguousarray(cloud.T, np.float32)
    score_models(away, columns, field.corner, field.cells_per_unit, field.cost, scores)
    assert scores[0] == 255 * len(cloud)
    np.testing.assert_array_equal(field.distances(away[0], cloud), np.full(len(cloud), 0.3))


def test_distances_are_those_to_the_nearest_point_of_the_cell(rng, cloud):
    field = Field(cloud, 0.4, 0.1)
    points = rng.uniform(-2, 2, (500, 3))
    model = naive.random_model(rng, spread=0.2)
    positions = naive.moved(model, points)
    numbers = field.nearest_of(positions)
    expected = np.where(numbers < 0, 0.4, np.minimum(0.4, np.linalg.norm(positions - cloud[numbers], axis=1)))
    np.testing.assert_allclose(field.distances(model, points), expected, atol=1e-12)


def test_distances_are_near_the_true_ones(rng, cloud):
    field = Field(cloud, 0.4, 0.02)
    points = rng.uniform(-1, 1, (300, 3))
    true = np.minimum(0.4, np.linalg.norm(points[:, None] - cloud[None], axis=2).min(axis=1))
    distances = field.distances(np.eye(4)[:3], points)
    assert (distances >= true - 1e-12).all()  # never nearer than the nearest
    assert (distances <= true + 0.02 * np.sqrt(3)).all()  # a cell's diagonal, twice the half


def test_exact_data_are_aligned_to_the_last_digits(rng):
    """With cells finer than the spacing, each point finds itself again, so the true motion is a fixed point."""
    surface, normals = curved_surface(rng, 250)
    field = Field(surface, 0.2, 0.02, normals)
    alone = np.linalg.norm(surface[:, None] - surface[None], axis=2)
    np.fill_diagonal(alone, np.inf)
    subset = surface[alone.min(axis=1) > 0.04]
    truth = naive.random_model(rng)
    source = (subset - truth[:, 3]) @ truth[:, :3]  # truth maps the source onto the surface
    for _ in range(5):
        disturbance = small_motion(rng, 1.0, 0.01)
        start = np.column_stack([disturbance[:, :3] @ truth[:, :3], naive.moved(disturbance, truth[:, 3])])
        aligned = field.align(start[None], source)[0]
        np.testing.assert_allclose(aligned, truth, atol=1e-6)


def test_a_small_motion_on_a_curved_surface_is_undone(rng):
    surface, normals = curved_surface(rng, 3000)
    field = Field(surface, 0.25, 0.05, normals)
    points = curved_surface(rng, 500)[0]
    starts = np.stack([small_motion(rng, 5.0, 0.08) for _ in range(20)])
    aligned = field.align(starts, points)
    angles = np.array([naive.angle_between(model, np.eye(3)) for model in aligned])
    assert np.median(angles) < 0.3
    assert (angles < 1.0).all()
    assert np.abs(aligned[:, :, 3]).max() < 0.02


def test_aligned_models_stay_rigid(rng):
    surface, normals = curved_surface(rng)
    aligned = Field(surface, 0.25, 0.05, normals).align(np.stack([small_motion(rng, 20, 0.2)] * 3), surface[:100])
    for model in aligned:
        np.testing.assert_allclose(model[:, :3] @ model[:, :3].T, np.eye(3), atol=1e-10)
    np.testing.assert_array_equal(aligned[0], aligned[1])  # models do not see each other


def test_a_model_that_touches_nothing_stays_where_it_is(rng):
    surface, normals = curved_surface(rng)
    away = np.column_stack([np.eye(3), [50.0, 0, 0]])
    np.testing.assert_array_equal(Field(surface, 0.2, 0.1, normals).align(away[None], surface)[0], away)


def test_points_of_the_surface_lie_in_it(rng):
    surface, normals = curved_surface(rng)
    field = Field(surface, 0.1, 0.02, normals)
    flipped = normals * rng.choice([-1.0, 1.0], (len(normals), 1))
    distances = field.surface_distances(np.eye(4)[:3], surface, flipped, 0.05, 0.9)
    assert (distances < 0.01).mean() > 0.98


def test_surface_distances_equal_the_definition(rng):
    surface, normals = curved_surface(rng)
    reach, flat, cosine = 0.2, 0.05, 0.8
    field = Field(surface, reach, 0.05, normals)
    model = small_motion(rng, 10.0, 0.05)
    own = rng.permutation(normals)  # most of them wrong
    positions = naive.moved(model, surface)
    numbers = field.nearest_of(positions)
    differences, target = positions - surface[numbers], normals[numbers]
    height = np.abs((differences * target).sum(axis=1))
    inside = (
        (numbers >= 0)
        & (np.linalg.norm(differences, axis=1) <= reach)
        & (height <= flat)
        & (np.abs((own @ model[:, :3].T * target).sum(axis=1)) > cosine)
    )
    assert 0.05 < inside.mean() < 0.95
    distances = field.surface_distances(model, surface, own, flat, cosine)
    np.testing.assert_allclose(distances, np.where(inside, height, np.inf), atol=1e-12)
