"""Slow, obvious implementations: the fast ones are held against them. Written from the papers, not from the code."""

import math
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

import nonsac

# --- geometry -----------------------------------------------------------------------------------------------------


def moved(model, points):
    """Points under [A | t], (3, 4) or (4, 4)."""
    return points @ model[:3, :3].T + model[:3, 3]


def gradient(function, point, step):
    """Central differences of a function at a point (p,)."""
    units = step * np.eye(len(point))
    return np.array([(function(point + unit) - function(point - unit)) / (2 * step) for unit in units])


def random_model(rng, scale=1.0, spread=1.0):
    """A random similarity [s R | t]."""
    return np.column_stack([scale * Rotation.random(random_state=rng).as_matrix(), spread * rng.standard_normal(3)])


def matching_rows(rng, n, model, noise=0.0):
    """Rows (a, b) of six numbers with b = model(a), disturbed."""
    a = rng.standard_normal((n, 3))
    return np.hstack([a, moved(model, a) + noise * rng.standard_normal((n, 3))])


def angle_between(A, B):
    """Degrees between the rotation parts of two models, the scale ignored."""
    A, B = (M[:3, :3] / np.cbrt(np.linalg.det(M[:3, :3])) for M in (np.asarray(A), np.asarray(B)))
    return np.degrees(Rotation.from_matrix(A @ B.T).magnitude())


def residuals(model, rows):
    """|A a + t - b| of each row."""
    return np.array([np.linalg.norm(model[:, :3] @ row[:3] + model[:, 3] - row[3:6]) for row in rows])


def kabsch(rows, weights, scale=1.0):
    """Weighted least-squares similarity by SVD (Arun 1987, Umeyama 1991); scale None estimates it."""
    w = weights / weights.sum()
    mean_a, mean_b = w @ rows[:, :3], w @ rows[:, 3:]
    a, b = rows[:, :3] - mean_a, rows[:, 3:] - mean_b
    u, singular, vt = np.linalg.svd((w[:, None] * b).T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    R = u @ sign @ vt
    if scale is None:
        scale = np.trace(np.diag(singular) @ sign) / (w @ (a**2).sum(axis=1))
    return np.column_stack([scale * R, mean_b - scale * R @ mean_a])


# --- cameras ------------------------------------------------------------------------------------------------------


def random_pose(rng, degrees=40.0):
    """A camera pose [R | t] with |t| = 1, turned about a random axis by up to so many degrees."""
    axis, t = rng.standard_normal((2, 3))
    R = Rotation.from_rotvec(np.radians(rng.uniform(0.1, 1) * degrees) * axis / np.linalg.norm(axis)).as_matrix()
    return np.column_stack([R, t / np.linalg.norm(t)])


def nudged(rng, model, degrees, direction=False):
    """A pose turned by so many degrees, and moved by as many radians; with `direction`, |t| = 1 again."""
    axis, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    t = model[:, 3] + np.radians(degrees) * shift
    R = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix() @ model[:, :3]
    return np.column_stack([R, t / np.linalg.norm(t) if direction else t])


def projected(points):
    return points[:, :2] / points[:, 2:]


def lifted(image, depths):
    """Points (n, 3) seen at image points (n, 2) in these depths."""
    return np.column_stack([image, np.ones(len(image))]) * np.asarray(depths).reshape(-1, 1)


def scene(rng, n, model, near=2.0, far=8.0):
    """Points (n, 3) in the frame of the first camera, that both cameras have well in front of them."""
    points = np.empty((0, 3))
    while len(points) < n:
        more = lifted(rng.uniform(-1, 1, (200, 2)), rng.uniform(near, far, 200))
        x, y, z = moved(model, more).T
        points = np.vstack([points, more[(z > 0.5) & (np.hypot(x, y) < 2 * z)]])
    return points[:n]


def two_view_rows(rng, n, model, noise=0.0):
    """Rows x1 y1 x2 y2 that a relative pose explains, disturbed."""
    points = scene(rng, n, model)
    rows = np.hstack([projected(points), projected(moved(model, points))])
    return rows + noise * rng.standard_normal((n, 4))


def one_view_rows(rng, n, model, noise=0.0, near=2.0, far=8.0):
    """Rows u v X Y Z that an absolute pose explains, with noise in the image."""
    image = rng.uniform(-1, 1, (n, 2))
    points = (lifted(image, rng.uniform(near, far, n)) - model[:, 3]) @ model[:, :3]
    return np.hstack([image + noise * rng.standard_normal((n, 2)), points])


def fundamental(model, focal1=1.0, focal2=1.0):
    """[t]x R for image coordinates in pixels."""
    tx, ty, tz = model[:, 3]
    essential = np.array([[0, -tz, ty], [tz, 0, -tx], [-ty, tx, 0]]) @ model[:, :3]
    return np.diag([1 / focal2, 1 / focal2, 1]) @ essential @ np.diag([1 / focal1, 1 / focal1, 1])


def signed_sampson(model, rows, focal1=1.0, focal2=1.0):
    """Epipolar error over the length of its gradient, in pixels (Hartley and Zisserman, eq. 11.9), with its sign."""
    F, result = fundamental(model, focal1, focal2), []
    for x, y, u, v in rows * [focal1, focal1, focal2, focal2]:
        first, second = np.array([x, y, 1]), np.array([u, v, 1])
        error, slope = second @ F @ first, np.r_[(F @ first)[:2], (F.T @ second)[:2]]
        result.append(error / np.linalg.norm(slope) if slope.any() else np.inf)
    return np.array(result)


def sampson(model, rows, focal1=1.0, focal2=1.0):
    return np.abs(signed_sampson(model, rows, focal1, focal2))


def ray_depths(model, row):
    """Depths d1, d2 at which the rays of a match come nearest to each other: d1 R x1 + t = d2 x2 by least squares."""
    first, second = model[:, :3] @ [row[0], row[1], 1], np.array([row[2], row[3], 1])
    return np.linalg.lstsq(np.column_stack([-first, second]), model[:, 3], rcond=None)[0]


def epipolar(model, rows, focal1=1.0, focal2=1.0):
    """Sampson's distance, or the angle between the rays, as a distance, where they meet behind a camera."""
    result = sampson(model, rows, focal1, focal2)
    for i, row in enumerate(rows):
        if (ray_depths(model, row) < 0).any():
            first, second = (v / np.linalg.norm(v) for v in (model[:, :3] @ [*row[:2], 1], [*row[2:], 1]))
            sine = np.linalg.norm(np.cross(first, second))
            result[i] = max(result[i], np.sqrt(focal1 * focal2) * sine) if first @ second > 0 else np.inf
    return result


def image_errors(model, rows, focal=1.0):
    """Where a camera sees points less where they were seen (n, 2), in pixels; infinite for points not in front."""
    result = []
    for row in rows:
        x, y, depth = model[:, :3] @ row[2:5] + model[:, 3]
        result.append([focal * (x / depth - row[0]), focal * (y / depth - row[1])] if depth > 0 else [np.inf, np.inf])
    return np.array(result)


def reprojection(model, rows, focal=1.0):
    return np.array([np.hypot(*error) for error in image_errors(model, rows, focal)])


def tukey(r, threshold):
    """Loss and weight of a residual (Beaton and Tukey 1974), scaled so that they are near r^2 and 1 for small ones."""
    if not abs(r) < threshold:
        return threshold**2 / 3, 0.0
    share = 1 - (r / threshold) ** 2
    return threshold**2 / 3 * (1 - share**3), share**2


def p3p(sample):
    """All poses of three rows u v X Y Z, by Grunert's quartic (Haralick et al., IJCV 1994, Sec. 3.1): (M, 3, 4)."""
    rays = lifted(sample[:, :2], 1 / np.linalg.norm(lifted(sample[:, :2], np.ones(3)), axis=1))
    points = sample[:, 2:]
    aa, bb, cc = (math.dist(points[i], points[j]) ** 2 for i, j in ((1, 2), (0, 2), (0, 1)))
    alpha, beta, gamma = rays[1] @ rays[2], rays[0] @ rays[2], rays[0] @ rays[1]  # cosines
    p, q = (aa - cc) / bb, (aa + cc) / bb
    quartic = [
        (p - 1) ** 2 - 4 * cc / bb * alpha**2,
        4 * (p * (1 - p) * beta - (1 - q) * alpha * gamma + 2 * cc / bb * alpha**2 * beta),
        2
        * (
            p**2
            - 1
            + 2 * p**2 * beta**2
            + 2 * (bb - cc) / bb * alpha**2
            - 4 * q * alpha * beta * gamma
            + 2 * (bb - aa) / bb * gamma**2
        ),
        4 * (-p * (1 + p) * beta + 2 * aa / bb * gamma**2 * beta - (1 - q) * alpha * gamma),
        (1 + p) ** 2 - 4 * aa / bb * gamma**2,
    ]
    poses = []
    for root in np.roots(quartic):
        v = root.real
        if abs(root.imag) > 1e-6 * abs(root) or v <= 0:
            continue
        u = ((p - 1) * v**2 - 2 * p * beta * v + 1 + p) / (2 * (gamma - v * alpha))
        if u > 0:
            first = np.sqrt(bb / (1 + v**2 - 2 * v * beta))
            poses.append(kabsch(np.hstack([points, rays * first * np.array([[1], [u], [v]])]), np.ones(3)))
    return np.array(poses).reshape(-1, 3, 4)


# --- consistency --------------------------------------------------------------------------------------------------


def distances(rows, i, j):
    return np.linalg.norm(rows[i, :3] - rows[j, :3]), np.linalg.norm(rows[i, 3:6] - rows[j, 3:6])


def distance_disagreement(rows):
    """| |a_i - a_j| - |b_i - b_j| | for all pairs of rows; infinite on the diagonal."""
    n = len(rows)
    result = np.full((n, n), np.inf)
    for i in range(n):
        for j in range(n):
            if i != j:
                result[i, j] = abs(math.dist(rows[i, :3], rows[j, :3]) - math.dist(rows[i, 3:6], rows[j, 3:6]))
    return result


def log_ratio_counts(rows, scale, tolerance):
    """With how many others each row agrees on ln(|b_i - b_j| / |a_i - a_j|) being near ln(scale)."""
    n = len(rows)
    counts = np.zeros(n, int)
    for i in range(n):
        for j in range(n):
            da, db = distances(rows, i, j)
            if i != j and da > 0 and db > 0:
                counts[i] += abs(np.log(db / da) - np.log(scale)) < tolerance
    return counts


def triplet_values(rows, triplet, by_ratio, scale):
    values = []
    for i, j in combinations(triplet, 2):
        da, db = distances(rows, i, j)
        if not (da > 0 and db > 0):
            return None
        values.append(np.log(db / da) if by_ratio else db - scale * da)
    return np.array(values)


def triplet_is_consistent(rows, triplet, by_ratio, scale, tolerance):
    """All three differences near what the scale predicts, or, with scale None, near each other."""
    values = triplet_values(rows, triplet, by_ratio, 1.0 if scale is None else scale)
    if values is None:
        return False
    if scale is None:
        return bool(np.ptp(values) < tolerance)
    return bool((np.abs(values - (np.log(scale) if by_ratio else 0.0)) < tolerance).all())


def triplets_by_rank_sum(n):
    """All triplets i < j < k of range(n), the smallest sum first, ties in lexicographic order."""
    return sorted(combinations(range(n), 3), key=lambda triplet: (sum(triplet), triplet))


def oriented_pair_invariants(rows, i, j):
    """Chord length, both points' distances to the other's tangent plane, cosine of the normals: in each cloud."""
    result = []
    for point, normal in ((slice(0, 3), slice(3, 6)), (slice(6, 9), slice(9, 12))):
        chord = rows[j, point] - rows[i, point]
        result.append(
            (
                np.linalg.norm(chord),
                abs(rows[i, normal] @ chord),
                abs(rows[j, normal] @ chord),
                abs(rows[i, normal] @ rows[j, normal]),
            )
        )
    return np.array(result)


def oriented_pair_is_consistent(rows, i, j, tolerance, angle, smallest):
    (length, *_), _ = invariants = oriented_pair_invariants(rows, i, j)
    limits = np.array([tolerance, angle * length, angle * length, 1.5 * angle])
    return bool(length > smallest and (np.abs(invariants[0] - invariants[1]) < limits).all())


# --- nearest points -----------------------------------------------------------------------------------------------


def cell_centres(shape, corner, cells_per_unit):
    return corner + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1) + 0.5) / cells_per_unit


def nearest_to_cells(points, shape, corner, cells_per_unit):
    """Distance of every cell's centre to the nearest point, and that point's number."""
    centres = cell_centres(shape, corner, cells_per_unit).reshape(-1, 3)
    table = np.linalg.norm(centres[:, None] - points[None], axis=2)
    return table.min(axis=1).reshape(shape), table.argmin(axis=1).reshape(shape)


# --- scoring rules, straight from the formulas of Sec. 3.2: each returns the winner --------------


def inlier_counts(hypotheses):
    return [sum(1 for r in h.residuals if r < h.threshold) for h in hypotheses]


def _most(candidates, counts):
    best = max(counts[i] for i in candidates)
    return min(i for i in candidates if counts[i] == best)


def most_inliers(hypotheses, distance):
    counts = inlier_counts(hypotheses)
    return _most(range(len(counts)), counts)


def closest_pair(hypotheses, distance):
    pairs = combinations(range(len(hypotheses)), 2)
    pair = min(pairs, key=lambda p: distance(hypotheses[p[0]].model, hypotheses[p[1]].model))
    return _most(pair, inlier_counts(hypotheses))


def closest_triplet(hypotheses, distance):
    def largest(triplet):
        return max(distance(hypotheses[i].model, hypotheses[j].model) for i, j in combinations(triplet, 2))

    return _most(min(combinations(range(len(hypotheses)), 3), key=largest), inlier_counts(hypotheses))


def minimum(statistic):
    def rule(hypotheses, distance):
        values = [statistic([r for r in h.residuals if r < h.threshold]) for h in hypotheses]
        return values.index(min(values))

    return rule


def pair_cost(k):
    def rule(hypotheses, distance):
        counts = inlier_counts(hypotheses)

        def cost(pair):
            i, j = pair
            return max(counts[i], counts[j]) / distance(hypotheses[i].model, hypotheses[j].model) ** k

        return _most(max(combinations(range(len(hypotheses)), 2), key=cost), counts)

    return rule


def truncated_lp(p):
    def rule(hypotheses, distance):
        costs = [sum(min(abs(r) ** p, h.threshold**p) for r in h.residuals) for h in hypotheses]
        return costs.index(min(costs))

    return rule


def scoring_rules():
    """Name in files -> oracle that returns the winner's number."""
    return {
        "most_inliers": most_inliers,
        "closest_pair": closest_pair,
        "closest_triplet": closest_triplet,
        "minimum_mean": minimum(np.mean),
        "minimum_median": minimum(np.median),
        "minimum_q3": minimum(lambda r: np.percentile(r, 75)),
        **{f"pair_{k}": pair_cost(float(k)) for k in ("0.02", "0.05", "0.1", "0.2", "0.5", "1")},
        **{f"tlp_{p}": truncated_lp(float(p)) for p in ("0.01", "0.1", "0.2", "0.3", "0.5", "1", "2")},
    }


# --- the simplest problem: y = x + shift, one row determines it ------------------------------------------------------


def shift_model(shift):
    return np.column_stack([np.eye(3), [shift, 0.0, 0.0]])


class Shift(nonsac.Problem):
    """Rows (x, y) with y = x + shift, in the form [I | (shift, 0, 0)]; models differ by |shift_a - shift_b|."""

    layout = nonsac.Layout("x | y")
    minimal_size = 1

    def solve_minimal(self, samples):
        return np.array([shift_model(y - x) for x, y in samples[:, 0]]).reshape(-1, 3, 4)

    def residuals(self, models, rows):
        return np.abs(rows[:, 0] + models[:, 0, 3, None] - rows[:, 1])

    def refit(self, model, rows, weights):
        return shift_model(np.average(rows[:, 1] - rows[:, 0], weights=weights))

    def determined(self, model, inliers, noise):
        return True

    def distance(self, a, b):
        return np.abs(np.asarray(a)[..., 0, 3] - np.asarray(b)[..., 0, 3])

    def average(self, models, rows):
        return shift_model(np.median(models[:, 0, 3]))

    def transform(self, model):
        return np.vstack([model, [0.0, 0.0, 0.0, 1.0]])


def median_shift(values, threshold, seed):
    """The function of somebody who knows nothing of problems and estimators."""
    return shift_model(np.median(values[:, 1] - values[:, 0]))


# --- rows that match nothing, and models that are no motions: only what a problem has to have -------------------------


def line_model(degrees, offset):
    """The line x cos + y sin = offset, with an angle below 180 degrees so that each line has one model."""
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), offset])


class Line(nonsac.Problem):
    """Points (x, y) with a x + b y = c, in the form (a, b, c) with a^2 + b^2 = 1."""

    layout = nonsac.Layout("x y")
    minimal_size = 2
    model_shape = (3,)

    def solve_minimal(self, samples):
        lines = [self.refit(None, sample, np.ones(2)) for sample in samples if (sample[0] != sample[1]).any()]
        return np.array(lines).reshape(-1, 3)

    def residuals(self, models, rows):
        return np.abs(models[:, :1] * rows[:, 0] + models[:, 1:2] * rows[:, 1] - models[:, 2:])

    def refit(self, model, rows, weights):
        mean = np.average(rows, axis=0, weights=weights)
        across = np.linalg.eigh((weights[:, None] * (rows - mean)).T @ (rows - mean))[1][:, 0]
        across *= 1.0 if across[1] > 0 else -1.0
        return np.append(across, across @ mean)


def fullest_windows(ratios, tolerance, reach=4.0):
    """The middles of the windows of two bins that hold the most log ratios; bins are `tolerance` wide, from -reach."""
    bins = int(2 * reach / tolerance) + 1
    counts = [sum(int((r + reach) / tolerance) in (k - 1, k) for r in ratios if abs(r) < reach) for k in range(1, bins)]
    return [k * tolerance - reach for k, count in enumerate(counts, 1) if count == max(counts)]
