"""Cameras as COLMAP writes them (text), with the survey's offset beside them.

COLMAP's world is the survey's CRS minus an offset, so that its numbers stay small: x east, y north,
z up. Quaternions (w, x, y, z) turn world vectors into the camera frame (x right, y down, z
forward). PURE: returns text.

References
----------
COLMAP documentation, "Output format", https://colmap.github.io/format.html
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from terraport_pipeline.geometry.lens import View
from terraport_pipeline.model import Float64, UInt8

__all__ = ["cameras_text", "images_text", "offset_text", "points_text"]

_TO_SCENE: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""World (east, north, up) -> scene (east, up, south)."""


def cameras_text(views: Sequence[View]) -> str:
    """Return ``cameras.txt``: one OPENCV camera, which all views share."""
    lens = views[0].lens
    radial = (*lens.radial, 0.0, 0.0)[:2]
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *radial, *lens.tangential)
    return (
        "# Camera list with one line of data per camera:\n"
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        "# Number of cameras: 1\n"
        f"1 OPENCV {lens.width} {lens.height} {_spaced(numbers)}\n"
    )


def images_text(views: Sequence[View], shift: Float64) -> str:
    """Return ``images.txt``.

    Parameters
    ----------
    views : sequence of View
        In the scene frame about some origin.
    shift : ndarray of shape (3,), float64
        That origin in COLMAP's world: the origin in the CRS minus the offset.
    """
    lines = [
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "#   POINTS2D[] as (X, Y, POINT3D_ID)",
        f"# Number of images: {len(views)}, mean observations per image: 0",
    ]
    for number, view in enumerate(views, start=1):
        turn = view.rotation @ _TO_SCENE
        centre = view.position @ _TO_SCENE + shift
        place = (*_quaternion(turn), *(-turn @ centre))
        lines += [f"{number} {_spaced(place)} 1 {view.name}", ""]
    return "\n".join(lines) + "\n"


def points_text(points: Float64, colours: UInt8) -> str:
    """Return ``points3D.txt``: points (N, 3) of COLMAP's world, without tracks."""
    lines = [
        "# 3D point list with one line of data per point:",
        "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
        f"# Number of points: {len(points)}, mean track length: 0",
    ]
    for number, (place, colour) in enumerate(
        zip(points.tolist(), colours.tolist(), strict=True), start=1
    ):
        x, y, z = place
        red, green, blue = colour
        lines.append(f"{number} {x:.4f} {y:.4f} {z:.4f} {red} {green} {blue} 0")
    return "\n".join(lines) + "\n"


def offset_text(offset: Float64, epsg: int, survey: str) -> str:
    """Return ``OFFSET.txt``: how COLMAP's world lies in the CRS."""
    east, north, up = offset
    return (
        f"World = COLMAP coordinates + ({east:.6f} {north:.6f} {up:.6f}), EPSG:{epsg}, metres; "
        f"same frame as {survey}\n"
    )


def _quaternion(turn: Float64) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z), w >= 0, of a rotation matrix: its largest part first (Shepperd)."""
    trace = np.trace(turn)
    squares = np.array([trace, turn[0, 0], turn[1, 1], turn[2, 2]])
    i = int(squares.argmax())
    if i == 0:
        q = np.array(
            [1 + trace, turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
    else:
        a, b, c = i - 1, i % 3, (i + 1) % 3
        q = np.empty(4)
        q[0] = turn[c, b] - turn[b, c]
        q[1 + a] = 1 + turn[a, a] - turn[b, b] - turn[c, c]
        q[1 + b] = turn[b, a] + turn[a, b]
        q[1 + c] = turn[c, a] + turn[a, c]
    q /= np.linalg.norm(q)
    if q[0] < 0:
        q = -q
    return (float(q[0]), float(q[1]), float(q[2]), float(q[3]))


def _spaced(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
