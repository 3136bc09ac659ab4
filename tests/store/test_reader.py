from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from store.tiny_scene import TinyScene, add_encoding, base_cover, write_tiny_scene

from terraport_store import (
    CorruptPayloadError,
    DamagedSceneError,
    Scene,
    SceneNotFoundError,
    read_manifest,
)
from terraport_store.files import FolderFiles
from terraport_store.layout import BASE, ENCODING


def flip(path: Path, offset: int) -> None:
    with path.open("r+b") as file:
        file.seek(offset)
        byte = file.read(1)[0]
        file.seek(offset)
        file.write(bytes([byte ^ 0x40]))


def test_reads_what_was_written(tiny: TinyScene) -> None:
    with Scene.open(tiny.path) as scene:
        assert scene.manifest == tiny.manifest
        assert len(scene.index) == 4
        assert np.array_equal(scene.cover.segments, base_cover().segments)
        assert scene.regions["regions"][1] == {"id": 1, "label": "bench"}
        assert len(scene.file_mesh(BASE).faces) == 32
        for segment, payload in enumerate(tiny.payloads):
            assert bytes(scene.payload(segment)) == payload
        assert scene.within((0.1, 1.0, -0.1), 0.3).tolist() == [0]
        assert scene.within((1.5, 1.0, -1.5), 0.5).tolist() == [0, 1, 2, 3]


def test_an_encoding_that_is_not_there(tiny: TinyScene) -> None:
    with Scene.open(tiny.path) as scene:
        assert scene.index_for(ENCODING) is scene.index
        with pytest.raises(KeyError):
            scene.payload(0, "draco")


def test_an_encoding_of_a_later_version_has_its_own_index(tiny: TinyScene) -> None:
    with Scene.open(add_encoding(tiny)) as scene:
        assert scene.index_for("later") is not scene.index
        assert bytes(scene.payload(3, "later")) == tiny.payloads[3]


def test_border_vertices_of_stored_neighbours_are_bit_equal(tiny: TinyScene) -> None:
    """Segments 0 and 2 share the line x = 1.5 m; so do 1 and 3."""
    with Scene.open(tiny.path) as scene:
        meshes = [scene.mesh(segment) for segment in range(4)]
    for left, right in ((0, 2), (1, 3)):
        rows = [
            sorted(p.tobytes() for p in meshes[segment].positions if p[0] == np.float32(1.5))
            for segment in (left, right)
        ]
        assert rows[0] == rows[1]
        assert len(rows[0]) == 7


@pytest.mark.parametrize("segment", [-1, 4, 10**9])
def test_no_such_segment(tiny: TinyScene, segment: int) -> None:
    with Scene.open(tiny.path) as scene, pytest.raises(IndexError, match=f"segment {segment}"):
        scene.payload(segment)


def test_flipped_payload_byte_is_never_handed_out(tiny: TinyScene) -> None:
    """Every byte of one payload, one after the other."""
    with Scene.open(tiny.path) as scene:
        start, length = int(scene.index.offset[2]), int(scene.index.length[2])
        pack = scene.file_path("segments.pack")
    for offset in range(start, start + length, 101):
        flip(pack, offset)
        with Scene.open(tiny.path) as scene:
            with pytest.raises(CorruptPayloadError, match="segment 2 has hash") as caught:
                scene.payload(2)
            assert caught.value.segment == 2
            assert caught.value.offset == start
            assert caught.value.expected == int(scene.index.xxh3[2])
            assert len(scene.payload(1)) == int(scene.index.length[1])
            assert len(scene.payload(2, verify=False)) == length
        flip(pack, offset)
    with Scene.open(tiny.path) as scene:
        assert bytes(scene.payload(2)) == tiny.payloads[2]


def test_verified_once_and_again_on_request(tiny: TinyScene) -> None:
    """A byte flipped after the first check is found by recheck, and the segment is distrusted from
    then on."""
    with Scene.open(tiny.path) as scene:
        scene.payload(0)
        flip(scene.file_path("segments.pack"), int(scene.index.offset[0]) + 5)
        scene.payload(0)
        with pytest.raises(CorruptPayloadError):
            scene.payload(0, recheck=True)
        with pytest.raises(CorruptPayloadError):
            scene.payload(0)


def test_threads_may_read_at_once(tiny: TinyScene) -> None:
    with Scene.open(tiny.path) as scene, ThreadPoolExecutor(4) as pool:
        answers = pool.map(
            lambda n: bytes(scene.payload(n % 4)) == tiny.payloads[n % 4], range(200)
        )
        assert all(answers)


@pytest.mark.parametrize("name", ["base.cover", "segments.idx", "regions.json"])
def test_flipped_byte_in_small_files(tiny: TinyScene, name: str) -> None:
    path = tiny.path / tiny.manifest.files[name].path
    for offset in range(0, path.stat().st_size, 7):
        flip(path, offset)
        with (
            pytest.raises(DamagedSceneError, match=r"expected .* by scene\.json") as caught,
            Scene.open(tiny.path) as scene,
        ):
            _ = scene.regions
        assert caught.value.file == tiny.manifest.files[name].path
        flip(path, offset)


@pytest.mark.parametrize(
    "name", ["base.cover", "base.tsg", "regions.json", "segments.idx", "segments.pack"]
)
def test_missing_or_shortened_file_is_named(tiny: TinyScene, name: str) -> None:
    path = tiny.path / tiny.manifest.files[name].path
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 1)
    with pytest.raises(DamagedSceneError, match="expect") as caught:
        Scene.open(tiny.path)
    assert caught.value.file == tiny.manifest.files[name].path
    path.unlink()
    with pytest.raises(DamagedSceneError, match=r"no such file, expected by scene\.json") as caught:
        Scene.open(tiny.path)
    assert caught.value.file == tiny.manifest.files[name].path


def test_pack_of_another_kind_is_refused(tiny: TinyScene) -> None:
    """Two files swapped in the manifest: each whole, neither what it should be."""
    manifest = add_encoding(tiny) / "scene.json"
    document = json.loads(manifest.read_bytes())
    ours, later = (document["encodings"][name] for name in (ENCODING, "later"))
    ours["pack"], later["pack"] = later["pack"], ours["pack"]
    manifest.write_text(json.dumps(document))
    with pytest.raises(DamagedSceneError, match="expected 'segment-2'"):
        Scene.open(tiny.path)


def test_counts_must_agree(tiny: TinyScene) -> None:
    manifest = tiny.path / "scene.json"
    document = json.loads(manifest.read_bytes())
    for key, message in (("segments", "4 segments, expected 9"), ("base_faces", "32 base faces")):
        changed = json.loads(json.dumps(document))
        changed["counts"][key] = 9
        manifest.write_text(json.dumps(changed))
        with pytest.raises(DamagedSceneError, match=message):
            Scene.open(tiny.path)


def test_opened_version_outlives_newer_ones(tmp_path: Path) -> None:
    """Sessions of an old version go on even after its folder is deleted."""
    first = write_tiny_scene(tmp_path / "s", seed=0)
    with Scene.open(first.path) as scene:
        write_tiny_scene(tmp_path / "s", seed=1)
        assert scene.base_path.is_file()
        write_tiny_scene(tmp_path / "s", seed=2)
        assert not scene.base_path.exists()
        assert [bytes(scene.payload(n)) for n in range(4)] == first.payloads


def test_version_that_vanishes_while_opening(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The manifest was read, then two newer versions were published: the newest is opened."""
    write_tiny_scene(tmp_path / "s", seed=0)
    published = []
    real = Scene._open_version.__func__  # type: ignore[attr-defined]

    def late(cls: type[Scene], files: FolderFiles, manifest: object) -> Scene:
        if not published:
            published.extend(write_tiny_scene(files.directory, seed=seed) for seed in (1, 2))
        return real(cls, files, manifest)

    monkeypatch.setattr(Scene, "_open_version", classmethod(late))
    with Scene.open(tmp_path / "s") as scene:
        assert scene.manifest.version == published[-1].manifest.version


def test_no_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneNotFoundError, match=r"expected a directory with scene\.json"):
        Scene.open(tmp_path)
    with pytest.raises(SceneNotFoundError):
        read_manifest(tmp_path / "nothing")


def test_close_twice_is_fine(tiny: TinyScene) -> None:
    scene = Scene.open(tiny.path)
    scene.close()
    scene.close()
