"""Publish a scene with other regions: the same ground, and every payload that did not change.

Payloads of segments whose faces keep their regions are written as they are, byte by byte; clients
that hold them load nothing. The others are decoded, their vertices split along the new borders and
encoded again; positions, colours and attributes come back exactly, normals within a code.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from terraport_payload import AttributeScale, SegmentMesh, decode_segment, encode_segment
from terraport_payload.types import Bool, Float32, Int32, Int64, UInt8
from terraport_pipeline.engines.coarser import levels_of
from terraport_pipeline.engines.overview import overview_payload
from terraport_pipeline.geometry.mesh.face_measures import main_labels
from terraport_pipeline.geometry.regions.base_regions import base_regions
from terraport_pipeline.naming.recut import Recut
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.ground import Ground
from terraport_pipeline.stages.pack import encode_payload
from terraport_store import Manifest, Scene, SceneBusyError, change_labels, read_manifest
from terraport_store.writer import SceneInfo, SceneWriter

__all__ = ["Republished", "republish"]


@dataclass(frozen=True, slots=True)
class Republished:
    """What became of a scene."""

    version: str
    regions: int
    kept: int
    """Regions that have the stable id that they had."""
    segments: int
    segments_changed: int
    """Payloads that clients load again."""


def republish(
    scene: Scene,
    ground: Ground,
    new: Recut,
    progress: Progress,
    *,
    over: tuple[Path, str] | None = None,
) -> Republished:
    """Publish the version with other regions, then set their labels.

    Parameters
    ----------
    scene : Scene
        Open on a folder; the version that `ground` was read from.
    ground : Ground
    new : Recut
    progress : Progress
        A step of segments.
    over : (Path, str), optional
        Scene directory to publish in, and the version that must stand there; None where that is
        `scene` itself. Then the version is published whatever differs.

    Returns
    -------
    Republished
        Of the version before, where nothing differs from it.

    Raises
    ------
    SceneBusyError
        Another process publishes, or has published since.
    OutOfSpaceError
        The disk is full; the version before stands.
    """
    manifest = scene.manifest
    changed = np.zeros(len(scene.index), np.bool_)
    changed[ground.segment_of_face[new.regions != ground.region_of_face]] = True
    target, version = over or (scene.path, manifest.version)
    if over is not None or changed.any() or new.document != ground.document:
        manifest = _publish(scene, ground, new, changed, target, version, progress)
    if any(ground.names.labels.get(number) != label for number, label in new.labels.items()):
        change_labels(target, new.labels)
    return Republished(
        manifest.version, new.count, new.kept, len(changed), int(np.count_nonzero(changed))
    )


def _publish(
    scene: Scene,
    ground: Ground,
    new: Recut,
    changed: Bool,
    target: Path,
    version: str,
    progress: Progress,
) -> Manifest:
    before, index = scene.manifest, scene.index
    scales = before.scales
    starts = np.searchsorted(ground.segment_of_face, np.arange(len(index) + 1))
    main, region_counts = main_labels(ground.segment_of_face, len(index), new.regions)
    with SceneWriter(target, expected_bytes=sum(f.bytes for f in before.files.values())) as out:
        # The lock is held: what is published now stays so until the end.
        if read_manifest(target).version != version:
            raise SceneBusyError(str(target))
        progress.start("regions: segments", float(len(index)), "segments")
        for segment in range(len(index)):
            data = bytes(scene.payload(segment))
            box: list[float] | None = index.bounds[segment].tolist()
            vertices: int | None = int(index.vertex_count[segment])
            if changed[segment]:
                regions = new.regions[starts[segment] : starts[segment + 1]]
                packed = encode_payload(
                    with_regions(scene.mesh(segment), regions), before.step_m, scales
                )
                data, vertices = packed.data, packed.vertices
            out.add_segment(
                data,
                region=int(main[segment]),
                region_count=int(region_counts[segment]),
                bounds=box,
                vertices=vertices,
                faces=int(index.face_count[segment]),
            )
            progress.advance(1)
        for row in range(len(index), len(scene.rows)):
            _add_level(out, scene, row, new, changed, starts, scales)
        progress.done({"changed": int(np.count_nonzero(changed))})
        base = _base(scene, ground, new, scales, starts)
        out.set_base(base, scene.cover, overview_payload(base, before.step_m))
        out.set_regions(new.document)
        return out.publish(
            SceneInfo(
                name=before.name,
                origin=before.origin,
                step_m=before.step_m,
                points=before.counts.points,
                regions=new.count,
                hand_off=before.hand_off,
                build=before.build,
                crs=before.crs,
                survey_units=before.survey_units,
                attributes=before.attributes,
                has_colour=before.has_colour,
                textures=before.textures,
                levels=before.levels,
            )
        )


def _add_level(
    out: SceneWriter,
    scene: Scene,
    row: int,
    new: Recut,
    changed: Bool,
    starts: Int64,
    scales: dict[str, AttributeScale],
) -> None:
    """Write a coarser level as it is, or, of a segment whose regions changed, of its new detail."""
    rows, segment = scene.rows, row % len(changed)
    data, region = bytes(scene.payload(row)), int(rows.region[row])
    region_count, vertices = int(rows.region_count[row]), int(rows.vertex_count[row])
    faces = int(rows.face_count[row])
    if changed[segment]:
        regions = new.regions[starts[segment] : starts[segment + 1]]
        *_, mesh = levels_of(with_regions(scene.mesh(segment), regions), 1 + row // len(changed))
        packed = encode_payload(mesh, scene.manifest.step_m, scales)
        data, region, region_count = packed.data, packed.region, packed.region_count
        vertices, faces = packed.vertices, packed.faces
    out.add_segment(
        data,
        region=region,
        region_count=region_count,
        bounds=rows.bounds[row].tolist(),
        vertices=vertices,
        faces=faces,
    )


def with_regions(mesh: SegmentMesh, regions: Int32) -> SegmentMesh:
    """Give the faces of a payload other regions.

    Parameters
    ----------
    mesh : SegmentMesh
    regions : ndarray of shape (F,), int32

    Returns
    -------
    SegmentMesh
        A vertex that several regions share is there once for each; vertices that were split for
        regions alone are one again.
    """
    # (1) Vertices that differ in nothing but their region are one.
    columns = [mesh.positions, mesh.normals, mesh.colours, mesh.uvs, *mesh.attributes.values()]
    rows = np.concatenate([_bytes(values) for values in columns if values is not None], axis=1)
    _, first, place = np.unique(
        np.ascontiguousarray(rows).view(f"V{rows.shape[1]}").reshape(-1),
        return_index=True,
        return_inverse=True,
    )
    # (2) Split along the new borders.
    span = int(regions.max()) + 1
    keys = place.reshape(-1)[mesh.faces].astype(np.int64) * span + regions[:, None]
    unique, corner = np.unique(keys, return_inverse=True)
    at, region = np.divmod(unique, span)
    vertex: Int64 = first[at]
    return SegmentMesh(
        positions=mesh.positions[vertex],
        faces=corner.reshape(-1, 3).astype(np.uint32),
        normals=mesh.normals[vertex],
        colours=None if mesh.colours is None else mesh.colours[vertex],
        region_ids=region.astype(np.uint16),
        attributes={name: values[vertex] for name, values in mesh.attributes.items()},
        uvs=None if mesh.uvs is None else mesh.uvs[vertex],
        texture=mesh.texture,
    )


def _bytes(values: np.ndarray) -> UInt8:
    table: UInt8 = np.ascontiguousarray(values).reshape(len(values), -1).view(np.uint8)
    return table


def _base(
    scene: Scene,
    ground: Ground,
    new: Recut,
    scales: dict[str, AttributeScale],
    starts: Int64,
) -> bytes:
    """Give the base the regions of the detail over it; the same bytes where none changes."""
    data = scene.base_path.read_bytes()
    mesh = decode_segment(data, scales=scales)

    def pieces() -> Iterator[tuple[Float32, Int32, Int32]]:
        for begin, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
            yield ground.mesh.vertices, ground.mesh.faces[begin:end], new.regions[begin:end]

    regions = base_regions(mesh.positions, pieces())
    if regions is None or (mesh.region_ids is not None and (regions == mesh.region_ids).all()):
        return data
    return encode_segment(
        replace(mesh, region_ids=regions),
        step_m=scene.manifest.step_m,
        scales=scales,
        may_be_wide=True,
    )
