"""Regions: how well every engine finds what a person would draw.

Truth is the true surface of procedural quarries, each face with its material, photographed with
more and more noise, shadow and less contrast; the true regions are those of
``terraport_pipeline/synth/truth_regions.py``. Real surveys: ``drawn_regions.py``.

Engines were tuned on seeds 3 to 6; the seeds here are others.

    python benchmarks/region_engines.py
    python benchmarks/region_engines.py --smoke

Prints Markdown; ``--json FILE`` appends one line per engine and scene.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyInt
from terraport_pipeline.geometry.borders.border_segmenter import BorderSegmenter
from terraport_pipeline.geometry.graph.felzenszwalb import FelzenszwalbSegmenter
from terraport_pipeline.geometry.graph.graph_options import COLOUR_GRAPH, SHAPE_GRAPH
from terraport_pipeline.geometry.graph.graph_segmenter import GraphSegmenter
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.colour import face_lab
from terraport_pipeline.geometry.regions.engine_options import TrianglePoolOptions
from terraport_pipeline.geometry.regions.grid_segmenter import GridSegmenter
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh
from terraport_pipeline.synth.truth_regions import true_regions
from terraport_research.boundary_scores import boundary_score
from terraport_research.cutters import COLOUR_CUTTERS, Body
from terraport_research.segmentation_scores import consistency_errors, rand_error

SEEDS: Final = (11, 12, 13)
EDGE_M: Final = 2.6
"""Longest edge: about 140,000 faces."""
CLEAN: Final = QuarryOptions(shadows=0.0, colour_noise=0.0)
SCENES: Final[dict[str, dict[str, float]]] = {
    "clean": {},
    "noise 4": {"colour_noise": 4.0},
    "noise 8": {"colour_noise": 8.0},
    "noise 12": {"colour_noise": 12.0},
    "shadow .3": {"shadows": 0.3},
    "shadow .6": {"shadows": 0.6},
    "contrast .75": {"contrast": 0.75},
    "contrast .5": {"contrast": 0.5},
    "photo": {"colour_noise": 4.0, "shadows": 0.45},
}
"""Colour options of each scene; "photo" is what the sample quarry has."""
BORDER_EDGES: Final = 2.0
"""A border is found within this many mean edge lengths."""

Engine = Callable[[SegmenterMesh], AnyInt]
Row = dict[str, Any]


def pools(mesh: SegmenterMesh, **options: Any) -> AnyInt:
    """Pools of the Triangle Pool Algorithm."""
    assert mesh.pairs is not None
    return triangle_pools(
        mesh.vertices,
        mesh.faces,
        colours=None if mesh.scalar is not None else mesh.colours,
        scalar=mesh.scalar,
        options=TrianglePoolOptions(**options),
        pairs=mesh.pairs[0],
    ).labels


def stretched(mesh: SegmenterMesh, axis: tuple[float, float, float], **options: Any) -> AnyInt:
    """Pools of one CIELAB axis, its middle 99 %: a few extreme colours do not stretch it."""
    assert mesh.colours is not None
    value = face_lab(mesh.colours, mesh.faces, 64.0) @ np.array(axis)
    scalar = np.clip(value, *np.percentile(value, [0.5, 99.5]))
    return pools(replace(mesh, scalar=scalar), **options)


def graph(options: Any) -> Engine:
    """Regions of the graph engine."""
    return lambda mesh: GraphSegmenter(options).segment(mesh).regions


def means(**options: Any) -> Engine:
    """Regions by mean colour."""
    return lambda mesh: MeanColourSegmenter(**options).segment(mesh).regions


def felzenszwalb(scale: float) -> Engine:
    """Regions of Felzenszwalb and Huttenlocher."""
    return lambda mesh: FelzenszwalbSegmenter(region_scale=scale).segment(mesh).regions


def compared(key: str) -> Engine:
    """Segments of an algorithm that the thesis describes."""

    def engine(mesh: SegmenterMesh) -> AnyInt:
        body = Body(mesh.vertices.astype(np.float64), mesh.faces, colours=mesh.colours)
        return COLOUR_CUTTERS[key].prepare(body)(0)

    return engine


BRIGHT_EDGES = replace(COLOUR_GRAPH, weights=replace(COLOUR_GRAPH.weights, lightness=1.0))
ENGINES: Final[dict[str, Engine]] = {
    "one region": lambda mesh: np.zeros(len(mesh.faces), np.int32),
    "grid": lambda mesh: GridSegmenter().segment(mesh).regions,
    "TPA as published": pools,
    "TPA, sTh .002": lambda mesh: pools(mesh, small_threshold=0.002),
    "TPA, Th .35, sTh .002": lambda mesh: pools(mesh, threshold=0.35, small_threshold=0.002),
    "TPA, Th .35, sTh .002, tau 0": lambda mesh: pools(
        mesh, threshold=0.35, small_threshold=0.002, tau=0.0
    ),
    "TPA of L*, 99 %, Th .5, sTh .002": lambda mesh: stretched(
        mesh, (1, 0, 0), threshold=0.5, small_threshold=0.002
    ),
    "TPA of b*, 99 %, Th .5, sTh .002": lambda mesh: stretched(
        mesh, (0, 0, 1), threshold=0.5, small_threshold=0.002
    ),
    "Felzenszwalb, k 30": felzenszwalb(30.0),
    "Felzenszwalb, k 100": felzenszwalb(100.0),
    "Felzenszwalb, k 300": felzenszwalb(300.0),
    "region growing on RGB": compared("colour-growing"),
    "double threshold": compared("double-threshold"),
    "graph": graph(COLOUR_GRAPH),
    "graph, lightness 1": graph(BRIGHT_EDGES),
    "graph without colour": graph(SHAPE_GRAPH),
    "borders": lambda mesh: BorderSegmenter().segment(mesh).regions,
    "means": means(),
    "means, lightness 1": means(lightness=1.0),
    "means, leak 0": means(leak=0.0),
}


def quarry(scene: str, seed: int, edge_m: float) -> tuple[SegmenterMesh, dict[str, AnyInt]]:
    """Mesh and true regions of a procedural quarry."""
    surface = truth_mesh(replace(CLEAN, seed=seed, **SCENES[scene]), edge_m)
    pairs = face_pairs(surface.faces, len(surface.vertices))
    mesh = SegmenterMesh(surface.vertices, surface.faces, surface.colours, pairs=pairs)
    return mesh, {
        "visible": true_regions(surface, *pairs, "visible"),
        "material": true_regions(surface, *pairs, "material"),
    }


def score(mesh: SegmenterMesh, truths: dict[str, AnyInt], engine: Engine) -> Row:
    """Run one engine and score its regions; faces of negative truth are not scored."""
    assert mesh.pairs is not None
    start = time.process_time()
    labels = engine(mesh)
    row: Row = {"cpu_s": round(time.process_time() - start, 3)}
    row["regions"] = len(np.unique(labels))
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.sqrt((normal * normal).sum(axis=1))
    edge = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
    for name, truth in truths.items():
        labelled = truth >= 0
        row[f"{name}_true_regions"] = len(np.unique(truth[labelled]))
        row[f"{name}_error"] = rand_error(truth[labelled], labels[labelled])
        row[f"{name}_area_error"] = rand_error(truth[labelled], labels[labelled], area[labelled])
        row[f"{name}_gce"], row[f"{name}_lce"] = consistency_errors(
            truth[labelled], labels[labelled], area[labelled]
        )
        if labelled.all():
            border = boundary_score(mesh.vertices, *mesh.pairs, truth, labels, BORDER_EDGES * edge)
            row[f"{name}_recall"], row[f"{name}_precision"] = border.recall, border.precision
    return row


def table(title: str, rows: list[Row], value: Callable[[list[Row]], str]) -> None:
    """Print engines down, scenes across."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    print(f"\n**{title}**\n\n| engine | {' | '.join(scenes)} |")
    print("|---" * (len(scenes) + 1) + "|")
    for engine in dict.fromkeys(row["engine"] for row in rows):
        cells = [
            value([r for r in rows if r["engine"] == engine and r["scene"] == scene])
            for scene in scenes
        ]
        print(f"| {engine} | " + " | ".join(cells) + " |")


def mean(key: str, form: str = ".3f") -> Callable[[list[Row]], str]:
    """Cell of the mean over seeds."""
    return lambda rows: format(float(np.mean([row[key] for row in rows])), form)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--edge", type=float, default=EDGE_M, help="longest edge, metres")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--engines", nargs="+", choices=list(ENGINES), default=list(ENGINES))
    parser.add_argument("--json", type=Path, help="append one line of JSON per engine and scene")
    parser.add_argument("--smoke", action="store_true", help="one small quarry")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.seeds, arguments.edge = [SEEDS[0]], 8.0
        arguments.scenes = ["clean", "photo"]
    rows: list[Row] = []

    def run(scene: str, seed: int, mesh: SegmenterMesh, truths: dict[str, AnyInt]) -> None:
        for engine in arguments.engines:
            row = {"engine": engine, "scene": scene, "seed": seed, "faces": len(mesh.faces)}
            row |= score(mesh, truths, ENGINES[engine])
            rows.append(row)
            if arguments.json:
                with arguments.json.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")

    for scene in arguments.scenes:
        for seed in arguments.seeds:
            run(scene, seed, *quarry(scene, seed, arguments.edge))
    truth = {row["seed"]: (row["faces"], row["visible_true_regions"]) for row in rows}
    print(f"Quarries, seed: (faces, true regions): {truth}")
    table("1 - RI, visible materials", rows, mean("visible_error"))
    table("1 - RI, visible materials, by area", rows, mean("visible_area_error"))
    table("1 - RI, all materials", rows, mean("material_error"))
    table("boundary recall, visible", rows, mean("visible_recall", ".2f"))
    table("boundary precision, visible", rows, mean("visible_precision", ".2f"))
    table("regions found", rows, mean("regions", ".0f"))
    table("CPU seconds", rows, mean("cpu_s", ".2f"))


if __name__ == "__main__":
    main()
