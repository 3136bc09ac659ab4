"""Textures against the truth: how near the colours come to what is there.

A synthetic quarry is surveyed (cloud) and photographed (lens distortion, exposure drift,
vignetting, sensor noise, JPEG, a truck that stands elsewhere in every photo). The cloud is
reconstructed once; then every method colours the same mesh:

* textures of this project; without levelling; without rejection of outliers;
* the vertices' colours, and the same drawn into textures (the thesis's comparison);
* PyMeshLab and Open3D, where a Python that has them is given (``--other-python``; see
  parts/texture_engines.py). They know no distortion: they are given photos without it.

Measured: *held out*, pictures from cameras that took no photo, against the truth there (day's
light, no truck, no errors of a camera); *surface*, places spread evenly over the mesh against the
true colour there; *truck*, the share of its pixels that a texture kept.

    python benchmarks/textures.py
    python benchmarks/textures.py --smoke
    python benchmarks/textures.py --other-python VENV/bin/python --pictures FOLDER

Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from parts.texture_scores import (
    ColouredMesh,
    ghost_share,
    score_surface,
    score_views,
    truth_of,
    undistort,
)
from parts.work_arrays import read_base, read_segments, read_tiles, welded
from PIL import Image

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.engines.photos import OpenPhotos, open_photos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.texturing import ImageCache, Texturing
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.model import Mesh
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import choose_views as choosing
from terraport_pipeline.stages.texture import Options, texture_mesh
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.view_gains import view_gains
from terraport_pipeline.synth.camera_eye import CameraEye
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import plan_flight, seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import photo_edge_m, write_photos
from terraport_pipeline.workflow.build import BuildOptions, build

THREADS: Final = max(1, min(os.cpu_count() or 1, 2))
MAX_OPEN3D_FACES: Final = 50_000
"""Its parametrisation of 36,000 took 115 CPU-s."""

PLACES: Final = 200_000
HELD_OUT_SEED: Final = 1_000
"""Added to the quarry's seed for the flight of the cameras that are held out."""


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Everything that methods start from, and the truth. Meshes and views in the truth's frame."""

    folder: Path
    mesh: Mesh
    base: Mesh
    segments: np.ndarray
    opened: OpenPhotos
    views: tuple[View, ...]
    gsd_m: float
    eye: CameraEye
    held_out: tuple[View, ...]
    truths: list[Any]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--size", type=float, default=150.0)
    parser.add_argument("--photos", type=int, default=30)
    parser.add_argument("--photo-size", type=int, nargs=2, default=(1000, 750))
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--other-python", type=Path, help="a Python with pymeshlab, open3d")
    parser.add_argument("--keep", type=Path, help="folder for everything; taken up next time")
    parser.add_argument("--pictures", type=Path, help="folder for the held-out pictures")
    parser.add_argument("--only", nargs="*", help="methods, by the beginning of their names")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.points, arguments.size = 8_000, 60.0
        arguments.photos, arguments.photo_size = 6, (240, 180)
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-textures-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        run(folder, arguments)
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


def run(folder: Path, arguments: argparse.Namespace) -> None:
    site = prepare(folder, arguments)
    photos = [site.opened.photos.get(number) for number in range(len(site.views))]
    masks = [
        np.asarray(Image.open(folder / "photos/truth/masks" / f"{Path(view.name).stem}.png"))
        for view in site.views
    ]
    print(
        f"{len(site.mesh.faces):,} faces, {len(site.views)} photos of {photos[0].shape[1]} x "
        f"{photos[0].shape[0]}, {site.gsd_m * 100:.1f} cm a pixel; {len(site.held_out)} cameras "
        f"held out, {THREADS} threads\n"
    )
    columns = "held out dB | matched dB | median dB | surface matched dB | median dB | truck kept"
    print(f"| method | {columns} | Mtexels | wall s | CPU s |")
    print("|---|" + "---:|" * 9)
    for name, make in methods(site, arguments.other_python):
        if arguments.only and not any(name.startswith(prefix) for prefix in arguments.only):
            continue
        with timed() as spent:
            model, texels = make()
        if model is None:
            print(f"| {name} | {texels} |" + " |" * 8, flush=True)
            continue
        far, pictures = score_views(model, site.held_out, site.truths)
        near = score_surface(model, site.eye, count=PLACES, texel_m=site.gsd_m)
        ghosts = ghost_share(model, site.eye, site.views, photos, masks)
        print(
            f"| {name} | {far.psnr_db:.2f} | {far.matched_db:.2f} | {far.median_db:.2f} | "
            f"{near.matched_db:.2f} | {near.median_db:.2f} | {ghosts:.1%} | {texels / 1e6:.1f} | "
            f"{spent['wall']:.1f} | {spent['cpu']:.1f} |",
            flush=True,
        )
        if arguments.pictures is not None:
            save_pictures(arguments.pictures, name, pictures)
    if arguments.pictures is not None:
        truths = [np.clip(colours, 0, 255).astype(np.uint8) for colours, _ in site.truths]
        save_pictures(arguments.pictures, "truth", truths)


def prepare(folder: Path, arguments: argparse.Namespace) -> Site:
    """Survey, photograph and reconstruct the site."""
    # The quarry as the flight sees it, its photos and its scene.
    width, height = arguments.photo_size
    flight = FlightOptions(count=arguments.photos, width=width, height=height)
    quarry = seen_by(
        flight, QuarryOptions(points=arguments.points, seed=arguments.seed, size_m=arguments.size)
    )
    plan = plan_flight(flight, quarry)
    if not (folder / "photos").is_dir():
        write_photos(quarry, flight, folder / "photos", threads=THREADS)
        write_quarry(quarry, folder / "quarry.laz", overwrite=True)
    work = folder / "work"
    if not (folder / "scene" / "scene.json").is_file():  # else of an earlier run: --keep
        build(BuildOptions(folder / "quarry.laz", folder / "scene", work=work, threads=THREADS))
    # Cameras in the frame of the quarry, which lies elsewhere than the scene's origin.
    origin = np.load(work / "clean" / "origin.npy")
    cameras = read_cameras(folder / "photos" / "colmap", origin=origin, crs=None)
    opened = open_photos(cameras.views, folder / "photos" / "images", max_bytes=1 << 30)
    shift_crs = origin - (quarry.easting_m, quarry.northing_m, quarry.elevation_m)
    shift = np.array([shift_crs[0], shift_crs[2], -shift_crs[1]])
    views = tuple(
        View(view.name, view.lens, view.rotation, view.position + shift) for view in opened.views
    )
    other = plan_flight(
        FlightOptions(count=max(6, arguments.photos // 4), width=width, height=height),
        QuarryOptions(
            points=1_000, seed=arguments.seed + HELD_OUT_SEED, size_m=arguments.size * 0.8
        ),
    )
    # From other places, nearer, and both kinds: three straight down, three oblique.
    held_out = (*other.views[:3], *other.views[-3:])
    eye = CameraEye(quarry, photo_edge_m(plan, quarry), threads=THREADS)
    return Site(
        folder,
        _shifted(welded(read_tiles(work)), shift),
        _shifted(read_base(work), shift),
        read_segments(work),
        opened,
        views,
        plan.gsd_m,
        eye,
        held_out,
        _truths(folder, eye, held_out),
    )


def _truths(folder: Path, eye: CameraEye, views: tuple[View, ...]) -> list[Any]:
    """Look through the held-out cameras; kept in the folder, since every run asks again."""
    path = folder / "truths.npz"
    if not path.is_file():
        truths = truth_of(eye, views)
        np.savez(path, colours=[truth[0] for truth in truths], what=[truth[1] for truth in truths])
    with np.load(path) as kept:
        return list(zip(kept["colours"], kept["what"], strict=True))


def _shifted(mesh: Mesh, shift: Float64) -> Mesh:
    return replace(mesh, vertices=(mesh.vertices + shift).astype(np.float32))


def methods(site: Site, other_python: Path | None) -> Iterator[tuple[str, Any]]:
    """Name every method, with what makes its mesh and counts its texels."""
    option_names = {field.name for field in fields(choosing.Options)}

    def ours(gains: bool = True, **switches: Any) -> Any:
        missing = sorted(set(switches) - option_names)
        if missing:
            return None, f"choose_views has no option {', '.join(missing)}"
        return textured(site, gains=gains, switches=switches)

    yield "textures", ours
    yield "textures, no levelling", lambda: ours(gains=False, level_seams=False)
    yield "textures, gains only", lambda: ours(level_seams=False)
    yield "textures, outliers kept", lambda: ours(reject_outliers=False)
    yield "vertex colours", lambda: (plain(site), 0)
    yield "vertex-colour textures", lambda: textured(site, source="vertex")
    for name in ("pymeshlab", "open3d"):
        yield name, lambda name=name: other(site, name, other_python)


def plain(site: Site) -> ColouredMesh:
    return ColouredMesh(site.mesh.vertices, site.mesh.faces, site.mesh.colours)


def textured(
    site: Site,
    *,
    source: str = "photos",
    gains: bool = True,
    switches: dict[str, Any] | None = None,
) -> tuple[ColouredMesh, int]:
    """Run the product's own stages on the whole mesh, as on a single tile."""
    mesh, views, photos = site.mesh, site.views, site.opened.photos
    choice = None
    if source == "photos":
        photo_gains = neutral_gains(len(views))
        if gains:
            base_rays = RayScene(site.base.vertices, site.base.faces, threads=THREADS)
            photo_gains = view_gains(site.base, views, photos, base_rays, threads=THREADS)
        rays = RayScene(mesh.vertices, mesh.faces, threads=THREADS)
        choice = choosing.choose_views(
            mesh.vertices, mesh.faces, mesh.normals, mesh.colours, views, photos, rays, photo_gains,
            choosing.Options(**(switches or {})), THREADS,
        )  # fmt: skip
        seams = {k: v for k, v in choice.facts.items() if "seam" in k or "outlier" in k}
        print(f"<!-- {seams} -->")
    textured_mesh = texture_mesh(
        mesh, site.segments, views, photos if choice is not None else None, choice,
        Options(source=source), max_side=2048, path=site.folder / "images", threads=THREADS,
        progress=NullProgress(), label="",
    )  # fmt: skip
    return from_textures(mesh, site.segments, textured_mesh.textures), int(
        np.prod(textured_mesh.textures.sides.astype(np.int64), axis=1).sum()
    )


def from_textures(mesh: Mesh, segments: np.ndarray, textures: TextureSet) -> ColouredMesh:
    """Give every corner its own vertex: what splitting at seams does, without the care."""
    count = len(mesh.faces)
    files = [textures.texture(piece).data for piece in range(len(textures.sides))]
    sizes = [(int(width), int(height)) for width, height in textures.sides]
    return ColouredMesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        mesh.colours[mesh.faces].reshape(-1, 3),
        Texturing(
            (textures.wedges / (2.0 * textures.sides[segments][:, None]))
            .astype(np.float32)
            .reshape(-1, 2),
            segments.astype(np.int32),
            ImageCache(files.__getitem__, dict(enumerate(sizes))),
        ),
    )


def other(site: Site, name: str, python: Path | None) -> tuple[ColouredMesh | None, Any]:
    """Run another library in its own Python; None and the reason where there is none."""
    # Whether it can run at all.
    if python is None:
        return None, "skipped: no --other-python given"
    if subprocess.run(
        [python, "-c", f"import {name}"], check=False, capture_output=True
    ).returncode:
        return None, f"skipped: {python} has no {name}"
    if name == "open3d" and len(site.mesh.faces) > MAX_OPEN3D_FACES:
        return None, f"skipped: more than {MAX_OPEN3D_FACES:,} faces take it many minutes"
    # Its own process reads the handed-over site and writes one image with wedge coordinates.
    folder = site.folder / "others"
    if not (folder / "views.npz").is_file():
        hand_over(site, folder)
    command = [
        str(python),
        str(Path(__file__).parent / "parts" / "texture_engines.py"),
        name,
        str(folder),
    ]
    environment = dict(os.environ)
    if name == "pymeshlab":
        if shutil.which("xvfb-run") is None:
            return None, "skipped: no xvfb-run"
        command = ["xvfb-run", "-a", *command]
        environment["QT_QPA_PLATFORM"] = "xcb"
        environment["QT_PLUGIN_PATH"] = "/usr/lib/x86_64-linux-gnu/qt5/plugins"
    done = subprocess.run(command, check=False, env=environment, capture_output=True, text=True)
    if done.returncode:
        return None, f"failed: {' '.join(done.stderr.split())[-200:]}"
    # Grey vertices: only the texture may score. Each face has corners of its own, as wedges need.
    with np.load(folder / f"result-{name}.npz") as result:
        vertices, faces, wedges = (result[key] for key in ("vertices", "faces", "wedges"))
    data = (folder / f"result-{name}.png").read_bytes()
    with Image.open(folder / f"result-{name}.png") as image:
        size = image.size
    grey = np.full((3 * len(faces), 3), 128, np.uint8)
    texturing = Texturing(
        np.ascontiguousarray(wedges.reshape(-1, 2), dtype=np.float32),
        np.zeros(len(faces), np.int32),
        ImageCache(lambda _: data, {0: size}, 1 << 30),
    )
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3), dtype=np.float32)
    whole = np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    return ColouredMesh(corners, whole, grey, texturing), size[0] * size[1]


def hand_over(site: Site, folder: Path) -> None:
    """Write the mesh, pinhole photos and cameras for the other libraries."""
    (folder / "photos").mkdir(parents=True, exist_ok=True)
    focal = float(round(site.views[0].lens.fx))
    for number, view in enumerate(site.views):
        photo = undistort(site.opened.photos.get(number), view, focal)
        Image.fromarray(photo).save(folder / "photos" / f"{number:04d}.png", compress_level=1)
    np.savez(folder / "mesh.npz", vertices=site.mesh.vertices, faces=site.mesh.faces)
    np.savez(
        folder / "views.npz",
        rotations=np.stack([view.rotation for view in site.views]),
        positions=np.stack([view.position for view in site.views]),
        focal=focal,
        width=site.views[0].lens.width,
        height=site.views[0].lens.height,
    )


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Wall and CPU time of this process and its children."""
    spent: dict[str, float] = {}

    def cpu() -> float:
        uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(use.ru_utime + use.ru_stime for use in uses)

    start, begun = time.perf_counter(), cpu()
    yield spent
    spent["wall"], spent["cpu"] = time.perf_counter() - start, cpu() - begun


def save_pictures(folder: Path, name: str, pictures: list[np.ndarray]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / f"{number}-{name.replace(' ', '-')}.png")


if __name__ == "__main__":
    sys.exit(main())
