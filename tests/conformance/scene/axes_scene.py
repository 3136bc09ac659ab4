"""The scene ``axes``: what is mirrored, turned or upside down shows at a glance.

Every client that has axes of its own (Unity, Unreal) draws it; the pictures must be that of the
Python SDK. On a grey plate lie or stand:

====  ============================================================================================
 id   what, in the directions of the survey
====  ============================================================================================
 0    a yellow letter F, flat on the ground: who looks down on it with north up can read it
 1    a red arrow to the east, 4 m
 2    a green arrow to the north, 6 m
 3    a blue arrow upwards, 3 m
 4    a board that faces south, with a picture: F, upper left corner red, upper right green, lower
      left blue, lower right white. Read from the south, it shows U and V
 5    the plate, light grey
====  ============================================================================================

The base mesh is the plate alone, in dark red: after a landing none of it is to be seen. Every face
has vertices of its own and the normal of its winding, so a wrong winding shows as well.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload import Cover, SegmentMesh, Texture, encode_segment
from terraport_payload.types import Float64
from terraport_store import BuildInfo, HandOff, Manifest, SceneInfo, SceneWriter, TextureInfo

__all__ = ["NAMES", "PICTURE_SIDE", "axes_meshes", "board_picture", "write_axes_scene"]

STEP_M: Final = 2.0**-10
NAMES: Final = ("letter", "east", "north", "up", "board", "plate")
"""Of the segments, by id; regions have the same."""
PICTURE_SIDE: Final = 64

Point = Float64
"""(east, up, north) in metres."""
Face = list[Point]
"""Corners, counter-clockwise seen from outside."""

YELLOW: Final = (235, 200, 40)
RED: Final = (220, 50, 40)
GREEN: Final = (50, 170, 60)
BLUE: Final = (50, 90, 220)
GREY: Final = (175, 175, 170)
DARK_RED: Final = (90, 20, 20)

FOOT: Final = np.array([1.5, 0.5, 0.0])
"""Where the three arrows begin."""


def write_axes_scene(path: Path) -> Manifest:
    """Publish the scene; the same bytes on every run of one zlib."""
    meshes = axes_meshes()
    with SceneWriter(path) as writer:
        for region, mesh in enumerate(meshes):
            writer.add_segment(encode_segment(mesh, step_m=STEP_M, scales={}), region=region)
        base = _plate(DARK_RED, region=NAMES.index("plate"))
        covered = np.full(len(base.faces), NAMES.index("plate"), dtype=np.uint32)
        cover = Cover(np.arange(len(base.faces) + 1, dtype=np.uint32), covered)
        writer.set_base(encode_segment(base, step_m=STEP_M, scales={}), cover)
        writer.set_regions({"regions": [{"id": i, "label": name} for i, name in enumerate(NAMES)]})
        picture = board_picture()
        return writer.publish(
            SceneInfo(
                name="axes",
                origin=(400_000.0, 5_000_000.0, 250.0),
                step_m=STEP_M,
                points=len(NAMES),
                regions=len(NAMES),
                has_colour=False,
                textures=TextureInfo(
                    source="photos",
                    media_types=("image/png",),
                    segments=1,
                    base_side=0,
                    max_side=PICTURE_SIDE,
                    image_bytes=len(picture),
                    texels=PICTURE_SIDE**2,
                    texel_m=4.0 / PICTURE_SIDE,
                    gsd_m=None,
                ),
                hand_off=HandOff(deviation_m=0.01, tolerance_m=0.05),
                build=BuildInfo(terraport="0.1.0"),
            )
        )


def axes_meshes() -> list[SegmentMesh]:
    """One mesh for each of `NAMES`, in the scene frame."""
    bars = (  # (east, north) from, to
        ((-5.0, 0.5), (-4.0, 6.5)),
        ((-4.0, 5.5), (-1.0, 6.5)),
        ((-4.0, 3.0), (-2.0, 4.0)),
    )
    letter = [
        face
        for (west, south), (east, north) in bars
        for face in _box((west, 0.0, south), (east, 0.4, north))
    ]
    east, up, north = np.eye(3)
    return [
        _mesh(letter, YELLOW, region=0),
        _mesh(_arrow(east, up, 4.0), RED, region=1),
        _mesh(_arrow(north, up, 6.0), GREEN, region=2),
        _mesh(_arrow(up, east, 3.0), BLUE, region=3),
        _board(),
        _plate(GREY, region=5),
    ]


def board_picture() -> bytes:
    """Return a PNG of an F whose four corners differ; its first row is the upper one."""
    half, eighth = PICTURE_SIDE // 2, PICTURE_SIDE // 8
    pixels = np.zeros((PICTURE_SIDE, PICTURE_SIDE, 3), dtype=np.uint8)
    pixels[:half, :half], pixels[:half, half:] = RED, GREEN
    pixels[half:, :half], pixels[half:, half:] = BLUE, (245, 245, 245)
    for rows, columns in (((1, 7), (2, 3)), ((1, 2), (3, 6)), ((3, 4), (3, 5))):
        area = (slice(rows[0] * eighth, rows[1] * eighth),)
        pixels[(*area, slice(columns[0] * eighth, columns[1] * eighth))] = 10

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    size = struct.pack(">IIBBBBB", PICTURE_SIDE, PICTURE_SIDE, 8, 2, 0, 0, 0)
    rows_of = b"".join(b"\0" + row.tobytes() for row in pixels)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", size)
        + chunk(b"IDAT", zlib.compress(rows_of, 9))
        + chunk(b"IEND", b"")
    )


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> list[Face]:
    """The six sides of a box given by (east, up, north)."""
    corners = [
        np.array(
            [(low, high)[bits & 1][0], (low, high)[bits >> 1 & 1][1], (low, high)[bits >> 2][2]]
        )
        for bits in range(8)
    ]
    sides = ((0, 1, 3, 2), (5, 4, 6, 7), (4, 0, 2, 6), (1, 5, 7, 3), (2, 3, 7, 6), (4, 5, 1, 0))
    return [[corners[corner] for corner in side] for side in sides]


def _arrow(along: Point, beside: Point, length_m: float) -> list[Face]:
    """A square rod from `FOOT` with a pyramid at its end."""
    across = np.cross(along, beside)
    # The cross product is taken of (east, up, north), which is left-handed; the rod is symmetrical.
    around = (beside + across, across - beside, -beside - across, beside - across)
    neck = FOOT + along * (length_m - 1.0)
    tip = FOOT + along * length_m
    faces: list[Face] = []
    for corner, other in zip(around, (*around[1:], around[0]), strict=True):
        thin, wide = 0.15, 0.4
        faces.append(
            [FOOT + corner * thin, FOOT + other * thin, neck + other * thin, neck + corner * thin]
        )
        faces.append([neck + corner * wide, neck + other * wide, tip])
        faces.append([neck + corner * wide, neck, neck + other * wide])
        faces.append([FOOT + corner * thin, FOOT, FOOT + other * thin])
    centre = (FOOT + tip) / 2
    return [_outwards(face, centre, along) for face in faces]


def _outwards(face: Face, centre: Point, along: Point) -> Face:
    """Turn the corners so that they run counter-clockwise seen from outside."""
    middle = sum(face) / len(face)
    outside = middle - centre
    normal = np.cross(_scene(face[1]) - _scene(face[0]), _scene(face[2]) - _scene(face[0]))
    # Of the rod's sides the part along it says nothing; of its ends nothing else does.
    apart = outside - along * np.dot(outside, along)
    direction = apart if np.linalg.norm(apart) > 1e-9 else outside
    flat_end = abs(np.dot(normal, _scene(along))) > 0.99 * np.linalg.norm(normal)
    if flat_end:
        direction = -along  # both flat faces look back: the rod's foot, and the head's underside
    return face if np.dot(normal, _scene(direction)) > 0 else face[::-1]


def _scene(point: Point) -> Point:
    """(east, up, north) to x, y, z of the scene frame: z points south."""
    return np.array([point[0], point[1], -point[2]])


def _mesh(faces: list[Face], colour: tuple[int, int, int], *, region: int) -> SegmentMesh:
    positions, normals, triangles = [], [], []
    for face in faces:
        start = len(positions)
        corners = [_scene(corner) for corner in face]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        positions += corners
        normals += [normal / np.linalg.norm(normal)] * len(corners)
        triangles += [(start, start + k, start + k + 1) for k in range(1, len(corners) - 1)]
    count = len(positions)
    return SegmentMesh(
        positions=np.array(positions, dtype=np.float32),
        faces=np.array(triangles, dtype=np.uint32),
        normals=np.array(normals, dtype=np.float32),
        colours=np.tile(np.array(colour, dtype=np.uint8), (count, 1)),
        region_ids=np.full(count, region, dtype=np.uint16),
    )


def _board() -> SegmentMesh:
    """Four metres square, read from the south; u runs east, v runs down."""
    west, east, low, high, north = -5.0, -1.0, 0.5, 4.5, 8.0
    places = [(west, low), (east, low), (east, high), (west, high)]
    face = [np.array([east, height, north]) for east, height in places]
    mesh = _mesh([face], GREY, region=4)
    return SegmentMesh(
        positions=mesh.positions,
        faces=mesh.faces,
        normals=mesh.normals,
        region_ids=mesh.region_ids,
        uvs=np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32),
        texture=Texture.of(board_picture()),
    )


def _plate(colour: tuple[int, int, int], *, region: int) -> SegmentMesh:
    """Ground from 8 m west to 8 m east, and from 4 m south to 10 m north."""
    round_a_tile = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0))
    faces = [
        [np.array([west + east, 0.0, south + north]) for east, north in round_a_tile]
        for west in range(-8, 8, 4)
        for south in range(-4, 10, 2)
    ]
    return _mesh(faces, colour, region=region)
