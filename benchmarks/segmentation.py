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
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
import numpy as np
from parts.mesh_facts import region_facts
from parts.plain_pools import plain_pools
from parts.work_arrays import read_base, read_tiles, welded

from terraport_payload.types import AnyArray, Float32, Float64, Int32
from terraport_pipeline.geometry.cover.cover import build_cover
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.geometry.regions.kmeans_1d import kmeans_1d
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh, segmenter_by_name
from terraport_pipeline.geometry.regions.triangle_pool import (
    FINE_POOLS,
    REGION_POOLS,
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

SEED: Final = 7
SIZES: Final = (500_000, 1_000_000, 2_000_000, 5_000_000, 12_000_000)
SMOKE_FACES: Final = 20_000
BASE_SHARE: Final = 15
MANY_BASE_FACES: Final = 2_000_000
TOLERANCE_M: Final = 0.1
CHAIN: Final = ("adjacency", "TPA regions and fine", "merge and split", "cover", "packing")
BARS: Final = (
    ("TPA, 12 M faces, arrays to labels", 11_500_000, "TPA, arrays to labels", "s", 20.0),
    ("the same, stretch", 11_500_000, "TPA, arrays to labels", "s", 10.0),
    ("peak memory of it", 11_500_000, "TPA, arrays to labels", "MiB", 2048.0),
    ("graph, 5 M faces, arrays to labels", 4_900_000, "graph, arrays to labels", "s", 60.0),
    ("whole chain, 5 M faces", 4_900_000, "whole chain", "s", 120.0),
)
ONE, SHUFFLED = "TPA, one thread", "TPA, one thread, shuffled"
PLAIN, PLAIN_SHUFFLED = "plain NumPy and SciPy", "plain NumPy and SciPy, shuffled"
MOST_PLAIN_FACES: Final = 5_200_000
"""Beyond it the plain version alone takes more memory than all stages together."""
THESIS: Final = "thesis, table 5.4: 12 M faces took 22 h on ten cores"

T = TypeVar("T")
Arrays = dict[str, AnyArray]


def terrain(n_faces: int, *, detail: bool, noise: float, side_m: float) -> Arrays:
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
    return {
        "vertices": np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32),
        "faces": faces.reshape(-1, 3).astype(np.int32),
        "colours": np.clip(colours, 0, 255).astype(np.uint8),
    }


def make(folder: Path, n_faces: int, noise: float, base_faces: int) -> None:
    """Write the arrays of a terrain and its base as a build's work directory holds them."""
    side_m = float(np.sqrt(n_faces * 0.02))
    none = np.zeros(0, np.int64)
    for name, prefix, mesh in (
        (
            "tile-00000",
            "",
            {"border-rows": none, "border-shared": none}
            | terrain(n_faces, detail=True, noise=noise, side_m=side_m),
        ),
        ("base", "base-", terrain(base_faces, detail=False, noise=noise, side_m=side_m)),
    ):
        mesh["normals"] = vertex_normals(mesh["vertices"], mesh["faces"])
        (folder / name).mkdir(exist_ok=True)
        for array, values in mesh.items():
            np.save(folder / name / f"{prefix}{array}.npy", values)
    (folder / "settle").mkdir(exist_ok=True)
    np.save(folder / "settle" / "ids.npy", none)  # one tile shares nothing
    np.save(folder / "settle" / "ids-starts.npy", np.zeros(2, np.int64))


class Clock:
    """Wall seconds, CPU seconds and peak memory of named stages."""

    def __init__(self) -> None:
        self.stages: dict[str, dict[str, float]] = {}

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        """Do the work and note what it cost."""
        _reset_peak()
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        self.stages[stage] = {
            "s": round(time.perf_counter() - wall, 3),
            "cpu_s": round(time.process_time() - cpu, 3),
            "MiB": _status_mib("VmHWM"),
        }
        return result


def _status_mib(field: str) -> int:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) // 1024
    return 0


def _reset_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return  # the figure is then the largest so far


def measure(folder: Path, threads: int, many_base: Path | None, *, whole: bool) -> dict[str, Any]:
    """Run every stage once on the meshes in a work directory."""
    clock = Clock()
    detail, base = welded(read_tiles(folder)), read_base(folder)
    mesh = (detail.vertices, detail.faces)
    inputs_mib = _status_mib("VmRSS")
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


def show(result: dict[str, Any], title: str) -> None:
    print(f"\n{title}: {result['faces']:,} faces, {result['threads']} threads")
    print(f"  {'':<34}{'wall s':>9}{'CPU s':>9}{'ns/face':>9}{'peak MiB':>10}")
    for stage, cost in result["stages"].items():
        per_face = 1e9 * cost["s"] / result["faces"]
        seconds = f"{cost['s']:>9.2f}{cost['cpu_s']:>9.2f}{per_face:>9.0f}"
        print(f"  {stage:<34}{seconds}{cost['MiB']:>10.0f}")
    for name, value in result.items():
        if name not in ("stages", "faces", "threads"):
            print(f"  {name}: {value}")


def verdict(results: list[dict[str, Any]]) -> None:
    """Say which bars are met: each at the nearest size that was measured, the worst of its runs."""
    print(f"\n{'bar':<40}{'measured':>12}{'allowed':>10}")
    for name, size, stage, unit, allowed in BARS:
        near = [r for r in results if size <= r["faces"] < 1.2 * size and stage in r["stages"]]
        if near:
            worst = max(r["stages"][stage][unit] for r in near)
            say(name, worst, allowed, unit)
    by_size = sorted((r for r in results if r["noise"] == results[0]["noise"]), key=_faces)
    if len(by_size) > 1 and by_size[-1]["faces"] > 20 * by_size[0]["faces"]:
        per_face = [r["stages"]["TPA, arrays to labels"]["s"] / r["faces"] for r in by_size]
        say("time per face, largest over smallest", per_face[-1] / per_face[0], 1.3, "x")
        cpu = [r["stages"]["TPA, arrays to labels"]["cpu_s"] / r["faces"] for r in by_size]
        say("the same in CPU seconds", cpu[-1] / cpu[0], 1.3, "x")
    # Shuffled against in order; and what compiled kernels have over a page of NumPy.
    for result in by_size:
        cpu_s = {name: cost["cpu_s"] for name, cost in result["stages"].items()}
        size = f"{result['faces']:,} faces"
        ratio = cpu_s[SHUFFLED] / max(cpu_s[ONE], 1e-3)
        say(f"{size}: shuffled over in order, CPU", ratio, 2.0, "x")
        if PLAIN in cpu_s:
            for plain, ours in ((PLAIN, ONE), (PLAIN_SHUFFLED, SHUFFLED)):
                times = cpu_s[plain] / max(cpu_s[ours], 1e-3)
                print(f"  {size}, {plain}: {cpu_s[plain]:.2f} CPU s, {times:.1f} x TPA")
    print(f"({THESIS}; a plain version on one core is the fairer comparison)")


def _faces(result: dict[str, Any]) -> int:
    return int(result["faces"])


def say(name: str, value: float, allowed: float, unit: str) -> None:
    met = "met" if value <= allowed else "MISSED"
    print(f"{name:<40}{value:>8.2f} {unit:<3}{allowed:>7.4g} {unit:<4}{met}")


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
        make(tiny, 2_000, 6.0, 500)
        # Do threads change the bytes? Nothing else is measured then.
        if arguments.bytes:
            in_fresh_process(make, folder, arguments.bytes, 6.0, arguments.bytes // BASE_SHARE)
            digests = {measured(folder, threads, tiny)["digest"] for threads in (1, 2, 2)}
            print(f"{arguments.bytes:,} faces, 1, 2 and 2 threads: {sorted(digests)}")
            raise SystemExit(0 if len(digests) == 1 else "the bytes differ")
        # Meshes of finished builds; else made ones of every size and noise.
        for real in arguments.mesh:
            measurements = measured(real, arguments.threads, tiny)
            show(measurements, real.name)
        for n_faces in [] if arguments.mesh else sizes:
            for noise in arguments.noise:
                in_fresh_process(make, folder, n_faces, noise, n_faces // BASE_SHARE)
                with_many = n_faces >= 2 * MANY_BASE_FACES
                if with_many:
                    in_fresh_process(make, many, n_faces, noise, MANY_BASE_FACES)
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
