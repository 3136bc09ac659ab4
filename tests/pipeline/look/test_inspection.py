"""inspect: counts, distribution and coordinates, without reading a payload."""

from __future__ import annotations

import json
import shutil

import pytest
from store.tiny_scene import write_tiny_scene

from terraport_pipeline.inspection import inspect_scene
from terraport_store import SceneNotFoundError, change_labels


def test_counts_distribution_and_coordinates(scene_path, base) -> None:
    inspection = inspect_scene(scene_path)
    assert inspection["counts"]["segments"] == 64
    assert inspection["segments"]["faces"]["min"] == inspection["segments"]["faces"]["max"] == 1250
    assert inspection["segments"]["extent_m"]["median"] == pytest.approx(12.5, abs=0.6)
    outline = inspection["place"]["bounds_crs"]
    # The base reaches from -2.5 to 102.5 m; z runs south.
    assert outline["east"] == [499_997.5, 500_102.5]
    assert outline["north"] == [5_999_897.5, 6_000_002.5]
    assert inspection["cover"]["base_faces_never_hidden"] == 0
    assert inspection["cover"]["segments_per_base_face"]["max"] == 4
    assert sum(inspection["files"].values()) == inspection["bytes"]
    assert inspection["versions_on_disk"] == [f"v-{inspection['version'][:12]}"]
    assert json.loads(json.dumps(inspection)) == inspection
    assert inspection["counts"]["base_faces"] == len(base.faces)


def test_no_payload_is_read(scene_path, tmp_path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    pack = next(copy.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[200:] = bytes(len(data) - 200)
    pack.write_bytes(data)
    assert inspect_scene(copy) == inspect_scene(scene_path)


def test_no_scene_is_an_error(tmp_path) -> None:
    with pytest.raises(SceneNotFoundError):
        inspect_scene(tmp_path)


def test_regions_by_area_with_labels(scene_path, tmp_path) -> None:
    regions = inspect_scene(scene_path)["regions"]
    assert [row["region"] for row in regions["largest"]] == [0, 1]
    assert (regions["labelled"], regions["problem"]) == (0, None)
    tiny = write_tiny_scene(tmp_path / "tiny", stable_ids=(4, 2, 9)).path
    change_labels(tiny, {9: "haul road"})
    regions = inspect_scene(tiny)["regions"]
    assert [row["label"] for row in regions["largest"]] == ["", "bench", "haul road"]
    assert (regions["largest"][2]["stable_id"], regions["labelled"]) == (9, 2)
    (tiny / "labels.json").write_text("{}")
    assert "labels.json" in inspect_scene(tiny)["regions"]["problem"]
