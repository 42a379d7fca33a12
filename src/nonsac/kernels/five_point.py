"""Relative pose of two calibrated cameras from five matches."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.polynomial import LANES, ROOTS, new_root_work, real_roots
from nonsac.kernels.pose_math import orthonormalise, rotate, solve_in_place, tangents

# Ten numbers of all lanes: what reflections act on, or a quadratic.
VECTOR = 10 * LANES
# I - m m^T, a reflection that mixes the basis of E. Without it, B4 would have no part in the E of a sideways motion
# without rotation, and the root that belongs to it would be infinite.
_MIX = (0.3, 0.6, 0.7, 1.0295630140987)


@kernel
def five_point_poses(samples, models):
    """All relative poses that five matches allow, for each of B samples.

    Solves x2^T E x1 = 0 for five matches, det E = 0 and 2 E E^T E = tr(E E^T) E, for E = [t]x R. The formulation is
    Nister's ("An efficient solution to the five-point relative pose problem", PAMI 2004): E is a combination of four
    matrices, elimination in the ten cubic constraints leaves one polynomial of degree ten in one variable. Its roots
    are isolated with Sturm's theorem. Compared with the polynomial eigenvalue form (Kukelova, Bujnak and Pajdla 2008)
    and the action matrix (Stewenius, Engels and Nister 2006), which need the eigenvalues of a 10 x 10 matrix, this is
    several times faster; what it loses in digits comes back through a Gauss-Newton step on the pose.

    All but the isolation of roots and that last step is done for LANES samples side by side, as `polynomial` explains.
    A lane whose sample is degenerate turns to NaN and has no roots; no lane depends on the others.

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
        cameras. Samples that do not determine finitely many poses have none, but for a few with all points in a
        plane through a camera's centre: rounding hides that these are degenerate.
    """
    steps, inverses = np.zeros(20), np.zeros(10 * LANES)
    matches, rows, mirrors = np.zeros(20 * LANES), np.zeros((5, VECTOR)), np.zeros((5, 11 * LANES))
    basis, quadratics, cubics = np.zeros(4 * VECTOR), np.zeros((3, 3 * VECTOR)), np.zeros(20 * VECTOR)
    equations, minor, polynomials = np.zeros((3, 13 * LANES)), np.zeros(7 * LANES), np.zeros(11 * LANES)
    work, roots, found = new_root_work(), np.zeros(ROOTS), np.zeros(LANES, np.int64)
    essentials, poses, sides = np.zeros(9 * LANES), np.zeros((10, 12 * LANES)), np.zeros((10, LANES))
    hits, system = np.zeros((ROOTS + 1, 2), np.int64), np.zeros((5, 6))
    steps[10:] = 1.0
    count = 0
    for start in range(0, samples.shape[0], LANES):
        block = samples[start : start + LANES]
        spread_matches(block, matches)
        null_space(matches, steps, rows, mirrors, inverses, basis.reshape((4, VECTOR)))
        cubic_constraints(basis, quadratics, cubics)
        eliminate(cubics.reshape((20, VECTOR)), steps, mirrors[0], inverses)
        hide_variable(cubics, equations)
        determinant(equations, minor, polynomials)
        most = real_roots(polynomials, work, roots, found)
        for r in range(most):
            essentials_at(roots[LANES * r :], equations, basis, essentials)
            poses_in_front(essentials, matches, poses[r], sides[r])
        for h in range(list_hits(sides, most, block.shape[0], hits)):
            lane, r = hits[h, 0], hits[h, 1]
            gather_pose(poses[r], sides[r, lane], lane, models[count])
            if polish(block[lane], system, models[count]):
                count += 1
    return count


@kernel
def spread_matches(samples, matches):
    """Up to LANES samples to lanes; the last one fills the lanes that are left."""
    for s in range(LANES):
        sample = samples[min(s, samples.shape[0] - 1)]
        for i in range(5):
            for j in range(4):
                matches[LANES * (4 * i + j) + s] = sample[i, j]


@kernel
def null_space(matches, steps, rows, mirrors, inverses, basis):
    """Orthonormal basis (4, VECTOR) of the E with x2^T E x1 = 0 for five matches, by Householder's QR.

    E is a vector of nine numbers, column by column; the tenth of `rows` and `basis` is 0.
    """
    epipolar_rows(matches, rows)
    basis[:] = 0.0
    for v in range(4):
        for w in range(4):
            value = (1.0 if v == w else 0.0) - _MIX[v] * _MIX[w]
            for s in range(LANES):
                basis[v, LANES * (5 + w) + s] = value
    for k in range(5):
        reflector(rows[k], steps[9 - k :], mirrors[k], inverses)
        reflect(mirrors[k], rows[k + 1 :])
    for k in range(4, -1, -1):
        reflect(mirrors[k], basis)


@kernel
def epipolar_rows(matches, rows):
    """The unit vectors whose products with E are 0."""
    for i in range(5):
        match, row = matches[4 * LANES * i :], rows[i]
        for s in range(LANES):
            x, y, u, v = match[s], match[LANES + s], match[2 * LANES + s], match[3 * LANES + s]
            one = 1.0 / np.sqrt((x * x + y * y + 1.0) * (u * u + v * v + 1.0))
            x, y = one * x, one * y
            row[s], row[LANES + s], row[2 * LANES + s] = u * x, v * x, x
            row[3 * LANES + s], row[4 * LANES + s], row[5 * LANES + s] = u * y, v * y, y
            row[6 * LANES + s], row[7 * LANES + s], row[8 * LANES + s] = u * one, v * one, one
            row[9 * LANES + s] = 0.0


@kernel
def reflector(column, steps, mirror, inverse):
    """The reflection z - f (w . z) w that clears a column below its k-th number.

    `steps` starts with k + 1 zeros, and goes on with ones. `mirror` receives the ten numbers of w, and f; `inverse` the
    inverse of what the k-th number becomes. If that number is not above 1e-11, the columns are dependent, and f is NaN:
    in 100,000 samples that determine poses, it stayed above 1e-7; of collinear samples and pure rotations, one in a
    hundred or fewer got above 1e-11.
    """
    for s in range(LANES):
        square, head = 0.0, 0.0
        for c in range(10):
            value = steps[c + 1] * column[LANES * c + s]
            head += (1.0 - steps[c]) * value
            square += value * value
        norm = np.sqrt(square) if head < 0.0 else -np.sqrt(square)
        factor = 1.0 / (square - norm * head) if square > 1e-22 else np.nan
        for c in range(10):
            mirror[LANES * c + s] = steps[c + 1] * (column[LANES * c + s] - (1.0 - steps[c]) * norm)
        mirror[VECTOR + s] = factor
        inverse[s] = (norm - head) * factor


@kernel
def reflect(mirror, vectors):
    """Apply a reflection to vectors (N, VECTOR), in place."""
    for j in range(vectors.shape[0]):
        z = vectors[j]
        for s in range(LANES):
            product = 0.0
            for c in range(10):
                product += mirror[LANES * c + s] * z[LANES * c + s]
            product *= mirror[VECTOR + s]
            for c in range(10):
                z[LANES * c + s] -= product * mirror[LANES * c + s]


@kernel
def cubic_constraints(basis, quadratics, cubics):
    """2 E E^T E - tr(E E^T) E = 0 and det E = 0 for E = x B1 + y B2 + z B3 + B4, as ten cubics.

    `basis` (4 * VECTOR,) holds B1 to B4, so that entry (i, j) of E starts at LANES * (3 * j + i); `quadratics` is (3,
    3 * VECTOR). In `cubics` (20 * VECTOR,) each monomial has its ten coefficients together:
    x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1.
    """
    quadratics[:] = 0.0
    for i in range(3):
        for j in range(3):
            for k in range(3):
                a, b = basis[LANES * (3 * k + i) :], basis[LANES * (3 * k + j) :]
                add_product(a, b, 1.0, quadratics[i, VECTOR * j :])
    for c in range(VECTOR):
        trace = quadratics[0, c] + quadratics[1, VECTOR + c] + quadratics[2, 2 * VECTOR + c]
        for i in range(3):
            quadratics[i, VECTOR * i + c] -= 0.5 * trace
    for i in range(3):
        for j in range(3):
            sum_of_products(quadratics[i], basis[LANES * 3 * j :], cubics[LANES * (3 * i + j) :])
    quadratics[0] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        cofactor = quadratics[0, VECTOR * i :]
        add_product(basis[LANES * (3 + j) :], basis[LANES * (6 + k) :], 1.0, cofactor)
        add_product(basis[LANES * (3 + k) :], basis[LANES * (6 + j) :], -1.0, cofactor)
    sum_of_products(quadratics[0], basis, cubics[LANES * 9 :])


@kernel
def add_product(a, b, sign, quadratic):
    """Add sign (a . v)(b . v) with v = (x, y, z, 1) to a quadratic: x2 xy y2 xz yz z2 x y z 1."""
    for s in range(LANES):
        a0, a1, a2, a3 = sign * a[s], sign * a[VECTOR + s], sign * a[2 * VECTOR + s], sign * a[3 * VECTOR + s]
        b0, b1, b2, b3 = b[s], b[VECTOR + s], b[2 * VECTOR + s], b[3 * VECTOR + s]
        quadratic[s] += a0 * b0
        quadratic[LANES + s] += a0 * b1 + a1 * b0
        quadratic[2 * LANES + s] += a1 * b1
        quadratic[3 * LANES + s] += a0 * b2 + a2 * b0
        quadratic[4 * LANES + s] += a1 * b2 + a2 * b1
        quadratic[5 * LANES + s] += a2 * b2
        quadratic[6 * LANES + s] += a0 * b3 + a3 * b0
        quadratic[7 * LANES + s] += a1 * b3 + a3 * b1
        quadratic[8 * LANES + s] += a2 * b3 + a3 * b2
        quadratic[9 * LANES + s] += a3 * b3


@kernel
def sum_of_products(quadratics, linear, cubic):
    """Three quadratics times three linear forms, in the orders of monomials above, into one cubic."""
    for s in range(LANES):
        c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = c8 = c9 = 0.0
        d0 = d1 = d2 = d3 = d4 = d5 = d6 = d7 = d8 = d9 = 0.0
        for k in range(3):
            i, j = LANES * k + s, VECTOR * k + s
            x, y, z, w = linear[i], linear[VECTOR + i], linear[2 * VECTOR + i], linear[3 * VECTOR + i]
            xx, xy, yy = quadratics[j], quadratics[LANES + j], quadratics[2 * LANES + j]
            xz, yz, zz = quadratics[3 * LANES + j], quadratics[4 * LANES + j], quadratics[5 * LANES + j]
            qx, qy = quadratics[6 * LANES + j], quadratics[7 * LANES + j]
            qz, one = quadratics[8 * LANES + j], quadratics[9 * LANES + j]
            c0 += xx * x
            c1 += yy * y
            c2 += xy * x + xx * y
            c3 += yy * x + xy * y
            c4 += xz * x + xx * z
            c5 += qx * x + xx * w
            c6 += yz * y + yy * z
            c7 += qy * y + yy * w
            c8 += yz * x + xz * y + xy * z
            c9 += qy * x + qx * y + xy * w
            d0 += zz * x + xz * z
            d1 += qz * x + qx * z + xz * w
            d2 += one * x + qx * w
            d3 += zz * y + yz * z
            d4 += qz * y + qy * z + yz * w
            d5 += one * y + qy * w
            d6 += zz * z
            d7 += qz * z + zz * w
            d8 += one * z + qz * w
            d9 += one * w
        cubic[0 * VECTOR + s] = c0
        cubic[1 * VECTOR + s] = c1
        cubic[2 * VECTOR + s] = c2
        cubic[3 * VECTOR + s] = c3
        cubic[4 * VECTOR + s] = c4
        cubic[5 * VECTOR + s] = c5
        cubic[6 * VECTOR + s] = c6
        cubic[7 * VECTOR + s] = c7
        cubic[8 * VECTOR + s] = c8
        cubic[9 * VECTOR + s] = c9
        cubic[10 * VECTOR + s] = d0
        cubic[11 * VECTOR + s] = d1
        cubic[12 * VECTOR + s] = d2
        cubic[13 * VECTOR + s] = d3
        cubic[14 * VECTOR + s] = d4
        cubic[15 * VECTOR + s] = d5
        cubic[16 * VECTOR + s] = d6
        cubic[17 * VECTOR + s] = d7
        cubic[18 * VECTOR + s] = d8
        cubic[19 * VECTOR + s] = d9


@kernel
def eliminate(cubics, steps, mirror, inverses):
    """Solve ten cubic equations for the first ten of their monomials (20, VECTOR), by Householder's QR.

    The last ten then hold the coefficients of the solution, but only for the monomials from x2z on.
    """
    for k in range(10):
        reflector(cubics[k], steps[9 - k :], mirror, inverses[LANES * k :])
        reflect(mirror, cubics[k + 1 :])
    substitute_back(cubics[:10].reshape(10 * VECTOR), inverses, cubics[10:])


@kernel
def substitute_back(triangle, inverses, columns):
    """The last six unknowns of triangular systems, in place of their right sides."""
    for j in range(columns.shape[0]):
        z = columns[j]
        for s in range(LANES):
            for step in range(6):
                k = 9 - step
                value = inverses[LANES * k + s] * z[LANES * k + s]
                z[LANES * k + s] = value
                for i in range(4, k):
                    z[LANES * i + s] -= triangle[VECTOR * k + LANES * i + s] * value


@kernel
def hide_variable(cubics, equations):
    """Three equations in x, y, 1 whose coefficients are polynomials in z: four, four and five numbers of them.

    The equations for x2z, y2z and xyz less z times those for x2, y2 and xy.
    """
    for r in range(3):
        upper = cubics[10 * VECTOR + LANES * (4 + 2 * r) :]
        lower, equation = upper[LANES:], equations[r]
        for s in range(LANES):
            for half in range(2):
                i, j = LANES * 4 * half + s, VECTOR * 3 * half + s
                equation[i] = -lower[j]
                equation[LANES + i] = upper[j] - lower[VECTOR + j]
                equation[2 * LANES + i] = upper[VECTOR + j] - lower[2 * VECTOR + j]
                equation[3 * LANES + i] = upper[2 * VECTOR + j]
            equation[8 * LANES + s] = -lower[6 * VECTOR + s]
            equation[9 * LANES + s] = upper[6 * VECTOR + s] - lower[7 * VECTOR + s]
            equation[10 * LANES + s] = upper[7 * VECTOR + s] - lower[8 * VECTOR + s]
            equation[11 * LANES + s] = upper[8 * VECTOR + s] - lower[9 * VECTOR + s]
            equation[12 * LANES + s] = upper[9 * VECTOR + s]


@kernel
def determinant(equations, minor, polynomials):
    """Determinant of the three equations: eleven coefficients, highest power first."""
    polynomials[:] = 0.0
    for r in range(3):
        a, b, c = equations[(r + 1) % 3], equations[(r + 2) % 3], equations[r]
        minor[:] = 0.0
        for s in range(LANES):
            for i in range(4):
                for j in range(4):
                    p, q = LANES * i + s, LANES * j + s
                    minor[LANES * i + q] += a[p] * b[4 * LANES + q] - a[4 * LANES + p] * b[q]
        for s in range(LANES):
            for i in range(7):
                for j in range(5):
                    polynomials[LANES * (i + j) + s] += minor[LANES * i + s] * c[LANES * (8 + j) + s]


@kernel
def essentials_at(roots, equations, basis, essentials):
    """The essential matrix, column by column, that belongs to a root z: x and y solve the three equations there."""
    first, second, third = equations[0], equations[1], equations[2]
    for s in range(LANES):
        z = roots[s]
        a0, a1, a2 = _values(first, s, z)
        b0, b1, b2 = _values(second, s, z)
        c0, c1, c2 = _values(third, s, z)
        x, y, w = _longer(a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0, 0.0, 0.0, 0.0)
        x, y, w = _longer(b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0, x, y, w)
        x, y, w = _longer(c1 * a2 - c2 * a1, c2 * a0 - c0 * a2, c0 * a1 - c1 * a0, x, y, w)
        z *= w
        for i in range(9):
            j = LANES * i + s
            essentials[j] = x * basis[j] + y * basis[VECTOR + j] + z * basis[2 * VECTOR + j] + w * basis[3 * VECTOR + j]


@kernel
def _values(equation, s, z):
    """The three coefficients of an equation at z."""
    x, y, one = 0.0, 0.0, 0.0
    for i in range(4):
        x = x * z + equation[LANES * i + s]
        y = y * z + equation[LANES * (4 + i) + s]
        one = one * z + equation[LANES * (8 + i) + s]
    return x, y, one * z + equation[12 * LANES + s]


@kernel
def _longer(a0, a1, a2, b0, b1, b2):
    """The longer one of two vectors; of one with NaN and another, the other."""
    longer = a0 * a0 + a1 * a1 + a2 * a2 > b0 * b0 + b1 * b1 + b2 * b2
    return a0 if longer else b0, a1 if longer else b1, a2 if longer else b2


@kernel
def poses_in_front(essentials, matches, poses, sides):
    """The pose [R | t], row by row, of each essential matrix that may have all matches in front of both cameras.

    `sides` receives 1 if it has them, -1 if it has them after t is turned around, and 0 if it has not.

    In closed form, after Horn, "Recovering baseline and orientation from essential matrix", 1990: with E = s [t]x R
    and b = R^T t, the cofactors of E are s^2 t b^T, and R = t b^T - [t]x E / s. The other rotation that goes with E
    has a plus there. Which one is told by x2^T ([t]x E / s) x1 = -(t x x2) . (t x R x1), since t x x2 and t x R x1
    point the same way if depths are positive. From d2 x2 = d1 R x1 + t follow d1 = -(t x x2) . n / |n|^2 and
    d2 = -(t x R x1) . n / |n|^2 with n = R x1 x x2; their numerators are written in terms of p = t . R x1 = b . x1,
    q = t . x2 and r = R x1 . x2.
    """
    for s in range(LANES):
        e00, e10, e20 = essentials[s], essentials[LANES + s], essentials[2 * LANES + s]
        e01, e11, e21 = essentials[3 * LANES + s], essentials[4 * LANES + s], essentials[5 * LANES + s]
        e02, e12, e22 = essentials[6 * LANES + s], essentials[7 * LANES + s], essentials[8 * LANES + s]
        norm = e00 * e00 + e01 * e01 + e02 * e02 + e10 * e10 + e11 * e11 + e12 * e12
        norm += e20 * e20 + e21 * e21 + e22 * e22
        c00, c01, c02 = e11 * e22 - e12 * e21, e12 * e20 - e10 * e22, e10 * e21 - e11 * e20
        c10, c11, c12 = e21 * e02 - e22 * e01, e22 * e00 - e20 * e02, e20 * e01 - e21 * e00
        c20, c21, c22 = e01 * e12 - e02 * e11, e02 * e10 - e00 * e12, e00 * e11 - e01 * e10
        t0, t1, t2 = _longer(c00, c10, c20, c01, c11, c21)
        t0, t1, t2 = _longer(c02, c12, c22, t0, t1, t2)
        scale = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        t0, t1, t2 = scale * t0, scale * t1, scale * t2
        scale = np.sqrt(2.0 / norm)
        d00, d01, d02 = scale * (t1 * e20 - t2 * e10), scale * (t1 * e21 - t2 * e11), scale * (t1 * e22 - t2 * e12)
        d10, d11, d12 = scale * (t2 * e00 - t0 * e20), scale * (t2 * e01 - t0 * e21), scale * (t2 * e02 - t0 * e22)
        d20, d21, d22 = scale * (t0 * e10 - t1 * e00), scale * (t0 * e11 - t1 * e01), scale * (t0 * e12 - t1 * e02)
        scale *= scale
        b0 = scale * (t0 * c00 + t1 * c10 + t2 * c20)
        b1 = scale * (t0 * c01 + t1 * c11 + t2 * c21)
        b2 = scale * (t0 * c02 + t1 * c12 + t2 * c22)
        sign, side, largest = 0.0, 0.0, -np.inf
        for i in range(5):
            j = LANES * 4 * i + s
            x, y, u, v = matches[j], matches[LANES + j], matches[2 * LANES + j], matches[3 * LANES + j]
            p, q = b0 * x + b1 * y + b2, t0 * u + t1 * v + t2
            turn = u * (d00 * x + d01 * y + d02) + v * (d10 * x + d11 * y + d12) + (d20 * x + d21 * y + d22)
            if i == 0:
                sign = 1.0 if turn > 0.0 else -1.0
            turn *= sign
            r = p * q + turn
            first, second = p * (u * u + v * v + 1.0) - q * r, p * r - q * (x * x + y * y + 1.0)
            if i == 0:
                side = -1.0 if first > 0.0 else 1.0
            largest = _larger(_larger(largest, -turn), _larger(side * first, side * second))
        sides[s] = side if largest < 0.0 else 0.0
        poses[s], poses[LANES + s] = t0 * b0 + sign * d00, t0 * b1 + sign * d01
        poses[2 * LANES + s], poses[3 * LANES + s] = t0 * b2 + sign * d02, t0
        poses[4 * LANES + s], poses[5 * LANES + s] = t1 * b0 + sign * d10, t1 * b1 + sign * d11
        poses[6 * LANES + s], poses[7 * LANES + s] = t1 * b2 + sign * d12, t1
        poses[8 * LANES + s], poses[9 * LANES + s] = t2 * b0 + sign * d20, t2 * b1 + sign * d21
        poses[10 * LANES + s], poses[11 * LANES + s] = t2 * b2 + sign * d22, t2


@kernel
def _larger(a, b):
    """The larger one; NaN if b is NaN."""
    return a if a > b else b


@kernel
def list_hits(sides, most, lanes, hits):
    """Lane and root of each pose in front, lane by lane; returns their number."""
    count = 0
    for s in range(lanes):
        for r in range(most):
            hits[count, 0], hits[count, 1] = s, r
            count += sides[r, s] != 0.0
    return count


@kernel
def gather_pose(poses, side, lane, model):
    """The pose of one lane, with t turned to the side where the points are."""
    for i in range(3):
        for j in range(3):
            model[i, j] = poses[LANES * (4 * i + j) + lane]
        model[i, 3] = side * poses[LANES * (4 * i + 3) + lane]


@kernel
def polish(sample, system, model):
    """Gauss-Newton steps on a pose until it fulfils the five epipolar equations.

    Returns False if it does not get there, or if not all points are in front of both cameras then.

    The pose moves on its manifold: R by a rotation vector from the left, t in its tangent plane. `system` (5, 6) is
    overwritten.
    """
    orthonormalise(model)
    before = np.inf
    for step in range(5):
        t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
        b0, b1, b2, c0, c1, c2 = tangents(t0, t1, t2)
        largest, nearest = 0.0, np.inf
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
            # The depths in the two cameras, times |n|^2.
            nearest = min(nearest, m0 * n0 + m1 * n1 + m2 * n2)
            nearest = min(nearest, (t2 * a1 - t1 * a2) * n0 + (t0 * a2 - t2 * a0) * n1 + (t1 * a0 - t0 * a1) * n2)
        if largest < 1e-13:
            return nearest > 0.0
        if step == 4 or not largest < before or not solve_in_place(system):
            return largest < 1e-11 and nearest > 0.0
        before = largest
        rotate(model, system[0, 5], system[1, 5], system[2, 5])
        d, e = system[3, 5], system[4, 5]
        t0, t1, t2 = t0 + d * b0 + e * c0, t1 + d * b1 + e * c1, t2 + d * b2 + e * c2
        scale = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        model[0, 3], model[1, 3], model[2, 3] = scale * t0, scale * t1, scale * t2
    return False
