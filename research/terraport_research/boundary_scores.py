"""How well the borders of one partition of a mesh's faces follow those of another.

The boundary score compares *lines*: how much of the true border a found border follows, and how
much of the found border is true. It is exact to a sixteenth of its distance. (Areas are compared
by :mod:`.segmentation_scores`.)

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64, Int32

__all__ = ["BoundaryScore", "border_edges", "boundary_score"]


_PIECES: Final = 8
"""Border edges are cut into pieces no longer than the distance over this; distances are taken
between the middles of pieces, so a border counts as near up to distance x (1 - 1/16) for certain
and never beyond the distance."""


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
