"""A scene of one flat square whose colours are an image: what exports of textures are tried on."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from terraport_payload import Cover, SegmentMesh, Texture, encode_segment
from terraport_payload.types import UInt8
from terraport_store import BuildInfo, CrsInfo, HandOff, SceneInfo, SceneWriter, TextureInfo

SIDE_M: Final = 8.0
ORIGIN: Final = (500_000.0, 6_000_000.0, 120.0)
"""Of the scene; the square lies east and south of it, at its height."""


def quadrants(side: int = 64) -> UInt8:
    """Four colours, one in each quarter of the image."""
    image = np.empty((side, side, 3), np.uint8)
    half = side // 2
    image[:half, :half], image[:half, half:] = (200, 40, 30), (30, 180, 50)
    image[half:, :half], image[half:, half:] = (40, 60, 210), (230, 220, 60)
    return image


def png(image: UInt8) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG")
    return buffer.getvalue()


def write_square(path: Path, *, sliver: bool = False) -> bytes:
    """Publish the square; return its image file.

    With a sliver: a triangle of which two corners are at one place.
    """
    corners = np.array([[0, 0, 0], [0, 0, SIDE_M], [SIDE_M, 0, SIDE_M], [SIDE_M, 0, 0]], np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    data = png(quadrants())
    places, triangles = corners, faces
    if sliver:
        places = np.concatenate([corners, corners[:1]])
        triangles = np.concatenate([faces, np.array([[0, 4, 2]], np.uint32)])
    # The image's upper left is the square's north-west.
    mesh = SegmentMesh(
        places,
        triangles,
        np.resize(up, places.shape),
        region_ids=np.zeros(len(places), np.uint16),
        uvs=places[:, [0, 2]] / np.float32(SIDE_M),
        texture=Texture.of(data),
    )
    base = SegmentMesh(corners, faces, up, np.full((4, 3), 120, np.uint8))
    with SceneWriter(path) as writer:
        writer.add_segment(encode_segment(mesh, step_m=2.0**-10, scales={}), region=0)
        writer.set_base(
            encode_segment(base, step_m=2.0**-10, scales={}),
            Cover(np.array([0, 1, 2], np.uint32), np.array([0, 0], np.uint32)),
        )
        writer.set_regions({"regions": [{"id": 0}]})
        writer.publish(
            SceneInfo(
                name="square",
                origin=ORIGIN,
                step_m=2.0**-10,
                points=4,
                regions=1,
                hand_off=HandOff(deviation_m=0.0, tolerance_m=1.0),
                build=BuildInfo(terraport="0.1.0"),
                has_colour=False,
                crs=CrsInfo(name="WGS 84 / UTM zone 33N", epsg=32633),
                textures=TextureInfo(
                    source="photos", media_types=("image/png",), segments=1, base_side=0,
                    max_side=64, image_bytes=len(data), texels=64 * 64, texel_m=SIDE_M / 64,
                ),
            )
        )  # fmt: skip
    return data
