"""From the tiles' own pieces to pieces of one surface: what is decided for all tiles together.

Four passes, each holding one tile at a time (:mod:`~terraport_pipeline.stages.tiles.joined_tile`):

1. the borders alone: vertices in walls become one, gaps are filled
   (:mod:`~terraport_pipeline.geometry.tiles.tile_weld`);
2. weak places: those that reach across walls are one, and stay or go as one (:func:`forgive`);
3. every tile is cut and looked at: how large its loose pieces are, what its faces add to the
   normals of shared vertices, which edges along walls stay open (:func:`settle`);
4. every tile is written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from terraport_payload.types import AnyArray, Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.geometry.mesh.vertex_normals import unit_normals
from terraport_pipeline.geometry.tiles.tile_weld import Seams
from terraport_pipeline.stages.contract import Stored

__all__ = [
    "NAME",
    "Join",
    "Look",
    "Settled",
    "TileArrays",
    "Weak",
    "cut_ids",
    "forgive",
    "from_stored",
    "settle",
    "to_stored",
]

NAME: Final = "join"

TileArrays = Mapping[str, AnyArray]
"""What is kept of a tile, by name."""

_CRACK_CELLS: Final = 1.0
"""Open edges of two tiles this near to each other are a crack, not two rims."""


@dataclass(frozen=True, slots=True, eq=False)
class Join:
    """What the join says of all tiles; small, and the same for every worker."""

    cells: Float64
    """(G, 3) shared vertices, lattice cells."""
    ratio: Float32
    """(G,) support ratio."""
    colours: UInt8
    """(G, 3)"""
    attributes: tuple[Float32, ...]
    """(G,) each."""
    codes: tuple[int, ...]
    """Places of attributes that hold codes."""
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
    forgiven: tuple[Bool, ...]
    """Per tile: which of its weak places stay."""
    base_forgiven: tuple[Bool, ...]
    """Per tile: which of them stay in the base."""

    @classmethod
    def of(
        cls,
        seams: Seams,
        tiles: Sequence[TileArrays],
        names: int,
        codes: tuple[int, ...],
        rules: tuple[EdgeRule, EdgeRule],
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
        none = tuple(np.zeros(0, dtype=bool) for _ in tiles)
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
            none,
            none,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Weak:
    """Connected faces of little support in a tile, and whether they reach its walls."""

    farthest: Float32
    """(W,) largest support ratio in each."""
    touch: Int64
    """(K, 2) (place, id) of the shared vertices in them."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Facts of a tile as it will be after the join, from which all tiles settle what stays."""

    sizes: Int64
    """(P,) faces of each of its loose pieces."""
    piece: Int64
    """(S,) piece of each shared vertex."""
    pairs: Int64
    """(S, 2) ids of its two ends, ascending: twice its own id, or those of the edge that the cut
    made it on."""
    sums: Float64
    """(S, 3) what the tile's faces add to its normal."""
    edges: Int64
    """(E, 4) open edges along walls, two names each."""
    middles: Float64
    """(E, 3) their middles, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """Decisions over all tiles: shared normals, cut vertices, and which pieces are islands."""

    pairs: Int64
    """(C, 2) ends of shared vertices that the cut made, ascending; their ids follow the join's."""
    normals: Float32
    """(G + C, 3) unit normals of shared vertices."""
    dropped: tuple[Int64, ...]
    """Per tile: loose pieces that go."""
    islands: int
    """Pieces of the whole surface that go."""
    seam_edges: int
    """Edges along walls that two tiles share."""
    cracks: int
    """Edges along walls that are open on both sides within a cell: must be 0."""
    rims: int
    """Other open edges along walls: the surface ends there."""


def forgive(join: Join, weak: Sequence[Weak]) -> Join:
    """Decide which weak places stay: those that, over all tiles, nowhere pass the largest ratio."""
    label, _ = _over_tiles(
        [len(each.farthest) for each in weak], [each.touch for each in weak], len(join.cells)
    )
    farthest = np.concatenate([np.zeros(0, np.float32), *(each.farthest for each in weak)])
    worst = np.zeros(int(label.max(initial=-1)) + 1, dtype=np.float32)
    np.maximum.at(worst, label, farthest)
    ends = np.cumsum([len(each.farthest) for each in weak])[:-1]
    stays, base_stays = (worst[label] <= rule.largest for rule in (join.rule, join.base_rule))
    return replace(
        join,
        forgiven=tuple(np.split(stays, ends)),
        base_forgiven=tuple(np.split(base_stays, ends)),
    )


def settle(looks: Sequence[Look], count: int, *, min_faces: int) -> Settled:
    """Decide what is left to decide.

    Parameters
    ----------
    looks : sequence of Look
    count : int
        Shared vertices of the join.
    min_faces : int
        Pieces of the joined surface with fewer faces go; the largest stays.
    """
    every = np.concatenate([np.zeros((0, 2), np.int64), *(each.pairs for each in looks)])
    pairs = np.unique(every[every[:, 0] != every[:, 1]], axis=0)
    ids = [cut_ids(each.pairs, pairs, count) for each in looks]
    touch = [np.stack([look.piece, own], axis=1) for look, own in zip(looks, ids, strict=True)]
    label, starts = _over_tiles([len(each.sizes) for each in looks], touch, count + len(pairs))
    sizes = np.concatenate([np.zeros(0, np.int64), *(each.sizes for each in looks)])
    whole = np.bincount(label, sizes, minlength=1)
    large = whole >= min_faces
    large[int(whole.argmax())] = True
    goes = ~large[label]
    dropped = tuple(
        np.flatnonzero(goes[starts[t] : starts[t + 1]]).astype(np.int64) for t in range(len(looks))
    )
    total = np.zeros((count + len(pairs), 3))
    for each, own in zip(looks, ids, strict=True):
        np.add.at(total, own, each.sums)
    islands = int(((whole > 0) & ~large).sum())
    return Settled(pairs, unit_normals(total), dropped, islands, *_count_open(looks))


def cut_ids(pairs: Int64, cut_pairs: Int64, count: int) -> Int64:
    """Ids of shared vertices (S,) by their ends (S, 2); those of `cut_pairs` follow `count`."""
    ids = pairs[:, 0].copy()
    cut = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
    if len(cut):
        span = int(cut_pairs.max()) + 1
        key, cut_keys = pairs[cut] @ [span, 1], cut_pairs @ [span, 1]
        ids[cut] = count + np.searchsorted(cut_keys, key)
    return ids


def to_stored(join: Join, settled: Settled) -> Stored:
    """Turn the join into arrays and values."""
    # (1) Plain arrays and values, and the rules of both cuts.
    rules = (("rule", join.rule), ("base_rule", join.base_rule))
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "cells": join.cells,
        "ratio": join.ratio,
        "colours": join.colours,
        "pairs": settled.pairs,
        "normals": settled.normals,
    }
    values: dict[str, Any] = {
        "attributes": len(join.attributes),
        "codes": list(join.codes),
        "counts": [settled.islands, settled.seam_edges, settled.cracks, settled.rims],
    }
    for name, rule in rules:
        outline = rule.footprint
        field_m = np.zeros((0, 0), np.float32) if outline is None else outline.field_m
        arrays[f"{name}-footprint"] = field_m
        position = None if outline is None else [*outline.low, outline.cell_m]
        numbers = [rule.threshold, rule.largest, rule.spacing_m, rule.outward_m]
        values[name] = {"numbers": numbers, "footprint": position}
    arrays |= {f"attribute-{i}": values for i, values in enumerate(join.attributes)}
    # (2) One list per tile, as one array with its starts.
    lists: tuple[tuple[str, Sequence[AnyArray]], ...] = (
        ("rows", join.rows),
        ("ids", join.ids),
        ("fillers", join.fillers),
        ("forgiven", join.forgiven),
        ("base_forgiven", join.base_forgiven),
        ("dropped", settled.dropped),
    )
    for name, per_tile in lists:
        arrays[name] = np.concatenate(per_tile)
        arrays[f"{name}-starts"] = np.cumsum([0, *(len(rows_of_tile) for rows_of_tile in per_tile)])
    return Stored(arrays, values)


def from_stored(stored: Stored) -> tuple[Join, Settled]:
    """Turn arrays and values back into the join and what was settled."""
    arrays, values = stored.arrays, stored.values

    def per_tile(name: str) -> tuple[Any, ...]:
        return tuple(np.split(arrays[name], arrays[f"{name}-starts"][1:-1]))

    def rule(name: str) -> EdgeRule:
        record, outline = values[name], None
        if record["footprint"] is not None:
            x, z, cell_m = record["footprint"]
            field_m = np.asarray(arrays[f"{name}-footprint"], np.float32)
            outline = Footprint((x, z), cell_m, field_m)
        threshold, largest, spacing_m, outward_m = record["numbers"]
        return EdgeRule(threshold, largest, spacing_m, outline, outward_m)

    join = Join(
        np.asarray(arrays["cells"], np.float64),
        np.asarray(arrays["ratio"], np.float32),
        np.asarray(arrays["colours"], np.uint8),
        tuple(
            np.asarray(arrays[f"attribute-{i}"], np.float32) for i in range(values["attributes"])
        ),
        tuple(values["codes"]),
        per_tile("rows"),
        per_tile("ids"),
        per_tile("fillers"),
        rule("rule"),
        rule("base_rule"),
        per_tile("forgiven"),
        per_tile("base_forgiven"),
    )
    settled = Settled(
        np.asarray(arrays["pairs"], np.int64),
        np.asarray(arrays["normals"], np.float32),
        per_tile("dropped"),
        *values["counts"],
    )
    return join, settled


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


def _count_open(looks: Sequence[Look]) -> tuple[int, int, int]:
    """Count edges that two tiles share, cracks, rims."""
    tile = np.repeat(np.arange(len(looks)), [len(each.edges) for each in looks])
    edges = np.concatenate([np.zeros((0, 4), np.int64), *(each.edges for each in looks)])
    middles = np.concatenate([np.zeros((0, 3)), *(each.middles for each in looks)])
    if not len(edges):
        return 0, 0, 0
    shared = (edges >= 0).all(axis=1)
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
