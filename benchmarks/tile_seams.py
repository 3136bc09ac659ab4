"""Are the borders of tiles as good as any other place of the surface? Measured, and drawn.

Takes the work directories of two builds of one survey, in several tiles and in one:

* how far the two surfaces of neighbouring tiles lay apart along their wall before they were joined
  (from the build's own report), and what stayed open after: edges along seams that only one face
  has, counted again here over the tiles' files;
* how far the joined surface lies from the one that was reconstructed in one tile: at the shared
  vertices, near them, far from any; in cells, and the 99th percentile in spacings of the points.

    terraport build quarry.laz -o whole --work whole.work --tile-depth 10
    terraport build quarry.laz -o tiles --work tiles.work --tile-depth 9
    python benchmarks/tile_seams.py tiles.work whole.work --picture seam.png
    python benchmarks/tile_seams.py --smoke

The tile depth of the whole is the least that gives one tile (here 10): deeper ones solve another
surface.

Prints Markdown. The picture stands before the highest wall that a seam crosses: tiles in colours,
and the same bare.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from parts.first_steps import single_tile_depth
from parts.work_arrays import Tiles, read_tiles, spacing_of, welded
from PIL import Image
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, UInt8
from terraport_pipeline.engines.cameras import eye_level
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.workflow.build import BuildOptions, build

SAMPLES: Final = 20_000
NEAR_CELLS: Final = 2.0
FAR_CELLS: Final = 20.0
COLUMN_M: Final = 40.0
"""Side of the columns of ground of which the one with the highest wall is drawn."""

REACH_M: Final = 150.0
PALETTE: Final = ((214, 120, 92), (96, 150, 190), (120, 170, 104), (200, 176, 92))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tiles", nargs="?", type=Path, help="work directory of the build in tiles")
    parser.add_argument(
        "whole", nargs="?", type=Path, help="work directory of the build in one tile"
    )
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.smoke:
        with tempfile.TemporaryDirectory() as scratch:
            run(*small(Path(scratch)), None)
    elif arguments.whole is None:
        parser.error("two work directories are wanted, or --smoke")
    else:
        run(arguments.tiles, arguments.whole, arguments.picture)
    return 0


def small(folder: Path) -> tuple[Path, Path]:
    """Build a small quarry twice."""
    survey = folder / "quarry.las"
    write_quarry(QuarryOptions(points=20_000, seed=4, size_m=150.0), survey)
    whole = single_tile_depth(survey, folder / "whole.work")
    for name, depth in (("tiles", whole - 1), ("whole", whole)):
        work, tiles = folder / f"{name}.work", TileOptions(depth=depth)
        build(BuildOptions(survey, folder / name, work=work, tiles=tiles))
    return folder / "tiles.work", folder / "whole.work"


def run(tiled: Path, whole: Path, picture: Path | None) -> None:
    tiles = read_tiles(tiled)
    counts: dict[str, float] = {}
    for name in ("join", "settle"):
        counts |= json.loads((tiled / name / "stage.json").read_text())["facts"]["counts"]
    cell_m = cell_of(tiled)
    spacings = cell_m / spacing_of(tiled)
    shared = len(np.unique(tiles.shared)) - 1
    print(
        f"{int(tiles.tile.max()) + 1} tiles with {len(tiles.faces):,} faces, cells of "
        f"{cell_m:.3f} m; {shared:,} shared vertices, {counts['seam_edges']:,} "
        f"edges along seams, {counts['seam_fillers']} triangles filled in, {counts['seam_cracks']} "
        f"cracks, {counts['seam_rims']} rims; counted again: {open_seam_edges(tiles)} open edges "
        "between two shared vertices\n"
    )
    print("| cells | median | 95 % | 99 % | largest | 99 %, spacings |")
    print("|---|---:|---:|---:|---:|---:|")
    gaps = [counts[f"seam_gap_p{p}_cells"] for p in (50, 95, 99, 100)]
    row("the two surfaces along the wall, before joining", np.array(gaps), spacings)
    detail = welded(read_tiles(whole))
    at = np.flatnonzero(tiles.shared >= 0)
    away = cKDTree(tiles.vertices[at]).query(tiles.vertices)[0] / cell_m
    for name, rows in (
        ("to the surface of one tile: shared vertices", at),
        (f"within {NEAR_CELLS:g} cells of one", np.flatnonzero((away < NEAR_CELLS) & (away > 0))),
        (f"farther than {FAR_CELLS:g} from any", np.flatnonzero(away > FAR_CELLS)),
    ):
        some = rows[:: max(1, len(rows) // SAMPLES)]
        apart = (
            distances_to_mesh(tiles.vertices[some], detail.vertices, detail.faces, workers=2)
            / cell_m
        )
        row(name, np.percentile(apart, (50, 95, 99, 100)), spacings)
    if picture is not None:
        Image.fromarray(draw(tiles)).save(picture)


def row(name: str, values: AnyFloat, spacings: float) -> None:
    shown = [*values, values[2] * spacings]
    print(f"| {name} | " + " | ".join(f"{value:.2g}" for value in shown) + " |", flush=True)


def cell_of(work: Path) -> float:
    """Side of a cell: shared vertices lie on the lattice's edges, in cells and in metres."""
    tiles = read_tiles(work)
    cells = np.load(work / "join" / "cells.npy")
    at = np.flatnonzero((tiles.shared >= 0) & (tiles.shared < len(cells)))
    places, ids = tiles.vertices[at].astype(np.float64), tiles.shared[at]
    widest = int(np.argmax(np.ptp(places, axis=0)))
    low, high = places[:, widest].argmin(), places[:, widest].argmax()
    metres = places[high, widest] - places[low, widest]
    return float(metres / (cells[ids[high], widest] - cells[ids[low], widest]))


def open_seam_edges(tiles: Tiles) -> int:
    """Count edges between two shared vertices that only one face has, over all tiles."""
    name = np.where(tiles.shared >= 0, tiles.shared, -1 - np.arange(len(tiles.shared)))
    corners = name[tiles.faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = np.sort(edges[(edges >= 0).all(axis=1)], axis=1)
    _, times = np.unique(edges, axis=0, return_counts=True)
    return int((times == 1).sum())


def draw(tiles: Tiles, size: tuple[int, int] = (800, 700)) -> UInt8:
    """Draw the highest wall that a seam crosses, from its foot."""
    at = np.flatnonzero(tiles.shared >= 0)
    column = np.floor(tiles.vertices[at][:, [0, 2]] / COLUMN_M)
    _, which = np.unique(column, axis=0, return_inverse=True)
    heights = tiles.vertices[at, 1]
    low = np.full(int(which.max()) + 1, np.inf)
    high = -low
    np.minimum.at(low, which.ravel(), heights)
    np.maximum.at(high, which.ravel(), heights)
    here = at[which.ravel() == int(np.argmax(high - low))]
    middle = 0.5 * (tiles.vertices[here].min(axis=0) + tiles.vertices[here].max(axis=0))
    middle = middle.astype(np.float64)
    height_m = float(np.ptp(tiles.vertices[here, 1]))
    steep = here[np.abs(tiles.normals[here, 1]) < 0.7]
    out = tiles.normals[steep].mean(axis=0).astype(np.float64) * (1.0, 0.0, 1.0)
    out /= max(float(np.linalg.norm(out)), 1e-9)
    eye = middle + (1.1 * height_m + 15.0) * out + (0.0, 0.25 * height_m, 0.0)
    azimuth = np.degrees(np.arctan2(-out[0], out[2]))
    camera = eye_level(eye, azimuth_deg=float(azimuth), pitch_deg=-12.0)
    near = np.linalg.norm(tiles.vertices - middle, axis=1) < REACH_M
    chosen = near[tiles.faces].all(axis=1)
    faces = tiles.faces[chosen].astype(np.int32)
    tinted = np.array(PALETTE, np.uint8)[tiles.tile[chosen] % len(PALETTE)]
    bare = np.full_like(tinted, 190)
    pictures = [
        render_mesh(tiles.vertices, faces, camera, size, face_colours=colours, supersample=2)
        for colours in (tinted, bare)
    ]
    return np.concatenate(pictures, axis=1)


if __name__ == "__main__":
    sys.exit(main())
