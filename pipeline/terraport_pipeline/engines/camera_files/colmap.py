"""COLMAP's sparse model: ``cameras`` and ``images``, as text or binary.

Conventions (colmap.github.io/format.html): the pose takes world to camera, x right, y down, z
forward; quaternions are w, x, y, z; the centre of the top left pixel is (0.5, 0.5). Parameters of
the camera models: COLMAP ``src/colmap/sensor/models.h``.

COLMAP's world is not the survey's: users subtract an offset before, or align after. A file
``OFFSET.txt`` beside the model or one folder above may say it, as three numbers E N H.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    MAX_CAMERAS,
    Frame,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    make_lens,
    quaternion_to_matrix,
)
from terraport_pipeline.engines.camera_files.text_files import (
    parse_numbers,
    read_small_text,
    text_lines,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["MODELS", "read_colmap", "stated_offset"]

MODELS: Final[dict[str, tuple[int, str]]] = {
    "SIMPLE_PINHOLE": (0, "f cx cy"),
    "PINHOLE": (1, "fx fy cx cy"),
    "SIMPLE_RADIAL": (2, "f cx cy k1"),
    "RADIAL": (3, "f cx cy k1 k2"),
    "OPENCV": (4, "fx fy cx cy k1 k2 p1 p2"),
    "OPENCV_FISHEYE": (5, "fx fy cx cy k1 k2 k3 k4"),
    "FULL_OPENCV": (6, "fx fy cx cy k1 k2 p1 p2 k3 d1 d2 d3"),
    "SIMPLE_RADIAL_FISHEYE": (8, "f cx cy k1"),
    "RADIAL_FISHEYE": (9, "f cx cy k1 k2"),
    "SIMPLE_FISHEYE": (14, "f cx cy"),
    "FISHEYE": (15, "fx fy cx cy"),
}
"""Number and parameters of every model that is understood."""

_FOREIGN: Final = {
    7: "FOV", 10: "THIN_PRISM_FISHEYE", 11: "RAD_TAN_THIN_PRISM_FISHEYE", 12: "SIMPLE_DIVISION",
    13: "DIVISION", 16: "EUCM", 17: "EQUIRECTANGULAR",
}  # fmt: skip

_NAMES: Final = {number: name for name, (number, _) in MODELS.items()} | _FOREIGN

_MAX_NAME_BYTES: Final = 4096
_MAX_POINTS: Final = 50_000_000
"""Tie points of one photo."""

_OFFSET_NAMES: Final = ("OFFSET.txt", "offset.txt", "offset.xyz")

_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def read_colmap(folder: Path, *, binary: bool) -> RawCameras:
    """Read the cameras of a sparse model.

    Parameters
    ----------
    folder : Path
        Holds ``cameras.txt`` and ``images.txt``, or the same with ``.bin``.
    binary : bool
        Which of both.

    Raises
    ------
    ReadError
        Damaged, cut off, or a lens that is not understood; names file and line or byte.
    """
    read_lenses, read_images = (
        (_lenses_binary, _images_binary) if binary else (_lenses_text, _images_text)
    )
    ending = "bin" if binary else "txt"
    lenses = read_lenses(folder / f"cameras.{ending}")
    images = folder / f"images.{ending}"
    cameras = read_images(images, lenses)
    check_count(images, len(cameras))
    own = Frame("offset", "no offset")
    stated = stated_offset(folder)
    frames = (own,) if stated is None else (stated, own)
    return RawCameras(f"COLMAP ({'binary' if binary else 'text'})", cameras, frames)


def stated_offset(folder: Path) -> Frame | None:
    """Look for a file that says which offset the world frame lacks.

    Parameters
    ----------
    folder : Path
        Looked into, and then its parent.

    Returns
    -------
    Frame or None
        The first three numbers of the first line that has three; None where there is no file.

    Raises
    ------
    ReadError
        The file has no line with three numbers.
    """
    for directory in (folder, folder.parent):
        for name in _OFFSET_NAMES:
            path = directory / name
            if not path.is_file():
                continue
            for line in read_small_text(path).splitlines():
                # "EPSG:32615" is no number of an offset: only what follows a blank or bracket is
                numbers = [m.group() for m in _NUMBER.finditer(line) if _stands_alone(line, m)]
                if len(numbers) >= 3:
                    east, north, up = (float(word) for word in numbers[:3])
                    return Frame("offset", name, offset=(east, north, up))
            raise ReadError(
                path, "no line has three numbers", "write the offset as one line: E N H, metres"
            )
    return None


def _stands_alone(line: str, match: re.Match[str]) -> bool:
    before = line[match.start() - 1 : match.start()]
    after = line[match.end() : match.end() + 1]
    return (not before or before in " \t,;([{=+") and (not after or after in " \t,;)]}")


def _make_lens(path: Path, location: str, model: str, size: Sequence[int], values: Any) -> Lens:
    parameters = dict(zip(MODELS[model][1].split(), (float(v) for v in values), strict=True))
    return make_lens(
        path,
        location,
        width=size[0],
        height=size[1],
        fx=parameters.get("fx", parameters.get("f")),
        fy=parameters.get("fy", parameters.get("f")),
        cx=parameters["cx"],
        cy=parameters["cy"],
        model="fisheye" if "FISHEYE" in model else "radial",
        radial=tuple(parameters[k] for k in ("k1", "k2", "k3", "k4") if k in parameters),
        tangential=(parameters.get("p1", 0.0), parameters.get("p2", 0.0)),
        denominator=tuple(parameters[k] for k in ("d1", "d2", "d3") if k in parameters),
    )


def _unknown_model(path: Path, name: str, location: str) -> ReadError:
    return ReadError(
        path,
        f"the camera model is {name}, expected one of {', '.join(MODELS)}",
        "run COLMAP with the model OPENCV or OPENCV_FISHEYE, or undistort the photos first "
        "(colmap image_undistorter)",
        location,
    )


def _lenses_text(path: Path) -> dict[int, Lens]:
    lenses: dict[int, Lens] = {}
    for number, line in text_lines(path):
        if not line or line.startswith("#"):
            continue
        location = f"line {number:,}"
        words = line.split()
        if len(words) < 4 or not all(words[i].isdecimal() for i in (0, 2, 3)):
            raise ReadError(
                path,
                f"{line[:80]!r} is no CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS",
                AGAIN,
                location,
            )
        if words[1] not in MODELS:
            raise _unknown_model(path, words[1], location)
        expected = len(MODELS[words[1]][1].split())
        values = parse_numbers(path, number, words[4:], expected, f"the lens of {words[1]}")
        size = _picture_size(path, int(words[2]), int(words[3]), location)
        lenses[int(words[0])] = _make_lens(path, location, words[1], size, values)
        check_count(path, len(lenses), location)
    return lenses


def _picture_size(path: Path, width: int, height: int, location: str) -> tuple[int, int]:
    if not (0 < width < 1 << 20 and 0 < height < 1 << 20):
        raise ReadError(path, f"a picture of {width} x {height} pixels", AGAIN, location)
    return width, height


def _images_text(path: Path, lenses: dict[int, Lens]) -> tuple[RawCamera, ...]:
    cameras: list[RawCamera] = []
    points_next = False
    for number, line in text_lines(path):
        if points_next:  # every second line holds tie points, and may be empty
            points_next = False
            continue
        if not line or line.startswith("#"):
            continue
        words = line.split(maxsplit=9)
        if len(words) < 10 or not words[8].isdecimal():
            raise ReadError(
                path,
                f"{line[:80]!r} is no IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
                AGAIN,
                f"line {number:,}",
            )
        pose = parse_numbers(path, number, words[1:8], 7, "a quaternion and a translation")
        cameras.append(
            _camera(path, f"line {number:,}", pose, int(words[8]), words[9].strip(), lenses)
        )
        check_count(path, len(cameras), f"line {number:,}")
        points_next = True
    return tuple(cameras)


def _camera(
    path: Path,
    location: str,
    pose: Sequence[float],
    camera: int,
    name: str,
    lenses: dict[int, Lens],
) -> RawCamera:
    if camera not in lenses:
        raise ReadError(
            path,
            f"{name} has camera {camera}, which {path.with_stem('cameras').name} does not have",
            "give the files of one and the same model",
            location,
        )
    rotation = quaternion_to_matrix(pose[:4])
    if rotation is None or not np.isfinite(pose).all():
        raise ReadError(path, f"the pose of {name} is {list(pose)}", AGAIN, location)
    check_position(path, location, pose[4:])
    centre = -rotation.T @ np.asarray(pose[4:])
    return RawCamera(name, lenses[camera], rotation, centre)


def _take(file: BinaryIO, path: Path, layout: str) -> tuple[Any, ...]:
    """Read little endian values, or say at which byte the file ends."""
    size = struct.calcsize("<" + layout)
    offset = file.tell()
    data = file.read(size)
    if len(data) < size:
        raise ReadError(path, "the file ends", "copy or export it again", f"byte {offset:,}")
    return struct.unpack("<" + layout, data)


def _lenses_binary(path: Path) -> dict[int, Lens]:
    lenses: dict[int, Lens] = {}
    with path.open("rb") as file:
        (count,) = _take(file, path, "Q")
        check_count(path, count)
        for _ in range(count):
            location = f"byte {file.tell():,}"
            camera, model, width, height = _take(file, path, "IiQQ")
            if _NAMES.get(model) not in MODELS:
                raise _unknown_model(path, _NAMES.get(model, f"number {model}"), location)
            name = _NAMES[model]
            values = _take(file, path, f"{len(MODELS[name][1].split())}d")
            size = _picture_size(path, width, height, location)
            lenses[camera] = _make_lens(path, location, name, size, values)
    return lenses


def _images_binary(path: Path, lenses: dict[int, Lens]) -> tuple[RawCamera, ...]:
    cameras: list[RawCamera] = []
    size = path.stat().st_size
    with path.open("rb") as file:
        (count,) = _take(file, path, "Q")
        if count > MAX_CAMERAS:
            check_count(path, count)
        for _ in range(count):
            location = f"byte {file.tell():,}"
            _, *pose, camera = _take(file, path, "I7dI")
            name = _take_name(file, path)
            (points,) = _take(file, path, "Q")
            after = file.tell() + 24 * points
            if points > _MAX_POINTS or after > size:
                raise ReadError(
                    path,
                    f"{name} should have {points:,} tie points, but the file ends after "
                    f"{size:,} bytes",
                    "it is cut off: copy or export it again",
                    location,
                )
            file.seek(after)
            cameras.append(_camera(path, location, pose, camera, name, lenses))
    return tuple(cameras)


def _take_name(file: BinaryIO, path: Path) -> str:
    start = file.tell()
    data = file.read(_MAX_NAME_BYTES)
    end = data.find(b"\0")
    if end < 1:
        raise ReadError(path, "no file name where one should be", AGAIN, f"byte {start:,}")
    file.seek(start + end + 1)
    return data[:end].decode("utf-8", errors="surrogateescape")
