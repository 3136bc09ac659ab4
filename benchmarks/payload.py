"""Measure the bytes per triangle of payloads: ours beside raw, plain meshopt and Draco.

    python benchmarks/payload.py [WORK ...] [--segments 40] [--smoke] [--out FILE]

WORK is the work directory of a build (``.NAME.work``), which holds its mesh as reconstructed;
without one, hills are generated. Some of its segments are encoded in every way in one run, both
with vertex colours and with texture coordinates (a projection from above at --texels-per-spacing
texels per point spacing; the image itself is left out of every figure):

* raw: float32 positions, normals and coordinates, 8-bit colours, 32-bit indices;
* quantised: as our GLB, uncompressed;
* meshopt: codec 0 on positions of 14 bits of the segment's own box, octahedral normals of 8 bits,
  16-bit coordinates over the whole image, in the same order of vertices: what gltfpack -c does;
* before: our GLB with the finest grid that fits, as it first was;
* ours: the GLB of today;
* Draco: level 7, by DracoPy where it is installed (pip install DracoPy), with positions of 14 bits,
  and of as many bits as our grid has in that segment; normals of 8, coordinates of 12 bits. Region
  ids and other attributes are left out for all.

Bytes are whole payloads (header and JSON too). Errors are distances of positions to the truth.
Times are CPU seconds of one thread, best of three.
"""

from __future__ import annotations

import argparse
import importlib
import io
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import meshopt
import numpy as np
from parts.work_arrays import read_segments, read_tiles, spacing_of
from PIL import Image
from scipy.spatial import cKDTree

from terraport_payload import (
    SegmentMesh,
    Texture,
    choose_step_m,
    decode_glb,
    encode_glb,
    order_for_cache,
)
from terraport_payload.glb_container import split_glb
from terraport_payload.glb_encode import NORMAL_BITS, TEXTURED_NORMAL_BITS

ROUNDS = 3
SMALLEST_JPEG_SIDE = 64


@dataclass
class Row:
    """Sums over segments of one way."""

    bytes: int = 0
    zstd: int = 0
    faces: int = 0
    encode_s: float = 0.0
    decode_s: float = 0.0
    kernel_s: float = 0.0
    errors: list[np.ndarray] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """Bytes per triangle, speeds in millions of triangles a second, errors in millimetres."""
        measured = {"bytes": self.bytes / self.faces}
        if self.zstd:
            measured["zstd"] = self.zstd / self.faces
        for name in ("encode", "decode", "kernel"):
            seconds = getattr(self, f"{name}_s")
            if seconds:
                measured[f"{name}_mtri"] = self.faces / seconds / 1e6
        if self.errors:
            away_mm = np.concatenate(self.errors) * 1000.0
            measured |= {
                "p95_mm": float(np.percentile(away_mm, 95)),
                "max_mm": float(away_mm.max()),
            }
        return {name: round(value, 3) for name, value in measured.items()}


def main() -> None:
    """Run and print; write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("builds", nargs="*", type=Path, help="work directories of builds")
    parser.add_argument("--segments", type=int, default=40, help="of each build")
    parser.add_argument("--texels-per-spacing", type=float, default=4.0)
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    parser.add_argument("--out", type=Path, help="write the figures as JSON here")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    draco = find_draco()
    sources = [segments_of(work, options.segments) for work in options.builds]
    for name, spacing_m, meshes in sources or [hills(20 if options.smoke else 50)]:
        results[name] = {"spacing_m": round(spacing_m, 4), **sizes(meshes)}
        for kind in ("textured", "coloured"):
            dressed_meshes = [
                dressed(m, kind, spacing_m / options.texels_per_spacing) for m in meshes
            ]
            results[name][kind] = compare(dressed_meshes, spacing_m, draco)
            draw(name, kind, results[name])
    if options.out is not None:
        options.out.write_text(json.dumps(results, indent=1) + "\n")


def find_draco() -> Any | None:
    """DracoPy where it is installed."""
    try:
        return importlib.import_module("DracoPy")
    except ImportError:
        print("Draco is left out: DracoPy is not installed (pip install DracoPy)")
        return None


def zstd_bytes(data: bytes) -> int:
    """Length after zstd level 9; 0 where pyarrow is not there."""
    try:
        codec = importlib.import_module("pyarrow").Codec("zstd", compression_level=9)
    except ImportError:
        return 0
    return len(codec.compress(data))


def segments_of(work: Path, count: int) -> tuple[str, float, list[SegmentMesh]]:
    """Cut some segments out of a build's mesh, the same every time, without other attributes."""
    tiles, labels = read_tiles(work), read_segments(work)
    total = int(labels.max()) + 1
    chosen = np.random.default_rng(1).choice(total, min(count, total), replace=False)
    meshes = []
    for label in np.sort(chosen):
        used, own = np.unique(tiles.faces[labels == label], return_inverse=True)
        meshes.append(
            SegmentMesh(
                positions=tiles.vertices[used],
                faces=own.reshape(-1, 3).astype(np.uint32),
                normals=tiles.normals[used],
                colours=tiles.colours[used],
                region_ids=None,
                attributes={},
            )
        )
    return work.name.removeprefix(".").removesuffix(".work"), spacing_of(work), meshes


def hills(cells: int) -> tuple[str, float, list[SegmentMesh]]:
    """Make four generated segments with points 0.12 m apart."""
    return "hill", 0.12, [hill(seed, cells) for seed in range(4)]


def hill(seed: int, cells: int) -> SegmentMesh:
    """Make a noisy slope with noisy colours."""
    rng = np.random.default_rng(seed)
    side = cells + 1
    x, z = np.meshgrid(np.arange(side) * 0.12, np.arange(side) * 0.12)
    y = np.sin(0.4 * x) * np.cos(0.3 * z) + rng.normal(0, 0.02, x.shape)
    positions = np.stack([x, y, z], axis=-1) + rng.normal(0, 0.01, (side, side, 3))
    normals = np.stack(
        [-np.gradient(y, axis=1), np.full_like(y, 0.12), -np.gradient(y, axis=0)], -1
    )
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = (np.arange(cells)[:, None] * side + np.arange(cells)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + side, corner + 1], 1),
            np.stack([corner + 1, corner + side, corner + side + 1], 1),
        ]
    )
    level = 120 + 50 * np.sin(0.2 * x) + rng.normal(0, 8, x.shape)
    colours = np.clip(level[..., None] * (1.0, 0.9, 0.7), 0, 255)
    return SegmentMesh(
        positions=positions.reshape(-1, 3).astype(np.float32),
        faces=faces.astype(np.uint32),
        normals=normals.reshape(-1, 3).astype(np.float32),
        colours=colours.reshape(-1, 3).astype(np.uint8),
        region_ids=None,
        attributes={},
    )


def typical_edge_m(meshes: list[SegmentMesh]) -> float:
    """Median length of the first side of all faces."""
    sides = [m.positions[m.faces[:, 0]] - m.positions[m.faces[:, 1]] for m in meshes]
    return float(np.median(np.linalg.norm(np.concatenate(sides), axis=1)))


def sizes(meshes: list[SegmentMesh]) -> dict[str, float]:
    """Give counts and lengths that explain the figures."""
    faces = sum(len(m.faces) for m in meshes)
    return {
        "segments": len(meshes),
        "faces": faces,
        "vertices_per_face": round(sum(len(m.positions) for m in meshes) / faces, 3),
        "edge_m": round(typical_edge_m(meshes), 4),
    }


def dressed(mesh: SegmentMesh, kind: str, texel_m: float) -> SegmentMesh:
    """Put the mesh in cache order once; exchange colours for coordinates where asked."""
    mesh = replace(mesh, faces=mesh.faces[order_for_cache(mesh.faces)])
    if kind == "coloured":
        return mesh
    flat = mesh.positions[:, [0, 2]].astype(np.float64)
    texels = (flat - flat.min(axis=0)) / texel_m + 4.0
    side = SMALLEST_JPEG_SIDE
    while side < min(texels.max() + 4.0, 2048):
        side *= 2
    uvs = np.clip(texels / side, 0.0, 1.0).astype(np.float32)
    image = io.BytesIO()
    Image.new("RGB", (side, side)).save(image, "JPEG")
    return replace(mesh, colours=None, uvs=uvs, texture=Texture.of(image.getvalue()))


def compare(meshes: list[SegmentMesh], spacing_m: float, draco: Any | None) -> dict[str, Any]:
    """Every way on the same segments."""
    widest_m = max(float(np.ptp(m.positions, axis=0).max()) for m in meshes)
    farthest_m = max(float(np.abs(m.positions).max()) for m in meshes)
    finest_m = choose_step_m(widest_m, farthest_m)
    ours_m = choose_step_m(widest_m, farthest_m, spacing_m)
    rows = {name: Row() for name in ("raw", "quantised", "meshopt", "before", "ours")}
    for mesh in meshes:
        add_plain(rows["raw"], mesh)
        add_glb(rows["quantised"], mesh, ours_m, compress=False)
        add_meshopt(rows["meshopt"], mesh)
        add_before(rows["before"], mesh, finest_m)
        add_glb(rows["ours"], mesh, ours_m, compress=True)
        if draco is not None:
            span = float(np.ptp(mesh.positions, axis=0).max())
            same = int(np.ceil(np.log2(span / ours_m)))
            for name, bits in (("Draco 14 bits", 14), ("Draco as ours", same)):
                add_draco(rows.setdefault(name, Row()), mesh, draco, bits)
    return {
        "step_mm": {"before": finest_m * 1000, "ours": ours_m * 1000},
        "ways": {name: row.figures() for name, row in rows.items()},
    }


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Give the result and the least CPU seconds of some runs."""
    least, result = np.inf, None
    for _ in range(ROUNDS):
        start = time.process_time()
        result = work()
        least = min(least, time.process_time() - start)
    return result, least


def account(row: Row, mesh: SegmentMesh, data: bytes) -> None:
    row.bytes += len(data)
    row.zstd += zstd_bytes(data)
    row.faces += len(mesh.faces)


def away(decoded: np.ndarray, mesh: SegmentMesh) -> np.ndarray:
    """Distance of every decoded vertex to the truth's nearest, metres."""
    distance, _ = cKDTree(mesh.positions.astype(np.float64)).query(decoded.astype(np.float64))
    return distance


def columns(mesh: SegmentMesh) -> Iterator[np.ndarray]:
    """Positions, normals, and colours or coordinates."""
    yield mesh.positions
    yield mesh.normals
    if mesh.colours is not None:
        yield np.column_stack([mesh.colours, np.full(len(mesh.colours), 255, np.uint8)])
    if mesh.uvs is not None:
        yield mesh.uvs


def add_plain(row: Row, mesh: SegmentMesh) -> None:
    account(row, mesh, b"".join(array.tobytes() for array in (*columns(mesh), mesh.faces)))
    row.errors.append(np.zeros(1))


def add_glb(row: Row, mesh: SegmentMesh, step_m: float, *, compress: bool) -> None:
    def encode() -> bytes:
        return encode_glb(mesh, step_m=step_m, attribute_scales={}, compress=compress)

    data, seconds = timed(encode)
    account(row, mesh, without_image(data, mesh))
    row.encode_s += seconds
    decoded, seconds = timed(lambda: decode_glb(data))
    row.decode_s += seconds
    row.errors.append(away(decoded.positions, mesh))
    if compress:
        row.kernel_s += kernel_seconds(data)


def without_image(data: bytes, mesh: SegmentMesh) -> bytes:
    """Cut the image off: it is the last part, filled up to four bytes."""
    length = 0 if mesh.texture is None else len(mesh.texture.data)
    return data[: len(data) - length - -length % 4] if length else data


def kernel_seconds(data: bytes) -> float:
    """Time the native decoders alone on every compressed view."""
    document, binary, _ = split_glb(data)
    views = []
    for view in document["bufferViews"]:
        packed = view.get("extensions", {}).get("EXT_meshopt_compression")
        if packed is not None:
            start = packed.get("byteOffset", 0)
            raw = bytes(binary[start : start + packed["byteLength"]])
            shape = (packed["count"], packed["byteStride"], packed["mode"])
            views.append((raw, *shape, packed.get("filter", "NONE")))

    def decode() -> None:
        for raw, count, stride, mode, name in views:
            meshopt.decode_gltf_buffer(raw, count, stride, mode, name)

    return timed(decode)[1]


def add_before(row: Row, mesh: SegmentMesh, step_m: float) -> None:
    """Today's GLB with yesterday's buffers in place of its own: sizes only."""
    data = without_image(encode_glb(mesh, step_m=step_m, attribute_scales={}), mesh)
    remap = fetch_order(mesh)
    bits = NORMAL_BITS if mesh.texture is None else TEXTURED_NORMAL_BITS
    extra = len(oct_normals(mesh, remap, 8)) - len(oct_normals(mesh, remap, bits))
    if mesh.uvs is not None and mesh.texture is not None:
        sides = np.array([mesh.texture.width, mesh.texture.height])
        now = np.rint(mesh.uvs[remap] * (2 * sides)).astype("<u2")
        extra += len(packed(np.rint(mesh.uvs[remap] * 65535).astype("<u2"))) - len(packed(now))
    row.bytes += len(data) + extra
    row.faces += len(mesh.faces)
    row.errors.append(away(np.rint(mesh.positions.astype(np.float64) / step_m) * step_m, mesh))


def fetch_order(mesh: SegmentMesh) -> np.ndarray:
    """Vertices in the order in which the faces use them first; unused ones last."""
    _, first = np.unique(mesh.faces.reshape(-1), return_index=True)
    used = mesh.faces.reshape(-1)[np.sort(first)].astype(np.int64)
    return np.concatenate([used, np.setdiff1d(np.arange(len(mesh.positions)), used)])


def packed(rows: np.ndarray, mode: str = "ATTRIBUTES") -> bytes:
    """One buffer view, compressed by meshoptimizer."""
    return bytes(meshopt.encode_gltf_buffer(np.ascontiguousarray(rows), mode, 0))


def oct_normals(mesh: SegmentMesh, order: np.ndarray, bits: int) -> bytes:
    """Encode normals as the octahedral filter does."""
    rows = np.zeros((len(order), 4), np.float32)
    rows[:, :3] = mesh.normals[order]
    return packed(meshopt.encode_filter_oct(rows, 4, bits))


def add_meshopt(row: Row, mesh: SegmentMesh) -> None:
    """Encode what gltfpack -c would store, without its JSON."""
    low = mesh.positions.min(axis=0).astype(np.float64)
    step_m = float(np.ptp(mesh.positions, axis=0).max()) / 16383

    def encode() -> list[bytes]:
        order = fetch_order(mesh)
        number = np.empty(len(order), np.uint32)
        number[order] = np.arange(len(order), dtype=np.uint32)
        codes = np.zeros((len(order), 4), "<u2")
        codes[:, :3] = np.rint((mesh.positions[order] - low) / step_m)
        buffers = [packed(codes), oct_normals(mesh, order, 8)]
        if mesh.colours is not None:
            alpha = np.full(len(order), 255, np.uint8)
            buffers.append(packed(np.column_stack([mesh.colours[order], alpha])))
        if mesh.uvs is not None:
            buffers.append(packed(np.rint(mesh.uvs[order] * 65535).astype("<u2")))
        wide = "<u2" if len(order) <= 65535 else "<u4"
        return [*buffers, packed(number[mesh.faces].reshape(-1).astype(wide), "TRIANGLES")]

    buffers, seconds = timed(encode)
    account(row, mesh, b"".join(buffers))
    row.encode_s += seconds
    rounded = np.rint((mesh.positions - low) / step_m) * step_m + low
    row.errors.append(away(rounded, mesh))


def add_draco(row: Row, mesh: SegmentMesh, draco: Any, bits: int) -> None:
    colours = None if mesh.colours is None else mesh.colours
    options: dict[str, Any] = {"quantization_bits": bits, "compression_level": 7}
    options["normal_quantization_bits"] = 8
    if colours is not None:
        options["colors"] = colours
    if mesh.uvs is not None:
        options |= {"tex_coord": mesh.uvs.astype(np.float64), "tex_coord_quantization_bits": 12}

    def encode() -> bytes:
        return draco.encode(
            mesh.positions, faces=mesh.faces, normals=mesh.normals.astype(np.float64), **options
        )

    data, seconds = timed(encode)
    account(row, mesh, data)
    row.encode_s += seconds
    decoded, seconds = timed(lambda: draco.decode(data))
    row.decode_s += seconds
    row.errors.append(away(np.asarray(decoded.points), mesh))


def draw(name: str, kind: str, result: dict[str, Any]) -> None:
    """Print one kind of payload as a table: a row for each way of encoding."""
    compared = result[kind]
    steps = ", ".join(f"{key} {value:.3g}" for key, value in compared["step_mm"].items())
    print(f"\n{name}, {kind}: {result['segments']} segments, {result['faces']:,} faces, ", end="")
    print(f"spacing {result['spacing_m']} m, grid step mm: {steps}")
    heads = ("bytes", "zstd", "encode_mtri", "decode_mtri", "kernel_mtri", "p95_mm", "max_mm")
    print(f"| {'way':14} | " + " | ".join(f"{head:>11}" for head in heads) + " |")
    for way, row in compared["ways"].items():
        cells: Iterable[str] = (f"{row[h]:11.3f}" if h in row else " " * 11 for h in heads)
        print(f"| {way:14} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
