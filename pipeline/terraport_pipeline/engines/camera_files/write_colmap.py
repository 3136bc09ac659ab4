"""Write cameras as COLMAP's text model, which every program of the field reads.

Poses are in CRS coordinates less an offset, which ``OFFSET.txt`` beside the model states: COLMAP's
numbers should stay small.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.colmap import MODELS
from terraport_pipeline.engines.camera_files.georeference import CRS_TO_SCENE
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.model import to_crs

__all__ = ["matrix_to_quaternion", "write_colmap"]


def write_colmap(
    folder: Path,
    views: Sequence[View],
    *,
    origin: Float64,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Write ``cameras.txt``, ``images.txt``, an empty ``points3D.txt`` and ``OFFSET.txt``.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    views : sequence of View
        Scene frame. Equal lenses become one camera.
    origin : ndarray of shape (3,), float64
        E0, N0, H0 of the scene.
    offset : tuple of float
        Taken off the coordinates, metres E, N, H.

    Raises
    ------
    ValueError
        A lens that no model of COLMAP has (skew, or more terms than FULL_OPENCV).
    """
    lenses = {lens: index for index, lens in enumerate(dict.fromkeys(v.lens for v in views), 1)}
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for lens, index in lenses.items():
        model, values = _parameters(lens)
        numbers = " ".join(repr(float(value)) for value in values)
        cameras.append(f"{index} {model} {lens.width} {lens.height} {numbers}")
    images = [
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "# POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    for index, view in enumerate(views, 1):
        rotation = view.rotation @ CRS_TO_SCENE
        centre = to_crs(view.position[None], origin)[0] - np.array(offset)
        pose = (*matrix_to_quaternion(rotation), *(-rotation @ centre))
        numbers = " ".join(repr(float(value)) for value in pose)
        images += [f"{index} {numbers} {lenses[view.lens]} {view.name}", ""]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    (folder / "points3D.txt").write_text("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n")
    east, north, up = (repr(float(value)) for value in offset)
    (folder / "OFFSET.txt").write_text(f"{east} {north} {up}\n")


def matrix_to_quaternion(rotation: Float64) -> tuple[float, float, float, float]:
    """Turn a rotation into w, x, y, z with w >= 0.

    Examples
    --------
    >>> matrix_to_quaternion(np.diag([1.0, -1.0, -1.0]))
    (0.0, 1.0, 0.0, 0.0)
    """
    # the largest of four numbers decides the signs of the others, so that nothing is divided by 0
    r = rotation
    squares = np.array(
        [
            1 + r[0, 0] + r[1, 1] + r[2, 2],
            1 + r[0, 0] - r[1, 1] - r[2, 2],
            1 - r[0, 0] + r[1, 1] - r[2, 2],
            1 - r[0, 0] - r[1, 1] + r[2, 2],
        ]
    )
    rows = np.array(
        [
            [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
        ]
    )
    row = rows[int(squares.argmax())]
    row = row / np.linalg.norm(row)
    w, x, y, z = (row if row[0] >= 0.0 else -row).tolist()
    return w, x, y, z


def _parameters(lens: Lens) -> tuple[str, list[float]]:
    """Choose the smallest model that holds every term."""
    if lens.skew:
        raise ValueError("COLMAP has no model with skew")
    k = [*lens.radial, *(0.0,) * (6 - len(lens.radial))]
    d = [*lens.denominator, *(0.0,) * (3 - len(lens.denominator))]
    terms = {"fx": lens.fx, "fy": lens.fy, "cx": lens.cx, "cy": lens.cy}
    terms |= {"k1": k[0], "k2": k[1], "k3": k[2], "k4": k[3], "k5": k[4], "k6": k[5]}
    terms |= {"p1": lens.tangential[0], "p2": lens.tangential[1]}
    terms |= {"d1": d[0], "d2": d[1], "d3": d[2]}
    if lens.model == "fisheye":
        choice = ["FISHEYE", "OPENCV_FISHEYE"]
    else:
        choice = ["PINHOLE", "OPENCV", "FULL_OPENCV"]
    for model in choice:
        names = MODELS[model][1].split()
        if all(name in names or not value for name, value in terms.items()):
            return model, [terms[name] for name in names]
    raise ValueError(f"COLMAP has no model with all terms of {lens}")
