"""The border of a surface: its edges, and how clean it is.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.mesh.vertex_normals import face_normals

__all__ = ["BorderFacts", "area_outside_m2", "border_edges", "measure_border"]


_CHUNK: Final = 1_000_000
"""Faces per step of the area sum; bounds its scratch to about 200 MB."""


@dataclass(frozen=True, slots=True)
class BorderFacts:
    """How far a surface reaches beyond its outline, and how ragged its border is."""

    outside_m2: float
    """Area of the surface outside the footprint."""
    length_m: float
    """Length of all borders, those of holes too."""
    reach_p50: float
    reach_p95: float
    """Distance of border vertices to the nearest sample, in spacings."""
    teeth_p50: float
    teeth_p95: float
    """Distance of border vertices from the line through their two neighbours on the border, in
    spacings: 0 on a straight border."""


def border_edges(faces: Int32, n_vertices: int) -> Int32:
    """Find the edges that one face alone has.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int32
        Wound consistently.
    n_vertices : int

    Returns
    -------
    ndarray of shape (E, 2), int32
        Directed as in their face, sorted by first and second vertex.

    Notes
    -----
    Around a vertex inside the surface every neighbour follows it once and precedes it once. One
    pass over the faces sums the neighbours that follow less those that precede, by hashes of their
    numbers: where the sum is not 0 there is border. Edges are compared only there. (Sums of the
    numbers themselves are 0 by chance where two fans meet in a vertex: ``+1 -2 +4 -3``.)
    """
    triangles = as_kernel_input(faces, np.int32)
    open_vertex = _unbalanced(triangles, n_vertices)
    some = triangles[open_vertex[triangles].sum(axis=1) >= 2].astype(np.int64)
    start = some.ravel()
    end = some[:, [1, 2, 0]].ravel()
    forth = np.sort((start << 32) | end)
    back = np.sort((end << 32) | start)
    alone = forth[~_is_in_sorted(forth, back)]
    return np.stack([alone >> 32, alone & 0xFFFFFFFF], axis=1).astype(np.int32)


def area_outside_m2(vertices: Float32, faces: Int32, footprint: Footprint) -> float:
    """Area of the faces whose centre lies outside a footprint.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    footprint : Footprint

    Returns
    -------
    float
        Square metres of surface, not of plan.
    """
    total = 0.0
    outside = footprint.margin_m(vertices) < 0
    touched = faces[outside[faces].any(axis=1)]
    for begin in range(0, len(touched), _CHUNK):
        some = touched[begin : begin + _CHUNK]
        centres = vertices[some].mean(axis=1, dtype=np.float64)
        _, areas_m2 = face_normals(vertices, some)
        total += float(areas_m2[footprint.margin_m(centres) < 0].sum(dtype=np.float64))
    return total


def measure_border(
    vertices: Float32,
    faces: Int32,
    footprint: Footprint,
    ratio_of: Callable[[Float32], Float32],
    spacing_m: float,
) -> BorderFacts:
    """Measure how clean a surface ends.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    footprint : Footprint
    ratio_of : callable
        Gives places (M, 3) their support ratio (M,).
    spacing_m : float
        The cloud's.

    Returns
    -------
    BorderFacts
        All 0 for a closed surface.
    """
    edges = border_edges(faces, len(vertices))
    outside_m2 = area_outside_m2(vertices, faces, footprint)
    if not len(edges):
        return BorderFacts(outside_m2, 0.0, 0.0, 0.0, 0.0, 0.0)
    ends = vertices[edges].astype(np.float64)
    length_m = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
    reach = np.percentile(ratio_of(vertices[np.unique(edges)]), (50, 95))
    teeth = np.percentile(_teeth_m(vertices, edges), (50, 95)) / spacing_m
    return BorderFacts(
        outside_m2, length_m, float(reach[0]), float(reach[1]), float(teeth[0]), float(teeth[1])
    )


def _teeth_m(vertices: Float32, edges: Int32) -> Float64:
    """Distance of border vertices from the line through their two neighbours along the border."""
    starts = np.bincount(edges[:, 0], minlength=len(vertices))
    ends = np.bincount(edges[:, 1], minlength=len(vertices))
    simple = (starts == 1) & (ends == 1)
    after = np.full(len(vertices), -1, dtype=np.int64)
    before = np.full(len(vertices), -1, dtype=np.int64)
    after[edges[:, 0]] = edges[:, 1]
    before[edges[:, 1]] = edges[:, 0]
    rows = np.flatnonzero(simple)
    if not len(rows):
        return np.zeros(1)
    position = vertices[rows].astype(np.float64)
    first = vertices[before[rows]].astype(np.float64)
    chord = vertices[after[rows]] - first
    length = np.linalg.norm(chord, axis=1)
    away: Float64 = np.linalg.norm(np.cross(position - first, chord), axis=1)
    teeth: Float64 = away / np.maximum(length, np.finfo(np.float64).tiny)
    return teeth


def _is_in_sorted(values: Int64, among: Int64) -> Bool:
    if not len(among):
        return np.zeros(len(values), dtype=bool)
    index = np.minimum(np.searchsorted(among, values), len(among) - 1)
    present: Bool = among[index] == values
    return present


@numba.njit(cache=True, nogil=True)
def _unbalanced(faces: Int32, n_vertices: int) -> Bool:
    balance = np.zeros(n_vertices, np.uint64)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        hash_a, hash_b, hash_c = _mixed(a), _mixed(b), _mixed(c)
        balance[a] += hash_b - hash_c
        balance[b] += hash_c - hash_a
        balance[c] += hash_a - hash_b
    unbalanced: Bool = balance != 0
    return unbalanced


@numba.njit(cache=True, nogil=True)
def _mixed(number: int) -> np.uint64:
    """Hash of a vertex number: splitmix64's finaliser (Steele, Lea, Flood 2014)."""
    z = np.uint64(number) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
