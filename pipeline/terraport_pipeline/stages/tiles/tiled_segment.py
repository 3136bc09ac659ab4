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
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Float32, Float64, Int32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import (
    extent_of_area,
    longest_edge,
    surface_area,
)
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals, axis_index
from terraport_pipeline.geometry.regions.region_roughness import automatic_roughness_scale
from terraport_pipeline.geometry.regions.region_totals import RegionTotals, slope_bins, tile_totals
from terraport_pipeline.geometry.segments.segment_shapes import raggedness
from terraport_pipeline.geometry.segments.segments import (
    SegmentExceptions,
    SegmentOptions,
    build_segments,
)
from terraport_pipeline.geometry.tiles.tile_seams import OpenEdges, Seams, match_seams, open_edges
from terraport_pipeline.geometry.tiles.tiled_cover import tile_cover
from terraport_pipeline.geometry.tiles.tiled_means import (
    JoinedRegions,
    MeansScale,
    TileUnits,
    colours_of_faces,
    join_tiles,
    tile_units,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context, Facts, Form, Json, Stored
from terraport_pipeline.stages.region_engine import (
    make_segmenter,
    means_segmenter,
    segmenter_mesh,
)
from terraport_pipeline.stages.segment import MAX_REGIONS, Options

__all__ = [
    "CUT_BYTES_PER_FACE",
    "MEASURE_BYTES_PER_FACE",
    "REGIONS_FORM",
    "UNITS_BYTES_PER_FACE",
    "AttributeRange",
    "Regions",
    "TiledScene",
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


@dataclass(frozen=True, slots=True)
class AttributeRange:
    """Least and largest value of one attribute, NaN left out, and whether all are whole."""

    low: float
    high: float
    """Below ``low`` where there is no value at all."""
    fraction: float | None
    """Some value that is no whole number; None when all are."""

    @classmethod
    def of(cls, values: Float32) -> AttributeRange:
        """Measure the range of one mesh's values."""
        valid = values[~np.isnan(values)]
        if not len(valid):
            return cls(1.0, 0.0, None)
        broken = valid[valid != np.rint(valid)]
        fraction = float(broken.min()) if len(broken) else None
        return cls(float(valid.min()), float(valid.max()), fraction)

    def plus(self, other: AttributeRange) -> AttributeRange:
        """Unite it with the range of another piece of the surface."""
        if self.high < self.low:
            return other
        if other.high < other.low:
            return self
        fractions = [f for f in (self.fraction, other.fraction) if f is not None]
        return AttributeRange(
            min(self.low, other.low), max(self.high, other.high), min(fractions, default=None)
        )

    def values(self) -> Float32:
        """Values that stand for all in the choice of a scale."""
        if self.high < self.low:
            return np.full(1, np.nan, np.float32)
        some = [self.low, self.high] + ([] if self.fraction is None else [self.fraction])
        return np.array(some, np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class TiledScene:
    """Sums and bounds over all tiles that the passes need before they start."""

    faces: tuple[int, ...]
    """Number of faces of every tile."""
    vertices: int
    area_m2: float
    low: Float64
    """(3,) least x, y, z."""
    high: Float64
    """(3,)"""
    totals: ColourTotals
    longest_m: float
    seams: Seams
    attributes: dict[str, AttributeRange]

    @property
    def face_count(self) -> int:
        """Number of faces of the detail over all tiles."""
        return sum(self.faces)

    def scale(self, options: Options) -> MeansScale:
        """Make what the units of every tile are made by."""
        segmenter = means_segmenter(options)
        return MeansScale(segmenter, self.totals, self.longest_m)

    def max_extent_m(self, options: Options) -> float:
        """Longest side of a segment's box: as asked for, or chosen by the density of faces."""
        widest = float((self.high - self.low).max())
        return options.max_extent_m or extent_of_area(
            self.area_m2, self.face_count, widest, options.max_faces
        )

    @property
    def roughness_scale_m(self) -> float:
        """Width of the cubes that roughness is measured in."""
        return automatic_roughness_scale(
            self.area_m2, self.face_count, float((self.high - self.low).max())
        )


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
    return TiledScene(
        tuple(int(value["faces"]) for value in values),
        sum(int(value["vertices"]) for value in values),
        float(sum(value["area_m2"] for value in values)),
        np.min([value["low"] for value in values], axis=0),
        np.max([value["high"] for value in values], axis=0),
        totals,
        max(*(value["longest_m"] for value in values), float(seams.length_m.max(initial=0.0))),
        seams,
        attributes,
    )


def units(mesh: Mesh, tile: int, scene: TiledScene, options: Options, context: Context) -> Stored:
    """Unite one tile's faces up to the fine pools.

    Raises
    ------
    OptionError
        An attribute that cannot be compared; the shape diameter of an open surface.
    """
    pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=context.threads)
    if options.in_one_piece:
        return _units_of_whole(mesh, pairs, options, context)
    united = tile_units(
        mesh.vertices,
        mesh.faces,
        mesh.colours,
        pairs,
        scene.seams.of(tile),
        scene.scale(options),
    )
    arrays = {
        field.name: getattr(united, field.name)
        for field in fields(united)
        if field.name != "edge_steps"
    }
    return Stored(arrays, {"edge_steps": list(united.edge_steps)})


def _units_of_whole(
    mesh: Mesh, pairs: tuple[Int32, Int32], options: Options, context: Context
) -> Stored:
    """Let an engine that needs the whole surface make its regions; a unit is a pool in a region."""
    segmenter = make_segmenter(options, threads=context.threads)
    segmentation = segmenter.segment(segmenter_mesh(mesh, pairs, options, threads=context.threads))
    keys = segmentation.fine.astype(np.int64) * segmentation.region_count + segmentation.regions
    unique, labels = np.unique(keys, return_inverse=True)
    fine, region = np.divmod(unique, segmentation.region_count)
    return Stored(
        {
            "labels": labels.astype(np.int32),
            "fine": fine.astype(np.int32),
            "region": region.astype(np.int32),
            "similarity": segmentation.similarity,
        },
        {
            "regions": segmentation.region_count,
            "pools": segmentation.fine_count,
            "facts": dict(segmentation.facts),
        },
    )


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
    if options.in_one_piece:
        (whole,) = tiles
        count, pools = int(whole.values["regions"]), int(whole.values["pools"])
        joined = JoinedRegions(
            (np.asarray(whole.arrays["region"]),), (np.asarray(whole.arrays["fine"]),),
            count, pools, pools, 0,
        )  # fmt: skip
        facts: dict[str, Json] = whole.values["facts"]
    else:
        joined = _joined(tiles, scene, options, context)
        facts = {
            "region_limit": scene.scale(options).limit,
            "region_pools": joined.pools,
            "region_islands": joined.islands,
        }
    if joined.count > MAX_REGIONS:
        raise OptionError(
            f"{joined.count} regions; at most {MAX_REGIONS} can be told apart at run time: raise "
            "--small-region-share, or change the engine's own threshold (terraport build --help)"
        )
    context.progress.done({"regions": joined.count})
    return Regions(joined, facts)


def _joined(
    tiles: Sequence[Stored], scene: TiledScene, options: Options, context: Context
) -> JoinedRegions:
    """Unite the units of tiles by mean colour."""
    seams = scene.seams
    at_seams = np.zeros(seams.faces.shape, np.int32)
    units_of_tile = []
    for number, tile in enumerate(tiles):
        labels = tile.arrays["labels"]
        for side in (0, 1):
            rows = np.flatnonzero(seams.tiles[:, side] == number)
            at_seams[rows, side] = labels[seams.faces[rows, side]]
        arrays: dict[str, Any] = {
            name: np.array(a) for name, a in tile.arrays.items() if name != "labels"
        }
        arrays["labels"] = np.zeros(0, np.int32)
        one, other = tile.values["edge_steps"]
        units_of_tile.append(TileUnits(**arrays, edge_steps=(int(one), int(other))))
    return join_tiles(units_of_tile, at_seams, seams, scene.scale(options), threads=context.threads)


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
        np.array(units.arrays["similarity"])
        if options.in_one_piece
        else _index_of_faces(mesh, scene, options),
        faces_region,
        SegmentOptions(
            min_faces=options.min_faces,
            max_faces=options.max_faces,
            max_extent_m=scene.max_extent_m(options),
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


def _index_of_faces(mesh: Mesh, scene: TiledScene, options: Options) -> Float32:
    """Index by which pools are merged to segments: the colour's place on the scene's main axis."""
    weight = scene.scale(options).segmenter.weights()
    return axis_index(colours_of_faces(mesh.colours, mesh.faces), scene.totals, weight)
