"""Pack: from labelled meshes to a published scene.

Every segment becomes one payload, its vertices split where regions meet; base, cover, region facts
and manifest follow; the last act publishes all of it at once. Memory: the meshes and a few
payloads.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload import (
    AttributeScale,
    Cover,
    SegmentMesh,
    choose_attribute_scale,
    choose_step_m,
    encode_glb,
    gltf_attribute_name,
    snap,
)
from terraport_payload.types import Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.uv import split_wedges
from terraport_pipeline.geometry.segments.segment_shapes import QUANTILES
from terraport_pipeline.model import Mesh
from terraport_pipeline.ordered import in_order
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.region_ids import NewSurface, number_regions
from terraport_pipeline.stages.segment import Segmented
from terraport_pipeline.stages.texture_set import Textured, TextureSet, texture_info
from terraport_store.manifest import AttributeInfo, BuildInfo, CrsInfo, HandOff, Manifest
from terraport_store.writer import SceneInfo, SceneWriter

__all__ = [
    "EXPECTED_BYTES_PER_FACE",
    "NAME",
    "About",
    "Options",
    "Packed",
    "Payload",
    "encode_payload",
    "in_order",
    "kept_faces",
    "pack_counts",
    "run",
    "split_segments",
    "whole_payload",
]

NAME: Final = "pack"

EXPECTED_BYTES_PER_FACE: Final = 16
"""Free space asked for before writing; twice what a coloured face takes with few attributes."""


@dataclass(frozen=True, slots=True)
class Options:
    """Name of the published scene."""

    name: str
    """The scene's name for people."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.name) <= 200:
            raise OptionError(f"name of {len(self.name)} characters; expected 1 to 200")


@dataclass(frozen=True, slots=True)
class About:
    """What the manifest says beyond the meshes."""

    origin: Float64
    """(3,) E0, N0, H0."""
    crs: CrsInfo | None
    points: int
    """Points that were used."""
    has_colour: bool
    build: BuildInfo
    spacing_m: float = 0.0
    """Typical distance between the points: decides how fine the grid is; 0 is as fine as fits."""


@dataclass(frozen=True, slots=True)
class Packed:
    """Manifest of the published version, and counts of what it holds."""

    manifest: Manifest
    facts: Facts


@dataclass(frozen=True, slots=True)
class Payload:
    """One segment as GLB, with what the index says of it."""

    glb: bytes
    bounds: tuple[float, ...]
    vertices: int
    faces: int


def run(
    scene: Path,
    reconstructed: Reconstructed,
    segmented: Segmented,
    about: About,
    options: Options,
    context: Context,
    textured: Textured | None = None,
) -> Packed:
    """Encode everything and publish it.

    Parameters
    ----------
    scene : Path
        Scene directory; untouched until everything is written, then replaced in one act.
    reconstructed : Reconstructed
    segmented : Segmented
    about : About
    options : Options
    context : Context
    textured : Textured, optional
        Payloads get its images instead of the vertex colours.

    Returns
    -------
    Packed

    Raises
    ------
    SceneStoreError
        The disk is full, or somebody else publishes the same scene; nothing half-written is left.
    """
    detail, progress = reconstructed.detail, context.progress
    base = kept_faces(reconstructed.base, segmented.base_kept)
    step_m = choose_step_m(_widest_m(segmented.bounds), _farthest_m(detail, base), about.spacing_m)
    scales = {
        name: choose_attribute_scale(np.concatenate([values, base.attributes[name]]))
        for name, values in detail.attributes.items()
    }
    count = len(segmented.main_region)
    expected = (len(detail.faces) + len(base.faces)) * EXPECTED_BYTES_PER_FACE
    if textured is not None:
        expected += len(textured.detail.images) + len(textured.base.images)
    with SceneWriter(scene, expected_bytes=expected) as writer:
        # (1) segments, in their Morton order
        progress.start("pack: segments", float(count), "segments")

        def encode(make: Callable[[], SegmentMesh]) -> Payload:
            return encode_payload(make(), step_m, scales)

        payload_bytes = []
        images = None if textured is None else textured.detail
        makers = _segment_makers(detail, segmented.segments, segmented.regions, images)
        for number, payload in enumerate(in_order(encode, makers, context.threads)):
            writer.add_segment(
                payload.glb,
                region=int(segmented.main_region[number]),
                region_count=int(segmented.region_counts[number]),
                bounds=payload.bounds,
                vertices=payload.vertices,
                faces=payload.faces,
            )
            payload_bytes.append(len(payload.glb))
            progress.advance(1)
        progress.done({})
        # (2) base, cover, regions
        progress.start("pack: base", None, "faces")
        glb = encode_glb(
            whole_payload(base, None if textured is None else textured.base),
            step_m=step_m,
            attribute_scales=scales,
            keep_face_order=True,
        )
        writer.set_base(glb, Cover(segmented.cover_offsets, segmented.cover_segments))
        progress.done({})
        numbered = number_regions(
            scene,
            segmented.region_facts,
            NewSurface(detail, segmented.segments, segmented.regions, about.origin, about.crs),
            progress,
        )
        writer.set_regions(numbered.document)
        # (3) publish
        progress.start("pack: publish", None, "files")
        manifest = writer.publish(
            SceneInfo(
                name=options.name,
                origin=_triple(about.origin),
                step_m=step_m,
                points=about.points,
                regions=len(segmented.region_facts["regions"]),
                hand_off=HandOff(
                    deviation_m=reconstructed.deviation_m[3], tolerance_m=segmented.tolerance_m
                ),
                build=about.build,
                crs=about.crs,
                attributes=_attribute_infos(detail, base, scales),
                has_colour=about.has_colour and textured is None,
                textures=None if textured is None else texture_info(textured),
            )
        )
        progress.done({"version": manifest.version[:12]})
    return Packed(
        manifest, Facts(pack_counts(manifest, payload_bytes) | numbered.counts, numbered.warnings)
    )


def split_segments(
    detail: Mesh, segments: Int32, regions: Int32, textures: TextureSet | None = None
) -> Iterator[SegmentMesh]:
    """Cut the detail into one mesh per segment.

    Parameters
    ----------
    detail : Mesh
    segments, regions : ndarray of shape (F,), int32
        Labels of every face, from 0.
    textures : TextureSet, optional
        An image for every segment, instead of the vertex colours.

    Yields
    ------
    SegmentMesh
        In order of the segments' numbers. Vertices on region borders and on seams of the texture
        are there once per region and chart; vertices on segment borders once per segment, with
        equal values.
    """
    for make in _segment_makers(detail, segments, regions, textures):
        yield make()


def _segment_makers(
    detail: Mesh, segments: Int32, regions: Int32, textures: TextureSet | None
) -> Iterator[Callable[[], SegmentMesh]]:
    """Yield what makes each segment, to be called in any thread."""
    order = np.argsort(segments, kind="stable")
    count = int(segments.max()) + 1
    starts = np.searchsorted(segments[order], np.arange(count + 1))
    region_count = int(regions.max()) + 1

    def make(segment: int, chosen: Int64) -> SegmentMesh:
        # A vertex that several regions of the segment share is split: a payload has one region a
        # vertex.
        keys = detail.faces[chosen].astype(np.int64) * region_count + regions[chosen, None]
        unique, corner = np.unique(keys, return_inverse=True)
        faces = corner.reshape(-1, 3)
        vertex, region = np.divmod(unique, region_count)
        # Split again at texture seams.
        uvs = None
        if textures is not None:
            split = split_wedges(faces, textures.uvs(chosen, segment), len(unique))
            vertex, region, faces = vertex[split.vertex], region[split.vertex], split.faces
            uvs = split.uvs
        return SegmentMesh(
            positions=detail.vertices[vertex],
            faces=faces.astype(np.uint32),
            normals=detail.normals[vertex],
            colours=detail.colours[vertex] if textures is None else None,
            region_ids=region.astype(np.uint16),
            attributes={name: values[vertex] for name, values in detail.attributes.items()},
            uvs=uvs,
            texture=None if textures is None else textures.texture(segment),
        )

    for segment, (begin, end) in enumerate(itertools.pairwise(starts)):
        yield partial(make, segment, order[begin:end])


def kept_faces(base: Mesh, kept: Bool) -> Mesh:
    """Keep some faces in their order, and the vertices that they use."""
    faces = base.faces[kept]
    used, corner = np.unique(faces, return_inverse=True)
    return Mesh(
        vertices=base.vertices[used],
        faces=corner.reshape(-1, 3).astype(np.int32),
        normals=base.normals[used],
        colours=base.colours[used],
        attributes={name: values[used] for name, values in base.attributes.items()},
    )


def whole_payload(mesh: Mesh, textures: TextureSet | None = None) -> SegmentMesh:
    """Take a mesh as one payload, without regions; with its one image instead of its colours."""
    plain = SegmentMesh(
        positions=mesh.vertices,
        faces=mesh.faces.astype(np.uint32),
        normals=mesh.normals,
        colours=mesh.colours,
        attributes=mesh.attributes,
    )
    if textures is None:
        return plain
    split = split_wedges(mesh.faces, textures.uvs(slice(None), 0), len(mesh.vertices))
    return replace(
        plain,
        positions=mesh.vertices[split.vertex],
        faces=split.faces.astype(np.uint32),
        normals=mesh.normals[split.vertex],
        colours=None,
        attributes={name: values[split.vertex] for name, values in mesh.attributes.items()},
        uvs=split.uvs,
        texture=textures.texture(0),
    )


def encode_payload(mesh: SegmentMesh, step_m: float, scales: dict[str, AttributeScale]) -> Payload:
    """Quantise a segment's mesh and encode it as GLB."""
    glb = encode_glb(mesh, step_m=step_m, attribute_scales=scales)
    corners = np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])
    return Payload(
        glb=glb,
        bounds=tuple(snap(corners, step_m).ravel().tolist()),
        vertices=len(mesh.positions),
        faces=len(mesh.faces),
    )


def _widest_m(bounds: Float32) -> float:
    """Longest side of any segment's box."""
    return float((bounds[:, 3:].astype(np.float64) - bounds[:, :3]).max())


def _farthest_m(*meshes: Mesh) -> float:
    return max(float(np.abs(mesh.vertices).max()) for mesh in meshes)


def _attribute_infos(
    detail: Mesh, base: Mesh, scales: dict[str, AttributeScale]
) -> tuple[AttributeInfo, ...]:
    infos = []
    for name, scale in scales.items():
        low, high = _range(np.concatenate([detail.attributes[name], base.attributes[name]]))
        infos.append(
            AttributeInfo(
                name=name,
                gltf_name=gltf_attribute_name(name),
                offset=scale.offset,
                step=scale.step,
                min=low,
                max=high,
            )
        )
    return tuple(infos)


def _range(values: Float32) -> tuple[float | None, float | None]:
    valid: Float32 = values[~np.isnan(values)]
    return (float(valid.min()), float(valid.max())) if len(valid) else (None, None)


def _triple(values: Float64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def pack_counts(manifest: Manifest, payload_bytes: list[int]) -> dict[str, Json]:
    """Report sizes and counts of the published version."""
    payload = manifest.encodings["glb"].payload_bytes
    return {
        "segments": manifest.counts.segments,
        "payload_bytes": payload,
        "bytes_per_face": round(payload / max(manifest.counts.detail_faces, 1), 2),
        "segment_bytes": np.quantile(payload_bytes, QUANTILES).astype(int).tolist(),
        "base_bytes": manifest.files["base.glb"].bytes,
        "cover_bytes": manifest.files["base.cover"].bytes,
        "max_segment_bytes": manifest.limits.max_segment_bytes,
        "step_m": manifest.step_m,
    }
