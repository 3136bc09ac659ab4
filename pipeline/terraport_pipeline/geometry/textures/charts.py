"""Charts of one segment: pieces of surface that lie flat in the atlas.

A chart is a set of connected faces that one photo colours; its coordinates are the photo's own
pixels, so nothing has to be unfolded and no detail of the photo is lost or invented. Faces without
a photo are grouped by the axis that their normals are nearest to, without any photo also with their
neighbours (:mod:`.facing_charts`), and laid flat along the mean normal of the group.

Two faces of a photo's chart may cover the same texels only where one hides the other in the photo;
the choice of views keeps hidden faces out.

PURE: no I/O, no clock.

References
----------
M. Waechter, N. Moehrle, M. Goesele, "Let There Be Color! Large-Scale Texturing of 3D
Reconstructions", ECCV 2014, section 4 (texture patches).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH, project_packed
from terraport_pipeline.geometry.textures.facing_charts import axis_of, facing_labels

__all__ = ["Charts", "make_charts"]

_BEYOND: Final = 0.5
"""Pixels by which a corner may lie outside the picture: rounding, no more."""

_TOUCHING: Final = 0.05
"""Pixels between corners of two faces that lie at one place in a given image."""

_SAME_SIDE: Final = 0.3
"""Least cosine between a face and its chart's mean normal; below it the axis is taken instead,
which every face of the group faces by 0.577 or more, or by 0.2 where it joined a neighbour."""

_PLAIN_TEXELS: Final = 2.0
"""Texels along an edge of the mesh where vertex colours are all there is: they hold no more."""


_SPARSE: Final = 0.7
"""Share of its box below which a chart is tried to be cut. A level triangle fills a half."""

_LEAST_CUT: Final = 48.0
"""Texels: shorter charts stay whole, their gutters cost more than their corners."""

_CELL_RIM: Final = 12.0
"""Texels that a cell has on top of its chart along each axis: gutters, and rounding up."""

_SAVED: Final = 0.93
"""Share of its cells' area that a cut may leave: less is not worth a seam. On the quarry 0.93 and
six rounds saved 18 % of all texels; 0.8 and four rounds 2 %."""

_LEAST_HALF: Final = 100
"""Faces that a half has at least: what is saved with fewer comes back as seams."""

_WORTH_ANY_SEAM: Final = 4096.0
"""Texels saved that count more than that."""

_CUTS: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class Charts:
    """Charts of F faces with a photo each: connected faces of one view, laid out flat."""

    view: Int32
    """(F,) photo that colours each face; -1: none asked for, or not wholly in its picture."""
    chart: Int32
    """(F,) chart of each face, 0 to C - 1, numbered by the first face."""
    pixels: Float32
    """(F, 3, 2) corners in the face's photo, pixels; zeros without one."""
    uvs: Float64
    """(F, 3, 2) corners within the chart, texels at full density, from the chart's lower corner."""
    sizes: Float64
    """(C, 2) extents, texels at full density."""
    surface_m2: Float64
    """(F,) area of each face."""
    texels: Float64
    """(F,) area of each face in the chart, texels at full density."""
    gsd_m: Float64
    """(F,) length of a photo's pixel on the face; NaN without a photo."""
    rim: Bool
    """(F,) faces with an edge where the chart ends."""

    @property
    def count(self) -> int:
        """Number of charts C; `chart` numbers them from 0."""
        return len(self.sizes)


def make_charts(
    vertices: AnyFloat,
    faces: AnyInt,
    view: AnyInt,
    packed: Float64,
    *,
    texel_m: float | None = None,
    pixels: Float32 | None = None,
) -> Charts:
    """Cut a mesh into charts.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3)
        Metres, scene frame.
    faces : ndarray of shape (F, 3), integer
        Vertex indices; F >= 1.
    view : ndarray of shape (F,), integer
        Photo of each face, -1 for none.
    packed : ndarray of shape (views, PACKED), float64
        From ``View.packed``.
    texel_m : float, optional
        Length of a texel on the surface. Never finer than a photo's pixel, nor, where there are
        photos, than two texels an edge on faces without one. None: as fine as the photos, and
        without a photo two texels an edge.
    pixels : ndarray of shape (F, 3, 2), float32, optional
        Corners in the photos, where they are known: nothing is projected, and a chart also ends
        where two faces do not touch in their photo. NaN: without one.

    Returns
    -------
    Charts
        A face whose corners are not all in its photo's picture counts as without photo. One that
        shows it its back covers texels of its neighbours, with the same pixels.
    """
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    seen = np.ascontiguousarray(view, dtype=np.int32).copy()
    if pixels is None:
        pixels = np.zeros((len(corners), 3, 2), dtype=np.float32)
        _project_corners(points, corners, np.ascontiguousarray(packed), seen, pixels)
        pairs, _ = face_pairs(corners, len(points))
    else:
        seen[np.isnan(pixels).any(axis=(1, 2))] = -1
        pixels = np.where((seen >= 0)[:, None, None], pixels, np.float32(0.0))
        pairs, edges = face_pairs(corners, len(points))
        pairs = pairs[_touch(corners, seen, pixels, pairs, edges)]
    edge_a = points[corners[:, 1]] - points[corners[:, 0]]
    edge_b = points[corners[:, 2]] - points[corners[:, 0]]
    normal = np.cross(edge_a, edge_b)
    surface = 0.5 * np.linalg.norm(normal, axis=1)
    labels = _labels(seen, normal, pairs)
    chart, count = components(len(corners), pairs, labels=labels)
    uvs = pixels.astype(np.float64)
    plain = seen < 0
    area_px = _plan_area(uvs)
    gsd = np.full(len(corners), np.nan)
    gsd[~plain] = np.sqrt(surface[~plain] / np.maximum(area_px[~plain], 1e-12))
    if texel_m is not None and not plain.all():
        # One scale a chart, from its whole area: texels stay square within the photo's geometry.
        length = np.sqrt(
            np.bincount(chart, surface, count)
            / np.maximum(np.bincount(chart, area_px, count), 1e-12)
        )
        uvs *= np.minimum(1.0, length / texel_m)[chart][:, None, None]
    if plain.any():
        plain_m = _plain_texel_m(edge_a[plain])
        if texel_m is not None:
            # Beside photos a texel size is for them: colours of vertices are not finer for it.
            plain_m = max(texel_m, plain_m) if len(packed) else texel_m
        per_m = 1.0 / plain_m
        flat = _laid_flat(points, corners[plain], normal[plain], chart[plain], count, labels[plain])
        uvs[plain] = flat * per_m
    area = _plan_area(uvs)
    chart, low, high = _cut_sparse(chart, count, uvs, area)
    uvs -= low[chart][:, None, :]
    within = pairs[chart[pairs[:, 0]] == chart[pairs[:, 1]]]
    rim = np.bincount(within.ravel(), minlength=len(corners)) < 3
    return Charts(seen, chart, pixels, uvs, high - low, surface, area, gsd, rim)


def _touch(corners: Int32, view: Int32, pixels: Float32, pairs: Int32, edges: Int32) -> Bool:
    """Mark the pairs whose common edge lies at one place in the photo."""
    touching = np.ones(len(pairs), np.bool_)
    row = np.arange(len(pairs))
    for end in range(2):
        ends = [
            pixels[pairs[:, side]][
                row, np.argmax(corners[pairs[:, side]] == edges[:, end, None], axis=1)
            ]
            for side in range(2)
        ]
        touching &= (np.abs(ends[0] - ends[1]) <= _TOUCHING).all(axis=1)
    return touching | (view[pairs] < 0).any(axis=1)


def _cut_sparse(
    chart: Int32, count: int, uvs: Float64, area: Float64
) -> tuple[Int32, Float64, Float64]:
    """Halve charts that fill little of their boxes: a road's bend takes a box of mostly nothing.

    Returns the charts and their boxes' lower and upper corners, (C, 2) each. A cut is kept where it
    saves texels; at most :data:`_CUTS` rounds.
    """
    middle = uvs.mean(axis=1)
    low, high = _boxes(chart, count, uvs)
    for _ in range(_CUTS):
        size = high - low
        fill = np.bincount(chart, area, count) / np.maximum(size[:, 0] * size[:, 1], 1e-300)
        wanted = (fill < _SPARSE) & (size.max(axis=1) > _LEAST_CUT)
        if not wanted.any():
            break
        along = np.argmax(size, axis=1)
        half = np.take_along_axis(0.5 * (low + high), along[:, None], axis=1)[:, 0]
        beyond = np.take_along_axis(middle, along[chart][:, None], axis=1)[:, 0] > half[chart]
        tried = np.where(wanted[chart] & beyond, chart + count, chart)
        new_low, new_high = _boxes(tried, 2 * count, uvs)
        with np.errstate(invalid="ignore"):  # the boxes of halves that nobody wanted are empty
            cells = np.nan_to_num(np.prod(new_high - new_low + _CELL_RIM, axis=1), posinf=0.0)
        cells[~np.isfinite(new_low).all(axis=1)] = 0.0
        before = np.prod(size + _CELL_RIM, axis=1)
        saved = before - cells[:count] - cells[count:]
        halves = np.bincount(tried, minlength=2 * count).reshape(2, count).min(axis=0)
        kept = wanted & (saved > (1.0 - _SAVED) * before)
        kept &= (halves >= _LEAST_HALF) | (saved > _WORTH_ANY_SEAM)
        if not kept.any():
            break
        tried = np.where(kept[chart], tried, chart)
        _, first, again = np.unique(tried, return_index=True, return_inverse=True)
        # By the first face, as without cuts.
        rank = np.empty(len(first), np.int32)
        rank[np.argsort(first, kind="stable")] = np.arange(len(first))
        chart, count = rank[again.reshape(-1)], len(first)
        low, high = _boxes(chart, count, uvs)
    return chart, low, high


def _boxes(chart: Int32, count: int, uvs: Float64) -> tuple[Float64, Float64]:
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, uvs.min(axis=1))
    np.maximum.at(high, chart, uvs.max(axis=1))
    return low, high


def _labels(view: Int32, normal: Float64, pairs: Int32) -> Int32:
    """Give each face what it shares with its chart: its photo, or the axis it is laid along."""
    labels = view.astype(np.int32)
    plain = np.flatnonzero(view < 0)
    if len(plain):
        row = np.full(len(view), -1, np.int32)
        row[plain] = np.arange(len(plain), dtype=np.int32)
        both = row[pairs]
        labels[plain] = facing_labels(normal[plain], both[(both >= 0).all(axis=1)])
    return labels


def _plan_area(uvs: Float64) -> Float64:
    a, b = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    area: Float64 = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return area


def _plain_texel_m(edges: Float64) -> float:
    return max(float(np.median(np.linalg.norm(edges, axis=1))), 1e-6) / _PLAIN_TEXELS


def _laid_flat(
    points: Float64, corners: Int32, normal: Float64, chart: Int32, count: int, labels: Int32
) -> Float64:
    """Project faces along their charts' mean normals; metres."""
    total = np.stack([np.bincount(chart, normal[:, k], count) for k in range(3)], axis=1)
    mean = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    cosine = (normal * mean[chart]).sum(axis=1) / length
    least = np.full(count, np.inf)
    np.minimum.at(least, chart, np.where(length > 1e-200, cosine, 1.0))
    straight = np.zeros_like(mean)
    straight[chart] = axis_of(labels)  # the same for all faces of a chart
    mean = np.where((least < _SAME_SIDE)[:, None], straight, mean)
    other = np.zeros_like(mean)
    other[np.arange(count), np.argmin(np.abs(mean), axis=1)] = 1.0
    across = np.cross(other, mean)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    up = np.cross(mean, across)
    position = points[corners]
    flat: Float64 = np.stack(
        [
            (position * across[chart][:, None]).sum(axis=2),
            (position * up[chart][:, None]).sum(axis=2),
        ],
        axis=2,
    )
    return flat


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project_corners(
    points: Float64, corners: Int32, packed: Float64, view: Int32, pixels: Float32
) -> None:
    """Find the corners' pixels; put -1 for faces that are not wholly in the picture."""
    for f in range(len(corners)):
        v = view[f]
        if v < 0:
            view[f] = -1
            continue
        row = packed[v]
        good = True
        for c in range(3):
            p = corners[f, c]
            x, y, _ = project_packed(row, points[p, 0], points[p, 1], points[p, 2])
            # Written so that NaN is outside.
            if not (
                -_BEYOND <= x <= row[WIDTH] + _BEYOND and -_BEYOND <= y <= row[HEIGHT] + _BEYOND
            ):
                good = False
                break
            pixels[f, c, 0], pixels[f, c, 1] = x, y
        if not good:
            view[f] = -1
            pixels[f] = 0.0
