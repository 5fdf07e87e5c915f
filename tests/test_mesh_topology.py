"""Values of corners and points, spread over the faces of a mesh."""

import numpy as np
import pytest

from isolux.mesh_topology import MeshTopology


@pytest.mark.parametrize("odd", [np.inf, -np.inf, np.nan, 1e30])
def test_an_odd_value_stays_in_its_face(odd):
    counts = np.array([3, 0, 4, 3], np.int32)
    topology = MeshTopology(counts, np.arange(10, dtype=np.int32), 10)
    values = np.arange(10.0)[:, None]
    values[1] = odd
    means = topology.to_faces(values, "vertex")
    assert means[1:, 0].tolist() == [0.0, (3 + 4 + 5 + 6) / 4, (7 + 8 + 9) / 3]
