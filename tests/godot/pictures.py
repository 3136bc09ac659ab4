"""The same landings seen from the same eyes in Godot and in the viewer, and compared.

A pixel counts as ground where all of its samples are: the viewer smooths outlines, Godot here does
not. Pictures are compared where both show ground, at half their size: there a pixel is the mean of
four, so that texels which fall to one side or the other do not count, and another colour does.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from browser.driven_viewer import DrivenViewer
from godot.engine import Engine, Visit
from PIL import Image

from terraport_payload.types import Bool, UInt8

__all__ = [
    "FAR",
    "FOV_DEG",
    "SIZE",
    "Apart",
    "Pose",
    "apart",
    "background_in_ground",
    "from_godot",
    "from_viewer",
    "poses_around",
    "read_godot",
    "visit",
]

SIZE: Final = (320, 180)
"""Of every picture, pixels."""
FOV_DEG: Final = 55.0
"""The viewer's, upright."""
FAR: Final = 24
"""Levels of 255 from which two pixels are far apart."""

READ: Final = """async (pose) => {
  glWatch.groundOnly = true;
  await terraport.look(pose);
  const gl = glWatch.context;
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const rgba = new Uint8Array(width * height * 4);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  return [width, height, ...rgba];
}"""


@dataclass(frozen=True)
class Pose:
    """Of an eye: place in the scene's frame, metres; yaw 0 looks north, degrees."""

    eye: tuple[float, float, float]
    yaw_deg: float
    pitch_deg: float


@dataclass(frozen=True)
class Apart:
    """How far two pictures are apart, where both show ground."""

    mean: float
    """Mean difference of the channels, of 255."""
    far: float
    """Share of the pixels with a channel more than `FAR` apart."""
    uncovered: float
    """Share of all pixels where one shows ground, well away from outlines, and the other none."""


def poses_around(
    place: Sequence[float], chance: random.Random, radius_m: float, count: int
) -> list[Pose]:
    """Choose eyes at a landing: at eye height on it, and above it looking down."""
    x, y, z = place
    poses = []
    for number in range(count):
        if number % 2 == 0:
            eye, pitch_deg = (x, y + 1.7, z), chance.uniform(-35, -10)
        else:
            eye = (x, y + radius_m * chance.uniform(0.5, 1.2), z + radius_m * 0.6)
            pitch_deg = chance.uniform(-70, -35)
        poses.append(Pose(eye, chance.uniform(0, 360) if number % 2 == 0 else 0.0, pitch_deg))
    return poses


def from_viewer(viewer: DrivenViewer, pose: Pose) -> tuple[UInt8, Bool]:
    """Draw one frame in the page; returns the picture (height, width, 3), and what is ground."""
    width, height, *rgba = viewer.run(
        READ, {"eye": list(pose.eye), "yawDeg": pose.yaw_deg, "pitchDeg": pose.pitch_deg}
    )
    pixels = np.array(rgba, np.uint8).reshape(height, width, 4)[::-1]
    return pixels[:, :, :3].copy(), pixels[:, :, 3] == 255


def from_godot(poses: Sequence[Pose], folder: Path, name: str) -> list[list[Any]]:
    """Return steps of a visit that draw from there into files of a folder."""
    return [
        ["look", *pose.eye, pose.yaw_deg, pose.pitch_deg, str(folder / f"{name}-{number}.png")]
        for number, pose in enumerate(poses)
    ]


def read_godot(path: Path) -> tuple[UInt8, Bool]:
    """Read a picture that a visit with ``magenta`` has written, and what of it is ground."""
    picture = np.array(Image.open(path).convert("RGB"))
    background = (picture[:, :, 0] > 250) & (picture[:, :, 1] < 5) & (picture[:, :, 2] > 250)
    return picture, ~background


def visit(engine: Engine, scene_url: str, *steps: Sequence[Any], **properties: object) -> Visit:
    """Visit with pictures of `SIZE` on a colour that no ground has."""
    width, height = SIZE
    return engine.visit(
        scene_url,
        *steps,
        width=width,
        height=height,
        magenta=True,
        fov_deg=FOV_DEG,
        **properties,
    )


def apart(first: tuple[UInt8, Bool], second: tuple[UInt8, Bool]) -> Apart:
    """Compare two pictures of the same size."""
    both = _halved(first[1] & second[1]).min(-1) == 1
    small = [_halved(picture).mean(-1) for picture, _ in (first, second)]
    difference = np.abs(small[0] - small[1])[both]
    one_alone = (_inner(first[1]) & ~second[1]) | (_inner(second[1]) & ~first[1])
    return Apart(
        float(difference.mean()) if difference.size else 0.0,
        float((difference.max(-1) > FAR).mean()) if difference.size else 0.0,
        float(one_alone.mean()),
    )


def background_in_ground(mixed: Bool, base: Bool, detail: Bool) -> int:
    """Count pixels of the background where base alone and detail alone both cover.

    Not at an outline of either: where two outlines cross, each covers a pixel by another piece of
    ground (as ``benchmarks/viewer.py`` counts holes).
    """
    return int((~mixed & _inner(base) & _inner(detail)).sum())


def _halved(values: Any) -> Any:
    """Return (height / 2, width / 2, ..., 4): the four pixels of each place, last."""
    return np.stack(
        [values[row::2, column::2].astype(np.float64) for row in (0, 1) for column in (0, 1)], -1
    )


def _inner(covered: Bool) -> Bool:
    """Return the covered pixels whose eight neighbours are covered too."""
    padded = np.pad(covered, 1, constant_values=True)
    height, width = covered.shape
    inner = covered.copy()
    for dy in range(3):
        for dx in range(3):
            inner &= padded[dy : dy + height, dx : dx + width]
    return inner
