"""Triangle meshes of other programs as plain arrays: OFF, PLY, OBJ, STL, GLB.

Triangles keep their order in the file, so that a table with a row a triangle belongs to it. OBJ is
read here (:mod:`.read_obj`), the rest by trimesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh

from terraport_payload.colour import linear16_to_srgb
from terraport_payload.types import AnyArray, Float64, Int32, UInt8
from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.engines.mesh_files.read_obj import read_obj
from terraport_pipeline.errors import EngineError, ReadError
from terraport_pipeline.geometry.mesh.face_blocks import same_places

__all__ = ["MAX_MESH_BYTES", "MESH_ENDINGS", "FileMesh", "read_mesh"]

MESH_ENDINGS: Final = (".off", ".ply", ".obj", ".stl", ".glb")

MAX_MESH_BYTES: Final = 4 << 30
"""Largest file: about 100 M triangles as binary PLY. It is read whole."""

_TABLE: Final = 2
_POSITIONS: Final = frozenset(("x", "y", "z", "nx", "ny", "nz"))
_COLOURS: Final = frozenset(("red", "green", "blue", "alpha"))


@dataclass(frozen=True, slots=True, eq=False)
class FileMesh:
    """A mesh as its file has it, vertices at one place made one."""

    vertices: Float64
    """(V, 3) in the file's coordinates."""
    faces: Int32
    """(F, 3) in the file's order; some may have corners at one place."""
    colours: UInt8 | None = None
    """(V, 3) sRGB: of the vertices, or read from the texture at each. None where there is none."""
    attributes: dict[str, Float64] = field(default_factory=dict)
    """By name: (V,) of vertices or (F,) of faces."""
    origin_of_colours: str = "none"
    """``vertices``, ``faces``, ``texture`` or ``none``."""


def read_mesh(path: Path) -> FileMesh:
    """Read a mesh.

    Parameters
    ----------
    path : Path
        Its ending is its format. Polygons are cut into triangles.

    Returns
    -------
    FileMesh

    Raises
    ------
    ReadError
        Not there, of no known format, damaged, without triangles, or with coordinates that are not
        finite.
    """
    kind = path.suffix.lower()
    if kind not in MESH_ENDINGS:
        raise ReadError(
            path,
            f"its ending is {path.suffix or 'missing'}, expected {', '.join(MESH_ENDINGS)}",
            "export the mesh in one of these; terraport build reads point clouds",
        )
    if not path.is_file():
        raise ReadError(path, "there is no such file", "check the path")
    size = path.stat().st_size
    if size > MAX_MESH_BYTES:
        raise ReadError(path, f"{size} bytes, more than {MAX_MESH_BYTES}", "cut it into tiles")
    parts = _parts_of_obj(path) if kind == ".obj" else _parts_by_trimesh(path)
    mesh = _joined(path, parts)
    if len(mesh.faces) == 0:
        raise ReadError(
            path,
            f"{len(mesh.vertices)} vertices and no triangle",
            "terraport build makes a mesh of points",
        )
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        raise ReadError(
            path, f"vertex {bad} is at {mesh.vertices[bad]}, expected numbers", "export it again"
        )
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ReadError(
            path,
            f"a triangle names vertex {mesh.faces.max()} of {len(mesh.vertices)}",
            "export it again",
        )
    return _welded(mesh)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One material or node of a file."""

    vertices: Float64
    faces: Int32
    colours: UInt8 | None
    origin_of_colours: str
    attributes: dict[str, Float64]
    place: Int32 | None = None
    """Of its triangles in the file; None: behind those of the part before."""


def _parts_of_obj(path: Path) -> list[_Part]:
    images: dict[Path, UInt8] = {}
    parts = []
    for piece in read_obj(path):
        colours, origin = piece.colours, "none" if piece.colours is None else "vertices"
        if piece.uvs is not None and piece.image is not None:
            if piece.image not in images:
                images[piece.image] = _image(path, piece.image)
            colours, origin = _looked_up(images[piece.image], piece.uvs), "texture"
        parts.append(_Part(piece.vertices, piece.faces, colours, origin, {}, piece.place))
    return parts


def _image(path: Path, image: Path) -> UInt8:
    try:
        return decode_image(image.read_bytes())
    except (EngineError, OSError) as error:
        raise ReadError(
            path, f"its texture {image.name} cannot be read: {error}", "export both again"
        ) from error


def _looked_up(image: UInt8, uvs: AnyArray) -> UInt8:
    """Colour of the texel at every coordinate, from the upper left; images repeat beyond 0..1."""
    height, width = image.shape[:2]
    share = np.nan_to_num(uvs.astype(np.float64))
    # 1 is the far edge, not the near one again.
    share = np.where((share >= 0.0) & (share <= 1.0), share, share % 1.0)
    column = np.minimum((share[:, 0] * width).astype(np.int64), width - 1)
    row = np.minimum((share[:, 1] * height).astype(np.int64), height - 1)
    colours: UInt8 = image[row, column, :3]
    return colours


def _parts_by_trimesh(path: Path) -> list[_Part]:
    try:
        scene = trimesh.load_scene(path, process=False)
        parts = []
        # Nodes in the order of the file: a mesh may stand in several places.
        for name in scene.graph.nodes_geometry:
            transform, key = scene.graph[name]
            if isinstance(scene.geometry[key], trimesh.Trimesh):
                parts.append(_part_of_trimesh(scene.geometry[key], np.asarray(transform)))
    except Exception as error:  # whatever a damaged file makes its many readers raise
        raise ReadError(
            path, f"it cannot be read ({type(error).__name__}: {error})", "export it again"
        ) from error
    return parts


def _part_of_trimesh(mesh: Any, transform: Float64) -> _Part:
    vertices = np.asarray(mesh.vertices, np.float64)
    if not np.array_equal(transform, np.eye(4)):
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3).astype(np.int32)
    colours, origin = _colours_of_trimesh(mesh, faces)
    return _Part(vertices, faces, colours, origin, _attributes(mesh, len(vertices), len(faces)))


def _colours_of_trimesh(mesh: Any, faces: Int32) -> tuple[UInt8 | None, str]:
    visual = mesh.visual
    if visual.kind == "vertex":
        return np.asarray(visual.vertex_colors, np.uint8)[:, :3], "vertices"
    if visual.kind == "face":
        return _of_vertices(np.asarray(visual.face_colors)[:, :3], faces, len(mesh.vertices)), (
            "faces"
        )
    material = getattr(visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uvs = getattr(visual, "uv", None)
    if visual.kind != "texture" or image is None or uvs is None:
        # A GLB has its colours beside the material. glTF asks for linear light; writers of 8 bits
        # put sRGB there all the same, as 8 bits of linear light band.
        codes = np.asarray(getattr(visual, "vertex_attributes", {}).get("color", ()))
        if codes.shape[:1] != (len(mesh.vertices),) or codes.ndim != _TABLE:
            return None, "none"
        if codes.dtype.kind == "f":
            codes = np.rint(np.clip(codes, 0.0, 1.0) * 65535.0).astype(np.uint16)
        codes = np.ascontiguousarray(codes[:, :3])
        return linear16_to_srgb(codes) if codes.dtype == np.uint16 else codes.astype(np.uint8), (
            "vertices"
        )
    # trimesh counts v from below.
    return _looked_up(np.asarray(image.convert("RGB")), np.asarray(uvs) * [1, -1] + [0, 1]), (
        "texture"
    )


def _of_vertices(values: AnyArray, faces: Int32, n_vertices: int) -> UInt8:
    """Mean over the faces of every vertex."""
    count = np.maximum(np.bincount(faces.ravel(), minlength=n_vertices), 1)
    channels = [
        np.bincount(faces.ravel(), np.repeat(values[:, c].astype(np.float64), 3), n_vertices)
        for c in range(values.shape[1])
    ]
    return np.rint(np.stack(channels, axis=1) / count[:, None]).astype(np.uint8)


def _attributes(mesh: Any, n_vertices: int, n_faces: int) -> dict[str, Float64]:
    """Every column of numbers, one for each vertex or face."""
    found: dict[str, Float64] = {}
    columns: list[tuple[str, Any]] = []
    for held in (mesh.vertex_attributes, mesh.face_attributes):
        columns += [(str(name).lstrip("_"), values) for name, values in held.items()]
    # PLY: columns that trimesh itself has no use for.
    for element in ("vertex", "face"):
        data = mesh.metadata.get("_ply_raw", {}).get(element, {}).get("data")
        names = getattr(getattr(data, "dtype", None), "names", None) or ()
        items = [(name, data[name]) for name in names]
        items = list(data.items()) if isinstance(data, dict) else items
        columns += [(n, v) for n, v in items if n not in _POSITIONS | _COLOURS]
    for name, values in columns:
        array = np.asarray(values)
        if array.dtype.kind in "iufb" and array.size in (n_vertices, n_faces) and array.size:
            found[name] = array.reshape(-1).astype(np.float64)
    return found


def _joined(path: Path, parts: list[_Part]) -> FileMesh:
    """Put all parts into one mesh; what not all have is left out, but for colours: grey."""
    if not parts:
        raise ReadError(path, "no triangle mesh", "terraport build makes a mesh of points")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate(
        [part.faces + start for part, start in zip(parts, starts, strict=False)]
    ).astype(np.int32)
    origins = {part.origin_of_colours for part in parts} - {"none"}
    colours = None
    if origins:
        grey = np.array([128, 128, 128], np.uint8)
        colours = np.concatenate(
            [
                np.tile(grey, (len(part.vertices), 1)) if part.colours is None else part.colours
                for part in parts
            ]
        )
    attributes: dict[str, Float64] = {}
    for name in parts[0].attributes:
        if all(name in part.attributes for part in parts):
            values = np.concatenate([part.attributes[name] for part in parts])
            if len(values) in (starts[-1], len(faces)):
                attributes[name] = values
    # Parts of an OBJ are its materials, whose triangles may stand in turns.
    if all(part.place is not None for part in parts):
        place = np.concatenate([part.place for part in parts if part.place is not None])
        faces = faces[np.argsort(place, kind="stable")]
    return FileMesh(
        np.concatenate([part.vertices for part in parts]),
        faces,
        colours,
        attributes,
        " and ".join(sorted(origins)) or "none",
    )


def _welded(mesh: FileMesh) -> FileMesh:
    """Make vertices at one place one: neighbours over seams, and all of an STL, touch again."""
    first, number = same_places(mesh.vertices)
    n_vertices = len(mesh.vertices)
    if len(first) == n_vertices:
        return mesh

    def mean(values: AnyArray) -> Float64:
        count = np.bincount(number, minlength=len(first))
        return np.asarray(np.bincount(number, values.astype(np.float64), len(first)) / count)

    colours = mesh.colours
    if colours is not None:
        channels = [mean(colours[:, channel]) for channel in range(3)]
        colours = np.rint(np.stack(channels, axis=1)).astype(np.uint8)
    attributes = {
        name: mean(values) if len(values) == n_vertices else values
        for name, values in mesh.attributes.items()
    }
    return FileMesh(
        mesh.vertices[first],
        number[mesh.faces].astype(np.int32),
        colours,
        attributes,
        mesh.origin_of_colours,
    )
