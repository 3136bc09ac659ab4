"""Small LAZ files of a synthetic hill, whole and in tiles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from pyproj import CRS

from terraport_payload.types import Bool, Float64, Int64

STEP_M = 0.001


class Hill:
    """Points of a hill in whole millimetres, with colour, class and grade."""

    def __init__(self, count: int = 4000, *, seed: int = 3, side_m: float = 40.0) -> None:
        rng = np.random.default_rng(seed)
        east, north = rng.uniform(0, side_m, (2, count))
        height = 6.0 * np.sin(east / 9.0) * np.cos(north / 11.0) + 0.05 * east
        place = np.stack([east, north, height + rng.normal(0, 0.01, count)], axis=1)
        self.millimetres: Int64 = np.rint(place / STEP_M).astype(np.int64)
        self.millimetres += [641_200_000, 8_594_700_000, 1_287_000]
        self.colours = rng.integers(0, 256, (count, 3)).astype(np.uint16) * 257
        self.classes = np.where(north > side_m / 2, 2, 6).astype(np.uint8)
        self.grade = rng.random(count).astype(np.float32)
        self.side_m = side_m

    def __len__(self) -> int:
        return len(self.grade)

    def inside(self, column: int, row: int, tiles: int, margin_m: float = 0.0) -> Bool:
        """Rows of the points in a tile of a square of tiles, with a margin."""
        wide = self.side_m / tiles
        local: Float64 = (self.millimetres[:, :2] - [641_200_000, 8_594_700_000]) * STEP_M
        low = np.array([column, row]) * wide - margin_m
        return ((local >= low) & (local < low + wide + 2 * margin_m)).all(axis=1)


def las_data(
    hill: Hill,
    rows: Any = slice(None),
    *,
    epsg: int | None = 32735,
    offset: Sequence[float] = (641_000.0, 8_594_000.0, 0.0),
    fields: Sequence[str] = ("grade",),
    colour: bool = True,
    depth: int = 1,
) -> laspy.LasData:
    """Some points in memory; `depth` 257 puts 8-bit colours into the 16 bits."""
    header = laspy.LasHeader(point_format=7 if colour else 6, version="1.4")
    header.scales, header.offsets = np.full(3, STEP_M), np.array(offset, float)
    if epsg is not None:
        header.add_crs(CRS.from_epsg(epsg))
    for name in fields:
        kind = np.float32 if name == "grade" else np.uint8
        header.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    las = laspy.LasData(header)
    ticks = hill.millimetres[rows] - np.rint(np.array(offset) / STEP_M).astype(np.int64)
    las.points = laspy.ScaleAwarePointRecord.zeros(len(ticks), header=header)
    las.X, las.Y, las.Z = ticks.T.astype(np.int32)
    if colour:
        las.red, las.green, las.blue = hill.colours[rows].T // depth
    las.classification = hill.classes[rows]
    for name in fields:
        las[name] = hill.grade[rows] if name == "grade" else hill.classes[rows]
    return las


def write_laz(path: Path, hill: Hill, rows: Any = slice(None), **options: Any) -> Path:
    """Write some points, with the options of :func:`las_data`."""
    las_data(hill, rows, **options).write(path, laz_backend=laspy.LazBackend.Lazrs)
    return path


def write_tiles(folder: Path, hill: Hill, *, tiles: int = 3, margin_m: float = 0.0) -> list[Path]:
    """Write a square of tiles, each with its own offset and its points in an order of its own."""
    rng = np.random.default_rng(9)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(tiles * tiles):
        column, row = number % tiles, number // tiles
        rows = rng.permutation(np.flatnonzero(hill.inside(column, row, tiles, margin_m)))
        offset = (641_200.0 + 1.234 * column, 8_594_700.0 + 0.011 * row, 1_287.0)
        path = folder / f"tile_{number + 1}.laz"
        paths.append(write_laz(path, hill, rows, offset=offset))
    return paths
