"""How densely a cloud samples its surface.

Two measures, both distances in metres along the surface:

*median spacing*
    Median distance to the nearest other sample. Small where scans overlap; right for "how fine is
    the finest".
*areal spacing*
    Side of the square that one sample stands for. From the disk that holds a point's k nearest
    samples: ``sqrt(pi / k) * r_k``, and of that the median. Robust against overlapping scans and
    against clusters; it is what the depth of a reconstruction should follow.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Int32

__all__ = [
    "Neighbours",
    "Spacing",
    "areal_from_radius",
    "estimate_spacing",
    "nearest_neighbours",
    "remaining_neighbours",
]

_CHUNK = 200_000
"""Points per neighbour query: 200 k x 17 neighbours x 16 B = 54 MB of scratch."""


@dataclass(frozen=True, slots=True)
class Neighbours:
    """The k nearest other samples of every point."""

    indices: Int32
    """(N, k) point indices, nearest first."""
    distances: Float32
    """(N, k) metres."""


@dataclass(frozen=True, slots=True)
class Spacing:
    """A cloud's sampling density as distances."""

    median_m: float
    areal_m: float
    local_m: Float32
    """(N,) areal spacing around each point."""


def nearest_neighbours(
    points: AnyFloat,
    k: int,
    *,
    workers: int = -1,
    advance: Callable[[float], None] = lambda _: None,
) -> Neighbours:
    """Find the `k` nearest other points of every point.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        Metres, any frame.
    k : int
        Neighbours wanted; N - 1 are given where the cloud is smaller.
    workers : int
        Threads; -1 uses all cores. The answer does not depend on it.
    advance : callable
        Told the points done since its last call.

    Returns
    -------
    Neighbours
        Sorted by distance. A point is never its own neighbour; of points at one place one stands
        for itself.

    Raises
    ------
    ValueError
        Fewer than two points.
    """
    if len(points) < 2:
        raise ValueError(f"received {len(points)} points; neighbours need at least 2")
    tree = cKDTree(points, balanced_tree=False)
    k = min(k, len(points) - 1)
    everyone = np.arange(len(points))
    return _query(tree, points, everyone, k, workers, advance)


def remaining_neighbours(
    points: AnyFloat,
    neighbours: Neighbours,
    removed: Bool,
    *,
    workers: int = -1,
) -> Neighbours:
    """Update neighbours after some points were taken out.

    Only points that lost a neighbour are looked up again.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        All points, as given to :func:`nearest_neighbours`.
    neighbours : Neighbours
        Of all points.
    removed : ndarray of shape (N,), bool
    workers : int
        Threads; the answer does not depend on it.

    Returns
    -------
    Neighbours
        Of the points that stay, numbered without the others.
    """
    stays = ~removed
    rest = points[stays]
    k = min(neighbours.indices.shape[1], len(rest) - 1)
    number = np.cumsum(stays, dtype=np.int64) - 1
    old = neighbours.indices[stays, :k]
    indices = number[old].astype(np.int32)
    distances = neighbours.distances[stays, :k].copy()
    lost = np.flatnonzero(removed[old].any(axis=1))
    if len(lost):
        tree = cKDTree(rest, balanced_tree=False)
        updated = _query(tree, rest, lost, k, workers)
        indices[lost] = updated.indices
        distances[lost] = updated.distances
    return Neighbours(indices, distances)


def areal_from_radius(radius_m: AnyFloat, k: int) -> Float32:
    """Spacing of samples of which `k` lie in a disk of `radius_m`.

    Examples
    --------
    >>> float(areal_from_radius(np.array([1.0]), 4)[0])
    0.8862269520759583
    """
    spacing_m: Float32 = (np.sqrt(np.pi / k) * np.asarray(radius_m)).astype(np.float32)
    return spacing_m


def estimate_spacing(neighbours: Neighbours) -> Spacing:
    """Measure the spacing of a cloud from its neighbours.

    Parameters
    ----------
    neighbours : Neighbours
        Of all points, k >= 1; 8 to 16 give a steady areal spacing.

    Returns
    -------
    Spacing
        Metres.
    """
    k = neighbours.indices.shape[1]
    local_m = areal_from_radius(neighbours.distances[:, -1], k)
    return Spacing(
        median_m=float(np.median(neighbours.distances[:, 0])),
        areal_m=float(np.median(local_m)),
        local_m=local_m,
    )


def _query(
    tree: cKDTree,
    points: AnyFloat,
    wanted: AnyInt,
    k: int,
    workers: int,
    advance: Callable[[float], None] = lambda _: None,
) -> Neighbours:
    """Find the k nearest neighbours of some of the points, without the points themselves."""
    count = len(wanted)
    indices = np.empty((count, k), dtype=np.int32)
    distances = np.empty((count, k), dtype=np.float32)
    for begin in range(0, count, _CHUNK):
        end = min(begin + _CHUNK, count)
        neighbours_m, neighbours = tree.query(points[wanted[begin:end]], k=k + 1, workers=workers)
        # The point itself is among its neighbours at distance 0, but not always in the first column
        # (copies of it may stand before it, or push it out): drop it where it stands, else the
        # last column.
        own = neighbours == wanted[begin:end, None]
        own[~own.any(axis=1), -1] = True
        indices[begin:end] = neighbours[~own].reshape(-1, k)
        distances[begin:end] = neighbours_m[~own].reshape(-1, k)
        advance(end - begin)
    return Neighbours(indices, distances)
