"""Randomised cuts: split again and again along what many random cuts agree on.

1. The body is cut into some hundred small pieces (the paper: simplified to 4,000 faces).
2. A part is cut in two many times: from two pieces drawn by lot, along the least cut between them.
   Concave folds are cheap; borders near either piece are dear, so that a cut does not just go
   around one of them.
3. How often a border lies on a cut is its share of the *partition function*. Of the cuts made, the
   one whose borders lie on most others is the part's.
4. The part whose cut is worth most, agreement times the share of the body on its smaller side, is
   split, until there are k.

References
----------
A. Golovinskiy, T. Funkhouser, "Randomized cuts for 3D mesh analysis", ACM Transactions on Graphics
27(5), 2008, sections 4 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.cutters.normalised_cuts import PAPER_CONCAVITY, paper_tree
from terraport_research.kernels.graph_cut import arcs_of_pairs, least_cut
from terraport_research.kernels.nearest_source import nearest_source, rows_of_edges

__all__ = ["RANDOMISED_CUTS"]

_PIECES: Final = 600
_CUTS: Final = 40
"""Of each part. The paper has more; the share of a border is good to a tenth with these."""
_LEAST_SHARE: Final = 0.02
"""Cuts with less than this share of the part's area on a side are not taken."""
_NEAR: Final = 2.0
"""A border beside one of the two pieces costs this many times more than one half way. Chosen on
every sixteenth model, and so is what a cut is worth."""
_LEAST_WEIGHT: Final = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Pieces and their borders."""

    of_face: Int32
    area: Float64
    centres: Float64
    pairs: Int32
    length: Float64
    weight: Float64
    """What a border costs to cut: its length, less where it folds inwards."""


@dataclass(frozen=True, slots=True, eq=False)
class _Split:
    """A part's most consistent cut."""

    items: Int32
    near: Bool
    worth: float
    """Mean share of cuts on its borders, times the share of the body that it cuts off; negative
    where the part cannot be cut."""


def _prepare(body: Body) -> Cut:
    pieces = _pieces_of(body)
    rng = np.random.default_rng(body.seed)
    whole, _ = components(len(pieces.area), pieces.pairs)
    parts = [
        _best_split(pieces, np.flatnonzero(whole == one).astype(np.int32), rng)
        for one in range(int(whole.max()) + 1)
    ]

    def cut(k: int) -> Int32:
        # Splits do not depend on k: the first k - 1 of more are those of fewer.
        shown = list(parts) if k < len(parts) else parts
        while len(shown) < k:
            chosen = max(range(len(shown)), key=lambda at: shown[at].worth)
            split = shown[chosen]
            if split.worth < 0.0:
                break
            shown[chosen] = _best_split(pieces, split.items[split.near], rng)
            shown.append(_best_split(pieces, split.items[~split.near], rng))
        labels = np.zeros(len(pieces.area), np.int32)
        for number, part in enumerate(shown):
            labels[part.items] = number
        return labels[pieces.of_face]

    return cut


def _pieces_of(body: Body) -> _Pieces:
    of_face, count = paper_tree(body).cut_by_count(_PIECES)
    area = np.bincount(of_face, body.area, count).astype(np.float64)
    centres = (
        np.stack(
            [np.bincount(of_face, body.area * body.centres[:, axis], count) for axis in range(3)],
            axis=1,
        )
        / np.maximum(area, 1e-300)[:, None]
    )
    a, b = of_face[body.neighbours[0]].T
    across = a != b
    low, high = np.minimum(a, b)[across], np.maximum(a, b)[across]
    cells, cell = np.unique(low.astype(np.int64) * count + high, return_inverse=True)
    length = body.edge_lengths[across]
    inwards = np.maximum(-body.folds[across], 0.0)
    weight = length * np.maximum((1.0 - inwards / np.pi) ** PAPER_CONCAVITY, _LEAST_WEIGHT)
    pairs = np.stack(np.divmod(cells, count), axis=1).astype(np.int32)
    lengths, weights = (
        np.bincount(cell, values, len(cells)).astype(np.float64) for values in (length, weight)
    )
    return _Pieces(of_face, area, centres, pairs, lengths, weights)


def _best_split(pieces: _Pieces, items: Int32, rng: np.random.Generator) -> _Split:
    """Cut a part many times, and take the cut that the others agree with most."""
    none = _Split(items, np.ones(len(items), np.bool_), -1.0)
    if len(items) < 2:
        return none
    # (1) The part alone, numbered anew.
    at = np.full(len(pieces.area), -1, np.int32)
    at[items] = np.arange(len(items), dtype=np.int32)
    inside = (at[pieces.pairs] >= 0).all(axis=1)
    pairs = at[pieces.pairs[inside]]
    weight, length = pieces.weight[inside], pieces.length[inside]
    step = pieces.centres[items][pairs[:, 0]] - pieces.centres[items][pairs[:, 1]]
    rows = rows_of_edges(len(items), pairs, np.sqrt((step * step).sum(axis=1)))
    arcs = arcs_of_pairs(len(items), pairs)
    area = pieces.area[items]
    share = area / area.sum()
    scale = 1.0 / max(float(weight.max()), 1e-300)
    # (2) Cuts between two pieces, the second drawn among the far ones more often.
    sides, lesser = [], []
    for _ in range(_CUTS):
        source = int(rng.choice(len(items), p=share))
        away, _ = nearest_source(*rows, np.array([source], np.int32))
        away = np.where(np.isfinite(away), away, 0.0)
        chance = share * away
        if chance.sum() <= 0.0:
            return none
        target = int(rng.choice(len(items), p=chance / chance.sum()))
        back, _ = nearest_source(*rows, np.array([target], np.int32))
        part = away / np.maximum(away + back, 1e-300)
        middle = (part[pairs[:, 0]] + part[pairs[:, 1]]) / 2
        cost = weight * scale * (1.0 + _NEAR * (2.0 * middle - 1.0) ** 2)
        pull = np.zeros(len(items))
        # More than all borders together.
        pull[source], pull[target] = cost.sum() + 1.0, -cost.sum() - 1.0
        near = least_cut(arcs, cost, cost, pull)
        sides.append(near)
        lesser.append(float(min(share[near].sum(), share[~near].sum())))
    # (3) How often each border is cut; how far each cut lies on what is cut.
    on_cut = np.stack([near[pairs[:, 0]] != near[pairs[:, 1]] for near in sides])
    often = on_cut.mean(axis=0)
    cut_length = on_cut * length
    agreement = (cut_length * often).sum(axis=1) / np.maximum(cut_length.sum(axis=1), 1e-300)
    agreement[np.array(lesser) < _LEAST_SHARE] = -1.0
    # (4) Of small parts all cuts agree, for there are few: what is cut off counts by its area.
    worth = agreement * np.array(lesser) * float(area.sum() / pieces.area.sum())
    best = int(np.argmax(worth))
    return _Split(items, sides[best], float(worth[best]))


RANDOMISED_CUTS: Final = Cutter(
    "randomised-cuts",
    "Randomised Cuts",
    "Golovinskiy and Funkhouser 2008",
    takes_k=True,
    prepare=_prepare,
    thesis="RC",
    departs="600 pieces of the mesh in place of 4,000 faces of a simplified one; 40 cuts of a "
    "part; a cut's agreement counts by the share of the body that it cuts off; borders are not "
    "refined on the whole mesh.",
)
