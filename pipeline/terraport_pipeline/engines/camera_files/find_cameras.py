"""Which file of cameras a folder holds, and which reader reads it: by content.

Names are only where programs leave their files. What a file is, its first bytes say, except
COLMAP's, which have none of their own. A folder with the results of several programs, or with
several files of one, is refused with their names: they may be different alignments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from terraport_pipeline.engines.camera_files.agisoft import read_agisoft
from terraport_pipeline.engines.camera_files.blocks_exchange import MAGIC as BLOCKS_MAGIC
from terraport_pipeline.engines.camera_files.blocks_exchange import read_blocks_exchange
from terraport_pipeline.engines.camera_files.bundler import MAGIC as BUNDLER_MAGIC
from terraport_pipeline.engines.camera_files.bundler import read_bundler
from terraport_pipeline.engines.camera_files.colmap import read_colmap
from terraport_pipeline.engines.camera_files.nvm import MAGIC as NVM_MAGIC
from terraport_pipeline.engines.camera_files.nvm import read_nvm
from terraport_pipeline.engines.camera_files.omega_phi_kappa import (
    is_omega_phi_kappa,
    read_omega_phi_kappa,
)
from terraport_pipeline.engines.camera_files.opensfm import read_opensfm, read_shots
from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize
from terraport_pipeline.engines.camera_files.pix4d import EXTERNAL_MAGIC as PIX4D_EXTERNAL_MAGIC
from terraport_pipeline.engines.camera_files.pix4d import MAGIC as PIX4D_MAGIC
from terraport_pipeline.engines.camera_files.pix4d import read_pix4d, read_pix4d_external
from terraport_pipeline.engines.camera_files.raw_cameras import MAX_CAMERAS, RawCameras
from terraport_pipeline.engines.camera_files.realitycapture import (
    XMP_MAGIC,
    is_camera_table,
    read_camera_table,
    read_sidecars,
)
from terraport_pipeline.errors import PhotoError, ReadError

__all__ = ["has_cameras", "reader_of"]

_HEAD_BYTES: Final = 4096

_ADVICE: Final = (
    "give a COLMAP model (folder with cameras and images, .txt or .bin), OpenSfM's or "
    "OpenDroneMap's reconstruction.json or shots.geojson, Pix4D's "
    "*_calibrated_camera_parameters.txt, Metashape's cameras as XML, Blocks Exchange XML, "
    "RealityCapture's camera parameters (CSV) or XMP files, VisualSFM's NVM, or Bundler's "
    "bundle.out"
)

_COLMAP: Final = "COLMAP"
_OPENSFM: Final = "OpenDroneMap or OpenSfM"
_PIX4D: Final = "Pix4D"

_PLACES: Final = (
    "cameras.txt", "cameras.bin", "colmap/cameras.txt", "colmap/cameras.bin",
    "[0-9]*/cameras.[bt][ix][nt]", "sparse/cameras.bin", "sparse/cameras.txt",
    "sparse/[0-9]*/cameras.[bt][ix][nt]", "colmap/sparse/[0-9]*/cameras.[bt][ix][nt]",
    "reconstruction.json",
    "opensfm/reconstruction.json", "shots.geojson", "odm_report/shots.geojson",
    "*_calibrated_camera_parameters.txt", "params/*_calibrated_camera_parameters.txt",
    "1_initial/params/*_calibrated_camera_parameters.txt",
    "*_calibrated_external_camera_parameters.txt", "bundle.out", "bundle/bundle.out",
    "opensfm/bundle_r000.out", "*.out", "*.nvm", "*.xml", "*.csv", "*.txt",
)  # fmt: skip
"""Where a project folder has its cameras, the most complete first."""

_SIDECARS: Final = ("*.xmp", "images/*.xmp")
"""Where XMP files lie, which are taken where there is nothing else: they stay behind from earlier
alignments."""

_NAMED: Final = 4
"""Files that a message names."""


@dataclass(frozen=True, slots=True)
class _Format:
    """How a file is read, and whose it is."""

    program: str
    read: Callable[[Path, PhotoSize], RawCameras]


def has_cameras(folder: Path) -> bool:
    """Tell whether a folder holds a file of cameras where programs leave them."""
    return folder.is_dir() and (
        next(_inside(folder), None) is not None or next(_sidecars(folder), None) is not None
    )


def reader_of(path: Path, photo_size: PhotoSize | None) -> tuple[Path, Callable[[], RawCameras]]:
    """Choose the file and its reader.

    Parameters
    ----------
    path : Path
        A file, or the folder of a project.
    photo_size : callable or None
        Passed to readers of formats that do not say the size of photos.

    Returns
    -------
    source : Path
        The file that is read; for XMP files their folder.
    read : callable

    Raises
    ------
    ReadError
        No file of cameras; or several that may be different alignments.
    """
    if path.is_dir():
        candidates = list(_inside(path))
        if candidates:
            source, form = _only(path, candidates)
            models = _further_models(source, candidates)
            if models:
                return source, partial(_read_first_model, source, models)
        elif next(_sidecars(path), None) is not None:
            return path, partial(_read_all_sidecars, path, _asked(path, photo_size))
        else:
            raise ReadError(path, "no file of cameras is in this folder", _ADVICE)
        return source, partial(form.read, source, _asked(source, photo_size))
    if not path.is_file():
        raise ReadError(path, "there is no such file", _ADVICE)
    found = _format_of(path, _head(path))
    if found is None:
        head = _head(path)
        if XMP_MAGIC in head:
            return path, partial(read_sidecars, (path,), path.parent, _asked(path, photo_size))
        contents = (
            "XML of another program" if head.startswith(b"<") else f"it begins with {head[:24]!r}"
        )
        raise ReadError(path, f"this is no file of cameras: {contents}", _ADVICE)
    return path, partial(found.read, path, _asked(path, photo_size))


def _inside(folder: Path) -> Iterator[tuple[Path, str, _Format]]:
    """Find the files of cameras with the place that matched; each once, most complete first."""
    seen: set[Path] = set()
    for pattern in _PLACES:
        for path in sorted(folder.glob(pattern), key=_model_number):
            if path in seen or not path.is_file():
                continue
            seen.add(path)
            form = _format_of(path, _head(path))
            if form is not None:
                yield path, pattern, form


def _only(folder: Path, candidates: list[tuple[Path, str, _Format]]) -> tuple[Path, _Format]:
    """Take the most complete file of the only program; refuse several that may differ."""
    source, place, form = candidates[0]
    same = {source.parent, *_further_models(source, candidates)} if form.program == _COLMAP else {}
    rivals = [
        path
        for path, other_place, other in candidates
        if other.program != form.program
        or (other_place == place and path != source and path.parent not in same)
    ]
    if rivals:
        names = [str(path.relative_to(folder)) for path in (source, *rivals)]
        more = "" if len(names) <= _NAMED else f" and {len(names) - _NAMED} more"
        raise ReadError(
            folder,
            f"{len(names)} files of cameras that may be different alignments "
            f"({', '.join(names[:_NAMED])}{more})",
            "name one of them with --cameras",
        )
    return source, form


def _model_number(path: Path) -> tuple[bool, int, Path]:
    """Sort key of COLMAP's numbered models: 2 before 10."""
    number = path.parent.name
    return not number.isdecimal(), int(number) if number.isdecimal() else 0, path


def _further_models(source: Path, candidates: list[tuple[Path, str, _Format]]) -> tuple[Path, ...]:
    """List the folders of COLMAP's other models, next to the one that is read.

    COLMAP writes one model, numbered from 0, for every set of photos that it could not join.
    """
    if not source.parent.name.isdecimal():
        return ()
    folders = {path.parent for path, _, form in candidates if form.program == _COLMAP}
    numbered = [
        folder
        for folder in folders - {source.parent}
        if folder.parent == source.parent.parent and folder.name.isdecimal()
    ]
    return tuple(sorted(numbered, key=lambda folder: int(folder.name)))


def _read_first_model(source: Path, models: Sequence[Path]) -> RawCameras:
    """Read one of COLMAP's models; warn how many photos the others have."""
    raw = _read_colmap(source, partial(_no_photos, source))
    used = {camera.name for camera in raw.cameras}
    counts = []
    for folder in models:
        file = folder / "cameras.bin"
        try:
            cameras = _read_colmap(
                file if file.is_file() else file.with_suffix(".txt"), partial(_no_photos, source)
            ).cameras
        except ReadError as error:
            counts.append(f"{folder.name} cannot be read: {error.reason}")
            continue
        more = len({camera.name for camera in cameras} - used)
        counts.append(f"{folder.name} has {len(cameras):,} photos, {more:,} of them only there")
    text = (
        f"Of COLMAP's {len(models) + 1} models only {source.parent.parent.name}/"
        f"{source.parent.name} is used, with {len(used):,} photos ({'; '.join(counts)}): merge "
        "them (colmap model_merger), or name another one with --cameras."
    )
    return replace(raw, warnings=(*raw.warnings, text))


def _sidecars(folder: Path) -> Iterator[Path]:
    for pattern in _SIDECARS:
        for path in sorted(folder.glob(pattern)):
            if XMP_MAGIC in _head(path):
                yield path


def _read_all_sidecars(folder: Path, photo_size: PhotoSize) -> RawCameras:
    paths = []
    for path in sorted(folder.rglob("*.xmp")):
        if XMP_MAGIC in _head(path):
            paths.append(path)
        if len(paths) > MAX_CAMERAS:
            raise ReadError(folder, f"more than {MAX_CAMERAS:,} XMP files", "give fewer photos")
    return read_sidecars(paths, folder, photo_size)


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES).removeprefix(b"\xef\xbb\xbf").lstrip()


def _asked(path: Path, photo_size: PhotoSize | None) -> PhotoSize:
    return photo_size or partial(_no_photos, path)


def _alone(read: Callable[[Path], RawCameras]) -> Callable[[Path, PhotoSize], RawCameras]:
    """Adapt a reader whose format says the size of the photos."""
    return lambda path, _: read(path)


def _format_of(path: Path, head: bytes) -> _Format | None:
    """Tell a format by content, and by name where the content cannot tell; None of any other."""
    # (1) COLMAP's files have no first bytes of their own: by name.
    name = path.name.lower()
    stem = name.rpartition(".")[0]
    if is_omega_phi_kappa(head):
        return _Format("Metashape", _alone(read_omega_phi_kappa))
    if stem in ("cameras", "images") and path.suffix in (".txt", ".bin"):
        return _Format(_COLMAP, _read_colmap)
    # (2) The others by their first bytes.
    text = head.decode("utf-8", errors="replace")
    if text.startswith(("{", "[")):
        # A folder's other JSON is not read as cameras: only what is named, or lies where it should.
        if "FeatureCollection" in text:
            return _Format(_OPENSFM, _alone(read_shots))
        return _Format(_OPENSFM, _alone(read_opensfm))
    if text.startswith("<"):
        if BLOCKS_MAGIC in head:
            return _Format("Blocks Exchange", _alone(read_blocks_exchange))
        if "<document" in text or "<chunk" in text:
            return _Format("Metashape", _alone(read_agisoft))
        return None
    if text.startswith(BUNDLER_MAGIC):
        return _Format(_program_of(path, "Bundler"), read_bundler)
    if text.startswith(NVM_MAGIC):
        return _Format(_program_of(path, "VisualSFM"), read_nvm)
    if text.startswith(PIX4D_MAGIC):
        return _Format(_PIX4D, _alone(read_pix4d))
    if text.startswith(PIX4D_EXTERNAL_MAGIC):
        return _Format(_PIX4D, _alone(read_pix4d_external))
    if is_camera_table(head):
        return _Format("RealityCapture", read_camera_table)
    return None


def _program_of(path: Path, usual: str) -> str:
    """Attribute a file to OpenSfM where it lies beside its reconstruction: the same alignment."""
    return _OPENSFM if (path.parent / "reconstruction.json").is_file() else usual


def _read_colmap(path: Path, _: PhotoSize) -> RawCameras:
    for stem in ("cameras", "images"):
        if not path.with_stem(stem).is_file():
            raise ReadError(
                path,
                f"COLMAP's {path.with_stem(stem).name} is not beside it",
                "give the whole model",
            )
    return read_colmap(path.parent, binary=path.suffix == ".bin")


def _no_photos(path: Path, name: str) -> tuple[int, int]:
    raise PhotoError(
        f"{path} does not say how large its photos are (the first is {name}); give their folder "
        "with --photos"
    )
