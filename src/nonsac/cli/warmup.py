"""Compile everything once."""

from __future__ import annotations

from collections.abc import Callable

from nonsac.cli.messages import to_stdout
from nonsac.cli.session import session


def warmup() -> None:
    """Compile all kernels now, so that no later run has to wait for it."""
    with session(False, "problems") as progress:
        tasks = [*_registrations(), *_poses()]
        for done, task in enumerate(tasks):
            progress(done, len(tasks))
            task()
    to_stdout("all kernels are compiled")


def _registrations() -> list[Callable[[], object]]:
    import nonsac
    from nonsac import simulate

    scans = simulate.demo_scans(0, points=1500)
    pairs = simulate.registration(300, 0.5, 0.01, 0)
    return [
        lambda: nonsac.register_clouds(scans.source, scans.target, samples=2),
        lambda: nonsac.register_pairs(pairs.source, pairs.target),
        lambda: nonsac.register_pairs(pairs.source, pairs.target, noise=0.01),
        lambda: nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, scale=None, refine="full"),
        lambda: nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, estimator=nonsac.Pcr99(order="random")),
    ]


def _poses() -> list[Callable[[], object]]:
    import numpy as np

    import nonsac
    from nonsac import simulate

    views = simulate.relative_pose(300, 0.5, 0.001, 0)
    scene = simulate.absolute_pose(300, 0.5, 0.001, 0)
    weights = np.linspace(0.1, 1.0, 300)
    return [
        lambda: nonsac.relative_pose(views.points1, views.points2),
        lambda: nonsac.relative_pose(views.points1, views.points2, noise=0.001),
        lambda: nonsac.relative_pose(views.points1, views.points2, noise=0.001, weights=weights, refine="full"),
        lambda: nonsac.absolute_pose(scene.points2d, scene.points3d),
        lambda: nonsac.absolute_pose(scene.points2d, scene.points3d, noise=0.001),
        lambda: nonsac.absolute_pose(scene.points2d, scene.points3d, noise=0.001, weights=weights, refine="full"),
    ]
