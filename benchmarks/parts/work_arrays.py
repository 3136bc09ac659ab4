"""Meshes and labels of a finished build, from its work directory.

Detail lies in tiles: ``tile-00000/vertices.npy`` and so on, shared vertices once in each tile with
the same bits. Segments lie in ``segment-cut-00000``, numbered within the tile; ``segment`` holds
their numbers in the scene.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terraport_payload.types import AnyArray, Float32, Int32, Int64, UInt8
from terraport_pipeline.model import Mesh

__all__ = ["Tiles", "read_base", "read_segments", "read_tiles", "spacing_of", "welded"]


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """All tiles of a build as one soup; shared vertices stand once in each."""

    vertices: Float32
    faces: Int64
    normals: Float32
    colours: UInt8
    tile: Int64
    """(F,)"""
    shared: Int64
    """(V,) number of a shared vertex, -1 elsewhere."""


def read_tiles(work: Path) -> Tiles:
    """Read the detail; tiles without faces do not count."""
    columns: dict[str, list[AnyArray]] = {}
    first = number = 0
    # A tile names its shared vertices in numbers of its own; those of the scene are in `settle`.
    ids, starts = (np.load(work / "settle" / f"{name}.npy") for name in ("ids", "ids-starts"))
    for each, folder in enumerate(sorted(work.glob("tile-*"))):
        tile = {
            name: np.load(folder / f"{name}.npy")
            for name in ("vertices", "faces", "normals", "colours", "border-rows", "border-shared")
        }
        if not len(tile["faces"]):
            continue
        shared = np.full(len(tile["vertices"]), -1, np.int64)
        shared[tile["border-rows"]] = ids[starts[each] : starts[each + 1]][tile["border-shared"]]
        for name, array in (
            ("vertices", tile["vertices"]),
            ("faces", tile["faces"].astype(np.int64) + first),
            ("normals", tile["normals"]),
            ("colours", tile["colours"]),
            ("tile", np.full(len(tile["faces"]), number, np.int64)),
            ("shared", shared),
        ):
            columns.setdefault(name, []).append(array)
        first, number = first + len(tile["vertices"]), number + 1
    if not columns:
        raise SystemExit(f"{work} holds no tiles; expected the work directory of a build")
    return Tiles(**{name: np.concatenate(arrays) for name, arrays in columns.items()})


def welded(tiles: Tiles) -> Mesh:
    """Put the detail together, every shared vertex once; faces keep their order."""
    rows = np.arange(len(tiles.vertices))
    # A shared vertex stands for all of its number; the others stay in their order.
    _, first, inverse = np.unique(tiles.shared, return_index=True, return_inverse=True)
    original = np.where(tiles.shared >= 0, first[inverse], rows)
    kept = original == rows
    number = (np.cumsum(kept) - 1)[original]
    return Mesh(
        tiles.vertices[kept],
        number[tiles.faces].astype(np.int32),
        tiles.normals[kept],
        tiles.colours[kept],
    )


def read_base(work: Path) -> Mesh:
    """Read the base, without its attributes."""
    fields = ("vertices", "faces", "normals", "colours")
    return Mesh(*(np.load(work / "base" / f"base-{field}.npy") for field in fields))


def read_segments(work: Path) -> Int32:
    """Segment of every face of :func:`read_tiles`, by its number in the scene."""
    tile, within = (np.load(work / "segment" / f"{name}.npy") for name in ("tile", "within"))
    labels = []
    for number, folder in enumerate(sorted(work.glob("segment-cut-*"))):
        in_tile = np.flatnonzero(tile == number)
        in_scene = np.empty(len(in_tile), np.int32)
        in_scene[within[in_tile]] = in_tile
        labels.append(in_scene[np.load(folder / "segments.npy")])
    return np.concatenate(labels)


def spacing_of(work: Path) -> float:
    """Typical distance between the points of the whole survey, metres."""
    stage = json.loads((work / "measure_survey" / "stage.json").read_text(encoding="utf-8"))
    return float(stage["values"]["spacing_m"])
