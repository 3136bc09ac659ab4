"""Segment: regions and streamable segments of the detail, and which segments lie over the base.

Memory: about 350 bytes per detail face, its meshes included (measured at 10 M faces).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from terraport_payload.types import Bool, Float32, Int32, UInt32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.adjacency import face_pairs
from terraport_pipeline.geometry.chunks import side_by_side
from terraport_pipeline.geometry.cover import BaseCover, build_cover
from terraport_pipeline.geometry.region_facts import region_facts
from terraport_pipeline.geometry.segment_shapes import segment_shapes
from terraport_pipeline.geometry.segmenter import Segmentation
from terraport_pipeline.geometry.segments import SegmentOptions, Segments, build_segments
from terraport_pipeline.stages.contract import Context, Facts, Json, Stored
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.region_engine import (
    ENGINES,
    Engine,
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

_MOST_THRESHOLD: Final = 1_000_000
"""The scale of "felzenszwalb" is the widest: up to 30,000 means something on landscapes."""

SMALLEST_TOLERANCE_M: Final = 1e-3
"""Base and detail can coincide (a cloud so small that both are the same): the cover needs a
length."""


@dataclass(frozen=True, slots=True)
class Options:
    """How to cut the surface into regions and segments."""

    engine: Engine = "means"
    """Means of colour (measures best on landscapes), the graph of faces, the Triangle Pool
    Algorithm (the thesis), or to compare with: "felzenszwalb" and "grid"."""
    segment_by: str = "colour"
    """What faces are compared by: "colour", "shape", or an attribute's name."""
    region_threshold: float | None = None
    """The engine's own: Th of "tpa" (0.7, lower tells more apart), the stop of "graph" (0.5, higher
    tells more apart), the spread of "means" (0.95, lower tells more apart), the scale k of
    "felzenszwalb" (100, lower tells more apart), the cell of "grid" in metres. None for those."""
    region_small: float | None = None
    """Regions below this share of the surface join a neighbour. None for the engine's own: 0.015
    of "tpa", 0.003 of "graph", 0.002 of "means" and "felzenszwalb"; "grid" knows none."""
    segment_threshold: float = 0.2
    """Th of the pools that segments are merged from; of "tpa" alone."""
    min_faces: int = 2000
    """Segments below this are merged. Higher: fewer draw calls, coarser landings."""
    max_faces: int = 20000
    """Segments above this are cut."""
    max_extent_m: float | None = None
    """Segments wider than this are cut; None chooses by the density of faces."""
    units: Literal["segments", "pools"] = "segments"
    """"pools" streams each pool of the thesis as it is, for comparison."""

    def __post_init__(self) -> None:
        if self.engine not in ENGINES:
            raise OptionError(f"engine {self.engine!r}; expected one of {', '.join(ENGINES)}")
        if not self.segment_by:
            raise OptionError("segments by ''; expected colour, shape or an attribute's name")
        for name, value in (
            ("region threshold", self.region_threshold),
            ("segment threshold", self.segment_threshold),
        ):
            if value is not None and not 0 < value <= _MOST_THRESHOLD:
                raise OptionError(f"{name} {value}; expected above 0, at most {_MOST_THRESHOLD}")
        if self.region_small is not None and not 0 <= self.region_small < 1:
            raise OptionError(f"small region share {self.region_small}; expected 0 to below 1")
        if not 1 <= self.min_faces <= self.max_faces:
            raise OptionError(
                f"segments of {self.min_faces} to {self.max_faces} faces; expected at least 1, and "
                "the smaller bound first"
            )
        if self.max_extent_m is not None and not self.max_extent_m > 0:
            raise OptionError(f"largest extent {self.max_extent_m} m; expected above 0")


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
    found = make_segmenter(
        options.engine,
        segment_by=options.segment_by,
        region_threshold=options.region_threshold,
        region_small=options.region_small,
        segment_threshold=options.segment_threshold,
        threads=context.threads,
    ).segment(
        segmenter_mesh(
            detail,
            pairs,
            engine=options.engine,
            segment_by=options.segment_by,
            threads=context.threads,
        )
    )
    progress.done({"regions": found.region_count, "pools": found.fine_count})
    if found.region_count > MAX_REGIONS:
        raise OptionError(
            f"{found.region_count} regions; at most {MAX_REGIONS} can be told apart at run time: "
            "change --region-threshold or raise --region-small"
        )
    # The regions' facts need neither segments nor cover: they are gathered beside them.
    facts, (segments, shapes, cover, base_kept, tolerance_m) = side_by_side(
        [
            lambda: region_facts(
                *mesh, detail.colours, found.regions, attributes=detail.attributes, pairs=pairs
            ),
            lambda: _cut_and_cover(reconstructed, found, pairs, options, context),
        ],
        threads=context.threads,
    )
    counts: dict[str, Any] = {
        "regions": found.region_count,
        "pools": found.fine_count,
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
    counts |= {"engine": options.engine, "segment_by": options.segment_by, **found.facts}
    counts |= {f"segments_{name}": n for name, n in asdict(segments.exceptions).items()}
    warnings = []
    one_colour = options.segment_by == "colour" and not np.ptp(detail.colours, axis=0).any()
    if one_colour and found.region_count == 1:
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
        regions=found.regions,
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
    found: Segmentation,
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
        found.fine,
        found.similarity,
        found.regions,
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
