"""Labels over real sockets: set while clients are connected, answered in their next pick."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_store import change_labels
from terraport_wire import Hit, Notice, Pick, Picked

ABOVE = (15.0, 40.0, 25.0)
"""Over region 2 of the grid."""


@pytest.fixture
def pit(tmp_path: Path) -> Path:
    return write_grid_scene(tmp_path / "scenes" / "pit", cells=2, stable_ids=(4, 2, 9)).path


@pytest.fixture
def server(pit: Path) -> Iterator[BackgroundServer]:
    with BackgroundServer(pit.parent, scene_poll_s=0.02, max_messages_per_s=1e4) as running:
        yield running


def picked_hit(client: PlainClient) -> Hit:
    client.send(Pick(request=1, origin=ABOVE))
    answer = client.receive()
    while isinstance(answer, Notice):  # that a newer version is published
        answer = client.receive()
    assert isinstance(answer, Picked)
    assert answer.hit is not None
    return answer.hit


def asked_until(client: PlainClient, label: str | None) -> Hit:
    """Pick until the label is there, for at most 20 s."""
    end = time.monotonic() + 20
    hit = picked_hit(client)
    while hit.label != label and time.monotonic() < end:
        time.sleep(0.02)
        hit = picked_hit(client)
    return hit


def test_a_connected_client_gets_the_new_label(pit: Path, server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("pit")) as client:
        client.hello()
        hit = picked_hit(client)
        assert (hit.region, hit.stable_id, hit.label) == (2, 9, None)
        change_labels(pit, {9: "haul road"})
        assert asked_until(client, "haul road").label == "haul road"
        change_labels(pit, {9: None})
        assert asked_until(client, None).label is None


def test_a_session_of_the_version_before_gets_it_too(pit: Path, server: BackgroundServer) -> None:
    """Region 2 is stable id 9 before and 7 after; each session hears of its own."""
    with PlainClient(server.scene_url("pit")) as old:
        old.hello()
        assert picked_hit(old).stable_id == 9
        write_grid_scene(pit, cells=2, seed=1, stable_ids=(4, 9, 7))
        change_labels(pit, {9: "moved", 7: "new"})
        assert asked_until(old, "moved").stable_id == 9
        end = time.monotonic() + 20
        while time.monotonic() < end:
            with PlainClient(server.scene_url("pit")) as new:
                new.hello()
                hit = picked_hit(new)
                if hit.stable_id == 7:
                    break
        assert (hit.stable_id, asked_label(server)) == (7, "new")


def asked_label(server: BackgroundServer) -> str | None:
    with PlainClient(server.scene_url("pit")) as client:
        client.hello()
        return asked_until(client, "new").label
