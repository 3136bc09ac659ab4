"""Metashape's cameras as text (Export Cameras, *Omega Phi Kappa*), with the lens beside it.

Lines ``name X Y Z omega phi kappa r11 .. r33`` after comments, the first of which states the
coordinate system. Angles as Pix4D's: ``Rx(omega) Ry(phi) Rz(kappa)`` takes a camera of x right, y
up, z backward to the world. The matrix is the same, one way or the other, and is only compared.

The text says no lens: that is Metashape's calibration (Tools > Camera Calibration > Save, Agisoft
XML), the only one beside it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.camera_files.agisoft import read_calibration
from terraport_pipeline.engines.camera_files.pix4d import omega_phi_kappa
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    FLIP,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    frames_by_name,
)
from terraport_pipeline.engines.camera_files.text_files import parse_numbers, text_lines
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["is_omega_phi_kappa", "read_omega_phi_kappa"]

_SYSTEM: Final = "# CoordinateSystem:"
_HEADING: Final = "PhotoID, X, Y, Z, Omega, Phi, Kappa"

_ADVICE: Final = "export the cameras in the survey's coordinate system"

_ROUNDED: Final = 1e-4
"""By which a stated rotation may differ from its angles."""


def is_omega_phi_kappa(head: bytes) -> bool:
    """Tell Metashape's text by the heading of its columns.

    Parameters
    ----------
    head : bytes
        The file's beginning.
    """
    return _HEADING.encode() in head


def read_omega_phi_kappa(path: Path) -> RawCameras:
    """Read the cameras, and the one lens beside them.

    Raises
    ------
    ReadError
        Damaged, or not exactly one calibration beside it.
    """
    lens = _only_lens(path)
    system = ""
    cameras: list[RawCamera] = []
    for number, text in text_lines(path):
        if text.startswith("#"):
            if text.startswith(_SYSTEM):
                system = text.removeprefix(_SYSTEM).strip()
            continue
        if not text:
            continue
        location = f"line {number:,}"
        words = text.split("\t") if "\t" in text else text.split()
        if len(words) not in (7, 16):
            raise ReadError(
                path, f"{text[:80]!r} is no name with position and angles", AGAIN, location
            )
        values = parse_numbers(path, number, words[1:], len(words) - 1, "position and angles")
        check_position(path, location, values[:3])
        to_world = omega_phi_kappa(*values[3:6])
        if len(values) == 15:
            stated = np.array(values[6:]).reshape(3, 3)
            if min(np.abs(stated - to_world).max(), np.abs(stated.T - to_world).max()) > _ROUNDED:
                raise ReadError(path, "the matrix is not that of the angles", AGAIN, location)
        cameras.append(RawCamera(words[0], lens, FLIP @ to_world.T, np.array(values[:3])))
        check_count(path, len(cameras), location)
    check_count(path, len(cameras))
    frames = frames_by_name(system, "the file's coordinate system")
    return RawCameras("Omega Phi Kappa", tuple(cameras), frames, advice=_ADVICE)


def _only_lens(path: Path) -> Lens:
    lenses = {
        candidate: lens
        for candidate in sorted(path.parent.glob("*.xml"))
        if (lens := read_calibration(candidate)) is not None
    }
    if len(lenses) != 1:
        names = ", ".join(candidate.name for candidate in lenses) or "none"
        raise ReadError(
            path,
            f"it does not say the lens, and of Metashape's calibrations (*.xml) {names} is beside "
            "it, expected one",
            "export the cameras as Agisoft XML (*.xml) instead, which has all in one",
        )
    return next(iter(lenses.values()))
