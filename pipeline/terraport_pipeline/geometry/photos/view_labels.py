"""One photo for every face: good ones, and the same as its neighbours'.

The energy of a Markov random field on the faces, as in Lempitsky & Ivanov, "Seamless mosaicing of
image-based texture maps" (CVPR 2007), equation 1, with the Potts model of Waechter, Moehrle,
Goesele (ECCV 2014), equation 1::

    E(l) = sum over faces f: a_f c_f(l_f)  +  smoothness * sum over edges (f, g): s_fg [l_f != l_g]

with c_f(v) = 1 - quality(f, v) / best quality of f, a_f the face's area and s_fg the edge's length,
both in units of their mean: the seams' length and the loss of quality are what counts, not how many
faces a solver made of them.

It is lowered by *block coordinate descent on trees* (Thuerck, Waechter, Widmer, von Buelow,
Seemann, Pfetsch, Goesele, "A fast, massively parallel solver for large, irregular pairwise Markov
random fields", HPG 2016): faces are picked so that those picked form a forest, about three in four
of them; given the labels of the rest, dynamic programming finds the forest's best labels exactly,
so the energy never rises. The next round grows other trees. With Potts costs a message takes time
linear in the labels (Felzenszwalb & Huttenlocher, "Efficient belief propagation for early vision",
IJCV 2006, section 3.1).

The start matters: from each face's own best view the trees end in small patches that no tree can
turn over as a whole. So all faces of a cell some sixteen edges wide begin with the view that is
best for the cell. On 1 M faces of a beach seen by 18 drone photos (smoothness 4, eight rounds):
energy 263,000 from the faces' own views, 192,000 from the cells', with half the length of seams;
iterated conditional modes
(each face its best, again and again) stopped at 396,000.

Rounds run in pieces of faces beside each other; a face with a neighbour in another piece rests
while its piece is solved, and the pieces are cut elsewhere in the next round. So the result does
not depend on the number of threads.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int8, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.photos import label_kernels as kernels
from terraport_pipeline.geometry.photos.view_candidates import Candidates

__all__ = [
    "FaceNeighbours",
    "Labelled",
    "chosen_views",
    "energy",
    "face_neighbours",
    "label_faces",
    "view_costs",
]

_PIECE: Final = 2**18
"""Faces solved as one: its border, where faces rest, is under 1 % of them, and its messages take
8 MB."""

_SHIFT: Final = 0.382
"""Pieces begin this part of a piece later in every round (the golden section: never twice near one
place)."""

_CHUNK_CELLS: Final = 2**11
"""Cells in a piece of work."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceNeighbours:
    """Up to three neighbours of every face, and the sizes that weigh them."""

    face: Int32
    """(F, 3) neighbour across each edge, -1 where there is none; places in no order. Of more than
    three neighbours (several faces at one edge) the first three."""
    length: Float32
    """(F, 3) length of the shared edge over the mean length."""
    area: Float32
    """(F,) area over the mean area."""


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """Chosen slot of every face, and the energy after every round."""

    slot: Int8
    """(F,) chosen place among the face's candidates, -1 where it has none."""
    energies: tuple[float, ...]
    """Before the first round and after each; never rising."""


def face_neighbours(vertices: Float32, faces: Int32, pairs: Int32, edges: Int32) -> FaceNeighbours:
    """Put pairs of neighbouring faces in rows.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    pairs, edges : ndarray of shape (P, 2), int32
        From :func:`terraport_pipeline.geometry.mesh.adjacency.face_pairs`.

    Returns
    -------
    FaceNeighbours
    """
    return FaceNeighbours(*kernels.neighbour_rows(vertices, faces, pairs, edges))


def view_costs(candidates: Candidates, *, threads: int = 1) -> None:
    """Turn qualities into costs c_f(v), in place: 0 for a face's best view, below 65535."""

    def work(begin: int, end: int) -> None:
        kernels.costs(candidates.view, candidates.quality, begin, end)

    in_chunks(work, len(candidates.view), threads=threads)


def label_faces(
    candidates: Candidates,
    neighbours: FaceNeighbours,
    cells: tuple[Int32, Int64],
    *,
    smoothness: float,
    max_rounds: int = 6,
    min_gain: float = 0.01,
    threads: int = 1,
) -> Labelled:
    """Choose a view for every face.

    Parameters
    ----------
    candidates : Candidates
        Sorted by view, with costs for qualities (:func:`view_costs`). Faces without any stay
        without and weigh nothing.
    neighbours : FaceNeighbours
    cells : tuple of ndarray
        From :func:`terraport_pipeline.geometry.cover.face_cells.face_cells`; sixteen edges wide.
    smoothness : float
        What one mean edge of seam costs, in mean faces without any quality. 0 leaves every face its
        best view (the first of equal ones).
    max_rounds : int
    min_gain : float
        Stop when a round lowers the energy by less than this part of it.
    threads : int
        The result does not depend on it.

    Returns
    -------
    Labelled
    """
    n_faces = len(candidates.view)
    slot = np.full(n_faces, -1, np.int8)
    in_chunks(
        lambda begin, end: kernels.best_slots(
            candidates.view, candidates.quality, slot, begin, end
        ),
        n_faces, threads=threads,
    )  # fmt: skip
    if smoothness > 0.0:
        in_chunks(
            lambda begin, end: kernels.common_slots(
                candidates.view, candidates.quality, neighbours.area, *cells, slot, begin, end
            ),
            len(cells[1]) - 1, threads=threads, chunk=_CHUNK_CELLS,
        )  # fmt: skip
    energies = [energy(candidates, neighbours, slot, smoothness=smoothness, threads=threads)]
    for round_number in range(max_rounds if smoothness > 0.0 else 0):
        _solve_round(candidates, neighbours, slot, smoothness, round_number, threads)
        energies.append(
            energy(candidates, neighbours, slot, smoothness=smoothness, threads=threads)
        )
        if energies[-2] - energies[-1] < min_gain * energies[-2]:
            break
    return Labelled(slot, tuple(energies))


def chosen_views(candidates: Candidates, slot: Int8, *, threads: int = 1) -> Int32:
    """View in every face's chosen place, (F,) int32; -1 where the place is."""
    chosen = np.full(len(slot), -1, np.int32)

    def work(begin: int, end: int) -> None:
        rows = begin + np.flatnonzero(slot[begin:end] >= 0)
        chosen[rows] = candidates.view[rows, slot[rows]]

    in_chunks(work, len(slot), threads=threads)
    return chosen


def energy(
    candidates: Candidates,
    neighbours: FaceNeighbours,
    slot: Int8,
    *,
    smoothness: float,
    threads: int = 1,
) -> float:
    """E of a choice; see the module. Edges to faces without any view cost nothing."""
    sums = in_chunks(
        lambda begin, end: kernels.energy(
            candidates.view, candidates.quality, neighbours.face, neighbours.length,
            neighbours.area, slot, smoothness, begin, end,
        ),
        len(slot), threads=threads,
    )  # fmt: skip
    return float(sum(sums))


def _solve_round(
    candidates: Candidates,
    neighbours: FaceNeighbours,
    slot: Int8,
    smoothness: float,
    round_number: int,
    threads: int,
) -> None:
    """Solve every piece once, in place; pieces read the other pieces' labels of before."""
    n_faces = len(slot)
    cuts = [0, *range(int(_SHIFT * round_number % 1.0 * _PIECE), n_faces, _PIECE), n_faces]
    before = slot.copy()

    def work(begin: int, end: int) -> None:
        for first, last in zip(cuts[begin:end], cuts[begin + 1 : end + 1], strict=True):
            if first < last:
                kernels.solve_piece(
                    candidates.view, candidates.quality, neighbours.face, neighbours.length,
                    neighbours.area, before, slot, smoothness, round_number, first, last,
                )  # fmt: skip

    in_chunks(work, len(cuts) - 1, threads=threads, chunk=1)
