"""Segmentation at survey scale: seconds, CPU seconds and memory per stage, and the bars.

    python benchmarks/segmentation.py                       # 0.5, 1, 2, 5, 12 M faces, noise 6
    python benchmarks/segmentation.py --faces 12000000 --noise 0 6 12
    python benchmarks/segmentation.py --mesh WORK           # a real survey's reconstructed mesh
    python benchmarks/segmentation.py --bytes 2000000       # same bytes again, with 1 and 2 threads
    python benchmarks/segmentation.py --smoke               # seconds, tiny

A procedural terrain (grid mesh of hills, patches of noisy colour, fixed seed, 0.2 m edges at every
size) is made in one process and measured in another, so that making it is not in the memory
figures. Memory is what the measured process has resident at most while a stage runs (``VmHWM``,
reset before each stage; a kernel that does not reset it shows the largest so far). Kernels are
loaded from numba's cache by a tiny mesh first.

*TPA, arrays to labels* is the bar of ``segmentation.md``: vertices, faces, colours in, region
labels out, nothing computed before. Beside it, on one thread: the same with the faces shuffled (as
no program writes them, and as one that knows no order may), and a plain NumPy and SciPy version
(``parts/plain_pools.py``) on both. The *floor* is what no method can save: reading the three
arrays and sorting s once. *means* and *graph* are the other engines. The *whole chain* is
adjacency, regions and fine pools, merging and splitting, cover, and packing all payloads into a
published scene.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import platform
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numba
import numpy as np
from parts.coloured_terrain import SEED, write_terrain
from parts.mesh_facts import region_facts
from parts.plain_pools import plain_pools
from parts.segmentation_bars import ONE, PLAIN, PLAIN_SHUFFLED, SHUFFLED, show, verdict
from parts.stage_clock import Clock, resident_mib
from parts.work_arrays import read_base, read_tiles, welded

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.geometry.cover.cover import build_cover
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.regions.engine_options import FINE_POOLS, REGION_POOLS
from terraport_pipeline.geometry.regions.kmeans_1d import kmeans_1d
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh, segmenter_by_name
from terraport_pipeline.geometry.regions.triangle_pool import (
    TrianglePools,
    chain_count,
    face_similarity,
    triangle_pools,
    triangle_pools_many,
)
from terraport_pipeline.geometry.segments.segment_shapes import QUANTILES, raggedness
from terraport_pipeline.geometry.segments.segments import (
    SegmentOptions,
    Segments,
    build_segments,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import pack
from terraport_pipeline.stages.contract import Context, Facts
from terraport_pipeline.stages.tiles import tiled_pack, tiled_segment
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented
from terraport_store.manifest import BuildInfo

SIZES: Final = (500_000, 1_000_000, 2_000_000, 5_000_000, 12_000_000)
SMOKE_FACES: Final = 20_000
BASE_SHARE: Final = 15
MANY_BASE_FACES: Final = 2_000_000
TOLERANCE_M: Final = 0.1
CHAIN: Final = ("adjacency", "TPA regions and fine", "merge and split", "cover", "packing")
MOST_PLAIN_FACES: Final = 5_200_000
"""Beyond it the plain version alone takes more memory than all stages together."""


def measure(folder: Path, threads: int, many_base: Path | None, *, whole: bool) -> dict[str, Any]:
    """Run every stage once on the meshes in a work directory."""
    clock = Clock()
    detail, base = welded(read_tiles(folder)), read_base(folder)
    mesh = (detail.vertices, detail.faces)
    inputs_mib = resident_mib()
    # (1) the bar: nothing known but the arrays
    tpa = clock(
        "TPA, arrays to labels",
        lambda: triangle_pools(*mesh, colours=detail.colours, threads=threads),
    )
    clock(
        ONE,
        lambda: triangle_pools(*mesh, colours=detail.colours, threads=1),
    )
    _beside_plain(clock, detail, tpa)
    # (2) its steps, one after the other
    pairs = _steps(clock, detail, threads)
    # (3) the other engines, from arrays to regions and fine pools
    if whole:
        for name in ("means", "graph"):
            segmenter_mesh = SegmenterMesh(*mesh, detail.colours)
            clock(
                f"{name}, arrays to labels",
                partial(segmenter_by_name(name).segment, segmenter_mesh),
            )
    # (4) the chain
    regions, fine = clock(
        "TPA regions and fine",
        lambda: triangle_pools_many(
            *mesh, (REGION_POOLS, FINE_POOLS), colours=detail.colours, pairs=pairs[0],
            threads=threads,
        ),
    )  # fmt: skip
    assert tpa.labels.tobytes() == regions.labels.tobytes()
    segments = clock(
        "merge and split",
        lambda: build_segments(
            *mesh, fine.labels, fine.similarity, regions.labels, SegmentOptions(),
            pairs=pairs, threads=threads,
        ),
    )  # fmt: skip
    cover = clock(
        "cover",
        lambda: build_cover(
            base.vertices, base.faces, *mesh, segments.labels, tolerance_m=TOLERANCE_M,
            hide_partly_covered=True, threads=threads,
        ),
    )  # fmt: skip
    if whole:
        facts = clock(
            "region facts (not in the chain)",
            lambda: region_facts(*mesh, detail.colours, regions.labels, pairs),
        )
        kept = np.diff(cover.offsets.astype(np.int64)) > 0
        joined = TiledSegmented(
            np.zeros(segments.count, np.int32), np.arange(segments.count, dtype=np.int32),
            segments.main_region, segments.region_counts, segments.bounds, kept,
            cover.offsets[np.append(True, kept)], cover.segments, facts, TOLERANCE_M,
            segments.max_extent_m, Facts(),
        )  # fmt: skip
        labels = (segments.labels, regions.labels)
        packed = clock("packing", lambda: _pack(folder, base, detail, labels, joined, threads))
        total = {unit: sum(clock.stages[name][unit] for name in CHAIN) for unit in ("s", "cpu_s")}
        peak = max(clock.stages[name]["MiB"] for name in CHAIN)
        clock.stages["whole chain"] = {**total, "MiB": peak}
    if many_base is not None:
        wide = read_base(many_base)
        clock(
            f"cover, {len(wide.faces):,} base faces",
            lambda: build_cover(
                wide.vertices,
                wide.faces,
                *mesh,
                segments.labels,
                tolerance_m=TOLERANCE_M,
                threads=threads,
            ),
        )
    return {
        "faces": len(detail.faces),
        "base_faces": len(base.faces),
        "threads": threads,
        "inputs_mib": inputs_mib,
        "stages": clock.stages,
        "regions": regions.count,
        "fine_pools": fine.count,
        "segments": segments.count,
        "max_extent_m": round(segments.max_extent_m, 2),
        "segments_per_base_face": round(float(np.diff(cover.offsets.astype(np.int64)).mean()), 3),
        **_shapes(*mesh, segments, threads),
        "bytes_per_face": packed["bytes_per_face"] if whole else None,
        "segment_bytes": packed["segment_bytes"] if whole else None,
        "digest": hashlib.sha256(
            b"".join(
                a.tobytes()
                for a in (
                    regions.labels,
                    fine.labels,
                    segments.labels,
                    cover.offsets,
                    cover.segments,
                )
            )
        ).hexdigest()[:16],
    }


def _beside_plain(clock: Clock, detail: Mesh, tpa: TrianglePools) -> None:
    """Run TPA on shuffled faces, and beside it a plain version, in both orders; one thread."""
    order = np.random.default_rng(SEED).permutation(len(detail.faces))
    shuffled = np.ascontiguousarray(detail.faces[order])
    of_shuffled = clock(
        SHUFFLED,
        lambda: triangle_pools(detail.vertices, shuffled, colours=detail.colours, threads=1),
    )
    assert _agreement(of_shuffled.labels, tpa.labels[order]) == 1.0
    if len(detail.faces) > MOST_PLAIN_FACES:
        return
    for name, faces, labels in (
        (PLAIN, detail.faces, tpa.labels),
        (PLAIN_SHUFFLED, shuffled, of_shuffled.labels),
    ):
        plain = clock(
            name, partial(plain_pools, detail.vertices, faces, detail.colours, REGION_POOLS)
        )
        clock.stages[name]["agreement"] = round(_agreement(plain, labels), 6)


def _agreement(first: Int32, second: Int32) -> float:
    """Share of the faces in the same pool, pools of the first matched to their largest part."""
    both, faces = np.unique(
        first.astype(np.int64) * (int(second.max()) + 1) + second, return_counts=True
    )
    largest = np.zeros(int(first.max()) + 1, np.int64)
    np.maximum.at(largest, both // (int(second.max()) + 1), faces)
    return float(largest.sum() / len(first))


def _steps(clock: Clock, detail: Mesh, threads: int) -> tuple[Int32, Int32]:
    """Each step of TPA alone; returns the adjacency."""
    mesh = (detail.vertices, detail.faces)
    clock("floor: reading", lambda: [int(a.view(np.uint8).max()) for a in (*mesh, detail.colours)])
    s = clock("similarity", lambda: face_similarity(*mesh, colours=detail.colours, threads=threads))
    ordered = clock("floor: sort of s", lambda: np.sort(s))
    k = chain_count(ordered, FINE_POOLS.threshold)
    level2 = clock("k-means and assign", lambda: kmeans_1d(ordered, k).assign(s, threads=threads))
    pairs = clock("adjacency", lambda: face_pairs(detail.faces, len(mesh[0]), threads=threads))
    clock("components", lambda: components(len(mesh[1]), pairs[0], labels=level2))
    return pairs


def _shapes(
    vertices: Float32, faces: Int32, segments: Segments, threads: int
) -> dict[str, list[float]]:
    """Quantiles over the segments, as the build's facts give them."""
    sides = segments.bounds[:, 3:].astype(np.float64) - segments.bounds[:, :3]
    return {
        name: [round(float(value), digits) for value in np.quantile(values, QUANTILES)]
        for name, values, digits in (
            ("segment_faces", segments.face_counts, 0),
            ("segment_extent_m", sides.max(axis=1), 3),
            ("segment_raggedness", raggedness(vertices, faces, segments, threads=threads), 2),
        )
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """The detail, segment by segment, as packing wants it for the ids of regions."""

    detail: Mesh
    segments: Int32
    regions: Int32
    origin: Float64
    crs: None = None

    @property
    def face_count(self) -> int:
        return len(self.detail.faces)

    def pieces(self) -> Iterator[tuple[Float32, Int32, Int32]]:
        order = np.argsort(self.segments, kind="stable")
        ends = np.cumsum(np.bincount(self.segments))
        for rows in np.split(order, ends[:-1]):
            yield self.detail.vertices, self.detail.faces[rows], self.regions[rows]


def _pack(
    folder: Path,
    base: Mesh,
    detail: Mesh,
    labels: tuple[Int32, Int32],
    joined: TiledSegmented,
    threads: int,
) -> dict[str, Any]:
    """Encode the detail as a build's only tile and publish it."""
    about = pack.About(
        np.zeros(3), None, len(detail.vertices), True, BuildInfo(terraport="benchmark")
    )
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        context = Context(Path(scratch), threads=threads)
        measured = tiled_segment.scene_of([tiled_segment.measure(detail, context)])
        extents = tiled_pack.Extents.of(measured, joined, base)
        scales = tiled_pack.scales_of(extents)
        payloads = tiled_pack.encode(detail, *labels, scales, context)
        return tiled_pack.publish(
            Path(scratch) / "scene", base, joined, lambda _tile: payloads,
            _Pieces(detail, *labels, about.origin), scales, extents.ranges,
            (0.01, 0.05, 0.1, 0.2), about,
            pack.Options("Benchmark"), context,
        ).facts.counts  # fmt: skip


def _child(
    answer: Path, folder: Path, threads: int, many_base: Path | None, tiny: Path, whole: bool
) -> None:
    measure(tiny, threads, None, whole=whole)  # loads (or compiles) the kernels
    measurements = measure(folder, threads, many_base, whole=whole)
    answer.write_text(json.dumps(measurements), encoding="utf-8")


def in_fresh_process(target: Callable[..., None], *arguments: Any) -> None:
    """Call a function in a process of its own; a failure there ends the benchmark."""
    child = multiprocessing.get_context("spawn").Process(target=target, args=arguments)
    child.start()
    child.join()
    if child.exitcode:
        raise SystemExit(f"the measured process ended with {child.exitcode}")


def measured(
    folder: Path, threads: int, tiny: Path, *, many: Path | None = None, whole: bool = False
) -> dict[str, Any]:
    """Run :func:`measure` in a fresh process."""
    answer = tiny / "answer.json"
    in_fresh_process(_child, answer, folder, threads, many, tiny, whole)
    measurements: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    return measurements


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--faces", type=int, nargs="+", default=list(SIZES))
    parser.add_argument("--noise", type=float, nargs="+", default=[6.0], help="0..255")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--mesh", type=Path, nargs="*", default=[], help="work directories of builds"
    )
    parser.add_argument("--bytes", type=int, help="compare bytes at this many faces, and stop")
    parser.add_argument("--no-pack", action="store_true", help="leave packing and facts out")
    parser.add_argument("--json", type=Path, help="append one line of JSON per run")
    parser.add_argument("--smoke", action="store_true", help=f"one run with {SMOKE_FACES} faces")
    arguments = parser.parse_args()
    sizes = [SMOKE_FACES] if arguments.smoke else arguments.faces
    machine = f"{platform.machine()}, Python {platform.python_version()}, numba {numba.__version__}"
    print(machine)
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        tiny, folder, many = Path(scratch, "tiny"), Path(scratch, "mesh"), Path(scratch, "many")
        for directory in (tiny, folder, many):
            directory.mkdir()
        # Kernels compile on a tiny mesh first, outside of what is measured.
        write_terrain(tiny, 2_000, 6.0, 500)
        # Do threads change the bytes? Nothing else is measured then.
        if arguments.bytes:
            in_fresh_process(
                write_terrain, folder, arguments.bytes, 6.0, arguments.bytes // BASE_SHARE
            )
            digests = {measured(folder, threads, tiny)["digest"] for threads in (1, 2, 2)}
            print(f"{arguments.bytes:,} faces, 1, 2 and 2 threads: {sorted(digests)}")
            raise SystemExit(0 if len(digests) == 1 else "the bytes differ")
        # Meshes of finished builds; else made ones of every size and noise.
        for real in arguments.mesh:
            measurements = measured(real, arguments.threads, tiny)
            show(measurements, real.name)
        for n_faces in [] if arguments.mesh else sizes:
            for noise in arguments.noise:
                in_fresh_process(write_terrain, folder, n_faces, noise, n_faces // BASE_SHARE)
                with_many = n_faces >= 2 * MANY_BASE_FACES
                if with_many:
                    in_fresh_process(write_terrain, many, n_faces, noise, MANY_BASE_FACES)
                result = measured(
                    folder, arguments.threads, tiny,
                    many=many if with_many else None, whole=not arguments.no_pack,
                )  # fmt: skip
                result |= {"noise": noise, "machine": machine}
                results.append(result)
                show(result, f"colour noise {noise:g}")
                if arguments.json:
                    with arguments.json.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(result) + "\n")
    if results:
        verdict(results)


if __name__ == "__main__":
    main()
