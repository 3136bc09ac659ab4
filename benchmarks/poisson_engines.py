"""Screened Poisson by several libraries, on the same clouds at the same depths.

One process per run, so that memory is the library's own. Accuracy against the truth of the
synthetic quarry: from points on the reconstructed surface (cut to where samples support it, as a
build does) to the true surface, and from where the samples were measured to the reconstruction.

    python benchmarks/poisson_engines.py                         # pycolmap only
    python benchmarks/poisson_engines.py --open3d /path/to/venv/bin/python --pcl
    python benchmarks/poisson_engines.py --points 200000 --depths 8,9,10 --json out.json

Open3D's wheel wants system libraries (Debian: libgl1 libegl1 libx11-6 libusb-1.0-0 libgomp1), so it
is looked for in an environment of its own. ``--pcl`` uses Debian's pcl-tools.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from scipy.spatial import cKDTree

from terraport_pipeline.engines import poisson
from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_pipeline.geometry.mesh.trim import compact, support_mask
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_pipeline.model import to_scene
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise

PYCOLMAP = """
import sys, pycolmap
source, target, depth, weight, threads = sys.argv[1:]
options = pycolmap.PoissonMeshingOptions()
options.depth, options.point_weight = int(depth), float(weight)
options.num_threads, options.trim, options.color = int(threads), 0.0, False
pycolmap.poisson_meshing(source, target, options)
"""
OPEN3D = """
import sys, open3d as o3d
source, target, depth, weight, threads = sys.argv[1:]
cloud = o3d.io.read_point_cloud(source)
mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
    cloud, depth=int(depth), point_weight=float(weight), n_threads=int(threads), linear_fit=False)
o3d.io.write_triangle_mesh(target, mesh)
"""
SAMPLES = 200_000


def run_child(command: list[str]) -> tuple[float, float, float]:
    """Run to the end: wall seconds, CPU seconds, peak GiB."""
    started = time.monotonic()
    peak = 0
    with tempfile.TemporaryFile() as log:
        process = psutil.Popen(command, stdout=log, stderr=log)
        while process.status() != psutil.STATUS_ZOMBIE:
            # Not the kernel's own maximum: it counts from before the new program took over.
            peak = max(peak, process.memory_info().rss)
            time.sleep(0.02)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            log.seek(0)
            raise RuntimeError(f"{command[:3]} ended with {status}: {log.read()[-500:].decode()}")
    return time.monotonic() - started, used.ru_utime + used.ru_stime, peak / 2**30


def write_ply(path: Path, points: np.ndarray, normals: np.ndarray) -> None:
    names = ("x", "y", "z", "nx", "ny", "nz")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    path.write_bytes(
        "\n".join(header).encode() + np.hstack([points, normals]).astype("<f4").tobytes()
    )


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    mesh = trimesh.load(path, process=False)
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--depths", default="8,9")
    parser.add_argument("--noise", type=float, default=0.015, help="of the samples, metres")
    parser.add_argument("--weights", default="2")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--repeat", type=int, default=2, help="runs, to see whether bytes differ")
    parser.add_argument("--open3d", help="a Python that has open3d")
    parser.add_argument("--pcl", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--smoke", action="store_true", help="few points, once: does it run?")
    options = parser.parse_args()
    if options.smoke:
        options.points, options.depths, options.threads, options.repeat = 10_000, "6", "1", 1
    # The samples that every engine gets, and the surface they were drawn from.
    quarry = synthesise(QuarryOptions(points=options.points, holes=0, noise_m=options.noise))
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "scratch").mkdir()
        cleaned = clean.run(quarry.survey, clean.Options(), Context(work / "scratch", threads=2))
        cloud = cleaned.cloud
        vertices, faces = quarry.surface_mesh(1.0)
        true_surface = TriangleTree(to_scene(vertices, cloud.origin), faces.astype(np.int32))
        seen = to_scene(quarry.truth, cloud.origin)
        seen = seen[quarry.material != 255][:: max(1, options.points // SAMPLES)]
        tree = cKDTree(cloud.points)
        source = work / "in.ply"
        write_ply(source, cloud.points, cloud.normals)
        extent = float(np.ptp(cloud.points, axis=0).max())
        print(
            f"{len(cloud.points):,} samples, areal spacing {cloud.spacing_m:.3f} m, extent "
            f"{extent:.0f} m, our rule: depth {poisson.depth_for(13, extent, cloud.spacing_m)}"
        )
        # Every engine at every depth, weight and thread count; runs repeat to compare bytes.
        rows = []
        for depth in map(int, options.depths.split(",")):
            for weight in options.weights.split(","):
                jobs = []
                for threads in options.threads.split(","):
                    arguments = [str(depth), weight, threads]
                    jobs.append(
                        (f"pycolmap, {threads} thr", [sys.executable, "-c", PYCOLMAP], arguments)
                    )
                    if options.open3d:
                        jobs.append(
                            (f"open3d, {threads} thr", [options.open3d, "-c", OPEN3D], arguments)
                        )
                for name, start, arguments in jobs:
                    target = work / "out.ply"
                    digests, costs, meshes = set(), [], []
                    for _ in range(options.repeat):
                        target.unlink(missing_ok=True)
                        costs.append(run_child([*start, str(source), str(target), *arguments]))
                        digests.add(hashlib.sha256(target.read_bytes()).hexdigest())
                        meshes.append(read_mesh(target))
                    row = score(meshes[0], tree, cleaned, true_surface, seen)
                    row |= {
                        "engine": name,
                        "depth": depth,
                        "weight": weight,
                        "wall_s": min(c[0] for c in costs),
                        "cpu_s": min(c[1] for c in costs),
                        "peak_gib": max(c[2] for c in costs),
                        "same_bytes": len(digests) == 1 if options.repeat > 1 else None,
                        "moved_mm": moved(meshes),
                    }
                    rows.append(row)
                    print(json.dumps(row), flush=True)
        # PCL has neither weight nor threads, so it is measured apart.
        if options.pcl:
            rows += pcl_rows(options, cloud, tree, cleaned, true_surface, seen, work)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))
    return 0


def moved(meshes: list) -> float | None:
    """How far vertices of two runs lie apart at most, mm."""
    if len(meshes) < 2:
        return None
    gap, _ = cKDTree(meshes[0][0]).query(meshes[1][0])
    return float(gap.max() * 1000)


def score(mesh, tree, cleaned, true_surface: TriangleTree, seen: np.ndarray) -> dict:
    vertices, faces = mesh
    solved = len(faces)
    keep = support_mask(vertices, faces, tree, cleaned.local_spacing_m, spacings=4.0)
    vertices, faces = compact(vertices, faces, keep)
    points, _ = sample_mesh(vertices, faces, SAMPLES, np.random.default_rng(1))
    # The rim that every engine makes beyond the samples is no question of accuracy.
    low, high = tree.mins[[0, 2]], tree.maxes[[0, 2]]
    points = points[((points[:, ::2] > low) & (points[:, ::2] < high)).all(axis=1)]
    out = true_surface.nearest(points).distance_m
    back = TriangleTree(vertices, faces).nearest(seen).distance_m
    percent = (50, 95, 99)
    return {
        "faces": solved,
        "kept": len(faces),
        "mesh_to_truth_mm": [round(float(v) * 1000, 1) for v in np.percentile(out, percent)],
        "truth_to_mesh_mm": [round(float(v) * 1000, 1) for v in np.percentile(back, percent)],
    }


def pcl_rows(options, cloud, tree, cleaned, true_surface, seen, work: Path) -> list[dict]:
    source, middle = work / "in.pcd", work / "out.vtk"
    names = "x y z normal_x normal_y normal_z"
    header = (
        f"VERSION 0.7\nFIELDS {names}\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\nCOUNT 1 1 1 1 1 1\n"
        f"WIDTH {len(cloud.points)}\nHEIGHT 1\nPOINTS {len(cloud.points)}\nDATA binary\n"
    )
    source.write_bytes(header.encode() + np.hstack([cloud.points, cloud.normals]).tobytes())
    rows = []
    for depth in map(int, options.depths.split(",")):
        cost = run_child(
            ["pcl_poisson_reconstruction", str(source), str(middle), "-depth", str(depth)]
        )
        subprocess.run(
            ["pcl_vtk2ply", str(middle), str(work / "pcl.ply")], check=True, capture_output=True
        )
        row = score(read_mesh(work / "pcl.ply"), tree, cleaned, true_surface, seen)
        row |= {
            "engine": "pcl",
            "depth": depth,
            "wall_s": cost[0],
            "cpu_s": cost[1],
            "peak_gib": cost[2],
            "same_bytes": None,
            "moved_mm": None,
            "weight": "default",
        }
        rows.append(row)
        print(json.dumps(row), flush=True)
    return rows


if __name__ == "__main__":
    sys.exit(main())
