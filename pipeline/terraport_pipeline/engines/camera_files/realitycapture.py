"""RealityCapture's and RealityScan's cameras: a table, or an XMP file beside each photo.

Conventions (Epic Games, "RealityCapture XMP camera math"; the export templates that RealityScan
2 ships; nerfstudio ``realitycapture_utils.py``, Camorph ``RealityCapture.py``):

- An XMP's ``Rotation`` takes world to camera row by row, x right, y down, z forward; ``Position``
  is the camera's centre.
- The table states heading, pitch and roll in degrees. At 0, 0, 0 the camera looks straight down
  and the picture's top is north; heading turns it clockwise seen from above, pitch lifts the view
  (90 looks at the horizon), roll tips it about the picture's vertical: the camera's axes (x right,
  y up, z backward) lie in the world as ``Rz(-heading) Rx(pitch) Ry(roll)``.
- The focal length is that of a 36 mm film on the photo's longer side, the principal point is from
  the picture's middle in units of that side.
- Brown's distortion in that order: k1 k2 k3 k4 t1 t2, with t1 and t2 the other way round than
  OpenCV's p1 and p2 (the templates' OpenCV table writes ``k1,k2,t2,t1``).

Neither says how large the photos are: they are asked. The table does not say the model of the
distortion either. A *Division* lens has one coefficient, a Brown one three or more, so a k1 alone
is refused.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.colmap import stated_offset
from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize, PhotoSizes
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    FLIP,
    Frame,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    make_lens,
    nearest_rotation,
)
from terraport_pipeline.engines.camera_files.text_files import parse_numbers, text_lines
from terraport_pipeline.engines.camera_files.xml_files import parse_xml, xml_numbers
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["XMP_MAGIC", "is_camera_table", "read_camera_table", "read_sidecars"]

XMP_MAGIC: Final = b"www.capturingreality.com/ns/xcr"
"""Name space of RealityCapture's fields; other programs' XMP files have none of them."""

_FILM_MM: Final = 36.0
"""Longer side of the film that focal lengths are stated for."""

_BROWN: Final = ("perspective", "brown3", "brown4", "brown3t2", "brown4t2")
"""Models of an XMP that are understood; ``division`` and ``rational..`` only without distortion."""

_ALIASES: Final = {
    "yaw": "heading", "z": "alt", "f_35mm": "f", "px_norm": "px", "py_norm": "py",
}  # fmt: skip
"""Names of columns in newer versions."""

_NEEDED: Final = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
_LENS: Final = ("px", "py", "k1", "k2", "k3", "k4", "t1", "t2")

_BROWN_ADVICE: Final = (
    "set Alignment > Settings > Advanced > Distortion model to Brown3 or Brown4 with tangential2, "
    "align again, and export; or export undistorted photos with their cameras"
)

_TABLE_ADVICE: Final = (
    "export with the coordinate system 'Project output', and that in the survey's CRS (Workflow > "
    "Settings > Coordinate systems)"
)

_XMP_ADVICE: Final = (
    "an XMP may hold local coordinates of the project; export Internal/External camera parameters "
    "(Alignment > Export > Registration) in the survey's CRS instead, or state the offset"
)


def is_camera_table(head: bytes) -> bool:
    """Tell RealityCapture's table of cameras by its heading.

    Parameters
    ----------
    head : bytes
        The file's beginning.
    """
    lines = [line.strip() for line in head.decode("utf-8", errors="replace").splitlines()[:3]]
    return any(set(_NEEDED) <= set(_columns(line)) for line in lines)


def read_camera_table(path: Path, photo_size: PhotoSize) -> RawCameras:
    """Read *Internal/External camera parameters* (CSV).

    Parameters
    ----------
    path : Path
    photo_size : callable
        Asked for width and height of every photo. A camera whose photo is missing or damaged is
        left out, with a warning.

    Raises
    ------
    ReadError
        Damaged or cut off, or a distortion that may be another model's.
    PhotoError
        No camera has a photo.
    """
    columns: list[str] = []
    cameras: list[RawCamera] = []
    sizes = PhotoSizes(photo_size)
    for number, text in text_lines(path):
        if not text or (not columns and set(_NEEDED) - set(_columns(text))):
            continue
        if not columns:
            columns = _columns(text)
            continue
        location = f"line {number:,}"
        try:
            words = next(csv.reader([text]))
        except csv.Error as error:
            raise ReadError(path, f"no row of a table ({error})", AGAIN, location) from error
        if len(words) != len(columns):
            raise ReadError(
                path,
                f"{len(words)} values for {len(columns)} columns: {text[:80]!r}",
                AGAIN,
                location,
            )
        row = dict(zip(columns, (word.strip() for word in words), strict=True))
        names = [*_NEEDED[1:], *(name for name in _LENS if name in row)]
        numbers = parse_numbers(path, number, [row[name] for name in names], len(names), "a camera")
        values = dict(zip(names, numbers, strict=True))
        if values.get("k1") and not any(values.get(name) for name in _LENS[3:]):
            raise ReadError(path, "k1 alone: a lens of the Division model", _BROWN_ADVICE, location)
        centre = np.array([values["x"], values["y"], values["alt"]])
        check_position(path, location, centre)
        size = sizes.of(row["name"])
        if size is None:
            continue
        lens = _lens(path, location, size, values)
        rotation = _rotation(values["heading"], values["pitch"], values["roll"])
        cameras.append(RawCamera(row["name"].replace("\\", "/"), lens, rotation, centre))
        check_count(path, len(cameras), location)
    sizes.check(len(cameras))
    check_count(path, len(cameras))
    return RawCameras(
        "RealityCapture CSV",
        tuple(cameras),
        _frames(path.parent, np.stack([camera.centre for camera in cameras])),
        tuple(sizes.warnings(len(cameras) + sizes.left_out)),
        _TABLE_ADVICE,
    )


def read_sidecars(paths: Sequence[Path], folder: Path, photo_size: PhotoSize) -> RawCameras:
    """Read the XMP files beside photos.

    Parameters
    ----------
    paths : sequence of Path
        One for each photo, of the photo's name.
    folder : Path
        The photos' common folder.
    photo_size : callable
        As for :func:`read_camera_table`.

    Raises
    ------
    ReadError
        Damaged, or a lens that is not understood.
    PhotoError
        No camera has a photo.
    """
    cameras: list[RawCamera] = []
    sizes = PhotoSizes(photo_size)
    unaligned = 0
    for path in paths:
        fields = _xcr_fields(parse_xml(path, "give RealityCapture's XMP files"))
        if "Rotation" not in fields or "Position" not in fields:
            unaligned += bool(fields)
            continue
        name = path.relative_to(folder).with_suffix("").as_posix()
        rotation = xml_numbers(path, fields["Rotation"], 9, "Rotation").reshape(3, 3)
        centre = xml_numbers(path, fields["Position"], 3, "Position")
        check_position(path, "Position", centre)
        size = sizes.of(name)
        if size is None:
            continue
        lens = _lens(path, "the lens", size, _xmp_lens(path, fields))
        cameras.append(RawCamera(name, lens, nearest_rotation(path, "Rotation", rotation), centre))
        check_count(path, len(cameras))
    sizes.check(len(cameras))
    check_count(folder, len(cameras))
    warnings = sizes.warnings(len(cameras) + sizes.left_out)
    if unaligned:
        warnings.append(f"{unaligned:,} XMP files hold no pose; their photos are left out.")
    return RawCameras(
        "RealityCapture XMP",
        tuple(cameras),
        _frames(folder, np.stack([camera.centre for camera in cameras])),
        tuple(warnings),
        _XMP_ADVICE,
    )


def _columns(heading: str) -> list[str]:
    names = [word.strip().lower() for word in heading.lstrip("\ufeff# ").split(",")]
    return [_ALIASES.get(name, name) for name in names]


def _rotation(heading_deg: float, pitch_deg: float, roll_deg: float) -> Float64:
    """Turn world to camera (x right, y down, z forward).

    Examples
    --------
    Straight down, north up: the picture's right is east, its down south.

    >>> (_rotation(0.0, 0.0, 0.0).round(9) + 0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]

    At the horizon, to the east.

    >>> (_rotation(90.0, 90.0, 0.0).round(9) + 0.0).tolist()[2]
    [1.0, 0.0, 0.0]
    """
    (ch, cp, cr), (sh, sp, sr) = (
        f(np.radians([heading_deg, pitch_deg, roll_deg])) for f in (np.cos, np.sin)
    )
    turn = np.array([[ch, sh, 0.0], [-sh, ch, 0.0], [0.0, 0.0, 1.0]])
    lift = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    tip = np.array([[cr, 0.0, sr], [0.0, 1.0, 0.0], [-sr, 0.0, cr]])
    to_camera: Float64 = FLIP @ (turn @ lift @ tip).T
    return to_camera


def _lens(path: Path, location: str, size: tuple[int, int], values: Mapping[str, float]) -> Lens:
    width, height = size
    side = max(width, height)
    focal = values["f"] / _FILM_MM * side
    return make_lens(
        path,
        location,
        width=width,
        height=height,
        fx=focal,
        fy=focal * values.get("aspect", 1.0),
        cx=0.5 * width + values.get("px", 0.0) * side,
        cy=0.5 * height + values.get("py", 0.0) * side,
        radial=tuple(values.get(f"k{i}", 0.0) for i in range(1, 5)),
        tangential=(values.get("t2", 0.0), values.get("t1", 0.0)),
    )


def _xcr_fields(root: ET.Element) -> dict[str, str]:
    """Gather RealityCapture's fields, which may be attributes or elements."""
    fields: dict[str, str] = {}
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.startswith("xcr:"):
                fields[name.removeprefix("xcr:")] = value
        if element.tag.startswith("xcr:") and element.text:
            fields[element.tag.removeprefix("xcr:")] = element.text
    return fields


def _xmp_lens(path: Path, fields: Mapping[str, str]) -> dict[str, float]:
    model = fields.get("DistortionModel", "perspective")
    terms = xml_numbers(
        path, fields.get("DistortionCoeficients", "0 0 0 0 0 0"), 6, "DistortionCoeficients"
    )
    if model not in _BROWN and terms.any():
        raise ReadError(
            path, f"a lens of the model {model!r}, expected Brown's", _BROWN_ADVICE, "the lens"
        )
    values = dict(zip(_LENS[2:], terms.tolist(), strict=True))
    for name, field, default in (
        ("f", "FocalLength35mm", None),
        ("px", "PrincipalPointU", "0"),
        ("py", "PrincipalPointV", "0"),
        ("aspect", "AspectRatio", "1"),
        ("skew", "Skew", "0"),
    ):
        values[name] = float(xml_numbers(path, fields.get(field, default), 1, field)[0])
    if values["skew"]:
        raise ReadError(path, f"a lens with a skew of {values['skew']:g}", _BROWN_ADVICE, "Skew")
    return values


def _frames(folder: Path, centres: Float64) -> tuple[Frame, ...]:
    """List what the coordinates may be: project output, degrees, or metres from Earth's centre."""
    stated = stated_offset(folder)
    frames = [] if stated is None else [stated]
    frames.append(Frame("offset", "project output"))
    longitude, latitude = np.abs(centres[:, 0]), np.abs(centres[:, 1])
    if (longitude <= 180.0).all() and (latitude <= 89.0).all():
        frames.append(Frame("geographic", "WGS 84", crs="EPSG:4979"))
    radius_m = np.linalg.norm(centres, axis=1)
    if ((radius_m > 6.3e6) & (radius_m < 6.45e6)).all():
        frames.append(Frame("geocentric", "WGS 84", crs="EPSG:4978"))
    return tuple(frames)
