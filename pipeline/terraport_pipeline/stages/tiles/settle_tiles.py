"""What is decided for all tiles together once they are joined: weak places, loose pieces, normals.

Weak places that reach across walls stay or go as one (:func:`forgive`); pieces that are too small
over all tiles go, and shared vertices get one normal (:func:`settle`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Self

import numpy as np
import xxhash
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float32, Float64, Int64
from terraport_pipeline.geometry.mesh.vertex_normals import unit_normals
from terraport_pipeline.stages.contract import Facts, Form, Stored
from terraport_pipeline.stages.tiles.join_tiles import Join
from terraport_pipeline.stages.tiles.tile_arrays import listed_by_tile, split_by_tile

__all__ = [
    "SETTLED_FORM",
    "Forgiven",
    "Look",
    "Settled",
    "SettledTile",
    "Weak",
    "forgive",
    "settle",
]

_CRACK_CELLS: Final = 1.0
"""Open edges of two tiles this near to each other are a crack, not two rims."""


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
    """Edges along walls that are open on both sides within a cell; the build warns of any."""
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


def _store_settled(settled: Settled) -> Stored:
    return Stored(
        {
            **listed_by_tile("ids", settled.ids),
            **listed_by_tile("normals", [tile.normals for tile in settled.tiles]),
            **listed_by_tile("dropped", [tile.dropped for tile in settled.tiles]),
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
    tiles = zip(split_by_tile(arrays, "normals"), split_by_tile(arrays, "dropped"), strict=True)
    count, islands, seam_edges, cracks, rims = stored.values["numbers"]
    return Settled(
        split_by_tile(arrays, "ids"),
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
    # An edge between two vertices that the cut made is where the surface was cut.
    is_cut = (edges[left][:, :, 0] != edges[left][:, :, 1]).all(axis=1)
    uncut = left[~is_cut]
    if not len(uncut):
        return int(closed.sum()) // 2, 0, len(left)
    near = cKDTree(middles[uncut]).query_pairs(_CRACK_CELLS, output_type="ndarray")
    other = tile[uncut][near[:, 0]] != tile[uncut][near[:, 1]] if len(near) else np.zeros(0, bool)
    cracked = np.unique(near[other])
    return int(closed.sum()) // 2, len(cracked), len(left) - len(cracked)
