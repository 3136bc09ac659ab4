"""Projects of OpenDroneMap and WebODM: which of their many files are cloud, photos and cameras.

A project (a task's folder, or *all assets* unpacked, with its ``images`` beside) holds the same
points several times: georeferenced, as tiles of a web viewer, and before georeferencing in
coordinates of their own. The survey is the first alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["OdmProject", "find_odm_project", "originals_in"]

_CLOUDS: Final = tuple(
    f"odm_georeferencing/odm_georeferenced_model.{ending}" for ending in ("copc.laz", "laz", "las")
)

_CAMERAS: Final = (
    "opensfm/reconstruction.json", "odm_report/shots.geojson", "opensfm/bundle_r000.out",
)  # fmt: skip

_IMAGES: Final = "images"


@dataclass(frozen=True, slots=True)
class OdmProject:
    """What of a project is the survey."""

    folder: Path
    cloud: Path | None
    """The georeferenced points; None where they are not there."""
    photos: Path | None
    """Folder of the original photos; None where it, or the cameras, are not there."""


def find_odm_project(folder: Path) -> OdmProject | None:
    """Look whether a folder is a project of OpenDroneMap.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    OdmProject or None
        None of any other folder.
    """
    if not folder.is_dir():
        return None
    cloud = next((folder / name for name in _CLOUDS if (folder / name).is_file()), None)
    has_cameras = any((folder / name).is_file() for name in _CAMERAS)
    if cloud is None and not has_cameras:
        return None
    images = folder / _IMAGES
    return OdmProject(folder, cloud, images if has_cameras and images.is_dir() else None)


def originals_in(folder: Path) -> Path:
    """Return where photos are looked for: of a project its originals, of any other folder itself.

    A project holds smaller and undistorted copies of the photos under the same names.
    """
    project = find_odm_project(folder)
    return folder if project is None or project.photos is None else project.photos
