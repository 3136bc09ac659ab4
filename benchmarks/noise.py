"""Faces and distance to the truth of noisy clouds: today's cells against cells that follow noise.

python benchmarks/noise.py                          a bench of the quarry, 70 k of 1 M points
python benchmarks/noise.py --points 5M --noise 1,2  the same of a denser survey
python benchmarks/noise.py --surveys A.laz B.laz    what surveys measure, and their faces per point
python benchmarks/noise.py --smoke                  15 k points

Noise is normal, of so many spacings on each axis. Every cloud is measured and solved as a tile is
(`solve_tile`), and cut to 2.5 local spacings. *depth*: cells of one areal spacing by 16 neighbours
(the middle of what whole octree depths gave), normals of 16 neighbours. *cell*: cells by density
and noise. *smooth*: and samples moved onto their surface. One line per run, as JSON; distances in
spacings of the clean cloud, root mean square and 95th percentile: of the surface from the truth,
of the samples' true places from the surface, and both within 2 spacings of the truth's sharp edges
(folds of the ground beyond 40 degrees).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from terraport_pipeline.engines.poisson import POINT_WEIGHT
from terraport_pipeline.geometry.clouds.detail_cell import detail_cell_m, smoothing_radius_m
from terraport_pipeline.geometry.clouds.outliers import mean_distances, usual_distance
from terraport_pipeline.geometry.clouds.spacing import estimate_spacing, nearest_neighbours
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.tiles.tile_plan import tile_shape
from terraport_pipeline.model import Cloud, to_scene
from terraport_pipeline.option import parse_count
from terraport_pipeline.stages import clean, measure_survey
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.stages.tiles import solve_tile
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import Quarry, synthesise

SAMPLES = 20_000
SUPPORT = 2.5
EDGE_SPACINGS = 2.0
RIM_SPACINGS = 5.0
"""The crop's rim is not measured: the surface bends away there."""
FOLD = np.cos(np.radians(40.0))
RULES = ("depth", "cell", "smooth")

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A square of the quarry about its densest folds, scene frame."""

    quarry: Quarry
    origin: Array
    centre: Array
    half_m: float
    points: Array
    """(N, 3) where samples truly lie."""
    spacing_m: float
    folds: cKDTree

    def inside(self, places: Array) -> Array:
        """Whether places lie farther from the rim than its effect."""
        away_m = np.abs(places[:, [0, 2]] - self.centre).max(axis=1)
        inner: Array = away_m < self.half_m - RIM_SPACINGS * self.spacing_m
        return inner

    def truth_m(self, places: Array) -> Array:
        """Measure the distance to the true surface."""
        return self.quarry.distance_m(to_crs(places) + self.origin)

    def near_folds(self, places: Array) -> Array:
        """Whether places lie near a sharp edge of the truth."""
        reach_m = EDGE_SPACINGS * self.spacing_m
        near: Array = self.folds.query(places, distance_upper_bound=reach_m)[0] < reach_m
        return near


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", default="1M", help="of the whole quarry")
    parser.add_argument("--crop", default="70k", help="of them that are solved")
    parser.add_argument("--noise", default="0,0.3,1,2,3", help="spacings")
    parser.add_argument("--rules", default=",".join(RULES))
    parser.add_argument("--weight", type=float, default=POINT_WEIGHT)
    parser.add_argument("--surveys", nargs="*", type=Path)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    rules = arguments.rules.split(",")
    with tempfile.TemporaryDirectory(prefix="benchmark-noise-") as scratch:
        context = Context(Path(scratch), threads=2)
        if arguments.surveys:
            for row in survey_rows(arguments.surveys, parse_count(arguments.crop), rules, context):
                print(json.dumps(row), flush=True)
            return 0
        points, crop = ("15k", "15k") if arguments.smoke else (arguments.points, arguments.crop)
        bench = make_bench(parse_count(points), parse_count(crop))
        noises = "1" if arguments.smoke else arguments.noise
        for noise in map(float, noises.split(",")):
            rng = np.random.default_rng(1)
            cloud = bench.points + rng.normal(0.0, noise * bench.spacing_m, bench.points.shape)
            for rule in rules:
                vertices, faces, facts = solve(cloud, rule, arguments.weight, context)
                row = {"noise_spacings": noise, "rule": rule, **facts}
                print(json.dumps(row | score(bench, vertices, faces)), flush=True)
    return 0


def survey_rows(
    files: list[Path], crop: int, rules: list[str], context: Context
) -> Iterator[dict[str, Any]]:
    """Measure and solve the middle of every survey."""
    for file in files:
        survey = read_survey(file)
        places = to_scene(survey.points, np.median(survey.points, axis=0)).astype(np.float64)
        away_m = np.abs(places[:, [0, 2]]).max(axis=1)
        half_m = float(np.sort(away_m)[min(crop, len(places)) - 1])
        cloud = places[away_m <= half_m]
        for rule in rules:
            _, faces, facts = solve(cloud, rule, POINT_WEIGHT, context)
            faces_per_point = round(len(faces) / len(cloud), 2)
            yield {
                "survey": file.parent.name,
                "points": len(cloud),
                "rule": rule,
                **facts,
                "faces_per_point": faces_per_point,
            }


def make_bench(points: int, crop: int) -> Bench:
    """Cut a square out of the quarry where its ground folds most."""
    options = QuarryOptions(points=points, noise_m=0.0, outlier_fraction=0.0)
    quarry = synthesise(options)
    origin = np.array([options.easting_m, options.northing_m, options.elevation_m])
    true = to_scene(quarry.truth, origin).astype(np.float64)
    vertices, faces = quarry.surface_mesh(options.size_m / 500)
    folds = sharp_edges(to_scene(vertices, origin), faces)
    count, x, z = np.histogram2d(folds[:, 0], folds[:, 2], bins=8)
    i, j = np.unravel_index(int(count.argmax()), count.shape)
    centre = np.array([x[i : i + 2].mean(), z[j : j + 2].mean()])
    away_m = np.abs(true[:, [0, 2]] - centre).max(axis=1)
    half_m = float(np.sort(away_m)[min(crop, len(true)) - 1])
    own = true[away_m <= half_m]
    spacing_m = estimate_spacing(nearest_neighbours(own, 16, workers=2)).areal_m
    return Bench(quarry, origin, centre, half_m, own, spacing_m, cKDTree(folds))


def sharp_edges(vertices: Array, faces: Array) -> Array:
    """Middles of the ground's edges that fold sharply, (E, 3)."""
    normals, _ = normals_and_areas(vertices, faces)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    pairs = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    first, second = order[pairs], order[pairs + 1]
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(vertices),) * 2)
    _, body = connected_components(graph, directed=False)
    ground = body == np.bincount(body).argmax()
    folded = (normals[first // 3] * normals[second // 3]).sum(axis=1) < FOLD
    chosen = edges[first[folded & ground[edges[first, 0]]]]
    middles: Array = vertices[chosen].astype(np.float64).mean(axis=1)
    return middles


def to_crs(places: Array) -> Array:
    return np.stack([places[:, 0], -places[:, 2], places[:, 1]], axis=1)


def solve(
    cloud: Array, rule: str, weight: float, context: Context
) -> tuple[Array, Array, dict[str, Any]]:
    """Measure a cloud and solve it as one tile."""
    # (1) What a build measures.
    middle = (cloud.max(axis=0) + cloud.min(axis=0)) / 2
    file = context.scratch / "points.npy"
    np.save(file, to_crs(cloud - middle))
    neighbours = nearest_neighbours(cloud, 16, workers=context.threads)
    areal_m = estimate_spacing(neighbours).areal_m
    thinned = Cloud(
        (cloud - middle).astype(np.float32),
        np.zeros((len(cloud), 3), np.float32),
        np.zeros((len(cloud), 3), np.uint8),
        {},
        np.zeros(3),
        areal_m,
    )
    measured = measure_survey.run(file, thinned, 16, context).values
    spacing_m, noise_m = measured["surface_spacing_m"], measured["noise_m"]
    # (2) The cell, and a tile about the whole cloud.
    cell_m = measured["spacing_m"] if rule == "depth" else detail_cell_m(spacing_m, noise_m)
    radius_m = smoothing_radius_m(spacing_m, noise_m) if rule == "smooth" else 0.0
    extent_m = float(np.ptp(cloud, axis=0).max())
    shape = next(s for s in map(tile_shape, range(8, 15)) if s.core * cell_m > extent_m + cell_m)
    task = solve_tile.TileTask(
        depth=shape.depth,
        cell_m=cell_m,
        centre_cells=(0.0, 0.0, 0.0),
        anchor_m=(0.0, 0.0, 0.0),
        core_cells=shape.core,
        margin_cells=shape.margin,
        origin=(0.0, 0.0, 0.0),
        spacing_m=measured["spacing_m"],
        usual=usual_distance(mean_distances(neighbours)),
        columns=(),
        attributes=(),
        codes=(),
        has_colour=False,
        outlier_ratio=clean.Options().outlier_ratio,
        outlier_deviations=clean.Options().outlier_deviations,
        normal_neighbours=16,
        point_weight=weight,
        kept_ratio=SUPPORT,
        raster_low=(-extent_m, -extent_m),
        raster_cell_m=extent_m,
        noise_m=noise_m,
        smoothing_m=radius_m,
    )
    samples = np.zeros(len(cloud), solve_tile.sample_type([], has_colour=False))
    samples["position"] = np.load(file)
    before = time.process_time()
    arrays = solve_tile.run(task, samples, np.zeros((0, 3), np.float32), context).arrays
    facts = {
        "spacing_m": round(spacing_m, 4),
        "measured_noise_spacings": round(noise_m / spacing_m, 3),
        "cell_spacings": round(cell_m / spacing_m, 2),
        "radius_spacings": round(radius_m / spacing_m, 2),
        "own_cpu_s": round(time.process_time() - before, 1),
    }
    return arrays["vertices"] + middle, arrays["faces"], facts


def score(bench: Bench, vertices: Array, faces: Array) -> dict[str, float]:
    """Distances both ways, of all and near sharp edges."""
    rng = np.random.default_rng(1)
    faces = faces[bench.inside(vertices[faces].mean(axis=1))]
    own = bench.points[bench.inside(bench.points)]
    vertices = vertices.astype(np.float32)
    _, area_m2 = normals_and_areas(vertices, faces)
    chosen = rng.choice(len(faces), SAMPLES, p=area_m2 / area_m2.sum())
    weights = rng.dirichlet([1, 1, 1], SAMPLES)
    places = (vertices[faces[chosen]] * weights[:, :, None]).sum(axis=1).astype(np.float64)
    true = own[rng.choice(len(own), min(SAMPLES, len(own)), replace=False)]
    invented_m = bench.truth_m(places)
    lost_m = distances_to_mesh(true.astype(np.float32), vertices, faces)
    figures = {"faces_per_point": round(len(faces) / len(own), 2)}
    for name, distance_m in (
        ("surface", invented_m),
        ("truth", lost_m),
        ("edge_surface", invented_m[bench.near_folds(places)]),
        ("edge_truth", lost_m[bench.near_folds(true)]),
    ):
        spacings = distance_m / bench.spacing_m
        figures[f"{name}_rms"] = round(float(np.sqrt((spacings**2).mean())), 3)
        figures[f"{name}_p95"] = round(float(np.percentile(spacings, 95)), 3)
    return figures


def normals_and_areas(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normal (F, 3) and area (F,), square metres, of every face."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    doubled = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled, axis=1)
    return doubled / np.maximum(length, np.finfo(np.float64).tiny)[:, None], 0.5 * length


if __name__ == "__main__":
    sys.exit(main())
