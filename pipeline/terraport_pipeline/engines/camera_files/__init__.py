"""Cameras of photos, from the programs that align them; found by content.

``read_cameras`` is all that others need. ``find_cameras.py`` tells formats apart, one file per
format reads it into :class:`~.raw_cameras.RawCameras`, ``georeference.py`` brings them to the
scene.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.find_cameras import has_cameras, reader_of
from terraport_pipeline.engines.camera_files.georeference import place_cameras
from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize
from terraport_pipeline.engines.camera_files.raw_cameras import RawCameras
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.model import Crs

__all__ = ["CameraSet", "has_cameras", "read_cameras", "read_raw_cameras"]


@dataclass(frozen=True, slots=True)
class CameraSet:
    """Views of a survey's photos in the scene frame, and how they were georeferenced."""

    views: tuple[View, ...]
    """Scene frame, in the order of the file."""
    warnings: tuple[str, ...]
    """What the user should know, whole sentences."""
    format: str
    """For people: ``"COLMAP (text)"``."""
    frame: str
    """How the file's coordinates were understood, with the offset where there is one."""
    seen: float | None
    """Share of the cloud's samples that lie in at least one photo; None without samples."""


def read_cameras(
    path: Path,
    *,
    origin: Float64,
    crs: Crs | None,
    offset: tuple[float, float, float] | None = None,
    samples: Float64 | None = None,
    photo_size: PhotoSize | None = None,
) -> CameraSet:
    """Read the cameras of a survey's photos.

    Parameters
    ----------
    path : Path
        A file, or the folder of a project of COLMAP, OpenSfM, OpenDroneMap, Pix4D, Metashape,
        RealityCapture, ContextCapture (Blocks Exchange), VisualSFM or Bundler.
    origin : ndarray of shape (3,), float64
        E0, N0, H0 of the scene, CRS frame.
    crs : Crs or None
        The survey's.
    offset : tuple of float, optional
        East, north, height to add to the file's coordinates; found by itself where the file or one
        beside it says it.
    samples : ndarray of shape (N, 3), optional
        Points of the cloud, metres, scene frame: the cameras must look at them, and of several
        meanings of the file's coordinates that is taken which lets them see most.
    photo_size : callable, optional
        Width and height in pixels of the photo of a name; needed for Bundler, NVM and
        RealityCapture.

    Returns
    -------
    CameraSet

    Raises
    ------
    ReadError
        The file cannot be read; names file, place, reason.
    PhotoError
        The cameras do not look at the cloud.
    """
    raw = read_raw_cameras(path, photo_size)
    placed = place_cameras(raw, origin=origin, crs=crs, offset=offset, samples=samples)
    warnings = (*raw.warnings, *placed.warnings)
    return CameraSet(placed.views, warnings, raw.format, str(placed.frame), placed.seen)


def read_raw_cameras(path: Path, photo_size: PhotoSize | None = None) -> RawCameras:
    """Read cameras in their file's own coordinates; the first half of :func:`read_cameras`.

    Raises
    ------
    ReadError
    """
    source, read = reader_of(path, photo_size)
    raw = read()
    (twice, times), *_ = Counter(camera.name for camera in raw.cameras).most_common(1)
    if times > 1:
        raise ReadError(
            source, f"photo {twice!r} has {times} poses, expected one",
            "give one reconstruction; photos of several folders need names that tell them apart",
        )  # fmt: skip
    return raw
