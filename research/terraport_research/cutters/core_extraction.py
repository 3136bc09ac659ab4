"""Core extraction: a body without its core falls into the parts that its feature points are on.

1. The body is thinned; shortest ways along its edges, from everywhere to everywhere, are brought
   into space as straight distances (scaling of several dimensions): limbs stretch, poses vanish.
2. *Feature points* are farther from everything, along the surface, than what lies around them, and
   lie at the convex hull of what was stretched.
3. *The core* is what is on the hull once all is mirrored at a sphere around it. It grows by what is
   most central where several feature points still hang together, until each is in a part of its
   own. Parts are cut again in the same way.
4. On the whole mesh borders move to the least cut nearby, cheap along folds inwards.

References
----------
S. Katz, G. Leifman, A. Tal, "Mesh segmentation using feature point and core extraction", The Visual
Computer 21(8), 2005.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import eigsh
from scipy.spatial import ConvexHull, QhullError, cKDTree

from terraport_payload.types import Bool, Float64, Int32, Int64
from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.errors import EngineError
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.regions.small_pieces import absorb_small
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.kernels.graph_cut import expand_labels
from terraport_research.kernels.nearest_source import nearest_source, rows_of_edges

__all__ = ["CORE_EXTRACTION"]

_FACES: Final = 2000
"""Of the thinned body: distances of all its vertices from each other are a table."""
_AGGRESSION: Final = 7.0
_AROUND: Final = 0.15
"""Of the longest way: a feature point is farthest from everything within this."""
_AT_HULL: Final = 0.05
"""Of the longest way, along the surface: this near to a corner of the hull is at it."""
_LEAST_PART: Final = 0.005
"""Of the area of what is cut: a feature point whose part would be smaller is none. Without it two
corners of a tail let the core grow over all else. On every fourth model a mean 1 - RI of .186; .182
with .01, .170 with .02, which is farther from the published row (.211) and fails more often."""
_DEPTH: Final = 3
_LEAST_CUT: Final = 0.02
"""Of the body's area: smaller parts are not cut again."""
_LEVELS: Final = 64
"""Steps in which the core grows."""
_CRUMB: Final = 0.003
"""Of the area: smaller pieces, left where labels went back to the whole mesh, join a neighbour."""
_BAND: Final = 0.05
"""Of the root of the area: borders move no farther."""
_OUTWARDS: Final = 0.1
"""Share of a fold outwards that counts."""

_Ways = Any
"""A csr_array: scipy says nothing of its types."""


class _Thin(NamedTuple):
    """The thinned body."""

    vertices: Float64
    faces: Int32
    ways: _Ways
    """(V, V) lengths of the edges."""
    share: Float64
    """(V,) of the area."""


def _prepare(body: Body) -> Cut:
    thin = _thinned(body)
    part = _parts(thin)
    # Of a face's corners two that agree; where none do, the first.
    a, b, c = part[thin.faces].T
    of_face = np.where(b == c, b, a)
    _, near = cKDTree(thin.vertices[thin.faces].mean(axis=1)).query(
        body.vertices32[body.faces].mean(axis=1)
    )
    labels = absorb_small(
        of_face[near].astype(np.int32),
        body.neighbours,
        body.vertices,
        body.area,
        _CRUMB * float(body.area.sum()),
    )
    labels, _ = number_by_first(labels)
    labels = _moved_to_folds(body, labels)

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return labels

    return cut


def _thinned(body: Body) -> _Thin:
    points, faces = decimate(
        body.vertices32, body.faces, max_faces=_FACES, aggression=_AGGRESSION
    )  # fmt: skip
    used, dense = np.unique(faces, return_inverse=True)
    vertices, faces = points[used].astype(np.float64), dense.reshape(-1, 3).astype(np.int32)
    n = len(vertices)
    both = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.unique(np.sort(both, axis=1), axis=0)
    step = vertices[edges[:, 0]] - vertices[edges[:, 1]]
    length = np.tile(np.sqrt((step * step).sum(axis=1)), 2)
    ends = np.concatenate([edges, edges[:, ::-1]]).T
    ways = sparse.coo_array((length, (ends[0], ends[1])), shape=(n, n)).tocsr()
    pieces, _ = connected_components(ways, directed=False)
    if pieces != 1:
        raise EngineError(f"the body is of {pieces} pieces; core extraction needs one")
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.sqrt((normal * normal).sum(axis=1))
    share = np.bincount(faces.ravel(), np.repeat(area, 3), n)
    return _Thin(vertices, faces, ways, share / max(float(share.sum()), 1e-300))


def _parts(thin: _Thin) -> Int64:
    """(V,) part of every vertex: 0 the core."""
    part = np.zeros(len(thin.vertices), np.int64)
    waiting, count = [(np.arange(len(part)), 0)], 1
    while waiting:
        items, depth = waiting.pop(0)
        # A part ends where it was cut: its own ends are those all of whose neighbours are in it.
        inside = np.zeros(len(part))
        inside[items] = 1.0
        outside = (thin.ways != 0)[items] @ (1.0 - inside)
        split = _split(thin.ways[items][:, items], thin.share[items], outside == 0.0)
        for one in range(1, int(split.max()) + 1):
            chosen = items[split == one]
            part[chosen] = count
            count += 1
            if depth + 1 < _DEPTH and thin.share[chosen].sum() >= _LEAST_CUT:
                waiting.append((chosen, depth + 1))
    if count == 1:
        raise EngineError("the body has no two feature points; core extraction cannot cut it")
    return part


def _split(ways: _Ways, share: Float64, whole: Bool) -> Int64:
    """Core (0) and parts (1..) of what hangs together; all 0 without two feature points."""
    n = len(share)
    nothing = np.zeros(n, np.int64)
    if n < 12:  # a hull in space, and something within it
        return nothing
    away = dijkstra(ways, directed=False)
    if not np.isfinite(away).all():
        return nothing
    away, share = (away + away.T) / 2, share / share.sum()
    remote = away @ share  # mean way to everything: least in the middle
    stretched = _stretched(away)
    stretched -= share @ stretched
    radius = np.sqrt((stretched * stretched).sum(axis=1))
    mirrored = stretched * ((2 * radius.max() - radius) / np.maximum(radius, 1e-300))[:, None]
    try:
        hull, core_hull = (
            ConvexHull(places, qhull_options="QJ").vertices for places in (stretched, mirrored)
        )
    except QhullError:  # all in one plane
        return nothing
    around = np.where(away < _AROUND * away.max(), remote[None, :], -1.0).max(axis=1)
    at_hull = away[:, hull].min(axis=1) <= _AT_HULL * away.max()
    features = np.flatnonzero((around <= remote) & at_hull & whole)
    while len(features) > 1:
        labels = _apart(ways, remote, core_hull, features)
        size = np.bincount(labels, share, int(labels.max()) + 1)
        least = np.where(labels[features] > 0, size[labels[features]], 0.0)
        if least.min() >= _LEAST_PART:
            return labels
        features = np.delete(features, least.argmin())
    return nothing


def _stretched(away: Float64) -> Float64:
    """Classical scaling (Torgerson) of distances (V, V) to places (V, 3)."""
    square = away * away
    mean = square.mean(axis=0)
    products = -0.5 * (square - mean - mean[:, None] + mean.mean())
    # The start is set: eigsh draws it by lot otherwise.
    values, vectors = eigsh(products, k=3, v0=np.ones(len(away)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _apart(ways: _Ways, remote: Float64, core_hull: Int32, features: Int64) -> Int64:
    """Let the core (0) grow until every feature point has a part of its own (1..)."""
    n = len(remote)
    core = np.zeros(n, np.bool_)
    core[core_hull] = True
    core[features] = False
    labels = np.zeros(n, np.int64)
    for level in (-np.inf, *np.quantile(remote, np.linspace(0.0, 1.0, _LEVELS + 1))):
        rest = np.flatnonzero(~core)
        _, piece = connected_components(ways[rest][:, rest], directed=False)
        of_item = np.full(n, -1)
        of_item[rest] = piece
        held = np.bincount(of_item[features], minlength=n)
        shared = (of_item >= 0) & (held[of_item] > 1)
        if not shared.any():
            break
        shared[features] = False
        core |= shared & (remote <= level)
    for number, at in enumerate(of_item[features], 1):
        if held[at] == 1:
            labels[of_item == at] = number
    return labels


def _moved_to_folds(body: Body, labels: Int32) -> Int32:
    """Move borders within a band to where a cut costs least."""
    pairs = body.neighbours[0]
    step = body.centres[pairs[:, 0]] - body.centres[pairs[:, 1]]
    rows = rows_of_edges(len(labels), pairs, np.sqrt((step * step).sum(axis=1)))
    beside = np.unique(pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]).astype(np.int32)
    if len(beside) == 0:
        return labels
    distance, _ = nearest_source(*rows, beside)
    band = distance < _BAND * np.sqrt(float(body.area.sum()))
    for label in range(int(labels.max()) + 1):  # half of a part stays, at least
        own = labels == label
        if band[own].all():
            band[own & (distance >= np.median(distance[own]))] = False
    fold = np.where(body.folds < 0.0, 1.0, _OUTWARDS) * (1.0 - np.cos(body.folds))
    weight = body.edge_lengths / max(float(body.edge_lengths.mean()), 1e-300)
    weight = weight / (1.0 + fold / max(float(fold.mean()), 1e-300))
    number = np.full(len(labels), -1, np.int32)
    number[band] = np.arange(np.count_nonzero(band), dtype=np.int32)
    side = number[pairs]
    # What lies beside the band has its label: any other costs that edge.
    costs = np.zeros((int(band.sum()), int(labels.max()) + 1))
    for one, other in ((0, 1), (1, 0)):
        rim = (side[:, one] >= 0) & (side[:, other] < 0)
        np.add.at(costs, side[rim, one], weight[rim][:, None])
        np.add.at(costs, (side[rim, one], labels[pairs[rim, other]]), -weight[rim])
    within = (side >= 0).all(axis=1)
    moved = labels.copy()
    moved[band] = expand_labels(labels[band], costs, side[within], weight[within])
    return moved


CORE_EXTRACTION: Final = Cutter(
    "core-extraction",
    "Core Extraction",
    "Katz, Leifman, Tal 2005",
    takes_k=False,
    prepare=_prepare,
    thesis="COE",
    departs="Distances by classical scaling; the core grows by mean distance; a feature point "
    "whose part would be below .5 % of the area is none; borders move within a band for all parts "
    "at once. Bodies in pieces, and without two feature points, fail.",
)
