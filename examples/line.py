"""A problem of your own: a line in the plane, in plain NumPy, through the same pipeline as everything else."""

import numpy as np

import nonsac


class Line:
    """a x + b y + c = 0 with a unit normal, for rows (x, y). A model is (3, 4): the line is its first three numbers."""

    width, minimal_size, split = 2, 2, 1

    def solve_minimal(self, samples):
        (x1, y1), (x2, y2) = samples[:, 0].T, samples[:, 1].T
        lines = np.stack([y1 - y2, x2 - x1, x1 * y2 - x2 * y1], axis=1)
        return self._models(lines[np.hypot(lines[:, 0], lines[:, 1]) > 0])

    def residuals(self, models, rows):
        a, b, c = models.reshape(-1, 12)[:, :3].T[..., None]
        return np.abs(a * rows[:, 0] + b * rows[:, 1] + c)

    def count_inliers(self, models, rows, threshold):
        return (self.residuals(models, rows) < threshold).sum(axis=1)

    def refit(self, model, rows, weights):
        if np.count_nonzero(weights) < 2:
            return np.full((3, 4), np.nan)
        mean = np.average(rows, axis=0, weights=weights)
        normal = np.linalg.svd((rows - mean) * np.sqrt(weights)[:, None], full_matrices=False)[2][1]
        return self._models(np.append(normal, -normal @ mean)[None])[0]

    def determined(self, model, inliers, threshold):
        return bool(np.ptp(inliers, axis=0).max() > threshold)

    def distance(self, a, b):
        a, b = a.reshape(*a.shape[:-2], 12), b.reshape(*b.shape[:-2], 12)
        return np.degrees(np.arccos(np.minimum(1.0, np.abs((a[..., :2] * b[..., :2]).sum(axis=-1)))))

    def _models(self, lines):
        models = np.zeros((len(lines), 12))
        models[:, :3] = lines / np.hypot(lines[:, 0], lines[:, 1])[:, None]
        return models.reshape(-1, 3, 4)


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (100_000, 2))
    points[:10_000, 1] = 0.5 * points[:10_000, 0] + 0.2 + rng.normal(scale=0.005, size=10_000)
    result = nonsac.estimate(nonsac.ArraySource(points), Line(), nonsac.Ransac(500), noise=0.005)
    a, b, c = result.T.ravel()[:3]
    print(f"y = {-a / b:.3f} x + {-c / b:.3f}: {result.status}, {result.num_inliers} of {result.num_rows} rows")
