"""Facts of regions, and finding them again: CPU seconds, memory, how many keep their number.

A procedural terrain (grid mesh, fixed seed) is cut into square regions. Facts are taken once; then
the terrain is "surveyed again": other noise, and every region's border moved by a tenth of its
width. The *floor* is one pass over the same labels: a stable sort of them.

    python benchmarks/regions.py                                    10 M faces, 65,025 regions
    python benchmarks/regions.py --faces 1000000 --regions 400
    python benchmarks/regions.py --smoke

Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import sys
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from parts.mesh_facts import region_facts

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.surface_samples import surface_samples
from terraport_pipeline.geometry.regions.region_match import match_regions, region_overlaps

SEED = 11
SPACING_M = 0.2
NOISE_M = 0.02
SAMPLES = 500_000
"""As many as a build takes of a surface."""
LEAST_SAMPLES = 32
"""As many as a build takes of each of very many regions."""

T = TypeVar("T")


def terrain(side: int, regions_a_side: int, seed: int, shift: float) -> dict[str, Any]:
    """Make a rolling surface of 2 (side - 1)^2 faces; ``shift`` moves borders by region widths."""
    rng = np.random.default_rng(seed)
    line = np.arange(side, dtype=np.float32) * np.float32(SPACING_M)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = 3 * np.sin(x / 9) + 2 * np.cos(z / 7) + rng.normal(0, NOISE_M, x.shape)
    i, j = np.meshgrid(np.arange(side - 1), np.arange(side - 1), indexing="ij")
    corner = (i * side + j).reshape(-1)
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + side], axis=1),
            np.stack([corner + side, corner + 1, corner + side + 1], axis=1),
        ]
    )
    width = (side - 1) / regions_a_side
    last = regions_a_side - 1
    row, column = (
        np.clip((axis / width + shift).astype(int), 0, last).reshape(-1) for axis in (i, j)
    )
    return {
        "vertices": np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32),
        "faces": faces.astype(np.int32),
        "regions": np.tile(row * regions_a_side + column, 2).astype(np.int32),
        "colours": rng.integers(0, 256, (side * side, 3)).astype(np.uint8),
        "grade": rng.random(side * side).astype(np.float32),
    }


def facts_of(mesh: dict[str, Any], pairs: Any) -> dict[str, Any]:
    """All facts of all regions, with one attribute."""
    names = ("vertices", "faces", "colours", "regions")
    return region_facts(*(mesh[name] for name in names), pairs, attributes={"grade": mesh["grade"]})


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result and the CPU seconds of this process."""
    start = time.process_time()
    return work(), round(time.process_time() - start, 2)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--faces", type=int, default=10_000_000)
    parser.add_argument("--regions", type=int, default=65_025)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    faces, regions = (20_000, 100) if arguments.smoke else (arguments.faces, arguments.regions)
    side, a_side = int((faces / 2) ** 0.5) + 1, int(regions**0.5)
    # Facts of all regions; sorting the labels once is the least that any way must do.
    tiny = terrain(12, 2, SEED, 0.0)
    facts_of(tiny, face_pairs(tiny["faces"], len(tiny["vertices"])))  # compiles
    before = terrain(side, a_side, SEED, 0.0)
    pairs = face_pairs(before["faces"], len(before["vertices"]))
    resting = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    facts, facts_s = timed(lambda: facts_of(before, pairs))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resting
    _, floor_s = timed(lambda: np.sort(before["regions"], kind="stable"))
    # Regions of a rebuild matched with those before: samples of both, then the match.
    after = terrain(side, a_side, SEED + 1, 0.1)
    per_sample = max(1, -(-len(before["faces"]) // SAMPLES))
    sampled = [
        timed(
            lambda mesh=mesh: surface_samples(
                mesh["vertices"],
                mesh["faces"],
                mesh["regions"],
                faces_per_sample=per_sample,
                at_least=LEAST_SAMPLES,
            )
        )
        for mesh in (before, after)
    ]
    (old, _), (new, _) = sampled
    (matched, similarity), match_s = timed(lambda: matched_with_similarity(new, old))
    print(
        json.dumps(
            {
                "faces": len(before["faces"]),
                "regions": len(facts["regions"]),
                "facts_cpu_s": facts_s,
                "facts_extra_peak_mib": peak // 1024,
                "floor_sort_cpu_s": floor_s,
                "sampling_cpu_s": [seconds for _, seconds in sampled],
                "samples": [len(old.labels), len(new.labels)],
                "match_cpu_s": match_s,
                "same_number": round(
                    float((matched[0] == matched[1]).sum() / len(facts["regions"])), 4
                ),
                "median_similarity": similarity,
                "machine": f"{platform.machine()}, Python {platform.python_version()}",
            },
            indent=1,
        )
    )
    return 0


def matched_with_similarity(new: Any, old: Any) -> tuple[Any, float]:
    """Match regions; return them and the median similarity of regions with themselves."""
    overlaps = region_overlaps(new, old)
    own = overlaps.similarity[overlaps.new == overlaps.old]
    return match_regions(overlaps), round(float(np.median(own)), 3)


if __name__ == "__main__":
    sys.exit(main())
