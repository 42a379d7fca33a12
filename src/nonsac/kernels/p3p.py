"""Absolute pose of a calibrated camera from three points."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel


@kernel
def p3p_poses(samples, models):
    """All camera poses that three 2D-3D matches allow, for each of B samples.

    Solves d_i y_i = R X_i + t with unit rays y_i and positive depths d_i. The differences of the three equations
    |d_i y_i - d_j y_j|^2 = |X_i - X_j|^2 (Grunert 1841) are two conics in d_1 / d_3 and d_2 / d_3. A real root of a
    cubic gives a degenerate conic of their pencil, a pair of lines, and each line meets a conic in at most two points
    (Persson and Nordberg, "Lambda twist", ECCV 2018; Ding et al., "Revisiting the P3P problem", CVPR 2023). One cubic
    and two square roots are faster and more stable than the quartic that Grunert's elimination leads to, which "P3P
    made easy" (Lee, Vandewalle and Civera 2025) solves. Newton steps on the three distances restore lost digits.

    Preconditions: the three points are not on a line, and their rays differ.

    Parameters
    ----------
    samples : (B, 3, 5) float64
        Rows u v X Y Z: normalised image coordinates and the point in the world.
    models : (4 B, 3, 4) float64
        Receives [R | t] with camera = R world + t.

    Returns
    -------
    int
        How many of `models` were filled: for each sample 0 to 4, all with the points in front of the camera.
    """
    depths, rays, sides = np.empty((4, 3)), np.empty((3, 3)), np.empty((2, 3))
    count = 0
    for b in range(samples.shape[0]):
        sample = samples[b]
        for i in range(3):
            u, v = sample[i, 0], sample[i, 1]
            norm = 1.0 / np.sqrt(u * u + v * v + 1.0)
            rays[i, 0], rays[i, 1], rays[i, 2] = norm * u, norm * v, norm
        for s in range(find_depths(sample, rays, depths)):
            if align(sample, rays, depths[s], sides, models[count]):
                count += 1
    return count


@kernel
def find_depths(sample, rays, depths):
    """Depths d (4, 3) along the unit rays (3, 3) at which the points have their true distances; returns how many."""
    first, second, third = sample[0], sample[1], sample[2]
    a12, a13, a23 = _squared_side(first, second), _squared_side(first, third), _squared_side(second, third)
    if not (a12 > 0.0 and a13 > 0.0 and a23 > 0.0):
        return 0
    unit = 1.0 / a23
    a, b = a12 * unit, a13 * unit
    m12 = rays[0, 0] * rays[1, 0] + rays[0, 1] * rays[1, 1] + rays[0, 2] * rays[1, 2]
    m13 = rays[0, 0] * rays[2, 0] + rays[0, 1] * rays[2, 1] + rays[0, 2] * rays[2, 2]
    m23 = rays[1, 0] * rays[2, 0] + rays[1, 1] * rays[2, 1] + rays[1, 2] * rays[2, 2]
    # Symmetric conics in (x, y, 1) = (d1, d2, d3) / d3, as xx xy yy x y 1 with the halves of the mixed terms:
    # x^2 - 2 m12 x y + (1 - a) y^2 + 2 a m23 y - a = 0 and x^2 - b y^2 - 2 m13 x + 2 b m23 y + 1 - b = 0.
    p0, p1, p2, p3, p4, p5 = 1.0, -m12, 1.0 - a, 0.0, a * m23, -a
    q0, q1, q2, q3, q4, q5 = 1.0, 0.0, -b, -m13, b * m23, 1.0 - b
    # det(s P + t Q) = c0 s^3 + c1 s^2 t + c2 s t^2 + c3 t^3, through the cofactors of both.
    f0, f1, f2, f3, f4, f5 = _cofactors(p0, p1, p2, p3, p4, p5)
    g0, g1, g2, g3, g4, g5 = _cofactors(q0, q1, q2, q3, q4, q5)
    c0 = p0 * f0 + p1 * f1 + p3 * f3
    c1 = q0 * f0 + 2.0 * q1 * f1 + q2 * f2 + 2.0 * q3 * f3 + 2.0 * q4 * f4 + q5 * f5
    c2 = p0 * g0 + 2.0 * p1 * g1 + p2 * g2 + 2.0 * p3 * g3 + 2.0 * p4 * g4 + p5 * g5
    c3 = q0 * g0 + q1 * g1 + q3 * g3
    # Symmetric views make P or Q itself degenerate: the larger coefficient leads, so that this is a root 0.
    of_p = abs(c0) > abs(c3)
    if of_p:
        r0, r1, r2, roots = cubic_roots(c0, c1, c2, c3)
    else:
        r0, r1, r2, roots = cubic_roots(c3, c2, c1, c0)
    best, s, t = 0.0, 0.0, 1.0  # without roots, P and Q are both degenerate
    for k in range(max(1, roots)):
        root = (r0 if k == 0 else (r1 if k == 1 else r2)) if roots > 0 else 0.0
        u, v = (root, 1.0) if of_p else (1.0, root)
        if roots == 0:
            u, v = 0.0, 1.0
        norm = 1.0 / (u * u + v * v)
        spread = norm * _line_spread(
            u * p0 + v * q0, u * p1 + v * q1, u * p2 + v * q2, u * p3 + v * q3, u * p4 + v * q4, u * p5 + v * q5
        )
        if spread > best:
            best, s, t = spread, u, v
    if best == 0.0:
        return 0
    d0, d1, d2 = s * p0 + t * q0, s * p1 + t * q1, s * p2 + t * q2
    d3, d4, d5 = s * p3 + t * q3, s * p4 + t * q4, s * p5 + t * q5
    h0, h1, h2, h3, h4, h5 = _cofactors(d0, d1, d2, d3, d4, d5)
    # The lines meet in a column of the cofactors.
    if h0 <= h2 and h0 <= h5:
        size, x, y, z = h0, h0, h1, h3
    elif h2 <= h5:
        size, x, y, z = h2, h1, h2, h4
    else:
        size, x, y, z = h5, h3, h4, h5
    scale = 1.0 / np.sqrt(-size)
    x, y, z = scale * x, scale * y, scale * z
    # D + [x]x is the product of the two lines.
    n00, n01, n02 = d0, d1 - z, d3 + y
    n10, n11, n12 = d1 + z, d2, d4 - x
    n20, n21, n22 = d3 - y, d4 + x, d5
    r = n00 * n00 + n01 * n01 + n02 * n02
    line0, line1, line2 = n00, n01, n02
    if n10 * n10 + n11 * n11 + n12 * n12 > r:
        r = n10 * n10 + n11 * n11 + n12 * n12
        line0, line1, line2 = n10, n11, n12
    if n20 * n20 + n21 * n21 + n22 * n22 > r:
        line0, line1, line2 = n20, n21, n22
    r = n00 * n00 + n10 * n10 + n20 * n20
    other0, other1, other2 = n00, n10, n20
    if n01 * n01 + n11 * n11 + n21 * n21 > r:
        r = n01 * n01 + n11 * n11 + n21 * n21
        other0, other1, other2 = n01, n11, n21
    if n02 * n02 + n12 * n12 + n22 * n22 > r:
        other0, other1, other2 = n02, n12, n22
    # On a line s P = -t Q, so the one with the larger factor is all but zero there, and tells nothing.
    conic = (p0, p1, p2, p3, p4, p5) if abs(t) > abs(s) else (q0, q1, q2, q3, q4, q5)
    triangle = (a, b, m12, m13, m23, unit)
    count = 0
    count += _meet((line0, line1, line2), conic, triangle, depths[count:])
    return count + _meet((other0, other1, other2), conic, triangle, depths[count:])


@kernel
def _line_spread(d0, d1, d2, d3, d4, d5):
    """How far apart the two lines of a degenerate conic are: 0 if they are not real."""
    return max(0.0, d1 * d1 - d0 * d2, d3 * d3 - d0 * d5, d4 * d4 - d2 * d5)


@kernel
def _squared_side(first, second):
    x, y, z = first[2] - second[2], first[3] - second[3], first[4] - second[4]
    return x * x + y * y + z * z


@kernel
def _cofactors(xx, xy, yy, x, y, one):
    """Cofactors of a symmetric 3 x 3 matrix, in the same order."""
    return (
        yy * one - y * y,
        x * y - xy * one,
        xx * one - x * x,
        xy * y - yy * x,
        xy * x - xx * y,
        xx * yy - xy * xy,
    )


@kernel
def cubic_roots(a, b, c, d):
    """Real roots of a x^3 + b x^2 + c x + d: three numbers, and how many of them are roots (1 or 3, 0 without a)."""
    if a == 0.0 or not np.isfinite(b / a + c / a + d / a):
        return 0.0, 0.0, 0.0, 0
    b, c, d = b / a, c / a, d / a
    third = b / 3.0
    p = third * third - c / 3.0
    q = third * third * third - 0.5 * third * c + 0.5 * d
    discriminant = q * q - p * p * p
    if discriminant > 0.0:
        u = np.cbrt(abs(q) + np.sqrt(discriminant))
        x = (-(u + p / u) if q > 0.0 else u + p / u) - third
        return _polished(x, b, c, d), 0.0, 0.0, 1
    if not p > 0.0:
        return -third, 0.0, 0.0, 1
    root = np.sqrt(p)
    angle = np.arccos(min(1.0, max(-1.0, q / (p * root)))) / 3.0
    cosine, sine = np.cos(angle), np.sqrt(3.0) * np.sin(angle)
    first = _polished(-2.0 * root * cosine - third, b, c, d)
    second = _polished(root * (cosine - sine) - third, b, c, d)
    return first, second, _polished(root * (cosine + sine) - third, b, c, d), 3


@kernel
def _polished(x, b, c, d):
    for _ in range(2):
        slope = (3.0 * x + 2.0 * b) * x + c
        if slope != 0.0:
            x -= (((x + b) * x + c) * x + d) / slope
    return x


@kernel
def _meet(line, conic, triangle, depths):
    """Write the depths at the points where a line meets a conic; returns how many: at most two."""
    l0, l1, l2 = line
    xx, xy, yy, cx, cy, one = conic
    a, b, m12, m13, m23, unit = triangle
    # Eliminate the variable with the larger coefficient: x = p y + q, or y = p x + q.
    for_x = abs(l0) > abs(l1)
    pivot = l0 if for_x else l1
    if pivot == 0.0:
        return 0
    p, q = -(l1 if for_x else l0) / pivot, -l2 / pivot
    if for_x:
        e, f, g = (xx * p + 2.0 * xy) * p + yy, (xx * p + xy) * q + cx * p + cy, (xx * q + 2.0 * cx) * q + one
    else:
        e, f, g = (yy * p + 2.0 * xy) * p + xx, (yy * p + xy) * q + cy * p + cx, (yy * q + 2.0 * cy) * q + one
    square = f * f - e * g
    if square < 0.0:
        if square < -1e-12 * f * f:
            return 0
        square = 0.0
    large = -(f + np.sqrt(square)) if f > 0.0 else -f + np.sqrt(square)
    count = 0
    for k in range(2):
        top, bottom = (large, e) if k == 0 else (g, large)
        if bottom == 0.0 or (k == 1 and square == 0.0):
            continue
        free = top / bottom
        x, y = (p * free + q, free) if for_x else (free, p * free + q)
        square_y = y * y + 1.0 - 2.0 * y * m23
        if not (x > 0.0 and y > 0.0 and square_y > 0.0):
            continue
        d3 = 1.0 / np.sqrt(square_y)
        d1, d2, d3, good = _sharpen(x * d3, y * d3, d3, a, b, m12, m13, m23)
        if good:
            scale = 1.0 / np.sqrt(unit)
            depths[count, 0], depths[count, 1], depths[count, 2] = scale * d1, scale * d2, scale * d3
            count += 1
    return count


@kernel
def _sharpen(d1, d2, d3, a, b, m12, m13, m23):
    """Newton steps on the three squared distances a, b and 1; the flag tells whether they were met."""
    error = np.inf
    for _ in range(5):
        r1 = d1 * d1 + d2 * d2 - 2.0 * d1 * d2 * m12 - a
        r2 = d1 * d1 + d3 * d3 - 2.0 * d1 * d3 * m13 - b
        r3 = d2 * d2 + d3 * d3 - 2.0 * d2 * d3 * m23 - 1.0
        before, error = error, abs(r1) + abs(r2) + abs(r3)
        if error < 1e-15 * (1.0 + a + b) or not error < before:
            break
        j11, j12 = d1 - d2 * m12, d2 - d1 * m12
        j21, j23 = d1 - d3 * m13, d3 - d1 * m13
        j32, j33 = d2 - d3 * m23, d3 - d2 * m23
        determinant = -j11 * j23 * j32 - j12 * j21 * j33
        if determinant == 0.0:
            break
        half = 0.5 / determinant
        step1 = half * (-j23 * j32 * r1 - j12 * j33 * r2 + j12 * j23 * r3)
        step2 = half * (-j21 * j33 * r1 + j11 * j33 * r2 - j11 * j23 * r3)
        step3 = half * (j21 * j32 * r1 - j11 * j32 * r2 - j12 * j21 * r3)
        d1, d2, d3 = d1 - step1, d2 - step2, d3 - step3
    return d1, d2, d3, d1 > 0.0 and d2 > 0.0 and d3 > 0.0 and error < 1e-9 * (1.0 + a + b)


@kernel
def align(sample, rays, depths, sides, model):
    """The pose that moves the three points onto their rays at these depths, from the two triangles; False if flat."""
    o0, o1, o2 = depths[0] * rays[0, 0], depths[0] * rays[0, 1], depths[0] * rays[0, 2]
    u0, u1, u2 = depths[1] * rays[1, 0] - o0, depths[1] * rays[1, 1] - o1, depths[1] * rays[1, 2] - o2
    v0, v1, v2 = depths[2] * rays[2, 0] - o0, depths[2] * rays[2, 1] - o1, depths[2] * rays[2, 2] - o2
    for i in range(2):
        for c in range(3):
            sides[i, c] = sample[i + 1, 2 + c] - sample[0, 2 + c]
    good = _frame(u0, u1, u2, v0, v1, v2, model)
    if not good:
        return False
    c00, c01, c02, c10, c11, c12 = model[0, 0], model[0, 1], model[0, 2], model[1, 0], model[1, 1], model[1, 2]
    c20, c21, c22 = model[2, 0], model[2, 1], model[2, 2]
    good = _frame(sides[0, 0], sides[0, 1], sides[0, 2], sides[1, 0], sides[1, 1], sides[1, 2], model)
    if not good:
        return False
    for c in range(3):
        w0, w1, w2 = model[0, c], model[1, c], model[2, c]
        model[0, c] = c00 * w0 + c10 * w1 + c20 * w2
        model[1, c] = c01 * w0 + c11 * w1 + c21 * w2
        model[2, c] = c02 * w0 + c12 * w1 + c22 * w2
    x, y, z = sample[0, 2], sample[0, 3], sample[0, 4]
    model[0, 3] = o0 - (model[0, 0] * x + model[0, 1] * y + model[0, 2] * z)
    model[1, 3] = o1 - (model[1, 0] * x + model[1, 1] * y + model[1, 2] * z)
    model[2, 3] = o2 - (model[2, 0] * x + model[2, 1] * y + model[2, 2] * z)
    return True


@kernel
def _frame(u0, u1, u2, v0, v1, v2, axes):
    """Rows of an orthonormal frame: along u, in the plane of u and v, and across it."""
    w0, w1, w2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    uu, vv, ww = u0 * u0 + u1 * u1 + u2 * u2, v0 * v0 + v1 * v1 + v2 * v2, w0 * w0 + w1 * w1 + w2 * w2
    if not ww > 1e-16 * uu * vv:
        return False
    scale = 1.0 / np.sqrt(uu)
    axes[0, 0], axes[0, 1], axes[0, 2] = scale * u0, scale * u1, scale * u2
    scale = 1.0 / np.sqrt(ww)
    axes[2, 0], axes[2, 1], axes[2, 2] = scale * w0, scale * w1, scale * w2
    axes[1, 0] = axes[2, 1] * axes[0, 2] - axes[2, 2] * axes[0, 1]
    axes[1, 1] = axes[2, 2] * axes[0, 0] - axes[2, 0] * axes[0, 2]
    axes[1, 2] = axes[2, 0] * axes[0, 1] - axes[2, 1] * axes[0, 0]
    return True
