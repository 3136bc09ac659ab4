"""Textured meshes of other programs: OBJ with MTL, as Pix4D, OpenDroneMap and Metashape write them.

An OBJ gives every corner its own texture coordinate; engines and glTF want one a vertex, so
vertices are split at the seams (:func:`terraport_pipeline.geometry.mesh.uv.split_wedges`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.mesh.uv import split_wedges

__all__ = ["MAX_OBJ_BYTES", "ObjPiece", "read_obj"]

MAX_OBJ_BYTES: Final = 4 << 30
"""Largest OBJ: about 40 M faces. It is read whole, at about six times its size."""

_ADVICE: Final = "export it again as an OBJ of triangles"
_CHANNELS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class ObjPiece:
    """The faces of one material, in the OBJ's own coordinates."""

    material: str
    """Empty where the file names none."""
    image: Path | None
    """``map_Kd`` of the material, where that file is there."""
    vertices: Float64
    """(V, 3) metres; large coordinates stay exact."""
    faces: Int32
    """(F, 3)"""
    uvs: Float32 | None
    """(V, 2) from the image's upper left (OBJ counts v from below); None without."""
    place: Int32
    """(F,) place of every triangle among all of the file, from 0."""
    colours: UInt8 | None
    """(V, 3) sRGB, of ``v`` lines with six numbers (0..1, as MeshLab writes them); None without."""


def read_obj(path: Path) -> tuple[ObjPiece, ...]:
    """Read a textured mesh.

    Parameters
    ----------
    path : Path
        Triangles; other polygons are cut into fans.

    Returns
    -------
    tuple of ObjPiece
        One for each material that has faces, in the order of their first face.

    Raises
    ------
    ReadError
        The file is too large, has no face, or a face names what is not there.
    """
    size = path.stat().st_size if path.is_file() else -1
    if size < 0:
        raise ReadError(path, "there is no such file", _ADVICE)
    if size > MAX_OBJ_BYTES:
        raise ReadError(path, f"{size} bytes, more than {MAX_OBJ_BYTES}", "cut it into tiles")
    # (1) Tables of the whole file; lines that end in a backslash go on.
    lines = path.read_bytes().replace(b"\\\n", b" ").splitlines()
    points = _table(path, [line[2:] for line in lines if line.startswith(b"v ")], 3, "v")
    positions = points[:, :3]
    colours = _colours(points[:, 3:])
    texture = [line[3:] for line in lines if line.startswith(b"vt ")]
    wedge_table = _table(path, texture, 2, "vt")[:, :2] if texture else np.zeros((0, 2))
    images = _images(path, lines)
    pieces = []
    # (2) One piece per material. OBJ counts v from the bottom, images from the top.
    for material, rows in _by_material(lines).items():
        corners, place = _corners(path, rows, len(positions), len(wedge_table))
        vertex, wedge = corners[:, :, 0], corners[:, :, 1]
        textured = bool((wedge >= 0).all())
        uvs = wedge_table[wedge] if textured else np.zeros((len(corners), 3, 2))
        uvs[:, :, 1] = 1.0 - uvs[:, :, 1]
        used, local = np.unique(vertex, return_inverse=True)
        split = split_wedges(local.reshape(-1, 3), uvs, len(used))
        pieces.append(
            ObjPiece(
                material,
                images.get(material),
                positions[used[split.vertex]],
                split.faces,
                split.uvs if textured else None,
                place,
                None if colours is None else colours[used[split.vertex]],
            )
        )
    if not pieces:
        raise ReadError(path, "no face", _ADVICE)
    return tuple(pieces)


def _table(path: Path, rows: list[bytes], columns: int, label: str) -> Float64:
    """Numbers of all lines of a kind, at least *columns* and as many on each."""
    if not rows:
        raise ReadError(path, f"no {label} line", _ADVICE)
    try:
        values = np.array(b" ".join(rows).split(), dtype=np.float64)
    except ValueError as error:
        raise ReadError(path, f"a {label} line holds no number: {error}", _ADVICE) from None
    width = len(values) // len(rows)
    if width < columns or width * len(rows) != len(values) or not np.isfinite(values).all():
        raise ReadError(
            path, f"{len(values)} finite numbers on {len(rows)} {label} lines expected", _ADVICE
        )
    return values.reshape(len(rows), width)


def _colours(further: Float64) -> UInt8 | None:
    """Colours behind the three coordinates; four numbers (a weight) hold none."""
    if further.shape[1] < _CHANNELS:
        return None
    return np.rint(np.clip(further[:, -_CHANNELS:], 0.0, 1.0) * 255.0).astype(np.uint8)


def _by_material(lines: list[bytes]) -> dict[str, list[tuple[int, bytes]]]:
    """Face lines by the material that is in force, each with its first triangle's place."""
    lines_of_material: dict[str, list[tuple[int, bytes]]] = {}
    rows = lines_of_material.setdefault("", [])
    place = 0
    for line in lines:
        if line.startswith(b"f "):
            rows.append((place, line))
            place += max(len(line.split()) - 3, 0)
        elif line.startswith(b"usemtl "):
            rows = lines_of_material.setdefault(line[7:].strip().decode("utf-8", "replace"), [])
    return {material: rows for material, rows in lines_of_material.items() if rows}


def _corners(
    path: Path, rows: list[tuple[int, bytes]], vertices: int, wedges: int
) -> tuple[Int32, Int32]:
    """Vertex and wedge (-1: none) of every triangle's corners, (F, 3, 2), from 0; their places."""
    triangles: list[list[bytes]] = []
    place: list[int] = []
    for first, row in rows:
        words = row.split()[1:]
        triangles += [[words[0], b, c] for b, c in itertools.pairwise(words[1:])]
        place += range(first, first + len(triangles) - len(place))
    pairs = [(corner + b"//").split(b"/")[:2] for triangle in triangles for corner in triangle]
    try:
        numbers = np.array([(int(v), int(t or b"0")) for v, t in pairs], dtype=np.int64)
    except ValueError as error:
        raise ReadError(path, f"a face names no number: {error}", _ADVICE) from None
    numbers = numbers.reshape(-1, 3, 2)
    # Negative numbers count from the end. Relative to the whole file: writers put faces last.
    counts = np.array([vertices, wedges])
    numbers = np.where(numbers < 0, numbers + counts, numbers - 1)
    if len(numbers) and not ((numbers >= [0, -1]) & (numbers < counts)).all():
        raise ReadError(path, f"a face beyond {vertices} vertices or {wedges} vt lines", _ADVICE)
    return numbers.astype(np.int32), np.array(place, np.int32)


def _images(path: Path, lines: list[bytes]) -> dict[str, Path]:
    """Image of every material, from the libraries beside the OBJ."""
    image_of_material: dict[str, Path] = {}
    for line in lines:
        if not line.startswith(b"mtllib "):
            continue
        library = path.parent / Path(line[7:].strip().decode("utf-8", "replace")).name
        if not library.is_file():
            continue
        material = ""
        for text in library.read_text(encoding="utf-8", errors="replace").splitlines():
            word, _, rest = text.strip().partition(" ")
            if word == "newmtl":
                material = rest.strip()
            elif word == "map_Kd" and rest.strip():
                # Only a name: a library never leads outside its folder. Options stand before it.
                image = path.parent / Path(rest.split()[-1].replace("\\", "/")).name
                if image.is_file():
                    image_of_material[material] = image
    return image_of_material
