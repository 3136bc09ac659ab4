"""Segmentation and cover: seconds per stage and peak memory by mesh size.

A procedural terrain (grid mesh with patches of noisy colour, fixed seed) goes through every step
from arrays to segments and the cover of a base a fifteenth its size. Each size runs in a fresh
process, once to load the compiled kernels on a tiny mesh and once for the figures. The *floor* is
one ``np.sort`` of the similarity array: no method that sorts can be faster.

    python benchmarks/segmentation.py --faces 500000 2000000
    python benchmarks/segmentation.py --smoke

Results are printed, and written as JSON lines with ``--json FILE``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import platform
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.adjacency import components, face_pairs
from terraport_pipeline.geometry.colour import face_colour_sums, white_distance_of_sums
from terraport_pipeline.geometry.cover import build_cover
from terraport_pipeline.geometry.kmeans_1d import kmeans_1d
from terraport_pipeline.geometry.region_facts import region_facts
from terraport_pipeline.geometry.segments import SegmentOptions, build_segments
from terraport_pipeline.geometry.triangle_pool import (
    FINE_POOLS,
    REGION_POOLS,
    chain_count,
    face_similarity,
    triangle_pools,
)

SEED = 7
BASE_SHARE = 15
SMOKE_FACES = 20_000
MACHINE = f"{platform.machine()}, Python {platform.python_version()}, numba {numba.__version__}"
CHAIN = ("adjacency", "TPA regions", "TPA fine", "segments", "cover")
FACTS = (
    "chain_s",
    "peak_mib",
    "regions",
    "fine_pools",
    "segments",
    "segment_faces",
    "base_faces",
    "segments_per_base_face",
)
THESIS = "thesis, table 5.4: 12 M faces took 22 h on ten cores"

T = TypeVar("T")
Mesh = tuple[npt.NDArray[np.float32], npt.NDArray[np.int32], npt.NDArray[np.uint8]]


def terrain(n_faces: int, *, detail: bool, noise: float, side_m: float) -> Mesh:
    """Coloured grid terrain; base and detail are the same hills, the detail with small bumps."""
    rng = np.random.default_rng(SEED)
    n = int(np.sqrt(n_faces / 2)) + 1
    axis = np.linspace(0.0, side_m, n)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    y, field = np.zeros_like(x), np.zeros_like(x)
    for octave in range(5):
        wave = 2.0**octave * 2.0 * np.pi / side_m
        a, b, c, d = rng.uniform(0.0, 2.0 * np.pi, 4)
        y += side_m / 20.0 / 2.0**octave * np.sin(wave * x + a) * np.cos(wave * z + b)
        field += np.sin(0.7 * wave * x + c + 0.3 * wave * z) * np.cos(wave * z + d) / 1.5**octave
    if detail:
        y += 0.05 * np.sin(2.0 * x) * np.cos(2.3 * z)
    material = np.digitize(field, [-0.6, 0.3, 0.9]).ravel()
    palette = np.array([[60, 80, 50], [140, 120, 95], [190, 175, 150], [90, 90, 95]], np.float64)
    colours = palette[material] + rng.normal(0.0, noise, (n * n, 3))
    i, j = np.divmod(np.arange((n - 1) ** 2), n - 1)
    corner = i * n + j
    faces = np.stack(
        [corner, corner + 1, corner + n, corner + n, corner + 1, corner + n + 1], axis=1
    )
    return (
        np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32),
        faces.reshape(-1, 3).astype(np.int32),
        np.clip(colours, 0, 255).astype(np.uint8),
    )


def measure(n_faces: int, noise: float) -> dict[str, Any]:
    """Run every stage once and report seconds, peak memory and counts."""
    side_m = float(np.sqrt(n_faces * 0.02))  # 0.2 m edges whatever the size
    vertices, faces, colours = terrain(n_faces, detail=True, noise=noise, side_m=side_m)
    base_vertices, base_faces, _ = terrain(
        n_faces // BASE_SHARE, detail=False, noise=noise, side_m=side_m
    )
    seconds: dict[str, float] = {}
    inputs_mib = _peak_mib()

    def timed(stage: str, work: Callable[[], T]) -> T:
        start = time.perf_counter()
        result = work()
        seconds[stage] = round(time.perf_counter() - start, 3)
        return result

    sums = timed("face colours", lambda: face_colour_sums(colours, faces))
    timed("CIEDE2000 to white", lambda: white_distance_of_sums(sums, 3))
    similarity = timed(
        "similarity, whole", lambda: face_similarity(vertices, faces, colours=colours)
    )
    ordered = timed("floor: sort of s", lambda: np.sort(similarity))
    k = timed("chaining", lambda: chain_count(ordered, FINE_POOLS.threshold))
    level2 = timed("k-means and assign", lambda: kmeans_1d(ordered, k).assign(similarity))
    pairs = timed("adjacency", lambda: face_pairs(faces, len(vertices)))
    timed("components", lambda: components(len(faces), pairs[0], labels=level2))
    tpa = timed("TPA alone, from arrays", lambda: triangle_pools(vertices, faces, colours=colours))
    regions = timed(
        "TPA regions",
        lambda: triangle_pools(
            vertices, faces, colours=colours, options=REGION_POOLS, pairs=pairs[0]
        ),
    )
    fine = timed(
        "TPA fine",
        lambda: triangle_pools(
            vertices, faces, colours=colours, options=FINE_POOLS, pairs=pairs[0]
        ),
    )
    tpa_mib = _peak_mib()
    segments = timed(
        "segments",
        lambda: build_segments(
            vertices, faces, fine.labels, fine.similarity, regions.labels, SegmentOptions(),
            pairs=pairs,
        ),
    )  # fmt: skip
    segments_mib = _peak_mib()
    cover = timed(
        "cover",
        lambda: build_cover(
            base_vertices, base_faces, vertices, faces, segments.labels, tolerance_m=0.1
        ),
    )
    timed(
        "region facts", lambda: region_facts(vertices, faces, colours, regions.labels, pairs=pairs)
    )
    assert tpa.labels.tobytes() == regions.labels.tobytes()
    lists = np.diff(cover.offsets.astype(np.int64))
    return {
        "faces": len(faces),
        "noise": noise,
        "seconds": seconds,
        "chain_s": round(
            sum(seconds[s] for s in ("adjacency", "TPA regions", "TPA fine", "segments", "cover")),
            3,
        ),
        "peak_mib": {
            "inputs": inputs_mib,
            "TPA": tpa_mib,
            "segments": segments_mib,
            "all": _peak_mib(),
        },
        "regions": regions.count,
        "fine_pools": fine.count,
        "segments": segments.count,
        "segment_faces": np.percentile(segments.face_counts, [0, 50, 100]).tolist(),
        "base_faces": len(base_faces),
        "segments_per_base_face": round(float(lists.mean()), 3),
        "machine": MACHINE,
    }


def _peak_mib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def _child(n_faces: int, noise: float, results: Any) -> None:
    measure(2_000, noise)  # loads (or compiles) the kernels
    results.put(measure(n_faces, noise))


def run(n_faces: int, noise: float) -> dict[str, Any]:
    """Measure in a fresh process, so that one size's memory does not hide in another's."""
    context = multiprocessing.get_context("spawn")
    results = context.SimpleQueue()
    child = context.Process(target=_child, args=(n_faces, noise, results))
    child.start()
    found: dict[str, Any] = results.get()
    child.join()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--faces", type=int, nargs="+", default=[500_000, 2_000_000])
    parser.add_argument(
        "--noise", type=float, nargs="+", default=[6.0], help="colour noise, 0..255"
    )
    parser.add_argument("--json", type=Path, help="append one line of JSON per run")
    parser.add_argument("--smoke", action="store_true", help=f"one run with {SMOKE_FACES} faces")
    arguments = parser.parse_args()
    sizes = [SMOKE_FACES] if arguments.smoke else arguments.faces
    for n_faces in sizes:
        for noise in arguments.noise:
            result = run(n_faces, noise)
            print(f"\n{result['faces']:,} faces, colour noise {noise:g} ({result['machine']})")
            for stage, seconds in result["seconds"].items():
                per_face_ns = 1e9 * seconds / result["faces"]
                print(f"  {stage:<24}{seconds:>9.3f} s{per_face_ns:>10.0f} ns/face")
            for name in FACTS:
                print(f"  {name}: {result[name]}")
            if arguments.json:
                with arguments.json.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(result) + "\n")
    print(f"\n({THESIS})")


if __name__ == "__main__":
    main()
