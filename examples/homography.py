"""A problem of your own: the homography between two images of a plane; models are 3 x 3."""

import numpy as np

import nonsac


class Homography(nonsac.Problem):
    """x2 ~ H x1 for matched points (x1, y1), (x2, y2). A model is H (3, 3), of length 1."""

    layout, minimal_size, model_shape = nonsac.Layout("x1 y1 | x2 y2"), 4, (3, 3)
    residual_dimension = 2  # the length of an error in both directions of the image

    def solve_minimal(self, samples):
        return np.linalg.svd(self._equations(samples))[2][:, -1].reshape(-1, 3, 3)

    def residuals(self, models, rows):
        x, y, depth = np.moveaxis(models @ np.column_stack([rows[:, :2], np.ones(len(rows))]).T, 1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = np.hypot(x / depth - rows[:, 2], y / depth - rows[:, 3])
        return np.nan_to_num(distances, nan=np.inf)

    def refit(self, model, rows, weights):
        """The direct linear transform, each row divided by its depth, so that errors are lengths in the image."""
        depth = rows[:, :2] @ model[2, :2] + model[2, 2]
        scale = np.sqrt(weights) / np.where(depth == 0, np.inf, np.abs(depth))
        used = scale > 0
        equations = self._equations(rows[None, used])[0] * np.repeat(scale[used], 2)[:, None]
        return np.linalg.svd(equations, full_matrices=len(equations) < 9)[2][-1].reshape(3, 3)

    @staticmethod
    def _equations(samples):
        """Two rows (9,) for each match, in pairs: (B, 2 k, 9)."""
        x, y, u, v = np.moveaxis(samples, 2, 0)
        zero, one = np.zeros_like(x), np.ones_like(x)
        first = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=2)
        second = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=2)
        return np.stack([first, second], axis=2).reshape(len(samples), -1, 9)


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    H = np.array([[0.9, -0.2, 0.1], [0.15, 1.1, -0.05], [0.2, -0.1, 1.0]])
    first = rng.uniform(-1, 1, (50_000, 2))
    seen = np.column_stack([first, np.ones(len(first))]) @ H.T
    second = seen[:, :2] / seen[:, 2:] + rng.normal(scale=0.002, size=first.shape)
    second[:40_000] = rng.uniform(-1, 1, (40_000, 2))
    rows = nonsac.ArraySource(np.hstack([first, second]))
    for noise in (0.002, None):
        result = nonsac.estimate(rows, Homography(), noise=noise)
        error = np.abs(result.model / result.model[2, 2] - H).max()
        print(f"noise {noise}: H is off by {error:.4f}, {result.status}, confidence {result.confidence:.3f}")
    print(result)
