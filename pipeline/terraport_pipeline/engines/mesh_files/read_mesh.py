"""Triangle meshes of other programs as plain arrays: OFF, PLY, OBJ, STL, GLB, glTF.

Triangles keep their order in the file, so that a table with one row per triangle matches it.
:mod:`.read_obj` reads OBJ, trimesh the other formats.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import PIL.Image
import trimesh

from terraport_payload.colour import linear16_to_srgb, srgb_to_linear16
from terraport_payload.types import AnyArray, Bool, Float32, Float64, Int32, Int64, UInt8, UInt16
from terraport_pipeline.engines.mesh_files.endings import GLTF_ENDINGS, MESH_ENDINGS
from terraport_pipeline.engines.mesh_files.gltf_files import GltfMaterial, open_gltf
from terraport_pipeline.engines.mesh_files.obj_materials import find_beside
from terraport_pipeline.engines.mesh_files.read_obj import ObjMesh, read_obj
from terraport_pipeline.engines.readers.survey_chunk import tell_precision
from terraport_pipeline.engines.texturing import decode_halved, rgb_of
from terraport_pipeline.errors import EngineError, ReadError
from terraport_pipeline.geometry.mesh.face_blocks import same_places

__all__ = [
    "MAX_MESH_BYTES",
    "FileImage",
    "FileMesh",
    "FileTexture",
    "ply_image",
    "read_mesh",
]


MAX_MESH_BYTES: Final = 4 << 30
"""Largest file: about 100 M triangles as binary PLY. It is read whole."""

_TABLE: Final = 2
_GREY: Final = (128, 128, 128)
_INWARDS: Final = 0.2
"""How far from a corner towards its face's middle its colour is read."""
_WIDEST_MEAN: Final = 8
"""Texels along a side of the mean that a vertex takes, at most."""
_OUTSIDE: Final = 1e-3
"""Share of an image by which corners may lie outside it: an allowance for rounding."""
_HEAD_BYTES: Final = 65536
_PLY_IMAGE: Final = re.compile(
    rb"^comment +TextureFile +(.+?)[ \t\r]*$", re.MULTILINE | re.IGNORECASE
)
_POSITIONS: Final = frozenset(("x", "y", "z", "nx", "ny", "nz"))
_PLY_COLOURS: Final = (
    ("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"),
)  # fmt: skip
_COLOURS: Final = frozenset(("alpha", *(name for names in _PLY_COLOURS for name in names)))
_LEAST_OF_BYTES: Final = 2.0
"""Colours are on a scale of 0 to 255 or more, not 0 to 1, if the largest is at least this."""


@dataclass(frozen=True, slots=True, eq=False)
class FileImage:
    """An image that a mesh is textured with."""

    name: str
    source: Path | bytes
    """The file, or its bytes where it stands within the mesh's."""

    def data(self) -> bytes:
        """Read the encoded image."""
        return self.source if isinstance(self.source, bytes) else self.source.read_bytes()


@dataclass(frozen=True, slots=True, eq=False)
class FileTexture:
    """Where the corners of F triangles lie in images."""

    wedges: Float32
    """(F, 3, 2) of every corner, from the image's upper left, 0..1 (beyond, the image repeats); NaN
    where a triangle has none."""
    image: Int32
    """(F,) row of `images`; -1 where a triangle has none."""
    images: tuple[FileImage, ...]


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
    """``vertices``, ``faces``, ``texture``, ``material`` or ``none``."""
    texture: FileTexture | None = None
    line: Int64 | None = None
    """(F,) line of the file that each triangle stands on, from 1; of text alone."""
    missing: ReadError | None = None
    """Why triangles with texture coordinates have no image: a library or an image is not there."""
    facts: dict[str, int] = field(default_factory=dict)
    """What else the file holds, by name: ``parts``, ``materials``, ``polygons`` that were cut into
    triangles."""
    warnings: tuple[str, ...] = ()
    """Contents of the file that are not read, as whole sentences."""


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
    warnings: list[str] = []
    read_parts = _parts_of_obj if kind == ".obj" else _parts_by_trimesh
    parts = read_parts(path, warnings)
    mesh = replace(_joined(path, parts), warnings=tuple(dict.fromkeys(warnings)))
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
    """A node of a file, or all of one."""

    vertices: Float64
    faces: Int32
    colours: UInt8 | None
    origin_of_colours: str
    attributes: dict[str, Float64]
    texture: FileTexture | None = None
    line: Int64 | None = None
    missing: ReadError | None = None
    facts: dict[str, int] = field(default_factory=dict)


def _parts_of_obj(path: Path, warnings: list[str]) -> list[_Part]:
    mesh = read_obj(path)
    if mesh.uncoloured:
        warnings.append(
            f"{mesh.uncoloured:,} of {len(mesh.vertices):,} vertices of {path.name} have no "
            "colour, unlike the others: they are grey."
        )
    warnings += mesh.warnings
    # OBJ is text: an axis with only whole numbers is taken as exact.
    warnings += _coarse(mesh.vertices, (mesh.vertices != np.rint(mesh.vertices)).any(axis=0))
    masked = [material.name for material in mesh.materials if material.has_mask]
    if masked:
        warnings.append(_transparent(masked[0]))
    # (1) The images that faces with wedges mean.
    has_wedge = np.zeros(len(mesh.faces), np.bool_)
    if mesh.wedges is not None:
        has_wedge = ~np.isnan(mesh.wedges[:, 0, 0])
    paths = [material.image for material in mesh.materials]
    unique = tuple(dict.fromkeys(image for image in paths if image is not None))
    row = np.array([-1 if image is None else unique.index(image) for image in paths], np.int32)
    image = np.where(has_wedge, row[mesh.material], -1).astype(np.int32)
    texture = None
    if (image >= 0).any() and mesh.wedges is not None:
        files = tuple(FileImage(file.name, file) for file in unique)
        texture = FileTexture(mesh.wedges, image, files)
    meant = np.unique(mesh.material[has_wedge])
    missing = next((m for i in meant if (m := mesh.materials[i].missing) is not None), None)
    # (2) Colours, also where there is no image.
    plain = np.full((len(mesh.materials), 3), -1, np.int16)
    for number, material in enumerate(mesh.materials):
        if material.image is None and material.colour is not None:
            plain[number] = material.colour
    colours, origin = mesh.colours, "none" if mesh.colours is None else "vertices"
    tells = _tells(plain[np.unique(mesh.material)])
    if texture is not None or (colours is None and tells):
        colours = _colours_of_texture(path, mesh, texture, plain[mesh.material])
        origin = "material" if texture is None else "texture"
    facts = {
        "parts": mesh.objects, "materials": len(mesh.materials), "polygons": mesh.polygons,
    }  # fmt: skip
    return [
        _Part(mesh.vertices, mesh.faces, colours, origin, {}, texture, mesh.line, missing, facts)
    ]


def _colours_of_texture(
    path: Path, mesh: ObjMesh | _Part, texture: FileTexture | None, plain: AnyArray
) -> UInt8:
    """Mean at every vertex of what its faces show there: texels, or the colour of their material.

    `plain` (F, 3) is that colour, -1 where there is none. Texels are means over half an edge, so
    that a blade of grass is not taken for a meadow.
    """
    n_vertices = len(mesh.vertices)
    total, count = np.zeros((n_vertices, 3)), np.zeros(n_vertices)

    def add(rows: AnyArray, colours: AnyArray) -> None:
        vertex = mesh.faces[rows].ravel()
        count[:] += np.bincount(vertex, minlength=n_vertices)
        for channel in range(3):
            total[:, channel] += np.bincount(vertex, colours[:, channel], n_vertices)

    shown = np.full(len(mesh.faces), -1, np.int32) if texture is None else texture.image
    for number, file in enumerate(() if texture is None else texture.images):
        rows = np.flatnonzero(shown == number)
        if not len(rows) or texture is None:
            continue
        image = _decoded(path, file)
        wedges = texture.wedges[rows].astype(np.float64)
        edges = (wedges[:, 1] - wedges[:, 0]) * image.shape[1::-1]
        step = int(np.clip(np.median(np.linalg.norm(edges, axis=1)) / 2.0, 1, _WIDEST_MEAN))
        if step > 1:
            image = np.asarray(PIL.Image.fromarray(image).reduce(step))
        # Within its face: beside a corner another chart begins.
        inside = _INWARDS * wedges.mean(axis=1, keepdims=True) + (1.0 - _INWARDS) * wedges
        add(rows, _looked_up(image, inside.reshape(-1, 2)).astype(np.float64))
    rows = np.flatnonzero((shown < 0) & (plain[:, 0] >= 0))
    add(rows, np.repeat(plain[rows].astype(np.float64), 3, axis=0))
    colours = np.rint(total / np.maximum(count, 1.0)[:, None]).astype(np.uint8)
    own = np.full((n_vertices, 3), _GREY, np.uint8) if mesh.colours is None else mesh.colours
    colours[count == 0] = own[count == 0]
    return colours


def _decoded(path: Path, image: FileImage) -> UInt8:
    try:
        return decode_halved(image.data(), 0)
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


def _tells(colours: AnyArray) -> bool:
    """Return whether the colours of materials, (N, 3), carry information: a single grey does not.

    Programs write grey or white if they have no colours; -1 means none.
    """
    distinct = np.unique(colours, axis=0)
    return len(distinct) > 1 or len(np.unique(distinct)) > 1


def _transparent(material: str) -> str:
    return f"Transparent parts of the mesh are drawn opaque (material {material})."


def _parts_by_trimesh(path: Path, warnings: list[str]) -> list[_Part]:
    materials: tuple[GltfMaterial, ...] = ()
    load: Any = trimesh.load_scene
    kind = path.suffix.lower()
    picture, missing = None, None
    if kind == ".ply":
        picture = ply_image(path)
        if picture is not None and not picture.is_file():
            missing = ReadError(
                path, f"its texture {picture.name} is not beside it", "copy it there"
            )
            picture = None
    try:
        if kind in GLTF_ENDINGS:
            gltf = open_gltf(path)
            materials = gltf.materials
            warnings += gltf.warnings
            document = io.BytesIO(gltf.document)
            scene = load(document, file_type="gltf", resolver=gltf, process=False)
        else:
            # trimesh does not load the image of a PLY: it would replace a missing one by grey.
            more = {"skip_materials": True} if kind == ".ply" else {}
            scene = load(path, process=False, **more)
        parts: list[_Part] = []
        images: dict[tuple[int, str], FileImage] = {}
        told: set[GltfMaterial] = set()
        # Nodes in the order of the file: several nodes may use one mesh.
        for name in scene.graph.nodes_geometry:
            transform, key = scene.graph[name]
            mesh = scene.geometry[key]
            if isinstance(mesh, trimesh.Trimesh):
                material = None
                if materials:
                    visual: Any = mesh.visual
                    material = materials[int(visual.material.name)]
                placed = np.asarray(transform)
                parts.append(_part_of_trimesh(path, mesh, placed, material or picture, images))
                warnings += _coarse(mesh.vertices)
                if material is not None and material not in told:
                    warnings += _left_out(path, mesh, material)
                    told.add(material)
    except ReadError:
        raise
    except Exception as error:  # whatever a damaged file makes its many readers raise
        raise ReadError(
            path, f"it cannot be read ({type(error).__name__}: {error})", "export it again"
        ) from error
    if len(parts) > 1:
        parts = [_used_alone(part) for part in parts]
    parts = [replace(part, missing=missing) for part in parts]
    if not parts and warnings:
        raise ReadError(path, f"no triangle mesh: {warnings[0].rstrip('.')}", "export triangles")
    # A single grey for all base colours carries no information.
    alone = all(part.origin_of_colours in ("material", "none") for part in parts)
    plain = [
        part.colours[0]
        for part in parts
        if part.colours is not None and part.origin_of_colours == "material"
    ]
    if alone and plain and not _tells(np.array(plain)):
        parts = [replace(part, colours=None, origin_of_colours="none") for part in parts]
    return parts


def _used_alone(part: _Part) -> _Part:
    """Remove vertices that no face of a part uses: parts often share one vertex list."""
    used, corner = np.unique(part.faces, return_inverse=True)
    count = len(part.vertices)
    if len(used) == count:
        return part
    return replace(
        part,
        vertices=part.vertices[used],
        faces=corner.reshape(-1, 3).astype(np.int32),
        colours=None if part.colours is None else part.colours[used],
        attributes={
            name: values[used] if len(values) == count else values
            for name, values in part.attributes.items()
        },
    )


def _coarse(stored: Float64, axes: Bool | bool = True) -> tuple[str, ...]:
    """Warn about coordinates, before node transforms, that are too large for 32-bit floats."""
    if not len(stored):
        return ()
    single = (stored == stored.astype(np.float32)).all(axis=0) & axes
    return tell_precision(single, np.abs(stored).max(axis=0))


def ply_image(path: Path) -> Path | None:
    """Return the path of the image that a PLY names, even if it is missing; None without one.

    Raises
    ------
    ReadError
        The file names several images.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).partition(b"end_header")[0]
    names = [name.decode("utf-8", "replace") for name in _PLY_IMAGE.findall(head)]
    if len(names) > 1:
        raise ReadError(
            path, f"it has {len(names)} textures ({names[0]}, ..), expected one",
            "export it as OBJ or GLB",
        )  # fmt: skip
    return (find_beside(path, names[0]) or path.parent / names[0]) if names else None


def _left_out(path: Path, mesh: Any, material: GltfMaterial) -> list[str]:
    """Return warnings about parts of a glTF material that are not read."""
    if mesh.visual.uv is None or not material.texture:
        return []
    found = []
    if not material.is_opaque and _has_alpha(mesh.visual.material.baseColorTexture):
        found.append(_transparent(material.label))
    codes = _vertex_codes(mesh)
    if codes is not None and (codes != np.iinfo(codes.dtype).max).any():  # white has no effect
        found.append(
            f"{path.name} has vertex colours (COLOR_0) on top of a texture; the texture alone is "
            "used."
        )
    return found


def _has_alpha(image: PIL.Image.Image) -> bool:
    return image.has_transparency_data and bool(
        np.asarray(image.convert("RGBA"))[..., 3].min() < 255
    )


def _part_of_trimesh(
    path: Path,
    mesh: Any,
    transform: Float64,
    material: GltfMaterial | Path | None,
    images: dict[tuple[int, str], FileImage],
) -> _Part:
    vertices = np.asarray(mesh.vertices, np.float64)
    if vertices.shape[1:] == (3,) and not np.array_equal(transform, np.eye(4)):
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3).astype(np.int32)
    if vertices.shape[1:] != (3,) or (len(faces) and faces.max() >= len(vertices)):
        raise ReadError(
            path, f"a triangle of a part names vertex {faces.max(initial=0)} of {len(vertices)}",
            "export it again",
        )  # fmt: skip
    if np.linalg.det(transform[:3, :3]) < 0.0:  # a mirrored node: glTF 2.0, 3.7.4
        faces = np.ascontiguousarray(faces[:, ::-1])
    attributes = _attributes(mesh, len(vertices), len(faces))
    texture = _texture_of_trimesh(path, mesh, faces, material, images)
    if texture is None:
        gltf = material if isinstance(material, GltfMaterial) else None
        own = _ply_colours(path, mesh, faces)
        colours, origin = own or _colours_of_trimesh(mesh, faces, gltf)
        return _Part(vertices, faces, colours, origin, attributes)
    part = _Part(vertices, faces, None, "texture", attributes, texture)
    none = np.full((len(faces), 3), -1, np.int16)
    return replace(part, colours=_colours_of_texture(path, part, texture, none))


def _texture_of_trimesh(
    path: Path,
    mesh: Any,
    faces: Int32,
    material: GltfMaterial | Path | None,
    images: dict[tuple[int, str], FileImage],
) -> FileTexture | None:
    """Return the texture of a part, from the image of its material or of its PLY.

    `images` holds the images of the file found before, by object and factor.
    """
    uvs = getattr(mesh.visual, "uv", None)
    if material is None or uvs is None:
        return None
    # trimesh counts v from below.
    wedges = (np.asarray(uvs, np.float64) * [1, -1] + [0, 1])[faces].astype(np.float32)
    if isinstance(material, Path):
        image = FileImage(material.name, material)
        return FileTexture(wedges, np.zeros(len(faces), np.int32), (image,))
    if not material.texture:
        return None
    held = mesh.visual.material.baseColorTexture
    if held is None:
        raise ReadError(
            path, f"its texture {material.texture} of material {material.label} is not read",
            "export it again with textures as JPEG, PNG or WebP, within the file or beside it",
        )  # fmt: skip
    beyond = float(np.nanmax(np.abs(wedges - 0.5), initial=0.0)) - 0.5
    if not material.repeats and beyond > _OUTSIDE:
        raise ReadError(
            path, f"the texture of material {material.label} is clamped or mirrored beyond its "
            "edges (sampler), and texture coordinates go there",
            "bake the texture into an atlas in the program that made it",
        )  # fmt: skip
    key = id(held), str(material.factor)
    if key not in images:
        data = io.BytesIO()
        # Lossless and fast: the image is only an intermediate result, drawn into atlases.
        _multiplied(rgb_of(held), material.factor).save(data, "PNG", compress_level=1)
        images[key] = FileImage(f"image {len(images)}", data.getvalue())
    row = list(images).index(key)
    return FileTexture(wedges, np.full(len(faces), row, np.int32), tuple(images.values()))


def _multiplied(image: PIL.Image.Image, factor: tuple[float, float, float]) -> PIL.Image.Image:
    """Multiply an sRGB image in linear light, as a base colour factor does."""
    if factor == (1.0, 1.0, 1.0):
        return image
    levels = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    changed = linear16_to_srgb(_codes16(srgb_to_linear16(levels) / 65535.0 * factor))
    return image.point(changed.T.ravel().tolist())


def _codes16(linear: AnyArray) -> UInt16:
    return np.rint(np.clip(linear, 0.0, 1.0) * 65535.0).astype(np.uint16)


def _colours_of_trimesh(
    mesh: Any, faces: Int32, material: GltfMaterial | None
) -> tuple[UInt8 | None, str]:
    visual = mesh.visual
    if visual.kind == "vertex":
        return np.asarray(visual.vertex_colors, np.uint8)[:, :3], "vertices"
    if visual.kind == "face":
        return _of_vertices(np.asarray(visual.face_colors)[:, :3], faces, len(mesh.vertices)), (
            "faces"
        )
    if material is None:
        # In a PLY with texture coordinates, trimesh stores the colours next to them.
        own = np.asarray(mesh.vertex_attributes.get("color", ()))
        is_read = own.shape[:1] == (len(mesh.vertices),) and own.ndim == _TABLE
        return (own[:, :3].astype(np.uint8), "vertices") if is_read else (None, "none")
    factor, codes = np.array(material.factor), _vertex_codes(mesh)
    if codes is None:
        return np.tile(linear16_to_srgb(_codes16(factor)), (len(mesh.vertices), 1)), "material"
    # A glTF has its colours beside the material. It asks for linear light; writers of 8 bits put
    # sRGB there all the same, as 8 bits of linear light band.
    if codes.dtype == np.uint8 and (factor == 1.0).all():
        return np.ascontiguousarray(codes), "vertices"
    linear = srgb_to_linear16(codes) if codes.dtype == np.uint8 else codes
    return linear16_to_srgb(_codes16(linear / 65535.0 * factor)), "vertices"


def _vertex_codes(mesh: Any) -> AnyArray | None:
    """Return the colours of glTF vertices, (V, 3): uint8 as stored, or uint16 in linear light."""
    codes = np.asarray(getattr(mesh.visual, "vertex_attributes", {}).get("color", ()))
    if codes.shape[:1] != (len(mesh.vertices),) or codes.ndim != _TABLE:
        return None
    codes = np.ascontiguousarray(codes[:, :3])
    if codes.dtype.kind == "f":
        return _codes16(codes)
    return codes if codes.dtype == np.uint16 else codes.astype(np.uint8)


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
        items = _ply_columns(mesh, element).items()
        columns += [(n, v) for n, v in items if n not in _POSITIONS | _COLOURS]
    for name, values in columns:
        array = np.asarray(values)
        is_column = array.ndim > 0 and array.size == len(array) > 0
        if is_column and array.dtype.kind in "iufb" and array.size in (n_vertices, n_faces):
            found[name] = array.reshape(-1).astype(np.float64)
    return found


def _ply_columns(mesh: Any, element: str) -> Mapping[str, Any]:
    """Return the columns of a PLY as stored in the file, by name."""
    data = mesh.metadata.get("_ply_raw", {}).get(element, {}).get("data")
    if isinstance(data, dict):
        return data
    names = getattr(getattr(data, "dtype", None), "names", None) or ()
    return {name: data[name] for name in names}


def _ply_colours(path: Path, mesh: Any, faces: Int32) -> tuple[UInt8, str] | None:
    """Return the colours of a PLY of any depth; trimesh would use the low byte of 16 bits."""
    for element, origin, count in (
        ("vertex", "vertices", len(mesh.vertices)), ("face", "faces", len(faces)),
    ):  # fmt: skip
        columns = _ply_columns(mesh, element)
        for names in _PLY_COLOURS:
            found = [np.asarray(columns[name]).reshape(-1) for name in names if name in columns]
            if len(found) == len(names) and all(len(one) == count for one in found):
                levels = _levels(path, np.stack(found, axis=1))
                return _of_vertices(levels, faces, len(mesh.vertices)) if element == "face" else (
                    levels
                ), origin
    return None


def _levels(path: Path, values: AnyArray) -> UInt8:
    """Convert colours from 0..1, 8 or 16 bits to 8 bits, by data type and largest value."""
    top = float(values.max(initial=0))
    if values.dtype.kind == "f" and top < _LEAST_OF_BYTES:
        scale = 255.0
    elif top <= 255.0:
        scale = 1.0
    elif top <= 65535.0:
        scale = 1.0 / 257.0
    else:
        raise ReadError(
            path, f"a colour of {top:g}, expected 0 to 1, 255 or 65535", "export it again"
        )
    return np.rint(np.clip(values * scale, 0.0, 255.0)).astype(np.uint8)


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
        grey = np.array(_GREY, np.uint8)
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
    [first, *more] = parts
    facts = {"parts": len(parts)} if more else {"parts": 1, **first.facts}
    return FileMesh(
        np.concatenate([part.vertices for part in parts]),
        faces,
        colours,
        attributes,
        " and ".join(sorted(origins)) or "none",
        _joined_textures(parts),
        None if more else first.line,
        None if more else first.missing,
        facts,
    )


def _joined_textures(parts: list[_Part]) -> FileTexture | None:
    """Put the textures of all parts into one; images that several use are there once."""
    textures = [part.texture for part in parts if part.texture is not None]
    if not textures:
        return None
    # Every part has the images of the file so far: the last one has all.
    images = max((texture.images for texture in textures), key=len)
    none = np.float32(np.nan)
    return FileTexture(
        np.concatenate(
            [
                np.full((len(part.faces), 3, 2), none)
                if part.texture is None
                else part.texture.wedges
                for part in parts
            ]
        ),
        np.concatenate(
            [
                np.full(len(part.faces), -1, np.int32)
                if part.texture is None
                else part.texture.image
                for part in parts
            ]
        ),
        images,
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
    return replace(
        mesh,
        vertices=mesh.vertices[first],
        faces=number[mesh.faces].astype(np.int32),
        colours=colours,
        attributes=attributes,
    )
