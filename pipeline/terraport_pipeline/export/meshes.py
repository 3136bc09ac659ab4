"""Meshes for other programs: OBJ, PLY and GLB, about a shift written in and beside the file.

Most programs keep positions in 32 bits: a northing of 8,000,000 m then has steps of half a metre.
So files hold small coordinates, and say what to add: in the file (a comment, ``extras`` of a GLB)
and beside it, in ``NAME.offset.xyz``, one line ``E N H`` as Pix4D writes it, and in
``NAME.global_shift.txt``, a line for CloudCompare's ``global_shift_list.txt``. ``full`` writes
whole coordinates in 64 bits instead, for programs that shift them themselves.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from terraport_payload import Texture
from terraport_payload.colour import srgb_to_linear16
from terraport_payload.glb_container import join_glb
from terraport_payload.types import AnyArray, Float64, Int64
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.gathered import GatheredMesh, has_three_corners
from terraport_pipeline.geometry.mesh.face_blocks import same_places
from terraport_pipeline.progress import Progress
from terraport_store import Manifest

__all__ = ["mesh_companions", "write_glb", "write_mesh", "write_obj", "write_ply"]

_ROWS: Final = 200_000
"""Lines of text made at once."""

_MAX_GLB_BYTES: Final = (1 << 32) - (1 << 20)
"""A GLB states its size in 32 bits."""

_GLTF_IMAGES: Final = ("image/jpeg", "image/png")
"""What glTF 2.0 has without extensions."""

_SUFFIXES: Final = {"image/jpeg": ".jpg", "image/png": ".png", "image/webp": ".webp"}


def mesh_companions(path: Path) -> tuple[str, ...]:
    """Names of what may come beside a mesh."""
    shift = (f"{path.name}.offset.xyz", f"{path.name}.global_shift.txt")
    if path.suffix.lower() == ".obj":
        return (f"{path.stem}.mtl", f"{path.stem}_textures", *shift)
    return shift


def write_mesh(
    path: Path,
    mesh: GatheredMesh,
    frame: SurveyFrame,
    manifest: Manifest,
    progress: Progress,
    *,
    full: bool,
) -> dict[str, Any]:
    """Write a mesh in the format of its ending, and its shift beside it.

    Parameters
    ----------
    path : Path
        In a folder of its own.
    mesh : GatheredMesh
    frame : SurveyFrame
    manifest : Manifest
    progress : Progress
        A step of triangles.
    full : bool
        Whole coordinates in 64 bits, without a shift; not in GLB, which has 32.

    Returns
    -------
    dict
        What to say of it.
    """
    kind = path.suffix.lower()
    if kind == ".glb":
        if full:
            raise OptionError(
                "--full-coordinates in a GLB, whose positions have 32 bits; expected .ply or .obj"
            )
        frame = frame.in_metres(manifest)
    shift = (0.0, 0.0, 0.0) if full else frame.shift
    progress.start("write mesh", len(mesh.faces), "triangles")
    write = {".obj": write_obj, ".ply": write_ply, ".glb": write_glb}[kind]
    vertices, triangles = write(path, mesh, frame, shift, _about(manifest, frame), progress)
    if not full:
        _write_shift(path, shift, manifest.name)
    facts = {"triangles": f"{triangles:,}", "vertices": f"{vertices:,}"}
    progress.done(facts)
    if not full:
        facts["add"] = " ".join(f"{value:.0f}" for value in shift)
    return facts


def write_ply(
    path: Path,
    mesh: GatheredMesh,
    frame: SurveyFrame,
    shift: tuple[float, float, float],
    about: list[str],
    progress: Progress,
) -> tuple[int, int]:
    """Write a binary PLY with normals and vertex colours; return its vertices and triangles.

    Z is up. Positions are float32, or float64 where nothing is shifted. Textures become colours of
    the vertices: PLY has no form of them that programs agree on.
    """
    first, number = same_places(mesh.positions)
    local = frame.to_survey(mesh.positions[first]) - shift
    real = "f4" if any(shift) else "f8"
    columns: list[tuple[str, str]] = [(axis, f"<{real}") for axis in "xyz"]
    columns += [(f"n{axis}", "<f4") for axis in "xyz"]
    if mesh.colours is not None:
        columns += [(name, "u1") for name in ("red", "green", "blue")]
    vertices = np.empty(len(first), columns)
    normals = frame.directions_to_survey(mesh.normals[first])
    for axis, name in enumerate("xyz"):
        vertices[name] = local[:, axis]
        vertices[f"n{name}"] = normals[:, axis]
    if mesh.colours is not None:
        for channel, name in enumerate(("red", "green", "blue")):
            vertices[name] = mesh.colours[first, channel]
    faces = _corners(number[mesh.faces], frame)
    faces = faces[has_three_corners(faces)]
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    types = {"<f4": "float", "<f8": "double", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in [*about, _shift_line(shift)]),
        f"element vertex {len(vertices)}",
        *(f"property {types[kind]} {name}" for name, kind in columns),
        f"element face {len(rows)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii", "replace"))
        vertices.tofile(file)
        rows.tofile(file)
    progress.advance(len(mesh.faces))
    return len(vertices), len(rows)


def write_obj(
    path: Path,
    mesh: GatheredMesh,
    frame: SurveyFrame,
    shift: tuple[float, float, float],
    about: list[str],
    progress: Progress,
) -> tuple[int, int]:
    """Write an OBJ, with its materials and images where it has textures.

    Returns how many vertices and triangles it has.

    Z is up. Without textures vertices have colours behind their positions, 0 to 1, as CloudCompare,
    MeshLab and Blender read them.
    """
    first, number = same_places(mesh.positions)
    local = frame.to_survey(mesh.positions[first]) - shift
    # 0.1 mm, or 0.3 of it in feet: below the grid of any scene's positions.
    form = f"v{f' %.{frame.decimals}f' * 3}"
    triangles = 0
    with path.open("wb") as file:
        _lines(file, [f"# {line}" for line in [*about, _shift_line(shift)]])
        if mesh.uvs is None:
            if mesh.colours is not None:
                local = np.concatenate([local, mesh.colours[first] / 255.0], axis=1)
                form += " %.4f %.4f %.4f"
            _table(file, form, local)
            for start in range(0, len(mesh.faces), _ROWS):
                rows = _corners(number[mesh.faces[start : start + _ROWS]], frame) + 1
                solid = has_three_corners(rows)
                _table(file, "f %d %d %d", rows[solid])
                triangles += int(solid.sum())
                progress.advance(len(rows))
            return len(first), triangles
        _lines(file, [f"mtllib {path.stem}.mtl"])
        _table(file, form, local)
        # OBJ counts v from below.
        _table(file, "vt %.7f %.7f", mesh.uvs * (1.0, -1.0) + (0.0, 1.0))
        images = path.with_name(f"{path.stem}_textures")
        materials: list[str] = []
        for run, (texture, span) in enumerate(mesh.texture_faces):
            name = "plain" if texture is None else f"texture_{run}"
            _lines(file, [f"usemtl {name}"])
            corners = _corners(mesh.faces[span], frame)
            rows = np.stack([number[corners] + 1, corners + 1], axis=2)
            solid = has_three_corners(rows[:, :, 0])
            _table(file, "f %d/%d %d/%d %d/%d", rows[solid].reshape(-1, 6))
            triangles += int(solid.sum())
            if texture is not None:
                materials += _material(name, texture, images)
            progress.advance(len(rows))
    if any(texture is None for texture, _ in mesh.texture_faces):
        materials += ["newmtl plain", "Kd 0.6 0.6 0.6", ""]
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n", encoding="ascii")
    return len(first), triangles


def _corners(faces: AnyArray, frame: SurveyFrame) -> AnyArray:
    """Order the corners of faces for programs that assume right-handed axes."""
    return faces[:, ::-1] if frame.units.is_mirrored else faces


def write_glb(
    path: Path,
    mesh: GatheredMesh,
    frame: SurveyFrame,
    shift: tuple[float, float, float],
    about: list[str],
    progress: Progress,
) -> tuple[int, int]:
    """Write a plain binary glTF 2.0 that every program reads; return its vertices and triangles.

    Y is up and lengths are metres, as glTF has it. No compression and no quantisation, which
    Blender and others do not read. Images are the scene's own bytes. The shift stands in the
    ``extras`` of asset and scene.
    """
    buffer = _GlbBuffer()
    # x east, y up, -z north, about the shift instead of the origin.
    east, north, height = np.array(frame.origin) - shift
    positions = (mesh.positions + np.array([east, height, -north])).astype(np.float32)
    if mesh.uvs is None:
        first, number = same_places(mesh.positions)
        welded = number[mesh.faces]
        spans: list[tuple[Texture | None, Int64, AnyArray]] = [
            (None, first, welded[has_three_corners(welded)])
        ]
    else:
        spans = []
        for texture, span in mesh.texture_faces:
            used, local = np.unique(mesh.faces[span].astype(np.int64), return_inverse=True)
            spans.append((texture, used, local.reshape(-1, 3)))
    primitives: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    images: list[dict[str, Any]] = []
    count = triangles = 0
    for texture, used, faces in spans:
        attributes = {
            "POSITION": buffer.accessor(positions[used], "VEC3", bounds=True),
            "NORMAL": buffer.accessor(mesh.normals[used], "VEC3"),
        }
        pbr: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        if texture is not None and mesh.uvs is not None:
            if texture.media_type not in _GLTF_IMAGES:
                raise OptionError(
                    f"textures of type {texture.media_type}, which a plain GLB does not have; "
                    "expected .ply, with the colours of its vertices"
                )
            attributes["TEXCOORD_0"] = buffer.accessor(mesh.uvs[used], "VEC2")
            pbr["baseColorTexture"] = {"index": len(images)}
            view = buffer.view(texture.data)
            images.append({"bufferView": view, "mimeType": texture.media_type})
        elif mesh.colours is not None:
            linear = np.full((len(used), 4), 65535, np.uint16)
            linear[:, :3] = srgb_to_linear16(mesh.colours[used])
            attributes["COLOR_0"] = buffer.accessor(linear, "VEC4", normalized=True)
        indices = buffer.accessor(faces.astype(np.uint32).reshape(-1), "SCALAR", indices=True)
        primitives.append(
            {"attributes": attributes, "indices": indices, "material": len(materials)}
        )
        materials.append({"pbrMetallicRoughness": pbr, "doubleSided": True})
        count += len(used)
        triangles += len(faces)
        progress.advance(len(faces))
    extras = {
        "global_shift": list(shift),
        "crs": None if frame.crs is None else frame.crs.to_wkt(),
        "axes": "x = easting - shift[0], y = height - shift[2], -z = northing - shift[1]",
    }
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": about[-1], "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0], "extras": extras}],
        "nodes": [{"mesh": 0, "name": path.stem}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        **buffer.document(),
    }
    if images:
        document["images"] = images
        document["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
        document["textures"] = [{"sampler": 0, "source": at} for at in range(len(images))]
    path.write_bytes(join_glb(document, buffer.bytes()))
    return count, triangles


class _GlbBuffer:
    """The binary chunk of a GLB, and what says where things are in it."""

    _COMPONENTS: Final = {np.dtype("<f4"): 5126, np.dtype("<u2"): 5123, np.dtype("<u4"): 5125}

    def __init__(self) -> None:
        self._file = io.BytesIO()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def view(self, data: bytes | memoryview, target: int | None = None) -> int:
        start = self._file.tell()
        if start + len(data) > _MAX_GLB_BYTES:
            raise ResourceError(
                "a GLB of more than 4 GB, which its header cannot state; export it in several, by "
                "--extent or --region, or as .ply"
            )
        self._file.write(data)
        self._file.write(bytes(-len(data) % 4))
        view: dict[str, Any] = {"buffer": 0, "byteOffset": start, "byteLength": len(data)}
        self._views.append(view if target is None else {**view, "target": target})
        return len(self._views) - 1

    def accessor(
        self,
        values: AnyArray,
        kind: str,
        *,
        bounds: bool = False,
        normalized: bool = False,
        indices: bool = False,
    ) -> int:
        data = np.ascontiguousarray(values)
        accessor: dict[str, Any] = {
            "bufferView": self.view(data.tobytes(), 34963 if indices else 34962),
            "componentType": self._COMPONENTS[data.dtype],
            "count": len(data),
            "type": kind,
        }
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = data.min(axis=0).tolist()
            accessor["max"] = data.max(axis=0).tolist()
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def document(self) -> dict[str, Any]:
        return {
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._file.tell()}],
        }

    def bytes(self) -> bytes:
        return self._file.getvalue()


def _about(manifest: Manifest, frame: SurveyFrame) -> list[str]:
    crs = "none stated" if frame.crs is None else frame.crs.name
    name = manifest.name.replace("\n", " ").replace("\r", " ")
    return [
        f"{name}, version {manifest.version}",
        f"coordinate reference system: {crs}, unit {frame.unit_name}",
        f"terraport {manifest.build.terraport}",
    ]


def _shift_line(shift: tuple[float, float, float]) -> str:
    return "global shift (add to x y z): " + " ".join(f"{value:.3f}" for value in shift)


def _write_shift(path: Path, shift: tuple[float, float, float], name: str) -> None:
    east, north, height = (f"{value:.3f}" for value in shift)
    beside, cloud_compare = mesh_companions(path)[-2:]
    path.with_name(beside).write_text(f"{east} {north} {height}\n", encoding="ascii")
    # CloudCompare's own sense: what it adds to whole coordinates to come to small ones.
    added = " ; ".join(f"{0.0 - value:.3f}" for value in shift)
    label = "".join(c if c.isalnum() or c in " -_." else "_" for c in name)
    path.with_name(cloud_compare).write_text(f"{label} ; {added} ; 1.0\n", encoding="utf-8")


def _material(name: str, texture: Texture, images: Path) -> list[str]:
    suffix = _SUFFIXES.get(texture.media_type)
    if suffix is None:
        raise OptionError(
            f"textures of type {texture.media_type}, which programs do not read of an OBJ; "
            "expected .ply, with the colours of its vertices"
        )
    images.mkdir(exist_ok=True)
    (images / f"{name}{suffix}").write_bytes(texture.data)
    return [f"newmtl {name}", "Kd 1 1 1", f"map_Kd {images.name}/{name}{suffix}", ""]


def _lines(file: IO[bytes], lines: list[str]) -> None:
    file.write(("\n".join(lines) + "\n").encode("ascii", "replace"))


def _table(file: IO[bytes], form: str, rows: AnyArray | Float64) -> None:
    """Write rows of numbers, each by the same form."""
    for start in range(0, len(rows), _ROWS):
        some = rows[start : start + _ROWS]
        text = (form + "\n") * len(some) % tuple(some.ravel().tolist())
        file.write(text.encode("ascii"))
