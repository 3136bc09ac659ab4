"""Pack, tile by tile: payloads of each tile into the work directory, then one scene in order.

A segment's payload needs its tile alone, so tiles are encoded one by one (:func:`encode`); the pack
is then written in the order of the segments' numbers, each payload read from where it lies
(:func:`publish`). Numbers follow the segments' Morton curve, but for payloads that the version
before had: those keep theirs. Memory: one tile and a few payloads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import xxhash

from terraport_payload import (
    AttributeScale,
    Cover,
    SegmentMesh,
    choose_attribute_scale,
    choose_step_m,
    encode_segment,
    gltf_attribute_name,
)
from terraport_payload.grid import NULL_CODE
from terraport_payload.types import AnyArray, Int32, UInt64
from terraport_pipeline.engines.overview import overview_payload
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE, HEIGHT_CHANGE_SCALE
from terraport_pipeline.geometry.regions.base_regions import base_regions
from terraport_pipeline.geometry.segments.segment_ids import carry_segment_ids
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored
from terraport_pipeline.stages.pack import (
    EXPECTED_BYTES_PER_FACE,
    About,
    Options,
    Packed,
    encode_levels,
    in_order,
    kept_faces,
    pack_counts,
    split_segments,
    whole_payload,
)
from terraport_pipeline.stages.region_ids import CarriedNumbers, Surface, number_regions
from terraport_pipeline.stages.survey_change import TileHeights
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.tiles.payload_rows import (
    PayloadFiles,
    hashes_of,
    payloads_by_number,
)
from terraport_pipeline.stages.tiles.scene_facts import AttributeRange, TiledScene
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented, renumbered
from terraport_store import DamagedSceneError, Scene, SceneNotFoundError
from terraport_store.manifest import AttributeInfo, HandOff, TextureInfo
from terraport_store.writer import SceneInfo, SceneWriter

__all__ = [
    "ENCODE_BYTES_PER_FACE",
    "SCALES_FORM",
    "SCALES_NAME",
    "Extents",
    "Scales",
    "encode",
    "publish",
    "scales_of",
]

ENCODE_BYTES_PER_FACE: Final = 150

SCALES_NAME: Final = "pack-scales"

_COARSEST: Final = 16.0
"""Times the step that its values alone would get by which an attribute may be rounded."""


@dataclass(frozen=True, slots=True)
class Extents:
    """What positions and attributes of a scene span, detail and base together."""

    widest_m: float
    """Longest side of any segment's box."""
    farthest_m: float
    """Largest absolute coordinate."""
    spacing_m: float
    """Typical distance between the survey's points; 0 where it is not known."""
    ranges: dict[str, AttributeRange]
    """Range of every attribute."""

    @classmethod
    def of(
        cls, scene: TiledScene, segmented: TiledSegmented, base: Mesh, spacing_m: float = 0.0
    ) -> Extents:
        """Measure a scene."""
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
        return cls(float(sides.max()), farthest, spacing_m, ranges)

    def recorded(self) -> dict[str, Any]:
        """Plain values, for keys."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Scales:
    """How positions and attributes are rounded, the same in every payload.

    Decided once for a scene and its later versions: another step would change every payload.
    """

    step_m: float
    attributes: dict[str, AttributeScale]
    """Quantisation of every attribute, in the order of the segments' masks."""

    def stands(self, extents: Extents) -> bool:
        """Say whether all that a scene spans can be rounded so: nothing is ever clipped."""
        return (
            choose_step_m(extents.widest_m, extents.farthest_m) <= self.step_m
            and self.attributes.keys() == extents.ranges.keys()
            and all(
                _fits(self.attributes[name], value_range)
                for name, value_range in extents.ranges.items()
            )
        )

    def recorded(self) -> dict[str, Any]:
        """Plain values, for the keys of the payloads; order matters, so attributes are a list."""
        return {
            "step_m": self.step_m,
            "attributes": [[n, s.offset, s.step] for n, s in self.attributes.items()],
        }


SCALES_FORM: Final[Form[Scales]] = Form(
    store=lambda scales: Stored({}, scales.recorded()),
    restore=lambda stored, _facts: Scales(
        float(stored.values["step_m"]),
        {
            name: AttributeScale(float(offset), float(step))
            for name, offset, step in stored.values["attributes"]
        },
    ),
    facts=lambda scales: Facts({"step_m": scales.step_m}),
)


def _fits(scale: AttributeScale, value_range: AttributeRange) -> bool:
    """Whether a scale holds a range, about as finely as a scale of its own would."""
    if value_range.high < value_range.low:
        return True
    own = choose_attribute_scale(value_range.values())
    slack = 0.25 * scale.step  # rounding of the range's own ends; encoding takes half a step
    last = scale.offset + scale.step * (NULL_CODE - 1)
    is_whole = scale.step == 1.0 and scale.offset == round(scale.offset)
    return (
        scale.offset - slack <= value_range.low
        and value_range.high <= last + slack
        and scale.step <= _COARSEST * own.step
        and not (is_whole and value_range.fraction is not None)
    )


def scales_of(extents: Extents) -> Scales:
    """Choose the quantisation that all payloads of a scene share."""
    return Scales(
        choose_step_m(extents.widest_m, extents.farthest_m, extents.spacing_m),
        {
            name: choose_attribute_scale(value_range.values())
            for name, value_range in extents.ranges.items()
        },
    )


def encode(
    mesh: Mesh,
    segments: Int32,
    regions: Int32,
    scales: Scales,
    context: Context,
    textures: TextureSet | None = None,
    heights: TileHeights | None = None,
    levels: int = 1,
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
    heights : TileHeights, optional
        How far the ground's height changed: an attribute of the segments in which it did. Those of
        all others have the bytes that they would have without.
    levels : int
        Payloads of each segment.

    Returns
    -------
    Stored
        ``payload``: payloads one after the other in order of the segments, those of a coarser level
        behind them, with their lengths and hashes; boxes and counts; value ``height_change``: least
        and greatest height difference, where any was written.
    """
    attributes, values = scales.attributes, {}
    if heights is not None:
        dz_m = heights.at(mesh.vertices)
        if not np.isnan(dz_m).all():
            values["height_change"] = [float(np.nanmin(dz_m)), float(np.nanmax(dz_m))]
            attributes = {**attributes, HEIGHT_CHANGE: HEIGHT_CHANGE_SCALE}
            mesh = replace(mesh, attributes={**mesh.attributes, HEIGHT_CHANGE: dz_m})
    pieces = list(
        in_order(
            lambda piece: encode_levels(piece, scales.step_m, attributes, levels),
            _without_empty(split_segments(mesh, segments, regions, textures)),
            context.threads,
        )
    )
    payloads = [piece[level] for level in range(levels) for piece in pieces]
    arrays: dict[str, AnyArray] = {
        "bounds": np.array([payload.bounds for payload in payloads], np.float64),
        "vertices": np.array([payload.vertices for payload in payloads], np.int64),
        "faces": np.array([payload.faces for payload in payloads], np.int64),
        "payload": np.frombuffer(b"".join(payload.data for payload in payloads), np.uint8),
        "payload_length": np.array([len(payload.data) for payload in payloads], np.int64),
        "payload_xxh3": np.array(
            [xxhash.xxh3_64_intdigest(payload.data) for payload in payloads], np.uint64
        ),
    }
    if levels > 1:  # of the detail the segments tell
        arrays["region"] = np.array([payload.region for payload in payloads], np.int64)
        arrays["region_count"] = np.array([payload.region_count for payload in payloads], np.int64)
    return Stored(arrays, values)


def _without_empty(pieces: Iterable[SegmentMesh]) -> Iterator[SegmentMesh]:
    """Leave the height differences out of segments in which no vertex has one."""
    for piece in pieces:
        dz_m = piece.attributes.get(HEIGHT_CHANGE)
        if dz_m is not None and np.isnan(dz_m).all():
            kept = {n: values for n, values in piece.attributes.items() if n != HEIGHT_CHANGE}
            yield replace(piece, attributes=kept)
        else:
            yield piece


def publish(
    scene_dir: Path,
    base: Mesh,
    segmented: TiledSegmented,
    payloads: PayloadFiles,
    surface: Surface,
    scales: Scales,
    ranges: Mapping[str, AttributeRange],
    deviation_m: Sequence[float],
    about: About,
    options: Options,
    context: Context,
    textured: tuple[TextureSet, TextureInfo] | None = None,
    carried: CarriedNumbers | None = None,
    *,
    into: Path | None = None,
) -> Packed:
    """Write base, payloads, cover and facts, and publish them in one act.

    Parameters
    ----------
    scene_dir : Path
        Scene directory; untouched until everything is written. Ids go on from what stands there.
    base : Mesh
        The whole base, as it was covered.
    segmented : TiledSegmented
    payloads : PayloadFiles
    surface : Surface
        For the regions of the base, and their stable ids.
    scales : Scales
    ranges : mapping
        Range of every attribute, for the manifest.
    deviation_m : sequence of float
        50th, 95th, 99th and 99.9th percentile of the distance of detail to base.
    about, options, context
        What the manifest says beyond the meshes, the scene's name, what may be used.
    textured : pair, optional
        The base's texture, and what the manifest says of all; payloads have theirs, or their
        colours.
    carried : CarriedNumbers, optional
        Numbers of regions that go on; None where they are matched by their ground.
    into : Path, optional
        Another directory to publish in: what people named is cut into it first.

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
    with SceneWriter(into or scene_dir, expected_bytes=expected) as writer:
        # (2) Payloads in order of segment numbers, whichever tile holds them; the writer's lock is
        # held since (1), so the version before stays what it is.
        hashes = hashes_of(segmented, payloads)
        ids, held = carry_segment_ids(hashes, _hashes_before(scene_dir))
        segmented = renumbered(segmented, ids)
        progress.start("pack: segments", float(count), "segments")
        payload_bytes = []
        for number, payload in enumerate(payloads_by_number(segmented, payloads)):
            writer.add_segment(
                payload.data,
                region=int(segmented.main_region[number]),
                region_count=int(segmented.region_counts[number]),
                bounds=payload.bounds,
                vertices=payload.vertices,
                faces=payload.faces,
            )
            payload_bytes.append(len(payload.data))
            progress.advance(1)
        for level in range(1, options.levels):
            for payload in payloads_by_number(segmented, payloads, level):
                writer.add_segment(
                    payload.data,
                    region=payload.region,
                    region_count=payload.region_count,
                    bounds=payload.bounds,
                    vertices=payload.vertices,
                    faces=payload.faces,
                )
        progress.done({})
        # (3) The base; its faces keep their order, because the cover names them by number.
        progress.start("pack: base", None, "faces")
        attributes = scales.attributes
        encoded = encode_segment(
            whole_payload(kept, images, base_regions(kept.vertices, surface.pieces())),
            step_m=scales.step_m,
            scales=attributes,
            may_be_wide=True,
        )
        cover = Cover(segmented.cover_offsets, segmented.cover_segments)
        writer.set_base(encoded, cover, overview_payload(encoded, scales.step_m))
        progress.done({})
        # (4) Regions with their stable ids.
        numbered = number_regions(scene_dir, segmented.region_facts, surface, progress, carried)
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
                survey_units=about.survey_units,
                attributes=(
                    *_attribute_infos(ranges, attributes),
                    *_height_change_info(segmented, payloads),
                ),
                has_colour=about.has_colour and (info is None or info.segments == 0),
                textures=info,
                levels=options.levels,
            )
        )
        progress.done({"version": manifest.version[:12]})
    counts = pack_counts(manifest, payload_bytes) | numbered.counts
    counts["segments_kept"] = int(np.count_nonzero(held))
    return Packed(manifest, Facts(counts, numbered.warnings))


def _hashes_before(scene_dir: Path) -> UInt64:
    """Read the hashes of the payloads that are published, by segment; none where it cannot be."""
    try:
        with Scene.open(scene_dir) as opened:
            return opened.index.xxh3.astype(np.uint64)
    except (SceneNotFoundError, DamagedSceneError):
        return np.zeros(0, np.uint64)


def _attribute_infos(
    ranges: Mapping[str, AttributeRange], scales: Mapping[str, AttributeScale]
) -> tuple[AttributeInfo, ...]:
    """Describe attributes in the order of their scales, which is that of the segments' masks."""
    infos = []
    for name, scale in scales.items():
        value_range = ranges[name]
        has_values = value_range.low <= value_range.high
        infos.append(
            AttributeInfo(
                name=name,
                gltf_name=gltf_attribute_name(name),
                offset=scale.offset,
                step=scale.step,
                min=value_range.low if has_values else None,
                max=value_range.high if has_values else None,
            )
        )
    return tuple(infos)


def _height_change_info(
    segmented: TiledSegmented, payloads: PayloadFiles
) -> tuple[AttributeInfo, ...]:
    """Describe the height differences, where any payload has them."""
    ends = [payloads(tile).values.get("height_change") for tile in np.unique(segmented.tile)]
    every = [end for pair in ends if pair is not None for end in pair]
    if not every:
        return ()
    return _attribute_infos(
        {HEIGHT_CHANGE: AttributeRange(min(every), max(every), None)},
        {HEIGHT_CHANGE: HEIGHT_CHANGE_SCALE},
    )
