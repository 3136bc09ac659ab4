"""The texture of a GLB: image, sampler and material, written and found again.

Follows glTF 2.0 (sections 3.8 and 3.9), ``EXT_texture_webp`` and ``KHR_texture_basisu``.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any, Final

from terraport_payload.errors import PayloadError
from terraport_payload.glb_json import pick, typed
from terraport_payload.texture import Texture

__all__ = ["IMAGE_EXTENSIONS", "add_texture", "find_image"]

IMAGE_EXTENSIONS: Final = {"image/webp": "EXT_texture_webp", "image/ktx2": "KHR_texture_basisu"}
"""Extension that a texture needs for an image type outside core glTF."""

_CORE: Final = ["image/jpeg", "image/png"]

_LINEAR: Final = 9729
_LINEAR_MIPMAP_LINEAR: Final = 9987
_CLAMP_TO_EDGE: Final = 33071
"""Sampler constants (section 5.26)."""


def add_texture(document: dict[str, Any], texture: Texture, view: int) -> None:
    """Make an image the colour of a document's one material.

    Parameters
    ----------
    document : dict
        Changed in place.
    texture : Texture
        Its media type counts here.
    view : int
        Number of the bufferView that holds its bytes.
    """
    document["images"] = [{"bufferView": view, "mimeType": texture.media_type}]
    document["samplers"] = [
        {
            "magFilter": _LINEAR,
            "minFilter": _LINEAR_MIPMAP_LINEAR,
            # An atlas has nothing to repeat, and its last column is no neighbour of its first.
            "wrapS": _CLAMP_TO_EDGE,
            "wrapT": _CLAMP_TO_EDGE,
        }
    ]
    extension = IMAGE_EXTENSIONS.get(texture.media_type)
    if extension is None:
        document["textures"] = [{"sampler": 0, "source": 0}]
    else:
        document["textures"] = [{"sampler": 0, "extensions": {extension: {"source": 0}}}]
        document["extensionsUsed"].append(extension)
        document["extensionsRequired"].append(extension)
    material = document["materials"][0]["pbrMetallicRoughness"]
    material["baseColorTexture"] = {"index": 0}


def find_image(document: dict[str, Any], primitive: dict[str, Any]) -> tuple[int, str] | None:
    """Find the image of a primitive's material.

    Parameters
    ----------
    document : dict
        Nothing in it is trusted.
    primitive : dict
        One of its primitives.

    Returns
    -------
    (int, str) or None
        Number of the bufferView and media type; None where the material has no texture.

    Raises
    ------
    PayloadError
        When the chain from material to image is broken, or outside the profile.
    """
    if "material" not in primitive:
        return None
    materials = typed(document.get("materials"), list, "materials")
    material = typed(pick(materials, primitive["material"], "material"), dict, "material")
    surface = typed(material.get("pbrMetallicRoughness", {}), dict, "pbrMetallicRoughness")
    if "baseColorTexture" not in surface:
        return None
    place = typed(surface["baseColorTexture"], dict, "baseColorTexture")
    if place.get("texCoord", 0) != 0 or "extensions" in place:
        raise PayloadError("baseColorTexture has another set or a transform, expected set 0 alone")
    textures = typed(document.get("textures"), list, "textures")
    texture = typed(pick(textures, place.get("index"), "texture"), dict, "texture")
    extensions = typed(texture.get("extensions", {}), dict, "extensions")
    source, allowed = texture.get("source"), _CORE
    for media_type, name in IMAGE_EXTENSIONS.items():
        if name in extensions:
            source = typed(extensions[name], dict, name).get("source")
            allowed = [media_type]
    images = typed(document.get("images"), list, "images")
    image = typed(pick(images, source, "image"), dict, "image")
    media_type, view = image.get("mimeType"), image.get("bufferView")
    if media_type not in allowed:
        raise PayloadError(f"image of type {media_type!r}, expected {' or '.join(allowed)}")
    pick(typed(document.get("bufferViews"), list, "bufferViews"), view, "bufferView of image")
    return view, media_type
