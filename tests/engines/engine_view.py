"""A small renderer that draws triangles as an engine would: with its handedness, its rule of which
side of a face is the front, and its origin of texture coordinates.

It knows nothing of how a client turns axes. Camera and sun are given in the survey's directions
(east, up, north), and each `Convention` says where its engine has those; so a picture is right only
if the client turned the mesh by the same rule. Faces seen from behind are drawn in magenta.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import PIL.Image
import PIL.ImageDraw

from terraport_payload.types import AnyArray, UInt8

__all__ = ["CONVENTIONS", "Convention", "Drawn", "beside", "draw"]


SKY: Final = (200, 215, 230)
BACK_FACE: Final = (255, 0, 255)

EYE: Final = (-7.0, 8.5, -11.0)
"""East, up, north in metres: from the south-west, above the ground."""
LOOK_AT: Final = (0.0, 1.0, 2.5)
SUN: Final = (0.35, 0.8, -0.5)
"""Towards it: high in the south-east, so that the sides that the eye sees differ."""
FIELD_OF_VIEW_DEG: Final = 46.0


@dataclass(frozen=True)
class Convention:
    """How an engine lays out space. Sources: the engines' own documentation, see README.md."""

    name: str
    east: tuple[float, float, float]
    up: tuple[float, float, float]
    north: tuple[float, float, float]
    """What a metre in each direction is in the engine's coordinates."""
    left_handed: bool
    front_clockwise: bool
    """Whether the corners of a face seen from its front run clockwise on the screen."""
    first_row_v: float
    """v of the first row of the image file: 0 where v grows downwards, 1 where it grows upwards."""

    def to_engine(self, east_up_north: Sequence[float]) -> AnyArray:
        """Return a place or direction in the engine's coordinates."""
        axes = np.array([self.east, self.up, self.north])
        turned: AnyArray = np.asarray(east_up_north, dtype=np.float64) @ axes
        return turned


CONVENTIONS: Final = {
    # glTF and the scene frame: +Y up, right-handed; we chose x east, so z is south.
    "scene": Convention("scene", (1, 0, 0), (0, 1, 0), (0, 0, -1), False, False, 0.0),
    # Unity: left-handed, +Y up, metres; a face's front is where its corners run clockwise;
    # texture coordinates begin at the lower left.
    "unity": Convention("unity", (1, 0, 0), (0, 1, 0), (0, 0, 1), True, True, 1.0),
    # Unreal: left-handed, +Z up, centimetres, X east and Y south as in its georeferencing plugin;
    # counter-clockwise fronts; texture coordinates begin at the upper left.
    "unreal": Convention("unreal", (100, 0, 0), (0, 0, 100), (0, -100, 0), True, False, 0.0),
}


@dataclass(frozen=True)
class Drawn:
    """A mesh in an engine's coordinates."""

    positions: AnyArray
    """(V, 3)."""
    normals: AnyArray
    """(V, 3), unit."""
    faces: AnyArray
    """(F, 3)."""
    colours: AnyArray | None = None
    """(V, 3) sRGB, 0..255."""
    uvs: AnyArray | None = None
    """(V, 2)."""
    image: bytes | None = None
    """The image file."""


def draw(meshes: Iterable[Drawn], by: Convention, width: int = 400, height: int = 300) -> UInt8:
    """Return a picture (height, width, 3) of meshes in an engine's coordinates."""
    eye, target = by.to_engine(EYE), by.to_engine(LOOK_AT)
    forward = _unit(target - eye)
    up = by.to_engine((0, 1, 0))
    # In left-handed coordinates the same component arithmetic gives the other side.
    right = _unit(np.cross(up, forward) if by.left_handed else np.cross(forward, up))
    above = np.cross(forward, right) if by.left_handed else np.cross(right, forward)
    scale = height / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG) / 2)
    sun = _unit(by.to_engine(SUN))
    picture = np.empty((height, width, 3), dtype=np.uint8)
    picture[:] = SKY
    depth = np.zeros((height, width))  # of the nearest so far, inverse: 0 is infinity
    for mesh in meshes:
        seen = np.asarray(mesh.positions, dtype=np.float64) - eye
        along = seen @ forward
        x = width / 2 + scale * (seen @ right) / along
        y = height / 2 - scale * (seen @ above) / along
        light = 0.35 + 0.65 * np.maximum(np.asarray(mesh.normals) @ sun, 0.0)
        texels = None
        if mesh.image is not None:
            texels = np.asarray(PIL.Image.open(io.BytesIO(mesh.image)).convert("RGB"))
        for face in np.asarray(mesh.faces):
            _fill(picture, depth, mesh, face, (x, y, along), light, texels, by)
    return picture


def _fill(
    picture: AnyArray,
    depth: AnyArray,
    mesh: Drawn,
    face: AnyArray,
    projected: tuple[AnyArray, AnyArray, AnyArray],
    light: AnyArray,
    texels: AnyArray | None,
    by: Convention,
) -> None:
    """Draw one face, perspective-correct, by pixel centres."""
    # Behind the eye, without area, or beside the picture: nothing to draw.
    x, y, along = (values[face] for values in projected)
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if (along <= 0).any() or area == 0:
        return
    height, width = depth.shape
    left, top = max(int(np.floor(x.min())), 0), max(int(np.floor(y.min())), 0)
    end_x, end_y = min(int(np.ceil(x.max())) + 1, width), min(int(np.ceil(y.max())) + 1, height)
    if left >= end_x or top >= end_y:
        return
    # Barycentric weights of every pixel centre; 1 / depth is linear on the screen.
    px, py = np.meshgrid(np.arange(left, end_x) + 0.5, np.arange(top, end_y) + 0.5)
    weights = np.stack(
        [
            ((x[b] - px) * (y[c] - py) - (x[c] - px) * (y[b] - py)) / area
            for b, c in ((1, 2), (2, 0), (0, 1))
        ],
        axis=-1,
    )
    near = weights @ (1.0 / along)
    window = (slice(top, end_y), slice(left, end_x))
    inside = (weights >= 0).all(axis=-1) & (near > depth[window])
    if not inside.any():
        return
    share = weights[inside] / along / near[inside][:, None]
    # y runs downwards on the screen, so a positive area is clockwise to the eye.
    if (area > 0) != by.front_clockwise:
        shade: AnyArray = np.tile(BACK_FACE, (len(share), 1))
    elif texels is not None and mesh.uvs is not None:
        u, v = (share @ np.asarray(mesh.uvs)[face]).T
        down = 1.0 - v if by.first_row_v == 1.0 else v
        rows = np.clip((down * texels.shape[0]).astype(int), 0, texels.shape[0] - 1)
        columns = np.clip((u * texels.shape[1]).astype(int), 0, texels.shape[1] - 1)
        shade = texels[rows, columns] * (share @ light[face])[:, None]
    elif mesh.colours is not None:
        shade = (share @ np.asarray(mesh.colours)[face]) * (share @ light[face])[:, None]
    else:
        shade = np.tile(160.0, (len(share), 3)) * (share @ light[face])[:, None]
    picture[window][inside] = np.clip(shade, 0, 255).astype(np.uint8)
    depth[window][inside] = near[inside]


def beside(pictures: dict[str, AnyArray], path: Path) -> None:
    """Write pictures side by side with their names below, as a small PNG."""
    caption = 22
    height, width, _ = next(iter(pictures.values())).shape
    gap = 8
    sheet = PIL.Image.new(
        "RGB", (width * len(pictures) + gap * (len(pictures) - 1), height + caption), "white"
    )
    pen = PIL.ImageDraw.Draw(sheet)
    for number, (name, picture) in enumerate(pictures.items()):
        sheet.paste(PIL.Image.fromarray(picture), (number * (width + gap), 0))
        pen.text((number * (width + gap) + 4, height + 5), name, fill="black")
    sheet.quantize(128, dither=PIL.Image.Dither.NONE).save(path, optimize=True)


def _unit(vector: AnyArray) -> AnyArray:
    unit: AnyArray = vector / np.linalg.norm(vector)
    return unit
