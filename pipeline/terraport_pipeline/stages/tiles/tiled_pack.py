"""Pack, tile by tile: payloads of each tile into the work directory, then one scene in order.

A segment's payload needs its tile alone, so tiles are encoded one by one (:func:`encode`); the pack
is then written in the order of the segments' Morton curve, each payload read from where it lies
(:func:`publish`). Memory: one tile and a few payloads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from terraport_payload import (
    AttributeScale,
    Cover,
    choose_attribute_scale,
    choose_step_m,
    encode_glb,
    gltf_attribute_name,
)
from terraport_payload.types import AnyArray, Int32
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.pack import (
    EXPECTED_BYTES_PER_FACE,
    About,
    Options,
    Packed,
    Payload,
    encode_payload,
    in_order,
    kept_faces,
    pack_counts,
    split_segments,
    whole_payload,
)
from terraport_pipeline.stages.region_ids import Surface, number_regions
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.tiles.scene_facts import AttributeRange, TiledScene
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented
from terraport_store.manifest import AttributeInfo, HandOff, TextureInfo
from terraport_store.writer import SceneInfo, SceneWriter

__all__ = ["ENCODE_BYTES_PER_FACE", "Scales", "encode", "publish", "scales_of"]

ENCODE_BYTES_PER_FACE: Final = 150


@dataclass(frozen=True, slots=True)
class Scales:
    """How positions and attributes are rounded, the same in every payload."""

    step_m: float
    ranges: dict[str, AttributeRange]
    """Range of every attribute over detail and base."""

    @property
    def attributes(self) -> dict[str, AttributeScale]:
        """Quantisation of every attribute, from its range over all tiles."""
        return {
            n: choose_attribute_scale(value_range.values())
            for n, value_range in self.ranges.items()
        }

    def recorded(self) -> dict[str, Any]:
        """Plain values, for the keys of the payloads."""
        return {
            "step_m": self.step_m,
            "attributes": {n: [s.offset, s.step] for n, s in self.attributes.items()},
        }


class PayloadFiles(Protocol):
    """Access to the encoded payloads of every tile, in the work directory."""

    def __call__(self, tile: int) -> Stored:
        """Give what :func:`encode` made of one tile; arrays may be mapped."""
        ...


def scales_of(
    scene: TiledScene,
    segmented: TiledSegmented,
    base: Mesh,
    spacing_m: float = 0.0,
) -> Scales:
    """Choose the quantisation that all payloads of a scene share."""
    sides = segmented.bounds[:, 3:].astype(np.float64) - segmented.bounds[:, :3]
    farthest = max(
        float(np.abs(scene.low).max()),
        float(np.abs(scene.high).max()),
        float(np.abs(base.vertices).max()),
    )
    ranges = {
        name: value_range.plus(AttributeRange.of(base.attributes[name]))
        for name, value_range in scene.attributes.items()
    }
    return Scales(
        choose_step_m(float(sides.max()), farthest, spacing_m),
        ranges,
    )


def encode(
    mesh: Mesh,
    segments: Int32,
    regions: Int32,
    scales: Scales,
    context: Context,
    textures: TextureSet | None = None,
) -> Stored:
    """Encode one tile's segments.

    Parameters
    ----------
    mesh : Mesh
        The tile.
    segments, regions : ndarray of shape (F,), int32
        Labels of its faces: segments by their numbers within the tile.
    scales : Scales
    context : Context
    textures : TextureSet, optional
        An image for every segment, instead of the vertex colours.

    Returns
    -------
    Stored
        ``glb``: payloads one after the other in order of the segments, with their
        lengths; boxes and counts of the segments.
    """
    attributes = scales.attributes
    payloads = list(
        in_order(
            lambda piece: encode_payload(piece, scales.step_m, attributes),
            split_segments(mesh, segments, regions, textures),
            context.threads,
        )
    )
    arrays: dict[str, AnyArray] = {
        "bounds": np.array([payload.bounds for payload in payloads], np.float64),
        "vertices": np.array([payload.vertices for payload in payloads], np.int64),
        "faces": np.array([payload.faces for payload in payloads], np.int64),
        "glb": np.frombuffer(b"".join(payload.glb for payload in payloads), np.uint8),
        "glb_length": np.array([len(payload.glb) for payload in payloads], np.int64),
    }
    return Stored(arrays, {})


def publish(
    scene_dir: Path,
    base: Mesh,
    segmented: TiledSegmented,
    payloads: PayloadFiles,
    surface: Surface,
    scales: Scales,
    deviation_m: Sequence[float],
    about: About,
    options: Options,
    context: Context,
    textured: tuple[TextureSet, TextureInfo] | None = None,
) -> Packed:
    """Write base, payloads, cover and facts, and publish them in one act.

    Parameters
    ----------
    scene_dir : Path
        Scene directory; untouched until everything is written.
    base : Mesh
        The whole base, as it was covered.
    segmented : TiledSegmented
    payloads : PayloadFiles
    surface : Surface
        For the stable ids of regions.
    scales : Scales
    deviation_m : sequence of float
        50th, 95th, 99th and 99.9th percentile of the distance of detail to base.
    about, options, context
        What the manifest says beyond the meshes, the scene's name, what may be used.
    textured : pair, optional
        The base's texture, and what the manifest says of all; payloads have theirs, or their
        colours.

    Returns
    -------
    Packed

    Raises
    ------
    SceneStoreError
        The disk is full, or somebody else publishes the same scene; nothing half-written is left.
    """
    # (1) Room on the disk, before anything is written.
    progress = context.progress
    kept = kept_faces(base, segmented.base_kept)
    count = len(segmented.tile)
    expected = surface.face_count * EXPECTED_BYTES_PER_FACE // 2
    images = info = None
    if textured is not None:
        images, info = textured
        expected += info.image_bytes + len(images.images)
    with SceneWriter(scene_dir, expected_bytes=expected) as writer:
        # (2) Payloads in order of segment numbers, whichever tile holds them.
        progress.start("pack: segments", float(count), "segments")
        payload_bytes = []
        for number, payload in enumerate(_by_number(segmented, payloads)):
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
        # (3) The base; its faces keep their order, because the cover names them by number.
        progress.start("pack: base", None, "faces")
        attributes = scales.attributes
        glb = encode_glb(
            whole_payload(kept, images),
            step_m=scales.step_m,
            attribute_scales=attributes,
            keep_face_order=True,
        )
        writer.set_base(glb, Cover(segmented.cover_offsets, segmented.cover_segments))
        progress.done({})
        # (4) Regions with their stable ids; the writer's lock is held since (1).
        numbered = number_regions(scene_dir, segmented.region_facts, surface, progress)
        writer.set_regions(numbered.document)
        # (5) The manifest last: readers see the old scene until it is there, then the new one.
        progress.start("pack: publish", None, "files")
        x, y, z = about.origin.tolist()
        manifest = writer.publish(
            SceneInfo(
                name=options.name,
                origin=(x, y, z),
                step_m=scales.step_m,
                points=about.points,
                regions=len(segmented.region_facts["regions"]),
                hand_off=HandOff(deviation_m=deviation_m[3], tolerance_m=segmented.tolerance_m),
                build=about.build,
                crs=about.crs,
                attributes=_attribute_infos(scales.ranges, attributes),
                has_colour=about.has_colour and (info is None or info.segments == 0),
                textures=info,
            )
        )
        progress.done({"version": manifest.version[:12]})
    return Packed(
        manifest, Facts(pack_counts(manifest, payload_bytes) | numbered.counts, numbered.warnings)
    )


def _by_number(segmented: TiledSegmented, payloads: PayloadFiles) -> Iterator[Payload]:
    """Read every payload in the order of the scene's segments."""
    tables: dict[int, tuple[Mapping[str, AnyArray], dict[str, AnyArray]]] = {}
    for tile, within in zip(segmented.tile.tolist(), segmented.within.tolist(), strict=True):
        if tile not in tables:
            arrays = payloads(tile).arrays
            small = {name: np.array(arrays[name]) for name in ("bounds", "vertices", "faces")}
            small["starts"] = np.concatenate([[0], np.cumsum(arrays["glb_length"])])
            tables[tile] = arrays, small
        arrays, small = tables[tile]
        begin, end = small["starts"][within : within + 2]
        yield Payload(
            glb=arrays["glb"][begin:end].tobytes(),
            bounds=tuple(small["bounds"][within].tolist()),
            vertices=int(small["vertices"][within]),
            faces=int(small["faces"][within]),
        )


def _attribute_infos(
    ranges: Mapping[str, AttributeRange], scales: Mapping[str, AttributeScale]
) -> tuple[AttributeInfo, ...]:
    infos = []
    for name, value_range in ranges.items():
        has_values = value_range.low <= value_range.high
        infos.append(
            AttributeInfo(
                name=name,
                gltf_name=gltf_attribute_name(name),
                offset=scales[name].offset,
                step=scales[name].step,
                min=value_range.low if has_values else None,
                max=value_range.high if has_values else None,
            )
        )
    return tuple(infos)
