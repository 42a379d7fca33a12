import re

import pytest

import nonsac
from nonsac import Remark, Status, simulate
from nonsac.method.noise import noise_remarks

NOISE = 0.01
FACTOR = re.compile(r"noise is (larger|smaller) than given: by a factor of ([\d,.]+)$")


def told(result):
    """The noise that a result speaks of, as a multiple of the given one; 1 if it does not."""
    found = [FACTOR.match(remark) for remark in result.info["remarks"] if remark.startswith("noise")]
    assert len(found) <= 1
    if not found:
        return 1.0
    factor = float(found[0][2].replace(",", ""))
    return factor if found[0][1] == "larger" else 1.0 / factor


@pytest.mark.parametrize(
    ("outliers", "given"),
    [
        *((outliers, given) for outliers in (0.3, 0.5, 0.9) for given in (1e-3, 0.1, 0.3, 1, 10)),
        (0.3, 1e-4),
        (0.5, 1e-4),
    ],
)
def test_a_wrong_noise_of_pairs_is_told_whatever_the_verdict(rng, outliers, given):
    pairs = simulate.registration(2000, outliers, NOISE, rng)
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=given)
    if result.success and result.info["measured_noise"] < 3 * given and given < NOISE:
        return  # ten rows that are nearer than the others: right, if not as accurate as it could be
    assert told(result) * given == pytest.approx(NOISE, rel=0.35)


@pytest.mark.parametrize("pixels", [0.002, 0.02, 20.0, 200.0])
@pytest.mark.parametrize("call", ["relative_pose", "absolute_pose"])
def test_a_wrong_noise_of_poses_is_told_whatever_the_verdict(rng, call, pixels):
    views = getattr(simulate, call)(1500, 0.3, 0.5 / 1000, rng)
    camera = nonsac.Camera("PINHOLE", (1000.0, 1000.0, 800.0, 600.0))
    if call == "relative_pose":
        points = camera.project(views.points1), camera.project(views.points2)
    else:
        points = camera.project(views.points2d), views.points3d
    result = getattr(nonsac, call)(*points, camera, noise=pixels)
    assert told(result) * pixels == pytest.approx(0.5, rel=0.35), result


@pytest.mark.parametrize("given", [1e-4, 1e-2, 0.3])
def test_nothing_is_told_of_rows_without_a_motion(rng, given):
    source, target = rng.uniform(-1, 1, (2, 1500, 3))
    result = nonsac.register_pairs(source, target, noise=given)
    assert result.status is Status.LOW_SUPPORT
    assert told(result) == 1.0


def test_nothing_is_told_of_the_right_noise(rng):
    pairs = simulate.registration(2000, 0.97, NOISE, rng)
    assert told(nonsac.register_pairs(pairs.source, pairs.target, noise=NOISE)) == 1.0


def test_hopeless_rows_cost_no_further_estimates(rng):
    calls = []

    class Counted(nonsac.Ransac):
        def estimate(self, *arguments):
            calls.append(arguments)
            return super().estimate(*arguments)

    rows = nonsac.ArraySource(rng.uniform(-1, 1, (500, 6)))
    result = nonsac.estimate(rows, nonsac.Registration(), Counted(), noise=NOISE, workers=1)
    assert result.status is Status.LOW_SUPPORT
    assert len(calls) == result.info["samples"]


@pytest.mark.parametrize(
    ("ratio", "said"),
    [(100.4, "larger, 100"), (12_345.0, "larger, 12,000"), (3.16, "larger, 3.2"), (1 / 31.0, "smaller, 31"), (2.9, "")],
)
def test_factors_are_written_as_people_write_them(ratio, said):
    kinds = {"larger": Remark.NOISE_LARGER, "smaller": Remark.NOISE_SMALLER}
    expected = [kinds[kind].detailed(f"by a factor of {factor}") for kind, _, factor in [said.partition(", ")] if kind]
    assert list(noise_remarks(ratio, 1.0)) == expected
