"""From the tiles' own pieces to pieces of one surface: what is decided for all tiles together.

Four passes, each holding one tile at a time (:mod:`~terraport_pipeline.stages.tiles.joined_tile`):

1. the borders alone: vertices in walls become one, gaps are filled
   (:mod:`~terraport_pipeline.geometry.tiles.tile_weld`);
2. weak places: those that reach across walls are one, and stay or go as one (:func:`forgive`);
3. every tile is cut and looked at: how large its loose pieces are, what its faces add to the
   normals of shared vertices, which edges along walls stay open (:func:`settle`);
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
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from terraport_payload.types import AnyArray, Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.geometry.mesh.vertex_normals import unit_normals
from terraport_pipeline.geometry.tiles.tile_weld import Seams
from terraport_pipeline.stages.contract import Facts, Form, Stored

__all__ = [
    "JOIN_FORM",
    "NAME",
    "SETTLED_FORM",
    "Forgiven",
    "Join",
    "Look",
    "Settled",
    "SettledTile",
    "TileArrays",
    "TileJoin",
    "Weak",
    "forgive",
    "settle",
]

NAME: Final = "join"

TileArrays = Mapping[str, AnyArray]
"""What is kept of a tile, by name."""

_CRACK_CELLS: Final = 1.0
"""Open edges of two tiles this near to each other are a crack, not two rims."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Weak:
    """Connected faces of little support in a tile, and whether they reach its walls."""

    farthest: Float32
    """(W,) largest support ratio in each."""
    touch: Int64
    """(K, 2) (weak place, shared vertex of the tile) where one is in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Forgiven:
    """Which weak places of a tile stay, (W,) each."""

    detail: Bool
    base: Bool

    def digest(self) -> str:
        """Hash of both."""
        return xxhash.xxh3_128_hexdigest(np.concatenate([self.detail, self.base]).tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Facts of a tile as it will be after the join, from which all tiles settle what stays."""

    sizes: Int64
    """(P,) faces of each of its loose pieces."""
    piece: Int64
    """(S,) piece of each shared vertex that the cut left or made."""
    ends: Int64
    """(S, 2) its two ends, shared vertices of the tile: twice itself, or those of the edge that the
    cut made it on."""
    sums: Float64
    """(S, 3) what the tile's faces add to its normal."""
    edges: Int64
    """(E, 2, 2) open edges along walls: two vertices, each by its two ends; both ends are one
    negative number for a vertex that is not shared."""
    middles: Float64
    """(E, 3) their middles, cells."""

    def stored(self) -> Stored:
        """Turn it into arrays."""
        return Stored({name: getattr(self, name) for name in self.__dataclass_fields__}, {})

    @classmethod
    def of(cls, stored: Stored) -> Self:
        """Turn arrays back; they may be mapped."""
        return cls(**{name: np.array(stored.arrays[name]) for name in cls.__dataclass_fields__})


@dataclass(frozen=True, slots=True, eq=False)
class SettledTile:
    """What all tiles settled for one."""

    normals: Float32
    """(S, 3) unit normals of its shared vertices, as :class:`Look` lists them."""
    dropped: Int64
    """Loose pieces that go."""

    def digest(self) -> str:
        """Hash of both."""
        digest = xxhash.xxh3_128(self.normals.tobytes())
        digest.update(self.dropped.tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """Decisions over all tiles: shared normals, and which pieces are islands."""

    ids: tuple[Int64, ...]
    """Per tile: numbers over all tiles of its shared vertices, as :class:`Look` lists them; those
    that the cut made follow the join's."""
    tiles: tuple[SettledTile, ...]
    count: int
    """Number of shared vertices over all tiles, those that the cut made among them."""
    islands: int
    """Pieces of the whole surface that go."""
    seam_edges: int
    """Edges along walls that two tiles share."""
    cracks: int
    """Edges along walls that are open on both sides within a cell: must be 0."""
    rims: int
    """Other open edges along walls: the surface ends there."""
    looks: tuple[str, ...] = ()
    """Per tile: hash of its :class:`Look`."""


def forgive(join: Join, weak: Sequence[Weak]) -> tuple[Forgiven, ...]:
    """Decide which weak places stay: those that, over all tiles, nowhere pass the largest ratio."""
    touch = [
        np.stack([each.touch[:, 0], ids[each.touch[:, 1]]], axis=1)
        for each, ids in zip(weak, join.ids, strict=True)
    ]
    label, _ = _over_tiles([len(each.farthest) for each in weak], touch, join.count)
    farthest = np.concatenate([np.zeros(0, np.float32), *(each.farthest for each in weak)])
    worst = np.zeros(int(label.max(initial=-1)) + 1, dtype=np.float32)
    np.maximum.at(worst, label, farthest)
    ends = np.cumsum([len(each.farthest) for each in weak])[:-1]
    stays, base_stays = (worst[label] <= rule.largest for rule in (join.rule, join.base_rule))
    return tuple(
        Forgiven(detail, base)
        for detail, base in zip(np.split(stays, ends), np.split(base_stays, ends), strict=True)
    )


def settle(
    join: Join,
    looks: Sequence[Look],
    *,
    min_faces: int,
    digests: tuple[str, ...] = (),
    held: Mapping[int, SettledTile] = MappingProxyType({}),
) -> Settled:
    """Decide what is left to decide.

    Parameters
    ----------
    join : Join
    looks : sequence of Look
        Of every tile.
    min_faces : int
        Pieces of the joined surface with fewer faces go; the largest stays.
    digests : tuple of str
        Hashes of the looks.
    held : mapping of int to SettledTile, optional
        What was settled earlier for tiles whose looks are as they were: their normals stay.
    """
    # (1) Numbers over all tiles of the vertices that the cut left, and of those that it made.
    named = [np.sort(ids[look.ends], axis=1) for look, ids in zip(looks, join.ids, strict=True)]
    every = np.concatenate([np.zeros((0, 2), np.int64), *named])
    pairs = np.unique(every[every[:, 0] != every[:, 1]], axis=0)
    ids = [_cut_ids(each, pairs, join.count) for each in named]
    count = join.count + len(pairs)
    # (2) Loose pieces over all tiles.
    touch = [np.stack([look.piece, own], axis=1) for look, own in zip(looks, ids, strict=True)]
    label, starts = _over_tiles([len(each.sizes) for each in looks], touch, count)
    sizes = np.concatenate([np.zeros(0, np.int64), *(each.sizes for each in looks)])
    whole = np.bincount(label, sizes, minlength=1)
    large = whole >= min_faces
    large[int(whole.argmax())] = True
    goes = ~large[label]
    # (3) Normals: what faces of all tiles add up to.
    total = np.zeros((count, 3))
    for each, own in zip(looks, ids, strict=True):
        np.add.at(total, own, each.sums)
    normals = unit_normals(total)
    for tile in sorted(held, reverse=True):  # the lowest last: it has its way
        normals[ids[tile]] = held[tile].normals
    tiles = tuple(
        SettledTile(
            normals[own],
            np.flatnonzero(goes[starts[tile] : starts[tile + 1]]).astype(np.int64),
        )
        for tile, own in enumerate(ids)
    )
    islands = int(((whole > 0) & ~large).sum())
    return Settled(tuple(ids), tiles, count, islands, *_count_open(looks, join.ids), digests)


def _cut_ids(pairs: Int64, cut_pairs: Int64, count: int) -> Int64:
    """Ids of shared vertices (S,) by their ends (S, 2); those of `cut_pairs` follow `count`."""
    ids = pairs[:, 0].copy()
    cut = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
    if len(cut):
        span = int(cut_pairs.max()) + 1
        key, cut_keys = pairs[cut] @ [span, 1], cut_pairs @ [span, 1]
        ids[cut] = count + np.searchsorted(cut_keys, key)
    return ids


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
        arrays |= _listed(name, getattr(join, name))
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
        _split(arrays, "rows"),
        _split(arrays, "ids"),
        _split(arrays, "fillers"),
        rule("rule"),
        rule("base_rule"),
        facts,
        tuple(values["solved"]),
    )


JOIN_FORM: Final[Form[Join]] = Form(_store_join, _restore_join, lambda join: join.facts)


def _store_settled(settled: Settled) -> Stored:
    return Stored(
        {
            **_listed("ids", settled.ids),
            **_listed("normals", [tile.normals for tile in settled.tiles]),
            **_listed("dropped", [tile.dropped for tile in settled.tiles]),
        },
        {
            "numbers": [
                settled.count, settled.islands, settled.seam_edges, settled.cracks, settled.rims,
            ],
            "looks": list(settled.looks),
        },
    )  # fmt: skip


def _restore_settled(stored: Stored, _facts: Facts) -> Settled:
    arrays = stored.arrays
    tiles = zip(_split(arrays, "normals"), _split(arrays, "dropped"), strict=True)
    count, islands, seam_edges, cracks, rims = stored.values["numbers"]
    return Settled(
        _split(arrays, "ids"),
        tuple(SettledTile(normals, dropped) for normals, dropped in tiles),
        count,
        islands,
        seam_edges,
        cracks,
        rims,
        tuple(stored.values["looks"]),
    )


def _settled_facts(settled: Settled) -> Facts:
    warnings: list[str] = []
    if settled.cracks:
        warnings.append(
            f"{settled.cracks} edges between tiles stay open; look at the seams in the report, "
            "and build with a larger --tile-depth if they show"
        )
    counts = {
        "seam_edges": settled.seam_edges,
        "seam_cracks": settled.cracks,
        "seam_rims": settled.rims,
        "islands_dropped": settled.islands,
    }
    return Facts(counts, tuple(warnings))


SETTLED_FORM: Final[Form[Settled]] = Form(_store_settled, _restore_settled, _settled_facts)


def _listed(name: str, per_tile: Sequence[AnyArray]) -> dict[str, AnyArray]:
    """One list per tile as one array with its starts."""
    return {
        name: np.concatenate(per_tile),
        f"{name}-starts": np.cumsum([0, *(len(rows) for rows in per_tile)]),
    }


def _split(arrays: TileArrays, name: str) -> tuple[Any, ...]:
    return tuple(np.split(np.array(arrays[name]), arrays[f"{name}-starts"][1:-1]))


def _rule_values(rule: EdgeRule) -> dict[str, Any]:
    outline = rule.footprint
    return {
        "numbers": [rule.threshold, rule.largest, rule.spacing_m, rule.outward_m],
        "footprint": None if outline is None else [*outline.low, outline.cell_m, *outline.first],
    }


def _field_of(rule: EdgeRule) -> Float32:
    return np.zeros((0, 0), np.float32) if rule.footprint is None else rule.footprint.field_m


def _over_tiles(counts: Sequence[int], touch: Sequence[Int64], shared: int) -> tuple[Int64, Int64]:
    """Join parts of tiles that have a shared vertex in common.

    Parameters
    ----------
    counts : sequence of int
        Parts of every tile.
    touch : sequence of ndarray of shape (K, 2), int64
        Per tile: (part, id).
    shared : int
        Number of ids.

    Returns
    -------
    label : ndarray, int64
        Of every part over all tiles.
    starts : ndarray of shape (T + 1,), int64
        Where each tile's parts begin.
    """
    starts = np.cumsum([0, *counts])
    nodes = int(starts[-1])
    numbered = [
        each + np.array([start, nodes]) for each, start in zip(touch, starts[:-1], strict=True)
    ]
    links = np.concatenate([np.zeros((0, 2), np.int64), *numbered])
    graph = coo_matrix(
        (np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), shape=(nodes + shared,) * 2
    )
    if not nodes:
        return np.zeros(0, np.int64), starts
    _, label = connected_components(graph, directed=False)
    return label[:nodes].astype(np.int64), starts


def _count_open(looks: Sequence[Look], ids: Sequence[Int64]) -> tuple[int, int, int]:
    """Count edges that two tiles share, cracks, rims."""
    tile = np.repeat(np.arange(len(looks)), [len(each.edges) for each in looks])
    named = []
    for look, own in zip(looks, ids, strict=True):
        # Vertices that are not shared keep their negative number: no other edge has them.
        numbers = look.edges.copy()
        numbers[look.edges >= 0] = own[look.edges[look.edges >= 0]]
        named.append(np.sort(numbers, axis=2))
    edges = np.concatenate([np.zeros((0, 2, 2), np.int64), *named])
    middles = np.concatenate([np.zeros((0, 3)), *(each.middles for each in looks)])
    if not len(edges):
        return 0, 0, 0
    shared = (edges >= 0).all(axis=(1, 2))
    _, vertex = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 2)
    _, which = np.unique(np.sort(vertex, axis=1), axis=0, return_inverse=True)
    sign = np.where(vertex[:, 0] < vertex[:, 1], 1, -1)
    balance = np.bincount(which.ravel(), sign, minlength=1)[which.ravel()]
    closed = shared & (balance == 0)
    left = np.flatnonzero(~closed)
    if not len(left):
        return int(closed.sum()) // 2, 0, 0
    near = cKDTree(middles[left]).query_pairs(_CRACK_CELLS, output_type="ndarray")
    other = tile[left][near[:, 0]] != tile[left][near[:, 1]] if len(near) else np.zeros(0, bool)
    cracked = np.unique(near[other])
    return int(closed.sum()) // 2, len(cracked), len(left) - len(cracked)
