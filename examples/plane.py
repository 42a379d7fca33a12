"""A problem of your own: a plane in space, such as the ground under a LiDAR."""

import numpy as np

import nonsac


class Plane(nonsac.Problem):
    """n . X = d with a unit normal n, for points (x, y, z). A model is (nx, ny, nz, d)."""

    layout, minimal_size, model_shape = nonsac.Layout("x y z"), 3, (4,)

    def solve_minimal(self, samples):
        first, second, third = samples.transpose(1, 0, 2)
        normals = np.cross(second - first, third - first)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        planes = np.column_stack([normals, (normals * first).sum(axis=1)])
        return planes[lengths[:, 0] > 0] / lengths[lengths[:, 0] > 0]

    def residuals(self, models, rows):
        return np.abs(models[:, :3] @ rows.T - models[:, 3:])

    def refit(self, model, rows, weights):
        mean = np.average(rows, axis=0, weights=weights)
        normal = np.linalg.svd((rows - mean) * np.sqrt(weights)[:, None], full_matrices=False)[2][-1]
        return np.append(normal, normal @ mean)

    def determined(self, model, inliers, noise):
        """Points on a line leave the plane free to turn about it."""
        return bool(np.linalg.svd(inliers - inliers.mean(axis=0), compute_uv=False)[1] > 10.0 * noise.sigma)


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    for name, normal in (("ground", np.array([0.0, 0.0, 1.0])), ("ramp", np.array([0.1, 0.0, 0.995]))):
        scan = rng.uniform([-30, -30, -3], [30, 30, 8], (200_000, 3))
        ground = 10_000
        heights = -1.7 - scan[:ground, :2] @ normal[:2] / normal[2]
        scan[:ground, 2] = heights + rng.normal(scale=0.02, size=ground)
        for noise in (0.02, None):
            result = nonsac.estimate(nonsac.ArraySource(scan), Plane(), noise=noise)
            cosine = abs(result.model[:3] @ normal) / np.linalg.norm(normal)
            error = np.degrees(np.arccos(min(1.0, cosine)))
            print(f"{name}, noise {noise}: {error:.2f} deg off, {result.status}, confidence {result.confidence:.3f}")
    print(result)
