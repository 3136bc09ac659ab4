"""Both cores on a line that is cut, stalls or lies, and with a service that dies."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest
from engines.programs import Client, ThreadedProxy
from engines.sdk_arrays import digests, land_with_sdk
from faults.service import Service
from server.grid_scene import write_grid_scene

from terraport_store import Scene

EVERYWHERE = "land:30,1,30,100"


@pytest.mark.parametrize("threaded", [0, 1], ids=["pumped", "threaded"])
def test_a_cut_line_is_mended_and_no_segment_comes_twice(
    client: Client, server: Service, threaded: int
) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.cuts = [600_000, 1_700_000, 500_000]
        landed = client.land(
            f"{line.url}/scenes/big",
            EVERYWHERE,
            credit_bytes=300_000,
            threaded=threaded,
        )
        assert landed.exit_code == 0, landed.output[-3000:]
        assert line.proxy.connections == 4 + 1, "the manifest, at the end"
    (ready,) = landed.landings
    assert ready["visible"] == list(range(36))
    arrived = [event["facts"]["id"] for event in landed.of("arrived")]
    assert sorted(arrived) == list(range(36)), "each whole exactly once"
    assert landed.stats["repeated_bytes"] == 0
    opened = landed.of("opened")
    assert len(opened) == 4
    assert opened[-1]["held_count"] > opened[1]["held_count"] > 0
    states = [link["state"] for link in landed.of("link")]
    assert states == ["connecting", "open"] + ["waiting", "connecting", "open"] * 3


def test_a_flipped_byte_is_noticed_and_the_segment_asked_for_again(
    client: Client, server: Service
) -> None:
    """One bit of the payload on its way; the hash finds it."""
    url = f"{server.url}/scenes/big"
    _, meshes = land_with_sdk(url, [(30, 1, 30, 100)])
    with ThreadedProxy(server.url) as line:
        proxy: Any = line.proxy
        proxy.flip_at = 3_000_000
        landed = client.land(f"{line.url}/scenes/big", EVERYWHERE)
        assert proxy.flip_at is None, "it was flipped"
        assert line.proxy.connections == 1 + 1, "the manifest, at the end"
    assert landed.exit_code == 0, landed.output[-3000:]
    (ready,) = landed.landings
    assert (ready["visible"], ready["missing"]) == (list(range(36)), [])
    assert {segment: digests(mesh) for segment, mesh in meshes.items()} == landed.segments


def test_a_byte_that_went_bad_on_disk_is_a_segment_missing(client: Client, tmp_path: Path) -> None:
    """The service finds it and never sends it; the landing is ready without."""
    own = write_grid_scene(tmp_path / "scenes" / "own")
    with Scene.open(own.path) as scene:
        offset = int(scene.index.offset[14]) + 40
        pack = scene.file_path("segments.pack")
    spoilt = bytearray(pack.read_bytes())
    spoilt[offset] ^= 0x10
    pack.write_bytes(spoilt)
    with Service(own.path.parent) as service:
        landed = client.land(f"{service.url}/scenes/own", EVERYWHERE)
    (ready,) = landed.landings
    assert ready["missing"] == [14]
    assert ready["visible"] == [segment for segment in range(36) if segment != 14]


def test_a_service_that_is_killed_and_comes_back(client: Client, tmp_path: Path) -> None:
    """Nothing whole is sent again by the one that comes after."""
    write_grid_scene(tmp_path / "scenes" / "big", cells=80)
    with Service(tmp_path / "scenes") as first, ThreadedProxy(first.url) as line:
        line.proxy.bytes_per_s = 4_000_000

        def restart() -> None:
            while line.proxy.down_bytes < 2_000_000:
                time.sleep(0.01)
            first.kill()
            time.sleep(0.5)
            first.start()

        thread = threading.Thread(target=restart)
        thread.start()
        landed = client.land(f"{line.url}/scenes/big", EVERYWHERE, credit_bytes=300_000)
        thread.join()
    assert landed.exit_code == 0, landed.output[-3000:]
    assert landed.landings[-1]["visible"] == list(range(36))
    assert landed.stats["repeated_bytes"] == 0
    assert landed.of("opened")[-1]["held_count"] > 0


def test_a_server_that_is_away_is_asked_again_later_each_time(
    client: Client, server: Service
) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.refuse = True
        landed = client.land(f"{line.url}/scenes/grid", "start:5,1,5,3", timeout_s=2.5)
    assert landed.failure == "start:5,1,5,3: timeout"
    waits = [link for link in landed.of("link") if link["state"] == "waiting"]
    assert [link["attempt"] for link in waits] == list(range(2, len(waits) + 2))
    assert 2 <= len(waits) <= 6
    assert waits[0]["retry_in_ms"] <= 500


def test_a_deadline_shows_the_inner_part_first(client: Client, server: Service) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.bytes_per_s = 1_200_000
        landed = client.land(
            f"{line.url}/scenes/big", "land:30,1,30,100,15,1500", credit_bytes=300_000
        )
    assert landed.exit_code == 0, landed.output[-3000:]
    (degraded,), (ready,) = landed.of("degraded"), landed.landings
    assert degraded["landing"] == ready["landing"]
    assert 0 < len(degraded["segments"]) < len(ready["visible"]) == 36
    kinds = [event["type"] for event in landed.events]
    assert kinds.index("degraded") < kinds.index("ready")
