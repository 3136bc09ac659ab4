"""Textures against photos that they were not made of: for real surveys, whose truth nobody knows.

Some photos of a survey are left out, the scene is built from the rest, and drawn by the cameras of
those left out, with its textures and with its vertex colours. Each picture is compared with the
photo itself, where the mesh is hit, after one factor per channel: exposure is a photo's own.

* *matched*, *median*: as in textures.py. Crowns and cars that the mesh lacks stand in the photo and
  count against both; the median leaves them out.
* *else*: share of the pixels where the photo shows something else than the cloud has there, judged
  as the choice of photos judges it: means over some cells differ from the vertex colours by more
  than 30 levels, or by more than 12 next to such a place. *there*: matched, without those pixels.
* *detail*: how much neighbouring pixels differ, as a share of what they do in the photo. One is as
  sharp as the photo; above, there is more noise than in it.
* *alone*: share of the pixels where no other photo that sees the place shows anything like it
  (means differ by more than 20 levels): what stands in front, and moves as the camera does.
* *developed*: matched, after five numbers a channel instead of one factor: exposure's gain and
  offset, vignetting, light from one side to the other. *shared*: that, without *alone*; *both*:
  without *else*, too.

    python benchmarks/held_out_photos.py SURVEY --photos FOLDER --cameras FOLDER
    python benchmarks/held_out_photos.py SURVEY --photos FOLDER --cameras FOLDER --keep FOLDER
    python benchmarks/held_out_photos.py --smoke

Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from parts.left_out_causes import developed, no_other_has, small_means
from PIL import Image
from scipy.ndimage import maximum_filter, uniform_filter

from terraport_payload.types import Bool, Float64, UInt8
from terraport_pipeline.engines.cameras import PhotoCamera
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.texturing import Texturing as Drawn
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.report.textures import find_vertex_colours, open_scene_photos
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import write_photos
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene

THREADS: Final = max(1, min(os.cpu_count() or 1, 2))

WINDOW: Final = 16
"""Pixels along which means are taken: four edges of the sets measured so far."""

FAR: Final = 30.0
"""Levels beyond which a photo shows something else, and the part that counts next to it."""
NEXT_TO_FAR: Final = 0.4

MIN_SEEN: Final = 0.05
"""A photo that the mesh fills less of says nothing."""


@dataclass(frozen=True, slots=True)
class Score:
    """How near a picture comes to a photo."""

    matched_db: float
    median_db: float
    detail: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("survey", type=Path, nargs="?")
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--cameras", type=Path)
    parser.add_argument("--leave-out", type=int, default=4, help="photos, evenly by name")
    parser.add_argument("--max-points", type=int, help="thin the survey")
    parser.add_argument("--keep", type=Path, help="folder for everything; taken up next time")
    parser.add_argument("--pictures", type=Path, help="folder for photo and pictures")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if not arguments.smoke and None in (arguments.survey, arguments.photos, arguments.cameras):
        parser.error("expected SURVEY, --photos and --cameras, or --smoke")
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-held-out-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        if arguments.smoke:
            synthesise(folder, arguments)
        run(folder, arguments)
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


def synthesise(folder: Path, arguments: argparse.Namespace) -> None:
    """Make a small survey with photos."""
    flight = FlightOptions(count=8, width=320, height=240)
    quarry = seen_by(flight, QuarryOptions(points=20_000, seed=7, size_m=90.0))
    write_photos(quarry, flight, folder / "flight", overwrite=True, threads=THREADS)
    arguments.survey = folder / "quarry.laz"
    write_quarry(quarry, arguments.survey, overwrite=True)
    arguments.photos, arguments.cameras = folder / "flight/images", folder / "flight/colmap"
    arguments.leave_out = 2


def run(folder: Path, arguments: argparse.Namespace) -> None:
    # Build without the photos that are left out.
    left_out = leave_out(arguments.photos, folder / "photos", arguments.leave_out)
    before = cpu_seconds()
    build(
        BuildOptions(
            arguments.survey,
            folder / "scene",
            work=folder / "work",
            threads=THREADS,
            max_points=arguments.max_points,
            texture=Texturing(photos=folder / "photos", cameras=arguments.cameras),
        ),
        NullProgress(),
    )
    spent = cpu_seconds() - before
    # The same detail twice: with the scene's textures, and with the colours of its vertices.
    with Scene.open(folder / "scene") as scene:
        model = load_scene_model(scene)
        plain = find_vertex_colours(scene, folder / "work")
    assert plain is not None
    assert model.textures is not None
    opened = open_scene_photos(model, arguments.photos, arguments.cameras)
    detail = model.detail
    coloured = Mesh(plain.vertices, plain.faces, detail.normals[:0], plain.colours, {})
    meshes = {"textures": (detail, model.textures.detail), "vertex colours": (coloured, None)}
    rays = {name: RayScene(mesh.vertices, mesh.faces) for name, (mesh, _) in meshes.items()}
    print(
        f"{len(detail.faces):,} faces, {len(opened.views) - len(left_out)} photos, "
        f"{len(left_out)} left out; the build took {spent:.0f} CPU s\n"
    )
    columns = "matched dB | median dB | detail"
    print(
        f"| photo | hit | textures: {columns} | vertex colours: {columns} | else | there dB "
        "| alone | developed dB | shared dB | both dB |"
    )
    print("|---|" + "---:|" * 13)
    # Draw what each left-out photo saw; one that sees too little of the mesh says nothing.
    total: dict[str, list[Float64]] = {name: [] for name in meshes}
    there: list[Float64] = []
    causes: dict[str, list[Float64]] = {"developed": [], "shared": [], "both": []}
    means = {number: small_means(opened.photos.get(number)) for number in range(len(opened.views))}
    kept = [number for number, view in enumerate(opened.views) if view.name not in left_out]
    for number, view in enumerate(opened.views):
        if view.name not in left_out:
            continue
        photo = opened.photos.get(number)
        cells, pictures, hits, seen = [], [photo], [], 0.0
        for name, (mesh, drawn) in meshes.items():
            picture, hit = draw(mesh, drawn, view, rays[name])
            seen = float(hit.mean())
            if seen < MIN_SEEN:
                break
            score, errors = compare(picture, photo, hit)
            total[name].append(errors)
            pictures.append(picture)
            hits.append(hit)
            cells.append(f"{score.matched_db:.2f} | {score.median_db:.2f} | {score.detail:.0%}")
        if not cells:
            print(f"| {view.name} | {seen:.0%} |" + " |" * 12)
            continue
        # Payloads hold corners on a grid: at a rim one mesh may be hit where the other is not.
        other = shows_something_else(pictures[-1], photo, hits[-1])[hits[0]]
        there.append(total["textures"][-1][~other])
        cells.append(f"{other.mean():.0%} | {mean_db(there[-1]):.2f}")
        hit = hits[0]
        alone = no_other_has(number, opened.views, means, kept, rays["textures"], hit)[hit]
        errors = developed(pictures[1], photo, hit) - photo[hit]
        parts = {"developed": errors, "shared": errors[~alone], "both": errors[~alone & ~other]}
        for name, part in parts.items():
            causes[name].append(part)
        cells.append(f"{alone.mean():.0%}")
        cells += [f"{mean_db(part):.2f}" for part in parts.values()]
        print(f"| {view.name} | {seen:.0%} | {' | '.join(cells)} |", flush=True)
        if arguments.pictures is not None:
            save(arguments.pictures, Path(view.name).stem, pictures)
    cells = []
    # Over the pixels of all photos, not the mean of their means.
    for errors_of in total.values():
        errors = np.concatenate(errors_of)
        cells.append(f"**{mean_db(errors):.2f}** | **{median_db(errors):.2f}** | ")
    rest = np.concatenate(there)
    every = sum(len(errors) for errors in total["textures"])
    cells.append(f"{1 - len(rest) / every:.0%} | **{mean_db(rest):.2f}**")
    shared = sum(len(errors) for errors in causes["shared"])
    cells.append(f"{1 - shared / every:.0%}")
    cells += [f"**{mean_db(np.concatenate(parts)):.2f}**" for parts in causes.values()]
    print(f"| all | | {' | '.join(cells)} |")


def leave_out(photos: Path, folder: Path, count: int) -> set[str]:
    """Link all photos but `count` into a folder; returns the names of those."""
    paths = sorted(path for path in photos.iterdir() if path.is_file())
    places = (np.arange(count) + 0.5) / count * len(paths)
    chosen = {paths[int(index)].name for index in places}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for path in paths:
        if path.name not in chosen:
            (folder / path.name).symlink_to(path.absolute())
    return chosen


def draw(mesh: Mesh, texturing: Drawn | None, view: View, rays: RayScene) -> tuple[UInt8, Bool]:
    """Draw a mesh as a camera sees it; also where it is hit."""
    camera, size = PhotoCamera(view), (view.lens.width, view.lens.height)
    picture = render_mesh(
        mesh.vertices, mesh.faces, camera, size,
        colours=mesh.colours, texturing=texturing, relief=0.0, shadows=False, supersample=1,
        scene=rays,
    )  # fmt: skip
    origins, headings = camera.rays(*size)
    return picture, (rays.closest_hit(origins, headings)[1] >= 0).reshape(size[1], size[0])


def compare(picture: UInt8, photo: UInt8, hit: Bool) -> tuple[Score, Float64]:
    """Compare where the mesh is hit; also the errors, (N, 3) levels."""
    factor = exposure(picture, photo, hit)
    errors = picture[hit] * factor - photo[hit]
    both = hit[:, 1:] & hit[:, :-1]
    steps = [
        np.abs(np.diff(image.astype(np.float64), axis=1)).mean(axis=2)[both].mean()
        for image in (picture * factor, photo)
    ]
    detail = float(steps[0] / max(steps[1], 1e-9))
    return Score(mean_db(errors), median_db(errors), detail), errors


def exposure(picture: UInt8, photo: UInt8, hit: Bool) -> Float64:
    """Factor per channel that brings a picture to a photo, (3,)."""
    rendered, true = picture[hit].astype(np.float64), photo[hit].astype(np.float64)
    factor: Float64 = (rendered * true).sum(axis=0) / np.maximum((rendered**2).sum(axis=0), 1e-9)
    return factor


def shows_something_else(plain: UInt8, photo: UInt8, hit: Bool) -> Bool:
    """Say where a photo shows what the vertex colours do not have: crowns, cars; (H, W)."""

    def means(image: Float64) -> Float64:
        filled = np.where(hit[:, :, None], image, 0.0)
        mean: Float64 = uniform_filter(filled, (WINDOW, WINDOW, 1)) / share[:, :, None]
        return mean

    share = np.maximum(uniform_filter(hit.astype(np.float64), WINDOW), 1e-6)
    difference = means(plain * exposure(plain, photo, hit)) - means(photo.astype(np.float64))
    far = np.sqrt(np.square(difference).mean(axis=2)) / FAR
    certain = (far > 1.0) & hit
    beside: Bool = maximum_filter(certain, 2 * WINDOW + 1) & (far > NEXT_TO_FAR)
    return (certain | beside) & hit


def mean_db(errors: Float64) -> float:
    return float(10 * np.log10(255.0**2 / max(float(np.mean(np.square(errors))), 1e-9)))


def median_db(errors: Float64) -> float:
    middle = float(np.median(np.abs(errors).mean(axis=1)))
    return float(20 * np.log10(255.0 / max(middle, 1e-9)))


def cpu_seconds() -> float:
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


def save(folder: Path, name: str, pictures: Sequence[UInt8]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for kind, picture in zip(("photo", "textures", "vertex"), pictures, strict=True):
        Image.fromarray(picture).save(folder / f"{name}-{kind}.png")


if __name__ == "__main__":
    sys.exit(main())
