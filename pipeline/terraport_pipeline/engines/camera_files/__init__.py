"""Cameras of photos, from the programs that align them; found by content.

``read_cameras`` is all that others need. One file per format reads it into
:class:`~.raw_cameras.RawCameras`; ``georeference.py`` brings them to the scene.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.agisoft import read_agisoft
from terraport_pipeline.engines.camera_files.bundler import MAGIC as BUNDLER_MAGIC
from terraport_pipeline.engines.camera_files.bundler import read_bundler
from terraport_pipeline.engines.camera_files.colmap import read_colmap
from terraport_pipeline.engines.camera_files.georeference import place_cameras
from terraport_pipeline.engines.camera_files.opensfm import read_opensfm, read_shots
from terraport_pipeline.engines.camera_files.pix4d import EXTERNAL_MAGIC as PIX4D_EXTERNAL_MAGIC
from terraport_pipeline.engines.camera_files.pix4d import MAGIC as PIX4D_MAGIC
from terraport_pipeline.engines.camera_files.pix4d import read_pix4d, read_pix4d_external
from terraport_pipeline.engines.camera_files.raw_cameras import PhotoSize, RawCameras
from terraport_pipeline.errors import PhotoError, ReadError
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.model import Crs

__all__ = ["CameraSet", "has_cameras", "read_cameras", "read_raw_cameras"]

_HEAD_BYTES: Final = 4096

_ADVICE: Final = (
    "give a COLMAP model (folder with cameras and images, .txt or .bin), OpenSfM's or "
    "OpenDroneMap's reconstruction.json or shots.geojson, Pix4D's "
    "*_calibrated_camera_parameters.txt, Metashape's cameras as XML, or Bundler's bundle.out"
)

_PLACES: Final = (
    "cameras.txt", "cameras.bin", "colmap/cameras.txt", "colmap/cameras.bin", "0/cameras.bin",
    "0/cameras.txt", "sparse/cameras.bin", "sparse/cameras.txt", "sparse/0/cameras.bin",
    "sparse/0/cameras.txt", "colmap/sparse/0/cameras.bin", "reconstruction.json",
    "opensfm/reconstruction.json", "shots.geojson", "odm_report/shots.geojson",
    "*_calibrated_camera_parameters.txt", "params/*_calibrated_camera_parameters.txt",
    "1_initial/params/*_calibrated_camera_parameters.txt",
    "*_calibrated_external_camera_parameters.txt", "bundle.out", "bundle/bundle.out", "*.out",
    "*.xml",
)  # fmt: skip
"""Where a project folder has its cameras, the most complete first."""


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
        A file, or the folder of a project of COLMAP, OpenSfM, OpenDroneMap, Pix4D, Metashape or
        Bundler.
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
        Width and height in pixels of the photo of a name; needed for Bundler.

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
    source = path
    if path.is_dir():
        candidates = list(_inside(path))
        if not candidates:
            raise ReadError(path, "no file of cameras is in this folder", _ADVICE)
        source = candidates[0]
    elif not path.is_file():
        raise ReadError(path, "there is no such file", _ADVICE)
    raw = _reader(source, photo_size)()
    (twice, times), *_ = Counter(camera.name for camera in raw.cameras).most_common(1)
    if times > 1:
        raise ReadError(source, f"photo {twice!r} has two poses", "give one reconstruction")
    return raw


def has_cameras(folder: Path) -> bool:
    """Tell whether a folder holds a file of cameras where programs leave them."""
    return folder.is_dir() and next(_inside(folder), None) is not None


def _inside(folder: Path) -> Iterator[Path]:
    for pattern in _PLACES:
        for path in sorted(folder.glob(pattern)):
            if path.suffix != ".xml" or _looks_like_agisoft(_head(path)):
                yield path


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES).removeprefix(b"\xef\xbb\xbf").lstrip()


def _looks_like_agisoft(head: bytes) -> bool:
    return head.startswith(b"<") and (b"<document" in head or b"<chunk" in head)


def _reader(path: Path, photo_size: PhotoSize | None) -> Callable[[], RawCameras]:
    """Choose by content, and by name where the content cannot tell."""
    name, head = path.name.lower(), _head(path)
    stem = name.rpartition(".")[0]
    # (1) COLMAP's files have no first bytes of their own: by name.
    if stem in ("cameras", "images") and path.suffix in (".txt", ".bin"):
        for one in ("cameras", "images"):
            if not path.with_stem(one).is_file():
                raise ReadError(
                    path,
                    f"COLMAP's {path.with_stem(one).name} is not beside it",
                    "give the whole model",
                )
        return partial(read_colmap, path.parent, binary=path.suffix == ".bin")
    # (2) The others by their first bytes.
    if head.startswith((b"{", b"[")):
        return partial(read_shots if b"FeatureCollection" in head else read_opensfm, path)
    if _looks_like_agisoft(head):
        return partial(read_agisoft, path)
    if head.startswith(BUNDLER_MAGIC.encode()):
        return partial(read_bundler, path, photo_size or partial(_no_photos, path))
    if head.startswith(PIX4D_MAGIC.encode()):
        return partial(read_pix4d, path)
    if head.startswith(PIX4D_EXTERNAL_MAGIC.encode()):
        return partial(read_pix4d_external, path)
    contents = (
        "XML of another program" if head.startswith(b"<") else f"it begins with {head[:24]!r}"
    )
    raise ReadError(path, f"this is no file of cameras: {contents}", _ADVICE)


def _no_photos(path: Path, name: str) -> tuple[int, int]:
    raise PhotoError(
        f"{path} does not say how large its photos are (the first is {name}); give their folder "
        "with --photos"
    )
