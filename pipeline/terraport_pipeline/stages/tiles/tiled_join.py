"""The last step of segmenting: one numbering, one cover, one set of facts for all tiles.

Holds no faces of the detail: a few hundred bytes per segment, 8 per entry of the cover, and the
sums of regions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float32, Float64, Int32, UInt32
from terraport_pipeline.geometry.mesh.curve import morton_codes
from terraport_pipeline.geometry.regions.region_facts import add_borders
from terraport_pipeline.geometry.regions.region_plan import with_plan
from terraport_pipeline.geometry.regions.region_totals import (
    RegionTotals,
    add_totals,
    spread_totals,
    totals_document,
)
from terraport_pipeline.geometry.segments.segment_ids import renumber_rows
from terraport_pipeline.geometry.segments.segment_shapes import QUANTILES
from terraport_pipeline.geometry.tiles.tiled_cover import unite_covers
from terraport_pipeline.geometry.tiles.tiled_means import JoinedRegions
from terraport_pipeline.options.regions import COLOUR, Options
from terraport_pipeline.stages.contract import Facts, Form, Json, Stored
from terraport_pipeline.stages.region_engine import SHAPE
from terraport_pipeline.stages.tiles.base_cover import NearBase
from terraport_pipeline.stages.tiles.scene_facts import SceneScale, TiledScene
from terraport_pipeline.stages.tiles.tiled_plan import loose_parts
from terraport_pipeline.stages.tiles.tiled_segment import Regions, totals_of

__all__ = ["FORM", "TiledSegmented", "join", "renumbered"]


@dataclass(frozen=True, slots=True)
class TiledSegmented:
    """What a build knows of its segments; labels of faces stay with the tiles."""

    tile: Int32
    """(S,) tile of every segment; :func:`join` numbers segments along one Morton curve."""
    within: Int32
    """(S,) its number within the tile."""
    main_region: Int32
    """(S,) region with most faces in the segment."""
    region_counts: Int32
    """(S,) regions in the segment."""
    bounds: Float32
    """(S, 6) each segment's box: minimum x, y, z, maximum x, y, z; metres, scene frame."""
    base_kept: Bool
    """(B,) base faces with detail over them; the others are not published."""
    cover_offsets: UInt32
    """(K + 1,) CSR rows, one per base face that is kept."""
    cover_segments: UInt32
    region_facts: dict[str, Json]
    """Contents of regions.json."""
    tolerance_m: float
    max_extent_m: float
    facts: Facts


def join(
    tiles: Iterable[Stored],
    covers: Iterable[Stored],
    scene: TiledScene,
    scale: SceneScale,
    regions: Regions,
    seam_regions: Int32,
    near: NearBase,
    options: Options,
    tolerance_m: float,
    plan: Mapping[str, Json],
) -> TiledSegmented:
    """Give segments their numbers, unite covers and add up facts.

    Parameters
    ----------
    tiles : iterable of Stored
        From :func:`~.tiled_segment.cut`, in order of the tiles; loaded one at a time.
    covers : iterable of Stored
        From :func:`.base_cover.cover`, in the same order.
    scene : TiledScene
    scale : SceneScale
    regions : Regions
        The published regions.
    seam_regions : ndarray of shape (N, 2), int32
        Regions on both sides of every seam.
    near : NearBase
    options : Options
    tolerance_m : float
        Tolerance of the cover, metres.
    plan : mapping
        Values of :func:`.tiled_plan.run`.

    Returns
    -------
    TiledSegmented
    """
    joined = regions.joined
    tables: list[dict[str, Any]] = []
    totals: RegionTotals | None = None
    exceptions: Counter[str] = Counter()
    for stored in tiles:
        arrays = stored.arrays
        names = ("face_counts", "bounds", "main_region", "region_counts", "ragged")
        tables.append({name: np.array(arrays[name]) for name in names})
        present = np.array(arrays["present"], np.int32)
        of_tile = spread_totals(totals_of(arrays), present, joined.count)
        totals = of_tile if totals is None else add_totals(totals, of_tile)
        exceptions.update(stored.values["exceptions"])
    assert totals is not None
    # (1) one curve over all segments
    counts = [len(table["face_counts"]) for table in tables]
    tile = np.repeat(np.arange(len(tables), dtype=np.int32), counts)
    within = np.concatenate([np.arange(n, dtype=np.int32) for n in counts])
    every = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    bounds = every["bounds"]
    order = np.argsort(
        morton_codes((bounds[:, :3] + bounds[:, 3:]) * np.float32(0.5)), kind="stable"
    )
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    starts = np.concatenate([[0], np.cumsum(counts)])
    # (2) one cover
    far = baseless = 0
    entries: list[tuple[Int32, Int32]] = []
    for stored, rows, at in zip(covers, near.rows, starts[:-1], strict=True):
        face, segment = (np.array(stored.arrays[name]) for name in ("base_face", "segment"))
        entries.append((rows[face].astype(np.int32), number[segment + at]))
        far += int(stored.values["far_faces"])
        baseless += int(stored.values["baseless_faces"])
    offsets, segments = unite_covers(entries, len(near.base.faces))
    base_kept = np.diff(offsets.astype(np.int64)) > 0
    # (3) one set of facts
    crossing = seam_regions[:, 0] != seam_regions[:, 1]
    touching, border_m = add_borders(
        np.concatenate([totals.touching, seam_regions[crossing]]),
        np.concatenate([totals.border_m, scene.seams.length_m[crossing]]),
    )
    totals = replace(totals, touching=touching, border_m=border_m)
    facts = with_plan(
        totals_document(totals, list(scene.attributes), scale.roughness_scale_m), plan
    )
    if len(joined.unions):
        facts["unions"] = [
            [one, other, round(cost, 3)]
            for (one, other), cost in zip(
                joined.unions.tolist(), joined.union_costs.tolist(), strict=True
            )
        ]
    ordered = {name: values[order] for name, values in every.items()}
    max_extent_m = scale.max_extent_m
    sides = ordered["bounds"][:, 3:].astype(np.float64) - ordered["bounds"][:, :3]
    quantiles = {
        "segment_faces": _quantiles(ordered["face_counts"], 0),
        "segment_extent_m": _quantiles(sides.max(axis=1), 3),
        "segment_raggedness": _quantiles(ordered["ragged"], 2),
    }
    outcome: dict[str, Json] = {
        "regions": joined.count,
        "pools": joined.fine_count,
        "segments": len(order),
        "tiles": len(tables),
        "seam_edges": len(seam_regions),
        "seam_edges_between_regions": int(np.count_nonzero(crossing)),
        "largest_segment_faces": int(ordered["face_counts"].max()),
        "smallest_segment_faces": int(ordered["face_counts"].min()),
        "max_extent_m": max_extent_m,
        "tolerance_m": tolerance_m,
        "cover_entries": len(segments),
        "base_faces": int(base_kept.sum()),
        "base_faces_beyond": int((~base_kept).sum()),
        "detail_faces_far_from_base": far,
        "detail_faces_without_base": baseless,
        **quantiles,
        "engine": options.engine,
        "segment_by": options.segment_by,
        **regions.facts,
        **{f"segments_{name}": n for name, n in exceptions.items()},
    }
    return TiledSegmented(
        tile[order],
        within[order],
        ordered["main_region"],
        ordered["region_counts"],
        ordered["bounds"],
        base_kept,
        offsets[np.append(True, base_kept)],
        segments,
        facts,
        tolerance_m,
        max_extent_m,
        Facts(
            outcome,
            (*_warnings(scene, joined, options, baseless), *loose_parts(plan["volumes"])),
        ),
    )


def renumbered(segmented: TiledSegmented, ids: Int32) -> TiledSegmented:
    """Give segments other numbers: ``ids``, (S,), a permutation."""
    order = np.argsort(ids)
    return replace(
        segmented,
        **{name: getattr(segmented, name)[order] for name in _OF_SEGMENTS},
        cover_segments=renumber_rows(segmented.cover_offsets, segmented.cover_segments, ids),
    )


def _store(result: TiledSegmented) -> Stored:
    arrays = {name: getattr(result, name) for name in _ARRAYS}
    return Stored(
        arrays,
        {
            "region_facts": result.region_facts,
            "tolerance_m": result.tolerance_m,
            "max_extent_m": result.max_extent_m,
        },
    )


def _restore(stored: Stored, facts: Facts) -> TiledSegmented:
    arrays: dict[str, Any] = {name: np.asarray(stored.arrays[name]) for name in _ARRAYS}
    return TiledSegmented(**arrays, **dict(stored.values), facts=facts)


_OF_SEGMENTS: Final = ("tile", "within", "main_region", "region_counts", "bounds")
_ARRAYS: Final = (*_OF_SEGMENTS, "base_kept", "cover_offsets", "cover_segments")


FORM: Final = Form(_store, _restore, attrgetter("facts"))


def _warnings(
    scene: TiledScene, joined: JoinedRegions, options: Options, baseless: int
) -> Iterator[str]:
    is_grey = options.segment_by == COLOUR and scene.is_grey
    if joined.count == 1 and is_grey:
        yield (
            "the surface has one colour and is therefore one region: --engine graph --segment-by "
            "shape tells regions apart by how the surface folds"
        )
    elif joined.count == 1 and options.segment_by == SHAPE:
        yield (
            f"the surface came out as one region: engine {options.engine} finds no border by "
            "shape; another --engine or --segment-by may"
        )
    if baseless:
        yield (
            f"{baseless} detail faces have no base below or above them: there is nothing to see "
            "there until they are loaded"
        )


def _quantiles(values: AnyArray | Float64, digits: int) -> list[float]:
    return [round(float(value), digits) for value in np.quantile(values, QUANTILES)]
