import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac import Noise, Registration, RelativePose, Rows, simulate
from nonsac.estimators import hough
from nonsac.estimators.hough import Hough, fullest, quaternions, sides_agree
from nonsac.testing import check_estimator

NOISE = 0.01


def two_clouds(rng, n=1000, outliers=0.9, scale=1.0):
    pairs = simulate.registration(n, outliers, NOISE, rng)
    return np.hstack([pairs.source, scale * pairs.target]), pairs.T


def estimate(rows, problem=None, seed=0, weights=None, **settings):
    rng = np.random.default_rng(seed)
    return Hough(**settings).estimate(problem or Registration(), Rows(rows, weights), Noise.given(NOISE), rng)


def motions(rotations):
    return np.stack([np.column_stack([R, [1.0, 2.0, 3.0]]) for R in rotations.as_matrix()])


# --- votes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 77.0, 179.9, 180.0])
@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.3, -0.5, 0.8], [1.0, -1.0, 0.0]])
def test_rotations_that_are_alike_fill_a_cell_wherever_they_are(rng, angle, axis):
    """At half a turn, too, where quaternions change their sign."""
    middle = Rotation.from_rotvec(np.radians(angle) * np.array(axis) / np.linalg.norm(axis))
    alike = Rotation.from_rotvec(np.radians(0.3) * rng.standard_normal((40, 3))) * middle
    others = Rotation.from_rotvec(np.radians(0.01) * rng.standard_normal((30, 3)) + [0.5, 0.7, 0.6])
    models = motions(Rotation.concatenate([Rotation.random(500, random_state=rng), others, alike]))
    assert np.mean(fullest(models, 12.0, 1)[:15] >= 530) > 0.9


def test_the_fullest_cell_has_the_votes_of_a_slow_count(rng):
    models = motions(Rotation.random(3000, random_state=rng))
    width, most = np.radians(20.0) / 2, 0
    for shift in (0.0, 0.5):
        votes = {}
        for model in models:
            q = Rotation.from_matrix(model[:, :3]).as_quat()
            for each in (q, -q):
                key = tuple(np.floor(each / width + shift))
                votes[key] = votes.get(key, 0) + 1
        most = max(most, *votes.values())
    members = fullest(models, 20.0, 1)
    assert len(members) >= most
    places = {tuple(place) for place in np.floor(quaternions(models[members[:most]]) / width + 0.0)}
    others = {tuple(place) for place in np.floor(quaternions(models[members[:most]]) / width + 0.5)}
    assert min(len(places), len(others)) <= 2  # of q, or of -q


@pytest.mark.parametrize("scale", [1.0, 2.5, None])
def test_sides_are_compared_as_they_are_said_to_be(rng, scale):
    true_scale = scale or 1.7
    model = naive.random_model(rng, true_scale)
    samples = naive.matching_rows(rng, 300, model, noise=0.03).reshape(-1, 3, 6)
    samples[50:, 2, 3:] += rng.normal(0, 0.2, (50, 3))
    found = sides_agree(samples, scale, 0.05)
    for sample, agrees in zip(samples, found, strict=True):
        pairs = [(0, 1), (1, 2), (2, 0)]
        sides = np.array([[np.linalg.norm(np.subtract(*half)) for half in naive_halves(sample, *p)] for p in pairs])
        longest = sides[np.argmax(sides[:, 0])]
        by = longest[1] / longest[0] if scale is None else scale
        assert agrees == (np.abs(by * sides[:, 0] - sides[:, 1]) < 0.1).all()
    assert found[:50].mean() > 0.7
    assert found[50:].mean() < 0.5


def naive_halves(sample, i, j):
    return (sample[i, :3], sample[j, :3]), (sample[i, 3:], sample[j, 3:])


# --- the method -------------------------------------------------------------------------------------------------------


def test_does_what_the_contract_says(rng):
    check_estimator(Hough(), Registration(), two_clouds(rng)[0], NOISE)


@pytest.mark.parametrize(("outliers", "least"), [(0.5, 20), (0.9, 20), (0.95, 19)])
def test_solves_registrations_of_which_few_rows_are_right(outliers, least):
    right = 0
    for seed in range(20):
        rows, T = two_clouds(np.random.default_rng(seed), outliers=outliers)
        found = estimate(rows, seed=seed)
        right += found.found and naive.angle_between(found.model, T) < 5.0
        assert found.tested > 1
    assert right >= least


def test_solves_registrations_of_unknown_scale(rng):
    rows, T = two_clouds(rng, outliers=0.8, scale=2.0)
    found = estimate(rows, Registration(None))
    assert naive.angle_between(found.model, T) < 3.0
    assert np.cbrt(np.linalg.det(found.model[:, :3])) == pytest.approx(2.0, rel=0.03)


def test_weights_draw_rows_and_count_them(rng):
    """Of two motions with as many rows, the one that weighs more is found."""
    rows, first = two_clouds(rng, 100, 0.0)
    others, second = two_clouds(rng, 100, 0.0)
    for T, weights in ((first, (3.0, 1.0)), (second, (1.0, 3.0))):
        found = estimate(np.vstack([rows, others]), weights=np.repeat(weights, 100), triplets=5000)
        assert naive.angle_between(found.model, T) < 3.0


@pytest.mark.parametrize("hopeless", ["same", "few", "none", "unrelated"])
def test_hopeless_rows_give_nothing_and_no_error(rng, hopeless):
    rows = two_clouds(rng)[0]
    unrelated = np.hstack([rows[:100, :3], 1000.0 * rows[:100, 3:]])
    rows = {"same": np.repeat(rows[:1], 50, axis=0), "few": rows[:2], "none": rows[:0], "unrelated": unrelated}[
        hopeless
    ]
    found = estimate(rows, triplets=2000)
    assert not found.found
    assert len(found.residuals) == len(rows)
    assert found.tested == 0


def test_other_problems_are_refused_by_name(rng):
    rows = Rows(np.ones((9, 4)))
    for refusing in (Hough().check, lambda problem: Hough().estimate(problem, rows, Noise.given(NOISE), rng)):
        with pytest.raises(TypeError, match="Hough estimates 3D registrations only, got RelativePose"):
            refusing(RelativePose())


def test_a_budget_is_of_triplets():
    assert Hough().with_budget(3) == Hough(300_000)


def test_wrong_settings_are_refused_by_name():
    for name in ("triplets", "peaks"):
        for number in (0, 1.5, True, "3"):
            with pytest.raises(ValueError, match=f"{name} must be a whole number of at least 1, got"):
                Hough(**{name: number})
    for cell in (0.0, -1.0, 181.0, np.nan, "8"):
        with pytest.raises(ValueError, match="cell must be an angle above 0"):
            Hough(cell=cell)


def test_of_many_models_that_agree_some_are_enough(rng, monkeypatch):
    """Where all rows are right, all triplets vote: that must not take longest."""
    drawn = []
    counted = hough.sides_agree
    monkeypatch.setattr(hough, "sides_agree", lambda *a: drawn.append(len(a[0])) or counted(*a))
    points = rng.random((200, 3))
    found = hough.Hough().estimate(
        Registration(), Rows(np.hstack([points, points + np.array([1.0, 2.0, 3.0])])), Noise.given(0.01), rng
    )
    assert sum(drawn) <= 20_000
    assert found.found
