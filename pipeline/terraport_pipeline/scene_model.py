"""A published scene as plain meshes: every payload decoded, as a client gets it.

Memory: about 60 bytes per detail face (vertices are half as many as faces), 80 with attributes.
Textures stay in the scene: see :mod:`.scene_textures`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import Cover, PayloadError, SegmentMesh, decode_glb
from terraport_pipeline.engines.texturing import Texturing
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.mixed_model import HandOffModel
from terraport_pipeline.model import Float32, Int32, Mesh
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.scene_textures import SceneTextures, TextureParts, open_images
from terraport_store import DamagedSceneError, Manifest, Scene

__all__ = ["MAX_DETAIL_FACES", "SceneModel", "load_scene_model"]

MAX_DETAIL_FACES: Final = 60_000_000
"""Largest scene held in memory at once (about 5 GB)."""

GREY: Final = 150
"""Drawn where a scene has no colour."""


@dataclass(frozen=True, slots=True)
class SceneModel:
    """Both levels of a scene with everything that pictures and proofs need."""

    manifest: Manifest
    detail: Mesh
    """All segments one after the other; border vertices stand once in each segment."""
    segment_of_face: Int32
    """(F,) segment of each detail face."""
    region_of_face: Int32
    """(F,) region of each detail face; -1 where a payload has none."""
    segment_bounds: Float32
    """(S, 6) metres: minimum x, y, z and maximum x, y, z of each segment."""
    base: Mesh
    cover: Cover
    textures: SceneTextures | None = None
    """None when no payload has one; vertices then have their own colours, else the textures'."""

    def hand_off_model(self) -> HandOffModel:
        """Take what the proof of the hand-off looks at."""
        return HandOffModel(
            self.detail.vertices,
            self.detail.faces,
            self.segment_of_face,
            self.manifest.counts.segments,
            self.base.vertices,
            self.base.faces,
            self.cover.offsets,
            self.cover.segments,
            self.manifest.hand_off.tolerance_m,
        )


def load_scene_model(scene: Scene, *, progress: Progress | None = None) -> SceneModel:
    """Read and decode a whole scene.

    Parameters
    ----------
    scene : Scene
        Open.
    progress : Progress, optional
        Advances by segments.

    Returns
    -------
    SceneModel
        Arrays of its own: the scene may be closed.

    Raises
    ------
    ResourceError
        When the scene has more than :data:`MAX_DETAIL_FACES` faces.
    DamagedSceneError
        When a payload fails its hash, does not decode, or has other counts than the index says.
    """
    watcher = progress or NullProgress()
    index, manifest = scene.index, scene.manifest
    total_faces = int(index.face_count.sum(dtype=np.int64))
    if total_faces > MAX_DETAIL_FACES:
        raise ResourceError(
            f"the scene has {total_faces} detail faces, expected at most {MAX_DETAIL_FACES} to "
            "look at in memory; inspect still works, and so does validate --rays 0"
        )
    watcher.start("read segments", len(index), "segments")
    parts = _Parts(
        int(index.vertex_count.sum(dtype=np.int64)),
        total_faces,
        tuple(attribute.name for attribute in manifest.attributes),
    )
    for segment in range(len(index)):
        mesh = _decoded(scene, segment)
        counts = (len(mesh.positions), len(mesh.faces))
        expected = (int(index.vertex_count[segment]), int(index.face_count[segment]))
        if counts != expected:
            raise DamagedSceneError(
                manifest.files["segments.pack"].path,
                f"segment {segment} has {counts[0]} vertices and {counts[1]} faces, "
                f"expected {expected[0]} and {expected[1]} by the index",
                offset=int(index.offset[segment]),
            )
        parts.add(segment, mesh)
        watcher.advance(1)
    base, base_parts = _decoded_base(scene, len(index))
    watcher.done({"faces": total_faces})
    return SceneModel(
        manifest,
        parts.mesh(),
        parts.segment_of_face,
        parts.region_of_face,
        index.bounds.copy(),
        base,
        scene.cover,
        _textures(scene, parts.textures, base_parts),
    )


class _Parts:
    """Arrays of the whole detail, filled segment by segment."""

    def __init__(self, vertices: int, faces: int, attributes: tuple[str, ...]) -> None:
        self._mesh = Mesh(
            np.empty((vertices, 3), np.float32),
            np.empty((faces, 3), np.int32),
            np.empty((vertices, 3), np.float32),
            np.full((vertices, 3), GREY, np.uint8),
            {name: np.full(vertices, np.nan, np.float32) for name in attributes},
        )
        self.segment_of_face = np.empty(faces, np.int32)
        self.region_of_face = np.full(faces, -1, np.int32)
        self.textures = TextureParts(vertices, faces)
        self._vertex = self._face = 0

    def add(self, segment: int, mesh: SegmentMesh) -> None:
        vertices = slice(self._vertex, self._vertex + len(mesh.positions))
        faces = slice(self._face, self._face + len(mesh.faces))
        whole = self._mesh
        whole.vertices[vertices] = mesh.positions
        whole.normals[vertices] = mesh.normals
        whole.faces[faces] = mesh.faces.astype(np.int32) + np.int32(self._vertex)
        textured = self.textures.add(segment, mesh, vertices, faces)
        colours = mesh.colours if textured is None else textured
        if colours is not None:
            whole.colours[vertices] = colours
        for name, values in mesh.attributes.items():
            if name in whole.attributes:
                whole.attributes[name][vertices] = values
        self.segment_of_face[faces] = segment
        if mesh.region_ids is not None:
            self.region_of_face[faces] = mesh.region_ids[mesh.faces[:, 0]]
        self._vertex, self._face = vertices.stop, faces.stop

    def mesh(self) -> Mesh:
        return self._mesh


def _decoded(scene: Scene, segment: int) -> SegmentMesh:
    try:
        return decode_glb(scene.payload(segment))
    except PayloadError as error:
        raise DamagedSceneError(
            scene.manifest.files["segments.pack"].path,
            f"segment {segment}: {error}",
            offset=int(scene.index.offset[segment]),
        ) from None


def _decoded_base(scene: Scene, image: int) -> tuple[Mesh, TextureParts]:
    try:
        mesh = decode_glb(scene.base_path.read_bytes())
    except PayloadError as error:
        raise DamagedSceneError(scene.manifest.files["base.glb"].path, str(error)) from None
    count = len(mesh.positions)
    parts = TextureParts(count, len(mesh.faces))
    colours = parts.add(image, mesh, slice(0, count), slice(0, len(mesh.faces)))
    if colours is None:
        colours = mesh.colours
    if colours is None:
        colours = np.full((count, 3), GREY, np.uint8)
    faces = mesh.faces.astype(np.int32)
    return Mesh(mesh.positions, faces, mesh.normals, colours, dict(mesh.attributes)), parts


def _textures(scene: Scene, detail: TextureParts, base: TextureParts) -> SceneTextures | None:
    if not ((detail.image_of_face >= 0).any() or (base.image_of_face >= 0).any()):
        return None
    sizes = [*detail.sizes, *base.sizes]
    images = open_images(scene.path, scene.manifest.version, sizes)
    return SceneTextures(
        Texturing(detail.uvs, detail.image_of_face, images),
        Texturing(base.uvs, base.image_of_face, images),
    )
