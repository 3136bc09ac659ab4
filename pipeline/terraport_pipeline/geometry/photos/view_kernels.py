"""Kernels of :mod:`terraport_pipeline.geometry.photos.view_candidates`, which states the model.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int16, Int32, Int64, UInt8, UInt16
from terraport_pipeline.geometry.mesh.face_vector import face_vector
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, POSITION, WIDTH, project_packed

__all__ = [
    "QUALITY_STEPS",
    "SLOTS",
    "face_radii",
    "index_of_view",
    "insert",
    "project",
    "rate",
    "sample_areas",
    "sort_slots",
]

SLOTS: Final = 8
"""Views kept per face, the best by quality. A drone survey shows a point in 5 to 50 photos; the
eighth best is rarely within half the quality of the best."""

QUALITY_STEPS: Final = 2048
"""Steps of quality per factor of two: qualities are kept as logarithms in 16 bits, 0.034 %
apart."""

_QUALITY_SHIFT: Final = 12.0
"""Qualities below 2^-12 square pixels are kept as that."""

_MARGIN: Final = 0.004
"""Strip along a photo's edge that is not used, as a part of its width: undistorted photos are black
there, and resampling needs neighbours."""


@numba.njit(cache=True, nogil=True)
def project(packed: Float64, vertices: Float32, uv: Float32, begin: int, end: int) -> None:
    """Project vertices begin..end to pixels of a photo, into `uv`."""
    for i in range(begin, end):
        u, v, _ = project_packed(
            packed,
            np.float64(vertices[i, 0]), np.float64(vertices[i, 1]), np.float64(vertices[i, 2]),
        )  # fmt: skip
        uv[i, 0], uv[i, 1] = u, v


@numba.njit(cache=True, nogil=True)
def face_radii(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    views: Int16,
    radius: Float32,
    begin: int,
    end: int,
) -> None:
    """Write how far from the photos' middle faces lie, 1 in the corners; one packed row a view."""
    for f in range(begin, end):
        x, y, z = 0.0, 0.0, 0.0
        for c in range(3):
            x += vertices[faces[f, c], 0] / 3.0
            y += vertices[faces[f, c], 1] / 3.0
            z += vertices[faces[f, c], 2] / 3.0
        for s in range(views.shape[1]):
            v = views[f, s]
            if 0 <= v < len(packed):
                width, height = packed[v, WIDTH], packed[v, HEIGHT]
                a, b, _ = project_packed(packed[v], x, y, z)
                radius[f, s] = (
                    2.0 * np.hypot(a - 0.5 * width, b - 0.5 * height) / np.hypot(width, height)
                )


@numba.njit(cache=True, nogil=True)
def sample_areas(packed: Float64, faces: Int32, uv: Float32, begin: int, end: int) -> Float64:
    """Projected areas of every 61st face that lies inside the picture."""
    areas = np.empty((end - begin) // 61 + 1)
    n = 0
    for f in range(begin, end, 61):
        inside = True
        for c in range(3):
            u, v = uv[faces[f, c], 0], uv[faces[f, c], 1]
            if not (u >= 0.0 and u <= packed[WIDTH] and v >= 0.0 and v <= packed[HEIGHT]):
                inside = False
        if inside:
            areas[n] = abs(_picture_area(faces, uv, f))
            n += 1
    return areas[:n]


@numba.njit(cache=True, nogil=True, inline="always")
def _picture_area(faces: Int32, uv: Float32, f: int) -> float:
    """Projected area; negative for faces that look away from the camera.

    v points down, so a face that is counter-clockwise seen from outside has a negative determinant.
    """
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    area: float = 0.5 * (
        (np.float64(uv[k, 0]) - uv[i, 0]) * (np.float64(uv[j, 1]) - uv[i, 1])
        - (np.float64(uv[j, 0]) - uv[i, 0]) * (np.float64(uv[k, 1]) - uv[i, 1])
    )
    return area


@numba.njit(cache=True, nogil=True)
def quality_level(quality: float) -> int:
    """Logarithm of a quality in steps, 1..65535."""
    level = np.log2(max(quality, 2.0**-_QUALITY_SHIFT)) + _QUALITY_SHIFT
    return min(max(int(level * QUALITY_STEPS), 1), 65535)


@numba.njit(cache=True, nogil=True)
def rate(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    uv: Float32,
    sharpness: Float32,
    quality: UInt16,
    min_cosine: float,
    begin: int,
    end: int,
) -> tuple[Int32, Float32, Float32]:
    """Rate faces begin..end; the three columns of :class:`Rated`.

    Parameters
    ----------
    packed : ndarray of shape (PACKED,), float64
        The view.
    vertices, faces : ndarray
        The mesh, metres.
    uv : ndarray of shape (V, 2), float32
        Pixels of the vertices; NaN outside the picture.
    sharpness : ndarray of shape (rows, columns), float32
        Sharpness of the photo by blocks.
    quality : ndarray of shape (F, SLOTS), uint16
        Qualities of the candidates so far.
    min_cosine : float
        Of the angle between normal and line of sight.
    begin, end : int
        Faces.
    """
    # Invariant: the first n rows of the three columns are the faces rated, ascending.
    width, height = packed[WIDTH], packed[HEIGHT]
    margin = _MARGIN * max(width, height)
    px, py, pz = packed[POSITION], packed[POSITION + 1], packed[POSITION + 2]
    rated_face = np.empty(end - begin, np.int32)
    rated_quality = np.empty(end - begin, np.float32)
    rated_area = np.empty(end - begin, np.float32)
    rows, columns = sharpness.shape
    n = 0
    for f in range(begin, end):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        # (1) In the picture with all corners, and of some area there.
        inside = True  # NaN (not in the picture) fails the comparisons
        for c in range(3):
            u, v = uv[faces[f, c], 0], uv[faces[f, c], 1]
            if not (u >= margin and u <= width - margin and v >= margin and v <= height - margin):
                inside = False
        if not inside:
            continue
        area = _picture_area(faces, uv, f)
        if not area > 0.0:
            continue
        # (2) Turned to the camera by min_cosine at least.
        nx, ny, nz = face_vector(vertices, faces, f)
        tx, ty, tz = px - vertices[i, 0], py - vertices[i, 1], pz - vertices[i, 2]
        size = np.sqrt((nx * nx + ny * ny + nz * nz) * (tx * tx + ty * ty + tz * tz))
        facing = nx * tx + ny * ty + nz * tz
        # A face without area, or one that the camera stands on, looks nowhere.
        if not (size > 0.0 and facing >= min_cosine * size):
            continue
        # (3) Quality: area in the picture, times cosine, times sharpness where it is seen; kept
        # only where it betters the worst of the face's slots.
        u = (np.float64(uv[i, 0]) + uv[j, 0] + uv[k, 0]) / 3.0
        v = (np.float64(uv[i, 1]) + uv[j, 1] + uv[k, 1]) / 3.0
        sharp = sharpness[
            min(int(v * rows / height), rows - 1), min(int(u * columns / width), columns - 1)
        ]
        value = area * (facing / size) * sharp
        least = 65535
        for s in range(SLOTS):
            least = min(least, int(quality[f, s]))
        if quality_level(value) <= least:
            continue
        rated_face[n], rated_quality[n], rated_area[n] = f, value, area
        n += 1
    return rated_face[:n], rated_quality[:n], rated_area[:n]


@numba.njit(cache=True, nogil=True)
def insert(
    views: Int16,
    qualities: UInt16,
    slot_colours: UInt8,
    view: int,
    face: Int32,
    quality: Float32,
    visible: Bool,
    colours: UInt8,
    begin: int,
    end: int,
) -> None:
    """Put a view among the best of rated faces begin..end.

    Parameters
    ----------
    views, qualities, slot_colours : ndarray of shape (F, SLOTS), (F, SLOTS), (F, SLOTS, 3)
        Candidates; written.
    view : int
        The view's number.
    face, quality : ndarray of shape (C,)
        Columns of :class:`Rated`.
    visible : ndarray of shape (C,), bool
        Whether nothing hides the face.
    colours : ndarray of shape (C, 3), uint8
        The face in this view.
    begin, end : int
        Rows of the columns.
    """
    for c in range(begin, end):
        if not visible[c]:
            continue
        # (1) The slot of least quality; an empty one has quality 0.
        f = face[c]
        worst = 0
        for s in range(1, SLOTS):
            if qualities[f, s] < qualities[f, worst]:
                worst = s
        # (2) Replace it by what is strictly better, so that of equal views the first stays.
        level = quality_level(np.float64(quality[c]))
        if level > qualities[f, worst]:
            views[f, worst] = view
            qualities[f, worst] = level
            for k in range(3):
                slot_colours[f, worst, k] = colours[c, k]


@numba.njit(cache=True, nogil=True, inline="always")
def index_of_view(seen: Int64, n: int, view: int) -> int:
    """Find a view among the first `n` of a cell's list; `n` where it is new."""
    index = 0
    while index < n and seen[index] != view:
        index += 1
    return index


@numba.njit(cache=True, nogil=True)
def sort_slots(views: Int16, qualities: UInt16, colours: UInt8, begin: int, end: int) -> None:
    """Sort the places of faces begin..end by view."""
    for f in range(begin, end):
        for s in range(1, SLOTS):
            t = s
            # as unsigned numbers the empty places (-1) come last
            while t > 0 and np.uint16(views[f, t]) < np.uint16(views[f, t - 1]):
                views[f, t], views[f, t - 1] = views[f, t - 1], views[f, t]
                qualities[f, t], qualities[f, t - 1] = qualities[f, t - 1], qualities[f, t]
                for k in range(3):
                    spare = colours[f, t, k]
                    colours[f, t, k] = colours[f, t - 1, k]
                    colours[f, t - 1, k] = spare
                t -= 1
