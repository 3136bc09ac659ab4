"""Uploads: whole or not at all, in the right order, resumed, pruned."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from s3_servers import Fault, FaultProxy, ProxiedRequest, s3_environment
from store.tiny_scene import TinyScene, write_tiny_scene

from terraport_store import DamagedSceneError, OriginError, Scene, SceneNotFoundError, change_labels
from terraport_store import upload as upload_module
from terraport_store.origin import ObjectOptions
from terraport_store.upload import upload_scene


@pytest.fixture
def proxy(moto: str) -> Iterator[FaultProxy]:
    with FaultProxy(moto) as between, s3_environment(between.url):
        yield between


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"s3://scenes/{tmp_path.name}/tiny"


def puts(proxy: FaultProxy) -> list[str]:
    return [
        request.path.rpartition("/")[2] for request in proxy.requests if request.method == "PUT"
    ]


def test_the_manifest_goes_last(proxy: FaultProxy, url: str, tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "t", stable_ids=(4, 2, 9))
    change_labels(scene.path, {2: "bench"})
    (scene.path / "report.html").write_text("<p>fine</p>")
    (scene.path / "report.pdf").write_bytes(b"%PDF-")
    done: list[int] = []
    report = upload_scene(scene.path, url, progress=lambda _path, _now, all_: done.append(all_))
    sent = puts(proxy)
    assert sent[-4:] == ["labels.json", "report.html", "report.pdf", "scene.json"]
    assert set(sent[:-4]) == set(scene.manifest.files)
    assert done[-1] == sum(file.bytes for file in scene.manifest.files.values())
    assert (report.sent_files, report.kept_files) == (len(sent) - 1, 0)


def test_where_nobody_answers_it_fails_within_seconds(tiny: TinyScene) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"http://127.0.0.1:{probe.getsockname()[1]}"
    began_s = time.monotonic()
    with (
        s3_environment(),
        pytest.raises(OriginError, match=rf"nothing answers at {endpoint}, expected .* tries in"),
    ):
        upload_scene(tiny.path, "s3://scenes/tiny", ObjectOptions(endpoint=endpoint))
    assert time.monotonic() - began_s < 15


def test_what_is_there_is_not_sent_again(proxy: FaultProxy, url: str, tiny: TinyScene) -> None:
    refused = {"segments.pack"}  # the largest, which comes last

    def rule(request: ProxiedRequest) -> Fault | None:
        name = request.path.rpartition("/")[2]
        return Fault(status=403) if request.method == "PUT" and name in refused else None

    proxy.rule = rule
    with pytest.raises(OriginError, match=r"segments\.pack"):
        upload_scene(tiny.path, url)
    assert "scene.json" not in puts(proxy)
    with pytest.raises(SceneNotFoundError):
        Scene.open(url)
    refused.clear()
    proxy.requests.clear()
    report = upload_scene(tiny.path, url)
    assert "base.tsg" not in puts(proxy)
    assert puts(proxy)[-1] == "scene.json"
    assert report.kept_files >= 3
    with Scene.open(url) as scene:
        assert bytes(scene.payload(0)) == tiny.payloads[0]


def test_a_part_that_fails_is_sent_again(
    proxy: FaultProxy, url: str, tiny: TinyScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pack large enough for several parts, as S3 has it: 5 MiB at least."""
    pad = 64 << 10
    scene = write_tiny_scene(tiny.path, copies=1, image=None)
    monkeypatch.setattr(upload_module, "PART_BYTES", pad)
    failed: list[str] = []

    def rule(request: ProxiedRequest) -> Fault | None:
        if request.method == "PUT" and not failed:
            failed.append(request.path)
            return Fault(status=503)
        return None

    proxy.rule = rule
    upload_scene(scene.path, url)
    assert failed
    with Scene.open(url) as opened:
        assert [bytes(opened.payload(n)) for n in range(4)] == scene.payloads


@pytest.mark.parametrize("name", ["report.html", "labels.json", "segments.pack"])
def test_what_lies_beside_a_scene_is_not_uploaded(
    proxy: FaultProxy, url: str, tiny: TinyScene, tmp_path: Path, name: str
) -> None:
    """A link out of it would publish whatever the uploading user may read."""
    path = tiny.path / (tiny.manifest.files[name].path if "pack" in name else name)
    path.unlink(missing_ok=True)
    (tmp_path / "secret").write_text("secret")
    path.symlink_to(tmp_path / "secret")
    with pytest.raises((DamagedSceneError, PermissionError), match="leads out of the scene"):
        upload_scene(tiny.path, url)
    assert "scene.json" not in puts(proxy)


def test_a_damaged_file_is_not_published(
    proxy: FaultProxy, url: str, tiny: TinyScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    pack = tiny.path / tiny.manifest.files["segments.pack"].path
    data = bytearray(pack.read_bytes())
    data[-1] ^= 1
    pack.write_bytes(data)
    for part_bytes in (8 << 20, 1 << 12):
        monkeypatch.setattr(upload_module, "PART_BYTES", part_bytes)
        with pytest.raises(DamagedSceneError, match=r"segments\.pack: hash .* by scene\.json"):
            upload_scene(tiny.path, url)
    assert "scene.json" not in puts(proxy)


def test_old_versions_go_when_asked(proxy: FaultProxy, url: str, tmp_path: Path) -> None:
    scenes = [write_tiny_scene(tmp_path / str(seed), seed=seed) for seed in range(3)]
    folders = [scene.manifest.folder for scene in scenes]
    for scene in scenes[:2]:
        assert upload_scene(scene.path, url).removed_versions == ()
    report = upload_scene(scenes[2].path, url, prune=True)
    assert report.removed_versions == (folders[0],)
    with Scene.open(url) as opened:
        assert opened.manifest == scenes[2].manifest


def test_no_scene(url: str, tmp_path: Path) -> None:
    with pytest.raises(SceneNotFoundError):
        upload_scene(tmp_path, url)
