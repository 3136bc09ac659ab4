"""OpenSfM's ``reconstruction.json`` and OpenDroneMap's ``shots.geojson``.

Conventions (OpenSfM ``doc/source/geometry.rst``, ``opensfm/io.py``): a pose is an angle-axis vector
and a translation that take world to camera, x right, y down, z forward. Lengths in a picture are
divided by its larger side, from its middle (``(w - 1) / 2`` where the first pixel's centre is 0,
which is ``w / 2`` for us). The world is metres east, north, up of ``reference_lla``.

OpenDroneMap (``stages/run_opensfm.py``, ``opendm/shots.py``) then moves ``reconstruction.json`` to
the UTM zone less the whole-metre offset in the second line of ``odm_georeferencing/coords.txt``,
and keeps the first in ``reconstruction.topocentric.json``. The place alone does not tell both
apart, so both are offered. ``shots.geojson`` holds UTM coordinates, no offset and no distortion:
that comes from ``cameras.json``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

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
    rotation_vector_to_matrix,
)
from terraport_pipeline.engines.camera_files.stated_frames import odm_offset, reference_frame
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import Lens

__all__ = ["MODELS", "read_opensfm", "read_shots"]

MODELS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "perspective": ("radial", ("k1", "k2")),
    "simple_radial": ("radial", ("k1",)),
    "radial": ("radial", ("k1", "k2")),
    "brown": ("radial", ("k1", "k2", "k3")),
    "fisheye": ("fisheye", ("k1", "k2")),
    "fisheye_opencv": ("fisheye", ("k1", "k2", "k3", "k4")),
}
"""Our model and the radial terms of every projection type that is understood."""

_UNDISTORTED: Final = "undistorted"
"""Folder of the photos without distortion, ``NAME.JPG.tif``, with a reconstruction of their own."""

_TOO_LARGE: Final = "give OpenDroneMap's odm_report/shots.geojson, which has no tie points"

_FRESH: Final = "export the reconstruction again"


def read_opensfm(path: Path) -> RawCameras:
    """Read a reconstruction; all of its parts must be in one frame.

    Parameters
    ----------
    path : Path
        ``reconstruction.json``.

    Raises
    ------
    ReadError
        No JSON of this kind, a lens that is not understood, or numbers that are none.
    """
    reconstructions = _load(path)
    cameras: dict[str, RawCamera] = {}
    references: list[Mapping[str, Any]] = []
    warnings: list[str] = []
    # (1) All reconstructions of the file; a photo in several keeps its first pose.
    for index, reconstruction in enumerate(reconstructions):
        location = f"reconstruction {index}"
        lenses = {
            name: _lens(path, f"camera {name!r}", values)
            for name, values in _mapping(path, reconstruction, "cameras", location).items()
        }
        for name, shot in _mapping(path, reconstruction, "shots", location).items():
            camera = _shot(path, _stored_name(path, name), shot, lenses)
            cameras.setdefault(camera.name, camera)
            check_count(path, len(cameras))
        reference = reconstruction.get("reference_lla") or _beside(
            path.parent / "reference_lla.json"
        )
        if reference is not None and reference not in references:
            references.append(reference)
    check_count(path, len(cameras))
    # (2) Pieces that were never joined may lie in frames of their own.
    if len(reconstructions) > 1:
        warnings.append(
            f"{path.name} holds {len(reconstructions)} reconstructions that OpenSfM could not "
            "join; they are taken as lying in one frame."
        )
    if len(references) > 1:
        raise ReadError(
            path, f"{len(references)} different reference_lla", "give one reconstruction"
        )
    frames = (*odm_offset(path), *(reference_frame(path, one) for one in references))
    own = Frame("offset", "no offset")
    return RawCameras("OpenSfM", tuple(cameras.values()), (*frames, own), tuple(warnings))


def read_shots(path: Path) -> RawCameras:
    """Read OpenDroneMap's ``shots.geojson``.

    Parameters
    ----------
    path : Path
        ``cameras.json`` is looked for beside it, one folder above, and in ``../opensfm``.

    Raises
    ------
    ReadError
        As :func:`read_opensfm`; also when no lens is of the size of a shot.
    """
    document = _parse(path)
    lenses, source = _lenses_beside(path)
    cameras = []
    for feature in document.get("features") or ():
        location = "a feature"
        try:
            values = feature["properties"]
            name = str(values["filename"])
            location = f"shot {name!r}"
            size = int(values["width"]), int(values["height"])
            pose = _floats(values["rotation"], 3), _floats(values["translation"], 3)
        except (KeyError, TypeError, ValueError) as error:
            raise ReadError(
                path, f"no shot of OpenDroneMap ({error!r})", _FRESH, location
            ) from error
        fitting = [one for one in lenses if (one.width, one.height) == size]
        if len(fitting) != 1:
            raise ReadError(
                path,
                f"{len(fitting)} lenses of {size[0]} x {size[1]} pixels in {source}, expected one",
                "give opensfm/reconstruction.json of the same project instead",
                location,
            )
        rotation = rotation_vector_to_matrix(pose[0].tolist())
        check_position(path, location, pose[1])
        cameras.append(RawCamera(name, fitting[0], rotation, pose[1]))
        check_count(path, len(cameras))
    check_count(path, len(cameras))
    frames = (Frame("offset", "shots.geojson: no offset"),)
    return RawCameras("OpenDroneMap shots", tuple(cameras), frames)


def _parse(path: Path) -> Any:
    check_size(path, MAX_TEXT_BYTES, _TOO_LARGE)
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        location = f"line {error.lineno:,}" if isinstance(error, json.JSONDecodeError) else None
        raise ReadError(path, f"no JSON ({str(error)[:80]})", AGAIN, location) from error


def _load(path: Path) -> list[Mapping[str, Any]]:
    document = _parse(path)
    reconstructions = document if isinstance(document, list) else [document]
    if not reconstructions or not all(
        isinstance(one, dict) and "shots" in one for one in reconstructions
    ):
        raise ReadError(
            path, "JSON without shots: no reconstruction of OpenSfM", "give reconstruction.json"
        )
    return reconstructions


def _mapping(path: Path, parent: Mapping[str, Any], key: str, location: str) -> dict[str, Any]:
    values = parent.get(key)
    if not isinstance(values, dict) or not all(isinstance(v, dict) for v in values.values()):
        raise ReadError(path, f"{key!r} is no object of objects", _FRESH, location)
    return values


def _floats(values: Any, expected: int) -> Float64:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (expected,) or not np.isfinite(array).all():
        raise ValueError(f"{str(values)[:80]} is not {expected} finite numbers")
    return array


def _lens(path: Path, location: str, values: Mapping[str, Any]) -> Lens:
    kind = values.get("projection_type")
    if kind not in MODELS:
        raise ReadError(
            path,
            f"the projection type is {kind!r}, expected one of {', '.join(MODELS)}",
            "reconstruct with the camera model brown or fisheye_opencv",
            location,
        )
    model, terms = MODELS[kind]
    # Lengths are in units of the photo's longer side, the principal point from its middle.
    try:
        width, height = int(values["width"]), int(values["height"])
        side = max(width, height)
        across = float(values["focal_x"] if "focal_x" in values else values["focal"])
        down = float(values.get("focal_y", across))
        radial = tuple(float(values.get(name, 0.0)) for name in terms)
        tangential = (0.0, 0.0)
        if kind == "brown":
            tangential = (float(values.get("p1", 0.0)), float(values.get("p2", 0.0)))
        middle = float(values.get("c_x", 0.0)), float(values.get("c_y", 0.0))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ReadError(path, f"no camera of OpenSfM ({error!r})", _FRESH, location) from error
    return make_lens(
        path,
        location,
        width=width,
        height=height,
        fx=across * side,
        fy=down * side,
        cx=0.5 * width + middle[0] * side,
        cy=0.5 * height + middle[1] * side,
        model=model,
        radial=radial,
        tangential=tangential,
    )


def _shot(path: Path, name: str, shot: Mapping[str, Any], lenses: Mapping[str, Lens]) -> RawCamera:
    location = f"shot {name!r}"
    try:
        rotation = rotation_vector_to_matrix(_floats(shot["rotation"], 3).tolist())
        translation = _floats(shot["translation"], 3)
        lens = lenses[shot["camera"]]
    except (KeyError, TypeError, ValueError) as error:
        raise ReadError(path, f"no shot of OpenSfM ({error!r})", _FRESH, location) from error
    check_position(path, location, translation)
    return RawCamera(name, lens, rotation, -rotation.T @ translation)


def _stored_name(path: Path, name: str) -> str:
    """Name the file of a shot; of undistorted ones some versions leave out the second ending."""
    if path.parent.name == _UNDISTORTED:
        images = path.parent / "images"
        for ending in ("", ".tif", ".jpg", ".png"):
            if (images / f"{name}{ending}").is_file():
                return f"{name}{ending}"
    return name


def _beside(path: Path) -> Mapping[str, Any] | None:
    if not path.is_file():
        return None
    document = _parse(path)
    return document if isinstance(document, dict) else None


def _lenses_beside(path: Path) -> tuple[list[Lens], str]:
    folders = (path.parent, path.parent.parent, path.parent.parent / "opensfm")
    for folder in folders:
        cameras = folder / "cameras.json"
        if cameras.is_file():
            document = _parse(cameras)
            if not isinstance(document, dict) or not all(
                isinstance(v, dict) for v in document.values()
            ):
                raise ReadError(cameras, "no object of cameras", _FRESH)
            lenses = [_lens(cameras, f"camera {name!r}", one) for name, one in document.items()]
            return lenses, str(cameras)
    raise ReadError(
        path,
        "no cameras.json beside it or one folder above: the shots do not say the lens",
        "put OpenDroneMap's cameras.json beside it",
    )
