"""What a cameras' file says, before it is brought to the scene; and how a reader checks it.

A reader gives cameras in the file's own world frame, and *frames*: the ways in which that frame may
lie in the survey's, best guess first. Which one is right shows only against the cloud
(``georeference.py``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_payload.types import Float64
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = [
    "AGAIN",
    "FLIP",
    "MAX_CAMERAS",
    "MAX_TEXT_BYTES",
    "Frame",
    "RawCamera",
    "RawCameras",
    "check_count",
    "check_position",
    "check_size",
    "frames_by_name",
    "make_lens",
    "nearest_rotation",
    "quaternion_to_matrix",
    "rotation_vector_to_matrix",
]

MAX_CAMERAS: Final = 100_000
"""Photos of one survey; a file that claims more is damaged."""

MAX_TEXT_BYTES: Final = 512 << 20
"""Largest file that is parsed whole (JSON, XML): ten thousand photos with their tie points."""

_MAX_COORDINATE_M: Final = 1e8
"""Twice around the Earth; some national grids count from far away."""

AGAIN: Final = "the file is cut off or damaged: copy or export it again"

FLIP: Final = np.diag([1.0, -1.0, -1.0])
"""Camera axes x right, y up, z backward to ours (x right, y down, z forward), and back."""

_NUMBERS: Final = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


@dataclass(frozen=True, slots=True)
class Frame:
    """One way to understand a file's world coordinates."""

    kind: Literal["offset", "enu", "geocentric", "crs", "geographic"]
    """``"offset"``: the survey's CRS less `offset`. ``"enu"``: metres east, north, up of a place on
    the ellipsoid. ``"geocentric"``: metres from the Earth's centre. ``"crs"``: another CRS, in
    metres. ``"geographic"``: centres in degrees east, degrees north and metres, each camera turned
    against the metres east, north, up of its own centre."""
    source: str
    """Where this comes from, for messages: ``"OFFSET.txt"``, ``"reference_lla"``."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres east, north, up."""
    geodetic: tuple[float, float, float] | None = None
    """Latitude and longitude in degrees and height in metres of ``"enu"``."""
    crs: str | None = None
    """Well-known text or code: of the datum for ``"geocentric"``, of the frame for ``"crs"`` and
    ``"geographic"``."""

    def __str__(self) -> str:
        if self.kind == "enu" and self.geodetic is not None:
            latitude, longitude, height = self.geodetic
            return f"metres about {latitude:.6f}, {longitude:.6f}, {height:.1f} m ({self.source})"
        if self.kind == "geocentric":
            return f"Earth-centred metres ({self.source})"
        if self.kind == "geographic":
            return f"degrees and metres ({self.source})"
        if self.kind == "crs":
            return f"coordinates of another system ({self.source})"
        if self.offset == (0.0, 0.0, 0.0):
            return f"the survey's own coordinates ({self.source})"
        numbers = ", ".join(f"{value:,.3f}" for value in self.offset)
        return f"the survey's coordinates less {numbers} m ({self.source})"


@dataclass(frozen=True, slots=True, eq=False)
class RawCamera:
    """Lens and pose of one photo in the file's world frame."""

    name: str
    lens: Lens
    rotation: Float64
    """(3, 3), world to camera (x right, y down, z forward)."""
    centre: Float64
    """(3,) world coordinates."""


@dataclass(frozen=True, slots=True)
class RawCameras:
    """Cameras in the coordinates of their file, with every frame these may be in."""

    format: str
    cameras: tuple[RawCamera, ...]
    frames: tuple[Frame, ...]
    warnings: tuple[str, ...] = ()
    advice: str = ""
    """How the program exports cameras that look at the cloud, for the message when these do not."""


def frames_by_name(name: str, source: str) -> tuple[Frame, ...]:
    """Read what a file says of its coordinate system: a code, or well-known text.

    Parameters
    ----------
    name : str
        ``"EPSG:32615"``, WKT, ``"ENU:46.8,-92.1"``; empty or a local system where it says none.
    source : str
        For messages.

    Returns
    -------
    tuple of Frame
        The stated one, where it is understood, and then the survey's own coordinates.
    """
    own = Frame("offset", "no offset")
    text = name.strip()
    if text.upper().startswith("ENU:"):
        numbers = [float(word) for word in _NUMBERS.findall(text[4:])]
        if len(numbers) in (2, 3) and abs(numbers[0]) <= 90.0:
            latitude, longitude, height = [*numbers, 0.0][:3]
            return (Frame("enu", source, geodetic=(latitude, longitude, height)), own)
        return (own,)
    if not text or text.upper().startswith(("LOCAL", "ENGCRS")):
        return (own,)
    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        return (own,)
    if crs.is_geocentric:
        return (Frame("geocentric", source, crs=text), own)
    return (Frame("geographic" if crs.is_geographic else "crs", source, crs=text), own)


def check_size(path: Path, most: int, advice: str) -> None:
    """Refuse a file beyond `most` bytes.

    Raises
    ------
    ReadError
    """
    size = path.stat().st_size
    if size > most:
        raise ReadError(path, f"it has {size:,} bytes, expected at most {most:,}", advice)


def check_count(path: Path, count: int, location: str | None = None) -> None:
    """Refuse no cameras, and more than :data:`MAX_CAMERAS`.

    Raises
    ------
    ReadError
    """
    if count < 1:
        raise ReadError(
            path, "no camera in it has a pose", "export it after the photos are aligned", location
        )
    if count > MAX_CAMERAS:
        raise ReadError(
            path, f"it says {count:,} cameras, expected at most {MAX_CAMERAS:,}", AGAIN, location
        )


def make_lens(path: Path, location: str, **fields: Any) -> Lens:
    """Make a lens; say where in the file the numbers are that make none.

    Raises
    ------
    ReadError
    """
    try:
        return Lens(**fields)
    except ValueError as error:
        raise ReadError(path, f"no lens: {error}", AGAIN, location) from error


def check_position(path: Path, location: str, numbers: npt.ArrayLike) -> None:
    """Refuse coordinates that are no place on Earth in any system.

    Raises
    ------
    ReadError
    """
    farthest = float(np.abs(numbers).max())
    if not farthest < _MAX_COORDINATE_M:
        raise ReadError(path, f"a coordinate of {farthest:g} m", AGAIN, location)


def nearest_rotation(path: Path, location: str, matrix: Float64) -> Float64:
    """Remove rounding; refuse what is far from a rotation.

    Raises
    ------
    ReadError
    """
    left, _, right = np.linalg.svd(matrix)
    rotation: Float64 = left @ right
    if np.abs(rotation - matrix).max() > 1e-3 or np.linalg.det(rotation) < 0.0:
        raise ReadError(path, f"no rotation: {matrix.round(4).tolist()}", AGAIN, location)
    return rotation


def quaternion_to_matrix(quaternion: Sequence[float]) -> Float64 | None:
    """Turn w, x, y, z of any length into a rotation; None when they are all zero.

    Examples
    --------
    >>> quaternion_to_matrix((2.0, 0.0, 0.0, 0.0)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    length = math.hypot(*quaternion)
    if not 1e-6 < length < 1e6:
        return None
    w, x, y, z = np.asarray(quaternion) / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector_to_matrix(vector: Sequence[float]) -> Float64:
    """Turn an axis times an angle in radians into a rotation (Rodrigues).

    Examples
    --------
    >>> rotation_vector_to_matrix((0.0, 0.0, np.pi / 2)).round(9).tolist()[0]
    [0.0, -1.0, 0.0]
    """
    angle = math.hypot(*vector)
    half = 0.5 * angle
    axis = np.asarray(vector) / angle if angle > 0.0 else np.zeros(3)
    matrix = quaternion_to_matrix((np.cos(half), *(np.sin(half) * axis)))
    assert matrix is not None  # the quaternion has length 1
    return matrix
