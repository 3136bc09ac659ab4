"""Landings over real sockets: what arrives is what the index says, and nothing else."""

from __future__ import annotations

import random
import socket

import msgpack
import numpy as np
import pytest
from server.grid_scene import SIDE, TILE_M, GridScene
from server.plain_client import PlainClient, assemble

from terraport_payload import box_distances_m
from terraport_server import BackgroundServer
from terraport_store import Scene
from terraport_wire import (
    HELD_DTYPE,
    Budgets,
    Bye,
    Credit,
    Degraded,
    Evict,
    Land,
    PayloadFrame,
    Pick,
    Picked,
    Plan,
    Ready,
    Superseded,
    encode,
)

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0


def land(
    generation: int,
    position: tuple[float, float, float] = CENTRE,
    radius_m: float = EVERYWHERE_M,
    **fields: object,
) -> Land:
    return Land(generation=generation, position=position, radius_m=radius_m, **fields)  # type: ignore[arg-type]


def test_the_bytes_are_those_of_the_pack(server: BackgroundServer, grid: GridScene) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        welcome = client.hello()
        assert welcome.scene.version == grid.manifest.version
        client.send(land(7, radius_m=12.0))
        plan = client.expect(Plan)
        ready, frames, others = client.until(Ready)
    assert others == []
    received = assemble(frames)
    ids = plan.load["id"].tolist()
    assert list(received) == ids
    assert received == {segment: grid.payloads[segment] for segment in ids}
    assert {frame.generation for frame in frames} == {7}
    assert ready.payload_bytes == plan.load_bytes == sum(map(len, received.values()))
    assert ready.missing.tolist() == []


def test_the_plan_equals_brute_force_over_random_landings(
    server: BackgroundServer, grid: GridScene
) -> None:
    rng = random.Random(4)
    with Scene.open(grid.path) as scene:
        index = scene.index
    held_ids: set[int] = set()
    with PlainClient(server.scene_url("grid")) as client:
        client.hello(budgets=Budgets(max_triangles=8000))
        for generation in range(60):
            centre = (rng.uniform(-10, 70), rng.uniform(-5, 9), rng.uniform(-10, 70))
            radius_m = rng.choice([0.5, 5.0, 15.0, 30.0])
            if rng.random() < 0.3 and held_ids:
                gone = rng.sample(sorted(held_ids), k=rng.randint(1, len(held_ids)))
                held_ids -= set(gone)
                client.send(Evict(segments=np.array(gone, dtype=np.uint32)))
            client.send(land(generation, centre, radius_m))
            plan = client.expect(Plan)
            _, frames, _ = client.until(Ready)
            distances = box_distances_m(index.bounds, centre)
            order = sorted(
                (d, s)
                for s, d in enumerate(distances.tolist())
                if d <= radius_m or (s in held_ids and d <= radius_m * 1.25)
            )
            expected, nearby, triangles = [], [], 0
            for distance_m, segment in order:
                triangles += int(index.face_count[segment])
                if triangles > 8000:
                    break
                (expected if distance_m <= radius_m else nearby).append(segment)
            load = plan.load["id"].tolist()
            assert load == [s for s in expected if s not in held_ids]
            assert plan.keep.tolist() == sorted(s for s in expected if s in held_ids)
            assert plan.nearby.tolist() == sorted(nearby)
            assert sorted(assemble(frames)) == sorted(load)
            held_ids |= set(load)


def test_resume_with_what_is_held(server: BackgroundServer, grid: GridScene) -> None:
    with Scene.open(grid.path) as scene:
        hashes = scene.index.xxh3
    rows = [(segment, int(hashes[segment])) for segment in range(10)]
    rows[3] = (3, rows[3][1] ^ 1)
    with PlainClient(server.scene_url("grid")) as client:
        welcome = client.hello(held=np.array(rows, dtype=HELD_DTYPE))
        assert (welcome.held_count, welcome.dropped.tolist()) == (9, [3])
        client.send(land(1))
        plan = client.expect(Plan)
        _, frames, _ = client.until(Ready)
    assert plan.keep.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    received = assemble(frames)
    assert sorted(received) == [3, *range(10, 36)]


def test_supersede_stops_within_the_frames_under_way(
    server: BackgroundServer, big: GridScene
) -> None:
    with PlainClient(server.scene_url("big")) as client:
        client.hello(credit_bytes=400_000)
        client.send(land(1))
        old_plan = client.expect(Plan)
        first = [client.receive() for _ in range(2)]
        client.send(land(2, (0.0, 0.0, 0.0), 1.0))
        superseded, late, _ = client.until(Superseded)
        client.send(Credit(bytes=1 << 30))
        plan = client.expect(Plan)
        ready, frames, _ = client.until(Ready)
    old = [frame for frame in [*first, *late] if isinstance(frame, PayloadFrame)]
    old_bytes = sum(len(frame.chunk) for frame in old)
    assert {frame.generation for frame in old} == {1}
    assert old_bytes <= 400_000
    assert superseded.unsent_bytes == old_plan.load_bytes - old_bytes
    assert {frame.generation for frame in frames} == {2}
    assert ready.payload_bytes <= plan.load_bytes < old_plan.load_bytes


def test_supersede_of_a_fast_client_continues_partly_sent_segments(
    server: BackgroundServer, big: GridScene
) -> None:
    rng = random.Random(1)
    with PlainClient(server.scene_url("big"), max_queue=4) as client:
        client.hello()
        payloads: dict[int, bytearray] = {}
        held_payloads: dict[int, bytes] = {}
        for newest in range(1, 13):
            client.send(land(newest, (rng.uniform(0, 60), 0.0, rng.uniform(0, 60)), 20.0))
            wait_for_ready = newest == 12
            frames_left = rng.randint(1, 12)
            while wait_for_ready or frames_left:
                got = client.receive()
                if isinstance(got, Plan):
                    planned = set(got.load["id"].tolist())
                    payloads = {s: p for s, p in payloads.items() if s in planned}
                elif isinstance(got, PayloadFrame):
                    payload = payloads.setdefault(got.segment, bytearray())
                    assert got.offset == len(payload), "no byte twice, none left out"
                    payload += got.chunk
                    frames_left = max(0, frames_left - 1)
                    if got.last:
                        held_payloads[got.segment] = bytes(payloads.pop(got.segment))
                elif isinstance(got, Ready) and got.generation == newest:
                    break
    assert held_payloads
    assert all(data == big.payloads[segment] for segment, data in held_payloads.items())


def test_without_credit_nothing_comes_and_nobody_else_waits(
    server: BackgroundServer, big: GridScene
) -> None:
    url = server.scene_url("big")
    with PlainClient(url) as stalled, PlainClient(url) as other:
        stalled.hello(credit_bytes=1000)
        other.hello()
        stalled.send(land(1))
        stalled.expect(Plan)
        assert len(stalled.receive().chunk) == 1000  # type: ignore[union-attr]
        other.send(land(1))
        other.until(Ready)
        with pytest.raises(TimeoutError):
            stalled.receive(timeout_s=0.1)
        stalled.send(Credit(bytes=500))
        assert len(stalled.receive().chunk) == 500  # type: ignore[union-attr]


def test_the_deadline_brings_the_inner_set(server: BackgroundServer, big: GridScene) -> None:
    with PlainClient(server.scene_url("big")) as client:
        client.hello(credit_bytes=2_000_000)
        client.send(land(1, inner_radius_m=1.0, deadline_ms=150))
        plan = client.expect(Plan)
        degraded, frames, _ = client.until(Degraded)
        whole = {frame.segment for frame in frames if frame.last}
        assert plan.inner_count == len(degraded.segments) == 4
        assert set(degraded.segments.tolist()) <= whole
        client.send(Credit(bytes=1 << 30))
        client.until(Ready)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((15.0, 40.0, 25.0), (0.0, -3.0, 0.0)),
        ((15.0, 40.0, 25.0), None),
        ((15.0, -7.0, 25.0), None),
    ],
)
def test_a_pick_is_answered_without_any_landing(
    server: BackgroundServer,
    origin: tuple[float, float, float],
    direction: tuple[float, float, float] | None,
) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.send(Pick(request=9, origin=origin, direction=direction))
        hit = client.expect(Picked).hit
    assert hit is not None
    assert (hit.segment, hit.region, hit.label) == (2 * SIDE + 1, 2, None)
    assert hit.position[0] == pytest.approx(15.0, abs=1e-9)
    assert hit.position[1] == pytest.approx(1 + 0.5 * np.sin(6.0) * np.cos(7.5), abs=0.02)
    assert hit.height_m == pytest.approx(100.0 + hit.position[1])
    assert hit.attributes["grade"] == pytest.approx(0.65, abs=2.0**-10)
    assert hit.normal[1] > 0.9


def test_a_pick_that_meets_nothing(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.send(Pick(request=9, origin=(15.0, 40.0, 25.0), direction=(0.0, 1.0, 0.0)))
        assert client.expect(Picked) == Picked(request=9)


def test_unknown_messages_and_fields_are_skipped(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.socket.send(msgpack.packb({"type": "dance", "steps": [1, 2]}))
        plain = msgpack.unpackb(encode(land(1, radius_m=1.0)))
        client.socket.send(msgpack.packb({**plain, "shoes": "red"}))
        client.expect(Plan)


def test_bye_is_answered_with_a_normal_close(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.send(Bye())
        assert client.closed() == 1000


def test_pings_and_slow_reading_leave_the_stream_whole(
    server: BackgroundServer, big: GridScene
) -> None:
    """Sockets take parts of frames; pongs go between frames."""
    with PlainClient(server.scene_url("big"), max_queue=1) as client:
        client.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)
        client.hello()
        client.send(land(1))
        frames, pongs = [], []
        while not isinstance(got := client.receive(), Ready):
            if isinstance(got, PayloadFrame):
                frames.append(got)
                if len(frames) % 5 == 0:
                    pongs.append(client.socket.ping())
        assert all(pong.wait(5) for pong in pongs)
    assert assemble(frames) == dict(enumerate(big.payloads))
