"""Both levels of a scene, and rays against mixtures of them.

A *mixed model* is what a client shows: the detail of the loaded segments plus every base face that
the cover rule does not hide. :class:`MixedModel` traces it through the two full meshes, so that a
hundred subsets cost no more than two ray scenes; :class:`BuiltModel` builds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Int32
from terraport_pipeline.engines.rays import RayScene

__all__ = [
    "BuiltModel",
    "HandOffModel",
    "MixedModel",
    "Places",
    "ShownFaces",
    "TracedModel",
    "face_normals",
]

MAX_RECASTS: Final = 64
"""Hidden faces that a ray is followed through; what is left then is judged exactly."""

STEP_OFF: Final = 4e-7
"""Share of a coordinate (a few float32 steps) by which a ray starts behind the face it left."""

START_BEHIND: Final = 1e-3
"""Share of the reach by which a measuring ray starts behind its place: a surface that lies in the
very place must not be missed by rounding."""


@dataclass(frozen=True, slots=True)
class HandOffModel:
    """Both levels of a scene, as a client gets them."""

    detail_vertices: Float32
    """(V, 3) metres, scene frame."""
    detail_faces: Int32
    """(F, 3)."""
    segment_of_face: Int32
    """(F,) segment of each detail face."""
    segment_count: int
    base_vertices: Float32
    """(W, 3) metres, scene frame."""
    base_faces: Int32
    """(B, 3)."""
    cover_offsets: AnyInt
    """(B + 1,) where each base face's segments begin in ``cover_segments``."""
    cover_segments: AnyInt
    """Segment ids of all lists, one after another."""
    tolerance_m: float
    """How far apart the two levels may lie (the manifest's ``hand_off.tolerance_m``)."""


class TracedModel(Protocol):
    """A surface that tells how far along a ray it lies."""

    def closest(self, origins: Float32, directions: Float32) -> Float32:
        """Distance in metres to the nearest face shown, (R,); ``inf`` where there is none."""
        ...


class ShownFaces:
    """One mesh of which only some faces are shown."""

    def __init__(self, rays: RayScene, shown: Bool) -> None:
        self._rays = rays
        self._shown = shown

    def closest(
        self,
        origins: Float32,
        directions: Float32,
        first: tuple[Float32, Int32] | None = None,
    ) -> Float32:
        """Distance to a shown face: the first one, but for faces within a rounding step."""
        t, face = self._rays.closest_hit(origins, directions) if first is None else first
        t = t.copy()
        waiting = np.flatnonzero(face >= 0)
        waiting = waiting[~self._shown[face[waiting]]]
        size = np.abs(origins).max(axis=1, initial=1.0)
        for attempt in range(MAX_RECASTS):
            if len(waiting) == 0:
                return t
            # A ray that keeps meeting faces so near takes ever longer steps.
            step = STEP_OFF * (size[waiting] + t[waiting]) * (1 + attempt // 4)
            behind = t[waiting] + step
            starts = origins[waiting] + directions[waiting] * behind[:, None]
            further, face = self._rays.closest_hit(starts, directions[waiting])
            t[waiting] = behind + further
            hidden = (face >= 0) & ~self._shown[face]
            waiting = waiting[hidden]
        t[waiting] = np.inf
        return t


class MixedModel:
    """The mixed model of one subset, traced through its two full meshes."""

    def __init__(self, detail: ShownFaces, base: ShownFaces) -> None:
        self._detail = detail
        self._base = base

    def closest(self, origins: Float32, directions: Float32) -> Float32:
        """Distance to the nearest shown face; (R,)."""
        near = self._detail.closest(origins, directions)
        nearest: Float32 = np.minimum(near, self._base.closest(origins, directions))
        return nearest


class BuiltModel:
    """The mixed model of one subset, really built."""

    def __init__(self, model: HandOffModel, loaded: Bool, hidden: Bool) -> None:
        faces = np.concatenate(
            [
                model.detail_faces[loaded[model.segment_of_face]],
                model.base_faces[~hidden] + np.int32(len(model.detail_vertices)),
            ]
        )
        self._rays = RayScene(np.concatenate([model.detail_vertices, model.base_vertices]), faces)

    def closest(self, origins: Float32, directions: Float32) -> Float32:
        """Distance along each ray to the nearest face, (R,); infinite where it meets none."""
        return self._rays.closest_hit(origins, directions)[0]


class Places:
    """Points on a surface, and how far another surface lies from them."""

    def __init__(self, origins: Float32, directions: Float32, t: Float32, normals: Float32) -> None:
        self._t = t
        self._points = origins + directions * t[:, None]
        self._normals = normals

    def distance(self, model: TracedModel, ray_t: Float32 | np.float32, reach_m: float) -> Float32:
        """Distance to the model, (R,): along the ray, the normal or the vertical, least of these.

        Only places whose ray did not meet the model at the very point are looked at more closely.
        Beyond ``reach_m`` only the ray counts.
        """
        # inf - t stays inf: a ray that met nothing gives no distance.
        best: Float32 = np.abs(ray_t - self._t)
        apart = np.flatnonzero(best > 0)
        up = np.broadcast_to(np.array([0, 1, 0], dtype=np.float32), (len(apart), 3))
        # Outwards from the place, so that nothing stands in between: a ray towards it from afar
        # would meet another rock first, and call the surface behind that rock missing.
        behind = np.float32(START_BEHIND * reach_m)
        for axis in (self._normals[apart], up):
            for sign in (np.float32(1), np.float32(-1)):
                starts = self._points[apart] - axis * (sign * behind)
                t = model.closest(starts.astype(np.float32), (axis * sign).astype(np.float32))
                length = np.where(t <= reach_m + behind, np.abs(t - behind), np.inf)
                best[apart] = np.minimum(best[apart], length)
        return best

    def meets_vertical(self, model: TracedModel) -> Bool:
        """Tell where the model has surface above or below, at whatever height; (R,)."""
        up = np.broadcast_to(np.array([0, 1, 0], dtype=np.float32), self._points.shape)
        points = self._points.astype(np.float32)
        above = np.isfinite(model.closest(points, np.ascontiguousarray(up)))
        meets: Bool = above | np.isfinite(model.closest(points, -up))
        return meets


def face_normals(vertices: Float32, faces: Int32, face: Int32) -> Float32:
    """Compute unit normals of some faces, (R, 3); the vertical where a face has no area."""
    corner = vertices[faces[face]].astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.where(length > 0, normal / np.maximum(length, 1e-30), np.array([0.0, 1.0, 0.0]))
    return unit.astype(np.float32)
