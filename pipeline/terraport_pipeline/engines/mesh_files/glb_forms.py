"""What a GLB may hold that its reader would read as something else: refused before it is read.

trimesh leaves out what it does not know. Of most extensions that is right; but compressed triangles
come out as none or as zeros, and coordinates of textures that are integers, transformed or a second
set come out as others, without a word.
"""

from __future__ import annotations

import importlib.util
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import ReadError

__all__ = ["check_glb"]

_READ: Final = frozenset(
    (
        "EXT_texture_webp",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
    )
)
"""Extensions that a file may require: read, or of no meaning for what is read."""

_DRACO: Final = "KHR_draco_mesh_compression"
_TRANSFORM: Final = "KHR_texture_transform"
_FLOAT: Final = 5126
_JSON: Final = b"JSON"
_HEAD: Final = struct.Struct("<4sIII4s")
_PLAIN: Final = "export it again without compression or quantisation"
_IDENTITY: Final = {"offset": [0, 0], "rotation": 0, "scale": [1, 1], "texCoord": 0}


def check_glb(path: Path) -> None:
    """Refuse a GLB that would be read as another mesh than it is.

    Parameters
    ----------
    path : Path
        glTF 2.0, binary.

    Raises
    ------
    ReadError
        No GLB, cut off in its description, or in a form that is not read; it names the form.
    """
    tree = _description(path)
    required = set(tree.get("extensionsRequired", ()))
    if _DRACO in required and importlib.util.find_spec("DracoPy") is None:
        raise ReadError(
            path, f"its triangles are compressed ({_DRACO})",
            f"pip install DracoPy reads them, or {_PLAIN}",
        )  # fmt: skip
    unknown = sorted(required - _READ - {_DRACO, _TRANSFORM})
    if unknown:
        raise ReadError(path, f"it requires {', '.join(unknown)}, which is not read", _PLAIN)
    for name, accessor in _coordinates(tree):
        is_float = accessor.get("componentType") == _FLOAT
        if "sparse" in accessor:
            raise ReadError(path, f"{name} is a sparse accessor, expected a whole one", _PLAIN)
        if not is_float and (name != "POSITION" or accessor.get("normalized")):
            raise ReadError(path, f"{name} holds integers, expected floats", _PLAIN)
    for material in tree.get("materials", ()):
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        transform = texture.get("extensions", {}).get(_TRANSFORM, {})
        moved = any(transform.get(key, same) != same for key, same in _IDENTITY.items())
        if moved or texture.get("texCoord", 0):
            what = f"transformed ({_TRANSFORM})" if moved else "a second set (texCoord)"
            raise ReadError(
                path, f"the coordinates of a texture are {what}, expected TEXCOORD_0 as it is",
                "export it again with its coordinates applied",
            )  # fmt: skip


def _description(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size or not head.startswith(b"glTF"):
            raise ReadError(path, "it does not begin as a GLB", "export it again as binary glTF")
        _, version, _, length, kind = _HEAD.unpack(head)
        if version != 2 or kind != _JSON:
            raise ReadError(
                path, f"glTF version {version}, expected 2", "export it again as glTF 2.0"
            )
        data = file.read(length)
    try:
        tree = json.loads(data)
    except ValueError as error:
        raise ReadError(path, f"its description is damaged: {error}", "export it again") from error
    if not isinstance(tree, dict):
        raise ReadError(path, "its description is no JSON object", "export it again")
    return tree


def _coordinates(tree: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Accessors of positions, and of texture coordinates where there are textures."""
    accessors = tree.get("accessors", [])
    names = ("POSITION", "TEXCOORD_0") if tree.get("textures") else ("POSITION",)
    for mesh in tree.get("meshes", ()):
        for primitive in mesh.get("primitives", ()):
            for name in names:
                number = primitive.get("attributes", {}).get(name)
                if isinstance(number, int) and 0 <= number < len(accessors):
                    yield name, accessors[number]
