"""What files beside the cameras say of their coordinates: offsets and places on Earth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_pipeline.engines.camera_files.colmap import stated_offset
from terraport_pipeline.engines.camera_files.raw_cameras import Frame
from terraport_pipeline.engines.camera_files.text_files import parse_numbers, read_small_text
from terraport_pipeline.errors import ReadError

__all__ = ["odm_offset", "reference_frame", "stated_frames"]

_AGAIN: Final = "export the reconstruction again"

_ODM_OFFSETS: Final = (
    "odm_georeferencing/coords.txt",
    "coords.txt",
    "odm_georeferencing/odm_georeferencing_model_geo.txt",
)
"""Files of OpenDroneMap whose second line is the offset of its local coordinates."""


def stated_frames(path: Path) -> tuple[Frame, ...]:
    """List what the world of a file without coordinates of its own may be, best guess first.

    Parameters
    ----------
    path : Path
        The file of cameras (Bundler, NVM).

    Returns
    -------
    tuple of Frame
        ``OFFSET.txt``, OpenDroneMap's offset, OpenSfM's reference, and the survey's coordinates.
    """
    stated = stated_offset(path.parent)
    frames = [] if stated is None else [stated]
    frames += odm_offset(path)
    reference = path.parent / "reference_lla.json"
    if reference.is_file():
        try:
            document = json.loads(read_small_text(reference))
        except ValueError as error:
            raise ReadError(reference, f"no JSON ({str(error)[:80]})", _AGAIN) from error
        if isinstance(document, dict):
            frames.append(reference_frame(reference, document))
    return (*frames, Frame("offset", "no offset"))


def odm_offset(path: Path) -> Iterator[Frame]:
    """Find the offset of an OpenDroneMap project; nothing elsewhere.

    Parameters
    ----------
    path : Path
        The file of cameras; its folder and the two above are looked into.

    Raises
    ------
    ReadError
        The file has no offset.
    """
    for folder in path.absolute().parents[:3]:
        for name in _ODM_OFFSETS:
            coords = folder / name
            if not coords.is_file():
                continue
            lines = read_small_text(coords).splitlines()
            if len(lines) < 2:
                raise ReadError(coords, "no second line with the offset", _AGAIN)
            east, north = parse_numbers(coords, 2, lines[1].split()[:2], 2, "an offset")
            yield Frame("offset", coords.name, offset=(east, north, 0.0))
            return


def reference_frame(path: Path, reference: Mapping[str, Any]) -> Frame:
    """Read OpenSfM's ``reference_lla``.

    Raises
    ------
    ReadError
        No place on Earth.
    """
    try:
        keys = ("latitude", "longitude", "altitude")
        latitude, longitude, height = (float(reference[key]) for key in keys)
    except (KeyError, TypeError, ValueError) as error:
        raise ReadError(
            path, f"no latitude, longitude, altitude ({error!r})", _AGAIN, "reference_lla"
        ) from error
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0 and np.isfinite(height)):
        raise ReadError(
            path, f"no place on Earth: {latitude}, {longitude}, {height}", _AGAIN, "reference_lla"
        )
    return Frame("enu", "reference_lla", geodetic=(latitude, longitude, height))
