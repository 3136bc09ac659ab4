"""The textures of a published scene, read from its payloads when a picture wants them.

Nothing is kept but sizes: an image is taken out of its payload each time it falls out of the
cache, so a scene with gigabytes of textures is drawn in the memory of the cache.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terraport_payload import PayloadError, SegmentMesh
from terraport_payload.types import Bool, Float32, Int32, UInt8
from terraport_pipeline.engines.texturing import (
    MAX_HALVINGS,
    ImageCache,
    Texturing,
    bilinear,
    decode_halved,
)
from terraport_pipeline.errors import EngineError
from terraport_store import DamagedSceneError, Scene
from terraport_store.layout import BASE

__all__ = ["SceneTextures", "TextureParts", "colours_from_texture", "open_images"]


@dataclass(frozen=True, slots=True, eq=False)
class SceneTextures:
    """Textures of both levels; images are numbered by segment, the base's comes last."""

    detail: Texturing
    base: Texturing

    def mixed(self, detail_faces: Bool, base_faces: Bool) -> Texturing:
        """Take what a mesh of some detail and some base faces needs, vertices of both in a row."""
        return Texturing(
            np.concatenate([self.detail.uvs, self.base.uvs]),
            np.concatenate(
                [self.detail.image_of_face[detail_faces], self.base.image_of_face[base_faces]]
            ),
            self.detail.images,
        )


def colours_from_texture(mesh: SegmentMesh) -> UInt8 | None:
    """Give vertices the colour of the texture there, (V, 3) sRGB.

    For whatever draws vertices only. Taken from the image at an eighth of its size: about what a
    vertex colour stands for. None without a texture, or where nothing here decodes it (KTX2).
    """
    if mesh.texture is None or mesh.uvs is None:
        return None
    try:
        image = decode_halved(mesh.texture.data, MAX_HALVINGS)
    except EngineError:
        return None
    colours: UInt8 = np.round(bilinear(image, mesh.uvs)).astype(np.uint8)
    return colours


def open_images(path: Path, version: str, sizes: Mapping[int, tuple[int, int]]) -> ImageCache:
    """Make the images of a scene available.

    Parameters
    ----------
    path : Path
        The scene directory.
    version : str
        Of the scene that was loaded.
    sizes : mapping of int to (int, int)
        Width and height by segment; the base's number follows the last segment's.
    """

    def read(image: int) -> bytes:
        with Scene.open(path) as scene:
            if scene.manifest.version != version:
                raise DamagedSceneError(
                    "scene.json", f"version {scene.manifest.version} came meanwhile; try again"
                )
            is_base = image == len(scene.index)
            try:
                mesh = scene.file_mesh(BASE) if is_base else scene.mesh(image)
            except PayloadError as error:
                raise DamagedSceneError("segments.pack", f"segment {image}: {error}") from None
        if mesh.texture is None:
            raise DamagedSceneError("segments.pack", f"segment {image}: no texture any more")
        return mesh.texture.data

    return ImageCache(read, sizes)


class TextureParts:
    """Texture coordinates of the whole detail, filled segment by segment."""

    def __init__(self, vertices: int, faces: int) -> None:
        self.uvs: Float32 = np.zeros((vertices, 2), np.float32)
        self.image_of_face: Int32 = np.full(faces, -1, np.int32)
        self.sizes: dict[int, tuple[int, int]] = {}
        """Width and height by image; of some segments where not all are loaded."""

    def add(self, image: int, mesh: SegmentMesh, vertices: slice, faces: slice) -> UInt8 | None:
        """Add a mesh; returns the vertex colours that stand for its texture, or None."""
        colours = colours_from_texture(mesh)
        if colours is None or mesh.texture is None or mesh.uvs is None:
            self.sizes[image] = (0, 0)
            return None
        self.sizes[image] = (mesh.texture.width, mesh.texture.height)
        self.uvs[vertices] = mesh.uvs
        self.image_of_face[faces] = image
        return colours
