"""A scene as 3D Tiles 1.1, for Cesium, Unreal, Unity, 3DTilesRendererJS and GIS: a folder, or .3tz.

The tree and its content are the store's (:mod:`terraport_store.tiles`), the same as a running
service's. Here every segment is encoded anew with what its regions and attributes mean; a service
sends the payload that it has.
"""

from __future__ import annotations

import hashlib
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.progress import Progress
from terraport_store import Scene, read_names
from terraport_store.layout import BASE
from terraport_store.tiles.placing import place_scene
from terraport_store.tiles.scene_tiles import SceneTiles
from terraport_store.tiles.tile_glb import TileFacts, encode_tile
from terraport_store.tiles.tileset import Tileset

__all__ = ["ARCHIVE", "FOLDER_HOLDS", "write_tiles"]

ARCHIVE: Final = ".3tz"
"""Ending of a tileset in one file."""

FOLDER_HOLDS: Final = frozenset({"tileset.json", "base", "segments"})
"""What is in a folder of tiles."""

_INDEX: Final = "@3dtilesIndex1@"
"""Last file of an archive: where each file begins, by the hash of its name (3TZ 1.3)."""

_ZIP_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""So that the same scene gives the same bytes."""


def write_tiles(
    path: Path,
    scene: Scene,
    progress: Progress,
    *,
    radius_m: float | None = None,
    height_shift_m: float = 0.0,
) -> dict[str, Any]:
    """Write a scene as a tileset.

    Parameters
    ----------
    path : Path
        A file that ends with ``.3tz``, or a folder to make.
    scene : Scene
    progress : Progress
        A step of tiles.
    radius_m : float, optional
        Full detail within this distance of the eye; None: by the error on the screen alone.
    height_shift_m : float, optional
        Added to all heights.

    Returns
    -------
    dict
        What to say of it; ``frame`` is what its coordinates are in.
    """
    manifest = scene.manifest
    placing = place_scene(manifest, height_shift_m=height_shift_m)
    deviation_m = manifest.hand_off.deviation_m
    tiles = SceneTiles.of(scene.file_mesh(BASE), scene.cover, scene.index.bounds, deviation_m)
    tileset = Tileset.of(
        tiles.cells,
        scene.index.bounds,
        placing,
        segment_uri="segments/{}.glb".format,
        part_uri="base/{}.glb".format,
        version=manifest.version,
    )
    names, _ = read_names(scene.files)
    labels = [names.label(region) or "" for region in range(manifest.counts.regions)]
    facts = TileFacts.of(manifest, scene.regions["regions"], labels)

    def files() -> Iterator[tuple[str, bytes]]:
        yield "tileset.json", b"".join(tileset.pieces(radius_m))
        for number, data in enumerate(tiles.encode_parts(facts)):
            yield f"base/{number}.glb", data
        for segment in range(len(scene.index)):
            yield f"segments/{segment}.glb", encode_tile(scene.mesh(segment), facts)

    total = 1 + len(tiles.parts) + len(scene.index)
    progress.start("write tiles", total, "tiles")
    write = _write_archive if path.suffix.lower() == ARCHIVE else _write_folder
    write(path, _told(files(), progress))
    progress.done({"tiles": total})
    frame = f"local, east, north, up: {placing.why_local}"
    return {
        "frame": frame if placing.is_local else "Earth-centred (EPSG:4978)",
        "segments": len(scene.index),
        "cells": len(tiles.cells),
    }


def _told(files: Iterator[tuple[str, bytes]], progress: Progress) -> Iterator[tuple[str, bytes]]:
    for file in files:
        yield file
        progress.advance(1)


def _write_folder(folder: Path, files: Iterator[tuple[str, bytes]]) -> None:
    for name, data in files:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(data)


def _write_archive(path: Path, files: Iterator[tuple[str, bytes]]) -> None:
    """Write a zip of stored files with the index that lets viewers read it in place."""
    rows: list[tuple[tuple[int, int], bytes, int]] = []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files:
            entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
            archive.writestr(entry, data)
            digest = hashlib.md5(name.encode(), usedforsecurity=False).digest()
            low, high = struct.unpack("<QQ", digest)
            rows.append(((low, high), digest, entry.header_offset))
        index = b"".join(digest + struct.pack("<Q", at) for _, digest, at in sorted(rows))
        archive.writestr(zipfile.ZipInfo(_INDEX, _ZIP_EPOCH), index)
