"""Ray casting against a scene at full detail.

Segments whose box the ray meets are decoded, nearest first, and their triangles are tested exactly,
until no box is left that begins before the nearest hit.

References
----------
A. Williams, S. Barrus, R. K. Morley, P. Shirley, "An efficient and robust ray-box intersection
algorithm", Journal of Graphics Tools 10(1), 2005 (slabs); T. Möller, B. Trumbore, "Fast, minimum
storage ray/triangle intersection", Journal of Graphics Tools 2(1), 1997.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from terraport_payload import PayloadError, SegmentMesh
from terraport_payload.types import AnyArray, Float32, Float64, UInt32
from terraport_server.errors import PickTimeoutError
from terraport_store import RegionNames, Scene, StoreError
from terraport_wire import Hit

__all__ = ["MeshCache", "RayHit", "pick", "ray_box_entry", "ray_triangles"]

_EDGE = 1e-9
"""Barycentric tolerance: a ray through a shared edge must not pass between two faces."""


@dataclass(frozen=True, slots=True)
class RayHit:
    """Nearest face that a ray meets."""

    distance_m: float
    face: int
    weights: tuple[float, float, float]
    """Barycentric, of the face's three vertices."""


class MeshCache:
    """LRU cache of decoded segments. Thread-safe.

    Parameters
    ----------
    max_bytes
        Bound of the cache; a mesh that is larger is not cached.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._meshes: OrderedDict[tuple[str, int], SegmentMesh] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def size_bytes(self) -> int:
        """Size of the cached arrays."""
        return self._bytes

    def get(self, scene: Scene, segment: int) -> SegmentMesh:
        """Return a decoded segment, from the cache or the scene.

        Raises
        ------
        StoreError, PayloadError
            When its payload is damaged.
        """
        key = (scene.manifest.version, segment)
        with self._lock:
            mesh = self._meshes.get(key)
            if mesh is not None:
                self._meshes.move_to_end(key)
                return mesh
        # Decoded outside the lock: two threads may decode the same segment, which only costs time.
        mesh = scene.mesh(segment, recheck=True)
        with self._lock:
            if key not in self._meshes:
                self._meshes[key] = mesh
                self._bytes += _mesh_bytes(mesh)
            while self._bytes > self._max_bytes:
                _, dropped = self._meshes.popitem(last=False)
                self._bytes -= _mesh_bytes(dropped)
        return mesh


def pick(
    scene: Scene,
    cache: MeshCache,
    origin: Sequence[float],
    direction: Sequence[float] | None,
    *,
    names: RegionNames,
    max_distance_m: float,
    max_segments: int,
    time_is_up: Callable[[], bool],
    failed: Callable[[int, Exception], None],
) -> Hit | None:
    """Find the nearest hit of a ray. Blocks: call it in a thread.

    Parameters
    ----------
    scene
    cache
        Decoded segments.
    origin
        x, y, z in metres, scene frame.
    direction
        Of any length but 0; ``None`` = both directions of the vertical line through the origin; on
        a tie the lower hit.
    names
        Stable ids and labels of the scene's regions.
    max_distance_m
        Length of the ray.
    max_segments
        Maximum number of decoded segments.
    time_is_up
        Called before each segment.
    failed
        Called for a segment that cannot be read; it is skipped.

    Returns
    -------
    Hit or None
        ``None`` without a hit.

    Raises
    ------
    PickTimeoutError
        When the time or the number of segments is exceeded before the result is certain.

    Notes
    -----
    Invariant: ``best`` is the nearest hit of all segments tested, and every other segment begins
    at or behind the next one.
    """
    # Unit vectors: a distance along them is in metres.
    start = np.asarray(origin, dtype=np.float64)
    if direction is None:
        rays = [np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0])]
    else:
        towards = np.asarray(direction, dtype=np.float64)
        # Scaled first: the square of a very small or large component would underflow or overflow.
        towards = towards / np.abs(towards).max()
        rays = [towards / np.linalg.norm(towards)]
    best: tuple[RayHit, int, SegmentMesh, Float64] | None = None
    decoded = 0
    for ray in rays:
        entry = ray_box_entry(scene.index.bounds, start, ray)
        near = np.flatnonzero(entry <= max_distance_m)
        for segment in near[np.lexsort((near, entry[near]))].tolist():
            limit = max_distance_m if best is None else best[0].distance_m
            if entry[segment] > limit:
                break  # nothing behind it can be nearer
            if time_is_up() or decoded >= max_segments:
                raise PickTimeoutError(decoded)
            decoded += 1
            try:
                mesh = cache.get(scene, segment)
            except (StoreError, PayloadError, OSError) as error:
                failed(segment, error)
                continue
            hit = ray_triangles(mesh.positions, mesh.faces, start, ray)
            if hit is None or hit.distance_m > max_distance_m:
                continue
            # Strictly nearer: on a tie the earlier ray (down) and the earlier segment stay.
            if best is None or hit.distance_m < best[0].distance_m:
                best = (hit, segment, mesh, ray)
    if best is None:
        return None
    hit, segment, mesh, ray = best
    return _describe(scene, names, hit, segment, mesh, start + hit.distance_m * ray)


def ray_box_entry(bounds: Float32, origin: Float64, ray: Float64) -> Float64:
    """Return the distance at which a ray enters each box.

    Parameters
    ----------
    bounds
        (N, 6) min x, y, z, max x, y, z, metres.
    origin
        (3,) metres.
    ray
        (3,) unit vector.

    Returns
    -------
    ndarray
        (N,) metres; 0 where the origin is inside, ``inf`` where the ray misses.
    """
    boxes = bounds.astype(np.float64)
    enter = np.zeros(len(boxes))
    leave = np.full(len(boxes), np.inf)
    for axis in range(3):
        low, high = boxes[:, axis] - origin[axis], boxes[:, axis + 3] - origin[axis]
        if ray[axis] == 0.0:
            leave[(low > 0.0) | (high < 0.0)] = -np.inf
            continue
        one, two = low / ray[axis], high / ray[axis]
        enter = np.maximum(enter, np.minimum(one, two))
        leave = np.minimum(leave, np.maximum(one, two))
    return np.where(enter <= leave, enter, np.inf)


def ray_triangles(
    positions: Float32,
    faces: UInt32,
    origin: Float64,
    ray: Float64,
) -> RayHit | None:
    """Find the nearest triangle that a ray meets, from either side.

    Parameters
    ----------
    positions
        (V, 3) metres.
    faces
        (F, 3) vertex indices.
    origin
        (3,) metres.
    ray
        (3,) unit vector.

    Returns
    -------
    RayHit or None
        The lowest face index on a tie. Degenerate faces and faces parallel to the ray have no hit.
    """
    corners = positions.astype(np.float64)[faces]
    first, edge_1, edge_2 = (
        corners[:, 0],
        corners[:, 1] - corners[:, 0],
        corners[:, 2] - corners[:, 0],
    )
    across = np.cross(ray, edge_2)
    determinant = np.einsum("ij,ij->i", edge_1, across)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        to_origin = origin - first
        u = np.einsum("ij,ij->i", to_origin, across) / determinant
        around = np.cross(to_origin, edge_1)
        v = around @ ray / determinant
        distance = np.einsum("ij,ij->i", edge_2, around) / determinant
        met = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE) & (distance >= 0.0)
        met &= determinant != 0.0
    if not met.any():
        return None
    distance = np.where(met, distance, np.inf)
    face = int(np.argmin(distance))
    weights = (float(1.0 - u[face] - v[face]), float(u[face]), float(v[face]))
    return RayHit(float(distance[face]), face, weights)


def _describe(
    scene: Scene,
    names: RegionNames,
    hit: RayHit,
    segment: int,
    mesh: SegmentMesh,
    position: Float64,
) -> Hit:
    vertices = mesh.faces[hit.face]
    a, b, c = mesh.positions[vertices].astype(np.float64)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    region = int(scene.index.region[segment])
    if mesh.region_ids is not None:
        region = int(mesh.region_ids[vertices[0]])
    weights = np.clip(hit.weights, 0.0, 1.0)
    attributes = {}
    for name, values in mesh.attributes.items():
        value = float(np.dot(weights, values[vertices].astype(np.float64)))
        if np.isfinite(value):
            attributes[name] = value
    return Hit(
        position=_triple(position),
        normal=_triple(normal),
        segment=segment,
        region=region,
        stable_id=names.stable_id(region),
        label=names.label(region),
        height_m=float(scene.manifest.origin[2] + position[1]),
        attributes=attributes,
    )


def _triple(vector: Float64) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))


def _mesh_bytes(mesh: SegmentMesh) -> int:
    arrays: list[AnyArray | None] = [
        mesh.positions,
        mesh.faces,
        mesh.normals,
        mesh.colours,
        mesh.region_ids,
        *mesh.attributes.values(),
    ]
    return sum(array.nbytes for array in arrays if array is not None)
