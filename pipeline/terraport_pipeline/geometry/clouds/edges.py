"""Where a reconstructed surface ends: at the end of the samples' support and of their footprint.

A Poisson surface runs on beyond its samples. Two rules cut it, both along smooth lines through the
faces (:mod:`~terraport_pipeline.geometry.mesh.clip`), not by taking whole faces away:

1. *Support.* A place is weak where its support ratio passes a threshold read from the histogram
   (:mod:`~terraport_pipeline.geometry.clouds.support`). Connected weak places go if any of them
   passes the larger bound; if none does they are a gap that chance left between samples, and stay.
   (Two thresholds, as edge detectors have them: one alone either riddles thin ground with holes or
   leaves a wide hem.)
2. *Footprint.* What lies outside the cloud's outline, seen from above, goes
   (:mod:`~terraport_pipeline.geometry.clouds.footprint`). It draws the outer border tighter than
   rule 1 can, and says nothing of walls; there rule 1 alone holds.

Everything that depends on the whole cloud is in :class:`EdgeRule`, so that pieces of one surface
are cut alike.

PURE: no I/O, no clock.

References
----------
J. Canny, "A computational approach to edge detection", IEEE PAMI 8(6), 1986: the two thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.geometry.mesh.clip import clip_by_field

__all__ = ["EdgeRule", "edge_field", "trim_edges"]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeRule:
    """How far a surface goes; one for a whole scene."""

    threshold: float
    """Support ratio above which a place is weak."""
    largest: float
    """Support ratio that no place may pass."""
    spacing_m: float
    """The cloud's areal spacing."""
    footprint: Footprint | None
    """None leaves rule 2 out."""
    outward_m: float = 0.0
    """The surface ends this much farther out than both rules say. For the base, which is thinned
    afterwards: without it the straight pieces of its border would cut off what the detail's border
    rounds, and there would be no base below that."""


def edge_field(vertices: Float32, faces: Int32, ratio: Float32, rule: EdgeRule) -> Float32:
    """Metres inside the surface's end, by the stricter of both rules.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    ratio : ndarray of shape (V,), float32
        Support ratio of the vertices.
    rule : EdgeRule

    Returns
    -------
    ndarray of shape (V,), float32
        Negative where the surface ends. A piece of a surface gives the whole's values, except where
        a weak place reaches the piece's own border: there it may be kept by mistake.
    """
    forgiven = _forgiven(faces, ratio, rule)
    limit = np.where(forgiven, np.float32(rule.largest), np.float32(rule.threshold))
    field_m = ((limit - ratio) * np.float32(rule.spacing_m)).astype(np.float32)
    if rule.footprint is not None:
        np.minimum(field_m, rule.footprint.margin_m(vertices), out=field_m)
    field_m += np.float32(rule.outward_m)
    return field_m


def trim_edges(
    vertices: Float32, faces: Int32, ratio: Float32, rule: EdgeRule
) -> tuple[Float32, Int32]:
    """Cut a surface where :func:`edge_field` is zero; see there and `clip_by_field`."""
    return clip_by_field(vertices, faces, edge_field(vertices, faces, ratio, rule))


def _forgiven(
    faces: Int32, ratio: Float32, rule: EdgeRule
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Weak vertices that are connected to none beyond the largest ratio."""
    weak = ratio > rule.threshold
    rows = np.flatnonzero(weak)
    if not len(rows):
        return weak
    number = np.cumsum(weak, dtype=np.int64) - 1
    links = [
        faces[weak[faces[:, start]] & weak[faces[:, end]]][:, [start, end]]
        for start, end in ((0, 1), (1, 2), (2, 0))
    ]
    pairs = number[np.concatenate(links)]
    graph = coo_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(rows),) * 2
    )
    count, label = connected_components(graph, directed=False)
    farthest = np.zeros(count, dtype=np.float32)
    np.maximum.at(farthest, label, ratio[rows])
    forgiven = np.zeros(len(ratio), dtype=bool)
    forgiven[rows[farthest[label] <= rule.largest]] = True
    return forgiven
