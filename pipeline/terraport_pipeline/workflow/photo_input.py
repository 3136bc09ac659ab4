"""The photos and cameras that a build is given: found, hashed, opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import xxhash

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.engines.camera_files import has_cameras, read_cameras, read_raw_cameras
from terraport_pipeline.engines.camera_files.raw_cameras import RawCameras
from terraport_pipeline.engines.odm_project import find_odm_project, originals_in
from terraport_pipeline.engines.photos import (
    OpenPhotos,
    find_photos,
    fit_lens,
    none_usable,
    open_photos,
    sizes_below,
)
from terraport_pipeline.errors import OptionError, PhotoError
from terraport_pipeline.model import Crs
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.progress import Progress
from terraport_pipeline.workflow.photo_check import checked_photos
from terraport_pipeline.workflow.workdir import file_digest

__all__ = [
    "LocatedPhotos",
    "camera_samples",
    "cameras_beside",
    "locate_photos",
    "photo_folder",
    "project_texturing",
    "recorded_textures",
]

_MAX_SAMPLES: Final = 20_000
"""Points of the cloud that the cameras are tried on."""


@dataclass(frozen=True, slots=True)
class LocatedPhotos:
    """Cameras whose photos were located and hashed, before they are placed in a scene."""

    asked: Texturing
    cameras: Path
    count: int
    photos_xxh3: str
    cameras_xxh3: str
    format: str

    def open(
        self,
        points: Float32,
        colours: UInt8 | None,
        origin: Float64,
        crs: Crs | None,
        *,
        max_bytes: int,
    ) -> OpenPhotos:
        """Place the cameras in the scene and open the photos that show it.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float32
            Of the survey, scene frame: the cameras must look at them.
        colours : ndarray of shape (N, 3), uint8, or None
            Theirs; None where the survey has none.
        origin : ndarray of shape (3,), float64
            The scene's.
        crs : Crs or None
            The survey's.
        max_bytes : int
            Bound of the decoded photos that are kept.

        Raises
        ------
        ReadError, PhotoError
            As :func:`~terraport_pipeline.engines.camera_files.read_cameras` and
            :func:`~terraport_pipeline.engines.photos.open_photos`.
        """
        folder = photo_folder(self.asked)
        samples = camera_samples(points)
        placed = read_cameras(
            self.cameras,
            origin=origin,
            crs=crs,
            offset=self.asked.camera_offset,
            samples=samples.astype(np.float64),
            photo_size=sizes_below(folder),
        )
        opened = open_photos(placed.views, folder, max_bytes=max_bytes)
        checked = checked_photos(
            opened, samples, None if colours is None else camera_samples(colours)
        )
        return replace(checked, warnings=(*placed.warnings, *checked.warnings))

    def try_on(
        self,
        points: Float32,
        colours: UInt8 | None,
        origin: Float64,
        crs: Crs | None,
        progress: Progress,
    ) -> None:
        """Say at once, before hours of work, whether cameras and photos show the survey.

        Parameters are those of :meth:`open`.

        Raises
        ------
        ReadError, PhotoError
            As :meth:`open`: the cameras look elsewhere.
        """
        progress.start("texture: do the photos show the survey", None, "photos")
        opened = self.open(points, colours, origin, crs, max_bytes=0)
        progress.done({"photos": len(opened.views), "left out": opened.left_out})


def photo_folder(texturing: Texturing) -> Path:
    """Return the folder that is searched for photos; for an OpenDroneMap project its originals."""
    if texturing.photos is None:
        raise ValueError("textures without photos have no folder of them")
    return originals_in(texturing.photos)


def locate_photos(texturing: Texturing, progress: Progress) -> LocatedPhotos | None:
    """Find and hash the cameras and photos; None if the textures need none.

    Raises
    ------
    OptionError
        No cameras are given, and none are next to the photos.
    ReadError
        The cameras cannot be read.
    PhotoError
        No photo of the cameras exists, or none can be used.
    """
    if texturing.photos is None:
        return None
    if not texturing.photos.is_dir():
        raise PhotoError(
            f"{texturing.photos} is not a folder; give the folder of the original photos"
        )
    cameras = texturing.cameras or cameras_beside(texturing.photos)
    raw = read_raw_cameras(cameras, sizes_below(photo_folder(texturing)))
    # Only names and sizes are checked; poses in the scene need the cloud.
    path_of_photo = find_photos(photo_folder(texturing), raw.cameras)
    refused: dict[str, PhotoError] = {}
    for camera in raw.cameras:
        if camera.name in path_of_photo:
            try:
                fit_lens(camera.lens, path_of_photo[camera.name])
            except PhotoError as error:
                refused[camera.name] = error
    if len(refused) == len(path_of_photo):
        raise none_usable(refused)
    progress.start("texture: checksum of the photos", float(len(path_of_photo)), "photos")
    digest = xxhash.xxh3_64()
    for name in sorted(path_of_photo):
        digest.update(f"{name}\0{file_digest(path_of_photo[name])}\0".encode())
        progress.advance(1)
    left_out = len(raw.cameras) - len(path_of_photo) + len(refused)
    progress.done({"photos": len(path_of_photo) - len(refused), "left out": left_out})
    return LocatedPhotos(
        texturing,
        cameras,
        len(path_of_photo),
        digest.hexdigest(),
        _digest_of_cameras(raw),
        raw.format,
    )


def recorded_textures(texturing: Texturing, photos: LocatedPhotos | None) -> dict[str, Any]:
    """Return the options that change the published bytes, as the manifest records them."""
    values: dict[str, Any] = asdict(texturing.options)
    if photos is not None:
        values["photos"] = {"count": photos.count, "xxh3": photos.photos_xxh3}
        values["cameras"] = {"format": photos.format, "xxh3": photos.cameras_xxh3}
        offset = texturing.camera_offset
        values["camera_offset"] = None if offset is None else [*offset]
    return values


def project_texturing(inputs: Sequence[Path]) -> Texturing | None:
    """Take the photos of an OpenDroneMap project that is given as the survey.

    Parameters
    ----------
    inputs : sequence of Path
        What was given as the survey.

    Returns
    -------
    Texturing or None
        None where it is no project with its photos.
    """
    project = find_odm_project(inputs[0]) if len(inputs) == 1 else None
    if project is None or project.cloud is None or project.photos is None:
        return None
    return Texturing(photos=project.folder)


_Rows = TypeVar("_Rows", Float32, Float64, UInt8)


def camera_samples(rows: _Rows) -> _Rows:
    """Thin points, or what belongs to them, to what cameras and photos are tried on."""
    return rows[:: max(1, len(rows) // _MAX_SAMPLES)]


def cameras_beside(photos: Path) -> Path:
    """Look for cameras where the photos are, or one folder up.

    Raises
    ------
    OptionError
        There are none.
    """
    for folder in (photos, photos.absolute().parent):
        if has_cameras(folder):
            return folder
    raise OptionError(
        f"photos without cameras: no file of cameras is in {photos} or the folder above; give the "
        "project of COLMAP, OpenDroneMap, Pix4D, Metashape, RealityCapture, ContextCapture, "
        "VisualSFM or Bundler that aligned the photos with --cameras"
    )


def _digest_of_cameras(raw: RawCameras) -> str:
    """Hash lenses, poses and frames to the last bit: a key for the textures."""
    digest = xxhash.xxh3_64()
    for camera in raw.cameras:
        digest.update(f"{camera.name}\0{astuple(camera.lens)!r}\0".encode())
        digest.update(np.ascontiguousarray(camera.rotation, dtype="<f8").tobytes())
        digest.update(np.ascontiguousarray(camera.centre, dtype="<f8").tobytes())
    for frame in raw.frames:
        digest.update(repr((frame.kind, frame.offset, frame.geodetic, frame.crs)).encode())
    return digest.hexdigest()
