"""Photos that show something else than the others: people, trucks, branches that the mesh lacks.

Waechter, Moehrle, Goesele (ECCV 2014, section 4.1) look at the mean colours of a face in all its
views, and drop views far from the mean of the inliers, found again and again. The faces of a dense
survey are a few pixels large and a pixel's error in the cameras changes them entirely, so here the
colours are means over *cells*, cubes of some four edges (25 faces or so), and the centre is the
mode of a density of Gaussians (mean shift; Comaniciu & Meer, PAMI 2002), which half of the views
cannot pull away. The cloud's colour there is a vote of its own: it decides between two views, and
against views that agree neither with it nor with each other, as where each photo has another branch
in the way.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.chunks import in_chunks
from terraport_pipeline.geometry.face_cells import CellGrid, face_cells
from terraport_pipeline.geometry.view_candidates import QUALITY_STEPS, SLOTS, Candidates
from terraport_pipeline.geometry.view_kernels import place_of_view
from terraport_pipeline.model import Float32, Int32, UInt8

__all__ = ["drop_outliers"]

_CELL_EDGES: Final = 4.0
"""Side of a cell in mean edges."""

_SIGMA: Final = 10.0
"""Spread of views that agree, levels (root mean square over the channels): noise, angles, what the
gains leave."""

_FAR: Final = 30.0
"""Views farther from the mode than this are dropped, levels: a car or a shadow differs by 40 to
100."""

_HALVED: Final = 15.0
"""Levels from the mode at which a view that stays counts half its quality."""

_FAR_ALONE: Final = 60.0
"""The same where a single view stands against the cloud."""

_CLOUD_VOTE: Final = 1.5
"""Votes of the cloud's colour: more than one view, less than two that agree."""

_MAX_VIEWS: Final = 16
"""Views looked at per cell; further ones stay."""

_SHIFTS: Final = 4
"""Steps of mean shift; it converges to a tenth of a level."""

_CHUNK_CELLS: Final = 2**13
"""Cells in a piece of work."""

_Int64 = npt.NDArray[np.int64]


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
    own = np.zeros((0, 3), np.uint8) if own_colour is None else own_colour

    def work(begin: int, end: int) -> int:
        return int(
            _judge_cells(
                candidates.view,
                candidates.quality,
                candidates.colour,
                own,
                order,
                starts,
                begin,
                end,
            )
        )

    return sum(in_chunks(work, len(starts) - 1, threads=threads, chunk=_CHUNK_CELLS))


@numba.njit(cache=True, nogil=True)
def _square_distance(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    square: float = (x * x + y * y + z * z) / 3.0
    return square


@numba.njit(cache=True, nogil=True)
def _judge_cells(
    views: npt.NDArray[np.int16],
    qualities: npt.NDArray[np.uint16],
    colours: UInt8,
    own: UInt8,
    order: Int32,
    starts: _Int64,
    begin: int,
    end: int,
) -> int:
    dropped = 0
    seen = np.empty(_MAX_VIEWS, np.int64)
    mean = np.empty((_MAX_VIEWS + 1, 3))
    vote = np.empty(_MAX_VIEWS + 1)
    far = np.empty(_MAX_VIEWS, np.bool_)
    less = np.empty(_MAX_VIEWS, np.int64)
    mode = np.empty(3)
    for cell in range(begin, end):
        first, last = starts[cell], starts[cell + 1]
        # (1) mean colour of the cell in each of its views, and in the cloud (place n)
        n = 0
        mean[:] = 0.0
        vote[:] = 0.0
        for i in range(first, last):
            f = order[i]
            for s in range(SLOTS):
                if views[f, s] < 0:
                    break
                place = place_of_view(seen, n, views[f, s])
                if place == n:
                    if n == _MAX_VIEWS:
                        continue
                    seen[n] = views[f, s]
                    n += 1
                vote[place] += 1.0
                for k in range(3):
                    mean[place, k] += colours[f, s, k]
        if n == 0:
            continue
        for place in range(n):
            for k in range(3):
                mean[place, k] /= vote[place]
            vote[place] = vote[place] / (last - first)  # a view of half the cell has half a vote
        count = n
        if len(own):
            mean[n] = 0.0
            for i in range(first, last):
                for k in range(3):
                    mean[n, k] += own[order[i], k] / (last - first)
            vote[n] = _CLOUD_VOTE
            count += 1
        if count < 2 or (count == 2 and len(own) == 0):
            continue
        # (2) the mode: from the densest colour uphill
        best, most = 0, -1.0
        for a in range(count):
            density = 0.0
            for b in range(count):
                density += vote[b] * np.exp(
                    -0.5 * _square_distance(mean[a], mean[b]) / (_SIGMA * _SIGMA)
                )
            if density > most:
                best, most = a, density
        mode[:] = mean[best]
        for _ in range(_SHIFTS):
            total0, total1, total2, mass = 0.0, 0.0, 0.0, 0.0
            for b in range(count):
                w = vote[b] * np.exp(-0.5 * _square_distance(mode, mean[b]) / (_SIGMA * _SIGMA))
                total0 += w * mean[b, 0]
                total1 += w * mean[b, 1]
                total2 += w * mean[b, 2]
                mass += w
            mode[0], mode[1], mode[2] = total0 / mass, total1 / mass, total2 / mass
        # (3) drop what is far from it, and like the less what is less near
        limit = _FAR_ALONE if n == 1 else _FAR
        for place in range(n):
            square = _square_distance(mode, mean[place])
            far[place] = square > limit * limit
            less[place] = int(QUALITY_STEPS * square / (_HALVED * _HALVED))
        for i in range(first, last):
            f = order[i]
            kept = 0
            for s in range(SLOTS):
                if views[f, s] < 0:
                    break
                out, minus = False, 0
                for place in range(n):
                    if seen[place] == views[f, s]:
                        out, minus = far[place], less[place]
                if out:
                    dropped += 1
                    continue
                qualities[f, kept] = max(int(qualities[f, s]) - minus, 1)
                if kept != s:
                    views[f, kept] = views[f, s]
                    for k in range(3):
                        colours[f, kept, k] = colours[f, s, k]
                kept += 1
            for s in range(kept, SLOTS):
                views[f, s] = -1
                qualities[f, s] = 0
    return dropped
