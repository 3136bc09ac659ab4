"""Segments: what a landing fetches in vain, and how well segments keep to true borders.

The same quarry is cut into streamable segments in several ways: from the pools and regions of every
engine (``geometry/segments/segments.py`` merges and splits them within the bounds), from a plain
grid with and without those bounds, and as the thesis has it (every fine pool a segment).

Landings: random places on the surface, a radius; fetched is every segment whose box comes within
the radius, wanted are the faces whose middle lies within it. *Over-fetch* is fetched faces that are
not wanted over wanted ones. *Purity* is the share of the area that lies in the true region most of
its segment lies in; *recall* the share of the true border that a segment's border follows.

    python benchmarks/segments.py
    python benchmarks/segments.py --smoke

Prints Markdown.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float64, Int64
from terraport_pipeline.geometry.graph.felzenszwalb import FelzenszwalbSegmenter
from terraport_pipeline.geometry.graph.graph_options import COLOUR_GRAPH
from terraport_pipeline.geometry.graph.graph_segmenter import GraphSegmenter
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import automatic_extent, face_centres
from terraport_pipeline.geometry.regions.grid_segmenter import GridSegmenter, grid_cells
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import (
    Segmentation,
    SegmenterMesh,
    TriangleSegmenter,
)
from terraport_pipeline.geometry.segments.segments import SegmentOptions, Segments, build_segments
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh
from terraport_pipeline.synth.truth_regions import true_regions
from terraport_research.boundary_scores import boundary_score

SEEDS: Final = (11, 12)
LANDINGS: Final = 1000
RADII_M: Final = (20.0, 50.0)
BORDER_EDGES: Final = 2.0
Row = dict[str, Any]


def without_regions(segmentation: Segmentation) -> Segmentation:
    """Put all faces into one region: borders of regions are not respected."""
    return replace(segmentation, regions=np.zeros_like(segmentation.regions), region_count=1)


def ways(mesh: SegmenterMesh, bounds: SegmentOptions) -> dict[str, Segments]:
    """Segments of every way, by name."""
    assert mesh.pairs is not None
    pairs, surface = mesh.pairs, (mesh.vertices, mesh.faces)

    def build(segmentation: Segmentation, options: SegmentOptions = bounds) -> Segments:
        return build_segments(
            mesh.vertices, mesh.faces, segmentation.fine, segmentation.similarity,
            segmentation.regions, options, pairs=pairs,
        )  # fmt: skip

    tpa = TriangleSegmenter().segment(mesh)
    means = MeanColourSegmenter().segment(mesh)
    # cells of half the most faces leave room for slopes and for merging
    plan = np.ptp(mesh.vertices[:, [0, 2]], axis=0)
    cell_m = float(np.sqrt(plan[0] * plan[1] * bounds.max_faces / 2 / len(mesh.faces)))
    grid = without_regions(GridSegmenter(fine_cell_m=cell_m).segment(mesh))
    cells = replace(grid, fine=grid_cells(mesh.vertices, mesh.faces, cell_m))
    alone = replace(bounds, units="pools")
    # a build's fine pools have half the faces of its least segment
    graph_options = replace(COLOUR_GRAPH, fine_faces=max(bounds.min_faces // 2, 1))
    graph = GraphSegmenter(graph_options).segment(mesh)
    large = GraphSegmenter(replace(COLOUR_GRAPH, fine_faces=bounds.max_faces * 2 // 5)).segment(
        mesh
    )
    extent_m = automatic_extent(*surface, bounds.max_faces)
    wide = replace(bounds, max_extent_m=extent_m / 0.6)  # the first default
    narrow = replace(bounds, max_extent_m=extent_m / 1.2)
    return {
        "TPA pools, one segment each (thesis)": build(tpa, alone),
        "grid cells as they are": build(cells, alone),
        "grid, within bounds": build(grid),
        "Felzenszwalb": build(FelzenszwalbSegmenter().segment(mesh)),
        "graph": build(graph),
        "graph, pools of up to .4 most": build(large),
        "graph pools, regions of means": build(
            replace(graph, regions=means.regions, region_count=means.region_count)
        ),
        "TPA": build(tpa),
        "TPA, wide": build(tpa, wide),
        "means": build(means),
        "means, wide": build(means, wide),
        "means, narrow": build(means, narrow),
        "graph, narrow": build(graph, narrow),
        "TPA pools, regions of means": build(
            replace(tpa, regions=means.regions, region_count=means.region_count)
        ),
        "TPA pools, no regions": build(without_regions(tpa)),
    }


def over_fetch(
    segments: Segments, landings: Float64, needed: Int64, r: float
) -> tuple[float, float]:
    """Mean over-fetch and mean number of segments over the landings."""
    low, high = segments.bounds[:, :3].astype(np.float64), segments.bounds[:, 3:]
    gap = np.maximum(low[None] - landings[:, None], 0.0)
    np.maximum(gap, landings[:, None] - high[None], out=gap)
    hit = (gap * gap).sum(axis=2) <= r * r
    fetched = hit @ segments.face_counts.astype(np.int64)
    return float(((fetched - needed) / np.maximum(needed, 1)).mean()), float(hit.sum(axis=1).mean())


def measure(seed: int, edge_m: float, bounds: SegmentOptions) -> list[Row]:
    """Every way on one quarry."""
    surface = truth_mesh(QuarryOptions(seed=seed), edge_m)
    pairs = face_pairs(surface.faces, len(surface.vertices))
    mesh = SegmenterMesh(surface.vertices, surface.faces, surface.colours, pairs=pairs)
    truth = true_regions(surface, *pairs)
    corners = surface.vertices.astype(np.float64)[surface.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.sqrt((normal * normal).sum(axis=1))
    centres = face_centres(surface.vertices, surface.faces)
    chosen = np.random.default_rng(seed).choice(len(area), LANDINGS, p=area / area.sum())
    tree = cKDTree(centres)
    needed = {r: tree.query_ball_point(centres[chosen], r, return_length=True) for r in RADII_M}
    edge = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
    rows = []
    for name, segments in ways(mesh, bounds).items():
        extent = (segments.bounds[:, 3:] - segments.bounds[:, :3]).max(axis=1)
        common = np.zeros((segments.count, int(truth.max()) + 1))
        np.add.at(common, (segments.labels, truth), area)
        border = boundary_score(
            surface.vertices, *pairs, truth, segments.labels, BORDER_EDGES * edge
        )
        row: Row = {
            "way": name,
            "mesh_faces": len(surface.faces),
            "segments": segments.count,
            "faces 5 %": np.percentile(segments.face_counts, 5),
            "faces 50 %": np.percentile(segments.face_counts, 50),
            "faces most": int(segments.face_counts.max()),
            "extent 50 % (m)": float(np.median(extent)),
            "extent 95 % (m)": float(np.percentile(extent, 95)),
            "below bounds": segments.exceptions.below_min_faces,
        }
        for r in RADII_M:
            beyond, hits = over_fetch(segments, centres[chosen], needed[r], r)
            row[f"over-fetch {r:g} m"], row[f"fetched {r:g} m"] = beyond, hits
        row["purity"] = float(common.max(axis=1).sum() / area.sum())
        row["recall"] = border.recall
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--edge", type=float, default=1.6, help="longest edge, metres")
    parser.add_argument("--min-faces", type=int, default=500, help="a quarter of a build's")
    parser.add_argument("--max-faces", type=int, default=5000, help="a quarter of a build's")
    parser.add_argument("--smoke", action="store_true", help="one small quarry")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.seeds, arguments.edge = [SEEDS[0]], 8.0
    bounds = SegmentOptions(min_faces=arguments.min_faces, max_faces=arguments.max_faces)
    start = time.process_time()
    rows = [row for seed in arguments.seeds for row in measure(seed, arguments.edge, bounds)]
    names = [key for key in rows[0] if key not in ("way", "mesh_faces")]
    print(
        f"{len(arguments.seeds)} quarries of {rows[0]['mesh_faces']:,} faces, bounds "
        f"{bounds.min_faces} to {bounds.max_faces}, {LANDINGS} landings each, means\n"
    )
    print(f"| segments from | {' | '.join(names)} |")
    print("|---" * (len(names) + 1) + "|")
    for way in dict.fromkeys(row["way"] for row in rows):
        mean = [float(np.mean([row[name] for row in rows if row["way"] == way])) for name in names]
        print(
            f"| {way} | " + " | ".join(f"{v:.0f}" if v >= 20 else f"{v:.2f}" for v in mean) + " |"
        )
    print(f"\n{time.process_time() - start:.0f} CPU seconds")


if __name__ == "__main__":
    main()
