"""Real roots of polynomials, by Sturm's theorem and safeguarded Newton steps.

Polynomials are worked on side by side, one in each lane: number i of lane s is stored at `LANES * i + s`. Loops over
the lanes vectorise, since their length and all strides in them are known when compiling. With 8 lanes they would not:
in loops that short, LLVM does not compare addresses at run time to see that arrays do not overlap.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nonsac.kernels._jit import kernel

LANES = 16
_TINY = 1e-300
# The most roots of all lanes together.
ROOTS = 10 * LANES

_POINTS = 16
_END = 0.99999


class RootWork(NamedTuple):
    """Scratch memory of `real_roots`."""

    remainders: np.ndarray  # (2, 11 * LANES)
    chains: np.ndarray  # (31 * LANES,)
    points: np.ndarray  # (_POINTS,)
    changes: np.ndarray  # (_POINTS,)
    waiting: np.ndarray  # (ROOTS, 5): lane, low, size, changes at both ends
    brackets: np.ndarray  # (ROOTS + 1, 3): lane, low, high
    counters: np.ndarray  # (2,) int64: how many are waiting, how many brackets
    newton: np.ndarray  # (17 * ROOTS,)


@kernel
def new_root_work():
    return RootWork(
        np.zeros((2, 11 * LANES)),
        np.zeros(31 * LANES),
        np.zeros(_POINTS),
        np.zeros(_POINTS),
        np.zeros((ROOTS, 5)),
        np.zeros((ROOTS + 1, 3)),
        np.zeros(2, np.int64),
        np.zeros(17 * ROOTS),
    )


@kernel
def real_roots(polynomials, work, roots, found):
    """Distinct real roots of polynomials of degree ten between -1e5 and 1e5, in no order.

    Sturm's theorem isolates them, Newton's method refines them until a step is below 1e-8, in x or, far from 0, in
    1 / x. What is left is about the square of that, divided by the distance of the nearest other root. Roots that
    are nearly multiple, to about 1e-4, may be missed, or found in the wrong number there.

    Parameters
    ----------
    polynomials : (11 * LANES,) float64, highest power first
    work : RootWork
    roots : (10 * LANES,) float64, NaN if a lane has no more roots
    found : (LANES,) int64
        Receives the number of roots of each lane. It is 0 for a polynomial that is not finite or not of degree ten, or
        in whose Sturm chain a degree is missing, such as x^10 - 1.

    Returns
    -------
    int
        The largest of `found`.
    """
    sturm_chains(polynomials, work.remainders, work.chains)
    isolate_roots(work)
    count = work.counters[1]
    load_newton(polynomials, work.brackets[:count], work.newton)
    for start in range(0, count, LANES):
        refine_roots(work.newton[start:])
    roots[:] = np.nan
    found[:] = 0
    most = 0
    for r in range(count):
        lane = int(work.brackets[r, 0])
        roots[LANES * found[lane] + lane] = work.newton[13 * ROOTS + r]
        found[lane] += 1
        most = max(most, found[lane])
    return most


@kernel
def sturm_chains(polynomials, remainders, chains):
    """Write the Sturm chains of polynomials of degree ten as the quotients of Euclid's algorithm.

    With f_0 the polynomial and f_1 its derivative, f_k = (a_k x + b_k) f_{k+1} - c_k f_{k+2}, where f_2 and later
    ones are scaled to a leading coefficient of 1 or -1. Evaluating the chain then costs three operations a step
    instead of k.

    Parameters
    ----------
    polynomials : (11 * LANES,) float64, highest power first
    remainders : (2, 11 * LANES) float64, overwritten
    chains : (31 * LANES,) float64
        Receives a_0, b_0, c_0, a_1 ... c_9 and the constant f_10, which is NaN if a degree is missing.
    """
    upper, lower = remainders[0], remainders[1]
    for i in range(11):
        for s in range(LANES):
            upper[LANES * i + s] = polynomials[LANES * i + s]
            lower[LANES * i + s] = polynomials[LANES * i + s] * (10 - i)
    for k in range(10):
        _divide(upper, lower, chains[3 * LANES * k :])
        upper, lower = lower, upper
    for s in range(LANES):
        chains[30 * LANES + s] = upper[s]


@kernel
def _divide(upper, lower, quotient):
    """One step of Euclid's algorithm, upper = (a x + b) lower - c remainder; the remainder replaces `upper`."""
    for s in range(LANES):
        inverse = 1.0 / lower[s]
        a = upper[s] * inverse
        b = (upper[LANES + s] - a * lower[LANES + s]) * inverse
        for i in range(2, 11):
            remainder = b * lower[LANES * (i - 1) + s] + a * lower[LANES * i + s] - upper[LANES * i + s]
            upper[LANES * (i - 2) + s] = remainder
        if upper[s] == 0.0:  # a double root, to the last bit: two roots as near as numbers can be
            upper[s] = _TINY
        c = abs(upper[s])
        scale = 1.0 / c
        for i in range(9):
            upper[LANES * i + s] *= scale
        quotient[s] = a
        quotient[LANES + s] = b
        quotient[2 * LANES + s] = c
        upper[9 * LANES + s] = 0.0
        upper[10 * LANES + s] = 0.0


@kernel
def isolate_roots(work):
    """Intervals that hold one real root each, in `work.brackets`; their number in `work.counters`.

    Intervals are cut in u with x = u / (1 - |u|), which maps (-1, 1) to the real line: at first the whole line, then
    again those that hold several roots. Roots that are still together in an interval of 1e-7 count as one; roots
    beyond |x| = 1e5 are not looked for.
    """
    points, changes, counters = work.points, work.changes, work.counters
    counters[:] = 0
    size = 2.0 * _END / (_POINTS - 1)
    for lane in range(LANES):
        _count_sign_changes(work.chains[lane:], -_END, size, points, changes)
        _sort_intervals(lane, -_END, size, changes[0], min(changes[0], changes[_POINTS - 1]), work)
    while counters[0] > 0:
        counters[0] -= 1
        interval = work.waiting[counters[0]]
        lane, low, size, before, last = int(interval[0]), interval[1], interval[2], interval[3], interval[4]
        _count_sign_changes(work.chains[lane:], low, size, points, changes)
        _sort_intervals(lane, low, size, before, last, work)


@kernel
def _count_sign_changes(chain, low, size, points, changes):
    """Sign changes of a lane's Sturm chain at points that are equally far from each other in u.

    The difference between two points is the number of distinct real roots between them.
    """
    for i in range(_POINTS):
        u = low + i * size
        x = u / (1.0 - abs(u))
        older, newer, count = 0.0, chain[30 * LANES], 0.0
        for j in range(10):
            k = 3 * LANES * (9 - j)
            value = (chain[k] * x + chain[k + LANES]) * newer - chain[k + 2 * LANES] * older
            count += 1.0 if (value < 0.0) != (newer < 0.0) else 0.0
            older = newer
            newer = value
        points[i] = x
        changes[i] = count


@kernel
def _sort_intervals(lane, low, size, before, last, work):
    """Intervals between points: with one root to the brackets, with more to those that wait to be cut again.

    `before` and `last` are the sign changes at the ends. Those in between are made to fall from one to the other, so
    that rounding never adds a root. There are no branches, which the processor could not predict.
    """
    narrow = size < 1e-7
    waiting, found = work.counters[0], work.counters[1]
    for i in range(1, _POINTS):
        after = max(last, min(before, work.changes[i])) if i < _POINTS - 1 else last
        roots = before - after
        bracket, interval = work.brackets[found], work.waiting[waiting]
        bracket[0], bracket[1], bracket[2] = lane, work.points[i - 1], work.points[i]
        interval[0], interval[1], interval[2] = lane, low + (i - 1) * size, size / (_POINTS - 1)
        interval[3], interval[4] = before, after
        found += (roots == 1.0) | ((roots > 1.0) & narrow)
        waiting += (roots > 1.0) & (not narrow)
        before = after
    work.counters[0], work.counters[1] = waiting, found


@kernel
def load_newton(polynomials, brackets, newton):
    """What `refine_roots` needs: ROOTS numbers of each kind, one for each bracket.

    The coefficients come first, then at 11 and 12 the ends, at 15 the last step, at 16 whether the root is an inverse.
    Brackets far from 0 are searched for the inverse of the root, a root of the reversed polynomial: Newton's method
    creeps along x^10.
    """
    for r in range(brackets.shape[0]):
        lane, low, high = int(brackets[r, 0]), brackets[r, 1], brackets[r, 2]
        far = abs(low + high) > 2.0
        position = 10 * LANES + lane if far else lane
        stride = -LANES if far else LANES
        for i in range(11):
            newton[ROOTS * i + r] = polynomials[position]
            position += stride
        newton[11 * ROOTS + r] = 1.0 / high if far else low
        newton[12 * ROOTS + r] = 1.0 / low if far else high
        newton[15 * ROOTS + r] = 1.0
        newton[16 * ROOTS + r] = 1.0 if far else 0.0


@kernel
def refine_roots(newton):
    """Newton's method in LANES brackets at once, halving those that a step would leave; the roots are put at 13.

    A root whose last step was below 1e-8 stays: its next step would be about the square of that.
    """
    for s in range(LANES):
        x = newton[11 * ROOTS + s]
        value = newton[s]
        for i in range(1, 11):
            value = value * x + newton[ROOTS * i + s]
        newton[13 * ROOTS + s] = 0.5 * (x + newton[12 * ROOTS + s])
        newton[14 * ROOTS + s] = value
    for _ in range(50):
        for s in range(LANES):
            x, low, high = newton[13 * ROOTS + s], newton[11 * ROOTS + s], newton[12 * ROOTS + s]
            value, slope = newton[s], 0.0
            for i in range(1, 11):
                slope = slope * x + value
                value = value * x + newton[ROOTS * i + s]
            beyond = value * newton[14 * ROOTS + s] <= 0.0
            low = low if beyond else x
            high = x if beyond else high
            middle = 0.5 * (low + high)
            step = x - value / slope
            step = step if step >= low else middle
            step = step if step <= high else middle
            moving = newton[15 * ROOTS + s] > 1e-8
            newton[11 * ROOTS + s] = low
            newton[12 * ROOTS + s] = high
            newton[13 * ROOTS + s] = step if moving else x
            newton[15 * ROOTS + s] = abs(step - x) if moving else 0.0
        largest = 0.0
        for s in range(LANES):
            largest = max(largest, newton[15 * ROOTS + s])
        if largest <= 1e-8:
            break
    for s in range(LANES):
        x = newton[13 * ROOTS + s]
        newton[13 * ROOTS + s] = 1.0 / x if newton[16 * ROOTS + s] > 0.0 else x
