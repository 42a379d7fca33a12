"""Relative pose of two calibrated cameras from five matches."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel
from nonsac.kernels.polynomial import new_root_work, real_roots
from nonsac.kernels.pose_math import orthonormalise, rotate, solve_in_place, tangents


@kernel
def five_point_poses(samples, models):
    """All relative poses that five matches allow, for each of B samples.

    Solves x2^T E x1 = 0 for five matches, det E = 0 and 2 E E^T E = tr(E E^T) E, for E = [t]x R. The formulation is
    Nister's ("An efficient solution to the five-point relative pose problem", PAMI 2004): E is a combination of four
    matrices, elimination in the ten cubic constraints leaves one polynomial of degree ten in one variable. Its roots
    are isolated with Sturm's theorem. Compared with the polynomial eigenvalue form (Kukelova, Bujnak and Pajdla 2008)
    and the action matrix (Stewenius, Engels and Nister 2006), which need the eigenvalues of a 10 x 10 matrix, this is
    several times faster; what it loses in digits comes back through a Gauss-Newton step on the pose.

    Preconditions: the five matches are distinct, and not all on a line in either image. Points on a plane are fine.

    Parameters
    ----------
    samples : (B, 5, 4) float64
        Rows x1 y1 x2 y2 in normalised image coordinates.
    models : (10 B, 3, 4) float64
        Receives [R | t] with X2 = R X1 + t and |t| = 1.

    Returns
    -------
    int
        How many of `models` were filled: for each sample 0 to 10, those with all five points in front of both
        cameras. Samples that do not determine finitely many poses have none.
    """
    rows, basis = np.empty((5, 9)), np.empty((4, 9))
    entries, quadratics, cubics = np.empty((9, 4)), np.empty((6, 10)), np.empty((10, 20))
    hidden, minor, polynomial, roots = np.empty((3, 13)), np.empty(7), np.empty(11), np.empty(10)
    work = new_root_work()
    essential, system = np.empty((3, 3)), np.empty((5, 6))
    count = 0
    for b in range(samples.shape[0]):
        sample = samples[b]
        if not null_space(sample, rows, basis):
            continue
        cubic_constraints(basis, entries, quadratics, cubics)
        if not eliminate(cubics):
            continue
        hide_variable(cubics, hidden)
        determinant(hidden, minor, polynomial)
        for r in range(real_roots(polynomial, work, roots)):
            essential_at(hidden, roots[r], basis, essential)
            if pose_in_front(essential, sample, models[count]) and polish(sample, system, models[count]):
                count += 1
    return count


@reordered_kernel
def null_space(sample, rows, basis):
    """Orthonormal basis (4, 9) of the matrices E that fulfil x2^T E x1 = 0 for five matches, by Householder's QR.

    Returns False where the matches are not independent.
    """
    for i in range(5):
        x, y, u, v = sample[i, 0], sample[i, 1], sample[i, 2], sample[i, 3]
        rows[i, 0], rows[i, 1], rows[i, 2] = u * x, u * y, u
        rows[i, 3], rows[i, 4], rows[i, 5] = v * x, v * y, v
        rows[i, 6], rows[i, 7], rows[i, 8] = x, y, 1.0
    for j in range(4):
        for c in range(9):
            basis[j, c] = 0.0
        basis[j, 5 + j] = 1.0
    for k in range(5):
        w = rows[k]
        square, whole = 0.0, 0.0
        for c in range(k, 9):
            square += w[c] * w[c]
        for c in range(9):
            whole += w[c] * w[c]
        if not square > 1e-16 * whole:
            return False
        norm = np.sqrt(square) if w[k] < 0.0 else -np.sqrt(square)
        scale = 1.0 / np.sqrt(square - norm * w[k])
        w[k] -= norm
        for c in range(9):
            w[c] = scale * w[c] if c >= k else 0.0
        for i in range(k + 1, 5):
            reflect(w, rows[i])
    for k in range(4, -1, -1):
        for j in range(4):
            reflect(rows[k], basis[j])
    return True


@reordered_kernel
def reflect(w, z):
    """z -= (w . z) w, in place."""
    product = 0.0
    for c in range(9):
        product += w[c] * z[c]
    for c in range(9):
        z[c] -= product * w[c]


@reordered_kernel
def cubic_constraints(basis, entries, quadratics, cubics):
    """det E = 0 and 2 E E^T E - tr(E E^T) E = 0 for E = x B1 + y B2 + z B3 + B4, as ten cubics (10, 20).

    Monomials: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1.
    """
    for i in range(9):
        for v in range(4):
            entries[i, v] = basis[v, i]
    quadratics[:] = 0.0
    cubics[:] = 0.0
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        add_product(entries[3 + d], entries[6 + e], 1.0, quadratics[c])
        add_product(entries[3 + e], entries[6 + d], -1.0, quadratics[c])
        add_cubic(quadratics[c], entries[c], cubics[9])
    quadratics[:] = 0.0
    slot = 0
    for i in range(3):
        for j in range(i, 3):
            for k in range(3):
                add_product(entries[3 * i + k], entries[3 * j + k], 1.0, quadratics[slot])
            slot += 1
    q00, q01, q02, q11, q12, q22 = (
        quadratics[0],
        quadratics[1],
        quadratics[2],
        quadratics[3],
        quadratics[4],
        quadratics[5],
    )
    for c in range(10):
        half = 0.5 * (q00[c] + q11[c] + q22[c])
        q00[c] -= half
        q11[c] -= half
        q22[c] -= half
    for j in range(3):
        e0, e1, e2 = entries[j], entries[3 + j], entries[6 + j]
        add_cubic(q00, e0, cubics[j])
        add_cubic(q01, e1, cubics[j])
        add_cubic(q02, e2, cubics[j])
        add_cubic(q01, e0, cubics[3 + j])
        add_cubic(q11, e1, cubics[3 + j])
        add_cubic(q12, e2, cubics[3 + j])
        add_cubic(q02, e0, cubics[6 + j])
        add_cubic(q12, e1, cubics[6 + j])
        add_cubic(q22, e2, cubics[6 + j])


@reordered_kernel
def add_product(a, b, sign, quadratic):
    """Add sign (a . v)(b . v) with v = (x, y, z, 1) to a quadratic: x2 xy y2 xz yz z2 x y z 1."""
    a0, a1, a2, a3 = sign * a[0], sign * a[1], sign * a[2], sign * a[3]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    quadratic[0] += a0 * b0
    quadratic[1] += a0 * b1 + a1 * b0
    quadratic[2] += a1 * b1
    quadratic[3] += a0 * b2 + a2 * b0
    quadratic[4] += a1 * b2 + a2 * b1
    quadratic[5] += a2 * b2
    quadratic[6] += a0 * b3 + a3 * b0
    quadratic[7] += a1 * b3 + a3 * b1
    quadratic[8] += a2 * b3 + a3 * b2
    quadratic[9] += a3 * b3


@reordered_kernel
def add_cubic(q, linear, cubic):
    """Add a quadratic times a linear form to a cubic, in the orders of monomials above."""
    x, y, z, w = linear[0], linear[1], linear[2], linear[3]
    xx, xy, yy, xz, yz, zz, qx, qy, qz, one = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], q[8], q[9]
    cubic[0] += xx * x
    cubic[1] += yy * y
    cubic[2] += xy * x + xx * y
    cubic[3] += yy * x + xy * y
    cubic[4] += xz * x + xx * z
    cubic[5] += qx * x + xx * w
    cubic[6] += yz * y + yy * z
    cubic[7] += qy * y + yy * w
    cubic[8] += yz * x + xz * y + xy * z
    cubic[9] += qy * x + qx * y + xy * w
    cubic[10] += zz * x + xz * z
    cubic[11] += qz * x + qx * z + xz * w
    cubic[12] += one * x + qx * w
    cubic[13] += zz * y + yz * z
    cubic[14] += qz * y + qy * z + yz * w
    cubic[15] += one * y + qy * w
    cubic[16] += zz * z
    cubic[17] += qz * z + zz * w
    cubic[18] += one * z + qz * w
    cubic[19] += one * w


@reordered_kernel
def eliminate(cubics):
    """Bring the first ten columns to the unit upper triangle, and the last six rows of them to the unit matrix.

    Gauss's elimination with partial pivoting; returns False where the matrix is singular.
    """
    for k in range(10):
        best, pivot = abs(cubics[k, k]), k
        for i in range(k + 1, 10):
            if abs(cubics[i, k]) > best:
                best, pivot = abs(cubics[i, k]), i
        if not best > 1e-14:
            return False
        row = cubics[k]
        if pivot != k:
            other = cubics[pivot]
            for c in range(k, 20):
                row[c], other[c] = other[c], row[c]
        inverse = 1.0 / row[k]
        for c in range(k, 20):
            row[c] *= inverse
        for i in range(k + 1, 10):
            other = cubics[i]
            factor = other[k]
            for c in range(k, 20):
                other[c] -= factor * row[c]
    for k in range(9, 4, -1):
        row = cubics[k]
        for i in range(4, k):
            other = cubics[i]
            factor = other[k]
            for c in range(10, 20):
                other[c] -= factor * row[c]
    return True


@reordered_kernel
def hide_variable(cubics, hidden):
    """Three equations in x, y, 1 whose coefficients are polynomials in z (3, 13): four, four and five of them.

    The rows for x2z, y2z and xyz less z times those for x2, y2 and xy.
    """
    for r in range(3):
        upper, lower, row = cubics[4 + 2 * r], cubics[5 + 2 * r], hidden[r]
        for start in (0, 4):
            column = 10 if start == 0 else 13
            row[start] = -lower[column]
            row[start + 1] = upper[column] - lower[column + 1]
            row[start + 2] = upper[column + 1] - lower[column + 2]
            row[start + 3] = upper[column + 2]
        row[8] = -lower[16]
        row[9] = upper[16] - lower[17]
        row[10] = upper[17] - lower[18]
        row[11] = upper[18] - lower[19]
        row[12] = upper[19]


@reordered_kernel
def determinant(hidden, minor, polynomial):
    """Determinant of the 3 x 3 matrix of polynomials: (11,), highest power first."""
    polynomial[:] = 0.0
    for r in range(3):
        a, b, c = hidden[(r + 1) % 3], hidden[(r + 2) % 3], hidden[r]
        minor[:] = 0.0
        for i in range(4):
            for j in range(4):
                minor[i + j] += a[i] * b[4 + j] - a[4 + i] * b[j]
        for i in range(7):
            for j in range(5):
                polynomial[i + j] += minor[i] * c[8 + j]


@reordered_kernel
def essential_at(hidden, z, basis, essential):
    """The essential matrix (3, 3) that belongs to a root z: x and y solve the three equations there."""
    a0, a1, a2 = _at(hidden[0], 0, 3, z), _at(hidden[0], 4, 3, z), _at(hidden[0], 8, 4, z)
    b0, b1, b2 = _at(hidden[1], 0, 3, z), _at(hidden[1], 4, 3, z), _at(hidden[1], 8, 4, z)
    c0, c1, c2 = _at(hidden[2], 0, 3, z), _at(hidden[2], 4, 3, z), _at(hidden[2], 8, 4, z)
    x, y, w = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    largest = x * x + y * y + w * w
    for pair in range(2):
        p0, p1, p2 = (b0, b1, b2) if pair == 0 else (a0, a1, a2)
        u, v, s = p1 * c2 - p2 * c1, p2 * c0 - p0 * c2, p0 * c1 - p1 * c0
        norm = u * u + v * v + s * s
        if norm > largest:
            x, y, w, largest = u, v, s, norm
    z *= w
    for i in range(3):
        for j in range(3):
            c = 3 * i + j
            essential[i, j] = x * basis[0, c] + y * basis[1, c] + z * basis[2, c] + w * basis[3, c]


@reordered_kernel
def _at(coefficients, start, degree, z):
    value = coefficients[start]
    for i in range(1, degree + 1):
        value = value * z + coefficients[start + i]
    return value


@kernel
def pose_in_front(essential, sample, model):
    """The pose [R | t] of an essential matrix that has all matches (N, 4) in front of both cameras, if there is one.

    In closed form (Horn, "Recovering baseline and orientation from essential matrix", 1990): the cofactors of
    E = [t]x R are t (R^T t)^T, and |t|^2 R = cofactors - [t]x E. Returns False where no pose is in front.
    """
    e = essential
    norm = 0.0
    for i in range(3):
        for j in range(3):
            norm += e[i, j] * e[i, j]
    if not 0.0 < norm < np.inf:
        return False
    scale = np.sqrt(2.0 / norm)
    e00, e01, e02 = scale * e[0, 0], scale * e[0, 1], scale * e[0, 2]
    e10, e11, e12 = scale * e[1, 0], scale * e[1, 1], scale * e[1, 2]
    e20, e21, e22 = scale * e[2, 0], scale * e[2, 1], scale * e[2, 2]
    c00, c01, c02 = e11 * e22 - e12 * e21, e12 * e20 - e10 * e22, e10 * e21 - e11 * e20
    c10, c11, c12 = e21 * e02 - e22 * e01, e22 * e00 - e20 * e02, e20 * e01 - e21 * e00
    c20, c21, c22 = e01 * e12 - e02 * e11, e02 * e10 - e00 * e12, e00 * e11 - e01 * e10
    t0, t1, t2 = c00, c10, c20
    largest = t0 * t0 + t1 * t1 + t2 * t2
    second = c01 * c01 + c11 * c11 + c21 * c21
    if second > largest:
        t0, t1, t2, largest = c01, c11, c21, second
    third = c02 * c02 + c12 * c12 + c22 * c22
    if third > largest:
        t0, t1, t2, largest = c02, c12, c22, third
    if not largest > 0.0:
        return False
    scale = 1.0 / np.sqrt(largest)
    t0, t1, t2 = scale * t0, scale * t1, scale * t2
    d00, d01, d02 = t1 * e20 - t2 * e10, t1 * e21 - t2 * e11, t1 * e22 - t2 * e12
    d10, d11, d12 = t2 * e00 - t0 * e20, t2 * e01 - t0 * e21, t2 * e02 - t0 * e22
    d20, d21, d22 = t0 * e10 - t1 * e00, t0 * e11 - t1 * e01, t0 * e12 - t1 * e02
    for twist in (-1.0, 1.0):
        model[0, 0], model[0, 1], model[0, 2] = c00 + twist * d00, c01 + twist * d01, c02 + twist * d02
        model[1, 0], model[1, 1], model[1, 2] = c10 + twist * d10, c11 + twist * d11, c12 + twist * d12
        model[2, 0], model[2, 1], model[2, 2] = c20 + twist * d20, c21 + twist * d21, c22 + twist * d22
        model[0, 3], model[1, 3], model[2, 3] = t0, t1, t2
        side = side_of(sample, model)
        if side != 0.0:
            model[0, 3], model[1, 3], model[2, 3] = side * t0, side * t1, side * t2
            return True
    return False


@kernel
def side_of(sample, model):
    """1 where all matches are in front of both cameras, -1 where they are after t is turned around, else 0.

    From d2 x2 = d1 R x1 + t: d1 = -(t x x2) . n / |n|^2 and d2 = -(t x R x1) . n / |n|^2 with n = R x1 x x2.
    """
    t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
    side = 0.0
    for i in range(sample.shape[0]):
        x, y, u, v = sample[i, 0], sample[i, 1], sample[i, 2], sample[i, 3]
        a0 = model[0, 0] * x + model[0, 1] * y + model[0, 2]
        a1 = model[1, 0] * x + model[1, 1] * y + model[1, 2]
        a2 = model[2, 0] * x + model[2, 1] * y + model[2, 2]
        n0, n1, n2 = a1 - a2 * v, a2 * u - a0, a0 * v - a1 * u
        first = (t1 - t2 * v) * n0 + (t2 * u - t0) * n1 + (t0 * v - t1 * u) * n2
        second = (t1 * a2 - t2 * a1) * n0 + (t2 * a0 - t0 * a2) * n1 + (t0 * a1 - t1 * a0) * n2
        if side == 0.0:
            side = -1.0 if first > 0.0 else 1.0
        if not (first * side < 0.0 and second * side < 0.0):
            return 0.0
    return side


@kernel
def polish(sample, system, model):
    """Gauss-Newton steps on a pose until it fulfils the five epipolar equations; False where it does not get there.

    The pose moves on its manifold: R by a rotation vector from the left, t in its tangent plane. `system` (5, 6) is
    overwritten.
    """
    orthonormalise(model)
    before = np.inf
    for _ in range(4):
        t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
        b0, b1, b2, c0, c1, c2 = tangents(t0, t1, t2)
        largest = 0.0
        for i in range(5):
            x, y, u, v = sample[i, 0], sample[i, 1], sample[i, 2], sample[i, 3]
            a0 = model[0, 0] * x + model[0, 1] * y + model[0, 2]
            a1 = model[1, 0] * x + model[1, 1] * y + model[1, 2]
            a2 = model[2, 0] * x + model[2, 1] * y + model[2, 2]
            n0, n1, n2 = a1 - a2 * v, a2 * u - a0, a0 * v - a1 * u
            m0, m1, m2 = v * t2 - t1, t0 - u * t2, u * t1 - v * t0
            row = system[i]
            row[0], row[1], row[2] = a1 * m2 - a2 * m1, a2 * m0 - a0 * m2, a0 * m1 - a1 * m0
            row[3] = b0 * n0 + b1 * n1 + b2 * n2
            row[4] = c0 * n0 + c1 * n1 + c2 * n2
            row[5] = -(t0 * n0 + t1 * n1 + t2 * n2)
            largest = max(largest, abs(row[5]))
        if largest < 1e-13:
            return True
        if not largest < before or not solve_in_place(system):
            break
        before = largest
        rotate(model, system[0, 5], system[1, 5], system[2, 5])
        d, e = system[3, 5], system[4, 5]
        t0, t1, t2 = t0 + d * b0 + e * c0, t1 + d * b1 + e * c1, t2 + d * b2 + e * c2
        scale = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        model[0, 3], model[1, 3], model[2, 3] = scale * t0, scale * t1, scale * t2
    return before < 1e-9
