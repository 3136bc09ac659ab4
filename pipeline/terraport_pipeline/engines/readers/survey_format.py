"""Which reader a survey's file needs: by its first bytes, and by its name only where it is text."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Final

from terraport_pipeline.errors import MissingReaderError, ReadError

__all__ = ["FORMATS", "find_format", "is_binary_survey", "is_foreign", "require_reader"]

FORMATS: Final[dict[str, tuple[str, ...]]] = {
    "las": (".las", ".laz"),
    "ply": (".ply",),
    "pcd": (".pcd",),
    "e57": (".e57",),
    "ptx": (".ptx",),
    "xyz": (".xyz", ".csv", ".txt", ".asc", ".pts", ".xyzrgb", ".dat"),
}
"""Readers and the file name endings that belong to them."""

_MAGIC: Final = {
    "las": (b"LASF",),
    "ply": (b"ply\n", b"ply\r", b"ply "),
    "pcd": (b"# .PCD",),
    "e57": (b"ASTM-E57",),
}

_PCD: Final = re.compile(
    rb"^\s*# \.PCD|^VERSION[ \t]+0?\.[567]\s|^(?:FIELDS|COLUMNS)[ \t].*\n[ \t]*SIZE[ \t]",
    re.IGNORECASE | re.MULTILINE,
)
"""First line of a PCD header; comments may precede it."""

_PTX: Final = re.compile(
    rb"\s*\d+\s*\n\s*\d+\s*\n(?:[ \t]*[-+.\deE]+[ \t]+[-+.\deE]+[ \t]+[-+.\deE]+[ \t]*\r?\n){4}"
    rb"(?:[ \t]*[-+.\deE]+[ \t]+[-+.\deE]+[ \t]+[-+.\deE]+[ \t]+[-+.\deE]+[ \t]*\r?\n){4}"
)
"""Header lines of a scan in a PTX file, which may have any name."""

_RASTER_ADVICE: Final = (
    "terraport wants the points that it was made of; of a raster of heights, gdal2xyz makes points"
)

_TILE_ADVICE: Final = (
    "its coordinates are relative to its tileset: export the model itself from the program that "
    "made the tiles, as OBJ, GLB or PLY, or the cloud as LAS"
)

_FOREIGN: Final = (
    (b"version https://git-lfs", "a Git LFS pointer", "fetch the file itself: git lfs pull"),
    (b"PK\x03\x04", "a ZIP archive", "unpack it and give the survey in it"),
    (b"\x1f\x8b", "a gzip archive", "unpack it and give the survey in it"),
    (b"II*\x00", "a TIFF picture", _RASTER_ADVICE),
    (b"MM\x00*", "a TIFF picture", _RASTER_ADVICE),
    (b"II+\x00", "a TIFF picture", _RASTER_ADVICE),
    (b"<!DOCTYPE", "a web page", "download the file itself"),
    (b"<html", "a web page", "download the file itself"),
    (b"b3dm", "the content of a 3D Tile", _TILE_ADVICE),
    (b"i3dm", "the content of a 3D Tile", _TILE_ADVICE),
    (b"cmpt", "the content of a 3D Tile", _TILE_ADVICE),
    (b"pnts", "the content of a 3D Tile", _TILE_ADVICE),
    (b"Kaydara FBX", "a mesh as FBX", "export it as OBJ, GLB or PLY"),
)


_EXTRAS: Final = {
    "e57": ("E57", "pye57", "e57"),
    "ptx": ("PTX", "pyarrow", "text"),
    "xyz": ("text", "pyarrow", "text"),
}
"""Readers of an extra of their own, for their size: what is read, package, extra."""


def require_reader(path: Path, name: str) -> None:
    """Make sure that what reads a format is installed.

    Parameters
    ----------
    path : pathlib.Path
        The file, for the error.
    name : str
        A key of :data:`FORMATS`.

    Raises
    ------
    MissingReaderError
        When it is not; names the extra.
    """
    if name in _EXTRAS:
        kind, package, extra = _EXTRAS[name]
        if importlib.util.find_spec(package) is None:
            raise MissingReaderError(path, kind, extra)


def find_format(path: Path) -> str:
    """Say which reader a file needs: a key of :data:`FORMATS`.

    Raises
    ------
    ReadError
        When there is no such file, it is empty, or nothing here reads it.
    """
    # (1) Something to read.
    if not path.exists():
        raise ReadError(path, "there is no such file", "check the name")
    if not path.is_file():
        raise ReadError(path, "this is a folder, expected one file", "name the survey in it")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise ReadError(path, f"the file cannot be opened ({error})", "check its rights") from error
    if not head:
        raise ReadError(path, "the file is empty (0 bytes)", "copy or export it again")
    # (2) By content: first bytes of the formats, and of files that people give by mistake.
    for name, starts in _MAGIC.items():
        if head.startswith(starts):
            return name
    for start, what, advice in _FOREIGN:
        if head.startswith(start):
            raise ReadError(path, f"this is {what}, no survey", advice)
    if path.suffix.lower() in FORMATS["ptx"] or _PTX.match(head):
        return "ptx"
    if _PCD.search(head[:512]):
        return "pcd"
    # (3) By name, only for text, which has no first bytes of its own.
    suffix = path.suffix.lower()
    if suffix in FORMATS["xyz"]:
        return "xyz"
    for name, suffixes in FORMATS.items():
        if suffix in suffixes:
            raise ReadError(
                path,
                f"the file starts with {head[:8]!r}, expected {_MAGIC[name][0]!r} of a {suffix} "
                "file",
                "it is damaged or has the wrong name: export it again",
                "byte 0",
            )
    readable = ", ".join(ending for endings in FORMATS.values() for ending in endings)
    raise ReadError(
        path,
        f"{suffix or 'a name without ending'} is no known kind of survey (the file starts with "
        f"{head[:8]!r})",
        f"terraport reads {readable}",
    )


def is_foreign(path: Path) -> bool:
    """Return whether a file's first bytes are those of an unsupported format given by mistake."""
    with path.open("rb") as file:
        head = file.read(64)
    return any(head.startswith(start) for start, _, _ in _FOREIGN)


def is_binary_survey(path: Path) -> bool:
    """Whether a file's first bytes are those of a survey; a text is none by its bytes."""
    try:
        return find_format(path) != "xyz"
    except ReadError:
        return False
