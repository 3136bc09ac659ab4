"""The photos and cameras that a build is given: found, hashed, opened."""

from __future__ import annotations

from dataclasses import asdict, astuple, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import xxhash

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.engines.camera_files import has_cameras, read_cameras, read_raw_cameras
from terraport_pipeline.engines.camera_files.raw_cameras import RawCameras
from terraport_pipeline.engines.photo_store import photo_size
from terraport_pipeline.engines.photos import (
    OpenPhotos,
    find_photos,
    fit_lens,
    none_usable,
    open_photos,
)
from terraport_pipeline.errors import OptionError, PhotoError
from terraport_pipeline.model import Crs, Survey, to_scene
from terraport_pipeline.photo_check import checked_photos
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import texture
from terraport_pipeline.workdir import file_digest

__all__ = ["FoundPhotos", "Texturing", "camera_samples"]

_MAX_SAMPLES: Final = 20_000
"""Points of the cloud that the cameras are tried on."""


@dataclass(frozen=True, slots=True)
class Texturing:
    """What a build is asked for in the way of textures."""

    options: texture.Options = field(default_factory=texture.Options)
    photos: Path | None = None
    """Folder of the photos; None with textures from vertex colours."""
    cameras: Path | None = None
    """File or project folder; looked for in the photos' folder and the one above by default."""
    camera_offset: tuple[float, float, float] | None = None
    """East, north, height to add to the cameras' coordinates; found by itself where stated."""

    def __post_init__(self) -> None:
        if self.options.source == "vertex" and (self.photos or self.cameras):
            raise OptionError(
                "photos for textures from vertex colours; expected one or the other: leave out "
                "--photos, or --texture-from vertex"
            )
        if self.options.source == "photos" and self.photos is None:
            raise OptionError("cameras without photos; give the folder of the photos with --photos")

    def find(self, progress: Progress) -> FoundPhotos | None:
        """Find cameras and photos and hash them; None with textures from vertex colours.

        Raises
        ------
        OptionError
            No cameras are given, and none are beside the photos.
        ReadError
            The cameras cannot be read.
        PhotoError
            No photo of the cameras is there, or none can be used.
        """
        if self.photos is None:
            return None
        if not self.photos.is_dir():
            raise PhotoError(f"{self.photos} is no folder; give the folder of the original photos")
        cameras = self.cameras or _beside(self.photos)
        raw = read_raw_cameras(cameras, partial(_size_of, self.photos))
        # Names and sizes are all that is looked at; poses in the scene need the cloud.
        found = find_photos(self.photos, raw.cameras)
        refused: dict[str, PhotoError] = {}
        for camera in raw.cameras:
            if camera.name in found:
                try:
                    fit_lens(camera.lens, found[camera.name])
                except PhotoError as error:
                    refused[camera.name] = error
        if len(refused) == len(found):
            raise none_usable(refused)
        progress.start("texture: checksum of the photos", float(len(found)), "photos")
        digest = xxhash.xxh3_64()
        for name in sorted(found):
            digest.update(f"{name}\0{file_digest(found[name])}\0".encode())
            progress.advance(1)
        left_out = len(raw.cameras) - len(found) + len(refused)
        progress.done({"photos": len(found) - len(refused), "left out": left_out})
        return FoundPhotos(
            self, cameras, len(found), digest.hexdigest(), _digest_of_cameras(raw), raw.format
        )

    def recorded(self, found: FoundPhotos | None) -> dict[str, Any]:
        """Return what changes the published bytes, as the manifest records it."""
        told: dict[str, Any] = asdict(self.options)
        if found is not None:
            told["photos"] = {"count": found.count, "xxh3": found.photos_xxh3}
            told["cameras"] = {"format": found.format, "xxh3": found.cameras_xxh3}
            told["camera_offset"] = None if self.camera_offset is None else [*self.camera_offset]
        return told


@dataclass(frozen=True, slots=True)
class FoundPhotos:
    """Cameras and photos that are there."""

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
        folder = self.asked.photos
        assert folder is not None
        samples = camera_samples(points)
        known = read_cameras(
            self.cameras,
            origin=origin,
            crs=crs,
            offset=self.asked.camera_offset,
            samples=samples.astype(np.float64),
            photo_size=partial(_size_of, folder),
        )
        opened = open_photos(known.views, folder, max_bytes=max_bytes)
        checked = checked_photos(
            opened, samples, None if colours is None else camera_samples(colours)
        )
        return replace(checked, warnings=(*known.warnings, *checked.warnings))

    def try_on(self, survey: Survey, progress: Progress) -> None:
        """Say at once, before hours of work, whether cameras and photos show the survey.

        Raises
        ------
        ReadError, PhotoError
            As :meth:`open`: the cameras look elsewhere.
        """
        progress.start("texture: do the photos show the survey", None, "photos")
        points = camera_samples(survey.points)
        origin = np.floor(points.mean(axis=0))
        colours = None if survey.colours is None else camera_samples(survey.colours)
        opened = self.open(
            to_scene(points, origin).astype(np.float32), colours, origin, survey.crs, max_bytes=0
        )
        progress.done({"photos": len(opened.views), "left out": opened.left_out})


_Rows = TypeVar("_Rows", Float32, Float64, UInt8)


def camera_samples(rows: _Rows) -> _Rows:
    """Thin points, or what belongs to them, to what cameras and photos are tried on."""
    return rows[:: max(1, len(rows) // _MAX_SAMPLES)]


@dataclass(frozen=True, slots=True)
class _Named:
    """As much of a view as finding its photo needs."""

    name: str


def _size_of(photos: Path, name: str) -> tuple[int, int]:
    """Width and height of a photo whose camera does not say them (Bundler's)."""
    return photo_size(find_photos(photos, [_Named(name)])[name])


def _beside(photos: Path) -> Path:
    """Look for cameras where the photos are, or one folder up."""
    for folder in (photos, photos.absolute().parent):
        if has_cameras(folder):
            return folder
    raise OptionError(
        f"photos without cameras: no file of cameras is in {photos} or the folder above; give the "
        "project of COLMAP, OpenDroneMap, Pix4D, Metashape or Bundler that aligned the photos with "
        "--cameras"
    )


def _digest_of_cameras(raw: RawCameras) -> str:
    """Hash what was read, to the last bit."""
    digest = xxhash.xxh3_64()
    for camera in raw.cameras:
        digest.update(f"{camera.name}\0{astuple(camera.lens)!r}\0".encode())
        digest.update(np.ascontiguousarray(camera.rotation, dtype="<f8").tobytes())
        digest.update(np.ascontiguousarray(camera.centre, dtype="<f8").tobytes())
    for frame in raw.frames:
        digest.update(repr((frame.kind, frame.offset, frame.place, frame.crs)).encode())
    return digest.hexdigest()
