"""Blocks Exchange XML of ContextCapture (iTwin Capture), also written by Metashape.

Conventions (Bentley, "BlocksExchange XML/XMZ format" and "Camera model"): ``Rotation`` takes the
world to a camera whose axes ``CameraOrientation`` names, ``Center`` is its centre, both in the
block's ``SRSId``. Focal length in pixels, or in millimetres beside the sensor's longer side. The
principal point counts from the *middle* of the top left pixel. ``K1 K2 K3 P1 P2`` is Brown's
model, P1 and P2 the other way round than OpenCV's: ``u (1 + K1 r^2 ..) + P1 (r^2 + 2 u^2) + 2 P2 u
v``. In a system of degrees a camera is turned against east, north, up of its own centre.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    Frame,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    frames_by_name,
    make_lens,
    nearest_rotation,
)
from terraport_pipeline.engines.camera_files.xml_files import parse_xml, xml_numbers
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["MAGIC", "read_blocks_exchange"]

MAGIC: Final = b"<BlocksExchange"

_AXES: Final = {
    "Right": (1.0, 0.0, 0.0), "Left": (-1.0, 0.0, 0.0),
    "Down": (0.0, 1.0, 0.0), "Up": (0.0, -1.0, 0.0),
}  # fmt: skip
"""Directions in the picture in our camera's axes."""

_ORIENTATION: Final = re.compile(r"X(Right|Left|Down|Up)Y(Right|Left|Down|Up)")

_ADVICE: Final = "export the block in the survey's CRS"

_UNDISTORTED: Final = "export undistorted photos with their cameras"


def read_blocks_exchange(path: Path) -> RawCameras:
    """Read the photos of all photogroups that have a full pose.

    Raises
    ------
    ReadError
        No XML of this kind, a lens or an order of axes that is not understood, several blocks, or
        photogroups in different systems.
    """
    root = parse_xml(path, "export the block without tie points")
    blocks = root.findall("Block")
    if root.tag != "BlocksExchange" or len(blocks) != 1:
        raise ReadError(
            path, f"<{root.tag[:40]}> with {len(blocks)} blocks, expected one", "export one block"
        )
    block = blocks[0]
    cameras: list[RawCamera] = []
    without_pose = 0
    systems: set[str] = set()
    for index, group in enumerate(block.findall("Photogroups/Photogroup")):
        location = f"photogroup {group.findtext('Name') or index}"
        lens: Lens | None = None
        for photo in group.findall("Photo"):
            if photo.find("Pose/Center") is None or photo.find("Pose/Rotation") is None:
                without_pose += 1
                continue
            lens = lens or _lens(path, location, group)
            cameras.append(_camera(path, photo, lens, _axes(path, location, group)))
            check_count(path, len(cameras), location)
            systems.add(group.findtext("SRSId") or block.findtext("SRSId") or "")
    check_count(path, len(cameras))
    if len(systems) > 1:
        raise ReadError(
            path, f"photogroups in {len(systems)} coordinate systems, expected one", _ADVICE
        )
    warnings: tuple[str, ...] = ()
    if without_pose:
        warnings = (f"{without_pose:,} photos have no pose in {path.name}; they are left out.",)
    frames = _frames(root, systems.pop())
    return RawCameras("Blocks Exchange", tuple(cameras), frames, warnings, _ADVICE)


def _frames(root: ET.Element, system: str) -> tuple[Frame, ...]:
    for srs in root.findall("SpatialReferenceSystems/SRS"):
        if (srs.findtext("Id") or "").strip() == system.strip() != "":
            definition = srs.findtext("Definition") or ""
            return frames_by_name(definition, srs.findtext("Name") or definition)
    return frames_by_name("", "no system")


def _axes(path: Path, location: str, group: ET.Element) -> Float64:
    """Return the rotation from the photogroup's camera axes to ours."""
    text = (group.findtext("CameraOrientation") or "XRightYDown").strip()
    match = _ORIENTATION.fullmatch(text)
    across, down = (np.array(_AXES[name]) for name in match.groups()) if match else (None, None)
    if across is None or down is None or across @ down != 0.0:
        raise ReadError(path, f"the camera's axes are {text!r}", AGAIN, location)
    return np.stack([across, down, np.cross(across, down)], axis=1)


def _camera(path: Path, photo: ET.Element, lens: Lens, axes: Float64) -> RawCamera:
    name = (photo.findtext("ImagePath") or "").strip().replace("\\", "/")
    location = f"photo {name or photo.findtext('Id')!r}"
    if not name:
        raise ReadError(path, "a photo without ImagePath", AGAIN, location)
    pose = photo.find("Pose")
    assert pose is not None  # looked for by the caller
    entries = [
        pose.findtext(f"Rotation/M_{row}{column}") for row in range(3) for column in range(3)
    ]
    if None in entries:
        raise ReadError(
            path,
            "a rotation without its matrix",
            "export rotations as matrices",
            location,
        )
    matrix = xml_numbers(path, " ".join(map(str, entries)), 9, location).reshape(3, 3)
    words = (pose.findtext(f"Center/{axis}") or "" for axis in "xyz")
    centre = xml_numbers(path, " ".join(words), 3, location)
    check_position(path, location, centre)
    rotation = nearest_rotation(path, location, matrix)
    return RawCamera(name, lens, axes @ rotation, centre)


def _lens(path: Path, location: str, group: ET.Element) -> Lens:
    kind = (group.findtext("CameraModelType") or "Perspective").strip()
    if kind != "Perspective":
        raise ReadError(path, f"a {kind} camera, expected Perspective", _UNDISTORTED, location)

    def number(tag: str, default: float | None = None) -> float:
        text = group.findtext(tag)
        if text is None and default is not None:
            return default
        return float(xml_numbers(path, text, 1, f"{location}, {tag}")[0])

    width, height = (int(number(f"ImageDimensions/{side}")) for side in ("Width", "Height"))
    if group.find("FocalLengthPixels") is not None:
        focal = number("FocalLengthPixels")
    else:
        focal = number("FocalLength") / number("SensorSize") * max(width, height)
    # Half a pixel: theirs count from the middle of the first one, ours from its corner.
    cx = number("PrincipalPoint/x", 0.5 * width - 0.5) + 0.5
    cy = number("PrincipalPoint/y", 0.5 * height - 0.5) + 0.5
    higher = [name for name in ("K4", "K5", "K6") if number(f"Distortion/{name}", 0.0)]
    if higher:
        raise ReadError(path, f"the lens has {', '.join(higher)}", _UNDISTORTED, location)
    return make_lens(
        path,
        location,
        width=width,
        height=height,
        fx=focal,
        fy=focal * number("AspectRatio", 1.0),
        cx=cx,
        cy=cy,
        skew=number("Skew", 0.0),
        radial=tuple(number(f"Distortion/K{i}", 0.0) for i in range(1, 4)),
        tangential=(number("Distortion/P2", 0.0), number("Distortion/P1", 0.0)),
    )
