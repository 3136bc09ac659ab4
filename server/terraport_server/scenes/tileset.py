"""Cache of the 3D Tiles of served scenes, made on request.

A scene does not contain the parts of its base; they are cut in a thread, one scene at a time, in
about a second per 100,000 faces.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeVar

import xxhash

from terraport_server.scenes.served_scene import ServedScene
from terraport_store import read_names
from terraport_store.layout import BASE
from terraport_store.tiles.placing import place_scene
from terraport_store.tiles.scene_tiles import SceneTiles
from terraport_store.tiles.tile_glb import TileFacts
from terraport_store.tiles.tileset import Tileset

__all__ = ["MAX_KEPT_BYTES", "ServedTiles", "TilesetCache"]

_Made = TypeVar("_Made")

MAX_KEPT_BYTES: Final = 128 << 20
"""Bound of the cache; the least recently used scene goes first, the newest always stays."""


@dataclass(frozen=True, slots=True, eq=False)
class ServedTiles:
    """Tileset and base parts of one version of a scene."""

    tileset: Tileset
    """For every radius; for 100,000 segments up to 25 MB, and a second to write."""
    digest: str
    """Hash of the tileset without a radius."""
    parts: dict[str, bytes]
    """Parts by the hash of their bytes, so that an address has one content."""

    @property
    def bytes(self) -> int:
        """Size of all parts and the tileset."""
        return self.tileset.size_bytes + sum(len(part) for part in self.parts.values())


class TilesetCache:
    """Builder and cache of tilesets, on one event loop."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, str], ServedTiles] = OrderedDict()
        self._lock = asyncio.Lock()

    async def tiles(self, served: ServedScene) -> ServedTiles:
        """Return the tiles of a scene; raises as :meth:`part`."""
        tiles = self._kept.get((served.id, served.version))
        if tiles is not None:
            return tiles
        async with self._lock:
            return await self._tiles(served)

    async def part(self, served: ServedScene, name: str) -> bytes | None:
        """Return a part of the base by its name; None where there is none of that name.

        Raises
        ------
        PayloadError, StoreError, OSError
            When the scene is damaged.
        ModuleNotFoundError
            When pyproj or Pillow is not installed.
        """
        return (await self.tiles(served)).parts.get(name)

    async def _tiles(self, served: ServedScene) -> ServedTiles:
        """Find or make the tiles; the caller holds the lock."""
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
        """Run in a thread, with the scene held open."""
        served.hold()
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(served.fetchers, work)
        finally:
            served.release()


def _make(served: ServedScene) -> ServedTiles:
    scene = served.scene
    tiles = SceneTiles.of(
        scene.file_mesh(BASE),
        scene.cover,
        scene.index.bounds,
        scene.manifest.hand_off.deviation_m,
    )
    _, regions = read_names(scene.files)
    # Without labels: they can change, and the bytes behind an address must not.
    facts = TileFacts.of(scene.manifest, regions["regions"])
    parts = list(tiles.encode_parts(facts))
    names = [xxhash.xxh3_64_hexdigest(part) for part in parts]
    query = f"?v={served.version}"
    tileset = Tileset.of(
        tiles.cells,
        scene.index.bounds,
        place_scene(scene.manifest),
        segment_uri=lambda number: f"tiles/segments/{number}.glb{query}",
        part_uri=lambda number: f"tiles/{names[number]}.glb{query}",
        version=served.version,
    )
    digest = xxhash.xxh3_64()
    for piece in tileset.pieces():
        digest.update(piece)
    return ServedTiles(tileset, digest.hexdigest(), dict(zip(names, parts, strict=True)))
