"""Segment: regions and streamable segments of the detail, and which segments lie over the base.

Memory: about 350 bytes per detail face, its meshes included (measured at 10 M faces).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np

from terraport_payload.types import Bool, Float32, Int32, UInt32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.cover.cover import BaseCover, build_cover
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.chunks import side_by_side
from terraport_pipeline.geometry.regions.region_facts import region_facts
from terraport_pipeline.geometry.regions.segmenter import Segmentation
from terraport_pipeline.geometry.segments.segment_shapes import segment_shapes
from terraport_pipeline.geometry.segments.segments import SegmentOptions, Segments, build_segments
from terraport_pipeline.option import Option
from terraport_pipeline.stages.contract import Context, Facts, Json, Stored
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.region_engine import (
    RegionOptions,
    make_segmenter,
    segmenter_mesh,
)

__all__ = [
    "MAX_REGIONS",
    "NAME",
    "SMALLEST_TOLERANCE_M",
    "Options",
    "Segmented",
    "restore",
    "run",
    "store",
]

NAME: Final = "segment"


MAX_REGIONS: Final = 65535
"""Feature ids travel as 16-bit numbers."""

SMALLEST_TOLERANCE_M: Final = 1e-3
"""Base and detail can coincide (a cloud so small that both are the same): the cover needs a
length."""


@dataclass(frozen=True, slots=True)
class Options(RegionOptions):
    """How to cut the surface into regions and segments."""

    min_faces: Annotated[int, Option(least=1)] = 2000
    """Segments with fewer faces are merged. Higher: fewer draw calls, coarser landings."""
    max_faces: Annotated[int, Option(least=1)] = 20000
    """Segments with more faces are cut."""
    max_extent_m: Annotated[
        float | None, Option(above=0, unit="m", unset="by the density of the faces")
    ] = None
    """Segments wider than this, metres, are cut."""
    units: Annotated[Literal["segments", "pools"], Option()] = "segments"
    """What is streamed as one piece. pools: each pool of the thesis as it is, to compare."""

    def __post_init__(self) -> None:
        RegionOptions.__post_init__(self)  # a slotted dataclass has no super() without arguments
        if self.min_faces > self.max_faces:
            raise OptionError(
                f"segments of {self.min_faces} to {self.max_faces} faces; expected the smaller "
                "bound first"
            )


@dataclass(frozen=True, slots=True)
class Segmented:
    """Labels of the detail's faces, and the cover of the base's."""

    regions: Int32
    """(F,) region of every detail face, 0 to R - 1."""
    segments: Int32
    """(F,) segment of every detail face, numbered along a Morton curve."""
    base_kept: Bool
    """(B,) base faces with detail over them. The others reach beyond the surface that there is and
    are not published: never hidden, they would stand as a fringe around loaded detail."""
    cover_offsets: UInt32
    """(K + 1,) CSR rows, one per base face that is kept."""
    cover_segments: UInt32
    main_region: Int32
    """(S,) region with most faces in the segment."""
    region_counts: Int32
    """(S,) regions in the segment."""
    bounds: Float32
    """(S, 6) each segment's box: minimum x, y, z, maximum x, y, z; metres, scene frame."""
    region_facts: dict[str, Json]
    """Contents of regions.json."""
    tolerance_m: float
    """Tolerance of the cover."""
    max_extent_m: float
    """Bound that the segments were cut to."""
    facts: Facts


def run(reconstructed: Reconstructed, options: Options, context: Context) -> Segmented:
    """Cut the detail into regions and segments and cover the base.

    Parameters
    ----------
    reconstructed : Reconstructed
    options : Options
    context : Context

    Returns
    -------
    Segmented
    """
    detail, progress = reconstructed.detail, context.progress
    mesh = (detail.vertices, detail.faces)
    # (1) regions and fine pools
    progress.start("segment: regions", None, "faces")
    pairs = face_pairs(detail.faces, len(detail.vertices), threads=context.threads)
    segmenter = make_segmenter(options, threads=context.threads)
    segmentation = segmenter.segment(
        segmenter_mesh(detail, pairs, options, threads=context.threads)
    )
    progress.done({"regions": segmentation.region_count, "pools": segmentation.fine_count})
    if segmentation.region_count > MAX_REGIONS:
        raise OptionError(
            f"{segmentation.region_count} regions; at most {MAX_REGIONS} can be told apart at run "
            "time: raise --small-region-share, or change the engine's own threshold (terraport "
            "build --help)"
        )
    # (2) Segments and cover.
    # The regions' facts need neither segments nor cover: they are gathered beside them.
    facts, (segments, shapes, cover, base_kept, tolerance_m) = side_by_side(
        [
            lambda: region_facts(
                *mesh,
                detail.colours,
                segmentation.regions,
                attributes=detail.attributes,
                pairs=pairs,
            ),
            lambda: _cut_and_cover(reconstructed, segmentation, pairs, options, context),
        ],
        threads=context.threads,
    )
    # (3) Counts, and what is worth a warning.
    counts: dict[str, Any] = {
        "regions": segmentation.region_count,
        "pools": segmentation.fine_count,
        "segments": segments.count,
        "largest_segment_faces": int(segments.face_counts.max()),
        "smallest_segment_faces": int(segments.face_counts.min()),
        "max_extent_m": segments.max_extent_m,
        "tolerance_m": tolerance_m,
        "cover_entries": len(cover.segments),
        "base_faces": int(base_kept.sum()),
        "base_faces_beyond": int((~base_kept).sum()),
        "detail_faces_far_from_base": cover.far_detail_faces,
        "detail_faces_without_base": cover.baseless_detail_faces,
    }
    counts |= shapes
    counts |= {"engine": options.engine, "segment_by": options.segment_by, **segmentation.facts}
    counts |= {f"segments_{name}": n for name, n in asdict(segments.exceptions).items()}
    warnings = []
    one_colour = options.segment_by == "colour" and not np.ptp(detail.colours, axis=0).any()
    if one_colour and segmentation.region_count == 1:
        warnings.append(
            "the surface has one colour and is therefore one region: --engine graph --segment-by "
            "shape tells regions apart by how the surface folds"
        )
    if cover.baseless_detail_faces:
        warnings.append(
            f"{cover.baseless_detail_faces} detail faces have no base below or above them: there "
            "is nothing to see there until they are loaded"
        )
    return Segmented(
        regions=segmentation.regions,
        segments=segments.labels,
        base_kept=base_kept,
        cover_offsets=cover.offsets[np.append(True, base_kept)],
        cover_segments=cover.segments,
        main_region=segments.main_region,
        region_counts=segments.region_counts,
        bounds=segments.bounds,
        region_facts=facts,
        tolerance_m=tolerance_m,
        max_extent_m=segments.max_extent_m,
        facts=Facts(counts, tuple(warnings)),
    )


def _cut_and_cover(
    reconstructed: Reconstructed,
    segmentation: Segmentation,
    pairs: tuple[Int32, Int32],
    options: Options,
    context: Context,
) -> tuple[Segments, dict[str, list[float]], BaseCover, Bool, float]:
    """Cut the segments and find what they cover of the base."""
    detail, base, progress = reconstructed.detail, reconstructed.base, context.progress
    mesh = (detail.vertices, detail.faces)
    # (2) segments
    progress.start("segment: segments", None, "faces")
    segments = build_segments(
        *mesh,
        segmentation.fine,
        segmentation.similarity,
        segmentation.regions,
        SegmentOptions(
            min_faces=options.min_faces,
            max_faces=options.max_faces,
            max_extent_m=options.max_extent_m,
            units=options.units,
        ),
        pairs=pairs,
        threads=context.threads,
    )
    shapes = segment_shapes(*mesh, segments, threads=context.threads)
    progress.done({"segments": segments.count})
    # (3) cover
    progress.start("segment: cover", None, "base faces")
    tolerance_m = max(reconstructed.deviation_m[2], SMALLEST_TOLERANCE_M)
    # Faces partly beyond the detail may be hidden too, because nothing is kept beyond them: no slit
    # can open between the detail's rim and a next base face.
    cover = build_cover(
        base.vertices,
        base.faces,
        *mesh,
        segments.labels,
        tolerance_m=tolerance_m,
        hide_partly_covered=True,
        threads=context.threads,
    )
    base_kept = np.diff(cover.offsets.astype(np.int64)) > 0
    progress.done({"base faces": int(base_kept.sum())})
    return segments, shapes, cover, base_kept, tolerance_m


def store(result: Segmented) -> Stored:
    """Turn the result into arrays and values."""
    names = ("regions", "segments", "base_kept", "cover_offsets", "cover_segments", "main_region")
    arrays = {name: getattr(result, name) for name in (*names, "region_counts", "bounds")}
    values = {
        "region_facts": result.region_facts,
        "tolerance_m": result.tolerance_m,
        "max_extent_m": result.max_extent_m,
    }
    return Stored(arrays, values)


def restore(stored: Stored, facts: Facts) -> Segmented:
    """Turn arrays and values back into the result."""
    arrays, values = stored.arrays, stored.values
    return Segmented(
        regions=np.asarray(arrays["regions"], dtype=np.int32),
        segments=np.asarray(arrays["segments"], dtype=np.int32),
        base_kept=np.asarray(arrays["base_kept"], dtype=bool),
        cover_offsets=np.asarray(arrays["cover_offsets"], dtype=np.uint32),
        cover_segments=np.asarray(arrays["cover_segments"], dtype=np.uint32),
        main_region=np.asarray(arrays["main_region"], dtype=np.int32),
        region_counts=np.asarray(arrays["region_counts"], dtype=np.int32),
        bounds=np.asarray(arrays["bounds"], dtype=np.float32),
        region_facts=values["region_facts"],
        tolerance_m=values["tolerance_m"],
        max_extent_m=values["max_extent_m"],
        facts=facts,
    )
