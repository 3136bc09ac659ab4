"""From the tiles' own pieces to pieces of one surface: what is decided for all tiles together.

Four passes, each holding one tile at a time (:mod:`~terraport_pipeline.stages.tiles.joined_tile`):

1. the borders alone: vertices in walls become one, gaps are filled
   (:mod:`~terraport_pipeline.geometry.tiles.tile_weld`);
2. weak places: those that reach across walls are one, and stay or go as one (:func:`.forgive`);
3. every tile is cut and looked at: how large its loose pieces are, what its faces add to the
   normals of shared vertices, which edges along walls stay open (:func:`.settle`);
4. every tile is written.

A tile gets and gives what is shared by numbers of its own (:class:`TileJoin`), so what is computed
of it stays as it was when other tiles change. Numbers over all tiles are used here alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt
import xxhash

from terraport_payload.types import AnyArray, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.geometry.tiles.tile_weld import Seams
from terraport_pipeline.stages.contract import Facts, Form, Stored
from terraport_pipeline.stages.tiles.tile_arrays import TileArrays, listed_by_tile, split_by_tile

__all__ = ["JOIN_FORM", "NAME", "Join", "TileJoin"]

NAME: Final = "join"


@dataclass(frozen=True, slots=True, eq=False)
class TileJoin:
    """What the join says of one tile; its shared vertices are numbered 0 to K-1."""

    cells: Float64
    """(K, 3) positions, lattice cells: vertices of the tile's own, then those for its fillers."""
    ratio: Float32
    """(K,) support ratio."""
    colours: UInt8
    """(K, 3)"""
    attributes: tuple[Float32, ...]
    """(K,) each."""
    codes: tuple[int, ...]
    """Positions of attributes that hold codes."""
    rows: Int32
    """(R,) vertices of the tile that are shared: the first R of K."""
    fillers: Int32
    """(M, 3) triangles that the tile gets, of shared vertices."""
    rule: EdgeRule
    """Where the surface ends."""
    base_rule: EdgeRule
    """Where the surface ends that the base is thinned from: farther out, with fewer gaps."""

    def digest(self) -> str:
        """Hash of all of it, for the keys of what is computed with it."""
        rules = [_rule_values(rule) for rule in (self.rule, self.base_rule)]
        digest = xxhash.xxh3_128(repr((self.codes, rules)).encode())
        arrays: list[AnyArray] = [
            self.cells, self.ratio, self.colours, *self.attributes, self.rows, self.fillers,
            _field_of(self.rule), _field_of(self.base_rule),
        ]  # fmt: skip
        for array in arrays:
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
        return digest.hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class Join:
    """What the join says of all tiles; shared vertices are numbered 0 to G-1."""

    cells: Float64
    """(G, 3) shared vertices, lattice cells."""
    ratio: Float32
    """(G,) support ratio."""
    colours: UInt8
    """(G, 3)"""
    attributes: tuple[Float32, ...]
    """(G,) each."""
    codes: tuple[int, ...]
    """Positions of attributes that hold codes."""
    rows: tuple[Int32, ...]
    """Per tile: its shared vertices."""
    ids: tuple[Int64, ...]
    """Per tile: their ids, then those of vertices it gets for its fillers."""
    fillers: tuple[Int64, ...]
    """Per tile: (K, 3) ids."""
    rule: EdgeRule
    """Where the surface ends."""
    base_rule: EdgeRule
    """Where the surface ends that the base is thinned from: farther out, with fewer gaps."""
    facts: Facts
    solved: tuple[str, ...] = ()
    """Per tile: hash of the surface that was joined."""

    @classmethod
    def of(
        cls,
        seams: Seams,
        tiles: Sequence[TileArrays],
        names: int,
        codes: tuple[int, ...],
        rules: tuple[EdgeRule, EdgeRule],
        facts: Facts | None = None,
        solved: tuple[str, ...] = (),
        held: Mapping[int, TileJoin] = MappingProxyType({}),
    ) -> Self:
        """Take colours and attributes of shared vertices from their owners.

        Parameters
        ----------
        seams : Seams
        tiles : sequence of mapping
            Gives ``colours`` and ``attribute-<i>`` of every tile; only of owners is anything read.
        names : int
            Number of attributes.
        codes : tuple of int
            Those that hold codes.
        rules : pair of EdgeRule
            Of the surface, of the base.
        facts : Facts, optional
            What to tell of the seams.
        solved : tuple of str
            Per tile the hash of its surface.
        held : mapping of int to TileJoin, optional
            What an earlier join said of tiles; those of :attr:`.Seams.held` keep the values of
            their shared vertices.
        """
        count = len(seams.cells)
        colours = np.zeros((count, 3), np.uint8)
        attributes = tuple(np.zeros(count, np.float32) for _ in range(names))
        # Every shared vertex has one owner; all tiles take its values, so that they agree bit by
        # bit.
        for tile, arrays in enumerate(tiles):
            mine = np.flatnonzero(seams.owner_tile == tile)
            if not len(mine):
                continue
            rows = seams.owner_row[mine]
            colours[mine] = arrays["colours"][rows]
            for number, values in enumerate(attributes):
                values[mine] = arrays[f"attribute-{number}"][rows]
        for tile in sorted(seams.held, reverse=True):  # as in the weld: the lowest has its way
            ids = seams.tile_ids[tile]
            colours[ids] = held[tile].colours
            for values, earlier in zip(attributes, held[tile].attributes, strict=True):
                values[ids] = earlier
        return cls(
            seams.cells,
            seams.ratio,
            colours,
            attributes,
            codes,
            seams.tile_rows,
            seams.tile_ids,
            seams.fillers,
            *rules,
            facts or Facts(),
            solved,
        )

    @property
    def count(self) -> int:
        """Number of shared vertices G."""
        return len(self.cells)

    def tile(self, tile: int, low_m: Float64, high_m: Float64) -> TileJoin:
        """Give what concerns one tile.

        Parameters
        ----------
        tile : int
        low_m, high_m : ndarray of shape (3,)
            Box of its core, scene frame.
        """
        ids = self.ids[tile]
        order = np.argsort(ids)
        fillers = order[np.searchsorted(ids[order], self.fillers[tile])]
        return TileJoin(
            self.cells[ids],
            self.ratio[ids],
            self.colours[ids],
            tuple(values[ids] for values in self.attributes),
            self.codes,
            self.rows[tile],
            fillers.astype(np.int32).reshape(-1, 3),
            self.rule.within(low_m, high_m),
            self.base_rule.within(low_m, high_m),
        )


def _store_join(join: Join) -> Stored:
    # (1) Plain arrays and values, and the rules of both cuts.
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "cells": join.cells,
        "ratio": join.ratio,
        "colours": join.colours,
    }
    values: dict[str, Any] = {"attributes": len(join.attributes), "codes": list(join.codes)}
    values["solved"] = list(join.solved)
    for name, rule in (("rule", join.rule), ("base_rule", join.base_rule)):
        arrays[f"{name}-footprint"] = _field_of(rule)
        values[name] = _rule_values(rule)
    arrays |= {f"attribute-{i}": values for i, values in enumerate(join.attributes)}
    # (2) One list per tile, as one array with its starts.
    for name in ("rows", "ids", "fillers"):
        arrays |= listed_by_tile(name, getattr(join, name))
    return Stored(arrays, values)


def _restore_join(stored: Stored, facts: Facts) -> Join:
    arrays, values = stored.arrays, stored.values

    def rule(name: str) -> EdgeRule:
        record, outline = values[name], None
        if record["footprint"] is not None:
            x, z, cell_m, row, column = record["footprint"]
            field_m = np.asarray(arrays[f"{name}-footprint"], np.float32)
            outline = Footprint((x, z), cell_m, field_m, (row, column))
        threshold, largest, spacing_m, outward_m = record["numbers"]
        return EdgeRule(threshold, largest, spacing_m, outline, outward_m)

    return Join(
        np.asarray(arrays["cells"], np.float64),
        np.asarray(arrays["ratio"], np.float32),
        np.asarray(arrays["colours"], np.uint8),
        tuple(
            np.asarray(arrays[f"attribute-{i}"], np.float32) for i in range(values["attributes"])
        ),
        tuple(values["codes"]),
        split_by_tile(arrays, "rows"),
        split_by_tile(arrays, "ids"),
        split_by_tile(arrays, "fillers"),
        rule("rule"),
        rule("base_rule"),
        facts,
        tuple(values["solved"]),
    )


JOIN_FORM: Final[Form[Join]] = Form(_store_join, _restore_join, lambda join: join.facts)


def _rule_values(rule: EdgeRule) -> dict[str, Any]:
    outline = rule.footprint
    return {
        "numbers": [rule.threshold, rule.largest, rule.spacing_m, rule.outward_m],
        "footprint": None if outline is None else [*outline.low, outline.cell_m, *outline.first],
    }


def _field_of(rule: EdgeRule) -> Float32:
    return np.zeros((0, 0), np.float32) if rule.footprint is None else rule.footprint.field_m
