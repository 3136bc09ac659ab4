"""Agisoft Metashape's (PhotoScan's) cameras as XML (File > Export > Export Cameras).

Conventions (Agisoft Metashape User Manual, appendix "Camera models"; forum topics 6437 and 9404): a
camera's ``transform`` takes camera (x right, y down, z forward) to the chunk, row by row; the
``transform`` of its component, or else of the chunk, takes that to the world (rotation,
translation, scale): Earth-centred metres on the datum of ``reference``, or plain metres where that
is a ``LOCAL_CS`` or missing.

Lens: ``u = w / 2 + cx + f x' + b1 x' + b2 y'``, ``v = h / 2 + cy + f y'`` with ``x' = x (1 + k1 r^2
+ .. + k4 r^8) + p1 (r^2 + 2 x^2) + 2 p2 x y``: p1 and p2 the other way round than OpenCV. The
centre of the top left pixel is (0.5, 0.5). A fisheye applies the same to its angles. PhotoScan
before 1.2 wrote ``fx``, ``fy``, ``skew``, absolute ``cx`` and ``cy``, and OpenCV's order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
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
    make_lens,
)
from terraport_pipeline.engines.camera_files.xml_files import parse_xml, xml_numbers
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["read_agisoft", "read_calibration"]

_MODELS: Final = {"frame": "radial", "fisheye": "fisheye"}

_TERMS: Final = (
    "f", "fx", "fy", "cx", "cy", "b1", "b2", "skew", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4",
)  # fmt: skip
"""Numbers of a calibration; others are dates and covariances."""

_UNDISTORTED: Final = "export undistorted photos from Metashape"

_ADVICE: Final = (
    "set the chunk's coordinate system to the survey's (Reference > Settings) and export the "
    "cameras again; for a local system state the offset"
)


def read_agisoft(path: Path) -> RawCameras:
    """Read the aligned cameras of the first chunk that has any.

    Raises
    ------
    ReadError
        No XML of this kind, a lens that is not understood, or numbers that are none.
    """
    root = parse_xml(path, "export the cameras alone, without tie points")
    chunks = [root] if root.tag == "chunk" else root.findall(".//chunk")
    if not chunks:
        raise ReadError(
            path,
            f"XML <{root.tag[:40]}> without a <chunk>",
            "export cameras from Metashape in its own format: Agisoft XML (*.xml)",
        )
    warnings: list[str] = []
    for chunk in chunks:
        cameras, unaligned, slaves = _read_chunk(path, chunk)
        if cameras:
            break
    check_count(path, len(cameras))
    if unaligned:
        warnings.append(f"{unaligned:,} photos have no pose in {path.name}; they are left out.")
    if slaves:
        warnings.append(
            f"{slaves:,} photos of other lenses or bands of a multi-camera system have no pose of "
            f"their own in {path.name}; they are left out."
        )
    if any(_rolls(sensor) for sensor in chunk.findall("sensors/sensor")):
        warnings.append(
            "Metashape corrected for a rolling shutter; each photo is taken as seen from one "
            "place, which may be off by some pixels at its top and bottom."
        )
    if len(chunks) > 1:
        label = chunk.get("label") or chunk.get("id")
        warnings.append(
            f"{path.name} holds {len(chunks)} chunks; only {label!r} with {len(cameras):,} photos "
            "is used: merge the chunks in Metashape, or export the cameras of another one."
        )
    frame = _frame(chunk)
    frames = (frame,) if frame.kind == "offset" else (frame, Frame("offset", "no offset"))
    return RawCameras("Agisoft XML", tuple(cameras), frames, tuple(warnings), _ADVICE)


def _rolls(sensor: ET.Element) -> bool:
    """Tell whether a sensor was corrected for its rolling shutter."""
    values = {one.get("name"): one.get("value") for one in sensor.findall("property")}
    return values.get("rolling_shutter") in ("true", "1")


def _read_chunk(path: Path, chunk: ET.Element) -> tuple[list[RawCamera], int, int]:
    # (1) Sensors, and the transforms of components and chunk.
    lenses = {one.get("id", ""): one for one in chunk.findall("sensors/sensor")}
    lens_of_sensor: dict[str, Lens] = {}
    moves = {
        one.get("id", ""): _move(path, one.find("transform"), f"component {one.get('id')}")
        for one in chunk.findall("components/component")
    }
    whole = _move(path, chunk.find("transform"), "the chunk's transform")
    # (2) Cameras; the component's transform stands in for the chunk's.
    cameras, unaligned, slaves = [], 0, 0
    listed = [
        ("/".join((*groups, label)), label, one)
        for groups, label, one in _labelled(chunk.find("cameras"))
    ]
    times = Counter(label for _, label, _ in listed)
    for path_of_groups, label, one in listed:
        # A group is a folder of photos: drones number the photos of every folder from 1.
        name = path_of_groups if times[label] > 1 else label
        location = f"camera {name!r}"
        transform = one.find("transform")
        if transform is None and one.get("master_id") is not None:
            slaves += 1
            continue
        if transform is None or one.get("enabled", "true") in ("false", "0"):
            unaligned += 1
            continue
        sensor = one.get("sensor_id", "")
        if sensor not in lenses:
            raise ReadError(path, f"sensor {sensor!r} is not in the file", AGAIN, location)
        if sensor not in lens_of_sensor:
            lens_of_sensor[sensor] = _lens(path, lenses[sensor])
        matrix = xml_numbers(path, transform.text, 16, location).reshape(4, 4)
        scale, rotation, shift = moves.get(one.get("component_id", "")) or whole or _NOWHERE
        check_position(path, location, [scale * np.abs(matrix[:3]).max(), *shift])
        to_world = rotation @ matrix[:3, :3]
        if np.abs(to_world @ to_world.T - np.eye(3)).max() > 1e-6 or np.linalg.det(to_world) < 0:
            raise ReadError(path, f"no rotation: {to_world.round(6).tolist()}", AGAIN, location)
        centre = scale * (rotation @ matrix[:3, 3]) + shift
        cameras.append(RawCamera(name, lens_of_sensor[sensor], to_world.T, centre))
        check_count(path, len(cameras), location)
    return cameras, unaligned, slaves


def _labelled(
    element: ET.Element | None, groups: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], str, ET.Element]]:
    """Yield all cameras, with the labels of their groups from the outermost to the innermost."""
    for one in () if element is None else element:
        if one.tag == "camera":
            yield groups, one.get("label") or f"camera {one.get('id')}", one
        elif one.tag == "group":
            inner = one.get("label") or f"group {one.get('id')}"
            yield from _labelled(one, (*groups, inner))


_NOWHERE: Final = (1.0, np.eye(3), np.zeros(3))
"""Where a chunk without transform lies: as it is."""


def _move(
    path: Path, transform: ET.Element | None, location: str
) -> tuple[float, Float64, Float64] | None:
    """Read scale, rotation and translation of a chunk or component; None where it has none."""
    if transform is None or transform.find("rotation") is None:
        return None
    rotation = xml_numbers(path, transform.findtext("rotation"), 9, location).reshape(3, 3)
    shift = xml_numbers(path, transform.findtext("translation") or "0 0 0", 3, location)
    (scale,) = xml_numbers(path, transform.findtext("scale") or "1", 1, location)
    if scale <= 0.0:
        raise ReadError(path, f"a scale of {scale}", AGAIN, location)
    return float(scale), rotation, shift


def _frame(chunk: ET.Element) -> Frame:
    text = (chunk.findtext("reference") or "").strip()
    if not text or text.startswith("LOCAL_CS"):
        return Frame("offset", "Metashape's local coordinates")
    return Frame("geocentric", "the chunk's reference", crs=text)


def _lens(path: Path, sensor: ET.Element) -> Lens:
    location = f"sensor {sensor.get('label') or sensor.get('id')!r}"
    kind = sensor.get("type", "frame")
    calibrations = sensor.findall("calibration")
    adjusted = [one for one in calibrations if one.get("class") == "adjusted"]
    calibration = next(iter(adjusted or calibrations), None)
    # (1) Kind and size; what is no perspective or fisheye lens is refused.
    if kind not in _MODELS:
        raise ReadError(
            path,
            f"a {kind} camera, expected {' or '.join(_MODELS)}",
            _UNDISTORTED,
            location,
        )
    if calibration is None:
        raise ReadError(path, "no calibration", "align the photos, then export again", location)
    resolution = calibration.find("resolution")
    if resolution is None:
        resolution = sensor.find("resolution")
    size = () if resolution is None else (resolution.get("width"), resolution.get("height"))
    width, height = (int(v) for v in xml_numbers(path, " ".join(map(str, size)), 2, location))

    return _calibrated(path, location, calibration, kind, (width, height))


def read_calibration(path: Path) -> Lens | None:
    """Read a lens that Metashape saved by itself (Tools > Camera Calibration > Save).

    Returns
    -------
    Lens or None
        None where the file is XML of another kind.

    Raises
    ------
    ReadError
        Damaged, or a lens that is not understood.
    """
    with path.open("rb") as file:
        if b"<calibration" not in file.read(512):
            return None
    root = parse_xml(path, "give one camera's calibration")
    if root.tag != "calibration":
        return None
    kind = (root.findtext("projection") or "frame").strip()
    if kind not in _MODELS:
        raise ReadError(path, f"a {kind} camera, expected {' or '.join(_MODELS)}", _UNDISTORTED)
    size = f"{root.findtext('width')} {root.findtext('height')}"
    width, height = (int(value) for value in xml_numbers(path, size, 2, "width and height"))
    return _calibrated(path, "the calibration", root, kind, (width, height))


def _calibrated(
    path: Path, location: str, calibration: ET.Element, kind: str, size: tuple[int, int]
) -> Lens:
    # (1) The numbers of the lens.
    width, height = size
    values = {
        one.tag: float(xml_numbers(path, one.text, 1, f"{location}, {one.tag}")[0])
        for one in calibration
        if one.text and one.tag in _TERMS
    }
    higher = [name for name in ("p3", "p4") if values.get(name)]
    if higher:
        raise ReadError(
            path,
            f"the lens has {', '.join(higher)}",
            "optimise the cameras in Metashape without p3 and p4, or export undistorted photos",
            location,
        )
    # (2) PhotoScan before 1.2 wrote fx, fy, cx, cy and p1, p2 as OpenCV does; Metashape
    # writes f, b1, b2, and cx, cy from the middle, p1 and p2 the other way round.
    old = "f" not in values
    middle = (0.0, 0.0) if old else (0.5 * width, 0.5 * height)
    focal = values.get("fy" if old else "f", 0.0)
    first, second = values.get("p1", 0.0), values.get("p2", 0.0)
    return make_lens(
        path,
        location,
        width=width,
        height=height,
        fx=values.get("fx", 0.0) if old else focal + values.get("b1", 0.0),
        fy=focal,
        cx=middle[0] + values.get("cx", 0.5 * width if old else 0.0),
        cy=middle[1] + values.get("cy", 0.5 * height if old else 0.0),
        skew=values.get("skew", 0.0) if old else values.get("b2", 0.0),
        model=_MODELS[kind],
        radial=tuple(values.get(f"k{i}", 0.0) for i in range(1, 5)),
        tangential=(first, second) if old else (second, first),
    )
