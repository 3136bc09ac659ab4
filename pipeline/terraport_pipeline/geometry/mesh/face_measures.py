"""Plain measures of faces and of sets of faces that several steps need.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyArray, AnyFloat, AnyInt, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = [
    "automatic_extent",
    "dense_labels",
    "edge_steps",
    "extent_of_area",
    "face_areas",
    "face_boxes",
    "face_centres",
    "first_faces",
    "label_boxes",
    "label_sums",
    "longest_edge",
    "main_labels",
    "mesh_input",
    "steps_of_lengths",
    "surface_area",
]


_AUTO_EXTENT: Final = 1.2
"""Automatic extent: this many sides of the square that ``max_faces`` faces of mean area would
fill. Landings on the quarry fetched 4.4 times too much at 2, 2.9 at 1.2, 2.6 at 1, where segments
begin to cut across true borders (``benchmarks/segments.py``)."""
_LENGTH_STEPS: Final = 2**20
"""Steps in the longest edge: finer than float32 rounding, and 2^43 edges fit an int64 sum."""


def face_centres(vertices: AnyFloat, faces: AnyInt, *, threads: int = 1) -> Float64:
    """Mean of each face's three corners, (F, 3) float64, in the vertices' unit and frame."""
    points, corners = mesh_input(vertices, faces)
    centres = np.empty((len(corners), 3))
    in_chunks(
        lambda begin, end: _centres(points, corners, centres, begin, end),
        len(corners), threads=threads,
    )  # fmt: skip
    return centres


def face_boxes(vertices: AnyFloat, faces: AnyInt, *, threads: int = 1) -> tuple[Float32, Float32]:
    """Least and greatest corner of every face, two (F, 3) float32, in the vertices' unit."""
    positions = as_kernel_input(vertices, np.float32)
    corners = as_kernel_input(faces, np.int32)
    low = np.empty((len(corners), 3), np.float32)
    high = np.empty((len(corners), 3), np.float32)
    in_chunks(
        lambda begin, end: _boxes(positions, corners, low, high, begin, end),
        len(corners), threads=threads,
    )  # fmt: skip
    return low, high


def label_boxes(labels: Int32, size: Int64, low: Float32, high: Float32) -> tuple[Float32, Float32]:
    """Box of the faces of every label, two (L, 3) float32; ``size`` are faces per label, >= 1."""
    return _label_boxes(as_kernel_input(labels, np.int32), len(size), low, high)


def label_sums(labels: Int32, count: int, values: Float32) -> tuple[Int64, Float64]:
    """Faces of every label 0..count-1 and the sum of their values, in face order, in float64."""
    return _label_sums(
        as_kernel_input(labels, np.int32), count, as_kernel_input(values, np.float32)
    )


def first_faces(labels: Int32, count: int) -> Int64:
    """Lowest face of every label 0..count-1, (count,) int64; 0 for labels that do not occur."""
    return _first_faces(as_kernel_input(labels, np.int32), count)


def main_labels(labels: Int32, count: int, kinds: Int32) -> tuple[Int32, Int32]:
    """Say which kind most faces of every label have, and how many kinds it has.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        0..count-1.
    count : int
        Number of labels.
    kinds : ndarray of shape (F,), int32
        Any second label, >= 0.

    Returns
    -------
    main : ndarray of shape (count,), int32
        The lowest of equally common kinds; -1 for labels that do not occur.
    n_kinds : ndarray of shape (count,), int32
    """
    given = as_kernel_input(kinds, np.int32)
    limit = int(given.max()) + 1 if len(given) else 0
    labels_and_counts: tuple[Int32, Int32] = _main_labels(
        as_kernel_input(labels, np.int32), count, given, limit
    )
    return labels_and_counts


def dense_labels(labels: AnyInt) -> Int32:
    """Labels as 0.. without gaps, in their own order."""
    if len(labels) == 0:
        return np.zeros(0, np.int32)
    used = np.zeros(int(labels.max()) + 1, np.bool_)
    used[labels] = True
    numbers = np.cumsum(used, dtype=np.int32)
    numbers -= 1
    dense: Int32 = np.take(numbers, labels)
    return dense


def edge_steps(
    vertices: AnyFloat,
    edges: Int32,
    *,
    longest: float | None = None,
    threads: int = 1,
) -> Int64:
    """Edge lengths as whole steps, at least 1, (P,) int64; see ``unit_graph.py``.

    Steps are shares of the longest edge: of these, or as given where they are part of more.
    """
    steps = np.empty(len(edges), np.int64)
    if len(edges) == 0:
        return steps
    points, ends = mesh_input(vertices, edges)
    if longest is None:
        longest = longest_edge(vertices, edges, threads=threads)
    scale = _LENGTH_STEPS / longest if longest > 0.0 else 0.0
    in_chunks(
        lambda begin, end: _edge_steps(points, ends, scale, steps, begin, end),
        len(ends), threads=threads,
    )  # fmt: skip
    return steps


def steps_of_lengths(length: Float64, longest: float) -> Int64:
    """Lengths as whole steps of the longest edge, at least 1; see :func:`edge_steps`."""
    scale = _LENGTH_STEPS / longest if longest > 0.0 else 0.0
    return np.maximum(np.rint(length * scale), 1.0).astype(np.int64)


def longest_edge(vertices: AnyFloat, edges: Int32, *, threads: int = 1) -> float:
    """Length of the longest of some edges (P, 2), in the vertices' unit; 0 where there is none."""
    points, ends = mesh_input(vertices, edges)
    longest = in_chunks(
        lambda begin, end: _longest_edge(points, ends, begin, end), len(ends), threads=threads
    )
    return max(longest, default=0.0)


def face_areas(vertices: AnyFloat, faces: AnyInt, *, threads: int = 1) -> Float64:
    """Area of every face, (F,) float64, in the square of the vertices' unit."""
    points, corners = mesh_input(vertices, faces)
    area = np.empty(len(corners))
    in_chunks(
        lambda begin, end: _areas(points, corners, area, begin, end), len(corners), threads=threads
    )
    return area


def surface_area(vertices: AnyFloat, faces: AnyInt, *, threads: int = 1) -> float:
    """Area of all faces, in the square of the vertices' unit."""
    area = face_areas(vertices, faces, threads=threads)
    return float(area.sum())


def automatic_extent(
    vertices: AnyFloat,
    faces: AnyInt,
    max_faces: int,
    *,
    threads: int = 1,
) -> float:
    """1.2 times the side of the square that ``max_faces`` faces of mean area fill."""
    area = surface_area(vertices, faces, threads=threads)
    return extent_of_area(area, len(faces), float(np.ptp(vertices, axis=0).max()), max_faces)


def extent_of_area(area: float, n_faces: int, widest: float, max_faces: int) -> float:
    """Automatic extent from what :func:`automatic_extent` measures of a mesh (or of its tiles)."""
    side = _AUTO_EXTENT * float(np.sqrt(area * max_faces / n_faces))
    # every face has zero area: do not cut by width
    return side if side > 0.0 else max(widest, 1.0)


def mesh_input(vertices: AnyFloat, indices: AnyInt) -> tuple[AnyArray, Int32]:
    """Vertices (float32 stays, everything else becomes float64) and indices for the kernels."""
    dtype = np.float32 if vertices.dtype == np.float32 else np.float64
    return as_kernel_input(vertices, dtype), as_kernel_input(indices, np.int32)


@numba.njit(cache=True, nogil=True)
def _centres(vertices: AnyArray, faces: Int32, centres: Float64, begin: int, end: int) -> None:
    for f in range(begin, end):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for axis in range(3):
            total = np.float64(vertices[a, axis]) + np.float64(vertices[b, axis])
            centres[f, axis] = (total + np.float64(vertices[c, axis])) / 3.0


@numba.njit(cache=True, nogil=True)
def _boxes(
    vertices: Float32, faces: Int32, low: Float32, high: Float32, begin: int, end: int
) -> None:
    for f in range(begin, end):
        for axis in range(3):
            a = vertices[faces[f, 0], axis]
            b = vertices[faces[f, 1], axis]
            c = vertices[faces[f, 2], axis]
            low[f, axis] = min(a, b, c)
            high[f, axis] = max(a, b, c)


@numba.njit(cache=True, nogil=True)
def _label_boxes(labels: Int32, count: int, low: Float32, high: Float32) -> tuple[Float32, Float32]:
    least = np.full((count, 3), np.float32(np.inf), np.float32)
    most = np.full((count, 3), np.float32(-np.inf), np.float32)
    for f in range(len(labels)):
        label = labels[f]
        for axis in range(3):
            least[label, axis] = min(least[label, axis], low[f, axis])
            most[label, axis] = max(most[label, axis], high[f, axis])
    return least, most


@numba.njit(cache=True, nogil=True)
def _label_sums(labels: Int32, count: int, values: Float32) -> tuple[Int64, Float64]:
    size = np.zeros(count, np.int64)
    total = np.zeros(count, np.float64)
    for f in range(len(labels)):
        size[labels[f]] += 1
        total[labels[f]] += np.float64(values[f])
    return size, total


@numba.njit(cache=True, nogil=True)
def _main_labels(labels: Int32, count: int, kinds: Int32, limit: int) -> tuple[Int32, Int32]:
    # (1) Sort faces by label, as CSR.
    starts = np.zeros(count + 1, np.int64)
    for f in range(len(labels)):
        starts[labels[f] + 1] += 1
    for label in range(count):
        starts[label + 1] += starts[label]
    by_label = np.empty(len(labels), np.int32)  # the kinds, grouped by label
    cursor = starts[:-1].copy()
    for f in range(len(labels)):
        by_label[cursor[labels[f]]] = kinds[f]
        cursor[labels[f]] += 1
    # (2) Count kinds label by label. Invariant: `seen` is 0 everywhere between labels; only what
    # was counted is cleared. Of kinds with as many faces the lower wins.
    main = np.full(count, -1, np.int32)
    n_kinds = np.zeros(count, np.int32)
    seen = np.zeros(limit, np.int64)
    for label in range(count):
        most = 0
        for i in range(starts[label], starts[label + 1]):
            kind = by_label[i]
            seen[kind] += 1
            if seen[kind] == 1:
                n_kinds[label] += 1
            if seen[kind] > most or (seen[kind] == most and kind < main[label]):
                most = seen[kind]
                main[label] = kind
        for i in range(starts[label], starts[label + 1]):
            seen[by_label[i]] = 0
    return main, n_kinds


@numba.njit(cache=True, nogil=True)
def _first_faces(labels: Int32, count: int) -> Int64:
    first = np.zeros(count, np.int64)
    for f in range(len(labels) - 1, -1, -1):
        first[labels[f]] = f
    return first


@numba.njit(cache=True, nogil=True)
def _length(vertices: AnyArray, a: int, b: int) -> float:
    x = np.float64(vertices[a, 0]) - np.float64(vertices[b, 0])
    y = np.float64(vertices[a, 1]) - np.float64(vertices[b, 1])
    z = np.float64(vertices[a, 2]) - np.float64(vertices[b, 2])
    length: float = np.sqrt(x * x + y * y + z * z)
    return length


@numba.njit(cache=True, nogil=True)
def _longest_edge(vertices: AnyArray, edges: Int32, begin: int, end: int) -> float:
    longest = 0.0
    for i in range(begin, end):
        longest = max(longest, _length(vertices, edges[i, 0], edges[i, 1]))
    return longest


@numba.njit(cache=True, nogil=True)
def _edge_steps(
    vertices: AnyArray, edges: Int32, scale: float, steps: Int64, begin: int, end: int
) -> None:
    for i in range(begin, end):
        length = np.rint(_length(vertices, edges[i, 0], edges[i, 1]) * scale)
        steps[i] = np.int64(length) if length > 1.0 else 1


@numba.njit(cache=True, nogil=True)
def _areas(vertices: AnyArray, faces: Int32, area: Float64, begin: int, end: int) -> None:
    for f in range(begin, end):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux = np.float64(vertices[b, 0]) - np.float64(vertices[a, 0])
        uy = np.float64(vertices[b, 1]) - np.float64(vertices[a, 1])
        uz = np.float64(vertices[b, 2]) - np.float64(vertices[a, 2])
        vx = np.float64(vertices[c, 0]) - np.float64(vertices[a, 0])
        vy = np.float64(vertices[c, 1]) - np.float64(vertices[a, 1])
        vz = np.float64(vertices[c, 2]) - np.float64(vertices[a, 2])
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area[f] = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
