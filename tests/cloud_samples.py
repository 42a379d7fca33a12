"""Clouds and motions that the tests of raw clouds share."""

import numpy as np

import nonsac


def bumpy(n, rng):
    """Points on a closed surface without symmetry: a sphere with three bumps of different size and direction."""
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    radius = np.ones(n)
    for height, centre in ((0.6, (1, 0, 0)), (0.45, (0.2, 1, 0.1)), (0.8, (-0.5, -0.3, 1))):
        centre = np.array(centre) / np.linalg.norm(centre)
        radius += height * np.exp(8.0 * (directions @ centre - 1.0))
    return directions * radius[:, None]


def motion(rng, size=1.0):
    T = np.eye(4)
    T[:3, :3] = nonsac.simulate.random_rotation(rng)
    T[:3, 3] = rng.uniform(-size, size, 3)
    return T


def move(points, T):
    return points @ T[:3, :3].T + T[:3, 3]
