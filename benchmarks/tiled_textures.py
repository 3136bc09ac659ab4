"""Textures of a build in several tiles beside those of the same build in one.

A synthetic quarry with a drone's photos is built twice by ``terraport build --photos``, with a
``--tile-depth`` that gives one tile and with one that gives several. Measured on what was
published:

* *held out*: pictures from cameras that took no photo, against the truth there; *surface*: places
  spread evenly over the mesh, against the true colour (as textures.py);
* *step*: how far the colour jumps across an edge of the mesh, both sides sampled at the edge's
  middle: inside a segment where two charts meet, where two segments of one tile meet, where two
  tiles meet. Levels of 255, mean of the channels.

    python benchmarks/tiled_textures.py
    python benchmarks/tiled_textures.py --smoke
    python benchmarks/tiled_textures.py --keep FOLDER --pictures FOLDER

Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from parts.first_steps import single_tile_depth
from parts.texture_scores import ColouredMesh, score_surface, score_views, truth_of
from PIL import Image

from terraport_pipeline.engines.texturing import bilinear
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.published.scene_model import SceneModel, load_scene_model
from terraport_pipeline.synth.camera_eye import CameraEye
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import plan_flight, seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import photo_edge_m, write_photos
from terraport_pipeline.synth.quarry import Quarry
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene

THREADS: Final = max(1, min(os.cpu_count() or 1, 2))
PLACES: Final = 200_000
HELD_OUT_SEED: Final = 1_000
"""Added to the quarry's seed for the flight of the cameras that are held out."""

KINDS: Final = ("charts of a segment", "segments of a tile", "tiles")


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Survey, photos and the truth."""

    folder: Path
    quarry: Quarry
    eye: CameraEye
    held_out: tuple[Any, ...]
    truths: list[Any]
    gsd_m: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--size", type=float, default=150.0)
    parser.add_argument("--photos", type=int, default=30)
    parser.add_argument("--photo-size", type=int, nargs=2, default=(1000, 750))
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--tile-depth", type=int, help="one less than of a single tile")
    parser.add_argument("--keep", type=Path, help="folder for everything; taken up next time")
    parser.add_argument("--pictures", type=Path, help="folder for the held-out pictures")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.points, arguments.size = 15_000, 110.0
        arguments.photos, arguments.photo_size = 6, (240, 180)
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-tiled-textures-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        run(folder, arguments)
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


def run(folder: Path, arguments: argparse.Namespace) -> None:
    site = prepare(folder, arguments)
    whole_depth = single_tile_depth(folder / "quarry.laz", folder / "whole.work")
    print(
        "| build | faces | tiles | held out dB | matched dB | median dB | surface matched dB | "
        "median dB | "
        + " | ".join(f"step between {kind}: median, p95, edges" for kind in KINDS)
        + " |"
    )
    print("|---|" + "---:|" * (7 + len(KINDS)))
    for name, tile_depth in (
        ("whole", whole_depth),
        ("tiles", arguments.tile_depth or whole_depth - 1),
    ):
        # A scene of an earlier run is taken as it is (--keep).
        scene = folder / name
        if not (scene / "scene.json").is_file():
            build(build_options(site, scene, tile_depth))
        with Scene.open(scene) as opened:
            model = load_scene_model(opened)
            origin = np.array(opened.manifest.origin)
        tile_of = np.load(folder / f"{name}.work" / "segment" / "tile.npy").astype(np.int64)
        mesh = coloured(model, shift_of(site.quarry, origin))
        # Against photos nobody saw, against the surface's true colours, and along seams.
        far, pictures = score_views(mesh, site.held_out, site.truths)
        near = score_surface(mesh, site.eye, count=PLACES, texel_m=site.gsd_m)
        seam_columns = [
            f"{np.median(steps):.2f}, {np.percentile(steps, 95):.1f}, {len(steps):,}"
            if len(steps)
            else ""
            for steps in seam_steps(model, tile_of)
        ]
        print(
            f"| {name} | {len(model.detail.faces):,} | {int(tile_of.max()) + 1} | "
            f"{far.psnr_db:.2f} | {far.matched_db:.2f} | {far.median_db:.2f} | "
            f"{near.matched_db:.2f} | {near.median_db:.2f} | " + " | ".join(seam_columns) + " |",
            flush=True,
        )
        texture = next(
            row for row in json.loads((scene / "build.json").read_text())["stages"]
            if row["name"] == "texture"
        )  # fmt: skip
        print(f"<!-- {texture['seconds']} s, {texture['peak_bytes'] / 2**20:.0f} MiB -->")
        if arguments.pictures is not None:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            for number, picture in enumerate(pictures):
                Image.fromarray(picture).save(arguments.pictures / f"{number}-{name}.png")


def build_options(site: Site, scene: Path, tile_depth: int) -> BuildOptions:
    return BuildOptions(
        site.folder / "quarry.laz",
        scene,
        work=scene.with_suffix(".work"),
        threads=THREADS,
        texture=Texturing(
            photos=site.folder / "photos" / "images", cameras=site.folder / "photos" / "colmap"
        ),
        tiles=TileOptions(depth=tile_depth),
    )


def prepare(folder: Path, arguments: argparse.Namespace) -> Site:
    """Survey and photograph the site."""
    width, height = arguments.photo_size
    flight = FlightOptions(count=arguments.photos, width=width, height=height)
    quarry = seen_by(
        flight, QuarryOptions(points=arguments.points, seed=arguments.seed, size_m=arguments.size)
    )
    plan = plan_flight(flight, quarry)
    if not (folder / "photos").is_dir():
        write_photos(quarry, flight, folder / "photos", threads=THREADS)
        write_quarry(quarry, folder / "quarry.laz", overwrite=True)
    other = plan_flight(
        FlightOptions(count=max(6, arguments.photos // 4), width=width, height=height),
        QuarryOptions(
            points=1_000, seed=arguments.seed + HELD_OUT_SEED, size_m=arguments.size * 0.8
        ),
    )
    held_out = (*other.views[:3], *other.views[-3:])
    eye = CameraEye(quarry, photo_edge_m(plan, quarry), threads=THREADS)
    path = folder / "truths.npz"
    if not path.is_file():
        pictures = truth_of(eye, held_out)
        np.savez(
            path,
            colours=[picture[0] for picture in pictures],
            what=[picture[1] for picture in pictures],
        )
    with np.load(path) as kept:
        truths = list(zip(kept["colours"], kept["what"], strict=True))
    return Site(folder, quarry, eye, held_out, truths, plan.gsd_m)


def shift_of(quarry: Any, origin: np.ndarray) -> np.ndarray:
    """From the scene's frame to the truth's."""
    crs = origin - (quarry.easting_m, quarry.northing_m, quarry.elevation_m)
    return np.array([crs[0], crs[2], -crs[1]])


def coloured(model: SceneModel, shift: np.ndarray) -> ColouredMesh:
    assert model.textures is not None
    detail = model.detail
    return ColouredMesh(
        (detail.vertices + shift).astype(np.float32), detail.faces, detail.colours,
        model.textures.detail,
    )  # fmt: skip


def seam_steps(model: SceneModel, tile_of: np.ndarray) -> Iterator[np.ndarray]:
    """Step of the colour across the edges of every kind; see KINDS."""
    assert model.textures is not None
    detail, texturing = model.detail, model.textures.detail
    position_ids = places(detail.vertices)
    pairs, edges = face_pairs(
        position_ids[detail.faces].astype(np.int32), int(position_ids.max()) + 1
    )
    segment = model.segment_of_face[pairs]
    corner_places = position_ids[detail.faces]
    uvs, own = [], []
    for side in (0, 1):
        face = pairs[:, side]
        ends = [np.argmax(corner_places[face] == edges[:, end, None], axis=1) for end in (0, 1)]
        rows = np.stack([detail.faces[face, end] for end in ends], axis=1)
        own.append(rows)
        uvs.append(texturing.uvs[rows].mean(axis=1))
    inside = (own[0] == own[1]).all(axis=1)
    same_segment = segment[:, 0] == segment[:, 1]
    tile = tile_of[segment]
    same_tile = tile[:, 0] == tile[:, 1]
    colours = [sampled(texturing, segment[:, side], uvs[side]) for side in (0, 1)]
    step = np.abs(colours[0] - colours[1]).mean(axis=1)
    yield step[same_segment & ~inside]
    yield step[~same_segment & same_tile]
    yield step[~same_tile]


def places(vertices: np.ndarray) -> np.ndarray:
    """Give every vertex the number of its place: equal positions have one."""
    bits = np.ascontiguousarray(vertices + np.float32(0.0)).view(np.int32)
    return np.unique(bits, axis=0, return_inverse=True)[1].ravel()


def sampled(texturing: Any, image: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    colours = np.zeros((len(image), 3), np.float32)
    order = np.argsort(image, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(image[order])) + 1):
        if len(rows):
            colours[rows] = bilinear(texturing.images.get(int(image[rows[0]]), 0), uvs[rows])
    return colours


if __name__ == "__main__":
    sys.exit(main())
