"""A problem of your own: a line in the plane, in plain NumPy, through the same pipeline as everything else."""

import numpy as np

import nonsac


class Line(nonsac.Problem):
    """a x + b y = c with a unit normal (a, b), for points (x, y). A model is (a, b, c)."""

    layout, minimal_size, model_shape = nonsac.Layout("x y"), 2, (3,)

    def solve_minimal(self, samples):
        along = samples[:, 1] - samples[:, 0]
        normals = np.column_stack([-along[:, 1], along[:, 0]])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        lines = np.column_stack([normals, (normals * samples[:, 0]).sum(axis=1)])
        return lines[lengths[:, 0] > 0] / lengths[lengths[:, 0] > 0]

    def residuals(self, models, rows):
        return np.abs(models[:, :2] @ rows.T - models[:, 2:])

    def refit(self, model, rows, weights):
        mean = np.average(rows, axis=0, weights=weights)
        normal = np.linalg.svd((rows - mean) * np.sqrt(weights)[:, None], full_matrices=False)[2][-1]
        return np.append(normal, normal @ mean)

    def describe(self, model):
        return "{:.3f} x {:+.3f} y = {:.3f}".format(*(model * np.sign(model[np.abs(model[:2]).argmax()])))


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    for angle in (0, 30, 90):  # horizontal, slanted, vertical
        normal = np.array([-np.sin(np.radians(angle)), np.cos(np.radians(angle))])
        points = rng.uniform(-1, 1, (100_000, 2))
        points[:5000] += (0.2 - points[:5000] @ normal + rng.normal(scale=0.005, size=5000))[:, None] * normal
        for noise in (0.005, None):
            result = nonsac.estimate(nonsac.ArraySource(points), Line(), noise=noise)
            error = np.degrees(np.arccos(abs(result.model[:2] @ normal)))
            print(
                f"{angle} deg, noise {noise}: {error:.2f} deg off, {result.status}, confidence {result.confidence:.3f}"
            )
    print(result)
