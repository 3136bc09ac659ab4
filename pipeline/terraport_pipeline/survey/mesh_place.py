"""What the files beside a mesh say of where on Earth it is: the shift to add, and the CRS.

Meshes hold small coordinates, because most programs keep them in 32 bits. Each program states what
is to be added in a way of its own:

=====================  ==========================================================================
terraport export       a comment in the file, or ``NAME.offset.xyz``; of a GLB ``extras``
Pix4D, PIX4Dmatic      ``*_offset.xyz``: ``E N H`` beside the mesh, or in ``1_initial/params``; the
                       CRS in ``*_wkt.prj``
OpenDroneMap           ``odm_georeferencing/coords.txt``: the second line is ``E N``, the first the
                       UTM zone; ``odm_georeferencing_model_geo.txt`` in older projects
RealityCapture         ``NAME.obj.rcInfo`` (``.rsInfo`` since RealityScan 2.0): the CRS, and a
                       matrix ``transformToModel``
Metashape              the shift that was typed on export stands nowhere in an OBJ; of a tiled
                       model in ``metadata.xml``: ``SRS`` and ``SRSOrigin``
any                    ``offset.xyz``, ``offset.txt``, ``OFFSET.txt``: three numbers
=====================  ==========================================================================

A matrix that turns or scales is refused, not guessed at: programs differ in how they mean one.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_pipeline.engines.camera_files.colmap import stated_offset
from terraport_pipeline.engines.camera_files.stated_frames import odm_offset
from terraport_pipeline.engines.camera_files.text_files import parse_numbers, read_small_text
from terraport_pipeline.engines.camera_files.xml_files import parse_xml, xml_numbers
from terraport_pipeline.errors import ReadError
from terraport_pipeline.survey.survey_files import prj_beside

__all__ = ["MeshPlace", "mesh_place"]

_HEAD_BYTES: Final = 4096
_COMMENT: Final = re.compile(
    rb"(?:global shift|offset|shift)[^:\n]*:?[ \t]*"
    rb"\(?(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)[ \t,;]+(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)[ \t,;]+"
    rb"(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)",
    re.IGNORECASE,
)
_SYSTEM: Final = re.compile(rb"coordinate reference system: (.+), unit ")
_UTM: Final = re.compile(r"WGS84 UTM ([0-9]{1,2})([NS])", re.IGNORECASE)
_INFO_ENDINGS: Final = (".rcinfo", ".rsinfo")
_GLB_MAGIC: Final = b"glTF"
_MAX_GLB_JSON: Final = 64 << 20

Shift = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshPlace:
    """What the files say of a mesh's coordinates."""

    shift: Shift | None = None
    """To add to easting, northing and height of the file, in its own unit; None where nothing says
    so."""
    shift_from: str = ""
    """Name of the file that states it."""
    crs: Any | None = None
    """pyproj.CRS of the shifted coordinates; None where nothing states it."""
    crs_from: str = ""
    files: tuple[Path, ...] = ()
    """Those that were read."""


def mesh_place(path: Path) -> MeshPlace:
    """Look beside a mesh, and in its first lines, for the shift and the CRS.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ReadError
        A file that states a shift cannot be read, or states a turn.
    """
    found: dict[str, Any] = {}
    files: list[Path] = []
    for shift, crs, source in _statements(path):
        if shift is not None and "shift" not in found:
            found |= {"shift": shift, "shift_from": source.name}
            files.append(source)
        if crs is not None and "crs" not in found:
            found |= {"crs": crs, "crs_from": source.name}
            files.append(source)
    beside = tuple(file for file in dict.fromkeys(files) if file != path)
    return MeshPlace(**found, files=beside)


def _statements(path: Path) -> Iterator[tuple[Shift | None, Any | None, Path]]:
    """Everything that is stated, the surest first."""
    # (1) In the file, and beside it under its own name.
    if path.suffix.lower() == ".glb":
        yield *_glb_extras(path), path
    with path.open("rb") as file:
        comments = [
            line for line in file.read(_HEAD_BYTES).splitlines() if line.startswith((b"#", b"comm"))
        ]
    for line in comments:
        match, system = _COMMENT.search(line), _SYSTEM.search(line)
        if match is not None:
            yield _numbers(path, " ".join(word.decode() for word in match.groups())), None, path
        if system is not None:
            yield None, _crs(system[1].decode("utf-8", "replace")), path
    own = [f"{path.name}.offset.xyz", f"{path.stem}_offset.xyz", f"{path.stem}.offset.xyz"]
    for name in own:
        if (path.parent / name).is_file():
            yield _numbers(path.parent / name), None, path.parent / name
    for info in sorted(path.parent.iterdir()):
        if info.name.lower() in {f"{path.name}{end}".lower() for end in _INFO_ENDINGS}:
            yield *_reality_capture(info), info
    if prj_beside(path):
        yield None, _crs(prj_beside(path)), path.with_suffix(".prj")
    # (2) Of the project that it belongs to.
    yield from _pix4d(path)
    yield from _tiled_model(path)
    stated = stated_offset(path.parent)
    if stated is not None:
        folder = path.parent if (path.parent / stated.source).is_file() else path.parent.parent
        yield stated.offset, None, folder / stated.source
    for frame in odm_offset(path):
        coords = _find_up(path, frame.source)
        zone = None if coords is None else _UTM.search(read_small_text(coords))
        crs = None if zone is None else _crs(f"EPSG:{_utm_code(zone)}")
        yield frame.offset, crs, coords or path


def _glb_extras(path: Path) -> tuple[Shift | None, Any | None]:
    """Read what terraport export writes: scene and asset say what to add."""
    try:
        with path.open("rb") as file:
            magic, _, _, length, _ = struct.unpack("<4sIIII", file.read(20))
            if magic != _GLB_MAGIC or length > _MAX_GLB_JSON:
                return None, None
            document = json.loads(file.read(length))
        extras = document["asset"]["extras"]
        shift = tuple(float(value) for value in extras["global_shift"])
        crs = extras.get("crs")
    except (OSError, ValueError, KeyError, TypeError, struct.error):
        return None, None
    if len(shift) != 3 or not np.isfinite(shift).all():
        return None, None
    return shift, _crs(crs) if isinstance(crs, str) else None


def _reality_capture(path: Path) -> tuple[Shift | None, Any | None]:
    """Read the info file of RealityCapture: its CRS by name, its matrix where that only shifts."""
    # Several elements stand in it without a root.
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    model = re.search(r"<Model\b[^>]*>", text)
    if model is None:
        return None, None
    named = re.search(r'globalCoordinateSystemName="\s*(epsg:[0-9]+)', text, re.IGNORECASE)
    crs = None if named is None else _crs(named[1])
    found = re.search(r'transformToModel(?:>|=")([^<"]*)', text)
    if found is None:
        return None, crs
    matrix = xml_numbers(path, found[1], 16, "transformToModel").reshape(4, 4)
    if not np.allclose(matrix[:3, :3], np.eye(3), atol=1e-9):
        raise ReadError(
            path,
            "transformToModel turns or scales the mesh, expected a shift at most",
            "export it with the coordinate system 'Project output', or say what to add with "
            "--shift EASTING NORTHING HEIGHT (0 0 0 for nothing)",
        )
    shift = matrix[:3, 3]
    return (float(shift[0]), float(shift[1]), float(shift[2])), crs


def _pix4d(path: Path) -> Iterator[tuple[Shift | None, Any | None, Path]]:
    """Offset and CRS of a Pix4D project, beside the mesh or where the project keeps them."""
    folders = [path.parent]
    folders += [up / "1_initial" / "params" for up in path.absolute().parents[:4]]
    for folder in folders:
        offsets = sorted(folder.glob("*_offset.xyz")) if folder.is_dir() else []
        if len(offsets) == 1:
            yield _numbers(offsets[0]), None, offsets[0]
        systems = sorted(folder.glob("*_wkt.prj")) if folder.is_dir() else []
        if len(systems) == 1:
            yield None, _crs(read_small_text(systems[0])), systems[0]


def _tiled_model(path: Path) -> Iterator[tuple[Shift | None, Any | None, Path]]:
    """``metadata.xml`` of Metashape and ContextCapture: ``SRS`` and ``SRSOrigin``."""
    for folder in path.absolute().parents[:3]:
        file = folder / "metadata.xml"
        if not file.is_file():
            continue
        root = parse_xml(file, "give the one beside the model")
        origin, system = root.findtext("SRSOrigin"), root.findtext("SRS")
        if origin:
            yield (
                _numbers(file, origin.replace(",", " ")), None if not system else _crs(system), file
            )  # fmt: skip
            return


def _numbers(path: Path, text: str | None = None) -> Shift:
    words = (read_small_text(path) if text is None else text).replace(",", " ").split()
    east, north, height = parse_numbers(path, 1, words[:3], 3, "an offset")
    return east, north, height


def _find_up(path: Path, name: str) -> Path | None:
    for folder in path.absolute().parents[:3]:
        for file in (folder / name, folder / "odm_georeferencing" / name):
            if file.is_file():
                return file
    return None


def _utm_code(zone: re.Match[str]) -> int:
    return (32600 if zone[2].upper() == "N" else 32700) + int(zone[1])


def _crs(text: str) -> Any | None:
    try:
        return CRS.from_user_input(text)
    except CRSError:
        return None
