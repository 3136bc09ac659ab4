"""The similarity index s of the Triangle Pool Algorithm, thesis equations (3.1) to (3.3).

Every pass over the faces runs in pieces (``chunks.py``) and recomputes centres instead of keeping
them: 12 bytes per face stay until the end where whole arrays of centres and colours took 90.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyArray, AnyFloat, AnyInt, Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.face_measures import mesh_input
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.regions.colour import white_index

__all__ = ["similarity_index"]


_LEAST: Final = 0
_SUM: Final = 1


def similarity_index(
    vertices: AnyFloat,
    faces: AnyInt,
    *,
    colours: UInt8 | None,
    scalar: AnyFloat | None,
    mu: float,
    tau: float,
    normalise: str,
    attribute_range: float,
    origin: str,
    threads: int = 1,
) -> Float32:
    """Similarity index of every face; see ``TrianglePoolOptions`` for the parameters.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Positions; finite.
    faces : ndarray of shape (F, 3), integer
        Vertex indices, F >= 1, all in range.
    colours : ndarray of shape (V, 3), uint8, or None
        sRGB per vertex.
    scalar : ndarray of shape (F,), float, or None
        Value per face; exactly one of the two is given.
    mu, tau, normalise, attribute_range, origin
        As in ``TrianglePoolOptions``.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    ndarray of shape (F,), float32
        Computed in float64 and rounded once.
    """
    # (1) The white index or the scalar of every face, and how it is stretched.
    points, corners = mesh_input(vertices, faces)
    n_faces = len(corners)
    index: AnyArray
    if colours is not None:
        index = white_index(colours, corners, threads=threads)
    else:
        index = as_kernel_input(np.asarray(scalar), np.float64)
    low, high = float(index.min()), float(index.max())
    shift, scale = 0.0, 1.0
    if normalise == "minmax":
        shift, scale = low, attribute_range / (high - low) if high > low else 0.0
    elif normalise == "max":
        largest = max(abs(low), abs(high))
        scale = attribute_range / largest if largest > 0.0 else 0.0
    # (2) Distances from the origin, only where they count; relative to the farthest.
    distance = np.zeros(0)
    if tau > 0.0:
        distance = np.empty(n_faces)
        start = _origin(points, corners, origin, threads)
        farthest = max(
            in_chunks(
                lambda begin, end: _distances(points, corners, start, distance, begin, end),
                n_faces, threads=threads,
            )
        )  # fmt: skip
        if farthest == 0.0:  # all centres coincide: d is zero everywhere
            distance, tau = np.zeros(0), 0.0
    else:
        farthest = 1.0
    # (3) s = mu * index + tau * distance, equation (3.1).
    similarity = np.empty(n_faces, np.float32)
    given = as_kernel_input(index, np.float32 if index.dtype == np.float32 else np.float64)
    in_chunks(
        lambda begin, end: _combine(
            given, distance, shift, scale, mu, tau, farthest, similarity, begin, end
        ),
        n_faces, threads=threads,
    )  # fmt: skip
    return similarity


def _origin(points: AnyArray, faces: Int32, origin: str, threads: int) -> Float64:
    """Choose the point that the distance d of equation (3.2) is measured from."""
    if origin == "first":
        return np.asarray(_reduce(points, faces, _SUM, 0, 1))
    kind = _SUM if origin == "centroid" else _LEAST
    chunks = np.stack(
        in_chunks(
            lambda begin, end: _reduce(points, faces, kind, begin, end), len(faces), threads=threads
        )
    )
    if origin == "centroid":
        mean: Float64 = chunks.sum(axis=0) / len(faces)
        return mean
    least: Float64 = chunks.min(axis=0)
    return least


@numba.njit(cache=True, nogil=True)
def _centre(points: AnyArray, faces: Int32, f: int, axis: int) -> float:
    """One coordinate of a face's centre, to the same bit as ``face_centres``."""
    total = np.float64(points[faces[f, 0], axis]) + np.float64(points[faces[f, 1], axis])
    return (total + np.float64(points[faces[f, 2], axis])) / 3.0


@numba.njit(cache=True, nogil=True)
def _reduce(points: AnyArray, faces: Int32, kind: int, begin: int, end: int) -> Float64:
    """Least coordinates or sum of the centres of some faces."""
    total = np.zeros(3) if kind == _SUM else np.full(3, np.inf)
    for f in range(begin, end):
        for axis in range(3):
            value = _centre(points, faces, f, axis)
            total[axis] = total[axis] + value if kind == _SUM else min(total[axis], value)
    return total


@numba.njit(cache=True, nogil=True)
def _distances(
    points: AnyArray,
    faces: Int32,
    start: Float64,
    distance: Float64,
    begin: int,
    end: int,
) -> float:
    """Distances of some centres to the start, and the largest of them."""
    farthest = 0.0
    for f in range(begin, end):
        x = _centre(points, faces, f, 0) - start[0]
        y = _centre(points, faces, f, 1) - start[1]
        z = _centre(points, faces, f, 2) - start[2]
        distance[f] = np.sqrt(x * x + y * y + z * z)
        farthest = max(farthest, distance[f])
    return farthest


@numba.njit(cache=True, nogil=True)
def _combine(
    index: AnyArray,
    distance: Float64,
    shift: float,
    scale: float,
    mu: float,
    tau: float,
    farthest: float,
    similarity: Float32,
    begin: int,
    end: int,
) -> None:
    """Equation (3.1) for faces begin..end, from the stretched index and the distance."""
    for f in range(begin, end):
        # (1) The index, stretched and weighted.
        value = (np.float64(index[f]) - shift) * scale * mu
        # (2) The distance, where it counts; `distance` is empty where it does not.
        if tau > 0.0:
            value += tau * (distance[f] / farthest)
        similarity[f] = np.float32(value)
