"""How well one partition of a mesh's faces agrees with another.

The Rand error and the consistency errors compare *areas*: they count pairs of faces, or single
faces, on which two partitions disagree. The boundary score compares *lines*: how much of the true
border a found border follows, and how much of the found border is true.

All of them are exact sums over the table of common faces of every pair of labels, so they need no
sampling and cost one sort. (The boundary score is exact to a sixteenth of its distance.)

PURE: no I/O, no clock.

References
----------
W. M. Rand, "Objective criteria for the evaluation of clustering methods", JASA 66(336), 1971.
D. Martin et al., "A database of human segmented natural images and its application to evaluating
segmentation algorithms and measuring ecological statistics", ICCV 2001 (global and local
consistency error). X. Chen, A. Golovinskiy, T. Funkhouser, "A benchmark for 3D mesh segmentation",
SIGGRAPH 2009, section 4: the same measures on meshes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64, Int32, Int64

__all__ = [
    "BoundaryScore",
    "ConsistencyErrors",
    "border_edges",
    "boundary_score",
    "consistency_errors",
    "rand_error",
]


_PIECES: Final = 8
"""Border edges are cut into pieces no longer than the distance over this; distances are taken
between the middles of pieces, so a border counts as near up to distance x (1 - 1/16) for certain
and never beyond the distance."""


class ConsistencyErrors(NamedTuple):
    """Errors that forgive one partition being finer than the other."""

    gce: float
    """Global: one partition must be the finer one everywhere; 0..1."""
    lce: float
    """Local: either may be finer, face by face; 0..gce."""


@dataclass(frozen=True, slots=True)
class BoundaryScore:
    """Recall and precision of region borders, weighted by edge length."""

    recall: float
    """Share of the true border's length with a found border within the distance; 1 where there is
    no true border."""
    precision: float
    """Share of the found border's length with a true border within the distance; 1 where there is
    no found border."""
    true_length: float
    """Length of the true border, the vertices' unit."""
    predicted_length: float
    """Length of the found border, the vertices' unit."""


def rand_error(labels_a: AnyInt, labels_b: AnyInt, weights: Float64 | None = None) -> float:
    """One minus the Rand index: the share of face pairs on which two partitions disagree.

    A pair disagrees when its two faces lie in one part of one partition and in two parts of the
    other.

    Parameters
    ----------
    labels_a, labels_b : ndarray of shape (F,), integer
        Part of every face; any values, negative ones included.
    weights : ndarray of shape (F,), float64, optional
        Weight of every face (its area), >= 0. A pair weighs the product of its faces' weights.
        None: every face weighs 1, which is the published measure.

    Returns
    -------
    float
        0 (same partition) to 1. 0 for fewer than two faces. Exact without weights: whole numbers
        until the one division.

    Raises
    ------
    ValueError
        Arrays of different lengths, or weights that are negative or not finite.

    Examples
    --------
    Four faces; the pair (1, 2) is together in one only, and so is (2, 3).

    >>> rand_error(np.array([0, 0, 1, 1]), np.array([0, 5, 5, 9]))  # 3 of 6 pairs
    0.5
    """
    table = _common(labels_a, labels_b, weights)
    if weights is None:
        counts = [sizes.astype(np.int64) for sizes in (table.common, table.size_a, table.size_b)]
        both, in_a, in_b = (int(np.dot(sizes, sizes)) for sizes in counts)
        n = len(labels_a)
        return (in_a + in_b - 2 * both) / (n * (n - 1)) if n > 1 else 0.0
    pairs = float(weights.sum()) ** 2 - float(np.dot(weights, weights))
    # Summed by cell, not as the difference of three large squares: equal partitions give exactly 0.
    apart_b = float(np.dot(table.common, table.size_a[table.row] - table.common))
    apart_a = float(np.dot(table.common, table.size_b[table.column] - table.common))
    return max(apart_a + apart_b, 0.0) / pairs if pairs > 0.0 else 0.0


def consistency_errors(
    labels_a: AnyInt, labels_b: AnyInt, weights: Float64 | None = None
) -> ConsistencyErrors:
    """Global and local consistency error of two partitions.

    The refinement error of a face is the share of its part in one partition that lies outside its
    part in the other. Global: the smaller of the two means. Local: the mean of the smaller.

    Parameters
    ----------
    labels_a, labels_b, weights
        As in :func:`rand_error`.

    Returns
    -------
    ConsistencyErrors
        Both 0 where one partition refines the other (one part for everything included: never
        report them alone).

    Raises
    ------
    ValueError
        As in :func:`rand_error`.
    """
    table = _common(labels_a, labels_b, weights)
    total = float(table.common.sum())
    if total <= 0.0:
        return ConsistencyErrors(0.0, 0.0)
    size_a = np.maximum(table.size_a[table.row], np.finfo(np.float64).tiny)
    size_b = np.maximum(table.size_b[table.column], np.finfo(np.float64).tiny)
    outside_b = np.maximum(size_a - table.common, 0.0) / size_a
    outside_a = np.maximum(size_b - table.common, 0.0) / size_b
    mean = [float(np.dot(table.common, error)) / total for error in (outside_b, outside_a)]
    local = float(np.dot(table.common, np.minimum(outside_b, outside_a))) / total
    return ConsistencyErrors(min(mean), local)


def border_edges(labels: AnyInt, pairs: Int32, edges: Int32, scored: Bool | None = None) -> Int32:
    """Mesh edges between faces of different labels.

    Parameters
    ----------
    labels : ndarray of shape (F,), integer
        Part of every face.
    pairs, edges : ndarray of shape (P, 2), int32
        Result of :func:`~.adjacency.face_pairs`.
    scored : ndarray of shape (F,), bool, optional
        Only edges between two scored faces; None: all.

    Returns
    -------
    ndarray of shape (E, 2), int32
        Vertices of each edge, lower first, ascending; an edge of more than two faces once.
    """
    differs = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    if scored is not None:
        differs &= scored[pairs[:, 0]] & scored[pairs[:, 1]]
    borders: Int32 = np.unique(edges[differs], axis=0).reshape(-1, 2)
    return borders


def boundary_score(
    vertices: AnyFloat,
    pairs: Int32,
    edges: Int32,
    true_labels: AnyInt,
    predicted_labels: AnyInt,
    distance: float,
    *,
    scored: Bool | None = None,
) -> BoundaryScore:
    """Recall and precision of borders: how much of the true, of the predicted border is matched.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Positions.
    pairs, edges : ndarray of shape (P, 2), int32
        Result of :func:`~.adjacency.face_pairs`.
    true_labels, predicted_labels : ndarray of shape (F,), integer
        The two partitions.
    distance : float
        How far a border may lie from its counterpart, straight through space, in the vertices'
        unit. > 0. Two mean edge lengths forgive the steps of a border that follows triangles.
    scored : ndarray of shape (F,), bool, optional
        Faces whose true label is known. Borders to other faces are neither asked for nor held
        against the predicted ones. None: all.

    Returns
    -------
    BoundaryScore
        A border of the mesh itself is no border between parts.

    Raises
    ------
    ValueError
        Labels that are not one per face, or a distance that is not a positive number.
    """
    if not 0.0 < distance < np.inf:
        msg = f"distance is {distance}, expected a finite length above 0"
        raise ValueError(msg)
    if true_labels.shape != predicted_labels.shape or true_labels.ndim != 1:
        shapes = f"{true_labels.shape} and {predicted_labels.shape}"
        msg = f"labels have shapes {shapes}, expected two (F,)"
        raise ValueError(msg)
    longest = distance / _PIECES
    true_at, true_length = _middles(
        vertices, border_edges(true_labels, pairs, edges, scored), longest
    )
    predicted_at, predicted_length = _middles(
        vertices, border_edges(predicted_labels, pairs, edges, scored), longest
    )
    # What is predicted beside a face without truth may still follow a true border nearby.
    every_at, _ = _middles(vertices, border_edges(predicted_labels, pairs, edges), longest)
    return BoundaryScore(
        _share_near(true_at, true_length, every_at, distance),
        _share_near(predicted_at, predicted_length, true_at, distance),
        float(true_length.sum()),
        float(predicted_length.sum()),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Common:
    """Non-empty cells of the table of two partitions."""

    row: Int64
    """(C,) part of the first partition."""
    column: Int64
    """(C,) part of the second."""
    common: Float64
    """(C,) weight of the faces in both."""
    size_a: Float64
    """Weight of every part of the first partition."""
    size_b: Float64
    """Weight of every part of the second."""


def _common(labels_a: AnyInt, labels_b: AnyInt, weights: Float64 | None) -> _Common:
    if labels_a.shape != labels_b.shape or labels_a.ndim != 1:
        msg = f"labels have shapes {labels_a.shape} and {labels_b.shape}, expected two (F,)"
        raise ValueError(msg)
    if weights is not None:
        if weights.shape != labels_a.shape:
            msg = f"weights have shape {weights.shape}, expected {labels_a.shape}"
            raise ValueError(msg)
        if not (np.isfinite(weights) & (weights >= 0.0)).all():
            bad = int(np.flatnonzero(~(np.isfinite(weights) & (weights >= 0.0)))[0])
            msg = f"weight of face {bad} is {weights[bad]}, expected a finite number, 0 or more"
            raise ValueError(msg)
    dense_a = np.unique(labels_a, return_inverse=True)[1].astype(np.int64)
    dense_b = np.unique(labels_b, return_inverse=True)[1].astype(np.int64)
    width = int(dense_b.max()) + 1 if len(dense_b) else 1
    cells, cell = np.unique(dense_a * width + dense_b, return_inverse=True)
    common = np.bincount(cell, weights=weights, minlength=len(cells)).astype(np.float64)
    row, column = np.divmod(cells, width)
    size_a = np.bincount(row, weights=common).astype(np.float64)  # integer where there is no face
    size_b = np.bincount(column, weights=common).astype(np.float64)
    return _Common(row, column, common, size_a, size_b)


def _middles(vertices: AnyFloat, edges: Int32, longest: float) -> tuple[Float64, Float64]:
    """Middles (M, 3) and lengths (M,) of equal pieces of the edges, none above ``longest``."""
    start = vertices[edges[:, 0]].astype(np.float64)
    along = vertices[edges[:, 1]].astype(np.float64) - start
    length = np.sqrt((along * along).sum(axis=1))
    pieces = np.maximum(np.ceil(length / longest), 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), pieces)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    at = start[edge] + along[edge] * ((number + 0.5) / pieces[edge])[:, None]
    return at, (length / pieces)[edge]


def _share_near(at: Float64, length: Float64, others: Float64, distance: float) -> float:
    """Share of the length whose pieces have another one within the distance."""
    total = float(length.sum())
    if total <= 0.0:
        return 1.0
    if len(others) == 0:
        return 0.0
    near, _ = cKDTree(others).query(at, distance_upper_bound=distance)
    return float(length[np.isfinite(near)].sum()) / total
