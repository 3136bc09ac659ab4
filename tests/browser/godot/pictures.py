"""The same landings seen from the same eyes in Godot and in the viewer, and compared.

A pixel counts as ground where all of its samples are: the viewer smooths outlines, Godot here does
not. Pictures are compared where both show ground, at half their size: there a pixel is the mean of
four, so that texels which fall to one side or the other do not count, and another colour does.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from browser.driven_viewer import DrivenViewer

from terraport_payload.types import Bool, UInt8

__all__ = ["SIZE", "Apart", "Pose", "apart", "from_viewer", "ground_of", "inner", "poses_around"]

SIZE: Final = (320, 180)
"""Of every picture, pixels."""
FAR: Final = 24
"""Levels of 255 from which two pixels are far apart."""

_READ: Final = """async (pose) => {
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


def poses_around(place: Sequence[float], chance: random.Random, radius_m: float) -> list[Pose]:
    """Choose two eyes at a landing: at eye height on it, and above it looking down."""
    x, y, z = place
    high = (x, y + radius_m * chance.uniform(0.5, 1.2), z + radius_m * 0.6)
    return [
        Pose((x, y + 1.7, z), chance.uniform(0, 360), chance.uniform(-35, -10)),
        Pose(high, 0.0, chance.uniform(-70, -35)),
    ]


def from_viewer(viewer: DrivenViewer, pose: Pose) -> tuple[UInt8, Bool]:
    """Draw one frame in the page; returns the picture (height, width, 3), and what is ground."""
    width, height, *rgba = viewer.run(
        _READ, {"eye": list(pose.eye), "yawDeg": pose.yaw_deg, "pitchDeg": pose.pitch_deg}
    )
    pixels = np.array(rgba, np.uint8).reshape(height, width, 4)[::-1]
    return pixels[:, :, :3].copy(), pixels[:, :, 3] == 255


def ground_of(picture: UInt8) -> Bool:
    """Return what is not the driver's background, a colour that no ground has."""
    return ~((picture[:, :, 0] > 250) & (picture[:, :, 1] < 5) & (picture[:, :, 2] > 250))


def apart(first: tuple[UInt8, Bool], second: tuple[UInt8, Bool]) -> Apart:
    """Compare two pictures of the same size."""
    both = _halved(first[1] & second[1]).min(-1) == 1
    small = [_halved(picture).mean(-1) for picture, _ in (first, second)]
    difference = np.abs(small[0] - small[1])[both]
    one_alone = (inner(first[1]) & ~second[1]) | (inner(second[1]) & ~first[1])
    return Apart(
        float(difference.mean()) if difference.size else 0.0,
        float((difference.max(-1) > FAR).mean()) if difference.size else 0.0,
        float(one_alone.mean()),
    )


def inner(covered: Bool) -> Bool:
    """Return the covered pixels whose eight neighbours are covered too."""
    padded = np.pad(covered, 1, constant_values=True)
    height, width = covered.shape
    result = covered.copy()
    for dy in range(3):
        for dx in range(3):
            result &= padded[dy : dy + height, dx : dx + width]
    return result


def _halved(values: Any) -> Any:
    """Return (height / 2, width / 2, ..., 4): the four pixels of each place, last."""
    return np.stack(
        [values[row::2, column::2].astype(np.float64) for row in (0, 1) for column in (0, 1)], -1
    )
