"""Walks that everybody goes alike: made over a scene, or taken from a live session's log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.published.landing_view import choose_landing
from terraport_pipeline.published.scene_model import WHOLE_FACES, SceneModel, load_scene_model
from terraport_research.study.measures import between_landings
from terraport_research.study.session_log import MAX_LOG_BYTES, SessionLog, read_log
from terraport_store import Scene

__all__ = ["made_walk", "read_walk", "walk_of_log"]

EYE_HEIGHT_M: Final = 1.7
_STEP_S: Final = 0.1
_TURN_DEG_S: Final = 45.0
_WALK_M_S: Final = 1.4
_NOD_DEG: Final = 12.0
_NOD_PERIOD_S: Final = 3.0
_LEGS: Final = ((0.0, 0.0), (0.35, 0.2), (-0.25, 0.35))
"""Places of the landings beside the first, in radii east and south."""


def made_walk(scene_path: Path, radius_m: float, seconds: float) -> dict[str, Any]:
    """Make a walk of three landings over a scene.

    After each landing the head turns, nodding, for half of the time, then walks ahead in a bow.
    The same scene gives the same walk.

    Parameters
    ----------
    scene_path : Path
        Of a built scene.
    radius_m : float
        Of the landings.
    seconds : float
        After each landing.

    Raises
    ------
    SurveyError
        The scene is too large to be looked at whole.
    """
    with Scene.open(scene_path) as scene:
        faces = scene.manifest.counts.detail_faces
        if faces > WHOLE_FACES:
            raise SurveyError(
                f"{scene_path} has {faces:,} faces, expected at most {WHOLE_FACES:,}: record a "
                "walk, and give its log with --walk"
            )
        model = load_scene_model(scene)
    rays = RayScene(model.detail.vertices, model.detail.faces)
    first = choose_landing(model, rays).position
    legs = []
    for east, south in _LEGS:
        place = (first[0] + east * radius_m, first[2] + south * radius_m)
        ground = _ground(model, rays, *place)
        if ground is not None:
            legs.append(_leg((place[0], ground, place[1]), radius_m, seconds, model, rays))
    return {"form": 1, "scene": scene_path.name, "legs": legs}


def _leg(
    position: tuple[float, float, float],
    radius_m: float,
    seconds: float,
    model: SceneModel,
    rays: RayScene,
) -> dict[str, Any]:
    poses = []
    x, y, z = position
    yaw = 0.0
    for step in range(round(seconds / _STEP_S) + 1):
        t = step * _STEP_S
        turns = t < seconds / 2
        yaw += _TURN_DEG_S * _STEP_S * (1.0 if turns else 0.4)
        if not turns:
            # Ahead, slower than it looks: nobody walks off the edge of the ground.
            ahead = np.radians(yaw)
            next_x = x + np.sin(ahead) * _WALK_M_S * _STEP_S
            next_z = z - np.cos(ahead) * _WALK_M_S * _STEP_S
            ground = _ground(model, rays, next_x, next_z)
            if ground is not None and abs(ground - y) < 1.0:
                x, y, z = float(next_x), ground, float(next_z)
        pitch = -6.0 + _NOD_DEG * np.sin(2 * np.pi * t / _NOD_PERIOD_S)
        row = (t, x, y + EYE_HEIGHT_M, z, yaw % 360.0, float(pitch))
        poses.append([round(value, 3) for value in row])
    return {"position": list(position), "radius_m": radius_m, "poses": poses}


def _ground(model: SceneModel, rays: RayScene, x: float, z: float) -> float | None:
    """Height of the highest ground at a place; None where there is none."""
    top = float(model.detail.vertices[:, 1].max()) + 1.0
    distance, face = rays.closest_hit(np.array([[x, top, z]]), np.array([[0.0, -1.0, 0.0]]))
    return top - float(distance[0]) if face[0] >= 0 else None


def walk_of_log(log: SessionLog) -> dict[str, Any]:
    """Take the walk out of a live session: what the head did after each landing.

    Raises
    ------
    SurveyError
        Nobody landed in it.
    """
    time, inside = log.frames["t_ms"], between_landings(log)
    keys = ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg")
    legs = []
    for number, landing in enumerate(log.landings):
        if landing.arrived_ms is None:
            continue
        later = log.landings[number + 1 :]
        end = later[0].asked_ms if later else np.inf
        rows = inside & (time > landing.arrived_ms) & (time < end)
        if not rows.any():
            continue
        seconds = (time[rows] - landing.arrived_ms) / 1000.0
        poses = np.stack([seconds, *(log.frames[key][rows] for key in keys)], axis=1)
        legs.append(
            {
                "position": list(landing.position),
                "radius_m": landing.radius_m,
                "poses": np.round(poses, 3).tolist(),
            }
        )
    if not legs:
        raise SurveyError(f"{log.name}: no landing was shown in it, so there is no walk")
    return {"form": 1, "scene": log.scene, "legs": legs}


def read_walk(path: Path) -> dict[str, Any]:
    """Read a walk, or a log and take the walk out of it.

    Raises
    ------
    SurveyError
        It is neither.
    """
    try:
        if path.stat().st_size > MAX_LOG_BYTES:
            raise SurveyError(f"{path} is larger than {MAX_LOG_BYTES:,} bytes")
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SurveyError(f"{path} cannot be read as a walk: {error}") from error
    if isinstance(document, dict) and "legs" in document:
        return document  # the page checks what is in it
    return walk_of_log(read_log(path))
