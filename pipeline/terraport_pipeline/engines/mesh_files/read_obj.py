"""Textured meshes of other programs: OBJ with MTL, as Pix4D, OpenDroneMap and Metashape write them.

An OBJ stores a texture coordinate for every corner (a wedge), so a vertex on a seam is in the file
once, and the faces on both sides of a seam share it. They also do so here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.engines.mesh_files.obj_materials import (
    ObjMaterial,
    decode_text,
    read_materials,
)
from terraport_pipeline.errors import ReadError

__all__ = ["MAX_OBJ_BYTES", "ObjMesh", "read_obj"]

MAX_OBJ_BYTES: Final = 4 << 30
"""Largest OBJ: about 40 M faces. It is read whole, at about six times its size."""

_ADVICE: Final = "export it again as an OBJ of triangles"
_CHANNELS: Final = 3
_LEAST_OF_BYTES: Final = 2.0
_BYTE: Final = 255.0
_GREY: Final = 128
_LOOKED_AT: Final = 1000
"""Vertices whose spelling is checked for lost digits."""
_SHORT: Final = re.compile(rb"(?<![0-9.])[0-9](?:\.[0-9]{1,5})?e\+0?([678])\b", re.IGNORECASE)
"""A number of a million or more that is written with at most six digits."""
_MIXED_SHOWN: Final = 40
"""Characters of a bad line that are shown."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjMesh:
    """An OBJ as it stands in its file; F triangles."""

    vertices: Float64
    """(V, 3) in the file's coordinates; large ones stay exact."""
    faces: Int32
    """(F, 3) in the file's order; polygons are cut into fans."""
    wedges: Float32 | None
    """(F, 3, 2) from the image's upper left (OBJ counts v from below), NaN where a face has none;
    None where no face has."""
    material: Int32
    """(F,) row of `materials`."""
    materials: tuple[ObjMaterial, ...]
    """Those that faces name, in the order of their first face."""
    colours: UInt8 | None
    """(V, 3) sRGB from ``v`` lines with six numbers (0..1, as MeshLab writes them, or 0..255); grey
    for lines without a colour if others have one, None if no line has one."""
    uncoloured: int
    """Number of vertices without a colour if others have one."""
    line: Int64
    """(F,) line of the file, from 1."""
    polygons: int
    """Faces with more than three corners."""
    objects: int
    """``o`` lines; one body at least."""
    warnings: tuple[str, ...]
    """Precision that its numbers lost when they were written, as whole sentences."""


@dataclass(slots=True)
class _Lines:
    """The lines of a file by what they say, with their numbers from 1."""

    points: list[bytes] = field(default_factory=list)
    point_lines: list[int] = field(default_factory=list)
    wedges: list[bytes] = field(default_factory=list)
    wedge_lines: list[int] = field(default_factory=list)
    faces: list[bytes] = field(default_factory=list)
    face_lines: list[int] = field(default_factory=list)
    face_materials: list[int] = field(default_factory=list)
    materials: dict[str, int] = field(default_factory=dict)
    libraries: list[tuple[int, str]] = field(default_factory=list)
    relative: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Vertices and wedges so far, of face lines with negative numbers, which count back from
    there."""
    objects: int = 0


def read_obj(path: Path) -> ObjMesh:
    """Read a textured mesh.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ObjMesh

    Raises
    ------
    ReadError
        The file is too large, has no face, a number that is none, or a face names what is not
        there. Libraries and images that are missing stand in the materials.
    """
    size = path.stat().st_size if path.is_file() else -1
    if size < 0:
        raise ReadError(path, "there is no such file", _ADVICE)
    if size > MAX_OBJ_BYTES:
        raise ReadError(path, f"{size} bytes, more than {MAX_OBJ_BYTES}", "cut it into tiles")
    # (1) Lines by kind, then their numbers.
    lines = _sorted_lines(path.read_bytes())
    if not lines.points:
        raise ReadError(path, "no v line", _ADVICE)
    points = _table(path, lines.points, lines.point_lines, 3, "v")
    wedge_table = np.zeros((0, 2))
    if lines.wedges:
        wedge_table = _table(path, lines.wedges, lines.wedge_lines, 2, "vt")[:, :2]
    colours, uncoloured = _colours(path, points[:, 3:])
    if not lines.faces:
        raise ReadError(path, "no face", _ADVICE)
    # (2) Corners of triangles. OBJ counts v from the bottom, images from the top.
    corners, row = _corners(path, lines, len(points), len(wedge_table))
    wedges = None
    if (corners[:, :, 1] >= 0).any():
        beyond = np.concatenate([wedge_table, np.full((1, 2), np.nan)])  # row -1: none
        wedges = beyond[corners[:, :, 1]].astype(np.float32)
        wedges[:, :, 1] = np.float32(1.0) - wedges[:, :, 1]
        wedges[np.isnan(wedges).any(axis=(1, 2))] = np.nan
    # (3) Materials by the faces that name them.
    named = read_materials(path, lines.libraries)
    unknown = named.get("")
    in_any_case = {name.casefold(): material for name, material in named.items()}
    materials = tuple(
        named.get(name)
        or in_any_case.get(name.casefold())
        or ObjMaterial(name, missing=None if unknown is None else unknown.missing)
        for name in lines.materials
    )
    return ObjMesh(
        points[:, :3],
        np.ascontiguousarray(corners[:, :, 0]),
        wedges,
        np.array(lines.face_materials, np.int32)[row],
        materials,
        colours,
        uncoloured,
        np.array(lines.face_lines, np.int64)[row],
        sum(len(text.split()) > _CHANNELS for text in lines.faces),
        max(lines.objects, 1),
        tuple(_short_numbers(path, lines.points)),
    )


def _short_numbers(path: Path, points: list[bytes]) -> Iterator[str]:
    """Warn about large coordinates with six digits, as C++ streams write them by default."""
    some = points[:: max(1, len(points) // _LOOKED_AT)]
    found = next(filter(None, map(_SHORT.search, some)), None)
    if found is not None:
        step = 10.0 ** (int(found[1]) - 5)
        yield (
            f"{path.name} has coordinates in six digits ({found[0].decode()}): they move in steps "
            f"of {step:g} m, and detail below that is lost. Export the mesh with a local offset."
        )


def _sorted_lines(data: bytes) -> _Lines:
    lines = _Lines()
    material = -1
    rows = data.splitlines()
    del data
    for number, text in enumerate(rows, 1):
        if text.endswith(b"\\") and number < len(rows):  # it goes on in the next
            rows[number] = text[:-1] + b" " + rows[number]
            continue
        word, _, rest = text.replace(b"\t", b" ").lstrip().partition(b" ")
        if word == b"v":
            lines.points.append(rest)
            lines.point_lines.append(number)
        elif word == b"vt":
            lines.wedges.append(rest)
            lines.wedge_lines.append(number)
        elif word == b"f":
            if material < 0:
                material = lines.materials.setdefault("", len(lines.materials))
            if b"-" in rest:
                lines.relative[len(lines.faces)] = len(lines.points), len(lines.wedges)
            lines.faces.append(rest)
            lines.face_lines.append(number)
            lines.face_materials.append(material)
        elif word == b"usemtl":
            name = decode_text(rest.strip())
            material = lines.materials.setdefault(name, len(lines.materials))
        elif word == b"mtllib":
            lines.libraries.append((number, decode_text(rest.strip())))
        elif word == b"o":
            lines.objects += 1
    return lines


def _table(
    path: Path, rows: list[bytes], numbers: Sequence[int], columns: int, label: str
) -> Float64:
    """Return the numbers of all lines of a kind, at least *columns* per line, padded with NaN."""
    width = len(rows[0].split())
    try:
        values = np.array(b" ".join(rows).split(), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if width >= columns and len(values) == width * len(rows) and np.isfinite(values).all():
        return values.reshape(len(rows), width)
    # Line by line, since a line is bad or lines have different numbers of columns.
    words = [_finite(row) for row in rows]
    bad = next((at for at, found in enumerate(words) if len(found) < columns), None)
    if bad is not None:
        shown = rows[bad][:_MIXED_SHOWN].decode("utf-8", "replace").strip()
        raise ReadError(
            path, f"{label} {shown!r}, expected {columns} finite numbers", _ADVICE,
            f"line {numbers[bad]:,}",
        )  # fmt: skip
    ragged = np.full((len(rows), max(map(len, words))), np.nan)
    for at, found in enumerate(words):
        ragged[at, : len(found)] = found
    return ragged


def _finite(row: bytes) -> list[float]:
    """Return the numbers of a line, or nothing if one of them is not finite."""
    try:
        values = [float(word) for word in row.split()]
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _colours(path: Path, further: Float64) -> tuple[UInt8 | None, int]:
    """Read the colours after the three coordinates, and count the lines that lack one.

    Lines with four numbers have a weight and no colour.
    """
    if further.shape[1] < _CHANNELS:
        return None, 0
    colours = further[:, :_CHANNELS]
    if further.shape[1] > _CHANNELS:
        # x y z w r g b, or x y z r g b a: weights are 1, and opaque alphas 1 or 255.
        full = further[~np.isnan(further[:, _CHANNELS])]
        is_weight = bool((full[:, 0] == 1.0).all())
        is_alpha = any((full[:, _CHANNELS] == one).all() for one in (1.0, _BYTE))
        if further.shape[1] > _CHANNELS + 1 or is_weight == is_alpha:
            raise ReadError(
                path, f"v lines with {3 + further.shape[1]} numbers, expected x y z r g b", _ADVICE
            )
        colours = further[:, 1:] if is_weight else colours
    # A line with only some of the three numbers has a weight and no colour.
    none = np.isnan(colours).any(axis=1)
    known = colours[~none]
    if known.max() > _BYTE:
        raise ReadError(path, f"a colour of {known.max():g}, expected 0 to 1 or 0 to 255", _ADVICE)
    # Most programs write shares, some of them a little more than 1; others write 8 bits.
    scale = _BYTE if known.max() < _LEAST_OF_BYTES else 1.0
    read = np.full(colours.shape, _GREY, np.uint8)
    read[~none] = np.rint(np.clip(known * scale, 0.0, _BYTE))
    return read, int(none.sum())


def _corners(path: Path, lines: _Lines, vertices: int, wedges: int) -> tuple[Int32, Int64]:
    """Vertex and wedge (-1: none) of every triangle's corners, (F, 3, 2), from 0; their lines."""
    numbers = _even_corners(lines.faces)
    row = np.arange(len(lines.faces), dtype=np.int64)
    if numbers is None:
        numbers, row = _uneven_corners(path, lines)
    # Negative numbers count back from where they stand; 0 is none.
    for at, so_far in lines.relative.items():
        first, last = np.searchsorted(row, (at, at + 1))
        some = numbers[first:last]
        numbers[first:last] = np.where(some < 0, some + np.array(so_far) + 1, some)
    numbers -= 1
    counts = np.array([vertices, wedges])
    good = ((numbers >= [0, -1]) & (numbers < counts)).all(axis=(1, 2))
    if not good.all():
        bad = int(np.flatnonzero(~good)[0])
        raise ReadError(
            path, f"a face beyond {vertices} vertices or {wedges} vt lines", _ADVICE,
            f"line {lines.face_lines[int(row[bad])]:,}",
        )  # fmt: skip
    # A face with wedges at some corners alone has none.
    numbers[(numbers[:, :, 1] < 0).any(axis=1), :, 1] = -1
    return numbers.astype(np.int32), row


def _even_corners(rows: list[bytes]) -> Int64 | None:
    """Corners where every line is a triangle in one form; None elsewhere: ten times as fast."""
    text = b" ".join(rows).replace(b"//", b"/0/")
    slashes = text.count(b"/")
    each = slashes // (3 * len(rows))
    if slashes != 3 * each * len(rows) or any(len(row.split()) != 3 for row in rows):
        return None
    if any(word.count(b"/") != each for row in rows for word in row.replace(b"//", b"/0/").split()):
        return None
    try:
        values = np.array(text.replace(b"/", b" ").split(), dtype=np.int64)
    except ValueError:
        return None
    if len(values) != 3 * (each + 1) * len(rows):
        return None
    numbers = np.zeros((len(rows), 3, 2), np.int64)
    numbers[:, :, : min(each + 1, 2)] = values.reshape(len(rows), 3, each + 1)[:, :, :2]
    return numbers


def _uneven_corners(path: Path, lines: _Lines) -> tuple[Int64, Int64]:
    """Corners of polygons and of lines in several forms, cut into fans."""
    triangles: list[tuple[int, int]] = []
    row: list[int] = []
    for at, text in enumerate(lines.faces):
        try:
            corners = []
            for word in text.split():
                vertex, wedge = (word + b"//").split(b"/")[:2]
                corners.append((int(vertex), int(wedge or b"0")))
        except ValueError as error:
            raise ReadError(
                path, f"a face names no number: {error}", _ADVICE, f"line {lines.face_lines[at]:,}"
            ) from None
        if len(corners) < 3:
            raise ReadError(
                path, f"a face with {len(corners)} corners, expected 3 or more", _ADVICE,
                f"line {lines.face_lines[at]:,}",
            )  # fmt: skip
        for k in range(1, len(corners) - 1):
            triangles += [corners[0], corners[k], corners[k + 1]]
            row.append(at)
    return np.array(triangles, np.int64).reshape(-1, 3, 2), np.array(row, np.int64)
