"""Voronoi filtering: the crust of a cloud.

N. Amenta and M. Bern, "Surface reconstruction by Voronoi filtering", Discrete and Computational
Geometry 22(4), 1999. The samples' Voronoi cells are long and thin across the surface; their two
far ends, the poles, lie near the medial axis. Of the Delaunay triangulation of samples and poles
the triangles between three samples are kept, then those whose normals agree with the poles'
directions.

Voronoi vertices are the circumcentres of the Delaunay tetrahedra, so two Delaunay triangulations
(Qhull, by SciPy) do it all. Poles far outside the cloud are drawn in to a sphere around it:
nearly flat tetrahedra have circumcentres as far as float64 reaches, which break Qhull and say
nothing more than their direction.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["crust"]


_FAR = 3.0
"""Poles stay within this many times the cloud's diagonal from its middle."""


def crust(points: Float32, normals: Float32, *, largest_angle_deg: float = 40.0) -> Int32:
    """Find the triangles of the crust.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Different from each other, not all in one plane.
    normals : ndarray of shape (N, 3), float32
        Only turn the finished triangles; the choice does not use them.
    largest_angle_deg : float
        A triangle goes when its normal is farther than this from the pole's direction at the corner
        with its largest angle, or one and a half times this at another (the paper's filtering by
        normals).

    Returns
    -------
    ndarray of shape (F, 3), int32
        Not a manifold: the paper leaves that to a last step of its own, which is not done here.
    """
    unit = np.asarray(points, np.float64)
    middle = (unit.min(axis=0) + unit.max(axis=0)) / 2
    size = float(np.linalg.norm(np.ptp(unit, axis=0)))
    unit = (unit - middle) / size
    poles, directions = _poles(unit)
    tetrahedra = Delaunay(np.concatenate([unit, poles])).simplices
    corners = np.concatenate(
        [tetrahedra[:, list(skip)] for skip in ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))]
    )
    corners = corners[(corners < len(unit)).all(axis=1)]
    triangles = np.unique(np.sort(corners, axis=1), axis=0)
    triangles, normal = _agreeing(unit, triangles, directions, np.radians(largest_angle_deg))
    outward = np.einsum("fc,fkc->f", normal, np.asarray(normals, np.float64)[triangles])
    triangles[outward < 0] = triangles[outward < 0][:, [0, 2, 1]]
    return triangles.astype(np.int32)


def _poles(points: Float64) -> tuple[Float64, Float64]:
    """Both poles of every sample, (P, 3), without doubles; direction of the first, (N, 3) unit."""
    tetrahedra = Delaunay(points).simplices
    centres = _circumcentres(points[tetrahedra])
    sample = tetrahedra.ravel()
    owner = np.repeat(np.arange(len(tetrahedra)), 4)
    offset = centres[owner] - points[sample]
    away = np.einsum("ij,ij->i", offset, offset)
    first = _farthest(sample, away, len(points))
    directions = np.zeros_like(points)
    has = first >= 0
    directions[has] = offset[first[has]]
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.where(length > 0, directions / np.maximum(length, 1e-300), [0.0, 1.0, 0.0])
    behind = np.einsum("ij,ij->i", offset, directions[sample]) < 0
    second = _farthest(sample, np.where(behind, away, -1.0), len(points))
    chosen = np.unique(owner[np.concatenate([first[has], second[second >= 0]])])
    return np.unique(centres[chosen], axis=0), directions


def _circumcentres(corners: Float64) -> Float64:
    """Centres of the spheres through four points, (T, 3), drawn in to the sphere of _FAR."""
    a = corners[:, 0]
    u, v, w = (corners[:, k] - a for k in (1, 2, 3))
    uu, vv, ww = (np.einsum("ij,ij->i", one, one)[:, None] for one in (u, v, w))
    volume = 2 * np.einsum("ij,ij->i", u, np.cross(v, w))
    top = uu * np.cross(v, w) + vv * np.cross(w, u) + ww * np.cross(u, v)
    flat = np.abs(volume) < 1e-14
    centre = top / np.where(flat, 1e-14, volume)[:, None] + a
    away = np.linalg.norm(centre, axis=1, keepdims=True)
    drawn_in: Float64 = centre * np.minimum(1.0, _FAR / np.maximum(away, 1e-300))
    return drawn_in


def _farthest(sample: Int64, away: Float64, count: int) -> Int64:
    """Row with the largest distance of each sample; -1 where there is none that is not negative."""
    order = np.lexsort((away, sample))
    last = np.searchsorted(sample[order], np.arange(count), side="right") - 1
    row = order[np.maximum(last, 0)]
    farthest: Int64 = np.where((last >= 0) & (sample[row] == np.arange(count)), row, -1)
    farthest[(farthest >= 0) & (away[np.maximum(farthest, 0)] < 0)] = -1
    return farthest


def _agreeing(
    points: Float64, triangles: Int64, directions: Float64, largest: float
) -> tuple[Int64, Float64]:
    """Keep triangles whose normal is near the poles' directions; returns their unit normals too."""
    corners = points[triangles]
    sides = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # opposite to each corner
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.maximum(length, 1e-300)
    widest = np.einsum("fkc,fkc->fk", sides, sides).argmax(axis=1)
    cosine = np.abs(np.einsum("fc,fkc->fk", normal, directions[triangles]))
    limit = np.full(triangles.shape, np.cos(1.5 * largest))
    limit[np.arange(len(triangles)), widest] = np.cos(largest)
    good = (cosine >= limit).all(axis=1) & (length[:, 0] > 0)
    return triangles[good], normal[good]
