"""Photos of a synthetic quarry on disk, with their cameras and what no camera knows.

::

    DIR/images/DJI_0001.JPG ..      JPEG, sRGB
    DIR/colmap/cameras.txt ..       COLMAP text: images.txt, points3D.txt, OFFSET.txt
    DIR/truth/photos.json           options, exposures, where the truck stood
    DIR/truth/masks/DJI_0001.png    255 the truck, 128 its shadow

The folder is made beside its name and renamed when whole: there is never a torso.
"""

from __future__ import annotations

import json
import secrets
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.engines.camera_files.write_colmap import write_colmap
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.synth._photo_kernels import develop_rows
from terraport_pipeline.synth.camera_eye import TRUCK, TRUCK_SHADOW, CameraEye, Seen
from terraport_pipeline.synth.colmap_text import offset_text, points_text
from terraport_pipeline.synth.flight import Flight, plan_flight
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.truck import Truck, parking_places, place_truck

__all__ = ["WrittenPhotos", "develop", "exposures", "photo_edge_m", "write_photos"]

_BYTES_PER_PIXEL: Final = 0.75
"""JPEG at quality 92 of this much grain (measured: 0.55 to 0.65), with a little room."""

_POINTS_PER_PHOTO: Final = 60
"""Of ``points3D.txt``: enough to check a camera's frame by."""

_STREAM: Final = 7


@dataclass(frozen=True, slots=True)
class WrittenPhotos:
    """Folder, counts and sizes of synthetic photos, and how they were flown."""

    directory: Path
    photos: int
    nadir: int
    megapixels: float
    bytes: int
    gsd_m: float
    """Ground sampling distance of the nadir photos on the plateau."""
    height_m: float
    truck_photos: int
    """Photos that show the truck."""
    exposure_ev: tuple[float, float]
    """Least and largest exposure offset, in stops."""


def photo_edge_m(flight: Flight, quarry: QuarryOptions) -> float:
    """Choose the truth mesh's longest edge: eight pixels, within 1.0 to 2.2 design metres."""
    return float(np.clip(8.0 * flight.gsd_m / quarry.scale, 1.0, 2.2)) * quarry.scale


def exposures(options: FlightOptions, seed: int) -> Float64:
    """Draw the exposure of every photo and channel, (count, 3) factors on light.

    The camera's automatic drifts from photo to photo; its white balance wanders by 2 %.
    """
    rng = np.random.default_rng([seed, _STREAM])
    ev = np.empty(options.count)
    now = 0.0
    for number, step in enumerate(rng.normal(0.0, 0.5, options.count)):
        now = float(np.clip(0.75 * now + step, -1.0, 1.0))
        ev[number] = now * options.exposure_drift_ev
    balance = np.ones((options.count, 3))
    if options.exposure_drift_ev > 0.0:
        balance[:, [0, 2]] += rng.normal(0.0, 0.02, (options.count, 2))
    result: Float64 = np.exp2(ev)[:, None] * balance
    return result


def develop(colours: Float32, gains: Float64, options: FlightOptions, seed: int) -> UInt8:
    """Turn what a camera sees into what it stores: exposure, vignetting, noise; (H, W, 3)."""
    result = np.empty(colours.shape, dtype=np.uint8)
    develop_rows(
        np.ascontiguousarray(colours, dtype=np.float32),
        0,
        np.ascontiguousarray(gains, dtype=np.float64),
        options.vignetting,
        options.sensor_noise,
        np.uint64(seed),
        result,
    )
    return result


def write_photos(
    quarry: QuarryOptions,
    options: FlightOptions,
    directory: Path,
    *,
    survey: str = "the survey",
    overwrite: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> WrittenPhotos:
    """Fly over a quarry and write its photos.

    Needs about 250 bytes for each face of the truth mesh (at most about 400 MB) and 60 for each
    pixel of one photo.

    Parameters
    ----------
    quarry : QuarryOptions
        What to fly over; ``detail`` should be 1. Equal options give equal bytes.
    options : FlightOptions
    directory : pathlib.Path
        Made; must not exist unless `overwrite`.
    survey : str
        File name of the cloud, for ``OFFSET.txt``.
    overwrite : bool
        Replace the folder.
    threads : int, optional
        Threads that draw; the bytes do not depend on it.
    progress : Progress, optional
        Told about photos.

    Raises
    ------
    OptionError
        When the parent folder is missing or the folder is there and `overwrite` is not set.
    ResourceError
        When the disk has too little room, before or while writing.
    """
    # (1) Refuse before anything is drawn.
    _validate_target(options, directory, overwrite=overwrite)
    watcher = progress or NullProgress()
    flight = plan_flight(options, quarry)
    # (2) Into a draft beside the folder, which takes its place in one step or is deleted.
    draft = directory.with_name(f".{directory.name}.{secrets.token_hex(4)}.part")
    try:
        for folder in ("images", "colmap", "truth/masks"):
            (draft / folder).mkdir(parents=True)
        watcher.start("synth: photos", options.count, "photos")
        rows = _write_images(quarry, options, flight, draft, survey, threads, watcher)
        size = sum(file.stat().st_size for file in (draft / "images").iterdir())
        watcher.done({"photos": options.count, "MB": round(size / 1e6, 1)})
        _put_in_place(draft, directory)
    except OSError as error:
        raise ResourceError(
            f"{directory}: cannot be written: {error}; nothing was left behind, check the disk "
            "and try again"
        ) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    # (3) What was written.
    ev = np.log2([row["gains"][1] for row in rows])
    return WrittenPhotos(
        directory,
        options.count,
        flight.nadir,
        options.count * options.width * options.height / 1e6,
        size,
        flight.gsd_m,
        flight.height_m,
        sum(row["truck"] is not None for row in rows),
        (float(ev.min()), float(ev.max())),
    )


def _validate_target(options: FlightOptions, directory: Path, *, overwrite: bool) -> None:
    parent = directory.absolute().parent
    if not parent.is_dir():
        raise OptionError(f"{parent}: no such folder; make it or choose another")
    if directory.exists() and not overwrite:
        raise OptionError(
            f"{directory}: exists already; choose another name or overwrite (--force)"
        )
    if directory.exists() and not (directory / "truth" / "photos.json").is_file():
        # --force must not delete a folder of somebody's own photos.
        raise OptionError(
            f"{directory}: is no folder of synthetic photos (it has no truth/photos.json), so it "
            "is not replaced; choose another name"
        )
    need = options.count * options.width * options.height * _BYTES_PER_PIXEL
    free = shutil.disk_usage(parent).free
    if free < need:
        raise ResourceError(
            f"{parent}: {free / 1e6:,.0f} MB free, about {need / 1e6:,.0f} MB needed for "
            f"{options.count} photos; free some room or take fewer or smaller photos"
        )


def _put_in_place(draft: Path, directory: Path) -> None:
    """Rename the draft; an old folder steps aside first and goes last."""
    old = draft.with_suffix(".old")
    if directory.exists():
        directory.replace(old)
    draft.replace(directory)
    shutil.rmtree(old, ignore_errors=True)


def _write_images(
    quarry: QuarryOptions,
    options: FlightOptions,
    flight: Flight,
    draft: Path,
    survey: str,
    threads: int | None,
    watcher: Progress,
) -> list[dict[str, Any]]:
    # (1) What all photos share: the surface, where trucks park, exposures, the frame.
    eye = CameraEye(quarry, photo_edge_m(flight, quarry), threads=threads)
    parking = parking_places(eye.surface, quarry.seed, quarry.scale)
    gains = exposures(options, quarry.seed)
    origin = np.array([quarry.easting_m, quarry.northing_m, quarry.elevation_m])
    offset = np.array([*np.round(origin[:2], -2), 0.0])
    rows: list[dict[str, Any]] = []
    points, colours = [], []
    # (2) Photo by photo. Every random number is drawn from seed and number of the photo, so the
    # bytes do not depend on the order.
    for number, view in enumerate(flight.views):
        truck = None
        if options.truck and number < options.count - flight.way:
            trucks = place_truck(view, number, parking, quarry.seed, quarry.scale)
            truck = _first_seen(eye, view.position, trucks)
        seen = eye.look(view, truck)
        photo = develop(seen.colours, gains[number], options, quarry.seed * 100_003 + number)
        Image.fromarray(photo).save(
            draft / "images" / view.name, "JPEG", quality=options.quality, subsampling=0
        )
        _write_mask(draft / "truth" / "masks" / f"{Path(view.name).stem}.png", seen.what)
        position, colour = _some_points(seen, view, quarry.seed, number)
        points.append(position)
        colours.append(colour)
        rows.append(
            {
                "name": view.name,
                "kind": "nadir" if number < flight.nadir else "oblique",
                "gains": [round(float(gain), 6) for gain in gains[number]],
                "truck": _truck_facts(truck, seen.what, origin),
            }
        )
        watcher.advance(1)
    # (3) The cameras, with some points of the surface, as COLMAP would write them.
    colmap = draft / "colmap"
    write_colmap(
        colmap,
        flight.views,
        origin=origin,
        offset=(float(offset[0]), float(offset[1]), float(offset[2])),
    )
    world = _to_world(np.concatenate(points)) + origin - offset
    text = points_text(world, np.concatenate(colours))
    (colmap / "points3D.txt").write_text(text, encoding="utf-8")
    text = offset_text(offset, quarry.epsg, survey)
    (colmap / "OFFSET.txt").write_text(text, encoding="utf-8")
    # (4) What no camera knows.
    truth = {
        "quarry": quarry.to_dict(),
        "flight": asdict(options),
        "origin": origin.tolist(),
        "offset": offset.tolist(),
        "epsg": quarry.epsg,
        "gsd_m": flight.gsd_m,
        "height_m": flight.height_m,
        "truth_edge_m": photo_edge_m(flight, quarry),
        "photos": rows,
    }
    (draft / "truth" / "photos.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return rows


def _first_seen(eye: CameraEye, position: Float64, trucks: list[Truck]) -> Truck | None:
    """Take the first truck whose top no wall hides."""
    for truck in trucks:
        top = truck.position + np.array([0.0, 3.0 * truck.scale, 0.0])
        t, _ = eye.rays.closest_hit(position[None], (top - position)[None])
        if t[0] > 1.0:
            return truck
    return None


def _write_mask(path: Path, what: UInt8) -> None:
    mask = np.zeros(what.shape, dtype=np.uint8)
    mask[what == TRUCK_SHADOW] = 128
    mask[what == TRUCK] = 255
    Image.fromarray(mask).save(path, "PNG", optimize=True)


def _some_points(seen: Seen, view: View, seed: int, number: int) -> tuple[Float64, UInt8]:
    """Take some places that a photo sees: scene metres and their colours."""
    rng = np.random.default_rng([seed, _STREAM, number])
    height, width = seen.what.shape
    row = rng.integers(0, height, _POINTS_PER_PHOTO)
    column = rng.integers(0, width, _POINTS_PER_PHOTO)
    good = np.isfinite(seen.distance_m[row, column]) & (seen.what[row, column] < TRUCK_SHADOW)
    row, column = row[good], column[good]
    rays = view.rays(np.stack([column + 0.5, row + 0.5], axis=1))
    points = view.position + rays * seen.distance_m[row, column][:, None]
    colours = np.clip(np.rint(seen.colours[row, column]), 0, 255).astype(np.uint8)
    return points, colours


def _to_world(points: Float64) -> Float64:
    x, y, z = points.T
    return np.stack([x, -z, y], axis=1)


def _truck_facts(truck: Truck | None, what: UInt8, origin: Float64) -> dict[str, Any] | None:
    rows, columns = np.nonzero(what == TRUCK)
    if truck is None or len(rows) == 0:
        return None
    return {
        "pixels": len(rows),
        "box_px": [
            int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1,
        ],
        "position": (_to_world(truck.position[None])[0] + origin).round(3).tolist(),
        "heading_deg": round(float(np.degrees(truck.heading_rad)), 2),
    }  # fmt: skip
