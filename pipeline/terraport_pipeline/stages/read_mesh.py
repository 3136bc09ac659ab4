"""Read a mesh that was reconstructed elsewhere: its coordinates in metres, its texels by pixel.

Memory: what the file takes (an OBJ six times its size), 100 bytes a face, and one decoded image.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import PIL.Image

from terraport_payload.types import Bool, Float64, Int32
from terraport_pipeline.engines.mesh_files.read_mesh import FileImage, FileMesh, read_mesh
from terraport_pipeline.engines.photo_store import MAX_PIXELS
from terraport_pipeline.engines.readers.attribute_names import distinct_names
from terraport_pipeline.engines.readers.survey_crs import conversion_line, interpret_coordinates
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.model import Crs
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.survey.find_mesh import MeshInput
from terraport_store import SurveyUnits

__all__ = ["NAME", "PlacedMesh", "place_mesh", "run"]

NAME: Final = "read-mesh"

_MIXED: Final = frozenset(("s", "t", "u", "v", "texture_u", "texture_v", "texnumber", "alpha"))
"""Columns of PLY that are no attribute of the ground."""

_OUTSIDE: Final = 1e-3
"""Share of an image by which corners may lie outside it: rounding, no more."""

_MOST_ATTRIBUTES: Final = 16


def run(given: MeshInput, context: Context, *, textured: bool) -> tuple[Mapping[str, Json], Facts]:
    """Read a mesh to columns on disk.

    Parameters
    ----------
    given : MeshInput
    context : Context
        Receives ``vertices.npy`` (V, 3) float64 easting, northing, height in metres; ``faces.npy``;
        ``colours.npy`` if there are any; ``attribute-<i>.npy``; for a textured mesh
        ``pixels.npy`` (F, 3, 2) float32 corners in their image, NaN for none,
        ``image.npy`` (F,) int32, ``images.npy`` the concatenated encoded images,
        ``offsets.npy`` and ``sizes.npy`` (N, 2) width and height.
    textured : bool
        Refuse a mesh that refers to missing images.

    Returns
    -------
    values, facts
        ``attributes``, ``crs``, ``units`` as for a survey; ``textured``, ``faces``, ``vertices``.

    Raises
    ------
    ReadError
        The file cannot be used; names the line of a text file.
    """
    context.progress.start(f"read: {given.path.name}", None, "faces")
    mesh = read_mesh(given.path)
    context.progress.done({"faces": len(mesh.faces), "vertices": len(mesh.vertices)})
    if textured and mesh.missing is not None:
        raise ReadError(
            mesh.missing.path, mesh.missing.reason,
            f"{mesh.missing.advice}, or build without textures: --texture-from vertex",
            mesh.missing.location,
        )  # fmt: skip
    placed = place_mesh(given, mesh)
    if placed.is_turned:
        mesh = _turned(mesh)
    warnings = [*mesh.warnings, *placed.warnings]
    counts: dict[str, Json] = {
        "faces": len(mesh.faces), "vertices": len(mesh.vertices), **mesh.facts,
        "colours": mesh.origin_of_colours,
    }  # fmt: skip
    folder = context.folder
    np.save(folder / "vertices.npy", placed.positions)
    np.save(folder / "faces.npy", mesh.faces)
    if mesh.colours is not None:
        np.save(folder / "colours.npy", mesh.colours)
    else:
        warnings.append("The mesh has no colours: the scene will be grey.")
    names = _attributes(mesh)
    for number, name in enumerate(names):
        np.save(folder / f"attribute-{number}.npy", mesh.attributes[name].astype(np.float32))
    renamed, notes = distinct_names(names)
    warnings += notes
    is_textured = textured and mesh.texture is not None
    if is_textured:
        context.progress.start("read: textures", None, "images")
        counts |= _write_texture(given, mesh, context, warnings)
        context.progress.done({"images": counts["images"]})
    crs, units = placed.crs, placed.units
    values: dict[str, Json] = {
        "crs": {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg} if crs else None,
        **({} if units is None else {"units": units.document()}),
        "attributes": [*renamed.values()], "textured": is_textured,
        "has_colour": mesh.colours is not None,
        "faces": len(mesh.faces), "vertices": len(mesh.vertices),
    }  # fmt: skip
    return values, Facts(counts, tuple(warnings), choices=placed.choices)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMesh:
    """Coordinates of a mesh in metres, and what is to be said of them."""

    positions: Float64
    """(V, 3) easting, northing, height."""
    is_turned: bool
    """True if its axes are left-handed, so that the corners of faces have to be reversed."""
    crs: Crs | None
    units: SurveyUnits | None
    """Conversion that was applied; None if the file is in metres east, north and up."""
    warnings: tuple[str, ...]
    choices: tuple[str, ...]


def place_mesh(given: MeshInput, mesh: FileMesh) -> PlacedMesh:
    """Turn a mesh's coordinates upright, add its shift, and bring them to metres.

    Raises
    ------
    SurveyError
        It has no extent.
    ReadError
        Its coordinates contradict their CRS or unit.
    """
    positions = mesh.vertices
    if given.up == "y":  # x east, y up, z south
        positions = np.stack([positions[:, 0], -positions[:, 2], positions[:, 1]], axis=1)
    choices = []
    place = given.place
    shift = given.mesh.shift if given.mesh.shift is not None else place.shift
    if shift is not None and any(shift):
        positions = positions + np.array(shift)
        source = "--shift" if given.mesh.shift is not None else place.shift_from
        numbers = ", ".join(f"{value:,.3f}" for value in shift)
        choices.append(f"{numbers} were added to the mesh's coordinates, as {source} says.")
    used = positions[np.unique(mesh.faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    if not (high - low).max() > 0:
        raise SurveyError(f"{given.path}: all {len(used):,} vertices lie at one place")
    units, crs, warnings = interpret_coordinates(given.path, low, high, place.crs, given.survey)
    if place.crs is not None and given.survey.system is None:
        choices.append(f"The mesh is taken to be in {place.crs.name}, as {place.crs_from} says.")
    is_turned = False
    if units is not None:
        positions = units.to_metres(positions)
        choices.append(conversion_line(units, place.crs, given.survey))
        # Programs assume that x, y and z are right-handed, and order corners accordingly.
        is_turned = units.is_mirrored and _area_up(positions, mesh.faces) < 0.0
    return PlacedMesh(
        np.ascontiguousarray(positions), is_turned, crs, units, tuple(warnings), tuple(choices)
    )


def _turned(mesh: FileMesh) -> FileMesh:
    """Reverse the order of the corners of every face."""
    faces, texture = np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.texture
    if texture is not None:
        texture = replace(texture, wedges=np.ascontiguousarray(texture.wedges[:, ::-1]))
    return replace(mesh, faces=faces, texture=texture)


def _area_up(positions: Float64, faces: Int32) -> float:
    """Return the plan area of faces that point up, minus that of the others."""
    a, b, c = (positions[faces[:, corner], :2] for corner in range(3))
    first, second = b - a, c - a
    return float((first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum())


def _attributes(mesh: FileMesh) -> list[str]:
    """Names of what vertices have beside colour, in their order."""
    count = len(mesh.vertices)
    named = [
        name
        for name, values in mesh.attributes.items()
        if len(values) == count and name.lower() not in _MIXED and name.isidentifier()
    ]
    return named[:_MOST_ATTRIBUTES]


def _write_texture(
    given: MeshInput, mesh: FileMesh, context: Context, warnings: list[str]
) -> dict[str, Any]:
    """Write images as they are, and corners in their pixels."""
    texture = mesh.texture
    assert texture is not None
    # (1) The images that faces mean, each opened once.
    meant = np.unique(texture.image[texture.image >= 0])
    offsets, sizes = [0], []
    with (context.scratch / "images").open("wb") as file:
        for number in meant:
            data, size = _image(given, texture.images[number])
            file.write(data)
            offsets.append(offsets[-1] + len(data))
            sizes.append(size)
    renumbered = np.full(len(texture.images) + 1, -1, np.int32)
    renumbered[meant] = np.arange(len(meant))
    image = renumbered[texture.image]
    # (2) Corners: whole repeats taken off, then in pixels.
    wedges = _unrepeated(given, mesh, texture.wedges.astype(np.float64), image)
    side = np.array([*sizes, (0, 0)], np.float64)
    pixels = (wedges * side[image][:, None, :]).astype(np.float32)
    pixels[image < 0] = np.nan
    without = int((image < 0).sum())
    if without:
        first = int(np.flatnonzero(image < 0)[0])
        where = "" if mesh.line is None else f", the first at line {mesh.line[first]:,}"
        warnings.append(
            f"{without:,} of {len(image):,} faces have no texture{where}: they get the colour of "
            "their material or vertices."
        )
    folder = context.folder
    np.save(folder / "pixels.npy", pixels)
    np.save(folder / "image.npy", image)
    np.save(folder / "images.npy", np.fromfile(context.scratch / "images", np.uint8))
    np.save(folder / "offsets.npy", np.array(offsets, np.int64))
    np.save(folder / "sizes.npy", np.array(sizes, np.int32))
    return {"images": len(meant), "faces_without_texture": without}


def _image(given: MeshInput, image: FileImage) -> tuple[bytes, tuple[int, int]]:
    try:
        data = image.data()
        with PIL.Image.open(io.BytesIO(data)) as opened:
            width, height = opened.size
    except (OSError, SyntaxError, ValueError, PIL.Image.DecompressionBombError) as error:
        raise ReadError(
            given.path, f"its texture {image.name} cannot be read: {error}", "export both again"
        ) from error
    if width * height > MAX_PIXELS:
        raise ReadError(
            given.path,
            f"its texture {image.name} has {width} x {height} pixels, expected at most "
            f"{MAX_PIXELS:,}",
            "export it in several",
        )
    return data, (width, height)


def _unrepeated(given: MeshInput, mesh: FileMesh, wedges: Float64, image: Int32) -> Float64:
    """Corners within 0..1: images repeat beyond; a face over the edge of one is refused."""
    moved = wedges - np.floor(wedges.mean(axis=1, keepdims=True))
    placed: Float64 = np.where(_is_within(wedges)[:, None, None], wedges, moved)
    bad = np.flatnonzero(~_is_within(placed) & (image >= 0))
    if len(bad):
        where = f"face {bad[0]:,}" if mesh.line is None else f"line {mesh.line[bad[0]]:,}"
        low, high = wedges[bad[0]].min(), wedges[bad[0]].max()
        raise ReadError(
            given.path,
            f"{len(bad):,} faces repeat their image (texture coordinates {low:.3g} to {high:.3g}), "
            "expected each within 0 and 1",
            "bake the texture into an atlas in the program that made it",
            where,
        )
    return np.clip(placed, 0.0, 1.0)


def _is_within(wedges: Float64) -> Bool:
    """Mark the faces all of whose corners lie within their image, (F,)."""
    flat = wedges.reshape(len(wedges), -1)
    within: Bool = np.all((flat >= -_OUTSIDE) & (flat <= 1.0 + _OUTSIDE), axis=1)
    return within
