from itertools import combinations

import numpy as np
import pytest

import naive
from nonsac.kernels.oriented_pairs import consistent_pairs, motions_of_pairs

TOLERANCE, ANGLE, SMALLEST = 0.05, 0.1, 0.3


def units(rng, n):
    vectors = rng.standard_normal((n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def planted(rng, n, model, flip=True):
    """Rows (a, u, b, v) under a rigid motion; the normals of the second cloud randomly flipped."""
    a, u = rng.uniform(-1, 1, (n, 3)), units(rng, n)
    signs = rng.choice([-1.0, 1.0], (n, 1)) if flip else 1.0
    return np.hstack([a, u, naive.moved(model, a), signs * (u @ model[:, :3].T)])


def unrelated(rng, n):
    return np.hstack([rng.uniform(-1, 1, (n, 3)), units(rng, n), rng.uniform(-1, 1, (n, 3)), units(rng, n)])


def find(rows, room=100_000):
    pairs = np.full((room, 2), -1, np.int32)
    columns = np.ascontiguousarray(rows.T, np.float32)
    count = consistent_pairs(columns, np.float32(TOLERANCE), np.float32(ANGLE), np.float32(SMALLEST), pairs)
    return count, [tuple(map(int, pair)) for pair in pairs[: min(count, room)]]


def motions(rows, pairs, angle=ANGLE):
    samples = np.ascontiguousarray(rows[np.array(pairs)])
    models = np.full((4 * len(samples), 3, 4), np.nan)
    return models[: motions_of_pairs(samples, angle, models)]


@pytest.mark.parametrize("n", [1, 2, 3, 8, 9, 33, 60])
def test_pairs_equal_the_definition(rng, n):
    rows = np.vstack([planted(rng, n // 2, naive.random_model(rng)), unrelated(rng, n - n // 2)])
    rows = rng.permutation(rows)
    expected = [
        p for p in combinations(range(n), 2) if naive.oriented_pair_is_consistent(rows, *p, TOLERANCE, ANGLE, SMALLEST)
    ]
    count, found = find(rows)
    assert count == len(found)
    assert sorted(found) == expected


@pytest.mark.parametrize("n", [255, 256, 257, 258, 600])
def test_pairs_of_many_rows_equal_those_of_few(rng, n):
    """The kernel works in blocks: each pair is found wherever its rows stand."""
    rows = rng.permutation(np.vstack([planted(rng, n // 4, naive.random_model(rng)), unrelated(rng, n - n // 4)]))
    count, found = find(rows)
    assert count == len(found) == len(set(found))
    assert all(i < j for i, j in found)
    expected = set()
    pieces = np.array_split(np.arange(n), 6)
    for first, second in combinations(pieces, 2):
        both = np.union1d(first, second)
        expected |= {(int(both[i]), int(both[j])) for i, j in find(rows[both])[1]}
    assert set(found) == expected


def test_every_pair_of_a_planted_motion_is_found_whatever_the_signs(rng):
    rows = planted(rng, 40, naive.random_model(rng))
    far = {p for p in combinations(range(40), 2) if naive.oriented_pair_invariants(rows, *p)[0, 0] > 1.001 * SMALLEST}
    assert far <= set(find(rows)[1])


def test_the_search_ends_when_there_is_no_more_room(rng):
    rows = planted(rng, 30, naive.random_model(rng))
    count, every = find(rows)
    assert count > 10
    assert find(rows, room=10) == (10, every[:10])


def test_no_pair_among_one_row(rng):
    assert find(unrelated(rng, 1)) == (0, [])


def test_rows_that_are_not_finite_are_in_no_pair(rng):
    rows = planted(rng, 20, naive.random_model(rng))
    rows[7, 8] = np.nan
    rows[9, 4] = np.nan
    found = find(rows)[1]
    assert found
    assert not {7, 9} & set(np.ravel(found))


@pytest.mark.parametrize("flip", [False, True])
def test_motions_of_planted_pairs_hold_the_planted_motion(rng, flip):
    model = naive.random_model(rng)
    rows = planted(rng, 30, model, flip)
    pairs, recovered = find(rows)[1], 0
    for pair in pairs:
        candidates = motions(rows, [pair])
        assert len(candidates) <= 4
        recovered += bool(len(candidates)) and np.abs(candidates - model).max(axis=(1, 2)).min() < 1e-9
    assert recovered > 0.9 * len(pairs)  # the others' normals are nearly along the chord


def test_motions_are_rigid_and_map_the_points(rng):
    rows = np.vstack([planted(rng, 20, naive.random_model(rng)), unrelated(rng, 60)])
    pairs = find(rows)[1]
    for pair in pairs:
        for model in motions(rows, [pair]):
            np.testing.assert_allclose(model[:, :3] @ model[:, :3].T, np.eye(3), atol=1e-9)
            assert np.linalg.det(model[:, :3]) == pytest.approx(1.0)
            sample = rows[list(pair)]
            np.testing.assert_allclose(naive.moved(model, sample[:, :3]), sample[:, 6:9], atol=0.51 * TOLERANCE)


def test_wrong_normals_give_no_motion():
    # Chord along x in both clouds; normals across it in the first, along it in the second.
    across, along = [0.0, 0, 1], [1.0, 0, 0]
    rows = np.array([[0.0, 0, 0, *across, 0, 0, 0, *along], [1.0, 0, 0, *across, 1, 0, 0, *along]])
    assert len(motions(rows, [(0, 1)])) == 0


@pytest.mark.parametrize("wrong", [0, 1])
def test_one_wrong_normal_gives_no_motion(wrong):
    """The normals are at right angles in both clouds, but one of the second's lies along the chord."""
    x, y, z = np.eye(3)
    second = [z, y]
    second[wrong] = x
    rows = np.array([[*(0 * x), *z, *(0 * x), *second[0]], [*x, *y, *x, *second[1]]])
    assert len(motions(rows, [(0, 1)])) == 0


def test_opposite_normals_do_not_cancel(rng):
    """Their parts across the chord point in opposite directions, as of the two sides of a wall."""
    model = naive.random_model(rng)
    x, _, z = np.eye(3)
    points, normals = np.array([0 * x, x]), np.array([z, -z])
    rows = np.hstack([points, normals, naive.moved(model, points), normals @ model[:, :3].T])
    assert np.abs(motions(rows, [(0, 1)]) - model).max(axis=(1, 2)).min() < 1e-12


def test_normals_along_the_chord_give_no_motion():
    along = [1.0, 0, 0]
    rows = np.array([[0.0, 0, 0, *along, 0, 0, 0, *along], [1.0, 0, 0, *along, 1, 0, 0, *along]])
    assert len(motions(rows, [(0, 1)])) == 0


def test_identical_points_give_no_motion(rng):
    rows = np.repeat(planted(rng, 1, naive.random_model(rng)), 2, axis=0)
    assert len(motions(rows, [(0, 1)])) == 0


def test_ambiguous_signs_give_several_motions(rng):
    # Both normals across the chord and across each other's: turning by 180 degrees about the chord fits as well.
    rows = np.array([[0.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1]])
    found = motions(rows, [(0, 1)])
    half_turn = np.diag([1.0, -1.0, -1.0])
    assert len(found) == 2
    for expected in (np.eye(3), half_turn):
        assert np.abs(found[:, :, :3] - expected).max(axis=(1, 2)).min() < 1e-12


def test_no_more_motions_than_there_is_room_for(rng):
    rows = planted(rng, 20, naive.random_model(rng))
    samples = rows[np.array(find(rows)[1])]
    assert motions_of_pairs(samples, ANGLE, np.empty((3, 3, 4))) == 3
