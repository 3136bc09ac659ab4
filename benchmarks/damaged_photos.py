"""Builds from photo sets with something wrong: each ends in a scene, and says what is wrong.

From one right set of photos with COLMAP's cameras: half of the files missing; all turned by half,
or every second; over-exposed; photos of another place under these names, all or every second; all
cameras 2 m to the east, or each 2 m to a side of its own; files cut off or no pictures; photos of
other sizes. Each is built, and the scene compared with what the right set gives, where both have a
photo: the mean difference of the textures' levels at the same places.

    python benchmarks/damaged_photos.py SURVEY --photos FOLDER --cameras FOLDER --other FOLDER
    python benchmarks/damaged_photos.py --smoke

Prints Markdown. With ``--keep`` scenes and reports stay to be looked at.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np
from parts.damaged_sets import DAMAGES, write_set

from terraport_payload import SegmentMesh
from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.stages import texture
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import write_photos
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene, validate_scene

SMOKE: Final = ("none", "turned", "cut off")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("survey", type=Path, nargs="?")
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--cameras", type=Path)
    parser.add_argument("--other", type=Path, help="photos of another place")
    parser.add_argument("--max-points", type=int, default=300_000, help="thin the survey")
    parser.add_argument("--only", action="append", help="one damage; may come again")
    parser.add_argument("--keep", type=Path, help="folder for everything; taken up next time")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if not arguments.smoke and None in (arguments.survey, arguments.photos, arguments.cameras):
        parser.error("expected SURVEY, --photos and --cameras, or --smoke")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        survey, photos, cameras = arguments.survey, arguments.photos, arguments.cameras
        if arguments.smoke:
            survey, photos, cameras = _quarry(folder)
        damages = SMOKE if arguments.smoke else ("none", *(arguments.only or list(DAMAGES)[1:]))
        print("| set | photos | in no photo | difference | s | what it says |")
        print("|---|---|---|---|---|---|")
        failed = 0
        for damage in damages:
            write_set(damage, photos, cameras, folder / "set", arguments.other)
            failed += _line(damage, survey, folder, arguments.max_points)
    return min(failed, 1)


def _line(damage: str, survey: Path, folder: Path, max_points: int) -> int:
    scene = folder / damage.replace(" ", "-")
    start = time.perf_counter()
    try:
        built = build(
            BuildOptions(
                survey,
                scene,
                max_points=max_points,
                texture=Texturing(photos=folder / "set/images", cameras=folder / "set/colmap"),
                work=folder / "work",
                threads=2,
            )
        )
    except PhotoError as error:
        print(f"| {damage} | refused | | | {time.perf_counter() - start:.0f} | {error} |")
        return 0
    seconds = time.perf_counter() - start
    textured = next(stage for stage in built.stages if stage.name == texture.NAME)
    counts = textured.facts.counts
    difference = _difference(folder / "none", scene)
    wrong = validate_scene(scene)
    warnings = "; ".join(textured.facts.warnings).replace("|", "/").replace(f"{folder}/set/", "")
    print(
        f"| {damage} | {counts['photos']} of {counts['photos'] + counts['photos_left_out']} "
        f"| {counts['unseen_share']:.1%} | {difference:.1f} | {seconds:.0f} | {warnings or '-'} |",
        flush=True,
    )
    return len(wrong)


def _difference(right: Path, scene: Path) -> float:
    """Mean difference of both scenes' textures in the middle of their faces, levels."""
    with Scene.open(right) as reference, Scene.open(scene) as damaged:
        assert len(reference.index) == len(damaged.index)  # the same surface
        differences = []
        for number in range(0, len(reference.index), max(1, len(reference.index) // 40)):
            first, second = (_levels(which.mesh(number)) for which in (reference, damaged))
            differences.append(np.abs(first - second).mean(axis=1))
    return float(np.concatenate(differences).mean())


def _levels(mesh: SegmentMesh) -> np.ndarray:
    """Levels in the middle of every face, by the faces' places: seams number them differently."""
    assert mesh.texture is not None
    assert mesh.uvs is not None
    pixels = decode_image(mesh.texture.data).astype(float)
    size = np.array([mesh.texture.width, mesh.texture.height])
    at = (mesh.uvs[mesh.faces].mean(axis=1) * size).astype(int)
    levels: np.ndarray = pixels[at[:, 1], at[:, 0]]
    middle = mesh.positions[mesh.faces].sum(axis=1)
    return levels[np.lexsort(middle.T)]


def _quarry(folder: Path) -> tuple[Path, Path, Path]:
    flight = FlightOptions(count=8, width=320, height=240, truck=False)
    options = seen_by(flight, QuarryOptions(points=20_000, size_m=90.0, seed=3))
    quarry = write_quarry(options, folder / "quarry.laz", overwrite=True)
    shutil.rmtree(folder / "photos", ignore_errors=True)
    write_photos(options, flight, folder / "photos", survey="quarry.laz")
    return quarry.survey_path, folder / "photos/images", folder / "photos/colmap"


if __name__ == "__main__":
    sys.exit(main())
