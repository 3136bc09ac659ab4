"""The texture of a GLB: image, sampler and material, written and found again.

Follows glTF 2.0 (sections 3.8 and 3.9), ``EXT_texture_webp``, ``KHR_texture_basisu`` and
``KHR_texture_transform``: texture coordinates are stored in half texels, and the transform's scale
makes fractions of the image of them. Codes a few apart from vertex to vertex pack into less than
half of what codes over the whole 16 bits do; sides are powers of two, so the product is exact.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.glb_json import pick, typed
from terraport_payload.texture import Texture
from terraport_payload.types import Float32, UInt16

__all__ = [
    "IMAGE_EXTENSIONS",
    "UV_STEPS_PER_TEXEL",
    "UV_TRANSFORM",
    "add_texture",
    "decode_uvs",
    "encode_uvs",
    "find_image",
    "find_uv_scale",
    "snap_uvs",
]

IMAGE_EXTENSIONS: Final = {"image/webp": "EXT_texture_webp", "image/ktx2": "KHR_texture_basisu"}
"""Extension that a texture needs for an image type outside core glTF."""

UV_STEPS_PER_TEXEL: Final = 2
"""Texture coordinates are whole half texels: coarse enough to pack well, and without any error for
an atlas that is drawn after :func:`snap_uvs`."""

_MAX_CODE: Final = 65535

_LEAST_SCALE: Final = 2.0**-16
"""Sides up to 32768 texels."""

UV_TRANSFORM: Final = "KHR_texture_transform"
"""Extension that brings codes of half texels to fractions of the image."""

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
    scale = [1.0 / steps for steps in _steps(texture.width, texture.height)]
    material["baseColorTexture"] = {"index": 0, "extensions": {UV_TRANSFORM: {"scale": scale}}}
    document["extensionsUsed"].append(UV_TRANSFORM)
    document["extensionsRequired"].append(UV_TRANSFORM)


def _steps(width: int, height: int) -> tuple[int, int]:
    return UV_STEPS_PER_TEXEL * width, UV_STEPS_PER_TEXEL * height


def encode_uvs(uvs: Float32, width: int, height: int) -> UInt16:
    """Round texture coordinates to half texels.

    Parameters
    ----------
    uvs : ndarray of shape (V, 2), float32
        0..1, from the image's upper left.
    width, height : int
        Texels of the image, powers of two.

    Returns
    -------
    ndarray of shape (V, 2), uint16
    """
    codes = np.rint(uvs.astype(np.float64) * _steps(width, height))
    return np.minimum(codes, _MAX_CODE).astype("<u2")


def decode_uvs(codes: UInt16, scale: tuple[float, float] | None) -> Float32:
    """Turn codes into texture coordinates.

    Parameters
    ----------
    codes : ndarray of shape (V, 2), uint16
    scale : tuple of float, or None
        The transform's; None where codes span the image with their 16 bits.

    Returns
    -------
    ndarray of shape (V, 2), float32
    """
    values = codes.astype(np.float32)
    if scale is None:
        return values / np.float32(_MAX_CODE)
    return values * np.array(scale, dtype=np.float32)


def snap_uvs(uvs: Float32, width: int, height: int) -> Float32:
    """Round texture coordinates to what a payload holds; draw the atlas with these.

    Parameters
    ----------
    uvs, width, height
        As in :func:`encode_uvs`.

    Returns
    -------
    ndarray of shape (V, 2), float32
        Within a quarter of a texel.

    Examples
    --------
    >>> snap_uvs(np.array([[0.1, 1.0]], dtype=np.float32), 8, 4).tolist()
    [[0.125, 1.0]]
    """
    steps = _steps(width, height)
    return decode_uvs(encode_uvs(uvs, width, height), (1.0 / steps[0], 1.0 / steps[1]))


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
    texture_info = typed(surface["baseColorTexture"], dict, "baseColorTexture")
    if texture_info.get("texCoord", 0) != 0:
        raise PayloadError("baseColorTexture has another set, expected set 0")
    textures = typed(document.get("textures"), list, "textures")
    texture = typed(pick(textures, texture_info.get("index"), "texture"), dict, "texture")
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


def find_uv_scale(
    document: dict[str, Any], primitive: dict[str, Any]
) -> tuple[float, float] | None:
    """Find what texture coordinates are multiplied with.

    Parameters
    ----------
    document : dict
        One in which :func:`find_image` found an image.
    primitive : dict
        One of its primitives.

    Returns
    -------
    tuple of float, or None
        None without a transform.

    Raises
    ------
    PayloadError
        When the transform does more than scale, or not by powers of two.
    """
    material = document["materials"][primitive["material"]]
    texture_info = material["pbrMetallicRoughness"]["baseColorTexture"]
    extensions = typed(texture_info.get("extensions", {}), dict, "extensions of baseColorTexture")
    if not extensions:
        return None
    transform = typed(extensions.get(UV_TRANSFORM), dict, UV_TRANSFORM)
    scale = typed(transform.get("scale"), list, f"scale of {UV_TRANSFORM}")
    factors = [one for one in scale if isinstance(one, float | int) and not isinstance(one, bool)]
    if set(transform) != {"scale"} or len(scale) != 2 or len(factors) != 2:
        raise PayloadError(
            f"{UV_TRANSFORM} is {transform!r}, expected a scale of two numbers alone"
        )
    if not all(_LEAST_SCALE <= one <= 1.0 and math.frexp(one)[0] == 0.5 for one in factors):
        raise PayloadError(f"scale of {UV_TRANSFORM} is {scale}, expected powers of two up to 1")
    return float(factors[0]), float(factors[1])
