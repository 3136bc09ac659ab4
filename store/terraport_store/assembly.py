"""From what the caller says and what was written to a manifest.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from terraport_payload import SegmentMesh
from terraport_payload.types import Float64
from terraport_store.index import SegmentIndex
from terraport_store.layout import ENCODING, INDEX, MEDIA_TYPE, PACK
from terraport_store.manifest import (
    AttributeInfo,
    Bounds,
    BuildInfo,
    Counts,
    CrsInfo,
    EncodingInfo,
    FileInfo,
    HandOff,
    Limits,
    Manifest,
    SurveyUnits,
    TextureInfo,
)

__all__ = ["MeshShape", "SceneInfo", "assemble_manifest"]


@dataclass(frozen=True, slots=True)
class SceneInfo:
    """What the manifest says of a scene beyond its files."""

    name: str
    """For people; 1 to 200 characters."""
    origin: tuple[float, float, float]
    """E0, N0, H0 in the CRS, metres."""
    step_m: float
    """Grid step, a power of two, metres."""
    points: int
    """Points of the survey that were used."""
    regions: int
    """Number of regions; ids are 0 to regions - 1."""
    hand_off: HandOff
    build: BuildInfo
    crs: CrsInfo | None = None
    survey_units: SurveyUnits | None = None
    attributes: tuple[AttributeInfo, ...] = ()
    has_colour: bool = True
    """Whether every segment has vertex colours, and the base those or a texture."""
    textures: TextureInfo | None = None
    levels: int = 1
    """Payloads of each segment; the index has all of the first level, then all of the next."""


@dataclass(frozen=True, slots=True)
class MeshShape:
    """Box and counts of one mesh."""

    bounds: tuple[float, ...]
    """x, y, z minimum, x, y, z maximum; metres, scene frame."""
    vertices: int
    faces: int

    @classmethod
    def of(cls, mesh: SegmentMesh) -> MeshShape:
        """Box and counts of a decoded mesh."""
        low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
        return cls((*low.tolist(), *high.tolist()), len(mesh.positions), len(mesh.faces))


def assemble_manifest(
    info: SceneInfo,
    index: SegmentIndex,
    base: MeshShape,
    files: Mapping[str, FileInfo],
) -> Manifest:
    """Put a manifest together and compute its version.

    Parameters
    ----------
    info : SceneInfo
        What the files do not say.
    index : SegmentIndex
        Of the payloads of all levels; at least one segment.
    base : MeshShape
        Of the base mesh.
    files : mapping of str to FileInfo
        By key; their folders do not matter yet.

    Returns
    -------
    Manifest
        Complete but for the folder in its files' paths, which is named after the version.

    Raises
    ------
    pydantic.ValidationError
        When a field of *info* is out of range.
    """
    detail = index.first(len(index) // info.levels)
    boxes = np.vstack([detail.bounds, np.array([base.bounds], dtype="<f4")]).astype(float)
    sides = detail.bounds[:, 3:].astype(float) - detail.bounds[:, :3]
    unnamed = Manifest(
        version="0" * 32,
        name=info.name,
        crs=info.crs,
        origin=info.origin,
        survey_units=info.survey_units,
        step_m=info.step_m,
        bounds=Bounds(min=_vector(boxes[:, :3].min(axis=0)), max=_vector(boxes[:, 3:].max(axis=0))),
        encodings={
            ENCODING: EncodingInfo(
                pack=PACK, index=INDEX, media_type=MEDIA_TYPE, payload_bytes=index.payload_bytes
            )
        },
        attributes=info.attributes,
        counts=Counts(
            points=info.points,
            base_vertices=base.vertices,
            base_faces=base.faces,
            detail_vertices=int(detail.vertex_count.sum(dtype=np.uint64)),
            detail_faces=int(detail.face_count.sum(dtype=np.uint64)),
            segments=len(detail),
            regions=info.regions,
        ),
        has_colour=info.has_colour,
        textures=info.textures,
        levels=info.levels,
        hand_off=info.hand_off,
        limits=Limits(
            max_segment_bytes=int(index.length.max()),
            max_segment_faces=int(index.face_count.max()),
            max_extent_m=float(sides.max()),
        ),
        build=info.build,
        files=dict(files),
    )
    return unnamed.model_copy(update={"version": unnamed.digest()})


def _vector(values: Float64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
