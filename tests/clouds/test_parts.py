"""The parts of the registration of raw clouds."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cloud_samples import bumpy, motion, move
from nonsac.clouds.frame import CommonFrame
from nonsac.clouds.overlap import Overlap, distinct, inverse
from nonsac.clouds.problem import OrientedRegistration
from nonsac.clouds.refine import align_coinciding, align_finely
from nonsac.clouds.search import Agreement
from nonsac.clouds.surfaces import LocalPlanes, Surface, thin_to, voxel_for, without_clutter
from nonsac.evaluation import rotation_error
from nonsac.result import Hypothesis


class TestParts:
    def test_common_frame_restores_motions(self, rng):
        source, target = rng.normal(size=(50, 3)) + 1e6, 7.0 * rng.normal(size=(60, 3))
        frame = CommonFrame.of(source, target)
        model = motion(rng)[:3]
        moved = ((source - frame.source_origin) / frame.unit) @ model[:, :3].T + model[:, 3]
        np.testing.assert_allclose(
            move(source, frame.to_target(model)), moved * frame.unit + frame.target_origin, atol=1e-6
        )

    def test_thinning_reaches_the_count(self, rng):
        for cloud in (bumpy(30_000, rng), rng.uniform(size=(30_000, 3)), rng.uniform(size=(30_000, 1)) * [1, 2, 3]):
            assert 1500 < len(thin_to(cloud, 2000)) < 2600
        few = bumpy(100, rng)
        assert thin_to(few, 2000) is few
        assert voxel_for(bumpy(30_000, rng), 500) > voxel_for(bumpy(30_000, rng), 2000)

    def test_surface_normals(self, rng):
        points = rng.normal(size=(3000, 3))
        points /= np.linalg.norm(points, axis=1)[:, None]
        surface = Surface.from_points(points)
        cosines = np.abs((surface.points * surface.normals).sum(axis=1))
        assert np.quantile(cosines, 0.05) > 0.99
        assert not surface.noisy
        assert 300 < len(surface.coarse) < 700

    def test_noise_is_smoothed_away(self, rng):
        points = rng.normal(size=(20_000, 3))
        points /= np.linalg.norm(points, axis=1)[:, None]
        noisy = points + rng.normal(scale=0.04, size=points.shape)
        surface = Surface.from_points(noisy)
        assert surface.noisy
        before, after = (np.abs(np.linalg.norm(x, axis=1) - 1).mean() for x in (noisy, surface.points))
        assert after < 0.4 * before

    def test_clutter_is_removed_and_surfaces_are_kept(self, rng):
        surface = bumpy(20_000, rng)
        clutter = rng.uniform(surface.min(0), surface.max(0), (5000, 3))
        kept = without_clutter(np.vstack([surface, clutter]))
        from_surface = np.isin(kept[:, 0], surface[:, 0]).sum()
        assert from_surface > 0.95 * len(surface)
        assert len(kept) - from_surface < 0.2 * len(clutter)  # what lies beside the surface stays
        np.testing.assert_array_equal(without_clutter(surface), surface)

    def test_planes_of_a_plane(self, rng):
        planes = LocalPlanes.of(np.column_stack([rng.uniform(size=(500, 2)), np.zeros(500)]))
        assert not planes.thick
        np.testing.assert_allclose(np.abs(planes.normals), np.tile([0.0, 0, 1], (500, 1)), atol=1e-6)
        assert LocalPlanes.of(rng.uniform(size=(500, 3))).thick

    def test_coinciding_points_are_found_and_others_left_alone(self, rng):
        points = bumpy(500, rng)
        T = motion(rng)
        start = T[:3].copy()
        start[:, :3] = Rotation.from_rotvec([0.01, 0.01, 0]).as_matrix() @ start[:, :3]
        exact = align_coinciding(points, move(points[100:], T), start)
        np.testing.assert_allclose(exact, T[:3], atol=1e-6)
        np.testing.assert_array_equal(align_coinciding(points, move(bumpy(500, rng), T), start), start)

    def test_support_falls_with_the_distance_to_the_surface(self, rng):
        points, up = np.column_stack([rng.uniform(-1, 1, (4000, 2)), np.zeros(4000)]), np.array([0.0, 0.0, 1.0])
        sheet = Surface(points, np.tile(up, (4000, 1)), np.arange(4000), 0.05, noisy=False, thin=True)
        overlap = Overlap.between(sheet, sheet, 0.2, 0.02)
        for height in (0.0, 0.02, 0.04, 0.06):
            model = np.column_stack([np.eye(3), height * up])
            weight = max(0.0, 1.0 - (height / 0.05) ** 2) ** 2
            assert overlap.support(model) == pytest.approx(8000 * weight, rel=0.02, abs=1.0)
            assert overlap.agreement(model) == pytest.approx(weight, abs=0.02)

    def test_surfaces_that_cross_do_not_agree(self, rng):
        points = np.column_stack([rng.uniform(-1, 1, (4000, 2)), np.zeros(4000)])
        sheet = Surface(points, np.tile([0.0, 0.0, 1.0], (4000, 1)), np.arange(4000), 0.05, noisy=False, thin=True)
        overlap = Overlap.between(sheet, sheet, 0.2, 0.02)
        for degrees, (least, most) in {0: (0.99, 1.0), 10: (0.1, 0.35), 45: (0.0, 0.0)}.items():
            turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
            assert least <= overlap.agreement(np.column_stack([turn, np.zeros(3)])) <= most
        assert overlap.agreement(np.column_stack([np.eye(3), np.full(3, 9.0)])) == 0.0

    def test_fine_alignment(self, rng):
        T = motion(rng)
        start = T[:3].copy()
        start[:, 3] += 0.01
        finished = align_finely(bumpy(5000, rng), move(bumpy(5000, rng), T), start, 0.1)
        assert rotation_error(finished[:, :3], T[:3, :3]) < 0.3

    def test_inverse(self, rng):
        T = motion(rng)
        np.testing.assert_allclose(inverse(T[:3]), np.linalg.inv(T)[:3], atol=1e-12)

    def test_distinct_keeps_the_first_of_each_answer(self):
        models = np.tile(np.eye(4)[:3], (4, 1, 1))
        models[1, 0, 3] = 0.05  # near the first
        models[2, 0, 3] = 0.5  # another translation
        models[3, :, :3] = Rotation.from_euler("z", 20, degrees=True).as_matrix()  # another rotation
        np.testing.assert_array_equal(distinct(models, 10.0, 0.1), [0, 2, 3])

    def test_agreement(self):
        def hypothesis(cost, angle=0.0):
            model = np.zeros((3, 4))
            model[:, :3] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
            return Hypothesis(model, np.full(10, cost), threshold=1.0)

        stop, problem = Agreement(reach=0.1), OrientedRegistration()
        right, other = hypothesis(0.2), hypothesis(0.4, angle=90.0)
        assert not stop([right, right], problem)
        assert stop([right, right, right], problem)
        assert stop([right, other, right, right], problem)
        assert not stop([right, right, right, hypothesis(0.21, angle=90.0)], problem)
        nothing = Hypothesis(np.full((3, 4), np.nan), np.full(10, 1.0), threshold=1.0)
        assert not stop([right, right, nothing], problem)
