"""Meshes of the payload's tests."""

from __future__ import annotations

import pytest
from store.tiny_scene import lattice_mesh

from terraport_payload import SegmentMesh


@pytest.fixture
def patch() -> SegmentMesh:
    """72 faces with everything a segment can have."""
    return lattice_mesh(0, 0)


@pytest.fixture
def triangle() -> SegmentMesh:
    """One face, nothing optional; written out by hand."""
    import numpy as np

    return SegmentMesh(
        positions=np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1]], dtype=np.float32),
        faces=np.array([[0, 1, 2]], dtype=np.uint32),
        normals=np.array([[0, 1, 0]] * 3, dtype=np.float32),
    )
