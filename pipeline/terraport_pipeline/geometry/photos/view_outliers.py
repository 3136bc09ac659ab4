"""Photos that show something else than the others: people, trucks, branches that the mesh lacks.

Waechter, Moehrle, Goesele (ECCV 2014, section 4.1) look at the mean colours of a face in all its
views, and drop views far from the mean of the inliers, found again and again. The faces of a dense
survey are a few pixels large and a pixel's error in the cameras changes them entirely, so here the
colours are means over *cells*, cubes of some four edges (25 faces or so), and the centre is the
mode of a density of Gaussians (mean shift; Comaniciu & Meer, PAMI 2002), which half of the views
cannot pull away. The cloud's colour there is a vote of its own: it decides between two views, and
against views that agree neither with it nor with each other, as where each photo has another branch
in the way.

Leaves over grass have its mean colour. What gives them away is *grain*: how much the colours of a
cell's faces differ from the cloud's there, the difference of the means apart. Grain beyond that of
the cell's smoothest view counts as distance. (Rough ground is rough in every photo.)

A cell at the rim of something holds only a corner of it, and its mean stays near. So a view that is
dropped in one cell is judged more strictly in the 26 around it: two thresholds, as for the edges of
Canny (PAMI 1986), but one step wide.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32, UInt8
from terraport_pipeline.geometry.cover.face_cells import CellGrid, cells_around, face_cells
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.photos import outlier_kernels as kernels
from terraport_pipeline.geometry.photos.view_candidates import Candidates

__all__ = ["drop_outliers"]

_CELL_EDGES: Final = 4.0
"""Side of a cell in mean edges."""

_CHUNK_CELLS: Final = 2**13
"""Cells in a piece of work."""


def drop_outliers(
    candidates: Candidates,
    vertices: Float32,
    faces: Int32,
    own_colour: UInt8 | None,
    *,
    grid: CellGrid | None = None,
    threads: int = 1,
) -> int:
    """Drop views that show something else.

    Parameters
    ----------
    candidates : Candidates
        Sorted by view; stays so. Written to.
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    own_colour : ndarray of shape (F, 3), uint8, or None
        Faces' vertex colours; None where the survey has no colour.
    grid : CellGrid, optional
        Where the cells lie that are judged: the same for all pieces of a surface.
    threads : int
        The result does not depend on it.

    Returns
    -------
    int
        Pairs of face and view dropped.
    """
    if not len(faces):
        return 0
    order, starts = face_cells(vertices, faces, _CELL_EDGES, grid)
    around = cells_around(vertices, faces, order, starts, _CELL_EDGES, grid)
    own = np.zeros((0, 3), np.uint8) if own_colour is None else own_colour
    count = len(starts) - 1
    views = np.full((count, kernels.MAX_VIEWS), -1, np.int16)
    far = np.zeros((count, kernels.MAX_VIEWS), np.float32)

    def rate(begin: int, end: int) -> None:
        kernels.rate(candidates.view, candidates.colour, own, order, starts, views, far, begin, end)

    def drop(begin: int, end: int) -> int:
        return int(
            kernels.drop(
                candidates.view, candidates.quality, candidates.colour, order, starts, around,
                views, far, begin, end,
            )
        )  # fmt: skip

    in_chunks(rate, count, threads=threads, chunk=_CHUNK_CELLS)
    return sum(in_chunks(drop, count, threads=threads, chunk=_CHUNK_CELLS))
