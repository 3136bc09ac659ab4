"""The Triangle Pool Algorithm (TPA): faces of like colour that hang together.

Thesis section 3.5, its symbols in brackets:

1. index of every face [l_i]: CIEDE2000 of its mean vertex colour to white (3.1), or any scalar
   given;
2. separation [d_i]: distance of the face's centre to one fixed point, over the largest (3.2);
3. similarity [s_i] = mu * l_i + tau * d_i (3.3);
4. k from chaining the sorted s with threshold Th (3.4); level 2 pools = 1-D k-means of s with that
   k;
5. level 3 pools = connected components of the faces of each level 2 pool;
6. small level 3 pools (faces / all < sTh, 3.5) join large ones (3.6).

Where the text is silent or cannot be meant, this module departs from it and says so:

- *Scale.* l runs 0..100 in CIEDE2000 but Th = 0.7 and tau = 0.1 only make sense for 0..1:
  ``normalise="minmax"`` is the default (``segmentation.md``).
- *k-means* is solved exactly (``kmeans_1d.py``) instead of from a random start.
- *Refining* (3.6) runs in rounds. In each round every small pool that touches a large pool joins
  the one of nearest mean s (the mean of the original large pool, as gamma_L is); what it touched
  then touches that large pool in the next round. Small pools that can reach no large pool first
  join each other, each its most similar neighbour, until one of the unions is large. Ties: nearer
  mean, then more faces, then lower number (pools are numbered by their first face). What is left
  touches nothing: see ``islands``.

PURE: no I/O, no clock. Time O(n log n) for the sort, everything else linear; peak about 70 bytes
per face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Int32, UInt8
from terraport_pipeline.geometry.mesh.adjacency import (
    components,
    face_pairs,
    order_of_scattered,
    vertex_pairs,
)
from terraport_pipeline.geometry.mesh.chunks import side_by_side
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.regions.engine_options import (
    FINE_POOLS,
    REGION_POOLS,
    TrianglePoolOptions,
)
from terraport_pipeline.geometry.regions.kmeans_1d import kmeans_1d
from terraport_pipeline.geometry.regions.pool_refine import (
    join_nearest,
    number_by_first,
    refine_pools,
)
from terraport_pipeline.geometry.regions.similarity import similarity_index

__all__ = [
    "FINE_POOLS",
    "REGION_POOLS",
    "TrianglePoolOptions",
    "TrianglePools",
    "chain_count",
    "face_similarity",
    "pools_of_similarity",
    "triangle_pools",
    "triangle_pools_many",
]


NumberArray = TypeVar("NumberArray", Int32, Float32)


@dataclass(frozen=True, slots=True, eq=False)
class TrianglePools:
    """Pool and similarity index of every face, and the numbers of pools at the levels before."""

    labels: Int32
    """(F,) pool of every face, numbered 0.. by each pool's first face."""
    similarity: Float32
    """(F,) s of every face."""
    k: int
    """Number of level 2 pools asked of k-means."""
    level3_count: int
    """Number of level 3 pools before refining."""
    count: int
    """Number of pools in ``labels``."""
    islands: int
    """Level 3 unions that could reach no large pool (joined to the nearest, or left, by
    ``islands``)."""


def triangle_pools(
    vertices: AnyFloat,
    faces: AnyInt,
    *,
    colours: UInt8 | None = None,
    scalar: AnyFloat | None = None,
    options: TrianglePoolOptions = REGION_POOLS,
    pairs: Int32 | None = None,
    threads: int = 1,
) -> TrianglePools:
    """Segment a mesh with the Triangle Pool Algorithm.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Positions, any one unit, any frame; finite.
    faces : ndarray of shape (F, 3), integer
        Vertex indices. F may be 0. Non-manifold edges, repeated and zero-area faces are allowed.
    colours : ndarray of shape (V, 3), uint8, optional
        sRGB per vertex.
    scalar : ndarray of shape (F,), float, optional
        One finite value per face instead of colours (a shape diameter, an attribute).
    options : TrianglePoolOptions
        Parameters.
    pairs : ndarray of shape (P, 2), int32, optional
        Neighbouring faces where the caller has them already (:func:`face_pairs`, or
        :func:`vertex_pairs` for ``contiguity="vertex"``).
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    TrianglePools
        Every face in exactly one pool. The same input gives the same bytes; renumbering vertices
        changes nothing.

    Raises
    ------
    ValueError
        Wrong shapes, not exactly one of ``colours`` and ``scalar``, or values that are not finite.

    Examples
    --------
    Four triangles in a row, two dark and two light:

    >>> x, y = np.repeat([0.0, 1.0, 2.0], 2), np.tile([0.0, 1.0], 3)
    >>> vertices = np.stack([x, y, np.zeros(6)], axis=1)
    >>> faces = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
    >>> triangle_pools(vertices, faces, scalar=np.array([0.0, 0.1, 0.9, 1.0])).labels.tolist()
    [0, 0, 1, 1]
    """
    by_edge = pairs if options.contiguity == "edge" else None
    by_vertex = pairs if options.contiguity == "vertex" else None
    return triangle_pools_many(
        vertices, faces, [options], colours=colours, scalar=scalar, pairs=by_edge,
        touching=by_vertex, threads=threads,
    )[0]  # fmt: skip


def triangle_pools_many(
    vertices: AnyFloat,
    faces: AnyInt,
    options: Sequence[TrianglePoolOptions],
    *,
    colours: UInt8 | None = None,
    scalar: AnyFloat | None = None,
    pairs: Int32 | None = None,
    touching: Int32 | None = None,
    threads: int = 1,
) -> list[TrianglePools]:
    """Segment one mesh with several sets of options, sharing what they have in common.

    Parameters
    ----------
    vertices, faces, colours, scalar
        As in :func:`triangle_pools`.
    options : sequence of TrianglePoolOptions
        One result for each.
    pairs : ndarray of shape (P, 2), int32, optional
        Faces that share an edge, where the caller has them: ``face_pairs(...)[0]``.
    touching : ndarray of shape (Q, 2), int32, optional
        Faces that share a vertex, likewise: ``vertex_pairs(...)``.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    list of TrianglePools
        To the byte what :func:`triangle_pools` gives for each of the options.

    Raises
    ------
    ValueError
        As :func:`triangle_pools`.

    Notes
    -----
    Options that agree on what s is made of (``mu``, ``tau``, ``normalise``, ``attribute_range``,
    ``origin``) share s and its sorting; all share the adjacency, which is found beside s when there
    are two threads.
    """
    _validate_inputs(vertices, faces, colours, scalar)
    # Faces that lie scattered in the list are worked on in another order: same bytes, half the
    # time. Not where something is given, or counts, by the order of the list.
    order = None
    by_place = all(o.contiguity == "edge" and o.origin == "min_corner" for o in options)
    if by_place and pairs is None and scalar is None and len(faces):
        order = order_of_scattered(as_kernel_input(faces, np.int32), len(vertices))
    listed = faces
    if order is not None:
        faces = np.ascontiguousarray(faces[order])
    near: dict[str, Int32 | None] = {"edge": pairs, "vertex": touching}
    shared: dict[tuple[float | str, ...], tuple[Float32, Float32]] = {}

    def find_neighbours() -> None:
        wanted = {o.contiguity for o in options} if len(faces) else set()
        if near["edge"] is None and "edge" in wanted:
            near["edge"] = face_pairs(faces, len(vertices), threads=threads)[0]
        if near["vertex"] is None and "vertex" in wanted:
            near["vertex"] = vertex_pairs(faces, len(vertices))

    def find_similarity() -> None:
        for o in options:
            if o.similarity_key not in shared:
                s = _similarity(vertices, faces, colours, scalar, o, threads)
                shared[o.similarity_key] = s, np.sort(s)

    side_by_side([find_neighbours, find_similarity], threads=threads)
    return [
        _pools(
            vertices, listed, *shared[o.similarity_key], o, near[o.contiguity], order, threads
        )
        for o in options
    ]  # fmt: skip


def pools_of_similarity(
    vertices: AnyFloat,
    faces: AnyInt,
    similarity: Float32,
    *,
    options: TrianglePoolOptions = REGION_POOLS,
    pairs: Int32 | None = None,
    ordered: Float32 | None = None,
    threads: int = 1,
) -> TrianglePools:
    """Segment a mesh whose similarity index is known: steps 4 to 6.

    Parameters
    ----------
    vertices, faces, options, pairs, threads
        As in :func:`triangle_pools`; of the options only those of steps 4 to 6 count.
    similarity : ndarray of shape (F,), float32
        [s_i] of every face; finite.
    ordered : ndarray of shape (F,), float32, optional
        ``np.sort(similarity)`` where the caller has it already.

    Returns
    -------
    TrianglePools
    """
    if ordered is None:
        ordered = np.sort(similarity)
    return _pools(vertices, faces, similarity, ordered, options, pairs, None, threads)


def _pools(
    vertices: AnyFloat,
    faces: AnyInt,
    similarity: Float32,
    ordered: Float32,
    options: TrianglePoolOptions,
    pairs: Int32 | None,
    order: Int32 | None,
    threads: int,
) -> TrianglePools:
    """Run steps 4 to 6; with an `order`, `similarity` and `pairs` are those of ``faces[order]``."""
    n_faces = len(faces)
    if n_faces == 0:
        return TrianglePools(np.zeros(0, np.int32), similarity, 0, 0, 0, 0)
    # (1) level 2: k by chaining, then k-means
    k = chain_count(ordered, options.threshold)
    level2 = kmeans_1d(ordered, k).assign(similarity, threads=threads)
    del ordered
    # (2) level 3: connected components
    if pairs is None:
        if options.contiguity == "edge":
            pairs = face_pairs(faces, len(vertices), threads=threads)[0]
        else:
            pairs = vertex_pairs(faces, len(vertices))
    level3, level3_count = components(n_faces, pairs, labels=level2)
    del level2
    pair_labels = None
    if order is not None:
        # Numbered by their first face in the list, as without an order; then in the list's order.
        first = np.full(level3_count, n_faces, np.int32)
        np.minimum.at(first, level3, order)
        rank = np.empty(level3_count, np.int32)
        rank[np.argsort(first)] = np.arange(level3_count, dtype=np.int32)
        pair_labels = rank[level3]
        level3, similarity = _listed(order, pair_labels), _listed(order, similarity)
    # (3) refining
    smallest = options.small_threshold * n_faces
    if smallest <= 0.0 or level3_count == 1:
        return TrianglePools(level3, similarity, k, level3_count, level3_count, 0)
    merged, unreached = refine_pools(level3, level3_count, pairs, similarity, smallest, pair_labels)
    islands = int(np.count_nonzero(unreached))
    if islands and options.islands == "nearest" and islands < len(unreached):
        merged = join_nearest(vertices, faces, merged, unreached, threads=threads)
    labels, count = number_by_first(merged)
    return TrianglePools(labels, similarity, k, level3_count, count, islands)


def _listed(order: Int32, values: NumberArray) -> NumberArray:
    """Put values of ``faces[order]`` into the order of the faces."""
    listed = np.empty_like(values)
    listed[order] = values
    return listed


def face_similarity(
    vertices: AnyFloat,
    faces: AnyInt,
    *,
    colours: UInt8 | None = None,
    scalar: AnyFloat | None = None,
    options: TrianglePoolOptions = REGION_POOLS,
    threads: int = 1,
) -> Float32:
    """Similarity index s of every face (3.3).

    Parameters
    ----------
    vertices, faces, colours, scalar, options, threads
        As in :func:`triangle_pools`.

    Returns
    -------
    ndarray of shape (F,), float32
        Computed in float64 and rounded once; every later comparison uses the rounded value.

    Raises
    ------
    ValueError
        As in :func:`triangle_pools`.
    """
    _validate_inputs(vertices, faces, colours, scalar)
    return _similarity(vertices, faces, colours, scalar, options, threads)


def chain_count(ordered: Float32, threshold: float) -> int:
    """Count the chained bins (3.4): a value over ``threshold`` above a bin's first opens the next.

    Parameters
    ----------
    ordered : ndarray of shape (N,), float32
        Ascending.
    threshold : float
        [Th]; a value *at* the threshold stays in the bin, as written.

    Returns
    -------
    int
        0 for no values.

    Examples
    --------
    >>> chain_count(np.array([0.0, 0.5, 0.75, 1.0, 1.25], dtype=np.float32), 0.5)
    2
    """
    return int(_chain_count(ordered, threshold))


def _validate_inputs(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8 | None,
    scalar: AnyFloat | None,
) -> None:
    # (1) The mesh.
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        msg = f"vertices {vertices.shape} and faces {faces.shape}, expected (V, 3) and (F, 3)"
        raise ValueError(msg)
    if len(faces) and (int(faces.min()) < 0 or int(faces.max()) >= len(vertices)):
        msg = f"face indices {faces.min()}..{faces.max()}, expected 0..{len(vertices) - 1}"
        raise ValueError(msg)
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        msg = f"vertex {bad} is {vertices[bad].tolist()}, expected finite coordinates"
        raise ValueError(msg)
    # (2) Exactly one of colours and scalar, of the mesh's size.
    if (colours is None) == (scalar is None):
        given = "neither" if colours is None else "both"
        msg = f"received {given} of colours and scalar, expected exactly one"
        raise ValueError(msg)
    if colours is not None and (colours.shape != vertices.shape or colours.dtype != np.uint8):
        msg = f"colours are {colours.dtype} {colours.shape}, expected uint8 {vertices.shape}"
        raise ValueError(msg)
    if scalar is not None:
        if scalar.shape != (len(faces),):
            msg = f"scalar has shape {scalar.shape}, expected ({len(faces)},)"
            raise ValueError(msg)
        if not np.isfinite(scalar).all():
            bad = int(np.flatnonzero(~np.isfinite(scalar))[0])
            msg = f"scalar of face {bad} is {scalar[bad]}, expected a finite number"
            raise ValueError(msg)


def _similarity(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8 | None,
    scalar: AnyFloat | None,
    options: TrianglePoolOptions,
    threads: int,
) -> Float32:
    if len(faces) == 0:
        return np.zeros(0, np.float32)
    return similarity_index(
        vertices, faces, colours=colours, scalar=scalar, mu=options.mu, tau=options.tau,
        normalise=options.normalise, attribute_range=options.attribute_range,
        origin=options.origin, threads=threads,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _chain_count(ordered: Float32, threshold: float) -> int:
    count = 0
    first = 0.0
    for i in range(len(ordered)):
        value = np.float64(ordered[i])
        if count == 0 or value - first > threshold:
            count += 1
            first = value
    return count
