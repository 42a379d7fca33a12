"""A grid that knows the nearest point of a cloud, so that thousands of poses a millisecond can be scored against it.

The grid covers the cloud's bounding box and a margin of `reach`. `nearest` (X, Y, Z) int32 holds the number of the
point nearest to each cell's centre, -1 if none is within `reach`; `cost` (X, Y, Z) uint8 that distance as a
share of `reach`, 0 to 255. A position x falls into the cell floor((x - corner) * cells_per_unit).
"""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


@kernel
def fill_nearest(points, corner, cells_per_unit, reach, nearest):
    """Write each point's number into all cells within `reach` that have no nearer one."""
    size = 1.0 / cells_per_unit
    span = int(np.ceil(reach * cells_per_unit)) + 1
    squared_reach = np.float32(reach * reach)
    squared = np.empty(nearest.shape, np.float32)
    squared[:] = squared_reach
    nearest[:] = -1
    cell = np.empty(3, np.int64)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for i in range(points.shape[0]):
        for c in range(3):
            cell[c] = int(np.floor((points[i, c] - corner[c]) * cells_per_unit))
            low[c] = max(0, cell[c] - span)
            high[c] = min(nearest.shape[c], cell[c] + span + 1)
        for u in range(low[0], high[0]):
            dx = corner[0] + (u + 0.5) * size - points[i, 0]
            for v in range(low[1], high[1]):
                dy = corner[1] + (v + 0.5) * size - points[i, 1]
                across = dx * dx + dy * dy
                if across >= squared_reach:
                    continue
                for w in range(low[2], high[2]):
                    dz = corner[2] + (w + 0.5) * size - points[i, 2]
                    distance = np.float32(across + dz * dz)
                    if distance < squared[u, v, w]:
                        squared[u, v, w] = distance
                        nearest[u, v, w] = i


@kernel
def fill_cost(points, corner, cells_per_unit, reach, nearest, cost):
    """Distance from each cell's centre to its nearest point as a share of `reach`, 0 to 255."""
    size = 1.0 / cells_per_unit
    for u in range(nearest.shape[0]):
        for v in range(nearest.shape[1]):
            for w in range(nearest.shape[2]):
                i = nearest[u, v, w]
                cost[u, v, w] = 255
                if i >= 0:
                    x = corner[0] + (u + 0.5) * size - points[i, 0]
                    y = corner[1] + (v + 0.5) * size - points[i, 1]
                    z = corner[2] + (w + 0.5) * size - points[i, 2]
                    cost[u, v, w] = np.uint8(min(255.0, 255.0 * np.sqrt(x * x + y * y + z * z) / reach))


@reordered_kernel
def score_models(models, points, corner, cells_per_unit, cost, scores):
    """Sum of the cell costs under the moved points: (3, n) float32 `points`, one int32 score for each model."""
    nx, ny, nz = np.int32(cost.shape[0]), np.int32(cost.shape[1]), np.int32(cost.shape[2])
    flat = cost.ravel()
    xs, ys, zs = points[0], points[1], points[2]
    # All cells first, as this loop vectorises; outside the grid that is cell 0, a corner of the empty margin.
    cells = np.empty(points.shape[1], np.int32)
    for m in range(models.shape[0]):
        model = models[m]
        r00 = np.float32(model[0, 0] * cells_per_unit)
        r01 = np.float32(model[0, 1] * cells_per_unit)
        r02 = np.float32(model[0, 2] * cells_per_unit)
        r10 = np.float32(model[1, 0] * cells_per_unit)
        r11 = np.float32(model[1, 1] * cells_per_unit)
        r12 = np.float32(model[1, 2] * cells_per_unit)
        r20 = np.float32(model[2, 0] * cells_per_unit)
        r21 = np.float32(model[2, 1] * cells_per_unit)
        r22 = np.float32(model[2, 2] * cells_per_unit)
        t0 = np.float32((model[0, 3] - corner[0]) * cells_per_unit)
        t1 = np.float32((model[1, 3] - corner[1]) * cells_per_unit)
        t2 = np.float32((model[2, 3] - corner[2]) * cells_per_unit)
        for i in range(cells.shape[0]):
            # Truncation equals floor if it matters: what is negative lies outside, or in the margin.
            u = np.int32(r00 * xs[i] + r01 * ys[i] + r02 * zs[i] + t0)
            v = np.int32(r10 * xs[i] + r11 * ys[i] + r12 * zs[i] + t1)
            w = np.int32(r20 * xs[i] + r21 * ys[i] + r22 * zs[i] + t2)
            inside = (u >= 0) & (v >= 0) & (w >= 0) & (u < nx) & (v < ny) & (w < nz)
            cells[i] = (u * ny + v) * nz + w if inside else np.int32(0)
        total = np.int32(0)
        for i in range(cells.shape[0]):
            total += np.int32(flat[cells[i]])
        scores[m] = total


@kernel
def _cell(x, y, z, corner, cells_per_unit, shape):
    """The cell of a position; the first number is -1 outside the grid."""
    u = int(np.floor((x - corner[0]) * cells_per_unit))
    v = int(np.floor((y - corner[1]) * cells_per_unit))
    w = int(np.floor((z - corner[2]) * cells_per_unit))
    if u < 0 or v < 0 or w < 0 or u >= shape[0] or v >= shape[1] or w >= shape[2]:
        return -1, -1, -1
    return u, v, w


@kernel
def nearest_distances(model, points, field_points, corner, cells_per_unit, reach, nearest, distances):
    """Distance of each moved point (n, 3) to the cloud's point of its cell, at most `reach`."""
    for i in range(points.shape[0]):
        distances[i] = reach
        x = model[0, 0] * points[i, 0] + model[0, 1] * points[i, 1] + model[0, 2] * points[i, 2] + model[0, 3]
        y = model[1, 0] * points[i, 0] + model[1, 1] * points[i, 1] + model[1, 2] * points[i, 2] + model[1, 3]
        z = model[2, 0] * points[i, 0] + model[2, 1] * points[i, 1] + model[2, 2] * points[i, 2] + model[2, 3]
        u, v, w = _cell(x, y, z, corner, cells_per_unit, nearest.shape)
        if u < 0 or nearest[u, v, w] < 0:
            continue
        q = field_points[nearest[u, v, w]]
        distances[i] = min(reach, np.sqrt((x - q[0]) ** 2 + (y - q[1]) ** 2 + (z - q[2]) ** 2))


@reordered_kernel
def _solve_spd(matrix, vector):
    """Solve a symmetric positive definite 6x6 system in place by Cholesky; False if it is not definite."""
    n = vector.shape[0]
    for j in range(n):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        if not matrix[j, j] > 0.0:
            return False
        matrix[j, j] = np.sqrt(matrix[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for i in range(n):
        for k in range(i):
            vector[i] -= matrix[i, k] * vector[k]
        vector[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            vector[i] -= matrix[k, i] * vector[k]
        vector[i] /= matrix[i, i]
    return True


@reordered_kernel
def _compose(step, centre, model):
    """Apply a small rotation vector step[:3] about `centre` and a translation step[3:] after `model`, in place."""
    angle = np.sqrt(_square(step[0]) + _square(step[1]) + _square(step[2]))
    rotation = np.eye(3)
    if angle > 1e-12:
        x, y, z = step[0] / angle, step[1] / angle, step[2] / angle
        s, c = np.sin(angle), np.cos(angle)
        d = 1.0 - c
        rotation[0, 0], rotation[0, 1], rotation[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
        rotation[1, 0], rotation[1, 1], rotation[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
        rotation[2, 0], rotation[2, 1], rotation[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d
    column = np.empty(3)
    for c4 in range(4):
        for r in range(3):
            column[r] = model[r, c4] - (centre[r] if c4 == 3 else 0.0)
        for r in range(3):
            value = rotation[r, 0] * column[0] + rotation[r, 1] * column[1] + rotation[r, 2] * column[2]
            model[r, c4] = value + (centre[r] + step[3 + r] if c4 == 3 else 0.0)


@kernel
def _square(x):
    """Not x ** 2: numba keeps one copy of that, with the flags of whichever kernel it compiled first."""
    return x * x


@reordered_kernel
def align_to_field(models, points, field_points, field_normals, corner, cells_per_unit, reach, nearest, iterations):
    """Move each model (M, 3, 4), in place, to a near minimum of the distances between the points and the cloud.

    Gauss-Newton steps on the distance to the tangent plane of the nearest point, with a tenth of the distance to the
    point itself against sliding, and Tukey's weights on the point distance, whose cut-off shrinks from `reach` to a
    third of it (Chen and Medioni 1992, with the nearest points read from the grid).
    """
    normal_matrix = np.empty((6, 6))
    gradient = np.empty(6)
    jacobian = np.empty(6)
    centre = np.empty(3)
    for m in range(models.shape[0]):
        model = models[m]
        for iteration in range(iterations):
            cut_off = reach * max(1.0 / 3.0, 1.0 - iteration / (0.75 * iterations))
            normal_matrix[:] = 0.0
            gradient[:] = 0.0
            for r in range(3):
                centre[r] = model[r, 3]
            total = moment_x = moment_y = moment_z = 0.0
            for i in range(points.shape[0]):
                x = model[0, 0] * points[i, 0] + model[0, 1] * points[i, 1] + model[0, 2] * points[i, 2]
                y = model[1, 0] * points[i, 0] + model[1, 1] * points[i, 1] + model[1, 2] * points[i, 2]
                z = model[2, 0] * points[i, 0] + model[2, 1] * points[i, 1] + model[2, 2] * points[i, 2]
                u, v, w = _cell(x + centre[0], y + centre[1], z + centre[2], corner, cells_per_unit, nearest.shape)
                if u < 0 or nearest[u, v, w] < 0:
                    continue
                q = field_points[nearest[u, v, w]]
                normal = field_normals[nearest[u, v, w]]
                dx, dy, dz = x + centre[0] - q[0], y + centre[1] - q[1], z + centre[2] - q[2]
                ratio = (dx * dx + dy * dy + dz * dz) / (cut_off * cut_off)
                if ratio >= 1.0:
                    continue
                weight = _square(1.0 - ratio)
                residual = normal[0] * dx + normal[1] * dy + normal[2] * dz
                jacobian[0] = y * normal[2] - z * normal[1]
                jacobian[1] = z * normal[0] - x * normal[2]
                jacobian[2] = x * normal[1] - y * normal[0]
                jacobian[3], jacobian[4], jacobian[5] = normal[0], normal[1], normal[2]
                for r in range(6):
                    for c in range(r + 1):
                        normal_matrix[r, c] += weight * jacobian[r] * jacobian[c]
                    gradient[r] -= weight * residual * jacobian[r]
                # A tenth of the distance to the point itself: its Jacobian is [-[p]x, I].
                weight *= 0.1
                total += weight
                gradient[0] -= weight * (y * dz - z * dy)
                gradient[1] -= weight * (z * dx - x * dz)
                gradient[2] -= weight * (x * dy - y * dx)
                gradient[3] -= weight * dx
                gradient[4] -= weight * dy
                gradient[5] -= weight * dz
                moment_x += weight * x
                moment_y += weight * y
                moment_z += weight * z
                normal_matrix[0, 0] += weight * (y * y + z * z)
                normal_matrix[1, 1] += weight * (x * x + z * z)
                normal_matrix[2, 2] += weight * (x * x + y * y)
                normal_matrix[1, 0] -= weight * x * y
                normal_matrix[2, 0] -= weight * x * z
                normal_matrix[2, 1] -= weight * y * z
            normal_matrix[3, 1] += moment_z
            normal_matrix[3, 2] -= moment_y
            normal_matrix[4, 0] -= moment_z
            normal_matrix[4, 2] += moment_x
            normal_matrix[5, 0] += moment_y
            normal_matrix[5, 1] -= moment_x
            for r in range(3):
                normal_matrix[3 + r, 3 + r] += total
            for r in range(6):
                normal_matrix[r, r] += 1e-6 * total
            if not _solve_spd(normal_matrix, gradient):
                break
            _compose(gradient, centre, model)
            largest = 0.0
            for r in range(6):
                largest = max(largest, abs(gradient[r]))
            if largest < 1e-5 and iteration > 0.75 * iterations:
                break


@kernel
def surface_distances(
    model, points, normals, field_points, field_normals, corner, cells_per_unit, reach, nearest, flat, cosine, distances
):
    """Distance of each moved point to the cloud's surface, infinite for points that do not lie *in* it: (n,).

    A point lies in the surface if its nearest point is within `reach`, that point's tangent plane within `flat`,
    and the two normals agree up to sign (absolute cosine above `cosine`).
    """
    for i in range(points.shape[0]):
        distances[i] = np.inf
        x = model[0, 0] * points[i, 0] + model[0, 1] * points[i, 1] + model[0, 2] * points[i, 2] + model[0, 3]
        y = model[1, 0] * points[i, 0] + model[1, 1] * points[i, 1] + model[1, 2] * points[i, 2] + model[1, 3]
        z = model[2, 0] * points[i, 0] + model[2, 1] * points[i, 1] + model[2, 2] * points[i, 2] + model[2, 3]
        u, v, w = _cell(x, y, z, corner, cells_per_unit, nearest.shape)
        if u < 0 or nearest[u, v, w] < 0:
            continue
        q = field_points[nearest[u, v, w]]
        n = field_normals[nearest[u, v, w]]
        dx, dy, dz = x - q[0], y - q[1], z - q[2]
        height = abs(n[0] * dx + n[1] * dy + n[2] * dz)
        if dx * dx + dy * dy + dz * dz > reach * reach or height > flat:
            continue
        agreement = 0.0
        for r in range(3):
            moved = model[r, 0] * normals[i, 0] + model[r, 1] * normals[i, 1] + model[r, 2] * normals[i, 2]
            agreement += moved * n[r]
        if abs(agreement) > cosine:
            distances[i] = height


@kernel
def keep_distinct(models, squared_chord, squared_distance, kept):
    """Numbers of the models (M, 3, 4) that differ from all kept before them; returns how many `kept` (M,) holds.

    Two models are the same answer if the squared Frobenius distance of their rotations is below `squared_chord`
    and that of their translations below `squared_distance`.
    """
    count = 0
    for i in range(models.shape[0]):
        new = True
        for k in range(count):
            other = models[kept[k]]
            turn = 0.0
            shift = 0.0
            for r in range(3):
                shift += (models[i, r, 3] - other[r, 3]) ** 2
                for c in range(3):
                    turn += (models[i, r, c] - other[r, c]) ** 2
            if turn < squared_chord and shift < squared_distance:
                new = False
                break
        if new:
            kept[count] = i
            count += 1
    return count
