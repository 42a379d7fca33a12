"""A field of nearest points takes bounded memory, however the cloud is shaped."""

import numpy as np
import pytest

from nonsac.clouds.surfaces import NearestField


@pytest.mark.parametrize("extent", [(1, 1, 1), (1e16, 1, 1), (1e9, 1e9, 1), (1e12, 1e-3, 0), (1e5, 1, 1e-9)])
def test_cells_are_few(rng, extent):
    points = rng.random((200, 3)) * extent
    normals = np.tile([0.0, 0.0, 1.0], (200, 1))
    field = NearestField.around(points, normals, 0.05, 0.01)
    assert field.nearest.size < 5e7
