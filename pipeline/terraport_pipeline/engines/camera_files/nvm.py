"""VisualSFM's N-View Match, ``NVM_V3`` (also written by OpenSfM, OpenDroneMap and COLMAP).

Conventions (C. Wu, VisualSFM documentation, "Output format"; COLMAP ``ExportNVM``; MVE
``bundle_io.cc``): a camera is ``name focal qw qx qy qz x y z r 0``: the quaternion takes world to
camera, x right, y down, z forward; x y z is the camera's centre; the focal length is in pixels, the
principal point in the middle of the picture. r states the *measured* point's way to the ideal one,
``(1 + r m^2) m`` with m divided by the focal length: the other way round than Bundler's k1, and so
of the other sign. Blanks in names are written as quotes.

``NVM_V3 FixedK fx cx fy cy r`` states one lens for all cameras; writers give its cx and cy from the
corner or from the middle, which their size tells apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.camera_files.inverse_lens import invert_radial
from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize, PhotoSizes
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    MAX_CAMERAS,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    make_lens,
    quaternion_to_matrix,
)
from terraport_pipeline.engines.camera_files.stated_frames import stated_frames
from terraport_pipeline.engines.camera_files.text_files import parse_numbers, plain_name, text_lines
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["MAGIC", "read_nvm"]

MAGIC: Final = "NVM_V3"

_FROM_MIDDLE: Final = 0.25
"""Share of a side below which a stated principal point is meant from the middle of the picture."""

_ADVICE: Final = (
    "VisualSFM's own coordinates have no scale and no place: georeference it (SfM > More Functions "
    "> GCP-based Transform), then save the NVM again"
)


def read_nvm(path: Path, photo_size: PhotoSize) -> RawCameras:
    """Read the cameras of the first model.

    Parameters
    ----------
    path : Path
    photo_size : callable
        Asked for width and height of every photo. A camera whose photo is missing or damaged is
        left out, with a warning.

    Raises
    ------
    ReadError
        Damaged or cut off, or a lens that cannot be turned round.
    PhotoError
        No camera has a photo.
    """
    lines = ((number, text) for number, text in text_lines(path) if text)
    number, first = next(lines, (1, ""))
    fixed = _fixed_lens(path, number, first)
    # (1) The first model's cameras.
    count = _count(path, lines, "a count of cameras")
    if not 0 < count <= MAX_CAMERAS:
        check_count(path, count, "the first model")
    cameras: list[RawCamera] = []
    sizes = PhotoSizes(photo_size)
    for _ in range(count):
        number, text = next(lines, (0, ""))
        words = text.rsplit(maxsplit=10)
        if len(words) != 11:
            raise ReadError(
                path,
                f"{text[:80]!r} is no camera (name, focal length, quaternion, centre, radial, 0)",
                AGAIN,
                f"line {number:,}" if number else "the end",
            )
        values = parse_numbers(path, number, words[1:], 10, "focal length, pose and distortion")
        name = plain_name(words[0].replace('"', " "))
        camera = _camera(path, f"line {number:,}", name, values, fixed, sizes)
        if camera is not None:
            cameras.append(camera)
    sizes.check(len(cameras))
    check_count(path, len(cameras))
    # (2) What is left out: photos, and models that lie in frames of their own.
    warnings = sizes.warnings(count)
    others = _other_models(path, lines)
    if others:
        warnings.append(
            f"{path.name} holds {others + 1} models that were not joined; only the first is used."
        )
    return RawCameras("NVM", tuple(cameras), stated_frames(path), tuple(warnings), _ADVICE)


def _fixed_lens(path: Path, number: int, first: str) -> list[float] | None:
    words = first.split()
    if not words or words[0] != MAGIC:
        raise ReadError(path, f"{first[:80]!r} is no heading {MAGIC}", AGAIN, f"line {number:,}")
    if len(words) == 1:
        return None
    if words[1] != "FixedK" or len(words) not in (6, 7):
        raise ReadError(
            path,
            f"{first[:80]!r} is no heading {MAGIC} [FixedK fx cx fy cy [r]]",
            AGAIN,
            f"line {number:,}",
        )
    values = words[2:] if len(words) == 7 else [*words[2:], "0"]
    return parse_numbers(path, number, values, 5, "FixedK fx cx fy cy r")


def _count(path: Path, lines: Iterator[tuple[int, str]], what: str) -> int:
    number, text = next(lines, (0, ""))
    if not text.isdecimal():
        raise ReadError(
            path,
            f"{text[:80]!r} is not {what}",
            AGAIN,
            f"line {number:,}" if number else "the end",
        )
    return int(text)


def _camera(
    path: Path,
    location: str,
    name: str,
    values: list[float],
    fixed: list[float] | None,
    sizes: PhotoSizes,
) -> RawCamera | None:
    focal, quaternion, centre, radial = values[0], values[1:5], values[5:8], values[8]
    rotation = quaternion_to_matrix(quaternion)
    if rotation is None:
        raise ReadError(path, f"the quaternion of {name} is {quaternion}", AGAIN, location)
    check_position(path, location, centre)
    size = sizes.of(name)
    if size is None:
        return None
    lens = _lens(path, location, size, focal, radial, fixed)
    return RawCamera(name, lens, rotation, np.array(centre))


def _lens(
    path: Path,
    location: str,
    size: tuple[int, int],
    focal: float,
    radial: float,
    fixed: list[float] | None,
) -> Lens:
    width, height = size
    across = down = focal
    middle = (0.5 * width, 0.5 * height)
    if fixed is not None:
        across, cx, down, cy, fixed_radial = fixed
        radial = radial or fixed_radial
        from_middle = abs(cx) < _FROM_MIDDLE * width and abs(cy) < _FROM_MIDDLE * height
        middle = (middle[0] + cx, middle[1] + cy) if from_middle else (cx, cy)
    corner = np.hypot(max(middle[0], width - middle[0]), max(middle[1], height - middle[1]))
    try:
        terms = invert_radial(radial, across, float(corner)) if across > 0.0 else ()
    except ValueError as error:
        raise ReadError(
            path, str(error), "undistort the photos and export them with their cameras", location
        ) from error
    return make_lens(
        path,
        location,
        width=width,
        height=height,
        fx=across,
        fy=down,
        cx=middle[0],
        cy=middle[1],
        radial=terms,
    )


def _other_models(path: Path, lines: Iterator[tuple[int, str]]) -> int:
    """Count the further models that have points; a model without is VisualSFM's list of the rest.

    What follows the cameras is not needed, so an end in the midst of it is none of damage.
    """
    count = 0
    try:
        for _ in range(_count(path, lines, "a count of points")):
            next(lines, None)
        while cameras := _count(path, lines, "a count of cameras"):
            for _ in range(cameras):
                next(lines, None)
            points = _count(path, lines, "a count of points")
            count += points > 0
            for _ in range(points):
                next(lines, None)
    except ReadError:
        pass
    return count
