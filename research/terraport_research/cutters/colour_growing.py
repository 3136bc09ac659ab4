"""Region growing on RGB: like neighbours grow together, small regions join their like.

Faces stand for the points of the paper, at their middles, in the mean colour of their corners.

1. *Growing.* A face's region takes in those of its nearest faces whose colour is like its own
   (Euclidean in RGB), and goes on from them.
2. *Merging.* A region below a size joins the most similar one that it touches: first only where
   their mean colours are alike, again and again, then what is left wherever it is.

Departs from the paper: nearness counts both ways, so that no order of faces changes the result.

References
----------
Q. Zhan, Y. Liang, Y. Xiao, "Color-based segmentation of point clouds", ISPRS Workshop Laser
Scanning 2009; the thesis, section 2.6.3.2.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["COLOUR_GROWING", "join_similar"]

_NEIGHBOURS: Final = 8
_POINT_DIFFERENCE: Final = 6.0
_REGION_DIFFERENCE: Final = 16.0
"""Of 255 levels; both chosen on the procedural quarries that the engines were tuned on."""
_LEAST_SHARE: Final = 0.002
"""Of all faces."""
_ROUNDS: Final = 64
"""At least half of the regions that can join do so in each."""


def _prepare(body: Body) -> Cut:
    colours = body.face_colours
    pairs = body.nearest_faces(_NEIGHBOURS)
    step = colours[pairs[:, 0]] - colours[pairs[:, 1]]
    alike = (step * step).sum(axis=1) < _POINT_DIFFERENCE**2
    grown, _ = components(len(colours), pairs[alike])
    least = int(np.ceil(_LEAST_SHARE * len(colours)))
    for difference in (_REGION_DIFFERENCE, np.inf):
        grown = join_similar(grown, colours, pairs, least, difference)

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return grown

    return cut


def join_similar(
    labels: Int32, colours: Float64, pairs: Int32, least: int, difference: float
) -> Int32:
    """Let small regions join the most similar neighbour, while one is similar enough.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        0..; every label is used.
    colours : ndarray of shape (F, 3), float64
    pairs : ndarray of shape (P, 2), int32
        Faces whose regions touch.
    least : int
        Regions below this many faces are small.
    difference : float
        Mean colours nearer than this are similar.

    Returns
    -------
    ndarray of shape (F,), int32
        Numbered by first face. Of neighbours equally similar the one of the lowest number is
        joined.
    """
    for _ in range(_ROUNDS):
        count = int(labels.max()) + 1 if len(labels) else 0
        size = np.bincount(labels, minlength=count)
        total = np.stack([np.bincount(labels, colours[:, c], count) for c in range(3)], axis=1)
        mean = total / np.maximum(size, 1)[:, None]
        side = np.sort(labels[pairs].astype(np.int64), axis=1)
        cells = np.unique(side[side[:, 0] != side[:, 1]] @ np.array([count, 1]))
        touching = np.stack(np.divmod(cells, max(count, 1)), axis=1)
        step = mean[touching[:, 0]] - mean[touching[:, 1]]
        apart = np.sqrt((step * step).sum(axis=1))
        # Every small region points at one other: the groups that hang together hold one large
        # region at most.
        near = np.flatnonzero(apart < difference)
        both = np.concatenate([touching[near], touching[near][:, ::-1]])
        both_apart = np.tile(apart[near], 2)
        small = size[both[:, 0]] < least
        both, both_apart = both[small], both_apart[small]
        order = np.lexsort((both[:, 1], both_apart, both[:, 0]))
        both = both[order]
        first = np.concatenate([[True], both[1:, 0] != both[:-1, 0]])[: len(both)]
        if not first.any():
            break
        joined, _ = components(count, both[first].astype(np.int32))
        labels = joined[labels]
    return labels


COLOUR_GROWING: Final = Cutter(
    "colour-growing",
    "Region growing on RGB",
    "Zhan, Liang, Xiao 2009",
    takes_k=False,
    prepare=_prepare,
    departs="Faces for points; nearness counts both ways.",
)
