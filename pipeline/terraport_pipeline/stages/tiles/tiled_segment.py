"""Segment, tile by tile: regions over all tiles, segments within each, one cover, one set of facts.

Seven steps, of which the second and the fifth are the long ones:

1. :func:`measure` every tile; :func:`scene_of` adds up what the whole scene must know, and
   ``scene_facts.py`` decides what tiles are measured by;
2. :func:`units` of every tile: fine pools, with their borders. An engine that needs the surface in
   one piece gets it as the only tile, and its regions are the units;
3. :func:`regions`: the units of all tiles united to regions, across the tiles' borders;
4. ``region_numbers.py``: regions of tiles that did not change stay what they were;
5. :func:`cut` every tile into segments, sum up its regions' facts;
6. ``base_cover.py``: the base faces under each tile's segments;
7. ``tiled_join.py``: segments numbered along one curve, covers and sums united.

Nothing here holds more than one tile. Memory: about 350 bytes per face of a tile in steps 2 and 5;
100 in step 1; what the others hold of the whole scene is small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
import xxhash

from terraport_payload.types import AnyArray, Float64, Int32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.borders.border_segmenter import RegionsBefore
from terraport_pipeline.geometry.cover.far_detail import median_edge
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import (
    longest_edge,
    surface_area,
)
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.mesh.surface_samples import surface_samples
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.region_totals import RegionTotals, tile_totals
from terraport_pipeline.geometry.segments.segment_shapes import raggedness
from terraport_pipeline.geometry.segments.segments import (
    SegmentExceptions,
    SegmentOptions,
    build_segments,
)
from terraport_pipeline.geometry.tiles.tile_seams import (
    OpenEdges,
    Seams,
    match_seams,
    open_edges,
)
from terraport_pipeline.geometry.tiles.tiled_means import (
    JoinedRegions,
    MeansScale,
    colours_of_faces,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.regions import MAX_REGIONS, Options
from terraport_pipeline.stages.contract import Context, Facts, Form, Json, Stored
from terraport_pipeline.stages.region_engine import means_segmenter, sized
from terraport_pipeline.stages.tiles.scene_facts import AttributeRange, SceneScale, TiledScene
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

_SAMPLES: Final = 2**16
"""Faces of a tile that the next survey's regions are matched by, and one of every unit: in a tile
of 2.5 million faces a region of a thousandth of it has 65."""


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
            "median_edge_m": median_edge(
                as_kernel_input(mesh.vertices, np.float64), as_kernel_input(mesh.faces, np.int32)
            ),
            "attributes": {n: [r.low, r.high, r.fraction] for n, r in ranges.items()},
        },
    )


def scene_of(tiles: Sequence[Stored]) -> TiledScene:
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
    longest_m = max(
        *(value["longest_m"] for value in values), float(seams.length_m.max(initial=0.0))
    )
    return TiledScene(
        tuple(int(value["faces"]) for value in values),
        sum(int(value["vertices"]) for value in values),
        float(sum(value["area_m2"] for value in values)),
        np.min([value["low"] for value in values], axis=0),
        np.max([value["high"] for value in values], axis=0),
        seams,
        attributes,
        totals,
        longest_m,
        tuple(float(value["median_edge_m"]) for value in values),
    )


def units(
    mesh: Mesh,
    seams: tuple[Int32, Float64],
    scale: SceneScale,
    options: Options,
    context: Context,
) -> Stored:
    """Unite one tile's faces up to the fine pools; see :meth:`.TileEngine.units`.

    With samples of its surface, by which ``region_numbers.py`` matches regions of two surveys:
    ``sample_point`` (N, 3), ``sample_unit``, ``sample_area``.
    """
    pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=context.threads)
    engine = tile_engine(sized(options, scale.width_m))
    united = engine.units(mesh, pairs, seams, _means_scale(scale, options), context)
    samples = surface_samples(
        mesh.vertices,
        mesh.faces,
        united.arrays["labels"].astype(np.int32, copy=False),
        faces_per_sample=-(-len(mesh.faces) // _SAMPLES),
        at_least=1,
    )
    sampled: dict[str, AnyArray] = {
        "sample_point": samples.points.astype(np.float32),
        "sample_unit": samples.labels,
        "sample_area": samples.areas.astype(np.float32),
    }
    return Stored({**united.arrays, **sampled}, united.values)


def _means_scale(scale: SceneScale, options: Options) -> MeansScale:
    return MeansScale(means_segmenter(options), scale.colours, scale.longest_m)


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
            "unions": result.joined.unions,
            "union_costs": result.joined.union_costs,
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
        replace(
            JoinedRegions(
                tuple(np.split(stored.arrays["region"], stored.arrays["starts"])),
                tuple(np.split(stored.arrays["fine"], stored.arrays["starts"])),
                *stored.values["numbers"],
            ),
            unions=np.asarray(stored.arrays["unions"], np.int32),
            union_costs=np.asarray(stored.arrays["union_costs"], np.float64),
        ),
        stored.values["facts"],
    ),
    facts=lambda result: Facts({"regions": result.joined.count}),
)


def regions(
    tiles: Sequence[Stored],
    seams: Seams,
    scale: SceneScale,
    options: Options,
    context: Context,
    *,
    before: Stored | None = None,
) -> Regions:
    """Unite the units of all tiles to regions.

    Parameters
    ----------
    tiles : sequence of Stored
        From :func:`units`; only the labels of faces at seams are looked at, so they may be mapped.
    seams : Seams
        Of all tiles.
    scale : SceneScale
    options : Options
    context : Context
    before : Stored, optional
        What ``numbered_regions.samples_of`` left of the survey before, in the same frame: evidence
        for borders.

    Raises
    ------
    OptionError
        More regions than can be told apart at run time.
    """
    context.progress.start("segment: regions across tiles", None, "units")
    stood = None
    if before is not None:
        stood = RegionsBefore(
            np.array(before.arrays["point"], np.float64),
            np.array(before.arrays["region"], np.int32),
        )
    joined, facts = tile_engine(sized(options, scale.width_m)).regions(
        tiles, seams, _means_scale(scale, options), stood, context
    )
    if joined.count > MAX_REGIONS:
        raise OptionError(
            f"{joined.count} regions; at most {MAX_REGIONS} can be told apart at run time: raise "
            "--region-size or --small-region-share, or change the engine's own threshold "
            "(terraport build --help)"
        )
    context.progress.done({"regions": joined.count})
    return Regions(joined, dict(facts))


def cut(
    mesh: Mesh,
    units: Stored,
    of_unit: tuple[Int32, Int32],
    scale: SceneScale,
    options: Options,
    context: Context,
    *,
    bins: int,
) -> Stored:
    """Cut one tile into segments and sum up its regions' facts.

    Parameters
    ----------
    mesh : Mesh
        The tile.
    units : Stored
        From :func:`units`.
    of_unit : pair of ndarray of shape (U,), int32
        Fine pool and region of every unit.
    scale : SceneScale
    options : Options
    context : Context
    bins : int
        ``slope_bins`` of the scene.

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
        tile_engine(options).index(mesh, units, _means_scale(scale, options)),
        faces_region,
        SegmentOptions(
            min_faces=options.min_faces,
            max_faces=options.max_faces,
            max_extent_m=scale.max_extent_m,
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
        roughness_scale_m=scale.roughness_scale_m,
        bins=bins,
    )
    arrays: dict[str, AnyArray] = {
        "segments": segments.labels,
        "face_counts": segments.face_counts,
        "bounds": segments.bounds,
        "main_region": segments.main_region,
        "region_counts": segments.region_counts,
        "ragged": ragged,
        "present": present.astype(np.int32),
    }
    arrays |= {f"totals_{f.name}": getattr(totals, f.name) for f in fields(RegionTotals)}
    return Stored(
        arrays,
        {
            "exceptions": {
                f.name: getattr(segments.exceptions, f.name) for f in fields(SegmentExceptions)
            },
            "segments_xxh3": xxhash.xxh3_128_hexdigest(np.ascontiguousarray(segments.labels).data),
        },
    )


def totals_of(arrays: Mapping[str, AnyArray]) -> RegionTotals:
    """Rebuild a tile's region totals from its stored arrays."""
    return RegionTotals(
        **{f.name: np.asarray(arrays[f"totals_{f.name}"]) for f in fields(RegionTotals)}
    )
