"""Cut a surface along the edges of a rectangle on the ground, exactly.

Unlike :mod:`.clip`, which follows a field and spares slivers, every cut lies where the rectangle's
edge is: neighbouring rectangles meet without gap and overlap.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64

__all__ = ["BoxClip", "clip_to_box"]

_SNAP_M: Final = 1e-10
"""A vertex that lies so near an edge of the box lies on it: one that another edge made may miss
its place there by rounding, and would get a twin."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxClip:
    """A surface that was cut."""

    values: Float64
    """(V', K) of every vertex, the position first."""
    faces: Int32
    """(F', 3) wound as before."""
    face_before: Int64
    """(F',) the face that each is part of."""


def clip_to_box(values: Float64, faces: Int32, box: tuple[float, float, float, float]) -> BoxClip:
    """Keep what lies above and below a rectangle of the ground.

    Parameters
    ----------
    values : ndarray of shape (V, K), float64
        x, y, z (metres, scene frame), then whatever is linear within a face.
    faces : ndarray of shape (F, 3), int32
    box : (float, float, float, float)
        Least x, least z, greatest x, greatest z. Its edges are within.

    Returns
    -------
    BoxClip
        No vertex is outside, none is unused; no face is seen from above as a line on an edge of the
        box unless it was so before.

    Notes
    -----
    I. E. Sutherland and G. W. Hodgman, "Reentrant polygon clipping" (1974), for triangles, one edge
    of the rectangle after the other. The faces on both sides of an edge share its new vertex.

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [0, 0, 4], [4, 0, 0]])
    >>> cut = clip_to_box(corners, np.array([[0, 1, 2]], np.int32), (0.0, 0.0, 9.0, 2.0))
    >>> float(cut.values[:, 2].max()), len(cut.faces)
    (2.0, 2)
    """
    values = values.copy()
    triangles, origin = faces.astype(np.int64), np.arange(len(faces), dtype=np.int64)
    for axis, limit, sign in (
        (0, box[0], 1.0),
        (2, box[1], 1.0),
        (0, box[2], -1.0),
        (2, box[3], -1.0),
    ):
        values[np.abs(values[:, axis] - limit) <= _SNAP_M, axis] = limit
        inside = sign * (values[:, axis] - limit) >= 0
        kept = inside[triangles].sum(axis=1)
        if (kept == 3).all():
            continue
        # A face that only touches the edge, from outside, has no part within.
        beyond = sign * (values[:, axis] - limit) > 0
        kept[~beyond[triangles].any(axis=1) & (kept < 3)] = 0
        values, triangles, origin = _cut(values, triangles, origin, inside, kept, axis, limit)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return BoxClip(values[used], renumbered.reshape(-1, 3).astype(np.int32), origin)


def _cut(
    values: Float64,
    triangles: Int64,
    origin: Int64,
    inside: Bool,
    kept: Int64,
    axis: int,
    limit: float,
) -> tuple[Float64, Int64, Int64]:
    """Cut along one edge of the box; `kept` corners of every face are within."""
    # (1) Faces that the edge passes, turned so that the odd corner comes first.
    passed = (kept == 1) | (kept == 2)
    crossed, crossed_origin = triangles[passed], origin[passed]
    alone = kept[passed] == 1
    odd = np.argmax(inside[crossed] == alone[:, None], axis=1)
    rows = np.arange(len(crossed))
    first, second, third = (crossed[rows, (odd + step) % 3] for step in range(3))
    # (2) A new vertex on each mesh edge that is cut, numbered by that edge.
    ends = np.concatenate([np.stack([first, second], 1), np.stack([first, third], 1)])
    edges, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    number = number.reshape(-1)
    a, b = values[edges[:, 0]], values[edges[:, 1]]
    share = (limit - a[:, axis]) / (b[:, axis] - a[:, axis])
    between = a + share[:, None] * (b - a)
    between[:, axis] = limit
    # Where an end lies on the limit already, it is the cut.
    new = np.arange(len(values), len(values) + len(edges))
    for end in (0, 1):
        on_limit = values[edges[:, end], axis] == limit
        new[on_limit] = edges[on_limit, end]
    number = new[number]
    # (3) A corner that stays alone leaves a triangle, one that goes a quadrilateral.
    near, far = number[: len(crossed)], number[len(crossed) :]
    lone = np.stack([first, near, far], axis=1)[alone]
    lower = np.stack([near, second, third], axis=1)[~alone]
    upper = np.stack([near, third, far], axis=1)[~alone]
    whole = kept == 3
    pieces = np.concatenate([triangles[whole], lone, lower, upper])
    parents = np.concatenate(
        [origin[whole], crossed_origin[alone], crossed_origin[~alone], crossed_origin[~alone]]
    )
    solid = (pieces != np.roll(pieces, 1, axis=1)).all(axis=1)
    return np.concatenate([values, between]), pieces[solid], parents[solid]
