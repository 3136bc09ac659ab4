"""Distance between the reconstructed detail and the truth, per octree depth and point weight.

python benchmarks/reconstruction_accuracy.py                 100 k points, depth of the rule
python benchmarks/reconstruction_accuracy.py --points 1M --less 0,1 --weights 2,4,8
python benchmarks/reconstruction_accuracy.py --points 1M --tile-depth 8     in many tiles
python benchmarks/reconstruction_accuracy.py --meshes WORK --survey quarry.laz    of a build
python benchmarks/reconstruction_accuracy.py --smoke         15 k points

Two ways: from the detail's vertices to the true surface (what was invented), and from the true
places of the samples to the detail (what was lost). The goal is a 95th percentile of 1.5 spacings
both ways. One line per run, as JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from parts.first_steps import read_and_clean
from parts.work_arrays import read_tiles, spacing_of

from terraport_pipeline.engines import poisson
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.option import parse_count
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.synth.files import load_options, truth_path, write_quarry
from terraport_pipeline.synth.options import MIN_POINTS, QuarryOptions
from terraport_pipeline.synth.quarry import Quarry, synthesise
from terraport_pipeline.workflow.reconstruct_step import reconstruct_tiles
from terraport_pipeline.workflow.tile_ground import prepare

SAMPLES = 50_000
"""Places measured each way: the 95th percentile rests on 2,500."""


def measure(
    quarry: Quarry, truth: np.ndarray, detail: Any, origin: np.ndarray, spacing_m: float
) -> dict[str, float]:
    """Distances both ways, in millimetres and in spacings; `truth` are the samples' true places."""
    rng = np.random.default_rng(1)
    vertices, faces = detail
    rows = rng.choice(len(vertices), min(SAMPLES, len(vertices)), replace=False)
    local = vertices[np.sort(rows)].astype(np.float64)
    places = origin + np.stack([local[:, 0], -local[:, 2], local[:, 1]], axis=1)
    invented = quarry.distance_m(places)
    rows = rng.choice(len(truth), min(SAMPLES, len(truth)), replace=False)
    seen = truth[np.sort(rows)] - origin
    scene = np.stack([seen[:, 0], seen[:, 2], -seen[:, 1]], axis=1).astype(np.float32)
    lost = distances_to_mesh(scene, vertices, faces)
    figures: dict[str, float] = {}
    for name, distance_m in (("mesh_to_truth", invented), ("truth_to_mesh", lost)):
        for percentile in (50, 95, 99):
            figures[f"{name}_p{percentile}_mm"] = round(
                1000 * float(np.percentile(distance_m, percentile)), 1
            )
        figures[f"{name}_p95_spacings"] = round(float(np.percentile(distance_m, 95)) / spacing_m, 3)
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", default="100k")
    parser.add_argument("--weights", default="2,4,8", help="point weights")
    parser.add_argument("--less", default="0", help="depths below the rule's: 0,1")
    parser.add_argument("--tile-depth", type=int, help="as of the build; by memory otherwise")
    parser.add_argument("--survey", type=Path, help="survey of terraport synth, with --meshes")
    parser.add_argument("--meshes", type=Path, help="work directory of its build")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    # A finished build, however large: only its accuracy is measured.
    if arguments.meshes is not None:
        work = arguments.meshes
        quarry, truth = _truth_of(arguments.survey)
        tiles = read_tiles(work)
        spacing_m = spacing_of(work)
        detail = (tiles.vertices, tiles.faces.astype(np.int32))
        figures = measure(quarry, truth, detail, np.load(work / "clean" / "origin.npy"), spacing_m)
        print(json.dumps({"points": len(truth), "spacing_m": spacing_m, **figures}))
        return 0
    # A quarry of its own, reconstructed with every depth and point weight.
    points = 15_000 if arguments.smoke else parse_count(arguments.points)
    weights = "4" if arguments.smoke else arguments.weights
    tile_options = TileOptions(depth=arguments.tile_depth)
    missed = 0
    with tempfile.TemporaryDirectory(prefix="benchmark-accuracy-") as scratch:
        # (1) The survey in a work directory, as a build has it before it reconstructs.
        survey = Path(scratch, "quarry.las")
        write_quarry(QuarryOptions(points=points), survey)
        quarry, truth = _truth_of(survey)
        runner, read, cleaned = read_and_clean(survey, Path(scratch, "work"))
        by_rule = prepare(
            runner, read, cleaned, clean.Options(), reconstruct.Options(), tile_options
        )
        extent_m = poisson.SCALE * by_rule.measured["extent_m"]
        rule = math.floor(math.log2(extent_m / by_rule.lattice.cell_m))
        # (2) Every depth and weight, from the samples in tiles to the base.
        for less in map(int, arguments.less.split(",")):
            for weight in map(float, weights.split(",")):
                options = reconstruct.Options(
                    detail_depth=rule - less, point_weight=weight, base_faces=20_000
                )
                before = _cpu_seconds()
                ground = prepare(runner, read, cleaned, clean.Options(), options, tile_options)
                surface = reconstruct_tiles(runner, ground).surface
                spent = _cpu_seconds() - before
                mesh, spacing_m = _detail_of(surface.tiles), ground.measured["spacing_m"]
                figures = measure(quarry, truth, mesh, ground.origin, spacing_m)
                row = {
                    "points": points,
                    "spacing_m": round(spacing_m, 4),
                    "depth": rule - less,
                    "tiles": surface.tiles.count,
                    "weight": weight,
                    "faces": len(mesh[1]),
                    "cpu_s": round(spent, 1),
                    **figures,
                }
                missed += max(row[f"{way}_p95_spacings"] for way in _WAYS) > 1.5
                print(json.dumps(row), flush=True)
    return int(missed > 0)


def _truth_of(survey: Path) -> tuple[Quarry, np.ndarray]:
    """Give a survey's true surface and the true places of its samples."""
    file = truth_path(survey)
    # The surface is the same however many points are taken; their places are in the file.
    quarry = synthesise(replace(load_options(file), points=MIN_POINTS))
    with np.load(file) as arrays:
        return quarry, arrays["truth_m"] + arrays["origin"]


def _detail_of(tiles: DetailTiles) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of all tiles; what tiles share stands in each."""
    meshes = [tiles.load(i) for i in range(tiles.count)]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return (
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.faces + np.int32(at) for mesh, at in zip(meshes, starts, strict=False)]
        ),
    )


_WAYS = ("mesh_to_truth", "truth_to_mesh")


def _cpu_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


if __name__ == "__main__":
    sys.exit(main())
