import numpy as np
import pytest

from nonsac.kernels.polynomial import LANES, ROOTS, _sort_intervals, new_root_work, real_roots


def solve_lanes(polynomials):
    """Sorted roots of up to LANES polynomials; the lanes that are left hold zeros."""
    lanes = np.zeros((11, LANES))
    lanes[:, : len(polynomials)] = np.transpose(polynomials)
    roots, found = np.full(ROOTS, 7.0), np.full(LANES, 7)
    assert real_roots(lanes.ravel(), new_root_work(), roots, found) == found.max()
    table = roots.reshape(10, LANES).T
    np.testing.assert_array_equal(np.isfinite(table), np.arange(10) < found[:, None])
    assert not found[len(polynomials) :].any()
    return [np.sort(row[:count]) for row, count in zip(table, found, strict=True)][: len(polynomials)]


def solve(polynomials):
    return [roots for i in range(0, len(polynomials), LANES) for roots in solve_lanes(polynomials[i : i + LANES])]


def with_roots(rng, real):
    """All roots of a polynomial of degree ten: these real ones, and complex ones far from the real line."""
    pairs = rng.uniform(-2, 2, (10 - len(real)) // 2) + 1j * rng.uniform(0.5, 2, (10 - len(real)) // 2)
    return np.concatenate([real, pairs, pairs.conj()])


def polynomial_of(rng, roots):
    return rng.choice([-1, 1]) * rng.uniform(0.1, 10) * np.poly(roots).real


def spaced(rng, n, gap, low=-2.0, high=2.0):
    """Sorted random numbers, no two nearer to each other than the gap."""
    while True:
        numbers = np.sort(rng.uniform(low, high, n))
        if (np.diff(numbers) > gap).all():
            return numbers


def assert_found(found, polynomial, roots):
    """That the real ones among these roots were found, as accurately as rounded coefficients and Newton's steps allow.

    Errors are those of x, or of 1 / x where |x| > 1.
    """
    expected = np.sort(roots[roots.imag == 0].real)
    assert len(found) == len(expected)
    for x, true in zip(found, expected, strict=True):
        others = roots[roots != true]
        far = abs(true) > 1
        error, gap = abs(x - true), np.abs(others - true).min()
        if far:
            error, gap = abs(1 / x - 1 / true), np.abs(1 / others - 1 / true).min()
        rounding = np.polyval(np.abs(polynomial), abs(true)) / abs(np.polyval(np.polyder(polynomial), true))
        assert error <= 1e-15 + 1e-15 / gap + 5e-15 * rounding / (true**2 if far else 1)


@pytest.mark.parametrize("n", [0, 2, 4, 6, 8, 10])
def test_finds_all_real_roots_and_no_others(rng, n):
    roots = [with_roots(rng, spaced(rng, n, 0.1)) for _ in range(200)]
    polynomials = [polynomial_of(rng, r) for r in roots]
    for found, polynomial, expected in zip(solve(polynomials), polynomials, roots, strict=True):
        assert_found(found, polynomial, expected)


@pytest.mark.parametrize("decades", [0, 3])
def test_equals_the_eigenvalues_of_the_companion_matrix(rng, decades):
    polynomials = rng.standard_normal((2000, 11)) * 10.0 ** rng.uniform(-decades, decades, (2000, 11))
    different = 0
    for found, polynomial in zip(solve(polynomials), polynomials, strict=True):
        roots = np.roots(polynomial)
        expected = np.sort(roots[(roots.imag == 0) & (np.abs(roots) < 99_999)].real)
        different += len(found) != len(expected) or not np.allclose(found, expected, rtol=1e-7, atol=1e-9)
    assert different <= decades  # a degree may nearly be missing in the chain


@pytest.mark.parametrize("scale", [2.0**-300, 2.0**-20, -1.0, 2.0**20, 2.0**300])
def test_a_factor_does_not_matter(rng, scale):
    polynomials = rng.standard_normal((LANES, 11))
    for found, expected in zip(solve(scale * polynomials), solve(polynomials), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_small_and_large_roots(rng):
    for _ in range(200):
        roots = 10 ** spaced(rng, 10, 0.3, -4.0, 4.9) * rng.choice([-1, 1], 10) + 0j
        polynomial = polynomial_of(rng, roots)
        assert_found(solve([polynomial])[0], polynomial, roots)


def test_roots_beyond_1e5_are_not_looked_for(rng):
    near = spaced(rng, 4, 0.1)
    (found,) = solve([polynomial_of(rng, with_roots(rng, [-1.01e5, 1.01e5, -9.9e4, 9.9e4, *near]))])
    np.testing.assert_allclose(found, [-9.9e4, *near, 9.9e4], rtol=1e-4)


@pytest.mark.parametrize(("gap", "least"), [(1e-2, 500), (1e-3, 500), (1e-4, 495), (1e-5, 495)])
def test_two_roots_next_to_each_other_are_two(rng, gap, least):
    true = [[-4.0, centre, centre + gap, 3.0] for centre in rng.uniform(-1, 1, 500)]
    found = solve([polynomial_of(rng, with_roots(rng, four)) for four in true])
    hits = [len(a) == 4 and np.abs(a - b).max() < gap / 3 for a, b in zip(found, true, strict=True)]
    assert sum(hits) >= least


@pytest.mark.parametrize("gap", [0.0, 1e-10, 1e-9])
def test_roots_too_near_to_each_other_are_at_most_two_and_hide_no_others(rng, gap):
    """The coefficients are rounded, so that a double root is one, two or none."""
    counts = set()
    for centre in rng.uniform(-1, 1, 500):
        (found,) = solve([polynomial_of(rng, with_roots(rng, [centre, centre + gap, 3.0, -4.0]))])
        np.testing.assert_allclose(found[[0, -1]], [-4.0, 3.0], rtol=1e-9)
        np.testing.assert_allclose(found[1:-1], centre, atol=0.02)
        counts.add(len(found) - 2)
    assert counts == {0, 1, 2}


def test_rounding_never_adds_a_root(rng):
    """Sign changes that go up and down, or are more or fewer than those at the ends."""
    for _ in range(1000):
        work = new_root_work()
        work.changes[:] = rng.integers(0, 11, len(work.changes))
        last, before = np.sort(rng.integers(0, 11, 2)).astype(float)
        _sort_intervals(3, -0.5, 0.01, before, last, work)
        intervals = work.waiting[: work.counters[0]]
        assert (intervals[:, 3] - intervals[:, 4]).sum() + work.counters[1] == before - last


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.1])
def test_ten_roots_next_to_each_other_are_at_most_ten(rng, size):
    """The chain is nothing but rounding then."""
    found = solve([np.poly(rng.uniform(-1, 1) + size * rng.uniform(-1, 1, 10)) for _ in range(2000)])
    assert max(map(len, found)) <= 10


@pytest.mark.parametrize(
    ("polynomial", "expected"),
    [
        (np.poly([1, -1, 2, -2, 3, -3, 4, -4, 5, -6]), [-6, -4, -3, -2, -1, 1, 2, 3, 4, 5]),
        (np.poly([0, 1, 10, 100, 1000, 10000, 1j, -1j, 2j, -2j]).real, [0, 1, 10, 100, 1000, 10000]),
        (np.poly([0, 0, 1, 1, 2, 2, 3, 3, 4, 4]) + np.eye(11)[10], []),
    ],
)
def test_polynomials_with_known_roots(polynomial, expected):
    np.testing.assert_allclose(solve([polynomial])[0], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("polynomial", [[1, *[0] * 9, -1], [1, *[0] * 9, 1], [1, 0, 0, 0, 0, -3, 0, 0, 0, 0, 1]])
def test_polynomials_in_whose_chain_a_degree_is_missing_have_none(polynomial):
    assert len(solve([polynomial])[0]) == 0


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, -np.inf])
def test_a_leading_coefficient_that_is_zero_or_not_finite(rng, bad):
    polynomial = rng.standard_normal(11)
    polynomial[0] = bad
    assert len(solve([polynomial])[0]) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("place", range(1, 11))
def test_polynomials_that_are_not_finite_have_none(rng, place, bad):
    polynomials = rng.standard_normal((LANES, 11))
    polynomials[:, place] = bad
    assert not any(map(len, solve(polynomials)))


def test_lanes_do_not_depend_on_each_other(rng):
    polynomials = rng.standard_normal((LANES, 11))
    polynomials[rng.permutation(LANES)[:3]] = np.array([np.nan, 0.0, np.inf])[:, None]
    for polynomial, found in zip(polynomials, solve_lanes(polynomials), strict=True):
        np.testing.assert_array_equal(solve_lanes([polynomial])[0], found)


def test_what_is_left_in_the_work_memory_does_not_matter(rng):
    batches = [rng.standard_normal(11 * LANES), np.full(11 * LANES, np.nan), rng.standard_normal(11 * LANES)]
    shared = new_root_work()
    for batch in batches * 2:
        roots, expected = np.empty((2, ROOTS))
        real_roots(batch, shared, roots, np.empty(LANES, np.int64))
        real_roots(batch, new_root_work(), expected, np.empty(LANES, np.int64))
        np.testing.assert_array_equal(roots, expected)
