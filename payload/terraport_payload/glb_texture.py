"""The texture of a GLB: image, sampler and material.

Follows glTF 2.0 (sections 3.8 and 3.9), ``EXT_texture_webp``, ``KHR_texture_basisu`` and
``KHR_texture_transform``, whose scale makes fractions of the image of codes in half texels.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any, Final

from terraport_payload.texture import Texture
from terraport_payload.uv import UV_STEPS_PER_TEXEL

__all__ = ["add_texture"]

_IMAGE_EXTENSIONS: Final = {"image/webp": "EXT_texture_webp", "image/ktx2": "KHR_texture_basisu"}
"""Extension that a texture needs for an image type outside core glTF."""

_UV_TRANSFORM: Final = "KHR_texture_transform"
"""Extension that brings codes of half texels to fractions of the image."""

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
    extension = _IMAGE_EXTENSIONS.get(texture.media_type)
    if extension is None:
        document["textures"] = [{"sampler": 0, "source": 0}]
    else:
        document["textures"] = [{"sampler": 0, "extensions": {extension: {"source": 0}}}]
        document["extensionsUsed"].append(extension)
        document["extensionsRequired"].append(extension)
    material = document["materials"][0]["pbrMetallicRoughness"]
    scale = [1.0 / (UV_STEPS_PER_TEXEL * side) for side in (texture.width, texture.height)]
    material["baseColorTexture"] = {"index": 0, "extensions": {_UV_TRANSFORM: {"scale": scale}}}
    document["extensionsUsed"].append(_UV_TRANSFORM)
    document["extensionsRequired"].append(_UV_TRANSFORM)
