"""Which scenes there are: published, being built, unfinished, damaged."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from s3_servers import s3_environment
from store.tiny_scene import write_tiny_scene

from terraport_pipeline.upkeep.listing import SceneExtent, list_rows
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store import OriginError
from terraport_store.manifest import SurveyUnits
from terraport_store.upload import upload_scene


def test_a_folder_with_all_there_is(tmp_path: Path) -> None:
    pit = write_tiny_scene(tmp_path / "pit")
    WorkDirectory(tmp_path / ".pit.work")
    (tmp_path / ".pit.work" / "cloud.npy").write_bytes(bytes(1000))
    write_tiny_scene(tmp_path / "torn")
    (tmp_path / "torn" / "scene.json").write_text("{")
    WorkDirectory(tmp_path / ".begun.work")
    (tmp_path / ".other.work").mkdir()  # no build's
    (tmp_path / "notes").mkdir()
    with scene_locked(tmp_path / "now"):
        rows = {row.name: row for row in list_rows(tmp_path)}
    assert {name: row.state for name, row in rows.items()} == {
        "begun": "unfinished",
        "now": "being built",
        "pit": "published",
        "torn": "damaged",
    }
    row = rows["pit"]
    assert row.manifest == pit.manifest
    assert row.work is not None
    assert row.work.bytes == 1000
    assert row.bytes == sum(file.bytes for file in pit.manifest.files.values()) + (
        (pit.path / "scene.json").stat().st_size
    )
    assert row.published is not None
    assert datetime.now(UTC) - row.published < timedelta(minutes=5)
    assert rows["torn"].problem is not None
    assert list(list_rows(tmp_path)) != []
    assert "now" not in {row.name for row in list_rows(tmp_path)}


def test_a_scene_itself_and_no_folder(tmp_path: Path) -> None:
    write_tiny_scene(tmp_path / "pit")
    assert [row.name for row in list_rows(str(tmp_path / "pit"))] == ["pit"]
    with pytest.raises(FileNotFoundError):
        list(list_rows(tmp_path / "nothing"))


def test_extents_are_the_surveys(tmp_path: Path) -> None:
    manifest = write_tiny_scene(tmp_path / "pit").manifest
    metres = SceneExtent.of(manifest)
    # The patch lies 0 to 3 m east and north of its origin.
    assert metres.east == pytest.approx((500000.0, 500003.0))
    assert metres.north == pytest.approx((8000000.0, 8000003.0))
    assert str(metres) == "500000.0 8000000.0 500003.0 8000003.0 m"
    feet = SurveyUnits(horizontal_m=0.3048, height_m=0.3048)
    in_feet = SceneExtent.of(replace_units(manifest, feet))
    assert in_feet.unit == in_feet.height_unit == "ft"
    assert in_feet.east[1] == pytest.approx(500003.0 / 0.3048)


def replace_units(manifest, units):  # type: ignore[no-untyped-def]
    return manifest.model_copy(update={"survey_units": units})


def test_an_address_shows_the_same(tmp_path: Path, moto: str) -> None:
    url = f"s3://scenes/{tmp_path.name}"
    with s3_environment(moto):
        for name in ("pit", "well"):
            write_tiny_scene(tmp_path / name, seed=len(name))
            upload_scene(tmp_path / name, f"{url}/{name}")
        remote = {row.name: row for row in list_rows(url)}
        [alone] = list_rows(f"{url}/pit")
    local = {row.name: row for row in list_rows(tmp_path)}
    assert remote.keys() == local.keys() == {"pit", "well"}
    for name, row in remote.items():
        assert row.location == f"{url}/{name}"
        assert row.published is not None
        assert datetime.now(UTC) - row.published < timedelta(minutes=5)
        same = replace(row, location=local[name].location, published=local[name].published)
        assert same == local[name]
    assert alone == remote["pit"]


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins
    import sys

    monkeypatch.delitem(sys.modules, "terraport_store.object_scene", raising=False)
    imported = builtins.__import__

    def missing(name: str, *arguments, **named):  # type: ignore[no-untyped-def]
        if name.startswith("terraport_store.object_scene"):
            raise ModuleNotFoundError("No module named 'obstore'", name="obstore")
        return imported(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(OriginError, match=r"s3://b/scenes: .*pip install 'terraport\[s3\]'"):
        list(list_rows("s3://b/scenes"))
