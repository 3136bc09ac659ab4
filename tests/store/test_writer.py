from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from store.tiny_scene import (
    SCALES,
    STEP_M,
    TinyScene,
    base_cover,
    lattice_mesh,
    scene_info,
    write_tiny_scene,
)

from terraport_payload import Cover, PayloadError, decode_segment, encode_segment
from terraport_store import OutOfSpaceError, PublishError, Scene, SceneWriter, validate_scene

PAYLOAD = encode_segment(lattice_mesh(0, 0), step_m=STEP_M, scales=SCALES)
BASE = encode_segment(lattice_mesh(0, 0, 4, stride=3), step_m=STEP_M, scales=SCALES)


def files_below(path: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()
    }


def test_same_input_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_tiny_scene(tmp_path / name)
    assert files_below(tmp_path / "a") == files_below(tmp_path / "b")


def test_what_lies_in_the_directory(tiny: TinyScene) -> None:
    folder = f"v-{tiny.manifest.version[:12]}"
    names = ["base.cover", "base.tsg", "regions.json", "segments.idx", "segments.pack"]
    assert sorted(files_below(tiny.path)) == ["scene.json", *(f"{folder}/{n}" for n in names)]


def test_manifest_counts_and_limits(tiny: TinyScene) -> None:
    manifest = tiny.manifest
    assert manifest.counts.model_dump() == {
        "points": 1000,
        "base_vertices": 25,
        "base_faces": 32,
        "detail_vertices": 4 * 49,
        "detail_faces": 4 * 72,
        "segments": 4,
        "regions": 3,
    }
    assert manifest.limits.max_segment_faces == 72
    assert manifest.limits.max_segment_bytes == max(map(len, tiny.payloads))
    assert manifest.limits.max_extent_m == 1.5
    assert manifest.bounds.min[0] == 0.0
    assert manifest.bounds.max[0] == 3.0
    assert manifest.bounds.min[2] == -3.0
    assert manifest.encodings["segment-2"].payload_bytes == sum(map(len, tiny.payloads))


def test_payloads_are_aligned_and_ordered(tiny: TinyScene) -> None:
    with Scene.open(tiny.path) as scene:
        assert (scene.index.offset % 64 == 0).all()
        assert scene.index.offset[0] == 64
        assert (np.diff(scene.index.offset.astype(int)) > 0).all()
        assert scene.index.region.tolist() == [0, 1, 1, 2]


def test_given_shape_equals_decoded_shape(tmp_path: Path) -> None:
    mesh = decode_segment(PAYLOAD, scales=SCALES)
    box = [*mesh.positions.min(axis=0).tolist(), *mesh.positions.max(axis=0).tolist()]
    versions = []
    for name, shape in (
        ("decoded", {}),
        ("given", {"bounds": box, "vertices": len(mesh.positions), "faces": len(mesh.faces)}),
    ):
        with SceneWriter(tmp_path / name) as writer:
            assert writer.add_segment(PAYLOAD, region=0, **shape) == 0  # type: ignore[arg-type]
            writer.set_base(
                BASE, Cover(np.zeros(33, dtype=np.uint32), np.zeros(0, dtype=np.uint32))
            )
            versions.append(writer.publish(scene_info()).version)
    assert versions[0] == versions[1]


def test_leaving_without_publishing_leaves_nothing(tmp_path: Path) -> None:
    with SceneWriter(tmp_path / "new") as writer:
        writer.add_segment(PAYLOAD, region=0)
    assert list(tmp_path.iterdir()) == []


def test_an_error_inside_leaves_the_old_version(tiny: TinyScene) -> None:
    before = files_below(tiny.path)

    def fail() -> None:
        with SceneWriter(tiny.path) as writer:
            writer.add_segment(PAYLOAD, region=0)
            writer.set_base(BASE, base_cover())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert files_below(tiny.path) == before


def test_publishing_again_keeps_the_version_before(tmp_path: Path) -> None:
    path = tmp_path / "s"
    versions = [write_tiny_scene(path, seed=seed).manifest.version[:12] for seed in range(4)]
    folders = sorted(p.name for p in path.iterdir() if p.is_dir())
    assert folders == sorted(f"v-{version}" for version in versions[-2:])
    assert validate_scene(path) == []


def test_publishing_the_same_again_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "s"
    write_tiny_scene(path, seed=0)
    write_tiny_scene(path, seed=1)
    before = files_below(path)
    write_tiny_scene(path, seed=1)
    assert files_below(path) == before


def test_publishing_the_same_over_a_damaged_version_heals_it(tiny: TinyScene) -> None:
    pack = tiny.path / tiny.manifest.files["segments.pack"].path
    data = bytearray(pack.read_bytes())
    data[100] ^= 1
    pack.write_bytes(bytes(data))
    assert validate_scene(tiny.path) != []
    again = write_tiny_scene(tiny.path)
    assert again.manifest.version == tiny.manifest.version
    assert again.manifest.folder == f"{tiny.manifest.folder}-1"
    assert validate_scene(tiny.path) == []


def test_unreadable_manifest_is_replaced(tiny: TinyScene) -> None:
    (tiny.path / "scene.json").write_text("garbage")
    write_tiny_scene(tiny.path, seed=1)
    assert validate_scene(tiny.path) == []


def test_foreign_files_are_left_alone(tiny: TinyScene) -> None:
    (tiny.path / "report.html").write_text("<p>")
    (tiny.path / "v-mine").mkdir()
    for seed in (1, 2):
        write_tiny_scene(tiny.path, seed=seed)
    assert (tiny.path / "report.html").exists()
    assert (tiny.path / "v-mine").exists()


def test_without_regions_there_is_an_empty_table(tmp_path: Path) -> None:
    with SceneWriter(tmp_path / "s") as writer:
        writer.add_segment(PAYLOAD, region=0)
        writer.set_base(BASE, Cover(np.zeros(33, dtype=np.uint32), np.zeros(0, dtype=np.uint32)))
        manifest = writer.publish(scene_info())
    assert json.loads((tmp_path / "s" / manifest.files["regions.json"].path).read_text()) == {
        "regions": []
    }


def test_refuses_misuse(tmp_path: Path) -> None:
    with SceneWriter(tmp_path / "s") as writer:
        with pytest.raises(PublishError, match="0 segments and no base, expected at least one"):
            writer.publish(scene_info())
        with pytest.raises(PayloadError, match="expected at least 12"):
            writer.add_segment(b"x", region=0)
        with pytest.raises(PublishError, match="cover of 0 base faces, expected 32"):
            writer.set_base(BASE, Cover(np.zeros(1, dtype=np.uint32), np.zeros(0, dtype=np.uint32)))
        with pytest.raises(PublishError, match="regions are not JSON"):
            writer.set_regions({"regions": [float("nan")]})
        writer.add_segment(PAYLOAD, region=0)
        writer.set_base(BASE, base_cover())
        with pytest.raises(PublishError, match="base set twice"):
            writer.set_base(BASE, base_cover())
        with pytest.raises(PublishError, match="cover names segment 3, expected below 1"):
            writer.publish(scene_info())
    with pytest.raises(PublishError, match="the writer is closed"):
        writer.add_segment(PAYLOAD, region=0)
    assert list(tmp_path.iterdir()) == []


def test_parent_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(PublishError, match="expected one for the scene to stand in"):
        SceneWriter(tmp_path / "no" / "scene")


def test_too_little_space_is_said_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(OutOfSpaceError, match=r"bytes free at .*, expected at least") as caught:
        SceneWriter(tmp_path / "s", expected_bytes=1 << 60)
    assert caught.value.needed_bytes == (1 << 60) + (1 << 20)
    assert caught.value.free_bytes is not None
    assert list(tmp_path.iterdir()) == []
