"""A scene of rolling ground in two colours, published in 64 segments and two regions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pipeline.look.conftest import build_model, build_terrain, publish_scene

from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.ground import Ground, read_ground
from terraport_store import Scene

EAST, NORTH = 500_000.0, 6_000_000.0
UTM = 32633

FACTS: dict[str, Any] = {
    "roughness_scale_m": 4.0,
    "next_stable_id": 9,
    "regions": [{"id": 0, "stable_id": 4, "area_m2": 1.0}, {"id": 1, "stable_id": 7}],
}


def is_dark(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Where the ground is dark: a disc, and a strip along the south."""
    return (np.hypot(x - 35, z - 40) < 18) | (z > 85)


def write_named_ground(
    path: Path, *, seed: int = 0, gain: float = 1.0, facts: dict[str, Any] = FACTS
) -> Path:
    """Publish it; another seed has other noise, as the next survey has."""
    detail, base = build_terrain(160), build_terrain(21, -2.5, 102.5)
    rng = np.random.default_rng(seed)
    vertices = detail.vertices.copy()
    vertices[:, 1] += rng.normal(0, 0.01, len(vertices)).astype(np.float32)
    dark = is_dark(vertices[:, 0], vertices[:, 2])
    colours = np.where(dark[:, None], (70, 80, 95), (175, 160, 120)) * gain
    colours = np.clip(colours + rng.normal(0, 4, colours.shape), 0, 255).astype(np.uint8)
    shown = replace(detail, vertices=vertices, colours=colours)
    return publish_scene(path, build_model(shown, base), shown, base, regions=facts)


def ground_at(path: Path) -> Ground:
    with Scene.open(path) as scene:
        return read_ground(scene, NullProgress())


def plan_at(ground: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing of every face's centre, about the scene's origin."""
    return ground.centres[:, 0], -ground.centres[:, 2]


def square(x0: float, y0: float, x1: float, y1: float) -> dict[str, Any]:
    """A polygon; east and north about the scene's origin."""
    ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    coordinates = [[(EAST + x, NORTH + y) for x, y in ring]]
    return {"type": "Polygon", "coordinates": coordinates}


def line(*places: tuple[float, float]) -> dict[str, Any]:
    coordinates = [(EAST + x, NORTH + y) for x, y in places]
    return {"type": "LineString", "coordinates": coordinates}


def write_geojson(
    path: Path, features: Sequence[tuple[str | None, dict[str, Any]]], epsg: int | None = UTM
) -> Path:
    document: dict[str, Any] = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {"name": name}, "geometry": geometry}
            for name, geometry in features
        ],
    }
    if epsg is not None:
        name = f"urn:ogc:def:crs:EPSG::{epsg}"
        document["crs"] = {"type": "name", "properties": {"name": name}}
    path.write_text(json.dumps(document))
    return path


def payloads_of(path: Path) -> list[bytes]:
    with Scene.open(path) as scene:
        return [bytes(scene.payload(segment)) for segment in range(len(scene.index))]
