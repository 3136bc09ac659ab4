"""Scenes of two levels: rows of the index, and what validation says of one that does not fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from server.grid_scene import SCALES, STEP_M, GridScene, tile_mesh, write_grid_scene

from terraport_payload import encode_segment
from terraport_store import PublishError, Scene, SceneWriter, validate_scene


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("levels") / "two", levels=2)


def test_rows_of_the_coarser_level_stand_behind_the_segments(two: GridScene) -> None:
    with Scene.open(two.path) as scene:
        count = scene.manifest.counts.segments
        assert (len(scene.index), len(scene.rows), scene.manifest.levels) == (count, 2 * count, 2)
        assert scene.index.face_count.sum() == scene.manifest.counts.detail_faces
        np.testing.assert_array_equal(scene.rows.bounds[count:], scene.index.bounds)
        assert (scene.rows.face_count[count:] < scene.index.face_count).all()
        for row in (0, count - 1, count, 2 * count - 1):
            assert bytes(scene.payload(row)) == two.payloads[row]
    assert validate_scene(two.path) == []


def test_a_scene_of_one_level_says_nothing_of_levels(tmp_path: Path, two: GridScene) -> None:
    one = write_grid_scene(tmp_path / "one")
    assert "levels" not in json.loads((one.path / "scene.json").read_bytes())
    assert json.loads((two.path / "scene.json").read_bytes())["levels"] == 2
    assert one.payloads == two.payloads[: len(one.payloads)]


def test_a_level_with_another_border_or_box_is_told(tmp_path: Path, two: GridScene) -> None:
    """One vertex of one border, a step away; and one box that is not the segment's."""
    count = two.manifest.counts.segments
    with Scene.open(two.path) as scene, SceneWriter(tmp_path / "bad") as writer:
        for row in range(2 * count):
            payload, box = bytes(scene.payload(row)), scene.rows.bounds[row].tolist()
            mesh = two.meshes[row]
            if row == count + 3:
                positions = mesh.positions.copy()
                corner = int(np.lexsort((positions[:, 2], positions[:, 0]))[0])
                positions[corner, 0] += STEP_M
                mesh = replace(mesh, positions=positions)
                payload = encode_segment(mesh, step_m=STEP_M, scales=SCALES)
            if row == count + 5:
                box[4] += 1.0
            writer.add_segment(
                payload,
                region=int(scene.rows.region[row]),
                bounds=box,
                vertices=len(mesh.positions),
                faces=len(mesh.faces),
            )
        base = tile_mesh(0, 0, 6, tiles=6)
        writer.set_base(
            encode_segment(base, step_m=STEP_M, scales=SCALES),
            scene.cover,
        )
        writer.set_regions(scene.regions)
        writer.publish(_info(two))
    codes = {(finding.code, finding.segment) for finding in validate_scene(tmp_path / "bad")}
    assert {("level-border", count + 3), ("level-bounds", 5)} <= codes


def test_each_segment_needs_every_level(tmp_path: Path, two: GridScene) -> None:
    with SceneWriter(tmp_path / "odd") as writer:
        for payload in two.payloads[:3]:
            writer.add_segment(payload, region=0)
        with Scene.open(two.path) as scene:
            writer.set_base(scene.base_path.read_bytes(), scene.cover)
        with pytest.raises(PublishError, match="3 payloads, expected one of each segment"):
            writer.publish(_info(two))


def _info(two: GridScene):  # type: ignore[no-untyped-def]
    from server.grid_scene import _info as info_of

    return replace(info_of("bad", 0), levels=2)
