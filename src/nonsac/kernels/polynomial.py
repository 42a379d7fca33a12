"""Real roots of polynomials, by Sturm's theorem and safeguarded Newton steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


class RootWork(NamedTuple):
    """Scratch memory of `real_roots`."""

    remainders: np.ndarray  # (2, 16)
    chain: np.ndarray  # (11, 3)
    points: np.ndarray  # (16,)
    changes: np.ndarray  # (16,) int32
    stack: np.ndarray  # (40, 2)
    brackets: np.ndarray  # (10, 2)
    lanes: np.ndarray  # (256,)


@kernel
def new_root_work():
    return RootWork(
        np.zeros((2, 16)),
        np.zeros((11, 3)),
        np.zeros(16),
        np.zeros(16, np.int32),
        np.zeros((40, 2)),
        np.zeros((10, 2)),
        np.zeros(256),
    )


@reordered_kernel
def sturm_chain(polynomial, work, chain):
    """Write the Sturm chain of a polynomial of degree n as the quotients of Euclid's algorithm.

    With f_0 the polynomial and f_1 its derivative, f_k = (a_k x + b_k) f_{k+1} - c_k f_{k+2}, where every f is scaled
    to a leading coefficient of 1 or -1. Evaluating the chain then costs three operations a step instead of k.

    Parameters
    ----------
    polynomial : (n + 1,) float64, highest power first, n >= 1
    work : (2, n + 1) float64, overwritten
    chain : (n + 1, 3) float64, receives a_k, b_k, c_k; `chain[steps, 0]` is the constant f_steps

    Returns
    -------
    int
        The number of steps; below n where the polynomial has multiple roots.
    """
    degree = polynomial.shape[0] - 1
    upper, lower = work[0], work[1]
    for i in range(degree + 1):
        upper[i] = polynomial[i]
        lower[i] = polynomial[i] * (degree - i)
    step = 0
    n = degree
    while True:
        inverse = 1.0 / lower[0]
        a = upper[0] * inverse
        b = (upper[1] - a * lower[1] * (n > 1)) * inverse
        chain[step, 0] = a
        chain[step, 1] = b
        chain[step, 2] = 0.0
        step += 1
        if n == 1:
            break
        for i in range(2, n):
            upper[i] = b * lower[i - 1] + a * lower[i] - upper[i]
        upper[n] = b * lower[n - 1] - upper[n]
        scale = abs(upper[2])
        if not scale > 1e-300:
            break
        inverse = 1.0 / scale
        for i in range(n - 1):
            remainder = upper[i + 2] * inverse
            upper[i] = lower[i]
            lower[i] = remainder
        upper[n - 1] = lower[n - 1]
        chain[step - 1, 2] = scale
        n -= 1
    chain[step, 0] = lower[0]
    return step


@reordered_kernel
def count_sign_changes(chain, steps, points, values, changes):
    """Sign changes of the Sturm chain at some points (W,); `values` (2, W) is overwritten.

    The difference between two points is the number of distinct real roots between them.
    """
    older, newer = values[0], values[1]
    constant = chain[steps, 0]
    for i in range(points.shape[0]):
        older[i] = 0.0
        newer[i] = constant
        changes[i] = 0
    for k in range(steps - 1, -1, -1):
        a, b, c = chain[k, 0], chain[k, 1], chain[k, 2]
        for i in range(points.shape[0]):
            value = (a * points[i] + b) * newer[i] - c * older[i]
            changes[i] += np.int32((value < 0.0) != (newer[i] < 0.0))
            older[i] = newer[i]
            newer[i] = value


@kernel
def isolate_roots(chain, steps, points, values, changes, stack, brackets):
    """Intervals that hold one real root each, in `brackets` (n, 2); returns their number.

    Intervals are cut in u with x = u / (1 - |u|), which maps (-1, 1) to the real line: the first one at all `points`,
    what holds several roots then at a few. Roots that are still together in an interval of 1e-7 count as one; roots
    beyond |x| = 1e5 are not looked for.
    """
    stack[0, 0], stack[0, 1] = -0.99999, 0.99999
    width = points.shape[0]
    waiting, found = 1, 0
    while waiting > 0:
        waiting -= 1
        low = stack[waiting, 0]
        size = (stack[waiting, 1] - low) / (width - 1)
        for i in range(width):
            u = low + i * size
            points[i] = u / (1.0 - abs(u))
        count_sign_changes(chain, steps, points[:width], values, changes)
        for i in range(width - 1):
            roots = changes[i] - changes[i + 1]
            if roots < 1 or found == brackets.shape[0]:
                continue
            if roots == 1 or size < 1e-7 or waiting == stack.shape[0]:
                brackets[found, 0] = points[i]
                brackets[found, 1] = points[i + 1]
                found += 1
            else:
                stack[waiting, 0] = low + i * size
                stack[waiting, 1] = low + (i + 1) * size
                waiting += 1
        width = min(8, points.shape[0])
    return found


@reordered_kernel
def refine_roots(polynomial, brackets, count, lanes, roots):
    """Newton's method in all brackets of a polynomial of degree ten at once, halving those that a step would leave.

    Brackets far from 0 are searched for the inverse of the root, a root of the reversed polynomial: Newton's method
    creeps along x^10.

    `lanes` (256,) holds 16 numbers of each kind, one for each bracket: the coefficients from 0, the ends from 176 and
    192, the root from 208, the value at the lower end from 224, the last step from 240. One array with strides that
    are known when compiling, and loops of a multiple of eight, are what makes the compiler vectorise over brackets.
    """
    padded = (count + 7) // 8 * 8
    for r in range(count):
        low, high = brackets[r, 0], brackets[r, 1]
        far = abs(low + high) > 2.0
        if far:
            for i in range(11):
                lanes[16 * i + r] = polynomial[10 - i]
        else:
            for i in range(11):
                lanes[16 * i + r] = polynomial[i]
        lanes[176 + r] = 1.0 / high if far else low
        lanes[192 + r] = 1.0 / low if far else high
    for r in range(padded):
        x = lanes[176 + r]
        value = lanes[r]
        for i in range(1, 11):
            value = value * x + lanes[16 * i + r]
        lanes[224 + r] = value
        lanes[208 + r] = 0.5 * (x + lanes[192 + r])
    for _ in range(50):
        largest = 0.0
        for r in range(padded):
            x, low, high = lanes[208 + r], lanes[176 + r], lanes[192 + r]
            value, slope = lanes[r], 0.0
            for i in range(1, 11):
                slope = slope * x + value
                value = value * x + lanes[16 * i + r]
            beyond = value * lanes[224 + r] <= 0.0
            low = low if beyond else x
            high = x if beyond else high
            step = x - value / slope
            middle = 0.5 * (low + high)
            step = step if step >= low else middle
            step = step if step <= high else middle
            lanes[240 + r] = abs(step - x)
            lanes[176 + r] = low
            lanes[192 + r] = high
            lanes[208 + r] = step
        for r in range(count):
            largest = max(largest, lanes[240 + r])
        if largest <= 1e-8:
            break
    for r in range(count):
        x = lanes[208 + r]
        roots[r] = 1.0 / x if abs(brackets[r, 0] + brackets[r, 1]) > 2.0 else x


@kernel
def real_roots(polynomial, work, roots):
    """Distinct real roots of a polynomial of degree ten between -1e5 and 1e5, in no order.

    Sturm's theorem isolates them, Newton's method refines them to about 1e-15 of the distance of neighbouring roots.

    Parameters
    ----------
    polynomial : (11,) float64, highest power first
    work : RootWork
    roots : (10,) float64

    Returns
    -------
    int
        How many of `roots` were filled; 0 for a polynomial whose leading coefficient is 0 or not finite.
    """
    if not 0.0 < abs(polynomial[0]) < np.inf:
        return 0
    steps = sturm_chain(polynomial, work.remainders, work.chain)
    found = isolate_roots(work.chain, steps, work.points, work.remainders, work.changes, work.stack, work.brackets)
    refine_roots(polynomial, work.brackets, found, work.lanes, roots)
    return found
