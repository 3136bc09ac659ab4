"""What the Python SDK makes of a visit, in the form in which other clients are compared with it.

The canonical arrays are those of README.md; here they come from ``terraport_payload``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

import terraport.sync
from terraport_payload import SegmentMesh

__all__ = ["NORMAL_STEP", "land_with_sdk", "normals_apart"]

NORMAL_STEP: Final = 1.02 / 127
"""One code of a normal's component. meshoptimizer's native x86 decoder takes an approximate root
where the portable one, which the engine clients have, takes an exact one."""


def land_with_sdk(
    url: str, places: list[tuple[float, float, float, float]], **options: Any
) -> tuple[list[list[int]], dict[int, SegmentMesh]]:
    """Land at places (x, y, z, radius); returns the visible ids of each, and the last's meshes."""
    visible = []
    meshes: dict[int, SegmentMesh] = {}
    with terraport.sync.connect(url, **options) as session:
        for x, y, z, radius_m in places:
            segments = session.land((x, y, z), radius_m).ready()
            visible.append(sorted(session.visible))
            meshes = {segment.id: segment.arrays() for segment in segments}
    return visible, meshes


def normals_apart(meshes: Mapping[int, SegmentMesh], folder: Path) -> float:
    """Return the largest difference of any component of the normals that a client dumped."""
    worst = 0.0
    for segment, mesh in meshes.items():
        normals = np.fromfile(folder / f"{segment}.normals", dtype="<f4").reshape(-1, 3)
        assert normals.shape == mesh.normals.shape
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
        worst = max(worst, float(np.abs(normals - mesh.normals).max()))
    return worst
