"""Random walks: faces go to the seed that a walk from them meets first; parts are then united.

1. Seeds are spread over the body, each the face farthest from those before, many more than parts
   are asked for.
2. A walk goes on over an edge with a chance that grows with the edge's length and shrinks with its
   fold: exp(-d), d the fold (1 - cos) over its mean, a fold outwards counting a fifth. Chances to
   meet each seed first are the solution of one sparse system.
3. Parts are united in an order of their own, down to k: first the two with the largest share of the
   smaller perimeter in common.

References
----------
Y.-K. Lai, S.-M. Hu, R. R. Martin, P. L. Rosin, "Fast mesh segmentation using random walks", ACM
Symposium on Solid and Physical Modeling, 2008, sections 3 (walks) and 5 (automatic).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from terraport_payload.types import Float64, Int32
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.cutters.k_means import farthest_seeds
from terraport_research.kernels.nearest_source import rows_of_edges

__all__ = ["RANDOM_WALKS"]

_SEEDS: Final = 60
"""On every sixteenth model 30, 60 and 100 give a mean 1 - RI of .179, .196, .207; people's parts
can be put together from the pieces of 60 to .044, of 30 to .055."""
_OUTWARDS: Final = 0.2
"""Share of a fold outwards that counts, as printed."""
_LOST: Final = 1e-9
"""Of a walk's chances, that it ends nowhere: what no seed can reach has a solution, too."""


def _prepare(body: Body) -> Cut:
    passable = _chance_to_pass(body)
    pieces = _first_met(body, passable)
    unions, count = _unions(body, passable, pieces), int(pieces.max()) + 1

    def cut(k: int) -> Int32:
        part_of = np.arange(count, dtype=np.int32)
        for kept, eaten in unions[: max(count - k, 0)]:
            part_of[part_of == eaten] = kept
        _, numbered = np.unique(part_of, return_inverse=True)
        return numbered.astype(np.int32)[pieces]

    return cut


def _chance_to_pass(body: Body) -> Float64:
    """(P,) 1 over an edge that does not fold; not yet by length."""
    fold = np.where(body.folds < 0.0, 1.0, _OUTWARDS) * (1.0 - np.cos(body.folds))
    return np.asarray(np.exp(-fold / max(float(fold.mean()), np.finfo(np.float64).tiny)))


def _first_met(body: Body, passable: Float64) -> Int32:
    """(F,) seed that a walk from the face most likely meets first."""
    n, pairs = len(body.faces), body.neighbours[0]
    step = body.centres[pairs[:, 0]] - body.centres[pairs[:, 1]]
    rows = rows_of_edges(n, pairs, np.sqrt((step * step).sum(axis=1)))
    seeds = farthest_seeds(rows, n, _SEEDS)
    # Dirichlet's problem on the faces that are no seeds: what a walk meets from a face is the mean
    # of what it meets from the next, each by its chance.
    weight = body.edge_lengths / max(float(body.edge_lengths.mean()), 1e-300) * passable
    both = np.concatenate([pairs, pairs[:, ::-1]]).T
    ways = sparse.coo_array((np.tile(weight, 2), (both[0], both[1])), shape=(n, n)).tocsr()
    total = np.asarray(ways.sum(axis=1)).ravel() + _LOST
    free = np.ones(n, np.bool_)
    free[seeds] = False
    labels = np.zeros(n, np.int32)
    labels[seeds] = np.arange(len(seeds))
    if free.any():
        from_free = ways[free]
        system = (sparse.diags_array(total[free]) - from_free[:, free]).tocsc()
        # Symmetric and diagonally dominant: no pivots, and the order of least fill for it.
        solver = splu(
            system,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        labels[free] = solver.solve(from_free[:, seeds].toarray()).argmax(axis=1)
    return labels


def _unions(body: Body, passable: Float64, pieces: Int32) -> list[tuple[int, int]]:
    """Pieces to unite, in turns: the one that grows and the one that it takes in."""
    n, pairs = int(pieces.max()) + 1, body.neighbours[0]
    area = np.bincount(pieces, body.area, n) / max(float(body.area.sum()), 1e-300)
    side = pieces[pairs]
    across = side[:, 0] != side[:, 1]
    common, open_common = np.zeros((n, n)), np.zeros((n, n))
    for matrix, values in (
        (common, body.edge_lengths),
        (open_common, body.edge_lengths * passable),
    ):
        np.add.at(matrix, (side[across, 0], side[across, 1]), values[across])
        matrix += matrix.T
    unions = []
    for _ in range(n - 1):
        perimeter = common.sum(axis=1)
        smaller = np.minimum(perimeter[:, None], perimeter) * np.minimum(area[:, None], area)
        worth = np.where(common > 0.0, open_common / np.maximum(smaller, 1e-300), -1.0)
        kept, eaten = (int(at) for at in np.unravel_index(np.argmax(worth), worth.shape))
        if worth[kept, eaten] < 0.0:  # pieces apart
            break
        unions.append((kept, eaten))
        area[kept] += area[eaten]
        area[eaten] = 0.0
        for matrix in (common, open_common):
            matrix[kept] += matrix[eaten]
            matrix[:, kept] += matrix[:, eaten]
            matrix[eaten] = matrix[:, eaten] = 0.0
            matrix[kept, kept] = 0.0
    return unions


RANDOM_WALKS: Final = Cutter(
    "random-walks",
    "Random Walks",
    "Lai, Hu, Martin, Rosin 2008",
    takes_k=True,
    prepare=_prepare,
    thesis="RW",
    departs="60 seeds; of the common border over the smaller perimeter, by which parts are united, "
    "an edge counts by the walk's chance to pass it, and the whole is over the smaller area: as "
    "printed, a limb is eaten from its end.",
)
