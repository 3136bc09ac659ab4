"""Segment, tile by tile: regions over all tiles, segments within each, one cover, one set of facts.

Five steps, of which the second and the fourth are the long ones:

1. :func:`measure` every tile; :func:`scene_of` adds up what the whole scene must know;
2. :func:`units` of every tile: fine pools, with their borders. An engine that needs the surface in
   one piece gets it as the only tile, and its regions are the units;
3. :func:`regions`: the units of all tiles united to regions, across the tiles' borders;
4. :func:`cut` every tile into segments, lay them over the base, sum up its regions' facts;
5. ``tiled_join.py``: segments numbered along one curve, covers and sums united.

Nothing here holds more than one tile. Memory: about 350 bytes per face of a tile in steps 2 and 4;
100 in step 1; what steps 3 and 5 hold of the whole scene is small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Int32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import (
    extent_of_area,
    longest_edge,
    surface_area,
)
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.region_totals import RegionTotals, slope_bins, tile_totals
from terraport_pipeline.geometry.segments.segment_shapes import raggedness
from terraport_pipeline.geometry.segments.segments import (
    SegmentExceptions,
    SegmentOptions,
    build_segments,
)
from terraport_pipeline.geometry.tiles.tile_seams import OpenEdges, match_seams, open_edges
from terraport_pipeline.geometry.tiles.tiled_cover import tile_cover
from terraport_pipeline.geometry.tiles.tiled_means import (
    JoinedRegions,
    MeansScale,
    colours_of_faces,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context, Facts, Form, Json, Stored
from terraport_pipeline.stages.region_engine import (
    means_segmenter,
)
from terraport_pipeline.stages.segment import MAX_REGIONS, Options
from terraport_pipeline.stages.tiles.scene_facts import AttributeRange, TiledScene
from terraport_pipeline.stages.tiles.tile_engines import tile_engine

__all__ = [
    "CUT_BYTES_PER_FACE",
    "MEASURE_BYTES_PER_FACE",
    "REGIONS_FORM",
    "UNITS_BYTES_PER_FACE",
    "Regions",
    "cut",
    "measure",
    "regions",
    "scene_of",
    "totals_of",
    "units",
]

MEASURE_BYTES_PER_FACE: Final = 150
UNITS_BYTES_PER_FACE: Final = 350
CUT_BYTES_PER_FACE: Final = 350


def measure(mesh: Mesh, context: Context) -> Stored:
    """Measure one tile; see :func:`scene_of`."""
    pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=context.threads)
    edges = open_edges(mesh.vertices, mesh.faces, pairs)
    totals = ColourTotals.of(colours_of_faces(mesh.colours, mesh.faces))
    ranges = {name: AttributeRange.of(values) for name, values in mesh.attributes.items()}
    return Stored(
        {
            "ends": edges.ends,
            "end_face": edges.face,
            "whole": totals.whole,
            "products": totals.products,
        },
        {
            "faces": len(mesh.faces),
            "vertices": len(mesh.vertices),
            "area_m2": surface_area(mesh.vertices, mesh.faces, threads=context.threads),
            "low": mesh.vertices.min(axis=0).astype(np.float64).tolist(),
            "high": mesh.vertices.max(axis=0).astype(np.float64).tolist(),
            "longest_m": longest_edge(mesh.vertices, pairs[1], threads=context.threads),
            "attributes": {n: [r.low, r.high, r.fraction] for n, r in ranges.items()},
        },
    )


def scene_of(tiles: Sequence[Stored], options: Options) -> TiledScene:
    """Add up what :func:`measure` found in every tile."""
    # (1) Sums of colours, which add up exactly.
    values = [tile.values for tile in tiles]
    totals = None
    for tile in tiles:
        totals_of_tile = ColourTotals(
            tile.values["faces"],
            np.array(tile.arrays["whole"], np.int64),
            np.array(tile.arrays["products"], np.int64),
        )
        totals = totals_of_tile if totals is None else totals.plus(totals_of_tile)
    assert totals is not None
    # (2) Open edges of different tiles at the same place are one seam.
    seams = match_seams(
        [
            OpenEdges(
                np.array(tile.arrays["ends"], np.float32),
                np.array(tile.arrays["end_face"], np.int32),
            )
            for tile in tiles
        ]
    )
    # (3) Ranges of the attributes.
    attributes: dict[str, AttributeRange] = {}
    for value in values:
        for name, stored_range in value["attributes"].items():
            value_range = AttributeRange(*stored_range)
            attributes[name] = (
                attributes[name].plus(value_range) if name in attributes else value_range
            )
    # (4) What all tiles are cut by.
    faces = tuple(int(value["faces"]) for value in values)
    area_m2 = float(sum(value["area_m2"] for value in values))
    low = np.min([value["low"] for value in values], axis=0)
    high = np.max([value["high"] for value in values], axis=0)
    longest_m = max(
        *(value["longest_m"] for value in values), float(seams.length_m.max(initial=0.0))
    )
    return TiledScene(
        faces,
        sum(int(value["vertices"]) for value in values),
        area_m2,
        low,
        high,
        seams,
        attributes,
        MeansScale(means_segmenter(options), totals, longest_m),
        options.max_extent_m
        or extent_of_area(area_m2, sum(faces), float((high - low).max()), options.max_faces),
    )


def units(mesh: Mesh, tile: int, scene: TiledScene, options: Options, context: Context) -> Stored:
    """Unite one tile's faces up to the fine pools; see :meth:`.TileEngine.units`."""
    pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=context.threads)
    return tile_engine(options).units(mesh, pairs, tile, scene, context)


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """Regions over all tiles, and what the engine tells of them."""

    joined: JoinedRegions
    facts: dict[str, Json]


REGIONS_FORM: Final[Form[Regions]] = Form(
    store=lambda result: Stored(
        {
            "region": np.concatenate(result.joined.region),
            "fine": np.concatenate(result.joined.fine),
            "starts": np.cumsum([len(units) for units in result.joined.region])[:-1],
        },
        {
            "numbers": [
                result.joined.count,
                result.joined.fine_count,
                result.joined.pools,
                result.joined.islands,
            ],
            "facts": result.facts,
        },
    ),
    restore=lambda stored, _facts: Regions(
        JoinedRegions(
            tuple(np.split(stored.arrays["region"], stored.arrays["starts"])),
            tuple(np.split(stored.arrays["fine"], stored.arrays["starts"])),
            *stored.values["numbers"],
        ),
        stored.values["facts"],
    ),
    facts=lambda result: Facts({"regions": result.joined.count}),
)


def regions(
    tiles: Sequence[Stored], scene: TiledScene, options: Options, context: Context
) -> Regions:
    """Unite the units of all tiles to regions.

    Parameters
    ----------
    tiles : sequence of Stored
        From :func:`units`; only the labels of faces at seams are looked at, so they may be mapped.
    scene : TiledScene
    options : Options
    context : Context

    Raises
    ------
    OptionError
        More regions than can be told apart at run time.
    """
    context.progress.start("segment: regions across tiles", None, "units")
    joined, facts = tile_engine(options).regions(tiles, scene, context)
    if joined.count > MAX_REGIONS:
        raise OptionError(
            f"{joined.count} regions; at most {MAX_REGIONS} can be told apart at run time: raise "
            "--small-region-share, or change the engine's own threshold (terraport build --help)"
        )
    context.progress.done({"regions": joined.count})
    return Regions(joined, dict(facts))


def cut(
    mesh: Mesh,
    units: Stored,
    of_unit: tuple[Int32, Int32],
    base: Mesh,
    scene: TiledScene,
    options: Options,
    context: Context,
    *,
    region_count: int,
    tolerance_m: float,
) -> Stored:
    """Cut one tile into segments, lay them over the base and sum up its regions' facts.

    Parameters
    ----------
    mesh : Mesh
        The tile.
    units : Stored
        From :func:`units`.
    of_unit : pair of ndarray of shape (U,), int32
        Fine pool and region of every unit.
    base : Mesh
        The whole base.
    region_count : int
        Regions of the scene.
    tolerance_m : float
        Of the cover.

    Returns
    -------
    Stored
        For ``tiled_join.py``.
    """
    # (1) Regions and pools of the faces, from those of their units.
    threads = context.threads
    fine, region = of_unit
    labels = np.array(units.arrays["labels"])
    faces_region: Int32 = region[labels]
    pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=threads)
    segments = build_segments(
        mesh.vertices,
        mesh.faces,
        fine[labels],
        tile_engine(options).index(mesh, units, scene),
        faces_region,
        SegmentOptions(
            min_faces=options.min_faces,
            max_faces=options.max_faces,
            max_extent_m=scene.max_extent_m,
            units=options.units,
        ),
        pairs=pairs,
        threads=threads,
    )
    # (2) Shape of the segments, sums of the regions' facts; sums of tiles add up to the scene's.
    ragged = raggedness(mesh.vertices, mesh.faces, segments, threads=threads)
    present, dense = np.unique(faces_region, return_inverse=True)
    totals = tile_totals(
        mesh.vertices,
        mesh.faces,
        mesh.colours,
        dense.astype(np.int32),
        len(present),
        attributes=mesh.attributes,
        pairs=pairs,
        roughness_scale_m=scene.roughness_scale_m,
        bins=slope_bins(region_count),
    )
    del pairs, dense
    # (3) Base faces under the segments; the whole base, as one may lie under several tiles.
    cover = tile_cover(
        base.vertices,
        base.faces,
        mesh.vertices,
        mesh.faces,
        segments.labels,
        tolerance_m=tolerance_m,
        threads=threads,
    )
    arrays: dict[str, AnyArray] = {
        "segments": segments.labels,
        "face_counts": segments.face_counts,
        "bounds": segments.bounds,
        "main_region": segments.main_region,
        "region_counts": segments.region_counts,
        "ragged": ragged,
        "cover_face": cover.base_face,
        "cover_segment": cover.segment,
        "present": present.astype(np.int32),
    }
    arrays |= {f"totals_{f.name}": getattr(totals, f.name) for f in fields(RegionTotals)}
    return Stored(
        arrays,
        {
            "exceptions": {
                f.name: getattr(segments.exceptions, f.name) for f in fields(SegmentExceptions)
            },
            "far_faces": cover.far_faces,
            "baseless_faces": cover.baseless_faces,
        },
    )


def totals_of(arrays: Mapping[str, AnyArray]) -> RegionTotals:
    """Rebuild a tile's region totals from its stored arrays."""
    return RegionTotals(
        **{f.name: np.asarray(arrays[f"totals_{f.name}"]) for f in fields(RegionTotals)}
    )
