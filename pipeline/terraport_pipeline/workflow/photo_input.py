"""The photos and cameras that a build is given: found, hashed, opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

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
from terraport_pipeline.option import COMMON, OFFSET, Option
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import texture
from terraport_pipeline.workflow.photo_check import checked_photos
from terraport_pipeline.workflow.workdir import file_digest

__all__ = ["LocatedPhotos", "Texturing", "camera_samples", "cameras_beside", "project_texturing"]

_NOT_PHOTOS: Final = {"vertex": "vertex colours", "mesh": "the mesh"}
"""What textures are made of without photos, by ``--texture-from``."""

_MAX_SAMPLES: Final = 20_000
"""Points of the cloud that the cameras are tried on."""


@dataclass(frozen=True, slots=True)
class Texturing:
    """What a build is asked for in the way of textures."""

    options: texture.Options = field(default_factory=texture.Options)
    photos: Annotated[Path | None, Option(heading=COMMON)] = None
    """Folder of the survey's photos, or of the project that aligned them: the scene gets textures
    from them."""
    cameras: Annotated[
        Path | None, Option(heading=COMMON, unset="looked for in the photos' folder and above it")
    ] = None
    """Where the photos were taken: file or project folder of COLMAP, OpenSfM, OpenDroneMap, Pix4D,
    Metashape, RealityCapture, ContextCapture, VisualSFM or Bundler."""
    camera_offset: Annotated[
        tuple[float, float, float] | None,
        Option(notation=OFFSET, unset="found where the cameras' files state it"),
    ] = None
    """Metres east, north and up to add to the cameras' coordinates."""

    def __post_init__(self) -> None:
        if self.options.source != "photos" and (self.photos or self.cameras):
            raise OptionError(
                f"photos for textures from {_NOT_PHOTOS[self.options.source]}; expected one or the "
                f"other: leave out --photos, or --texture-from {self.options.source}"
            )
        if self.options.source == "photos" and self.photos is None:
            raise OptionError(
                "options of cameras or textures without photos; expected the folder of the photos "
                "with --photos, or --texture-from vertex; of a mesh with textures of its own "
                "--texture-from mesh"
            )

    @property
    def folder(self) -> Path:
        """Folder that the photos are looked for in: of an OpenDroneMap project the originals."""
        if self.photos is None:
            raise ValueError("textures without photos have no folder of them")
        return originals_in(self.photos)

    def find(self, progress: Progress) -> LocatedPhotos | None:
        """Find cameras and photos and hash them; None with textures that need none.

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
        cameras = self.cameras or cameras_beside(self.photos)
        raw = read_raw_cameras(cameras, sizes_below(self.folder))
        # Names and sizes are all that is looked at; poses in the scene need the cloud.
        path_of_photo = find_photos(self.folder, raw.cameras)
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
            self,
            cameras,
            len(path_of_photo),
            digest.hexdigest(),
            _digest_of_cameras(raw),
            raw.format,
        )

    def recorded(self, photos: LocatedPhotos | None) -> dict[str, Any]:
        """Return what changes the published bytes, as the manifest records it."""
        values: dict[str, Any] = asdict(self.options)
        if photos is not None:
            values["photos"] = {"count": photos.count, "xxh3": photos.photos_xxh3}
            values["cameras"] = {"format": photos.format, "xxh3": photos.cameras_xxh3}
            values["camera_offset"] = None if self.camera_offset is None else [*self.camera_offset]
        return values


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
        folder = self.asked.folder
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
