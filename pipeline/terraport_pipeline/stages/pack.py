"""Pack: one payload of every segment, its vertices split where regions meet."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from terraport_payload import (
    AttributeScale,
    SegmentMesh,
    encode_segment,
    snap,
)
from terraport_payload.types import Bool, Float64, Int32, Int64, UInt16
from terraport_pipeline.engines.coarser import levels_of
from terraport_pipeline.geometry.mesh.uv import split_wedges
from terraport_pipeline.geometry.segments.segment_shapes import QUANTILES
from terraport_pipeline.geometry.segments.strip_order import strip_order
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.pack import Options
from terraport_pipeline.ordered import in_order
from terraport_pipeline.stages.contract import Facts, Json
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_store.layout import BASE, COVER, ENCODING
from terraport_store.manifest import BuildInfo, CrsInfo, Manifest, SurveyUnits

__all__ = [
    "EXPECTED_BYTES_PER_FACE",
    "NAME",
    "About",
    "Options",
    "Packed",
    "Payload",
    "encode_levels",
    "encode_payload",
    "in_order",
    "kept_faces",
    "pack_counts",
    "split_segments",
    "whole_payload",
]

NAME: Final = "pack"

EXPECTED_BYTES_PER_FACE: Final = 8
"""Free space asked for before writing; twice what a coloured face takes with few attributes."""


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
    survey_units: SurveyUnits | None = None
    spacing_m: float = 0.0
    """Typical distance between the points: decides how fine the grid is; 0 is as fine as fits."""


@dataclass(frozen=True, slots=True)
class Packed:
    """Manifest of the published version, and counts of what it holds."""

    manifest: Manifest
    facts: Facts


@dataclass(frozen=True, slots=True)
class Payload:
    """One encoded segment, with what the index says of it."""

    data: bytes
    bounds: tuple[float, ...]
    vertices: int
    faces: int
    region: int = 0
    """The one with most faces, the lower of equals."""
    region_count: int = 1


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


def whole_payload(
    mesh: Mesh, textures: TextureSet | None = None, region_ids: UInt16 | None = None
) -> SegmentMesh:
    """Take a mesh as one payload; with its one image instead of its colours.

    A vertex has one region, ``region_ids``, (V,): no vertex is split for them.
    """
    plain = SegmentMesh(
        positions=mesh.vertices,
        faces=mesh.faces.astype(np.uint32),
        normals=mesh.normals,
        colours=mesh.colours,
        region_ids=region_ids,
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
        region_ids=None if region_ids is None else region_ids[split.vertex],
        attributes={name: values[split.vertex] for name, values in mesh.attributes.items()},
        uvs=split.uvs,
        texture=textures.texture(0),
    )


def encode_payload(mesh: SegmentMesh, step_m: float, scales: dict[str, AttributeScale]) -> Payload:
    """Quantise and encode a segment's mesh; its faces get the order that takes fewest bytes."""
    ordered = replace(mesh, faces=mesh.faces[strip_order(mesh.faces)])
    corners = np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])
    return Payload(
        data=encode_segment(ordered, step_m=step_m, scales=scales),
        bounds=tuple(snap(corners, step_m).ravel().tolist()),
        vertices=len(mesh.positions),
        faces=len(mesh.faces),
        **_regions_of(mesh),
    )


def _regions_of(mesh: SegmentMesh) -> dict[str, int]:
    if mesh.region_ids is None:
        return {}
    faces = np.bincount(mesh.region_ids[mesh.faces[:, 0]])
    return {"region": int(faces.argmax()), "region_count": int(np.count_nonzero(faces))}


def encode_levels(
    mesh: SegmentMesh, step_m: float, scales: dict[str, AttributeScale], levels: int
) -> list[Payload]:
    """Encode a segment at every level, the finest first; all have its box."""
    payloads = [encode_payload(one, step_m, scales) for one in levels_of(mesh, levels)]
    return [replace(payload, bounds=payloads[0].bounds) for payload in payloads]


def pack_counts(manifest: Manifest, payload_bytes: list[int]) -> dict[str, Json]:
    """Report sizes and counts of the published version."""
    payload = manifest.encodings[ENCODING].payload_bytes
    return {
        "segments": manifest.counts.segments,
        "payload_bytes": payload,
        "bytes_per_face": round(payload / max(manifest.counts.detail_faces, 1), 2),
        "segment_bytes": np.quantile(payload_bytes, QUANTILES).astype(int).tolist(),
        "base_bytes": manifest.files[BASE].bytes,
        "cover_bytes": manifest.files[COVER].bytes,
        "max_segment_bytes": manifest.limits.max_segment_bytes,
        "step_m": manifest.step_m,
    }
