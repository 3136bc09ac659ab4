"""How near the detail comes to samples that it was not fitted to, per point weight.

python benchmarks/point_weight.py .apaxco_quarry.work ...     work directories of builds
python benchmarks/point_weight.py --smoke                     a small synthetic quarry

A tenth of the samples about a cloud's middle is held out; a build's cloud is the copy that it thins
to 1.5 million samples. Weights that follow the noise lie nearer
to the samples they were fitted to and no nearer to the others, and fold the surface more. One line
per cloud and weight, as JSON: millimetres, degrees, CPU seconds.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from terraport_pipeline.engines import poisson
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise

_FITTED_MEASURED = 4000
_SUPPORT_SPACINGS = 2.0
_RIM_SPACINGS = 5.0
"""Held-out samples this near to the crop's rim do not count: the surface bends away there."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("builds", nargs="*", type=Path, help="work directories of builds")
    parser.add_argument("--samples", type=int, default=40_000, help="about the cloud's middle")
    parser.add_argument("--weights", default="2,4,8")
    parser.add_argument("--smoke", action="store_true")
    options = parser.parse_args()
    clouds = [_stored(work) for work in options.builds] or [_synthetic()]
    weights = [4.0] if options.smoke else [float(weight) for weight in options.weights.split(",")]
    with tempfile.TemporaryDirectory(prefix="benchmark-weight-") as scratch:
        for name, points, normals, spacing_m in clouds:
            for row in _measure(points, normals, spacing_m, options.samples, weights, scratch):
                print(json.dumps({"cloud": name, **row}), flush=True)
    return 0


def _stored(work: Path) -> tuple[str, np.ndarray, np.ndarray, float]:
    points, normals = (np.load(work / "clean" / f"{name}.npy") for name in ("points", "normals"))
    spacing_m = json.loads((work / "clean" / "stage.json").read_text())["values"]["spacing_m"]
    return work.name.removeprefix(".").removesuffix(".work"), points, normals, float(spacing_m)


def _synthetic() -> tuple[str, np.ndarray, np.ndarray, float]:
    survey = synthesise(QuarryOptions(points=15_000)).survey
    with tempfile.TemporaryDirectory() as scratch:
        cloud = clean.run(survey, clean.Options(), Context(Path(scratch))).cloud
    return "quarry", cloud.points, cloud.normals, cloud.spacing_m


def _measure(
    points: np.ndarray,
    normals: np.ndarray,
    spacing_m: float,
    samples: int,
    weights: list[float],
    scratch: str,
) -> Any:
    # The square about the middle that holds as many samples as were asked for.
    away_m = np.abs(points[:, [0, 2]] - np.median(points, axis=0)[[0, 2]]).max(axis=1)
    half_m = float(np.sort(away_m)[min(samples, len(points)) - 1])
    rows = np.flatnonzero(away_m <= half_m)
    # A tenth is held out; at the rim a surface without neighbours says nothing of the weight.
    held_out = np.random.default_rng(1).random(len(rows)) < 0.1
    fitted, unseen = rows[~held_out], rows[held_out]
    unseen = unseen[away_m[unseen] < half_m - _RIM_SPACINGS * spacing_m]
    tree = cKDTree(points[fitted])
    depth = poisson.depth_for(13, float(np.ptp(points[fitted], axis=0).max()), spacing_m)
    for weight in weights:
        before = _cpu_seconds()
        vertices, faces = poisson.reconstruct(
            points[fitted],
            normals[fitted],
            depth,
            Path(scratch),
            point_weight=weight,
        )
        row = {"spacing_mm": round(1000 * spacing_m, 1), "depth": depth, "weight": weight}
        row["cpu_s"] = round(_cpu_seconds() - before, 1)
        # Only faces that samples support are measured.
        near = tree.query(vertices)[0] < _SUPPORT_SPACINGS * spacing_m
        faces = faces[near[faces].all(axis=1)]
        row["faces"] = len(faces)
        own = fitted[:: max(1, len(fitted) // _FITTED_MEASURED)]
        for name, some in (("held_out", unseen), ("fitted", own)):
            distance_m = distances_to_mesh(points[some], vertices, faces)
            for percentile in (50, 95):
                value = 1000 * float(np.percentile(distance_m, percentile))
                row[f"{name}_p{percentile}_mm"] = round(value, 2)
        # Roughness: how far neighbouring faces fold.
        pairs, _ = face_pairs(faces, len(vertices))
        a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
        facing = np.cross(b - a, c - a)
        facing /= np.maximum(np.linalg.norm(facing, axis=1), np.finfo(np.float64).tiny)[:, None]
        cosine = (facing[pairs[:, 0]] * facing[pairs[:, 1]]).sum(axis=1)
        fold = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        row["fold_mean_deg"] = round(float(fold.mean()), 2)
        row["fold_p95_deg"] = round(float(np.percentile(fold, 95)), 2)
        yield row


def _cpu_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


if __name__ == "__main__":
    sys.exit(main())
