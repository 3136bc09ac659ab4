"""Measure the store and the payload codecs.

    python benchmarks/store.py [--smoke] [--out FILE]

* spatial index: build, memory and query at 1 k, 10 k, 100 k and 1 M boxes: the packed tree, the
  package rtree (libspatialindex), every box measured; same answers required;
* index file: bytes per segment, encode and decode;
* payload: bytes per triangle, encode and decode per second, of a segment and of a base;
* reading: payloads per second from a published scene, with and without the hash check.

Fixed seeds. Times are medians; run on an idle machine, or compare ratios. ``--smoke`` runs
everything small, in seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rtree.index

from terraport_payload import (
    AttributeScale,
    Cover,
    SegmentMesh,
    box_distances_m,
    decode_segment,
    encode_segment,
)
from terraport_payload.types import Float32, Int64
from terraport_pipeline.geometry.segments.strip_order import strip_order
from terraport_store import (
    BuildInfo,
    HandOff,
    PackedRTree,
    Scene,
    SceneInfo,
    SceneWriter,
    SegmentIndex,
    validate_scene,
)

STEP_M = 2.0**-12
SCALES = {"grade": AttributeScale(0.0, 2.0 / 65534)}


def main() -> None:
    """Run and print; write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    parser.add_argument("--only-spatial", action="store_true", help="the index alone")
    parser.add_argument("--out", type=Path, help="write the figures as JSON here")
    options = parser.parse_args()
    counts = (1000,) if options.smoke else (10**3, 10**4, 10**5, 10**6)
    results: dict[str, Any] = {
        "machine": {"processor": platform.machine(), "python": platform.python_version()},
        "spatial": [spatial(count) for count in counts],
    }
    if not options.only_spatial:
        results["index"] = index_file(1000 if options.smoke else 100_000)
        sizes = (12,) if options.smoke else (35, 63, 90)
        results["payload"] = [payload(cells) for cells in sizes]
        results["reading"] = reading(8 if options.smoke else 200)
    text = json.dumps(results, indent=1)
    print(text)
    if options.out is not None:
        options.out.write_text(text + "\n")


def median_s(work: Callable[[], object], *, least_s: float = 0.3, most: int = 50) -> float:
    """Median time of one call, repeated for least_s or at most so often."""
    times: list[float] = []
    while not times or (sum(times) < least_s and len(times) < most):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def spatial(count: int) -> dict[str, Any]:
    """Boxes of 5 m on terrain of constant density; a landing of 60 m finds about 450 of them.

    By each index: its build, its memory, a query; in seconds of this thread's processor, which
    others on the machine hardly change. Same answers required.
    """
    rng = np.random.default_rng(1)
    side = 5.0 * count**0.5
    low = np.stack(
        [rng.uniform(0, side, count), rng.uniform(0, 40, count), rng.uniform(0, side, count)],
        axis=1,
    )
    bounds = np.hstack([low, low + rng.uniform(1, 6, (count, 3))]).astype(np.float32)
    kinds: dict[str, Callable[[Float32], Any]] = {
        "packed": PackedRTree,
        "rtree": LibraryTree,
        "measured": EveryBox,
    }
    rows: dict[str, Any] = {"boxes": count}
    indexes: dict[str, Any] = {}
    for name, kind in kinds.items():
        before_bytes, start_s = resident_bytes(), time.thread_time()
        indexes[name] = kind(bounds)
        rows[f"{name}_build_ms"] = round(1e3 * (time.thread_time() - start_s), 1)
        rows[f"{name}_bytes_per_box"] = round((resident_bytes() - before_bytes) / count)
    for radius in (20.0, 60.0, 150.0, 500.0):
        centres = [(float(x), 20.0, float(z)) for x, z in rng.uniform(0, side, (10, 2))]
        answers = [indexes["measured"].within(centre, radius) for centre in centres]
        row: dict[str, Any] = {"segments": round(statistics.mean(map(len, answers)))}
        for name, index in indexes.items():
            for centre, answer in zip(centres, answers, strict=True):
                assert np.array_equal(index.within(centre, radius), answer)
            row[f"{name}_ms"] = query_ms(index, centres, radius)
        rows[f"radius_{radius:.0f}_m"] = row
    return rows


class LibraryTree:
    """The package rtree, bulk-loaded from arrays; the boxes that it finds are measured."""

    def __init__(self, bounds: Float32) -> None:
        self._bounds = bounds
        wide = bounds.astype(np.float64)
        low, high = np.ascontiguousarray(wide[:, :3]), np.ascontiguousarray(wide[:, 3:])
        properties = rtree.index.Property(dimension=3, leaf_capacity=100, index_capacity=100)
        self._tree = rtree.index.Index((np.arange(len(bounds)), low, high), properties=properties)

    def within(self, centre: tuple[float, ...], radius_m: float) -> Int64:
        """Find the boxes within a radius."""
        point = np.array(centre)
        ids, _ = self._tree.intersection_v((point - radius_m)[None], (point + radius_m)[None])
        ids.sort()
        return ids[box_distances_m(self._bounds[ids], point) <= radius_m]


class EveryBox:
    """No tree."""

    def __init__(self, bounds: Float32) -> None:
        self._bounds = bounds

    def within(self, centre: tuple[float, ...], radius_m: float) -> Int64:
        """Measure every box."""
        return np.flatnonzero(box_distances_m(self._bounds, np.array(centre)) <= radius_m)


def resident_bytes() -> int:
    """Return what this process has in memory now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def query_ms(index: Any, centres: list[tuple[float, ...]], radius_m: float) -> float:
    """Median over the centres of one query's processor time, the best of five."""
    times = []
    for centre in centres:
        tries = []
        for _ in range(5):
            start_s = time.thread_time()
            index.within(centre, radius_m)
            tries.append(time.thread_time() - start_s)
        times.append(min(tries))
    return round(statistics.median(times) * 1e3, 3)


def index_file(count: int) -> dict[str, Any]:
    """Write and read an index of so many segments."""
    rng = np.random.default_rng(2)
    low = rng.uniform(0, 500, (count, 3)).astype(np.float32)
    length = rng.integers(20_000, 120_000, count).astype(np.uint32)
    index = SegmentIndex(
        bounds=np.hstack([low, low + np.float32(5)]),
        vertex_count=np.full(count, 4000, dtype=np.uint32),
        face_count=np.full(count, 8000, dtype=np.uint32),
        offset=np.arange(count, dtype=np.uint64) * np.uint64(131072) + np.uint64(64),
        length=length,
        xxh3=rng.integers(0, 2**63, count).astype(np.uint64),
        region=np.zeros(count, dtype=np.uint32),
        region_count=np.ones(count, dtype=np.uint16),
        texture=np.zeros((count, 3), dtype="<u2"),
    )
    data = index.to_bytes()
    return {
        "segments": count,
        "bytes_per_segment": round(len(data) / count, 2),
        "encode_ms": round(median_s(index.to_bytes) * 1e3, 2),
        "decode_ms": round(median_s(lambda: SegmentIndex.from_bytes(data)) * 1e3, 2),
    }


def terrain(cells: int, seed: int = 0) -> SegmentMesh:
    """Make noisy coloured terrain, 5 cm between vertices, 3 mm of height noise."""
    rng = np.random.default_rng(seed)
    x, z = np.meshgrid(np.arange(cells + 1) * 0.05, np.arange(cells + 1) * -0.05, indexing="ij")
    y = np.sin(x) + 0.3 * np.cos(3 * z) + rng.normal(0, 0.003, x.shape)
    jitter = rng.normal(0, 0.01, (2, *x.shape))
    positions = np.stack([x + jitter[0], y, z + jitter[1]], axis=-1).reshape(-1, 3) + 100.0
    normals = np.stack([-np.cos(x), np.ones_like(x), 0.9 * np.sin(3 * z)], axis=-1).reshape(-1, 3)
    normals += rng.normal(0, 0.05, normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    grey = 150 + 30 * np.sin(2 * x) + rng.normal(0, 8, x.shape)
    colours = np.stack([grey, grey * 0.9, grey * 0.8], axis=-1).reshape(-1, 3)
    colours += rng.normal(0, 3, colours.shape)
    side = cells + 1
    corner = (np.arange(cells)[:, None] * side + np.arange(cells)[None, :]).reshape(-1)
    faces = np.concatenate(
        [
            np.stack([corner, corner + side, corner + side + 1], axis=1),
            np.stack([corner, corner + side + 1, corner + 1], axis=1),
        ]
    )
    return SegmentMesh(
        positions=positions.astype(np.float32),
        faces=faces.astype(np.uint32),
        normals=normals.astype(np.float32),
        colours=np.clip(colours, 0, 255).astype(np.uint8),
        region_ids=(x.reshape(-1) > x.mean()).astype(np.uint16),
        attributes={"grade": (1 + np.sin(x / 3)).reshape(-1).astype(np.float32)},
    )


def payload(cells: int) -> dict[str, Any]:
    """Size and speed of one segment, and of the same mesh as a base."""
    mesh = terrain(cells)
    mesh = replace(mesh, faces=mesh.faces[strip_order(mesh.faces)])
    bare = SegmentMesh(mesh.positions, mesh.faces, mesh.normals)

    def segment(source: SegmentMesh) -> bytes:
        return encode_segment(source, step_m=STEP_M, scales=SCALES)

    def base(step_m: float) -> bytes:
        return encode_segment(mesh, step_m=step_m, scales=SCALES, may_be_wide=True)

    def decode(data: bytes) -> SegmentMesh:
        return decode_segment(data, scales=SCALES)

    variants: dict[str, tuple[Callable[[], bytes], Callable[[bytes], SegmentMesh]]] = {
        "segment": (lambda: segment(mesh), decode),
        "segment, positions and normals alone": (lambda: segment(bare), decode),
        "base": (lambda: base(STEP_M), decode),
        "base, wide": (lambda: base(2.0**-17), decode),
    }
    rows: dict[str, Any] = {"faces": len(mesh.faces)}
    for name, (encode, decoder) in variants.items():
        data = encode()
        rows[name] = figures(len(mesh.faces), data, encode, partial(decoder, data))
    return rows


def figures(
    faces: int, data: bytes, encode: Callable[[], object], decode: Callable[[], object]
) -> dict[str, float]:
    """Bytes per triangle and million triangles per second."""
    return {
        "bytes_per_triangle": round(len(data) / faces, 2),
        "encode_mtri_s": round(faces / median_s(encode) / 1e6, 2),
        "decode_mtri_s": round(faces / median_s(decode) / 1e6, 2),
    }


def reading(segments: int) -> dict[str, Any]:
    """Publish a scene of equal segments of 8 k faces, read and validate it."""
    # One payload, written over and over: reading does not care, and the hash is of equal cost.
    mesh = replace(terrain(63), attributes={})
    data = encode_segment(mesh, step_m=STEP_M, scales={})
    base = encode_segment(replace(terrain(8), attributes={}), step_m=STEP_M, scales={})
    shape = decode_segment(data, scales={})
    box = [*shape.positions.min(axis=0).tolist(), *shape.positions.max(axis=0).tolist()]
    rows: dict[str, Any] = {"segments": segments, "payload_kib": round(len(data) / 1024, 1)}
    # Write and publish.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene"
        start = time.perf_counter()
        with SceneWriter(path) as writer:
            for _ in range(segments):
                writer.add_segment(
                    data,
                    region=0,
                    region_count=2,
                    bounds=box,
                    vertices=len(shape.positions),
                    faces=len(shape.faces),
                )
            empty = np.zeros(0, dtype=np.uint32)
            writer.set_base(base, Cover(np.zeros(129, dtype=np.uint32), empty))
            writer.publish(
                SceneInfo(
                    name="benchmark",
                    origin=(0, 0, 0),
                    step_m=STEP_M,
                    points=0,
                    regions=2,
                    hand_off=HandOff(deviation_m=0, tolerance_m=0),
                    build=BuildInfo(terraport="benchmark"),
                )
            )
        rows["write_and_publish_s"] = round(time.perf_counter() - start, 3)
        rows["open_ms"] = round(median_s(lambda: Scene.open(path).close()) * 1e3, 2)
        # Every payload, with and without its hash.
        with Scene.open(path) as scene:
            for verify in (False, True):

                def read_all(scene: Scene = scene, verify: bool = verify) -> None:
                    for segment in range(segments):
                        scene.payload(segment, verify=verify, recheck=verify)

                seconds = median_s(read_all)
                key = "hash checked" if verify else "read"
                rows[f"{key}, us per payload"] = round(seconds / segments * 1e6, 1)
        # Validate every payload.
        start = time.perf_counter()
        findings = validate_scene(path)
        assert findings == [], findings[0]
        rows["validate_ms_per_segment"] = round((time.perf_counter() - start) / segments * 1e3, 2)
    return rows


if __name__ == "__main__":
    main()
