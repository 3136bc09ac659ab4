"""The 3D Tiles of served scenes: made when somebody asks, and kept for a while.

The parts of the base are the one thing that a scene does not have as it is; they are cut in a
thread, one scene at a time, in about a second per 100,000 faces.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeVar

import orjson
import xxhash

from terraport_server.served_scene import ServedScene
from terraport_store import read_names
from terraport_store.tiles.placing import Placing, place_scene
from terraport_store.tiles.scene_tiles import SceneTiles
from terraport_store.tiles.tile_glb import TileFacts
from terraport_store.tiles.tileset import Cell, tileset_document

__all__ = ["MAX_KEPT_BYTES", "MAX_KEPT_TILESETS", "ServedTiles", "TileDesk"]

_Made = TypeVar("_Made")

MAX_KEPT_BYTES: Final = 128 << 20
"""Parts of bases in memory, least recently asked for out first; those of the newest scene stay."""

MAX_KEPT_TILESETS: Final = 4
"""Of one scene, for one radius each: up to 40 MB for 100,000 segments, and a second to write."""


@dataclass(frozen=True, slots=True, eq=False)
class ServedTiles:
    """What is served of one version of a scene."""

    cells: list[Cell]
    placing: Placing
    names: list[str]
    """Of the parts, by number: the hash of their bytes, so that an address has one content."""
    parts: dict[str, bytes]
    tilesets: OrderedDict[float | None, bytes] = field(default_factory=OrderedDict)
    """By radius, least recently asked for first."""

    @property
    def bytes(self) -> int:
        """Of all parts."""
        return sum(len(part) for part in self.parts.values())


class TileDesk:
    """Makes tiles; lives on one event loop."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, str], ServedTiles] = OrderedDict()
        self._turn = asyncio.Lock()

    async def tileset(self, served: ServedScene, radius_m: float | None) -> bytes:
        """Return ``tileset.json``; raises as :meth:`part`."""
        async with self._turn:
            tiles = await self._tiles(served)
            tileset = tiles.tilesets.get(radius_m)
            if tileset is None:
                tileset = await self._in_thread(served, lambda: _tileset(served, tiles, radius_m))
                tiles.tilesets[radius_m] = tileset
                if len(tiles.tilesets) > MAX_KEPT_TILESETS:
                    tiles.tilesets.popitem(last=False)
            tiles.tilesets.move_to_end(radius_m)
            return tileset

    async def part(self, served: ServedScene, name: str) -> bytes | None:
        """Return a part of the base by its name; None where there is none of it.

        Raises
        ------
        PayloadError, StoreError, OSError
            When the scene is not whole.
        ModuleNotFoundError
            When pyproj or Pillow is not installed.
        """
        tiles = self._kept.get((served.id, served.version))
        if tiles is None:
            async with self._turn:
                tiles = await self._tiles(served)
        return tiles.parts.get(name)

    async def _tiles(self, served: ServedScene) -> ServedTiles:
        """Find or make what is served; its caller has the turn."""
        key = (served.id, served.version)
        tiles = self._kept.get(key)
        if tiles is None:
            tiles = await self._in_thread(served, lambda: _make(served))
            self._kept[key] = tiles
            while len(self._kept) > 1 and self._bytes() > MAX_KEPT_BYTES:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return tiles

    def _bytes(self) -> int:
        return sum(tiles.bytes for tiles in self._kept.values())

    @staticmethod
    async def _in_thread(served: ServedScene, work: Callable[[], _Made]) -> _Made:
        """Run it in a thread, with the scene held open."""
        served.hold()
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(served.fetchers, work)
        finally:
            served.release()


def _make(served: ServedScene) -> ServedTiles:
    scene = served.scene
    tiles = SceneTiles.of(
        scene.base_path.read_bytes(),
        scene.cover,
        scene.index.bounds,
        scene.manifest.hand_off.deviation_m,
    )
    _, regions = read_names(scene.files)
    # Without labels: they change, and the bytes behind an address do not.
    facts = TileFacts.of(scene.manifest, regions["regions"])
    parts = list(tiles.encode_parts(facts))
    names = [xxhash.xxh3_64_hexdigest(part) for part in parts]
    by_name = dict(zip(names, parts, strict=True))
    return ServedTiles(tiles.cells, place_scene(scene.manifest), names, by_name)


def _tileset(served: ServedScene, tiles: ServedTiles, radius_m: float | None) -> bytes:
    query = f"?v={served.version}"
    document = tileset_document(
        tiles.cells,
        served.scene.index.bounds,
        tiles.placing,
        segment_uri=lambda number: f"segments/{number}.glb{query}",
        part_uri=lambda number: f"tiles/{tiles.names[number]}.glb{query}",
        version=served.version,
        radius_m=radius_m,
    )
    return orjson.dumps(document)
