"""How rough each region is: the root mean square distance of its surface from local planes.

Space is cut into cubes; in each cube each region has its own plane of least squares. What is left
is what a person calls rough at that scale: a smooth slope and a smooth bend that is wide against
the cube count for nothing, rubble and steps smaller than the cube count in full. It is the standard
deviation of the residual relief that Grohmann, Smith and Riccomini compare with other measures
("Multiscale analysis of topographic surface roughness in the Midland Valley, Scotland", IEEE
Transactions on Geoscience and Remote Sensing 49(4), 2011), with three departures: planes by
orthogonal instead of vertical distance (K. Pearson, "On lines and planes of closest fit to systems
of points in space", 1901), so that walls and overhangs are measured as well as ground; integrals
over triangles instead of sums over samples, so that dense places do not count more; and cubes
instead of a moving window, so that it costs one pass.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.adjacency import as_kernel_input

__all__ = [
    "automatic_roughness_scale",
    "roughness_moments",
    "roughness_of",
]


_EDGES_PER_CUBE: Final = 8.0
"""Automatic scale: at least this many mean edges wide, about a hundred faces to a plane. Fewer, and
the plane follows the noise; more, and the form of the ground counts as roughness."""

_MAX_CELLS_A_SIDE: Final = 1 << 20
"""Cube numbers are packed 21 bits each into one integer."""

_FIRST_SLOTS: Final = 1 << 16


def automatic_roughness_scale(area_m2: float, faces: int, extent_m: float) -> float:
    """Choose the cube's width from the density of faces.

    Parameters
    ----------
    area_m2 : float
        Of all faces.
    faces : int
        How many.
    extent_m : float
        Widest side of the surface.

    Returns
    -------
    float
        Metres, a power of two, at least eight edges of an equilateral triangle of mean area: a
        rebuild with slightly other faces mostly has the same. 1 for a surface without area.

    Examples
    --------
    >>> automatic_roughness_scale(area_m2=100.0, faces=10_000, extent_m=10.0)
    2.0
    """
    if faces == 0 or not area_m2 > 0.0:
        return 1.0
    edge = float(np.sqrt(4.0 / np.sqrt(3.0) * area_m2 / faces))
    least = max(_EDGES_PER_CUBE * edge, extent_m / _MAX_CELLS_A_SIDE)
    return float(2.0 ** np.ceil(np.log2(least)))


def roughness_moments(
    vertices: AnyFloat,
    faces: AnyInt,
    regions: Int32,
    scale_m: float,
) -> tuple[Int64, Int32, Float64]:
    """Sum up what each region has in each cube; sums of several tiles may be added.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), integer
        Vertex indices; at least one face.
    regions : ndarray of shape (F,), int32
        Region of every face, 0..R-1.
    scale_m : float
        Width of the cubes, which are aligned with the frame's origin. A face belongs to the cube
        that its centre lies in (on a border: the cube above).

    Returns
    -------
    cube : ndarray of shape (K, 3), int64
        Number of the cube along each axis, from the frame's origin.
    region : ndarray of shape (K,), int32
    moments : ndarray of shape (K, 10), float64
        Area, first and second moments about the cube's corner.

    Notes
    -----
    With v_i the corners of a triangle of area A about the cube's corner and s their sum, the
    integral of x x^T over it is A / 12 (sum of v_i v_i^T + s s^T), exactly. Linear but for a hash
    of the cubes.
    """
    points = as_kernel_input(vertices, np.float32 if vertices.dtype == np.float32 else np.float64)
    corners = as_kernel_input(faces, np.int32)
    labels = as_kernel_input(regions, np.int32)
    low = np.floor(vertices.min(axis=0).astype(np.float64) / scale_m).astype(np.int64)
    piece, cell, region = _pieces(points, corners, labels, scale_m, low)
    return cell, region, _moments(points, corners, piece, cell, scale_m)


def roughness_of(region: Int32, moments: Float64, count: int) -> Float64:
    """Root mean square distance of each region's surface from its planes.

    Parameters
    ----------
    region : ndarray of shape (K,), int32
    moments : ndarray of shape (K, 10), float64
        From :func:`roughness_moments`; of several tiles, added up by region and cube.
    count : int
        Number of regions.

    Returns
    -------
    ndarray of shape (count,), float64
        Metres; 0 for flat regions and regions without area. A pure rotation changes it a little,
        since the cubes cut the surface elsewhere; scaling mesh and cube scales it.

    Notes
    -----
    The mean square distance from a piece's plane is the smallest eigenvalue of its covariance.
    """
    area = moments[:, 0]
    has_area = area > 0.0
    mean = moments[has_area, 1:4] / area[has_area, None]
    second = moments[has_area, 4:] / area[has_area, None]
    covariance = np.empty((len(mean), 3, 3))
    for column, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        covariance[:, i, j] = covariance[:, j, i] = second[:, column] - mean[:, i] * mean[:, j]
    # Rounding can leave a flat piece with a tiny negative eigenvalue.
    square = np.maximum(np.linalg.eigvalsh(covariance)[:, 0], 0.0)
    total = np.bincount(region, weights=area, minlength=count)
    deviation = np.bincount(region[has_area], weights=area[has_area] * square, minlength=count)
    roughness: Float64 = np.sqrt(
        np.divide(deviation, total, out=np.zeros(count), where=total > 0.0)
    )
    return roughness


@numba.njit(cache=True, nogil=True)
def _slot(keys: Int64, owner: Int32, number: Int32, key: int, region: int) -> int:
    """Slot of (cell, region) in an open-addressing table: its own, or the first free one."""
    mask = len(number) - 1
    # Fibonacci hashing; the constants are odd numbers near 2^63 over the golden ratio.
    mixed = key * 5700357409661598105 + region * 2654435769
    slot = (mixed ^ (mixed >> 29)) & mask
    while number[slot] >= 0 and (keys[slot] != key or owner[slot] != region):
        slot = (slot + 1) & mask
    return slot


@numba.njit(cache=True, nogil=True)
def _pieces(
    vertices: AnyFloat, faces: Int32, regions: Int32, scale_m: float, low: Int64
) -> tuple[Int32, Int64, Int32]:
    """Give a number to what each region has in each cube, in order of the first face.

    Returns ``(piece of every face (F,), cube of every piece (K, 3), region of every piece (K,))``.
    """
    # An open-addressing hash table of (cube, region). Invariant: it is at most half full, and
    # piece i was first met at a face before the first face of piece i + 1.
    slots = _FIRST_SLOTS
    keys = np.zeros(slots, np.int64)
    owner = np.zeros(slots, np.int32)
    number = np.full(slots, -1, np.int32)
    piece = np.empty(len(faces), np.int32)
    cells = np.empty((slots // 2 + 1, 3), np.int64)
    region = np.empty(slots // 2 + 1, np.int32)
    count = 0
    cell = np.empty(3, np.int64)
    for f in range(len(faces)):
        # (1) The cube of the face's centre, 21 bits an axis.
        key = np.int64(0)
        for axis in range(3):
            centre = (
                np.float64(vertices[faces[f, 0], axis])
                + np.float64(vertices[faces[f, 1], axis])
                + np.float64(vertices[faces[f, 2], axis])
            ) / 3.0
            cell[axis] = np.int64(np.floor(centre / scale_m))
            key = (key << 21) | (cell[axis] - low[axis])
        # (2) Its piece; a new one takes the next number.
        r = regions[f]
        slot = _slot(keys, owner, number, int(key), int(r))
        if number[slot] < 0:
            keys[slot] = key
            owner[slot] = r
            number[slot] = count
            for axis in range(3):
                cells[count, axis] = cell[axis]
            region[count] = r
            count += 1
        piece[f] = number[slot]
        if 2 * count >= slots:  # half full: double it
            old_keys, old_owner, old_number = keys, owner, number
            slots *= 2
            keys = np.zeros(slots, np.int64)
            owner = np.zeros(slots, np.int32)
            number = np.full(slots, -1, np.int32)
            for i in range(len(old_number)):
                if old_number[i] >= 0:
                    free = _slot(keys, owner, number, int(old_keys[i]), int(old_owner[i]))
                    keys[free] = old_keys[i]
                    owner[free] = old_owner[i]
                    number[free] = old_number[i]
            grown = np.empty((slots // 2 + 1, 3), np.int64)
            longer = np.empty(slots // 2 + 1, np.int32)
            for i in range(count):
                longer[i] = region[i]
                for axis in range(3):
                    grown[i, axis] = cells[i, axis]
            cells, region = grown, longer
    return piece, cells[:count].copy(), region[:count].copy()


@numba.njit(cache=True, nogil=True)
def _moments(
    vertices: AnyFloat,
    faces: Int32,
    piece: Int32,
    cells: Int64,
    scale_m: float,
) -> Float64:
    """Area, first and second moments of every piece about its cube's corner, (K, 10).

    Columns: area; x, y, z; xx, yy, zz, xy, xz, yz.
    """
    moments = np.zeros((len(cells), 10), np.float64)
    p = np.empty((3, 3), np.float64)
    s = np.empty(3, np.float64)
    for f in range(len(faces)):
        k = piece[f]
        # (1) Corners relative to the cube: moments about a far origin would lose their digits.
        for axis in range(3):
            corner = cells[k, axis] * scale_m
            s[axis] = 0.0
            for i in range(3):
                p[i, axis] = np.float64(vertices[faces[f, i], axis]) - corner
                s[axis] += p[i, axis]
        # (2) Area and first moments.
        ux, uy, uz = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
        wx, wy, wz = p[2, 0] - p[0, 0], p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        area = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        moments[k, 0] += area
        column = 4
        for axis in range(3):
            moments[k, 1 + axis] += area * s[axis] / 3.0
            # (3) Second moments of a triangle, exactly: area / 12 times (s s^T + sum of p p^T),
            # with s the sum of the corners; the diagonal here, the other three below.
            square = s[axis] * s[axis]
            for i in range(3):
                square += p[i, axis] * p[i, axis]
            moments[k, column] += area * square / 12.0
            column += 1
        for axis in range(2):
            for other in range(axis + 1, 3):
                product = s[axis] * s[other]
                for i in range(3):
                    product += p[i, axis] * p[i, other]
                moments[k, column] += area * product / 12.0
                column += 1
    return moments
