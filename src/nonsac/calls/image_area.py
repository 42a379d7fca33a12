"""Whether points can be pixels of a camera's image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.camera import Camera
from nonsac.cameras.models import parameter_names
from nonsac.result import Remark

_MOST_OUTSIDE, _FEWEST = 0.05, 50
_MARGIN, _MARGIN_OF_UNKNOWN = 0.02, 0.25  # of the size; a principal point may be off the centre


def remarks_on_image_area(points: NDArray[Any], name: str, camera: Camera | None) -> tuple[str, ...]:
    """What is said of points (n, 2) that cannot all be seen by a camera, or lie in one corner of its image.

    Images that were resized, swapped axes and wrong cameras look like this. If the size of the image is not known, it
    is taken to be twice the principal point, about.
    """
    if camera is None:
        return ()
    some = points[:: max(1, len(points) // 1000)].astype(np.float64)
    finite = some[np.isfinite(some).all(axis=1)]
    if len(finite) < _FEWEST:
        return ()
    first = parameter_names(camera.model).index("cx")
    centre = np.array(camera.params[first : first + 2])
    size, margin = 2.0 * centre, _MARGIN_OF_UNKNOWN
    if camera.width is not None and camera.height is not None:
        size, margin = np.array([camera.width, camera.height], np.float64), _MARGIN
    if not (size > 0.0).all():
        return ()
    share = float((np.abs(finite - 0.5 * size) > (0.5 + margin) * size).any(axis=1).mean())
    if share > _MOST_OUTSIDE:
        told = f"{100 * share:.0f} % of {name} are outside of about {size[0]:,.0f} x {size[1]:,.0f} pixels"
        return (Remark.OTHER_IMAGE.detailed(told),)
    low, high = np.quantile(finite, [0.02, 0.98], axis=0)
    if ((centre < low) | (centre > high)).all():
        return (Remark.OTHER_IMAGE.detailed(f"{name} are all in one corner, seen from the principal point"),)
    return ()
