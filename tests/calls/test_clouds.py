"""Registration of raw clouds: the public call, its parts, and its verdict."""

import json
import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nonsac
from cloud_samples import bumpy, motion, move
from nonsac.evaluation import rotation_error
from nonsac.io import read_cloud
from nonsac.result import Status


@pytest.fixture
def scans(rng):
    """Two independent, partial samples of one surface, and the motion between them."""
    T = motion(rng)
    source, target = bumpy(6000, rng), bumpy(6000, rng)
    return source[source[:, 0] > -0.5], move(target[target[:, 2] < 0.9], T), T


def assert_right(result, T, degrees=1.0, shift=0.02):
    assert result.status is Status.OK, result
    assert rotation_error(result.R, T[:3, :3]) < degrees
    assert np.linalg.norm(result.t - T[:3, 3]) < shift * max(1.0, np.linalg.norm(T[:3, 3]))


class TestRegisterClouds:
    def test_partial_scans(self, scans):
        source, target, T = scans
        result = nonsac.register_clouds(source, target)
        assert_right(result, T)
        assert 0.5 < result.inlier_ratio <= 1
        assert result.scale == pytest.approx(1.0, abs=1e-9)
        assert result.covariance is None

    def test_swapping_inverts(self, scans):
        source, target, T = scans
        assert_right(nonsac.register_clouds(target, source), np.linalg.inv(T))

    @pytest.mark.parametrize("unit", [1e-3, 1e3])
    def test_the_unit_does_not_matter(self, scans, unit):
        source, target, _ = scans
        plain = nonsac.register_clouds(source, target)
        scaled = nonsac.register_clouds(unit * source, unit * target)
        np.testing.assert_allclose(scaled.R, plain.R, atol=1e-3)
        np.testing.assert_allclose(scaled.t / unit, plain.t, atol=1e-3)
        assert scaled.noise / unit == pytest.approx(plain.noise, rel=0.1)
        assert scaled.status is plain.status

    @pytest.mark.parametrize("factor", [1000.0, 25.4, 1e-6])
    def test_different_units_are_told(self, scans, factor):
        source, target, _ = scans
        result = nonsac.register_clouds(factor * source, target, samples=4)
        assert not result.success
        assert result.status is not Status.DEGENERATE
        (remark,) = result.remarks
        larger, times, smaller = re.fullmatch(
            r"the clouds differ in size: the (\w+) is about ([0-9,]+) times as large as the (\w+), and no scale is "
            r"estimated; are the units the same\?",
            remark,
        ).groups()
        assert (larger, smaller) == (("source", "target") if factor > 1 else ("target", "source"))
        assert float(times.replace(",", "")) == pytest.approx(max(factor, 1 / factor), rel=0.2)

    def test_a_part_of_a_large_scene_is_no_other_unit(self, scans, rng):
        source, target, T = scans
        scene = np.vstack([target, move(bumpy(4000, rng) * 4 + [9, 0, 0], T)])
        result = nonsac.register_clouds(source, scene)
        assert_right(result, T)
        assert result.remarks == ()

    def test_survey_coordinates_keep_their_digits(self, scans):
        source, target, _ = scans
        offset = np.array([4.5e5, 5.1e6, 1e7])
        plain = nonsac.register_clouds(source, target)
        shifted = nonsac.register_clouds(source + offset, target - offset)
        assert shifted.success
        np.testing.assert_allclose(shifted.apply(source + offset) + offset, plain.apply(source), atol=2e-3)

    def test_answers_are_in_the_frame_of_the_clouds(self, scans):
        source, target, T = scans
        result = nonsac.register_clouds(source + 100.0, target)
        best = result.hypotheses[int(np.argmax([h.score for h in result.hypotheses]))]
        np.testing.assert_allclose(best.model @ np.append(source.mean(0) + 100.0, 1), move(source.mean(0), T), atol=0.1)
        for alternative in result.alternatives:
            assert np.linalg.norm(alternative.T[:3] @ np.append(source.mean(0) + 100.0, 1)) < 5.0
            assert 0 <= alternative.support <= result.inlier_ratio

    def test_model_and_motion_agree_and_there_are_no_rows(self, scans):
        source, target, _ = scans
        result = nonsac.register_clouds(source + 100.0, target)
        np.testing.assert_array_equal(result.model, result.T[:3])
        with pytest.raises(AttributeError, match="the data were raw clouds"):
            result.residuals  # noqa: B018

    def test_same_bits_for_any_workers(self, scans):
        source, target, _ = scans
        serial = nonsac.register_clouds(source, target, workers=1)
        threads = nonsac.register_clouds(source, target, workers=2)
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            processes = nonsac.register_clouds(source, target, workers=pool)
        for other in (threads, processes):
            np.testing.assert_array_equal(other.T, serial.T)
            assert [h.score for h in other.hypotheses] == [h.score for h in serial.hypotheses]

    def test_seeds(self, scans):
        source, target, T = scans
        first, second = (nonsac.register_clouds(source, target, rng=seed) for seed in (1, 2))
        assert_right(first, T)
        assert_right(second, T)
        assert first.info["seed"] == 1
        assert [h.score for h in first.hypotheses] != [h.score for h in second.hypotheses]

    def test_noise_is_measured(self, rng):
        T = motion(rng)
        sigma = 0.01
        source = bumpy(20_000, rng) + rng.normal(scale=sigma, size=(20_000, 3))
        target = move(bumpy(20_000, rng) + rng.normal(scale=sigma, size=(20_000, 3)), T)
        result = nonsac.register_clouds(source, target)
        assert_right(result, T)
        assert 0.3 * sigma < result.noise < 2.0 * sigma

    def test_clutter(self, rng):
        T = motion(rng)
        source, target = bumpy(8000, rng), bumpy(8000, rng)
        source = np.vstack([source, rng.uniform(source.min(0), source.max(0), (8000, 3))])
        target = np.vstack([target, rng.uniform(target.min(0), target.max(0), (8000, 3))])
        assert_right(nonsac.register_clouds(source, move(target, T)), T, degrees=2.0)

    def test_clouds_that_share_points_are_aligned_by_them(self, rng):
        cloud = bumpy(20_000, rng)
        pair = nonsac.simulate.cloud_pair(cloud, rng, points=500, overlap=0.5, noise=0.002)
        result = nonsac.register_clouds(pair.source, pair.target)
        assert_right(result, pair.T, degrees=0.2)

    def test_an_object_in_a_large_scene(self, rng):
        T = motion(rng)
        floor = np.column_stack([rng.uniform(-6, 6, (30_000, 2)), np.full(30_000, -1.5)])
        wall = np.column_stack([np.full(8000, 6.0), rng.uniform(-6, 6, 8000), rng.uniform(-1.5, 1.5, 8000)])
        scene = move(np.vstack([floor, wall, bumpy(8000, rng)]), T)
        result = nonsac.register_clouds(bumpy(4000, rng), scene)
        assert not result.success or rotation_error(result.R, T[:3, :3]) < 2.0

    def test_dropped_points_are_counted_and_warned_about(self, scans):
        source, target, T = scans
        dirty = np.vstack([source, [[np.nan, 0, 0], [0, np.inf, 0]]])
        with pytest.warns(UserWarning, match="dropped 2 of .* source points"):
            result = nonsac.register_clouds(dirty, target)
        assert result.info["dropped_source"] == 2
        assert result.info["dropped_target"] == 0
        assert_right(result, T)

    def test_json(self, scans):
        source, target, _ = scans
        plain = json.loads(nonsac.register_clouds(source, target).to_json())
        assert plain["success"]
        assert plain["info"]["seconds"].keys() == {"preparation", "hypotheses", "selection", "refinement"}

    def test_float32_and_memory_order_do_not_matter(self, scans):
        source, target, T = scans
        assert_right(nonsac.register_clouds(np.asfortranarray(source.astype(np.float32)), target[::-1]), T)


class TestBadInput:
    def test_columns_instead_of_rows(self):
        with pytest.raises(ValueError, match=r"source must have one point in each row .* pass source\.T"):
            nonsac.register_clouds(np.zeros((3, 50)), np.zeros((50, 3)))

    @pytest.mark.parametrize("shape", [(5,), (5, 2), (5, 3, 1)])
    def test_shapes(self, shape):
        with pytest.raises(ValueError, match=r"target must have one point in each row \(n, 3\), got shape"):
            nonsac.register_clouds(np.zeros((50, 3)), np.zeros(shape))

    def test_strings(self):
        with pytest.raises(TypeError, match="source must be an array of real numbers"):
            nonsac.register_clouds([["a", "b", "c"]], np.zeros((5, 3)))

    def test_a_bad_rng_is_named(self):
        with pytest.raises(ValueError, match="rng"):
            nonsac.register_clouds(np.zeros((5, 3)), np.zeros((5, 3)), rng=-1)

    @pytest.mark.parametrize(("name", "wrong"), [("samples", 0), ("sample_size", 1), ("workers", 0)])
    def test_other_settings_are_refused_by_name(self, name, wrong):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            nonsac.register_clouds(np.zeros((5, 3)), np.zeros((5, 3)), **{name: wrong})

    @pytest.mark.parametrize("count", [0, 1, 2])
    def test_too_few_points(self, count, rng):
        result = nonsac.register_clouds(rng.normal(size=(count, 3)), rng.normal(size=(100, 3)))
        assert result.status is Status.TOO_FEW
        assert np.isnan(result.T).all()
        json.loads(result.to_json())

    def test_identical_points(self):
        result = nonsac.register_clouds(np.ones((100, 3)), np.ones((100, 3)))
        assert result.status is Status.DEGENERATE

    def test_collinear_points(self, rng):
        line = rng.normal(size=(500, 1)) * [1.0, 2.0, 3.0]
        assert nonsac.register_clouds(line, line).status is Status.DEGENERATE
        assert nonsac.register_clouds(line + 1e7, line).status is Status.DEGENERATE

    @pytest.mark.parametrize("count", [3, 4, 8, 15, 40])
    def test_tiny_clouds_end_in_a_status(self, count, rng):
        result = nonsac.register_clouds(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))
        assert not result.success

    @pytest.mark.parametrize("far", [30.0, 300.0, 1e6])
    def test_stray_points_do_no_harm(self, scans, far):
        source, target, T = scans
        plain = nonsac.register_clouds(source, target)
        stray = nonsac.register_clouds(np.vstack([source, [[far, 0, 0]]]), np.vstack([target, [[0, far, 0]]]))
        assert_right(stray, T)
        assert stray.info["stray_source"] == stray.info["stray_target"] == 1
        assert stray.num_inliers > 0.9 * plain.num_inliers

    def test_masked_points_are_dropped(self, scans):
        source, target, T = scans
        masked = np.ma.masked_array(source.copy())
        masked[:500] = 1e3
        masked[:500] = np.ma.masked
        with pytest.warns(UserWarning, match="dropped 500 of"):
            assert_right(nonsac.register_clouds(masked, target), T)

    def test_mostly_one_point(self, rng):
        cloud = np.vstack([np.zeros((2000, 3)), rng.normal(size=(20, 3))])
        assert not nonsac.register_clouds(cloud, cloud).success


class TestVerdict:
    """A wrong answer must never be called trusted."""

    @pytest.mark.parametrize("shape", ["sphere", "cylinder", "cube", "plane", "corridor"])
    @pytest.mark.slow
    def test_symmetric_shapes_are_ambiguous(self, shape, rng):
        def sample(n):
            x = rng.uniform(-1, 1, (n, 3))
            face = rng.integers(6, size=n)
            angle = rng.uniform(0, 2 * np.pi, n)
            match shape:
                case "sphere":
                    return x / np.linalg.norm(x, axis=1)[:, None]
                case "cylinder":
                    return np.column_stack([np.cos(angle), np.sin(angle), 2 * x[:, 2]])
                case "cube":
                    x[np.arange(n), face % 3] = np.where(face < 3, -1, 1)
                    return x
                case "plane":
                    return x * [1, 1, 0]
                case "corridor":
                    x[np.arange(n), 1 + face % 2] = np.where(face < 3, -1, 1)
                    return x * [10, 1, 1]

        result = nonsac.register_clouds(sample(3000), move(sample(3000), motion(rng)))
        assert result.status is Status.AMBIGUOUS
        assert result.alternatives[0].support > 0.8 * result.inlier_ratio
        np.testing.assert_array_equal(result.alternatives[0].model, result.alternatives[0].T[:3])

    @pytest.mark.parametrize("seed", range(5))
    @pytest.mark.slow
    def test_unrelated_clouds(self, seed):
        rng = np.random.default_rng(seed)
        scan = nonsac.simulate.demo_scans(rng, points=4000).source
        assert not nonsac.register_clouds(bumpy(4000, rng), scan, rng=seed).success

    @pytest.mark.parametrize("seed", range(5))
    def test_points_in_a_volume(self, seed):
        rng = np.random.default_rng(seed)
        result = nonsac.register_clouds(rng.uniform(size=(1500, 3)), rng.uniform(size=(1500, 3)), rng=seed)
        assert not result.success

    @pytest.mark.parametrize("seed", range(8))
    def test_few_points_in_a_volume(self, seed):
        rng = np.random.default_rng(seed)
        points = rng.normal(size=(40, 3))
        assert not nonsac.register_clouds(points[:30], points[10:], rng=seed).success


class TestRealScans:
    @pytest.mark.parametrize(("folder", "every"), [("bunny_scans", 7), ("redkitchen", 4), ("car_lidar", 1)])
    def test_right_and_trusted(self, data, folder, every):
        spec = json.loads((data / folder / "pairs.json").read_text())
        pairs = [pair for pair in spec["pairs"] if pair["overlap"] > 0.55][::every]
        assert pairs
        for number, pair in enumerate(pairs):
            source, target = (read_cloud(data / folder / pair[key]) for key in ("source", "target"))
            turn = Rotation.random(rng=np.random.default_rng(number)).as_matrix()
            result = nonsac.register_clouds(source @ turn.T, target)
            expected = np.array(pair["T_target_source"])[:3, :3] @ turn.T
            assert result.success, (pair, result)
            assert rotation_error(result.R, expected) < spec["max_rotation_deg"], pair

    def test_scans_of_different_things(self, data):
        bunny = read_cloud(data / "bunny_scans" / "bun000.ply")
        lucy = np.load(data / "shapes" / "lucy_5k.npy")
        kitchen = read_cloud(data / "redkitchen" / "cloud_bin_0.ply")
        for source, target in ((bunny, lucy), (lucy, kitchen), (bunny, kitchen)):
            source, target = (x / np.linalg.norm(np.ptp(x, axis=0)) for x in (source, target))
            assert not nonsac.register_clouds(source, target).success
