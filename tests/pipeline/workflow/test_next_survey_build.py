"""A survey over a scene, from the file on: what changed is in payloads, regions and report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_payload import SegmentMesh
from terraport_payload.types import Float64
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.report.change_map import find_change_map
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene
from terraport_store.validate import validate_scene

SIDE_M = 48.0
PIT_M = (18.0, 20.0)
"""East and north of its middle."""
RADIUS_M, DEPTH_M = 7.0, 1.5


def flown(seed: int, *, pit: bool) -> Float64:
    """Samples of a slope, 0.3 m apart with 1 cm of noise; (N, 3) about the corner, metres."""
    rng = np.random.default_rng(seed)
    east, north = rng.uniform(0, SIDE_M, (2, round((SIDE_M / 0.3) ** 2)))
    height = 0.1 * east + 0.5 * np.sin(north / 9.0) + rng.normal(0, 0.01, len(east))
    if pit:
        height += depth(east, north)
    return np.stack([east, north, height], axis=1)


def depth(east: Float64, north: Float64) -> Float64:
    away = np.hypot(east - PIT_M[0], north - PIT_M[1])
    return -DEPTH_M * np.maximum(1 - (away / RADIUS_M) ** 2, 0)


def publish(folder: Path, points: Float64, name: str) -> Path:
    """Build the scene, or the next survey over it; the west is red, the east green."""
    survey = folder / f"{name}.xyz"
    red = np.where(points[:, 0] < 21.0, 200, 60)
    colours = np.stack([red, 260 - red, np.full(len(red), 60)], axis=1)
    rows = np.column_stack([points + np.array([500_000.0, 8_000_000.0, 100.0]), colours])
    np.savetxt(survey, rows, fmt=["%.4f"] * 3 + ["%d"] * 3)
    options = BuildOptions(
        survey, folder / "scene", threads=2, base_texture=0,
        reconstruct=reconstruct.Options(base_faces=2000),
        segment=segment.Options(min_faces=400, max_faces=3000),
    )  # fmt: skip
    assert build(options).published
    assert validate_scene(folder / "scene") == []
    return folder / "scene"


def payloads(scene: Scene) -> list[SegmentMesh]:
    return [scene.mesh(segment) for segment in range(len(scene.index))]


@pytest.fixture(scope="module")
def renewed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("renewed")
    scene = publish(folder, flown(0, pit=False), "first")
    with Scene.open(scene) as opened:
        assert "height_change_m" not in {info.name for info in opened.manifest.attributes}
        assert "change" not in opened.regions
        assert find_change_map(opened) is None
    return publish(folder, flown(1, pit=True), "second")


def test_vertices_in_the_pit_say_how_deep_it_is(renewed: Path) -> None:
    with Scene.open(renewed) as opened:
        (info,) = opened.manifest.attributes
        meshes, origin = payloads(opened), opened.manifest.origin
    assert info.name == "height_change_m"
    assert info.min == pytest.approx(-DEPTH_M, abs=0.06)
    errors, lacking = [], 0
    for mesh in meshes:
        east = mesh.positions[:, 0] + origin[0] - 500_000.0
        north = -mesh.positions[:, 2] + origin[1] - 8_000_000.0
        expected = depth(east, north)
        values = mesh.attributes.get("height_change_m")
        if values is None:
            lacking += 1
            assert (expected > -0.1).all()
            continue
        deep = expected < -0.3
        assert np.isfinite(values[deep]).all()
        errors.append(values[deep] - expected[deep])
    error = np.concatenate(errors)
    assert abs(np.median(error)) < 0.05
    assert np.percentile(np.abs(error), 95) < 0.15  # near the rim a cell holds both
    assert lacking > 0


def test_volumes_are_right_and_add_up(renewed: Path) -> None:
    with Scene.open(renewed) as opened:
        document = opened.regions
        stages = {stage["name"]: stage["counts"] for stage in opened.manifest.build.stages}
    whole = document["change"]["whole"]
    volume_m3 = np.pi * RADIUS_M**2 * DEPTH_M / 2
    assert whole["cut_m3"] == pytest.approx(volume_m3, rel=0.04)
    assert whole["cut_m3"] == pytest.approx(stages["renew"]["cut_m3"], abs=0.001)
    assert whole["uncertainty_m3"] == pytest.approx(
        stages["renew"]["volume_uncertainty_m3"], abs=0.001
    )
    regions = [row["change"] for row in document["regions"] if "change" in row]
    assert sum(row["cut_m3"] > 5.0 for row in regions) == 2  # the colours part in the pit
    pieces = [*regions, document["change"]["beyond"]]
    for name in ("cut_m3", "fill_m3", "area_m2"):
        assert sum(row[name] for row in pieces) == pytest.approx(whole[name], abs=0.01)
    assert sum(row["uncertainty_m3"] for row in pieces) >= whole["uncertainty_m3"]
    assert abs(whole["cut_m3"] - volume_m3) <= whole["uncertainty_m3"] < 0.1 * volume_m3


def test_the_report_finds_the_map(renewed: Path) -> None:
    with Scene.open(renewed) as opened:
        change = find_change_map(opened)
        origin = opened.manifest.origin
    assert change is not None
    x = np.array([PIT_M[0] + 500_000.0 - origin[0], 40.0 + 500_000.0 - origin[0]])
    z = -np.array([PIT_M[1] + 8_000_000.0 - origin[1], 40.0 + 8_000_000.0 - origin[1]])
    pit, level = change.cells_at(x, z)
    assert change.dz_m.ravel()[pit] == pytest.approx(-DEPTH_M, abs=0.1)
    assert change.counted.ravel()[[pit, level]].tolist() == [True, False]
    assert abs(change.dz_m.ravel()[pit]) > 5 * change.lod_m.ravel()[pit]
