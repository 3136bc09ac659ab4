"""Meshes that the look tests share: a rolling terrain at two resolutions, in tiles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terraport_payload import AttributeScale, Cover, SegmentMesh, encode_segment
from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.published.mixed_model import HandOffModel
from terraport_store import (
    AttributeInfo,
    BuildInfo,
    CrsInfo,
    HandOff,
    InputInfo,
    SceneInfo,
    SceneWriter,
)


def terrain_height(x: Float64, z: Float64) -> Float64:
    """Rolling ground with a bench: heights in metres over a 100 m square."""
    bench = 6.0 / (1.0 + np.exp(-(x - 60.0) / 1.5))
    return (
        bench + 2.0 * np.sin(x / 9.0) * np.cos(z / 11.0) + 0.15 * np.sin(x * 1.3) * np.sin(z * 1.1)
    )


@dataclass(frozen=True)
class Terrain:
    """One grid mesh; scene frame, metres."""

    vertices: Float32
    faces: Int32
    colours: UInt8


def build_terrain(cells: int, low: float = 0.0, high: float = 100.0) -> Terrain:
    """Sample the ground on (cells + 1)^2 vertices over [low, high]^2."""
    line = np.linspace(low, high, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = terrain_height(x, z)
    index = np.arange((cells + 1) ** 2, dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    shade = np.clip((y + 2) / 10, 0, 1)[..., None]
    colours = (np.array([150, 120, 90]) * (0.5 + 0.5 * shade)).astype(np.uint8)
    return Terrain(
        np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), faces, colours.reshape(-1, 3)
    )


@pytest.fixture(scope="session")
def detail() -> Terrain:
    """The ground at 0.5 m."""
    return build_terrain(200)


@pytest.fixture(scope="session")
def base() -> Terrain:
    """The ground at 5 m, 2 m larger on each side so that it covers the detail."""
    return build_terrain(21, -2.5, 102.5)


TILES = 8
"""The detail's segments are TILES x TILES squares."""


def build_model(
    detail: Terrain, base: Terrain, *, grow_m: float = 1.0, tolerance_m: float = 1.0
) -> HandOffModel:
    """Cut the detail into square segments; a base face's cover are the squares its box touches.

    ``grow_m`` widens the base face's box; a negative one makes a wrong cover.
    """
    size = 100.0 / TILES
    centre = detail.vertices[detail.faces].mean(axis=1)
    cell = np.clip(centre[:, [0, 2]] // size, 0, TILES - 1).astype(np.int32)
    segment = cell[:, 0] * TILES + cell[:, 1]
    corner = base.vertices[base.faces][:, :, [0, 2]]
    low = np.maximum(np.floor((corner.min(axis=1) - grow_m) / size), 0).astype(int)
    high = np.minimum(np.floor((corner.max(axis=1) + grow_m) / size), TILES - 1).astype(int)
    covers = [
        [x * TILES + z for x in range(x0, x1 + 1) for z in range(z0, z1 + 1)]
        for (x0, z0), (x1, z1) in zip(low, high, strict=True)
    ]
    offsets = np.concatenate([[0], np.cumsum([len(cover) for cover in covers])])
    return HandOffModel(
        detail.vertices,
        detail.faces,
        segment.astype(np.int32),
        TILES * TILES,
        base.vertices,
        base.faces,
        offsets.astype(np.uint32),
        np.array([s for cover in covers for s in cover], dtype=np.uint32),
        tolerance_m,
    )


@pytest.fixture(scope="session")
def model(detail: Terrain, base: Terrain) -> HandOffModel:
    """Both levels with a right cover."""
    return build_model(detail, base)


@pytest.fixture(scope="session")
def make_terrain() -> Callable[..., Terrain]:
    """Sample the ground anew; see :func:`build_terrain`."""
    return build_terrain


@pytest.fixture(scope="session")
def make_model() -> Callable[..., HandOffModel]:
    """Cut into segments; see :func:`build_model`."""
    return build_model


STEP_M = 2.0**-10
GRADE = AttributeScale(offset=0.0, step=1e-4)


def publish_scene(
    path: Path,
    model: HandOffModel,
    detail: Terrain,
    base: Terrain,
    *,
    regions: dict[str, Any] | None = None,
    stages: tuple[dict[str, Any], ...] = (),
) -> Path:
    """Publish a model as a scene with two regions, an attribute, a CRS and a warning."""
    normals = np.tile(np.float32([0, 1, 0]), (len(detail.vertices), 1))
    with SceneWriter(path) as writer:
        for segment in range(model.segment_count):
            faces = model.detail_faces[model.segment_of_face == segment]
            used, local = np.unique(faces, return_inverse=True)
            positions = detail.vertices[used]
            # A bench face is one region, the flats the other, split by where the tile lies.
            region = int(positions[:, 0].mean() > 60)
            mesh = SegmentMesh(
                positions,
                local.reshape(-1, 3).astype(np.uint32),
                normals[used],
                detail.colours[used],
                np.full(len(used), region, np.uint16),
                {"grade": np.clip(positions[:, 0] / 100, 0, 1)},
            )
            payload = encode_segment(mesh, step_m=STEP_M, scales={"grade": GRADE})
            writer.add_segment(payload, region=region)
        # The base keeps the order of its faces: the cover is by face.
        level = SegmentMesh(
            base.vertices,
            base.faces.astype(np.uint32),
            np.tile(np.float32([0, 1, 0]), (len(base.vertices), 1)),
            base.colours,
        )
        writer.set_base(
            encode_segment(level, step_m=STEP_M, scales={}, may_be_wide=True),
            Cover(model.cover_offsets.astype(np.uint32), model.cover_segments.astype(np.uint32)),
        )
        writer.set_regions(regions or {"regions": [{"id": 0}, {"id": 1}]})
        writer.publish(
            SceneInfo(
                name="rolling <ground>",
                origin=(500_000.0, 6_000_000.0, 120.0),
                step_m=STEP_M,
                points=123_456,
                regions=2,
                hand_off=HandOff(deviation_m=0.3, tolerance_m=model.tolerance_m),
                build=BuildInfo(
                    terraport="0.1.0",
                    options={"seed": 7},
                    input=InputInfo(name="ground.laz", bytes=9_999, xxh3="0" * 16),
                    warnings=("12 points were outliers",),
                    stages=stages,
                ),
                crs=CrsInfo(name="WGS 84 / UTM zone 33N", epsg=32633),
                attributes=(
                    AttributeInfo(
                        name="grade", gltf_name="_GRADE", offset=0.0, step=1e-4, min=0.0, max=1.0
                    ),
                ),
            )
        )
    return path


@pytest.fixture(scope="session")
def scene_path(
    tmp_path_factory: pytest.TempPathFactory, model: HandOffModel, detail: Terrain, base: Terrain
) -> Path:
    """A published scene; tests must not change it (copy it first)."""
    return publish_scene(tmp_path_factory.mktemp("scenes") / "ground", model, detail, base)


@pytest.fixture(scope="session")
def write_scene() -> Callable[..., Path]:
    """Publish another model; see :func:`publish_scene`."""
    return publish_scene
