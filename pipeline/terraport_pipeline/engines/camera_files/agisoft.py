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

from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    MAX_TEXT_BYTES,
    Frame,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    check_size,
    make_lens,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["read_agisoft"]

_MODELS: Final = {"frame": "radial", "fisheye": "fisheye"}


def read_agisoft(path: Path) -> RawCameras:
    """Read the aligned cameras of the first chunk that has any.

    Raises
    ------
    ReadError
        No XML of this kind, a lens that is not understood, or numbers that are none.
    """
    root = _parse(path)
    chunks = [root] if root.tag == "chunk" else root.findall(".//chunk")
    if not chunks:
        raise ReadError(
            path,
            f"XML <{root.tag[:40]}> without a <chunk>",
            "export cameras from Metashape in its own format: Agisoft XML (*.xml)",
        )
    warnings: list[str] = []
    for chunk in chunks:
        cameras, unaligned = _read_chunk(path, chunk)
        if cameras:
            break
    check_count(path, len(cameras))
    if unaligned:
        warnings.append(f"{unaligned:,} photos have no pose in {path.name}; they are left out.")
    if len(chunks) > 1:
        warnings.append(f"{path.name} holds {len(chunks)} chunks; only one is used.")
    frame = _frame(chunk)
    frames = (frame,) if frame.kind == "offset" else (frame, Frame("offset", "no offset"))
    return RawCameras("Agisoft XML", tuple(cameras), frames, tuple(warnings))


def _parse(path: Path) -> ET.Element:
    check_size(path, MAX_TEXT_BYTES, "export the cameras alone, without tie points")
    data = path.read_bytes()
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    def refuse(*_: object) -> None:
        raise ReadError(path, "XML with a document type", "export the cameras from Metashape again")

    # Without a document type there are no entities to expand or to fetch. The parser tells of one
    # in whatever encoding the file is; searching the bytes would miss it in UTF-16.
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ReadError(path, f"no XML ({error})", AGAIN, f"line {error.lineno:,}") from error
    except (LookupError, ValueError) as error:  # an encoding that Python, or expat, does not know
        raise ReadError(path, f"no XML ({error})", AGAIN, "line 1") from error
    return builder.close()


def _read_chunk(path: Path, chunk: ET.Element) -> tuple[list[RawCamera], int]:
    # (1) Sensors, and the transforms of components and chunk.
    lenses = {one.get("id", ""): one for one in chunk.findall("sensors/sensor")}
    lens_of_sensor: dict[str, Lens] = {}
    moves = {
        one.get("id", ""): _move(path, one.find("transform"), f"component {one.get('id')}")
        for one in chunk.findall("components/component")
    }
    whole = _move(path, chunk.find("transform"), "the chunk's transform")
    # (2) Cameras; the component's transform stands in for the chunk's.
    cameras, unaligned = [], 0
    for one in chunk.iterfind("cameras//camera"):
        name = one.get("label") or f"camera {one.get('id')}"
        location = f"camera {name!r}"
        transform = one.find("transform")
        if transform is None or one.get("enabled", "true") in ("false", "0"):
            unaligned += 1
            continue
        sensor = one.get("sensor_id", "")
        if sensor not in lenses:
            raise ReadError(path, f"sensor {sensor!r} is not in the file", AGAIN, location)
        if sensor not in lens_of_sensor:
            lens_of_sensor[sensor] = _lens(path, lenses[sensor])
        matrix = _numbers(path, transform.text, 16, location).reshape(4, 4)
        scale, rotation, shift = moves.get(one.get("component_id", "")) or whole or _NOWHERE
        check_position(path, location, [scale * np.abs(matrix[:3]).max(), *shift])
        to_world = rotation @ matrix[:3, :3]
        if np.abs(to_world @ to_world.T - np.eye(3)).max() > 1e-6 or np.linalg.det(to_world) < 0:
            raise ReadError(path, f"no rotation: {to_world.round(6).tolist()}", AGAIN, location)
        centre = scale * (rotation @ matrix[:3, 3]) + shift
        cameras.append(RawCamera(name, lens_of_sensor[sensor], to_world.T, centre))
        check_count(path, len(cameras), location)
    return cameras, unaligned


_NOWHERE: Final = (1.0, np.eye(3), np.zeros(3))
"""Where a chunk without transform lies: as it is."""


def _move(
    path: Path, transform: ET.Element | None, location: str
) -> tuple[float, Float64, Float64] | None:
    """Read scale, rotation and translation of a chunk or component; None where it has none."""
    if transform is None or transform.find("rotation") is None:
        return None
    rotation = _numbers(path, transform.findtext("rotation"), 9, location).reshape(3, 3)
    shift = _numbers(path, transform.findtext("translation") or "0 0 0", 3, location)
    (scale,) = _numbers(path, transform.findtext("scale") or "1", 1, location)
    if scale <= 0.0:
        raise ReadError(path, f"a scale of {scale}", AGAIN, location)
    return float(scale), rotation, shift


def _numbers(path: Path, text: str | None, expected: int, location: str) -> Float64:
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != expected or not np.isfinite(values).all():
        raise ReadError(
            path, f"{(text or '')[:80]!r} is not {expected} finite numbers", AGAIN, location
        )
    return values


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
            "export undistorted photos from Metashape",
            location,
        )
    if calibration is None:
        raise ReadError(path, "no calibration", "align the photos, then export again", location)
    resolution = calibration.find("resolution")
    if resolution is None:
        resolution = sensor.find("resolution")
    size = () if resolution is None else (resolution.get("width"), resolution.get("height"))
    width, height = (int(v) for v in _numbers(path, " ".join(map(str, size)), 2, location))

    # (2) Its numbers.
    values = {
        one.tag: float(_numbers(path, one.text, 1, f"{location}, {one.tag}")[0])
        for one in calibration
        if one.text and one.tag[:1] in "fckpbs" and one.tag != "covariance"
    }
    higher = [name for name in ("p3", "p4") if values.get(name)]
    if higher:
        raise ReadError(
            path,
            f"the lens has {', '.join(higher)}",
            "optimise the cameras in Metashape without p3 and p4, or export undistorted photos",
            location,
        )
    # (3) PhotoScan before 1.2 wrote fx, fy, cx, cy and p1, p2 as OpenCV does; Metashape
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
