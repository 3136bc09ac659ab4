"""The engines that cut regions, over tiles: units within each, and regions of all units.

Borders and mean colours go by tiles. Every other engine needs the surface in one piece: it
gets that as the only tile, and a unit is a pool within one of its regions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Protocol

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.geometry.borders.border_segmenter import BorderCut, RegionsBefore
from terraport_pipeline.geometry.borders.cells import (
    CellGraph,
    cells_of_faces,
    joined_cells,
    length_steps,
)
from terraport_pipeline.geometry.regions.mean_scale import axis_index
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.tiles.tile_seams import Seams
from terraport_pipeline.geometry.tiles.tiled_means import (
    JoinedRegions,
    MeansScale,
    TileUnits,
    colours_of_faces,
    join_tiles,
    tile_units,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.regions import Options
from terraport_pipeline.stages.contract import Context, Json, Stored
from terraport_pipeline.stages.region_engine import (
    border_segmenter,
    is_closed,
    make_segmenter,
    segmenter_mesh,
)

__all__ = ["CELL_BYTES", "TileEngine", "tile_engine"]

CELL_BYTES: Final = 850
"""Of a cell of engine borders while all are united: 788 measured on the 4.7 million cells of a
quarry of 100 million points, their sums and contacts among them."""


class TileEngine(Protocol):
    """An engine as the passes over tiles use it."""

    def units(
        self,
        mesh: Mesh,
        pairs: tuple[Int32, Int32],
        seams: tuple[Int32, Float64],
        scale: MeansScale,
        context: Context,
    ) -> Stored:
        """Unite one tile's faces; ``labels`` says the unit of every face, (F,).

        `seams` are the tile's own: :meth:`.Seams.of`.

        Raises
        ------
        OptionError
            An attribute that cannot be compared; the shape diameter of an open surface.
        """
        ...

    def regions(
        self,
        tiles: Sequence[Stored],
        seams: Seams,
        scale: MeansScale,
        before: RegionsBefore | None,
        context: Context,
    ) -> tuple[JoinedRegions, Mapping[str, Json]]:
        """Unite the units of all tiles to regions, and tell of it.

        `before` are samples of the version before, in the same frame; an engine need not heed it.
        """
        ...

    def index(self, mesh: Mesh, units: Stored, scale: MeansScale) -> Float32:
        """Say by which number of every face, (F,), pools are merged to segments."""
        ...


def tile_engine(options: Options) -> TileEngine:
    """Choose the engine that a build asks for."""
    if options.in_one_piece:
        return _InOnePiece(options)
    return _Borders(options) if options.engine == "borders" else _Means()


@dataclass(frozen=True, slots=True)
class _Borders:
    """Borders: a tile's units are its cells; what two tiles have of one cell is added up."""

    options: Options

    def units(
        self,
        mesh: Mesh,
        pairs: tuple[Int32, Int32],
        _seams: tuple[Int32, Float64],
        _scale: MeansScale,
        _context: Context,
    ) -> Stored:
        lab = colours_of_faces(mesh.colours, mesh.faces)
        cell_m = border_segmenter(self.options).cell_m
        cells = cells_of_faces(mesh.vertices, mesh.faces, lab, pairs, cell_m)
        return Stored({field.name: getattr(cells, field.name) for field in fields(cells)}, {})

    def regions(
        self,
        tiles: Sequence[Stored],
        seams: Seams,
        _scale: MeansScale,
        before: RegionsBefore | None,
        _context: Context,
    ) -> tuple[JoinedRegions, Mapping[str, Json]]:
        # (1) Cells of all tiles; labels of faces are looked at where they are at seams.
        at_seams = _units_at_seams(tiles, seams)
        graphs = [
            CellGraph(
                np.zeros(0, np.int32),
                *(np.array(tile.arrays[name]) for name in ("keys", "sums", "pairs", "border")),
            )
            for tile in tiles
        ]
        starts = np.cumsum([0, *(graph.count for graph in graphs)])[:-1]
        cells, of_tile = joined_cells(
            graphs, at_seams + starts[seams.tiles], length_steps(seams.length_m)
        )
        del graphs
        # (2) Regions, numbered by first cell in order of the tiles, hence by first face.
        cut = border_segmenter(self.options).cut(cells, before)
        every = np.concatenate(of_tile)
        region, count = number_by_first(cut.regions[every])
        ends = np.cumsum([len(of_cells) for of_cells in of_tile])[:-1]
        joined = JoinedRegions(
            tuple(np.split(region, ends)),
            tuple(cut.seeds[of_cells] for of_cells in of_tile),
            count,
            cut.tree.leaf_count,
            cut.before_joining,
            0,
            *_renumbered(cut, region, every, count),
        )
        return joined, {
            "region_size_m": border_segmenter(self.options).region_size_m,
            "region_cells": cells.count,
            "region_seeds": cut.tree.leaf_count,
            "region_pools": cut.before_joining,
        }

    def index(self, mesh: Mesh, _: Stored, scale: MeansScale) -> Float32:
        return _place_on_axis(mesh, scale)


def _renumbered(cut: BorderCut, region: Int32, cell: Int32, count: int) -> tuple[Int32, Float64]:
    """Give the unions of a cut the numbers that its regions have over all tiles."""
    number = np.arange(count + len(cut.unions), dtype=np.int32)
    number[cut.regions[cell]] = region
    return np.sort(number[cut.unions], axis=1), cut.union_costs


def _place_on_axis(mesh: Mesh, scale: MeansScale) -> Float32:
    """Place of every face's colour on the scene's main axis of colour."""
    colours = colours_of_faces(mesh.colours, mesh.faces)
    return axis_index(colours, scale.totals, scale.segmenter.weights())


def _units_at_seams(tiles: Sequence[Stored], seams: Seams) -> Int32:
    """Units on both sides of every seam, numbered within their tiles, (S, 2)."""
    at_seams = np.zeros(seams.faces.shape, np.int32)
    for number, tile in enumerate(tiles):
        labels = tile.arrays["labels"]
        for side in (0, 1):
            rows = np.flatnonzero(seams.tiles[:, side] == number)
            at_seams[rows, side] = labels[seams.faces[rows, side]]
    return at_seams


class _Means:
    """Mean colours: pools within tiles, but for faces near other tiles; see `tiled_means.py`."""

    def units(
        self,
        mesh: Mesh,
        pairs: tuple[Int32, Int32],
        seams: tuple[Int32, Float64],
        scale: MeansScale,
        _: Context,
    ) -> Stored:
        united = tile_units(mesh.vertices, mesh.faces, mesh.colours, pairs, seams, scale)
        arrays = {
            field.name: getattr(united, field.name)
            for field in fields(united)
            if field.name != "edge_steps"
        }
        return Stored(arrays, {"edge_steps": list(united.edge_steps)})

    def regions(
        self,
        tiles: Sequence[Stored],
        seams: Seams,
        scale: MeansScale,
        _before: RegionsBefore | None,
        context: Context,
    ) -> tuple[JoinedRegions, Mapping[str, Json]]:
        at_seams = _units_at_seams(tiles, seams)
        units_of_tile = []
        for tile in tiles:
            arrays: dict[str, Any] = {
                field.name: np.array(tile.arrays[field.name])
                for field in fields(TileUnits)
                if field.name not in ("labels", "edge_steps")
            }
            arrays["labels"] = np.zeros(0, np.int32)
            one, other = tile.values["edge_steps"]
            units_of_tile.append(TileUnits(**arrays, edge_steps=(int(one), int(other))))
        joined = join_tiles(units_of_tile, at_seams, seams, scale, threads=context.threads)
        return joined, {
            "region_limit": scale.limit,
            "region_pools": joined.pools,
            "region_islands": joined.islands,
        }

    def index(self, mesh: Mesh, _: Stored, scale: MeansScale) -> Float32:
        return _place_on_axis(mesh, scale)


@dataclass(frozen=True, slots=True)
class _InOnePiece:
    """An engine that sees the whole surface, which is the only tile."""

    options: Options

    def units(
        self,
        mesh: Mesh,
        pairs: tuple[Int32, Int32],
        _seams: tuple[Int32, Float64],
        _scale: MeansScale,
        context: Context,
    ) -> Stored:
        segmenter = make_segmenter(
            self.options,
            is_closed_body=is_closed(mesh.vertices, mesh.faces),
            threads=context.threads,
        )
        segmentation = segmenter.segment(
            segmenter_mesh(mesh, pairs, self.options, threads=context.threads)
        )
        count = segmentation.region_count
        keys = segmentation.fine.astype(np.int64) * count + segmentation.regions
        unique, labels = np.unique(keys, return_inverse=True)
        fine, region = np.divmod(unique, count)
        return Stored(
            {
                "labels": labels.astype(np.int32),
                "fine": fine.astype(np.int32),
                "region": region.astype(np.int32),
                "similarity": segmentation.similarity,
            },
            {
                "regions": count,
                "pools": segmentation.fine_count,
                "facts": dict(segmentation.facts),
            },
        )

    def regions(
        self,
        tiles: Sequence[Stored],
        _seams: Seams,
        _scale: MeansScale,
        _before: RegionsBefore | None,
        _context: Context,
    ) -> tuple[JoinedRegions, Mapping[str, Json]]:
        (whole,) = tiles
        count, pools = int(whole.values["regions"]), int(whole.values["pools"])
        region, fine = (np.array(whole.arrays[name]) for name in ("region", "fine"))
        return JoinedRegions((region,), (fine,), count, pools, pools, 0), whole.values["facts"]

    def index(self, _mesh: Mesh, units: Stored, _scale: MeansScale) -> Float32:
        return np.array(units.arrays["similarity"])
