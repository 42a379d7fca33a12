"""Which of many ranked models are different answers."""

from __future__ import annotations

from nonsac.kernels._jit import kernel


@kernel
def keep_distinct(models, squared_chord, squared_distance, kept):
    """Numbers of the models (M, 3, 4) that differ from all kept before them; returns how many `kept` (M,) holds.

    Two models are the same answer where the squared Frobenius distance of their rotations is below `squared_chord`
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
