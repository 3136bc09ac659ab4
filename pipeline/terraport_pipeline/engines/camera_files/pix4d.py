"""Pix4D's files of the folder ``1_initial/params``.

``*_calibrated_camera_parameters.txt`` has all in one: per photo its name and size, K in pixels,
three radial and two tangential terms, position t and rotation R of ``m = K [R | -R t] X``; x right,
y down, z forward; coordinates less ``*_offset.xyz``.

``*_calibrated_external_camera_parameters.txt`` has ``name X Y Z omega phi kappa`` in degrees (PATB
convention: ``R = Rx(omega) Ry(phi) Rz(kappa)`` takes a camera frame of x right, y up, z backward to
the world), in output coordinates. The lens is in ``*_pix4d_calibrated_internal_camera_parameters``
``.cam``, in millimetres of the sensor; it says no pixels, so the lens is made for a picture of one
pixel per micrometre and scaled to the photo.

Distortion is Brown's in OpenCV's order. Pix4D documents no place of the first pixel's centre;
(0.5, 0.5) is assumed.

References
----------
Pix4D Support, "How are the internal and external camera parameters defined?" (202559089) and "What
does the output params folder contain?" (202977149).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    FLIP,
    Frame,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    make_lens,
)
from terraport_pipeline.engines.camera_files.text_files import (
    next_numbers,
    parse_numbers,
    read_small_text,
    text_lines,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["EXTERNAL_MAGIC", "MAGIC", "omega_phi_kappa", "read_pix4d", "read_pix4d_external"]

MAGIC: Final = "fileName imageWidth imageHeight"
EXTERNAL_MAGIC: Final = "imageName X Y Z Omega Phi Kappa"

_SENSOR: Final = re.compile(r"sensor width of\s*([\d.]+)\s*x\s*([\d.]+)\s*mm")

_MICROMETRES: Final = 1000.0

_BLOCK: Final = (
    ("a row of K", 3), ("a row of K", 3), ("a row of K", 3), ("radial distortion", 3),
    ("tangential distortion", 2), ("a position", 3), ("a row of R", 3), ("a row of R", 3),
    ("a row of R", 3),
)  # fmt: skip
"""The nine lines after a photo's name."""


def read_pix4d(path: Path) -> RawCameras:
    """Read ``*_calibrated_camera_parameters.txt``.

    Raises
    ------
    ReadError
        Damaged or cut off; names the line.
    """
    lines = _after_heading(path)
    cameras = []
    for number, text in lines:
        # (1) Ten lines a photo: name and size, then K, distortion, position and rotation.
        words = text.rsplit(maxsplit=2)
        if len(words) != 3 or not (words[1].isdecimal() and words[2].isdecimal()):
            raise ReadError(
                path, f"{text[:80]!r} is no name, width, height", AGAIN, f"line {number:,}"
            )
        rows = [next_numbers(path, lines, what, count) for what, count in _BLOCK]
        location = f"photo {words[0]!r} after line {number:,}"
        k, rotation = np.array(rows[:3]), np.array(rows[6:])
        # (2) Matrices that are none.
        if abs(k[2, 2] - 1.0) > 1e-9 or k[1, 0] != 0.0 or (k[2, :2] != 0.0).any():
            raise ReadError(path, f"K is {k.tolist()}", AGAIN, location)
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise ReadError(path, f"R is {rotation.tolist()}, no rotation", AGAIN, location)
        lens = make_lens(
            path,
            location,
            width=int(words[1]),
            height=int(words[2]),
            fx=float(k[0, 0]),
            fy=float(k[1, 1]),
            cx=float(k[0, 2]),
            cy=float(k[1, 2]),
            skew=float(k[0, 1]),
            radial=tuple(rows[3]),
            tangential=(rows[4][0], rows[4][1]),
        )
        check_position(path, location, rows[5])
        cameras.append(RawCamera(words[0], lens, rotation, np.array(rows[5])))
        check_count(path, len(cameras), f"line {number:,}")
    check_count(path, len(cameras))
    stated = _offset(path, "_calibrated_camera_parameters.txt")
    own = Frame("offset", "no offset")
    frames = (own,) if stated is None else (stated, own)
    return RawCameras("Pix4D", tuple(cameras), frames)


def read_pix4d_external(path: Path) -> RawCameras:
    """Read ``*_calibrated_external_camera_parameters.txt`` and the lens beside it.

    Raises
    ------
    ReadError
        Damaged, or not exactly one ``*pix4d_calibrated_internal_camera_parameters.cam`` beside it.
    """
    lens = _internal(path)
    cameras = []
    for number, text in text_lines(path):
        if not text or text.startswith("imageName"):
            continue
        words = text.rsplit(maxsplit=6)
        if len(words) != 7:
            raise ReadError(
                path,
                f"{text[:80]!r} is no name and six numbers",
                AGAIN,
                f"line {number:,}",
            )
        values = parse_numbers(path, number, words[1:], 6, "X Y Z omega phi kappa")
        check_position(path, f"line {number:,}", values[:3])
        rotation = FLIP @ omega_phi_kappa(*values[3:]).T
        cameras.append(RawCamera(words[0], lens, rotation, np.array(values[:3])))
        check_count(path, len(cameras), f"line {number:,}")
    check_count(path, len(cameras))
    stated = _offset(path, "_calibrated_external_camera_parameters.txt")
    own = Frame("offset", "output coordinates")
    frames = (own,) if stated is None else (own, stated)
    return RawCameras("Pix4D external parameters", tuple(cameras), frames)


def omega_phi_kappa(omega_deg: float, phi_deg: float, kappa_deg: float) -> Float64:
    """Build ``Rx(omega) Ry(phi) Rz(kappa)``.

    Examples
    --------
    >>> omega_phi_kappa(0.0, 0.0, 90.0).round(9).tolist()[0]
    [0.0, -1.0, 0.0]
    """
    (cw, cp, ck), (sw, sp, sk) = (
        f(np.radians([omega_deg, phi_deg, kappa_deg])) for f in (np.cos, np.sin)
    )
    return np.array(
        [
            [cp * ck, -cp * sk, sp],
            [cw * sk + sw * sp * ck, cw * ck - sw * sp * sk, -sw * cp],
            [sw * sk - cw * sp * ck, sw * ck + cw * sp * sk, cw * cp],
        ]
    )


def _after_heading(path: Path) -> Iterator[tuple[int, str]]:
    """Skip the heading: it ends with the line that states the camera model."""
    heading = True
    for number, text in text_lines(path):
        if heading:
            heading = not text.startswith("camera model")
        elif text:
            yield number, text


def _offset(path: Path, ending: str) -> Frame | None:
    """Read ``<project>_offset.xyz``, or the only file of such a name."""
    own = path.with_name(path.name.removesuffix(ending) + "_offset.xyz")
    candidates = [own] if own.is_file() else sorted(path.parent.glob("*offset.xyz"))
    if len(candidates) != 1:
        return None
    east, north, up = parse_numbers(
        candidates[0], 1, read_small_text(candidates[0]).split(), 3, "an offset"
    )
    return Frame("offset", candidates[0].name, offset=(east, north, up))


def _internal(path: Path) -> Lens:
    candidates = sorted(path.parent.glob("*pix4d_calibrated_internal_camera_parameters.cam"))
    # (1) The one lens file of the project.
    if len(candidates) != 1:
        raise ReadError(
            path,
            f"{len(candidates)} files *pix4d_calibrated_internal_camera_parameters.cam beside it, "
            "expected one",
            "give the file *_calibrated_camera_parameters.txt instead, which needs no other",
        )
    cam = candidates[0]
    # (2) Its size, then its numbers by name; a second lens would overwrite the first and is
    # refused.
    text = read_small_text(cam)
    values: dict[str, float] = {}
    sensor = _SENSOR.search(text)
    if sensor is None:
        raise ReadError(
            cam,
            "no line 'Focal Length mm assuming a sensor width of ..x..mm': no perspective lens of "
            "Pix4D",
            "give the file *_calibrated_camera_parameters.txt; fisheye lenses of Pix4D are not "
            "understood: export undistorted photos",
        )
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if len(words) == 2 and words[0] in ("F", "Px", "Py", "K1", "K2", "K3", "T1", "T2"):
            if words[0] in values:
                raise ReadError(
                    cam,
                    f"{words[0]} occurs twice: the lenses of several cameras",
                    "give the file *_calibrated_camera_parameters.txt instead",
                    f"line {number}",
                )
            (values[words[0]],) = parse_numbers(cam, number, words[1:], 1, words[0])
    missing = [name for name in ("F", "Px", "Py") if name not in values]
    if missing:
        raise ReadError(cam, f"no {', '.join(missing)}", AGAIN)
    # (3) From micrometres on the sensor to pixels.
    size = parse_numbers(cam, 1, sensor.groups(), 2, "a sensor")
    return make_lens(
        cam,
        "the sensor",
        width=round(size[0] * _MICROMETRES),
        height=round(size[1] * _MICROMETRES),
        fx=values["F"] * _MICROMETRES,
        fy=values["F"] * _MICROMETRES,
        cx=values["Px"] * _MICROMETRES,
        cy=values["Py"] * _MICROMETRES,
        radial=tuple(values.get(name, 0.0) for name in ("K1", "K2", "K3")),
        tangential=(values.get("T1", 0.0), values.get("T2", 0.0)),
    )
