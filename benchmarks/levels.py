"""Two levels beside one: payload bytes for the same picture at eye height.

What a landing shows is drawn from eyes 1.7 m above the ground of random places, in four directions,
and held against full detail everywhere: once with full detail to a radius and the base beyond, as
with one level, once with the coarser level in a ring between the two. The error is the root mean
square of the colours' differences (sRGB, 0..255, sky counts as a colour); each ring is compared
with the bytes that one level takes for its error, between two radii by interpolation.

    python benchmarks/levels.py SCENE [--places 4] [--share 0.3] [--what-if]
    python benchmarks/levels.py --smoke

With --share the coarser level is made here, so that a scene of one level will do. With --what-if
each ring is drawn four more times: with the colours of the base's image along the same rays, with
full detail's own colours, with its normals, and with both. That bounds what a finer image of the
level, or a map of normals, could gain, whatever it cost.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload import SegmentMesh, box_distances_m, decode_segment
from terraport_pipeline.engines.coarser import coarser
from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.handoff_rays import hidden_base_faces
from terraport_pipeline.stages.pack import encode_payload
from terraport_store import Scene
from terraport_store.layout import BASE

SURVEY: Final = Path(__file__).resolve().parents[1] / "data" / "sample_quarry_60k.laz"
EYE_M: Final = 1.7
WIDTH, HEIGHT = 192, 108
OVERSAMPLING: Final = 2
SKY: Final = np.array([170.0, 195.0, 225.0])
LIGHT: Final = np.array([0.4, 0.8, 0.45]) / np.linalg.norm([0.4, 0.8, 0.45])
RADII_M: Final = (5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0)
RINGS: Final = ((5.0, 15.0), (7.5, 22.5), (10.0, 30.0), (15.0, 45.0), (20.0, 60.0), (30.0, 90.0))


@dataclass(frozen=True, slots=True)
class Soup:
    """Faces of many meshes, ready to be drawn."""

    corners: Any
    """(F, 3, 3) metres."""
    normals: Any
    """(F, 3, 3)."""
    colours: Any
    """(F, 3, 3) sRGB; of a textured mesh (F, 3, 2) places in the image instead."""
    owner: Any
    """(F,) segment."""


def soup(meshes: list[SegmentMesh]) -> Soup:
    """Take meshes apart into faces."""
    return Soup(
        np.concatenate([m.positions[m.faces] for m in meshes]).astype(np.float32),
        np.concatenate([m.normals[m.faces] for m in meshes]).astype(np.float32),
        np.concatenate(
            [(m.uvs if m.colours is None else m.colours)[m.faces] for m in meshes]  # type: ignore[index]
        ).astype(np.float32),
        np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]),
    )


@dataclass(frozen=True, slots=True)
class Seen:
    """What R rays meet."""

    colours: Any
    """(R, 3) sRGB; NaN: sky."""
    normals: Any
    """(R, 3)."""
    is_coarse: Any
    """(R,) whether it is the coarser level."""

    def picture(self) -> Any:
        """Draw it, lit."""
        out = np.tile(SKY, (len(self.colours), 1))
        met = ~np.isnan(self.colours[:, 0])
        light = 0.45 + 0.55 * np.maximum(self.normals[met] @ LIGHT, 0)
        out[met] = self.colours[met] * light[:, None]
        return _pixels(out)

    def with_ring_of(self, *, colours: Seen | None = None, normals: Seen | None = None) -> Seen:
        """Give the coarser level what others see along the same rays."""
        c, n = self.colours.copy(), self.normals.copy()
        for mine, other in (
            (c, colours and colours.colours),
            (n, normals and normals.normals),
        ):
            if other is not None:
                there = self.is_coarse & ~np.isnan(other[:, 0])
                mine[there] = other[there]
        return Seen(c, n, self.is_coarse)


class Bench:
    """One scene, all its levels in memory."""

    def __init__(self, scene: Scene, share: float | None) -> None:
        count = len(scene.index)
        detail = [scene.mesh(segment) for segment in range(count)]
        if share is None:
            coarse = [scene.mesh(count + segment) for segment in range(count)]
            lengths = scene.rows.length[count:].astype(np.int64)
        else:
            scales, step_m = scene.manifest.scales, scene.manifest.step_m
            payloads = [
                encode_payload(coarser(mesh, share), step_m, scales).data for mesh in detail
            ]
            coarse = [decode_segment(payload, scales=scales) for payload in payloads]
            lengths = np.array([len(payload) for payload in payloads])
        base = scene.file_mesh(BASE)
        self.image = None if base.texture is None else decode_image(base.texture.data)
        self.levels = (soup(detail), soup(coarse))
        self.base = soup([base])
        self.lengths = (scene.index.length.astype(np.int64), lengths)
        self.bounds, self.cover = scene.index.bounds, scene.cover
        self.deviation_m = scene.manifest.hand_off.deviation_m
        self.ground = RayScene(*_indexed(self.levels[0].corners))

    def shown(self, eye: Any, full_m: float, coarse_m: float) -> tuple[list[Soup], int]:
        """Give the faces that a landing under the eye shows, and its payload bytes."""
        distance = box_distances_m(self.bounds, eye - np.array([0, EYE_M, 0]))
        wanted = (distance <= full_m, (distance > full_m) & (distance <= coarse_m))
        hidden = hidden_base_faces(self.cover.offsets, self.cover.segments, wanted[0] | wanted[1])
        parts = [_chosen(s, w[s.owner]) for s, w in zip(self.levels, wanted, strict=True)]
        back = _chosen(self.base, ~hidden)
        sight = back.corners - eye
        sight /= np.maximum(np.linalg.norm(sight, axis=2, keepdims=True), 1e-6)
        pushed = (back.corners + sight * self.deviation_m).astype(np.float32)
        parts.append(Soup(pushed, back.normals, back.colours, back.owner))
        size = sum(int(n[w].sum()) for n, w in zip(self.lengths, wanted, strict=True))
        return parts, size

    def seen(self, parts: list[Soup], eye: Any, directions: Any) -> Seen:
        """Find what lies along the rays."""
        corners = np.concatenate([part.corners for part in parts])
        hits = RayScene(*_indexed(corners)).intersect(
            np.tile(eye, (len(directions), 1)), directions
        )
        colours, normals = np.full((2, len(directions), 3), np.nan)
        is_coarse = np.zeros(len(directions), np.bool_)
        first = 0
        for number, part in enumerate(parts):
            rows = np.flatnonzero((hits.face >= first) & (hits.face < first + len(part.corners)))
            face = hits.face[rows] - first
            first += len(part.corners)
            weight = np.stack([1 - hits.u[rows] - hits.v[rows], hits.u[rows], hits.v[rows]], axis=1)
            value = (part.colours[face] * weight[:, :, None]).sum(axis=1)
            if number == len(parts) - 1 and self.image is not None:
                value = _sampled(self.image, value)
            normal = (part.normals[face] * weight[:, :, None]).sum(axis=1)
            normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
            colours[rows], normals[rows], is_coarse[rows] = value, normal, number == 1
        return Seen(colours, normals, is_coarse)


def _indexed(corners: Any) -> tuple[Any, Any]:
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)


def _chosen(whole: Soup, chosen: Any) -> Soup:
    return Soup(
        whole.corners[chosen], whole.normals[chosen], whole.colours[chosen], whole.owner[chosen]
    )


def _sampled(image: Any, uvs: Any) -> Any:
    """Look up an image between its texels."""
    height, width, _ = image.shape
    at = np.clip(uvs * [width, height] - 0.5, 0, [width - 1.001, height - 1.001])
    low = at.astype(int)
    x, y = (at - low).T[:, :, None]
    column, row = low.T
    column_1, row_1 = np.minimum(column + 1, width - 1), np.minimum(row + 1, height - 1)
    top = image[row, column] * (1 - x) + image[row, column_1] * x
    return top * (1 - y) + (image[row_1, column] * (1 - x) + image[row_1, column_1] * x) * y


def _rays() -> Any:
    """Directions of four pictures around, 90 degrees wide, a little downwards."""
    x = ((np.arange(WIDTH * OVERSAMPLING) + 0.5) / (WIDTH * OVERSAMPLING) - 0.5) * 2
    y = ((np.arange(HEIGHT * OVERSAMPLING) + 0.5) / (HEIGHT * OVERSAMPLING) - 0.5) * -2
    across, up = np.meshgrid(x, y * HEIGHT / WIDTH - 0.15)
    rays = np.stack([across, up, -np.ones_like(across)], axis=-1).reshape(-1, 3)
    around = []
    for turn in range(4):
        c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
        around.append(rays @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    directions = np.concatenate(around)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _pixels(rays: Any) -> Any:
    n = OVERSAMPLING
    return rays.reshape(4, HEIGHT, n, WIDTH, n, 3).mean(axis=(2, 4))


def main() -> None:
    """Make a scene where that is asked for, and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, nargs="?", help="with colours at its vertices")
    parser.add_argument("--places", type=int, default=4)
    parser.add_argument("--share", type=float)
    parser.add_argument("--what-if", action="store_true")
    parser.add_argument("--smoke", action="store_true", help="one place of a small quarry")
    options = parser.parse_args()
    if options.smoke:
        with tempfile.TemporaryDirectory(prefix="benchmark-levels-") as folder:
            scene = Path(folder) / "scene"
            terraport = str(Path(sys.executable).with_name("terraport"))
            subprocess.run(
                [terraport, "build", str(SURVEY), "-o", str(scene), "--max-points", "10k",
                 "--levels", "2", "--no-report", "--quiet"],
                check=True,
            )  # fmt: skip
            measure(scene, 1, None, what_if=True)
    elif options.scene is None:
        parser.error("a scene is wanted, or --smoke")
    else:
        measure(options.scene, options.places, options.share, what_if=options.what_if)


def measure(scene_dir: Path, places: int, share: float | None, *, what_if: bool) -> None:
    """Compare landings of both levels with such of one, and print tables."""
    rng, started_s = np.random.default_rng(24), time.process_time()
    with Scene.open(scene_dir) as scene:
        bench = Bench(scene, share)
    full, coarse = (part.sum() for part in bench.lengths)
    faces = [len(level.corners) for level in bench.levels]
    print(f"{scene_dir.name}: {len(bench.bounds)} segments, {faces[0]} and {faces[1]} faces")
    print(
        f"coarser level: {coarse / full:.3f} of the bytes, {faces[1] / faces[0]:.3f} of the faces"
    )
    directions = _rays()
    middle = bench.bounds.reshape(-1, 2, 3).mean(axis=1)
    inner = np.argsort(np.linalg.norm(middle - np.median(middle, axis=0), axis=1))
    totals: dict[tuple[float, float, str], list[tuple[int, float]]] = {}
    everything = 1e9
    for segment in rng.choice(inner[: max(1, len(inner) // 2)], places, replace=False):
        above = middle[segment] + [0, 200, 0]
        t = bench.ground.intersect([above], [[0, -1, 0]]).t[0]
        eye = above + np.array([0, EYE_M - t, 0])
        whole = bench.seen(bench.shown(eye, everything, everything)[0], eye, directions)
        base = bench.seen(bench.shown(eye, -1.0, -1.0)[0], eye, directions)
        truth = whole.picture()
        for full_m, ring_m in [(r, r) for r in RADII_M] + list(RINGS):
            parts, size = bench.shown(eye, full_m, ring_m)
            own = bench.seen(parts, eye, directions)
            looks = {"": own}
            if what_if and ring_m > full_m:
                looks |= {
                    "base's colours": own.with_ring_of(colours=base),
                    "true colours": own.with_ring_of(colours=whole),
                    "true normals": own.with_ring_of(normals=whole),
                    "both true": own.with_ring_of(colours=whole, normals=whole),
                }
            for name, look in looks.items():
                error = float(np.mean((look.picture() - truth) ** 2))
                totals.setdefault((full_m, ring_m, name), []).append((size, error))
    rows = {
        radii: (
            float(np.mean([size for size, _ in some])),
            float(np.sqrt(np.mean([e for _, e in some]))),
        )
        for radii, some in totals.items()
    }
    plain = [(error, size) for (r, c, _), (size, error) in rows.items() if r == c]
    plain.sort()
    print(f"{'full m':>7} {'ring m':>7} {'kB':>8} {'error':>7} {'kB, one level':>14} {'share':>6}")
    for (r, c, name), (mean_bytes, rms) in rows.items():
        text = f"{r:7g} {c if c > r else 0:7g} {mean_bytes / 1e3:8.0f} {rms:7.3f}"
        if c > r:
            due = float(np.interp(rms, [e for e, _ in plain], [s for _, s in plain]))
            text += f" {due / 1e3:14.0f} {mean_bytes / due:6.2f} {name}"
        print(text)
    print(f"CPU {time.process_time() - started_s:.0f} s")


if __name__ == "__main__":
    main()
