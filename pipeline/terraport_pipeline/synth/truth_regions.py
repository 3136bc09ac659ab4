"""True regions of a synthetic quarry: what a person would draw on a map of it.

A region is a connected piece of ground of materials that can be told apart, no smaller than the
smallest piece worth drawing (a map maker's *minimum mapping unit*). Two answers to "told apart":

``visible``
    Materials whose mean colours in full sun lie closer than :data:`VISIBLE_STEP` are one: bench,
    rock face, road and boulder are one bare rock; grass, bush and tree one green. This is what an
    engine that sees colour can be asked for.
``material``
    Every material by itself; a road on a bench of nearly its colour counts. Asks for shape too.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.regions.colour import srgb_to_lab
from terraport_pipeline.geometry.regions.pool_refine import join_nearest, number_by_first
from terraport_pipeline.synth.appearance import material_colours
from terraport_pipeline.synth.truth_mesh import TruthMesh

__all__ = ["LEAST_SHARE", "VISIBLE_STEP", "families", "true_regions"]

VISIBLE_STEP: Final = 12.0
"""CIELAB units. Bench, boulder, road and rock face follow each other at 2 to 7, grassland, bush and
tree at 9 and 11; the next pair, bench and limestone, lies 16 apart."""
LEAST_SHARE: Final = 0.002
"""Share of the whole area; a stockpile has 0.005. A bush or a boulder is no region."""


def families(kind: Literal["visible", "material"]) -> Int32:
    """Family of every material, (256,) int32: materials of one family are one."""
    family = np.arange(256, dtype=np.int32)
    if kind == "visible":
        colours = material_colours()
        names = np.array(sorted(colours))
        lab = srgb_to_lab(np.array([colours[n] for n in names], dtype=np.float64))
        near = np.linalg.norm(lab[:, None] - lab[None], axis=2) < VISIBLE_STEP
        _, group = connected_components(coo_matrix(near), directed=False)
        family[names] = group
    return family


def true_regions(
    mesh: TruthMesh,
    pairs: Int32,
    edges: Int32,
    kind: Literal["visible", "material"] = "visible",
    *,
    least_share: float = LEAST_SHARE,
) -> Int32:
    """Draw the true regions.

    Parameters
    ----------
    mesh : TruthMesh
    pairs, edges : ndarray of shape (P, 2), int32
        Result of :func:`~terraport_pipeline.geometry.mesh.adjacency.face_pairs`.
    kind : {"visible", "material"}
        What can be told apart.
    least_share : float
        Pieces below this share of the whole area join the neighbour with the longest common border,
        the smallest first; pieces that touch nothing (trees) what stands nearest.

    Returns
    -------
    ndarray of shape (F,), int32
        Region of every face, 0.. by first face.
    """
    # (1) Connected faces of one kind, with their areas and the lengths of their common borders.
    pieces, count = components(len(mesh.faces), pairs, labels=families(kind)[mesh.material])
    area = _areas(mesh)
    piece_area = np.bincount(pieces, weights=area, minlength=count)
    least = least_share * float(area.sum())
    along = mesh.vertices[edges[:, 0]].astype(np.float64) - mesh.vertices[edges[:, 1]]
    borders = _borders(pieces, pairs, np.sqrt((along * along).sum(axis=1)))
    # (2) The smallest piece joins the one it shares most border with, until none is too small.
    # Invariant: `borders` is symmetric and holds only pieces that are left.
    target = np.arange(count)
    while True:
        small = [p for p in borders if piece_area[p] < least and borders[p]]
        if not small:
            break
        lost = min(small, key=lambda p: (piece_area[p], p))
        kept = max(borders[lost], key=lambda q: (borders[lost][q], -q))
        target[lost] = kept
        piece_area[kept] += piece_area[lost]
        for other, length in borders.pop(lost).items():
            del borders[other][lost]
            if other != kept:
                borders[kept][other] = borders[kept].get(other, 0.0) + length
                borders[other][kept] = borders[other].get(kept, 0.0) + length
    # (3) Follow every piece to where it ended.
    for piece in range(count):
        while target[target[piece]] != target[piece]:
            target[piece] = target[target[piece]]
    regions: Int32 = target[pieces].astype(np.int32)
    alone = piece_area < least
    alone &= target == np.arange(count)
    if alone.any() and not alone[regions].all():
        regions = join_nearest(mesh.vertices, mesh.faces, regions, alone)
    return number_by_first(regions)[0]


def _areas(mesh: TruthMesh) -> Float64:
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas: Float64 = 0.5 * np.sqrt((normal * normal).sum(axis=1))
    return areas


def _borders(pieces: Int32, pairs: Int32, length: Float64) -> dict[int, dict[int, float]]:
    """Length of the common border of every two pieces that touch."""
    a, b = pieces[pairs[:, 0]], pieces[pairs[:, 1]]
    apart = a != b
    count = int(pieces.max()) + 1 if len(pieces) else 0
    table = coo_matrix((length[apart], (a[apart], b[apart])), shape=(count, count)).tocsr()
    table = (table + table.T).tocoo()
    borders: dict[int, dict[int, float]] = {piece: {} for piece in range(count)}
    for row, column, common in zip(
        table.row.tolist(), table.col.tolist(), table.data.tolist(), strict=True
    ):
        borders[row][column] = common
    return borders
