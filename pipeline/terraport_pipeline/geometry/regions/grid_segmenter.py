"""The plain grid: what any cleverer way to cut a surface has to beat.

Faces go to the square cell in plan that their middle lies in; a region or pool is an edge-connected
piece of one cell. Colour and shape are not looked at.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.mesh.face_measures import face_centres
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh

__all__ = ["GridSegmenter", "grid_cells"]


_AUTO_REGION_SHARE: Final = 0.05
"""Automatic region cells hold this share of all faces of level ground."""
_AUTO_FINE_FACES: Final = 8000
"""Automatic fine cells hold about this many faces of level ground: the middle of the bounds of
streamable segments."""


@dataclass(frozen=True, slots=True)
class GridSegmenter:
    """Square cells in plan, cut into connected pieces."""

    region_cell_m: float | None = None
    """Side of the regions' cells, metres. None: cells of a twentieth of the ground in plan."""
    fine_cell_m: float | None = None
    """Side of the fine pools' cells, metres. None: cells of 8,000 faces of mean density in plan."""

    def __post_init__(self) -> None:
        """Refuse lengths that are none before any work."""
        for name in ("region_cell_m", "fine_cell_m"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                msg = f"{name} is {value}, expected a finite length above 0 or None"
                raise ValueError(msg)

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"grid"``."""
        return "grid"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into pieces of cells; see :class:`~.segmenter.Segmenter`."""
        pairs, _ = mesh.edge_pairs()
        n_faces = len(mesh.faces)
        extent = np.ptp(mesh.vertices[:, [0, 2]], axis=0) if len(mesh.vertices) else np.zeros(2)
        plan = max(float(extent[0]) * float(extent[1]), 1e-12)
        region_cell = self.region_cell_m or float(np.sqrt(plan * _AUTO_REGION_SHARE))
        fine_share = min(_AUTO_FINE_FACES / max(n_faces, 1), 1.0)
        fine_cell = self.fine_cell_m or float(np.sqrt(plan * fine_share))
        regions, region_count = components(
            n_faces, pairs, labels=grid_cells(mesh.vertices, mesh.faces, region_cell)
        )
        fine, _ = components(
            n_faces, pairs, labels=grid_cells(mesh.vertices, mesh.faces, fine_cell)
        )
        return Segmentation(
            regions=regions,
            region_count=region_count,
            fine=fine,
            similarity=np.zeros(n_faces, np.float32),
            facts={"region_cell_m": region_cell, "fine_cell_m": fine_cell},
        )


def grid_cells(vertices: AnyFloat, faces: AnyInt, cell_m: float) -> Int32:
    """Give every face the number of the cell in plan that its middle lies in.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres, scene frame (Y up): cells lie in x and z, the first corner at the least vertex.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    cell_m : float
        Side of a cell, metres. A middle on a border belongs to the cell of greater coordinates.

    Returns
    -------
    ndarray of shape (F,), int32
        Row by row.

    Raises
    ------
    ValueError
        More cells than 32-bit numbers: the cell is too small for the site.
    """
    if len(faces) == 0:
        return np.zeros(0, np.int32)
    plan = face_centres(vertices, faces)[:, [0, 2]]
    cell = np.floor((plan - vertices[:, [0, 2]].min(axis=0)) / cell_m)
    cells = (float(cell[:, 0].max()) + 1.0) * (float(cell[:, 1].max()) + 1.0)
    if cells >= 2**31:
        msg = f"cells of {cell_m:g} m would be {cells:.3g}, expected fewer than 2^31; take more"
        raise ValueError(msg)
    wide = int(cell[:, 0].max()) + 1
    numbered: Int32 = (cell[:, 1] * wide + cell[:, 0]).astype(np.int32)
    return numbered
