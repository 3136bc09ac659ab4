"""Which way the charts of a surface without photos face: few charts instead of many small ones.

Every face goes with the axis that its normal is nearest to, and connected faces of one axis are a
chart. On a noisy surface that leaves thousands of charts of a face or two, each with gutters and
seams of its own: more than the image of Caliterra's base has room for, so that a twenty-fifth of
its surface got one flat colour a face. So small charts join the neighbour with the longest common
border, if that looks at all of their faces. They are drawn a little squeezed there.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components

__all__ = ["axis_of", "facing_labels"]

_ROUNDS: Final = (1, 2, 4, 8, 16, 32, 64)
"""Most faces of the charts that join, round by round."""

_LEAST_COSINE: Final = 0.2
"""Between a face that joins and the axis it is seen along: five times as few texels, at worst."""

_AXES: Final = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
"""(6, 3): +x, -x, +y, -y, +z, -z."""


def facing_labels(normal: Float64, pairs: Int32) -> Int32:
    """Give each face the axis that its chart looks along, as a negative number.

    Parameters
    ----------
    normal : ndarray of shape (F, 3), float64
        Of any length; zero for a face without area.
    pairs : ndarray of shape (P, 2), int32
        Faces with a common edge.

    Returns
    -------
    ndarray of shape (F,), int32
        -1 to -6; see :func:`axis_of`. Of equally long borders the first axis counts, of equally
        near axes x, then y.
    """
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    cosine = (normal / length[:, None]) @ _AXES.T
    facing = np.argmax(cosine, axis=1)
    for most in _ROUNDS:
        chart, count = components(len(facing), pairs, labels=facing.astype(np.int32))
        size = np.bincount(chart, minlength=count)
        # (1) Borders of small charts with larger ones: those stay as they are in this round, so no
        # two charts change places. Of equal ones the one with the lower number stays.
        ends = np.concatenate([pairs, pairs[:, ::-1]])
        own, other = chart[ends[:, 0]], chart[ends[:, 1]]
        stays = (size[other] > size[own]) | ((size[other] == size[own]) & (other < own))
        rows = (own != other) & (size[own] <= most) & stays
        key = own[rows].astype(np.int64) * 6 + facing[ends[rows, 1]]
        border = np.bincount(key, minlength=count * 6).reshape(count, 6)
        # (2) An axis is allowed where it looks at every face of the chart.
        least = np.full((count, 6), np.inf)
        np.minimum.at(least, chart, cosine)
        border[least < _LEAST_COSINE] = 0
        best = np.argmax(border, axis=1)
        joins = border[np.arange(count), best] > 0
        facing = np.where(joins[chart], best[chart], facing)
    labels: Int32 = (-1 - facing).astype(np.int32)
    return labels


def axis_of(label: Int32) -> Float64:
    """Look up the axis of a label: (K, 3) unit vectors for (K,) labels of :func:`facing_labels`."""
    axes: Float64 = _AXES[-1 - label]
    return axes
