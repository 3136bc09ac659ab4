"""Open edges, holes and non-manifold edges of a triangle mesh.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import AnyFloat, Float64, Int32

__all__ = ["EdgeFacts", "OpenLoops", "edge_facts", "open_loops"]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeFacts:
    """Counts of open, non-manifold and inconsistently wound edges of a mesh."""

    edges: int
    """Number of distinct edges."""
    open_edges: Int32
    """(E, 2) edges with one face, in that face's direction."""
    non_manifold: int
    """Edges with three faces or more."""
    against: int
    """Edges of two faces that run through them in one direction: one face is turned over."""
    repeated_faces: int
    """Faces with the corners of an earlier one, or with two equal corners."""
    euler: int
    """Vertices used - edges + faces; 2 for one closed body without handles."""


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoops:
    """Open edges that hang together; L groups, each the rim of a hole or an outline."""

    group: Int32
    """(E,) group of each open edge."""
    length_m: Float64
    """(L,) summed length."""
    area_m2: Float64
    """(L,) area of the cone from the rim to its centre: of a flat round hole exactly the hole."""
    extent_m: Float64
    """(L,) longest side of the rim's box."""


def edge_facts(faces: Int32) -> EdgeFacts:
    """Count faces along every edge.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int32

    Returns
    -------
    EdgeFacts
        Repeated faces and faces with two equal corners do not count as faces.

    Examples
    --------
    >>> facts = edge_facts(np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    >>> len(facts.open_edges), facts.non_manifold, facts.euler
    (4, 0, 1)
    """
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    if len(proper):
        _, first = np.unique(np.sort(proper, axis=1), axis=0, return_index=True)
        proper = proper[np.sort(first)]
    half = np.concatenate([proper[:, [0, 1]], proper[:, [1, 2]], proper[:, [2, 0]]]).astype(
        np.int64
    )
    forward = half[:, 0] < half[:, 1]
    span = int(half.max(initial=0)) + 1
    keys = half.min(axis=1) * span + half.max(axis=1)
    _, first, inverse, count = np.unique(
        keys, return_index=True, return_inverse=True, return_counts=True
    )
    ahead = np.bincount(inverse, weights=forward, minlength=len(count))
    return EdgeFacts(
        edges=len(count),
        open_edges=half[first[count == 1]].astype(np.int32),
        non_manifold=int((count > 2).sum()),
        against=int(((count == 2) & (ahead != 1)).sum()),
        repeated_faces=len(faces) - len(proper),
        euler=len(np.unique(proper)) - len(count) + len(proper),
    )


def open_loops(vertices: AnyFloat, open_edges: Int32) -> OpenLoops:
    """Put open edges that share vertices together.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    open_edges : ndarray of shape (E, 2), int32

    Returns
    -------
    OpenLoops
        In the order of their first edge. Two holes that meet in a vertex count as one.
    """
    if len(open_edges) == 0:
        nothing = np.zeros(0)
        return OpenLoops(np.zeros(0, np.int32), nothing, nothing, nothing)
    # (1) Components of the open edges, numbered by their first edge.
    used, dense = np.unique(open_edges, return_inverse=True)
    dense = dense.reshape(-1, 2)
    links = coo_matrix(
        (np.ones(len(dense), np.int8), (dense[:, 0], dense[:, 1])), shape=(len(used), len(used))
    )
    _, label = connected_components(links, directed=False)
    _, first, group = np.unique(label[dense[:, 0]], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")
    group = rank[group]
    # (2) Length, middle, and area: the sum of the triangles from the middle to every edge.
    positions = np.asarray(vertices, np.float64)[used]
    start, end = positions[dense[:, 0]], positions[dense[:, 1]]
    count = len(first)
    edges = np.bincount(group, minlength=count)
    centre = np.stack(
        [np.bincount(group, (start + end)[:, axis] / 2, count) / edges for axis in range(3)], axis=1
    )
    cone = np.cross(start - centre[group], end - centre[group])
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for ends in (start, end):
        np.minimum.at(low, group, ends)
        np.maximum.at(high, group, ends)
    return OpenLoops(
        group.astype(np.int32),
        np.bincount(group, np.linalg.norm(end - start, axis=1), count).astype(np.float64),
        np.bincount(group, np.linalg.norm(cone, axis=1) / 2, count).astype(np.float64),
        (high - low).max(axis=1),
    )
