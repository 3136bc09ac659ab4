"""Do regions end at the borders of tiles? A reconstructed surface, whole and cut into tiles.

Takes the detail of a finished build, finds its regions whole and in tiles, and says how often an
edge between two faces parts two regions: at the tiles' borders, at the same edges of the whole,
and elsewhere; and 1 - RI of the two partitions.

    python benchmarks/tiled_regions.py SCENES/.quarry5m.work --tiles 4 --rings 0 8 12

``--smoke`` takes a small quarry that the project makes instead of a build.

Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from parts.work_arrays import read_tiles, welded

from terraport_payload.types import AnyArray, Float32, Int32, Int64, UInt8
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import longest_edge
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_pipeline.geometry.tiles import tiled_means
from terraport_pipeline.geometry.tiles.tile_seams import match_seams, open_edges
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh

TileMesh = tuple[Float32, Int32, UInt8]


def cut(mesh: TileMesh, along: int) -> tuple[list[TileMesh], Int64]:
    """Cut a mesh into along x along tiles by the middles of its faces."""
    vertices, faces, colours = mesh
    middle = vertices[faces][:, :, [0, 2]].mean(axis=1)
    low, high = middle.min(axis=0), middle.max(axis=0)
    cell = np.minimum(((middle - low) / (high - low) * along).astype(np.int64), along - 1)
    _, tile = np.unique(cell[:, 0] * along + cell[:, 1], return_inverse=True)
    meshes = []
    for number in range(int(tile.max()) + 1):
        used, corner = np.unique(faces[tile == number], return_inverse=True)
        meshes.append((vertices[used], corner.reshape(-1, 3).astype(np.int32), colours[used]))
    return meshes, tile.astype(np.int64)


def regions_by_tiles(meshes: list[TileMesh], tile: Int64, ring: int) -> Int32:
    """Find regions tile by tile, as a tiled build does."""
    pairs = [face_pairs(faces, len(vertices)) for vertices, faces, _ in meshes]
    seams = match_seams([open_edges(p[0], p[1], q) for p, q in zip(meshes, pairs, strict=True)])
    totals, longest = None, float(seams.length_m.max(initial=0.0))
    for (vertices, faces, colours), (_, edges) in zip(meshes, pairs, strict=True):
        tile_totals = ColourTotals.of(tiled_means.colours_of_faces(colours, faces))
        totals = tile_totals if totals is None else totals.plus(tile_totals)
        longest = max(longest, longest_edge(vertices, edges))
    assert totals is not None
    scale = tiled_means.MeansScale(MeanColourSegmenter(), totals, longest, ring)
    units_of_tiles = [
        tiled_means.tile_units(*mesh, near, seams.of(number), scale)
        for number, (mesh, near) in enumerate(zip(meshes, pairs, strict=True))
    ]
    sides = np.zeros(seams.faces.shape, np.int32)
    for number, units in enumerate(units_of_tiles):
        for side in (0, 1):
            rows = seams.tiles[:, side] == number
            sides[rows, side] = units.labels[seams.faces[rows, side]]
    joined = tiled_means.join_tiles(units_of_tiles, sides, seams, scale)
    regions = np.empty(len(tile), np.int32)
    for number, (units, region) in enumerate(zip(units_of_tiles, joined.region, strict=True)):
        regions[tile == number] = region[units.labels]
    return regions


def rand_distance(first: Int32, second: Int32) -> float:
    """1 - RI, each face counting once."""

    def pairs(labels: AnyArray) -> float:
        count = np.unique(labels, return_counts=True)[1].astype(float)
        return float((count * (count - 1) / 2).sum())

    both = pairs(first.astype(np.int64) * (int(second.max()) + 1) + second)
    return (pairs(first) + pairs(second) - 2 * both) / (len(first) * (len(first) - 1) / 2)


def main(arguments: list[str]) -> None:
    """Segment the whole and its tiles, and print how far the two differ as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("work", type=Path, nargs="?", help="work directory of a finished build")
    parser.add_argument("--smoke", action="store_true", help="a small quarry: does it run?")
    parser.add_argument("--tiles", type=int, default=4, help="tiles along each side")
    parser.add_argument("--rings", type=int, nargs="*", default=[tiled_means.RING])
    options = parser.parse_args(arguments)
    # The surface: a small quarry, or the detail of a finished build.
    if options.smoke:
        surface = truth_mesh(QuarryOptions(seed=1, size_m=60.0), 1.0)
    elif options.work is None:
        parser.error("expected a work directory, or --smoke")
    else:
        surface = welded(read_tiles(options.work))
    vertices, faces, colours = surface.vertices, surface.faces, surface.colours
    # Regions of the whole, as what those of the tiles are compared with.
    pairs = face_pairs(faces, len(vertices))
    whole = MeanColourSegmenter().segment(SegmenterMesh(vertices, faces, colours, pairs=pairs))
    meshes, tile = cut((vertices, faces, colours), options.tiles)
    at_border = tile[pairs[0][:, 0]] != tile[pairs[0][:, 1]]

    def rates(labels: Int32) -> tuple[float, float]:
        parted = labels[pairs[0][:, 0]] != labels[pairs[0][:, 1]]
        return float(parted[at_border].mean()), float(parted[~at_border].mean())

    # With each width of ring around a tile.
    rows = []
    for ring in options.rings:
        begin = time.process_time()
        regions = regions_by_tiles(meshes, tile, ring)
        rows.append(
            {
                "ring": ring,
                "cpu_s": round(time.process_time() - begin, 2),
                "regions": int(regions.max()) + 1,
                "parted_at_borders": rates(regions)[0],
                "parted_elsewhere": rates(regions)[1],
                "one_minus_rand_index": rand_distance(whole.regions, regions),
            }
        )
    result = {
        "faces": len(faces),
        "tiles": len(meshes),
        "border_edges": int(at_border.sum()),
        "whole": {
            "regions": whole.region_count,
            "parted_at_borders": rates(whole.regions)[0],
            "parted_elsewhere": rates(whole.regions)[1],
        },
        "tiled": rows,
    }
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main(sys.argv[1:])
