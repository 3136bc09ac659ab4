"""A published scene as plain meshes: every payload decoded, as a client gets it.

Memory: about 60 bytes per detail face (vertices are half as many as faces), 80 with attributes.
Textures stay in the scene: see :mod:`.scene_textures`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import Cover, PayloadError, SegmentMesh
from terraport_payload.types import Bool, Float32, Int32, Int64
from terraport_pipeline.engines.texturing import Texturing
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.geometry.mesh.thin_cells import thin_by_cells
from terraport_pipeline.model import Mesh
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.mixed_model import HandOffModel
from terraport_pipeline.published.scene_textures import (
    SceneTextures,
    TextureParts,
    colours_from_texture,
    open_images,
)
from terraport_store import DamagedSceneError, Manifest, Scene
from terraport_store.layout import BASE

__all__ = ["WHOLE_FACES", "SceneModel", "load_scene_model"]


WHOLE_FACES: Final = 16_000_000
"""Largest scene that is looked at whole (some 5 GB with the trees that rays need); larger ones are
drawn thinned, and proven in windows."""

_FACES_PER_CELL: Final = 2.0
"""Faces that are left of a cell of flat ground."""

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

    def hand_off_model(self, segments: Int64 | None = None) -> HandOffModel:
        """Take what the proof of the hand-off looks at.

        Parameters
        ----------
        segments : ndarray of int64, optional
            Ascending: the only ones there are, numbered 0.. in this order; the model holds no
            others' faces (see :mod:`.scene_windows`). None: all.
        """
        cover, base_faces = self.cover, self.base.faces
        offsets, listed = cover.offsets.astype(np.int64), cover.segments.astype(np.int64)
        segment_of_face, count = self.segment_of_face, self.manifest.counts.segments
        if segments is not None:
            number = np.full(count, -1, np.int32)
            number[segments] = np.arange(len(segments), dtype=np.int32)
            here = number[listed]
            kept = here >= 0
            lengths = np.diff(np.concatenate([[0], np.cumsum(kept)])[offsets])
            base_faces, lengths = base_faces[lengths > 0], lengths[lengths > 0]
            offsets, listed = np.concatenate([[0], np.cumsum(lengths)]), here[kept].astype(np.int64)
            segment_of_face, count = number[segment_of_face], len(segments)
        return HandOffModel(
            self.detail.vertices,
            self.detail.faces,
            segment_of_face,
            count,
            self.base.vertices,
            base_faces,
            offsets,
            listed,
            self.manifest.hand_off.tolerance_m,
        )


def load_scene_model(
    scene: Scene,
    *,
    segments: Int64 | None = None,
    max_faces: int | None = None,
    whole: Bool | None = None,
    each: Callable[[SegmentMesh], None] | None = None,
    progress: Progress | None = None,
) -> SceneModel:
    """Read and decode a scene, or part of it.

    Parameters
    ----------
    scene : Scene
        Open.
    segments : ndarray of int64, optional
        Read only these; the others have no faces in the model. None: all.
    max_faces : int, optional
        Thin the segments, for pictures from afar, so that about this many faces are left. None:
        they come as they are.
    whole : ndarray of shape (S,), bool, optional
        Segments that are never thinned.
    each : callable, optional
        Gets every segment as it was read, before it is thinned.
    progress : Progress, optional
        Advances by segments.

    Returns
    -------
    SceneModel
        Arrays of its own: the scene may be closed. Numbers of segments are the scene's.

    Raises
    ------
    ResourceError
        When the segments to read whole have more than 2^31 corners.
    DamagedSceneError
        When a payload fails its hash, does not decode, or has other counts than the index says.
    """
    # (1) What to read, and whether to thin it.
    watcher = progress or NullProgress()
    index, manifest = scene.index, scene.manifest
    chosen = np.arange(len(index)) if segments is None else segments
    total_faces = int(index.face_count[chosen].sum(dtype=np.int64))
    cell_m = None if max_faces is None else _cell_m(scene, chosen, max_faces, whole)
    if cell_m is None and total_faces > np.iinfo(np.int32).max // 3:
        raise ResourceError(
            f"{total_faces} detail faces, expected at most {np.iinfo(np.int32).max // 3} to look "
            "at in one piece"
        )
    # (2) Payloads one at a time. Thinned ones are gathered first: their size is known only then.
    watcher.start("read segments", len(chosen), "segments")
    meshes: Iterable[tuple[int, SegmentMesh]] = _read(scene, chosen, each, watcher)
    if cell_m is None:
        size = int(index.vertex_count[chosen].sum(dtype=np.int64)), total_faces
    else:
        thinned = [
            (number, mesh if whole is not None and whole[number] else _thinned(mesh, cell_m))
            for number, mesh in meshes
        ]
        size = (
            sum(len(mesh.positions) for _, mesh in thinned),
            sum(len(mesh.faces) for _, mesh in thinned),
        )
        meshes = thinned
    # (3) One mesh. Invariant: faces stand in order of their segments, whatever was thinned.
    builder = _Parts(*size, tuple(attribute.name for attribute in manifest.attributes))
    for number, mesh in meshes:
        builder.add(number, mesh)
    base, base_parts = _decoded_base(scene, len(index))
    watcher.done({"faces": size[1]})
    return SceneModel(
        manifest,
        builder.mesh(),
        builder.segment_of_face,
        builder.region_of_face,
        index.bounds.copy(),
        base,
        scene.cover,
        _textures(scene, builder.textures, base_parts),
    )


def _read(
    scene: Scene,
    chosen: Int64,
    each: Callable[[SegmentMesh], None] | None,
    watcher: Progress,
) -> Iterator[tuple[int, SegmentMesh]]:
    index = scene.index
    for segment in chosen.tolist():
        mesh = _decoded(scene, segment)
        counts = (len(mesh.positions), len(mesh.faces))
        expected = (int(index.vertex_count[segment]), int(index.face_count[segment]))
        if counts != expected:
            raise DamagedSceneError(
                scene.manifest.files["segments.pack"].path,
                f"segment {segment} has {counts[0]} vertices and {counts[1]} faces, "
                f"expected {expected[0]} and {expected[1]} by the index",
                offset=int(index.offset[segment]),
            )
        if each is not None:
            each(mesh)
        yield segment, mesh
        watcher.advance(1)


def _cell_m(scene: Scene, chosen: Int64, max_faces: int, whole: Bool | None) -> float | None:
    """Side of the cubes that thin a scene to so many faces; None when it has no more."""
    faces = scene.index.face_count.astype(np.int64)
    full = np.zeros(len(faces), np.bool_) if whole is None else whole
    kept = int(faces[chosen][full[chosen]].sum())
    if int(faces[chosen].sum()) <= max_faces:
        return None
    # A box seen from above is about the ground in it, or more: rather too few faces.
    thin = chosen[~full[chosen]]
    sides = scene.index.bounds[thin, 3:].astype(np.float64) - scene.index.bounds[thin, :3]
    area_m2 = float((sides[:, 0] * sides[:, 2]).sum())
    left = max(max_faces - kept, max_faces // 8, 1)
    return max(float(np.sqrt(_FACES_PER_CELL * area_m2 / left)), 1e-6)


def _thinned(mesh: SegmentMesh, cell_m: float) -> SegmentMesh:
    """Unite the vertices of every cube; textures become the colours of vertices."""
    kept, faces, _ = thin_by_cells(mesh.positions, mesh.faces, cell_m)
    textured = colours_from_texture(mesh)
    colours = mesh.colours if textured is None else textured
    return SegmentMesh(
        positions=mesh.positions[kept],
        faces=faces.astype(np.uint32),
        normals=mesh.normals[kept],
        colours=None if colours is None else colours[kept],
        region_ids=None if mesh.region_ids is None else mesh.region_ids[kept],
        attributes={name: values[kept] for name, values in mesh.attributes.items()},
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
        return scene.mesh(segment)
    except PayloadError as error:
        raise DamagedSceneError(
            scene.manifest.files["segments.pack"].path,
            f"segment {segment}: {error}",
            offset=int(scene.index.offset[segment]),
        ) from None


def _decoded_base(scene: Scene, image: int) -> tuple[Mesh, TextureParts]:
    try:
        mesh = scene.file_mesh(BASE)
    except PayloadError as error:
        raise DamagedSceneError(scene.manifest.files[BASE].path, str(error)) from None
    count = len(mesh.positions)
    textures = TextureParts(count, len(mesh.faces))
    colours = textures.add(image, mesh, slice(0, count), slice(0, len(mesh.faces)))
    if colours is None:
        colours = mesh.colours
    if colours is None:
        colours = np.full((count, 3), GREY, np.uint8)
    faces = mesh.faces.astype(np.int32)
    return Mesh(mesh.positions, faces, mesh.normals, colours, dict(mesh.attributes)), textures


def _textures(scene: Scene, detail: TextureParts, base: TextureParts) -> SceneTextures | None:
    if not ((detail.image_of_face >= 0).any() or (base.image_of_face >= 0).any()):
        return None
    sizes = {**detail.sizes, **base.sizes}
    images = open_images(scene.path, scene.manifest.version, sizes)
    return SceneTextures(
        Texturing(detail.uvs, detail.image_of_face, images),
        Texturing(base.uvs, base.image_of_face, images),
    )
