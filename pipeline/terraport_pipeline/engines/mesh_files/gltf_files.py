"""Checks of glTF 2.0 files (``.glb``, ``.gltf``) before trimesh reads them.

trimesh silently ignores features that it does not support: it rounds base colours to 8 bits, drops
KTX2 images and extensions, and reads compressed triangles as zeros. So the JSON is read here first.
Unsupported features that change the geometry or the picture are refused or become a warning that
names them. Materials are reduced to base colour factor and texture. trimesh reads the rest.
"""

from __future__ import annotations

import importlib.util
import json
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from terraport_pipeline.engines.mesh_files.obj_materials import find_beside
from terraport_pipeline.errors import ReadError

__all__ = ["GltfFile", "GltfMaterial", "gltf_companions", "open_gltf"]

_READ: Final = frozenset(
    (
        "EXT_texture_webp",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    )
)
"""Extensions that a file may require: they are supported, checked below, or do not change base
colours."""

_HARMLESS: Final = re.compile(
    r"KHR_materials_.*|KHR_lights_.*|KHR_xmp.*|KHR_animation_.*|KHR_texture_basisu|EXT_texture_.*"
    r"|MSFT_texture_dds|EXT_structural_metadata|EXT_mesh_features|EXT_instance_features"
    r"|EXT_feature_metadata|CESIUM_primitive_outline|KHR_draco_mesh_compression"
    r"|(EXT|KHR)_meshopt_compression|EXT_mesh_gpu_instancing|CESIUM_RTC|EXT_lights_.*"
)
"""Extensions that change neither positions nor base colours, and those that are checked where they
are used."""

_DRACO: Final = "KHR_draco_mesh_compression"
_TRANSFORM: Final = "KHR_texture_transform"
_SPECULAR: Final = "KHR_materials_pbrSpecularGlossiness"
_RTC: Final = "CESIUM_RTC"
_INSTANCES: Final = "EXT_mesh_gpu_instancing"
_PACKED: Final = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_FLOAT: Final = 5126
_REPEAT: Final = 10497
_TRIANGLES: Final = (4, 5)
"""Primitive modes that are read: triangles and strips of them."""
_JSON: Final = b"JSON"
_HEAD: Final = struct.Struct("<4sIII4s")
_CHUNK: Final = struct.Struct("<II")
_BINARY: Final = "binary chunk"
"""Name of the GLB's binary chunk for the reader."""
_NAMING: Final = ("buffers", "images")
"""Members of the JSON that refer to other files."""
_PLAIN: Final = "export it again without compression or quantisation"
_IDENTITY: Final = {"offset": [0, 0], "rotation": 0, "scale": [1, 1], "texCoord": 0}


@dataclass(frozen=True, slots=True)
class GltfMaterial:
    """The base colour of a material."""

    label: str
    """Its name, else its number, for messages."""
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """``baseColorFactor``, linear light."""
    texture: str = ""
    """Number and name of its image, for messages; empty without one."""
    repeats: bool = True
    """True if the image repeats outside 0..1; False if it is clamped or mirrored."""
    is_opaque: bool = True
    """Whether ``alphaMode`` ignores alpha."""
    only_emits: bool = False
    """True if its only texture is an emissive one, which is not read."""


@dataclass(frozen=True, slots=True)
class GltfFile:
    """A file prepared for trimesh's glTF reader, with its materials."""

    path: Path
    document: bytes
    """JSON; every material is named by its row in `materials`."""
    materials: tuple[GltfMaterial, ...]
    warnings: tuple[str, ...]
    binary: tuple[int, int] = (0, 0)
    """Offset and length of the GLB's binary chunk."""

    def __getitem__(self, uri: str) -> bytes:
        """Read a buffer or image that the JSON refers to."""
        if uri == _BINARY:
            with self.path.open("rb") as file:
                file.seek(self.binary[0])
                return file.read(self.binary[1])
        found = find_beside(self.path, unquote(uri))
        if found is None:
            raise ReadError(
                self.path, f"its file {uri[:80]} is missing", "copy it next to the mesh"
            )
        return found.read_bytes()

    get = __getitem__


def open_gltf(path: Path) -> GltfFile:
    """Read the JSON of a file, and refuse features that would give a wrong mesh.

    Parameters
    ----------
    path : Path
        glTF 2.0, binary or as text with buffers.

    Raises
    ------
    ReadError
        The file is not glTF 2.0, its JSON is cut off, or it uses an unsupported feature; names it.
    """
    tree, binary = _description(path)
    if binary != (0, 0) and tree.get("buffers"):
        tree["buffers"][0].setdefault("uri", _BINARY)
    warnings = list(_unread(path, tree))
    materials = _reduced_materials(path, tree)
    warnings += [
        f"Material {one.label} of {path.name} has its texture as emitted light (emissiveTexture), "
        "which is not read."
        for one in materials
        if one.only_emits
    ][:1]
    _check_accessors(path, tree)
    return GltfFile(path, json.dumps(tree).encode(), materials, tuple(warnings), binary)


def gltf_companions(path: Path) -> tuple[Path, ...]:
    """List the existing buffer and image files that a file refers to, each once."""
    tree, _ = _description(path)
    try:
        named = [part.get("uri", "data:") for name in _NAMING for part in tree.get(name, ())]
        uris = [uri for uri in named if not uri.startswith("data:")]
        found = [find_beside(path, unquote(uri)) for uri in uris]
    except (AttributeError, TypeError, ValueError):  # damaged: reading it says so
        return ()
    return tuple(dict.fromkeys(file for file in found if file is not None))


def _description(path: Path) -> tuple[dict[str, Any], tuple[int, int]]:
    """Read the JSON and the position of the binary chunk."""
    binary = (0, 0)
    if path.suffix.lower() == ".gltf":
        data = path.read_bytes()
    else:
        with path.open("rb") as file:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size or not head.startswith(b"glTF"):
                raise ReadError(
                    path, "it does not begin as a GLB", "export it again as binary glTF"
                )
            _, version, _, length, kind = _HEAD.unpack(head)
            if version != 2 or kind != _JSON:
                raise ReadError(
                    path, f"glTF version {version}, expected 2", "export it again as glTF 2.0"
                )
            data = file.read(length)
            chunk = file.read(_CHUNK.size)
            if len(chunk) == _CHUNK.size:
                binary = (_HEAD.size + length + _CHUNK.size, _CHUNK.unpack(chunk)[0])
    try:
        tree = json.loads(data)
    except ValueError as error:
        raise ReadError(path, f"its description is damaged: {error}", "export it again") from error
    if not isinstance(tree, dict):
        raise ReadError(path, "its description is not a JSON object", "export it again")
    asset = tree.get("asset")
    version = str(asset.get("version", "2.0")) if isinstance(asset, dict) else "missing"
    if not version.startswith("2"):
        raise ReadError(path, f"glTF version {version}, expected 2", "export it again as glTF 2.0")
    return tree, binary


def _unread(path: Path, tree: dict[str, Any]) -> Iterator[str]:
    """Refuse unsupported features, and return warnings about ignored ones."""
    # (1) Extensions: required ones, those that move or multiply the mesh, and unknown ones.
    required = set(tree.get("extensionsRequired", ()))
    if _DRACO in required and not _reads_draco():
        raise _draco_needed(path)
    unknown = sorted(required - _READ - {_DRACO, _RTC, _INSTANCES})
    if unknown:
        raise ReadError(path, f"it requires {', '.join(unknown)}, which is not read", _PLAIN)
    centre = tree.get("extensions", {}).get(_RTC)
    if centre is not None:
        raise ReadError(
            path,
            f"its coordinates are relative to the centre {centre.get('center')} ({_RTC}): it is "
            "the content of a 3D Tile",
            "export the model itself in the survey's coordinates, as GLB, OBJ or PLY",
        )
    nodes = tree.get("nodes", [])
    if any(_INSTANCES in node.get("extensions", {}) for node in nodes):
        raise ReadError(
            path, f"its meshes are drawn many times ({_INSTANCES}), which is not read",
            "export it again with the instances as meshes of their own",
        )  # fmt: skip
    for name in _PACKED:
        if any(name in view.get("extensions", {}) for view in tree.get("bufferViews", ())):
            raise ReadError(path, f"its buffers are compressed ({name})", _PLAIN)
    others = [
        name
        for name in tree.get("extensionsUsed", ())
        if name not in _READ and not _HARMLESS.fullmatch(name)
    ]
    if others:
        yield f"{path.name} uses {', '.join(others)}, which is not supported and is ignored."
    # (2) Primitives and deformations that are ignored.
    primitives = [one for mesh in tree.get("meshes", ()) for one in mesh.get("primitives", ())]
    left_out = sum(one.get("mode", 4) not in _TRIANGLES for one in primitives)
    if left_out:
        yield (
            f"{left_out:,} of {len(primitives):,} primitives of {path.name} are points, lines or "
            "triangle fans; they are left out."
        )
    posed = sum("skin" in node for node in nodes) + sum(
        any(mesh.get("weights", ())) for mesh in tree.get("meshes", ())
    )
    if posed:
        yield (
            f"{posed:,} meshes of {path.name} have a skeleton or morph targets; they are taken "
            "without."
        )


def _reduced_materials(path: Path, tree: dict[str, Any]) -> tuple[GltfMaterial, ...]:
    """Replace the JSON's materials by numbered base colour textures; return their properties."""
    materials = [*tree.get("materials", ()), {}]  # the last: primitives without one
    for mesh in tree.get("meshes", ()):
        for primitive in mesh.get("primitives", ()):
            primitive.setdefault("material", len(materials) - 1)
    reduced, found = [], []
    for number, material in enumerate(materials):
        base = material.get("pbrMetallicRoughness", {})
        factor, texture = base.get("baseColorFactor"), base.get("baseColorTexture")
        specular = material.get("extensions", {}).get(_SPECULAR)
        if specular is not None:  # used instead of the other if both are stated
            factor, texture = specular.get("diffuseFactor"), specular.get("diffuseTexture")
        label = material.get("name") or f"number {number}"
        image, repeats = "", True
        reduced.append({"name": str(number), "pbrMetallicRoughness": {}})
        if texture is not None:
            _check_texture(path, label, texture)
            reduced[-1]["pbrMetallicRoughness"] = {"baseColorTexture": {"index": texture["index"]}}
            image, repeats = _image_of(tree, texture["index"])
        red, green, blue, _alpha = factor or (1.0, 1.0, 1.0, 1.0)
        opaque = material.get("alphaMode", "OPAQUE") == "OPAQUE"
        emits = texture is None and "emissiveTexture" in material
        found.append(GltfMaterial(label, (red, green, blue), image, repeats, opaque, emits))
    tree["materials"] = reduced
    return tuple(found)


def _check_texture(path: Path, label: str, texture: dict[str, Any]) -> None:
    transform = texture.get("extensions", {}).get(_TRANSFORM, {})
    moved = any(transform.get(key, same) != same for key, same in _IDENTITY.items())
    if moved or texture.get("texCoord", 0):
        what = f"transformed ({_TRANSFORM})" if moved else "a second set (texCoord)"
        raise ReadError(
            path, f"the texture coordinates of material {label} are {what}, expected TEXCOORD_0",
            "export it again with its coordinates applied",
        )  # fmt: skip


def _image_of(tree: dict[str, Any], number: int) -> tuple[str, bool]:
    """Describe the image of a texture for messages; also return whether it repeats."""
    texture = tree["textures"][number]
    extensions = texture.get("extensions", {})
    source = extensions.get("EXT_texture_webp", {}).get("source", texture.get("source"))
    image = {} if source is None else tree["images"][source]
    kinds = [image.get("uri", "data:")[:80], image.get("mimeType", ""), *extensions]
    words = [kind for kind in kinds if kind and not kind.startswith("data:")]
    sampler = tree.get("samplers", [])[texture["sampler"]] if "sampler" in texture else {}
    repeats = all(sampler.get(axis, _REPEAT) == _REPEAT for axis in ("wrapS", "wrapT"))
    return f"{number} ({', '.join(words) or 'no image'})", repeats


def _check_accessors(path: Path, tree: dict[str, Any]) -> None:
    """Refuse positions and texture coordinates that trimesh would misread."""
    accessors = tree.get("accessors", [])
    names = ("POSITION", "TEXCOORD_0") if tree.get("textures") else ("POSITION",)
    for mesh in tree.get("meshes", ()):
        for primitive in mesh.get("primitives", ()):
            attributes = primitive.get("attributes", {})
            is_draco = _DRACO in primitive.get("extensions", {})
            for name in names:
                number = attributes.get(name)
                if not isinstance(number, int) or not 0 <= number < len(accessors):
                    continue
                accessor = accessors[number]
                is_float = accessor.get("componentType") == _FLOAT
                if "sparse" in accessor:
                    raise ReadError(
                        path, f"{name} is a sparse accessor, expected a whole one", _PLAIN
                    )
                if "bufferView" not in accessor and not (is_draco and _reads_draco()):
                    if is_draco:
                        raise _draco_needed(path)
                    raise ReadError(path, f"{name} has no data (bufferView)", "export it again")
                if not is_float and (name != "POSITION" or accessor.get("normalized")):
                    raise ReadError(path, f"{name} holds integers, expected floats", _PLAIN)


def _reads_draco() -> bool:
    return importlib.util.find_spec("DracoPy") is not None


def _draco_needed(path: Path) -> ReadError:
    return ReadError(
        path, f"its triangles are compressed ({_DRACO})",
        f"pip install DracoPy reads them, or {_PLAIN}",
    )  # fmt: skip
