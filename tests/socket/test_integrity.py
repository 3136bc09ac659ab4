"""Bytes that went bad on disk, and scenes that change, while clients are connected."""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from server.grid_scene import GridScene, write_grid_scene
from server.plain_client import PlainClient, assemble

from terraport_payload.types import UInt64
from terraport_server import BackgroundServer
from terraport_store import Scene
from terraport_wire import Credit, Error, Notice, Pick, Picked, Plan, Ready

HERE = (30.0, 1.0, 30.0)


EVERYWHERE_M = 100.0


def landed(client: PlainClient, generation: int) -> tuple[list[int], dict[int, bytes]]:
    """Land without anything; return what is missing and the payloads by segment."""
    client.land(generation, HERE, EVERYWHERE_M)
    ready, pieces, _ = client.until(Ready)
    return client.missing(ready), assemble(pieces)


def flip(path: Path, segment: int, *, at: int = 40) -> None:
    """Flip one bit of one segment's payload in the pack, in place."""
    with Scene.open(path) as scene:
        offset = int(scene.index.offset[segment]) + at
        pack = scene.file_path(scene.manifest.encodings["segment-2"].pack)
    with pack.open("r+b") as file:
        file.seek(offset)
        byte = file.read(1)[0]
        file.seek(offset)
        file.write(bytes([byte ^ 0x10]))


def keys_of(scene: GridScene, *segments: int) -> UInt64:
    """Return the keys of some segments."""
    with Scene.open(scene.path) as opened:
        return opened.index.xxh3[[*segments]]


@pytest.fixture
def own(tmp_path: Path) -> GridScene:
    """A scene that a test may damage or publish anew."""
    return write_grid_scene(tmp_path / "scenes" / "own")


def test_a_flipped_byte_is_found_reported_and_never_sent(
    own: GridScene, caplog: pytest.LogCaptureFixture
) -> None:
    flip(own.path, 14)
    with (
        caplog.at_level(logging.ERROR, logger="terraport.server"),
        BackgroundServer(own.path.parent) as server,
        PlainClient(server.scene_url("own")) as client,
    ):
        client.hello()
        missing, received = landed(client, 1)
        metrics = httpx.get(f"{server.url}/metrics").text
        segment = httpx.get(f"{server.scene_url('own')}/segments/14.glb")
        whole = httpx.get(f"{server.scene_url('own')}/segments/15.glb")
    assert missing == [14]
    assert received == {s: data for s, data in enumerate(own.payloads) if s != 14}
    assert 'terraport_corrupt_segments_total{scene="own"} 1.0' in metrics
    (record,) = [r for r in caplog.records if r.getMessage() == "segment_corrupt"]
    assert record.fields["segment"] == 14  # type: ignore[attr-defined]
    assert "expected" in record.fields["reason"]  # type: ignore[attr-defined]
    assert (segment.status_code, segment.json()["error"]["code"]) == (500, "segment_corrupt")
    assert whole.content == own.glb(15)


def test_a_byte_that_flips_after_it_was_sent_once(own: GridScene) -> None:
    with (
        BackgroundServer(own.path.parent) as server,
        PlainClient(server.scene_url("own")) as first,
        PlainClient(server.scene_url("own")) as second,
    ):
        first.hello()
        second.hello()
        assert landed(first, 1)[0] == []
        flip(own.path, 20)
        assert landed(second, 1)[1][20] != own.payloads[20], "checked before: sent unread"
        second.land(2, HERE, EVERYWHERE_M, without=keys_of(own, 20))
        assert 20 not in assemble(second.until(Ready)[1])
        assert "terraport_rejected_segments_total 1.0" in httpx.get(f"{server.url}/metrics").text
        assert landed(first, 2)[0] == [20], "read anew, found bad, not sent to anybody else"
        flip(own.path, 20)
        assert landed(first, 3)[1][20] == own.payloads[20], "mended on disk: sent again"


def test_a_pack_cut_short_loses_segments_and_nothing_else(own: GridScene) -> None:
    with (
        BackgroundServer(own.path.parent) as server,
        PlainClient(server.scene_url("own")) as client,
    ):
        client.hello()
        with Scene.open(own.path) as scene:
            end = int(scene.index.offset[30])
            pack = scene.file_path("segments.pack")
        with pack.open("r+b") as file:
            file.truncate(end)
        missing, received = landed(client, 1)
        assert missing == [30, 31, 32, 33, 34, 35]
        assert sorted(received) == list(range(30))


def test_a_pick_passes_over_a_corrupt_segment(own: GridScene) -> None:
    flip(own.path, 0)
    with (
        BackgroundServer(own.path.parent) as server,
        PlainClient(server.scene_url("own")) as client,
    ):
        client.hello()
        client.send(Pick(request=1, origin=(5.0, 9.0, 5.0)))
        assert client.expect(Picked).hit is None


def test_a_pick_out_of_time_is_refused_and_the_session_goes_on(own: GridScene) -> None:
    with (
        BackgroundServer(own.path.parent, pick_max_segments=1) as server,
        PlainClient(server.scene_url("own")) as client,
    ):
        client.hello()
        client.send(Pick(request=1, origin=(-5.0, 1.2, 5.0), direction=(1.0, 0.0, 0.0)))
        error = client.expect(Error)
        assert (error.code, error.fatal, error.request) == ("internal", False, 1)
        client.land(1, HERE, 1.0)
        client.until(Ready)


def test_a_scene_published_during_a_session(own: GridScene) -> None:
    with BackgroundServer(own.path.parent, scene_poll_s=0.05) as server:
        url = server.scene_url("own")
        with PlainClient(url) as old:
            assert old.hello(credit_bytes=20_000).scene.version == own.manifest.version
            old.land(1, HERE, EVERYWHERE_M)
            old.expect(Plan)
            new = write_grid_scene(own.path, seed=1)
            assert new.manifest.version != own.manifest.version
            notice, before, _ = old.until(Notice)
            assert (notice.kind, notice.version) == ("scene_published", new.manifest.version)
            # The landing under way and those after it stay in the old version, byte for byte.
            old.send(Credit(bytes=1 << 30))
            _, after, _ = old.until(Ready)
            assert assemble([*before, *after]) == dict(enumerate(own.payloads))
            with PlainClient(url) as fresh:
                with Scene.open(own.path) as scene:
                    newest = [int(h) for h in scene.index.xxh3]
                assert fresh.hello().scene.version == new.manifest.version
                # A key of the new version, and one of none.
                fresh.land(1, HERE, EVERYWHERE_M, have=[newest[0], 12345])
                _, frames, _ = fresh.until(Ready)
                assert assemble(frames) == dict(list(enumerate(new.payloads))[1:])
            served = server.service.registry.get("own", own.manifest.version)
            assert not served.closed
            base = httpx.get(f"{url}/base.tsg", params={"v": own.manifest.version})
            assert base.status_code == 200
        eventually(lambda: served.closed)


def test_a_damaged_new_version_leaves_the_old_one_served(own: GridScene) -> None:
    with BackgroundServer(own.path.parent, scene_poll_s=0.05) as server:
        manifest = own.path / "scene.json"
        manifest.write_bytes(manifest.read_bytes()[:100])
        time.sleep(0.3)
        with PlainClient(server.scene_url("own")) as client:
            client.hello()
            assert len(landed(client, 1)[1]) == 36


def test_stopping_finishes_the_open_landing_and_says_when_to_come_back(own: GridScene) -> None:
    server = BackgroundServer(own.path.parent, drain_timeout_s=5.0, reconnect_after_ms=250)
    server.start()
    with (
        PlainClient(server.scene_url("own")) as client,
        PlainClient(server.scene_url("own")) as idle,
    ):
        idle.hello()
        client.hello(credit_bytes=20_000)
        client.land(1, HERE, EVERYWHERE_M)
        client.expect(Plan)
        stopping = threading.Thread(target=server.stop)
        stopping.start()
        notice, frames, _ = client.until(Notice)
        assert (notice.kind, notice.reconnect_after_ms) == ("draining", 250)
        assert idle.expect(Notice).kind == "draining"
        assert idle.closed() == 4503
        client.send(Credit(bytes=1 << 30))
        _, rest, _ = client.until(Ready)
        assert assemble([*frames, *rest]) == dict(enumerate(own.payloads))
        assert client.closed() == 4503
    stopping.join(10.0)
    assert not stopping.is_alive()
