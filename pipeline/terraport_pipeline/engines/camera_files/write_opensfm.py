"""Write cameras as OpenSfM's ``reconstruction.json`` in coordinates of the CRS less an offset.

This is the form in which OpenDroneMap leaves the file; its offset stands in the second line of
``odm_georeferencing/coords.txt``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.georeference import CRS_TO_SCENE
from terraport_pipeline.engines.camera_files.write_colmap import matrix_to_quaternion
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.model import to_crs

__all__ = ["write_opensfm"]


def write_opensfm(
    project: Path,
    views: Sequence[View],
    *,
    origin: Float64,
    offset: tuple[float, float] = (0.0, 0.0),
    crs_name: str = "unknown",
) -> None:
    """Write ``opensfm/reconstruction.json`` and ``odm_georeferencing/coords.txt``.

    Parameters
    ----------
    project : Path
        Folder of the project; made where it is not there.
    views : sequence of View
        Scene frame.
    origin : ndarray of shape (3,), float64
        E0, N0, H0 of the scene.
    offset : tuple of float
        East and north taken off the coordinates, whole metres.
    crs_name : str
        First line of ``coords.txt``, as ``"WGS84 UTM 15N"``.

    Raises
    ------
    ValueError
        A lens that OpenSfM's models brown and fisheye_opencv do not have.
    """
    lenses = {lens: f"camera {i}" for i, lens in enumerate(dict.fromkeys(v.lens for v in views))}
    shots: dict[str, Any] = {}
    for view in views:
        rotation = view.rotation @ CRS_TO_SCENE
        centre = to_crs(view.position[None], origin)[0] - np.array((*offset, 0.0))
        shots[view.name] = {
            "rotation": _rotation_vector(rotation),
            "translation": (-rotation @ centre).tolist(),
            "camera": lenses[view.lens],
            "orientation": 1,
        }
    cameras = {name: _camera(lens) for lens, name in lenses.items()}
    (project / "opensfm").mkdir(parents=True, exist_ok=True)
    (project / "odm_georeferencing").mkdir(parents=True, exist_ok=True)
    text = json.dumps([{"cameras": cameras, "shots": shots, "points": {}}], indent=1)
    (project / "opensfm" / "reconstruction.json").write_text(text)
    coords = f"{crs_name}\n{offset[0]!r} {offset[1]!r}\n"
    (project / "odm_georeferencing" / "coords.txt").write_text(coords)


def _rotation_vector(rotation: Float64) -> list[float]:
    w, *axis = matrix_to_quaternion(rotation)
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return [0.0, 0.0, 0.0]
    angle = 2.0 * float(np.arctan2(sine, w))
    return [angle * value / sine for value in axis]


def _camera(lens: Lens) -> dict[str, Any]:
    fisheye = lens.model == "fisheye"
    terms = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "k3")
    beyond = any(lens.radial[len(terms) :]) or any(lens.denominator) or lens.skew
    if beyond or (fisheye and any(lens.tangential)):
        raise ValueError(f"OpenSfM has no model with all terms of {lens}")
    side = max(lens.width, lens.height)
    radial = (*lens.radial, *(0.0,) * len(terms))
    camera = {
        "projection_type": "fisheye_opencv" if fisheye else "brown",
        "width": lens.width,
        "height": lens.height,
        "focal_x": lens.fx / side,
        "focal_y": lens.fy / side,
        "c_x": (lens.cx - 0.5 * lens.width) / side,
        "c_y": (lens.cy - 0.5 * lens.height) / side,
        **dict(zip(terms, radial, strict=False)),
    }
    if not fisheye:
        camera |= {"p1": lens.tangential[0], "p2": lens.tangential[1]}
    return camera
