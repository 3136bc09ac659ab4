"""Landings over real sockets: what arrives is what the index says, and nothing else."""

from __future__ import annotations

import gzip
import random
import socket

import msgpack
import numpy as np
import pytest
from server.grid_scene import SIDE, TILE_M, GridScene
from server.plain_client import Piece, PlainClient, assemble, follows, make_land

from terraport_payload import box_distances_m
from terraport_server import BackgroundServer
from terraport_store import Scene
from terraport_wire import Budgets, Bye, Credit, Pick, Picked, Plan, Ready, encode

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0


def test_the_bytes_are_those_of_the_pack(server: BackgroundServer, grid: GridScene) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        welcome = client.hello()
        assert welcome.scene.version == grid.manifest.version
        client.land(7, CENTRE, 12.0)
        plan = client.expect(Plan)
        ready, pieces, others = client.until(Ready)
    assert others == []
    received = assemble(pieces)
    ids = follows(plan)
    assert list(received) == ids == plan.show["id"].tolist()
    assert received == {segment: grid.payloads[segment] for segment in ids}
    assert {piece.generation for piece in pieces} == {7}
    assert plan.show["bytes"].tolist() == [len(received[segment]) for segment in ids]
    assert (ready.missing, ready.hidden) == (None, None)


def test_a_return_brings_no_payload_and_hides_the_same_faces(
    server: BackgroundServer, grid: GridScene
) -> None:
    with Scene.open(grid.path) as scene:
        near = set(scene.within(CENTRE, 12.0).tolist())
        cover = scene.cover
        covered = [set(cover.over(face).tolist()) <= near for face in range(cover.base_faces)]
    have: list[int] = []
    for _ in range(2):  # the second on a new connection
        with PlainClient(server.scene_url("grid")) as client:
            assert client.hello().scene.base_faces == cover.base_faces
            client.land(1, CENTRE, 12.0, have=have)
            plan = client.expect(Plan)
            client.until(Ready)
            hidden = np.frombuffer(gzip.decompress(plan.hidden), np.uint8)
            bits = np.unpackbits(hidden, bitorder="little")[: cover.base_faces]
            assert set(plan.show["id"].tolist()) == near
            assert bits.tolist() == covered
            assert (client.taken_bytes > 0) == (not have)
            have = plan.show["key"].tolist()


def test_the_plan_equals_brute_force_over_random_landings(
    server: BackgroundServer, grid: GridScene
) -> None:
    rng = random.Random(4)
    with Scene.open(grid.path) as scene:
        index = scene.index
    keys = index.xxh3.tolist()
    have = set[int]()
    with PlainClient(server.scene_url("grid")) as client:
        client.hello(budgets=Budgets(max_triangles=8000))
        for generation in range(60):
            centre = (rng.uniform(-10, 70), rng.uniform(-5, 9), rng.uniform(-10, 70))
            radius_m = rng.choice([0.5, 5.0, 15.0, 30.0])
            if rng.random() < 0.3:
                have -= set(rng.sample(sorted(have), k=len(have) // 2))
            client.land(generation, centre, radius_m, have=[keys[segment] for segment in have])
            plan = client.expect(Plan)
            _, pieces, _ = client.until(Ready)
            distances = box_distances_m(index.bounds, centre)
            order = sorted((d, s) for s, d in enumerate(distances.tolist()) if d <= radius_m)
            triangles = np.cumsum([int(index.face_count[segment]) for _, segment in order])
            expected = [segment for _, segment in order][: int((triangles <= 8000).sum())]
            assert plan.show["id"].tolist() == expected
            assert plan.omitted == len(order) - len(expected)
            assert follows(plan) == [segment for segment in expected if segment not in have]
            assert list(assemble(pieces)) == follows(plan)
            have |= set(expected)


def test_a_newer_landing_stops_the_older_within_the_frames_under_way(
    server: BackgroundServer, big: GridScene
) -> None:
    with PlainClient(server.scene_url("big")) as client:
        client.hello(credit_bytes=400_000)
        client.land(1, CENTRE, EVERYWHERE_M)
        client.expect(Plan)
        first = [client.receive() for _ in range(2)]
        client.land(2, (0.0, 0.0, 0.0), 1.0)
        plan, late, _ = client.until(Plan)
        client.send(Credit(bytes=1 << 30))
        _, pieces, _ = client.until(Ready)
    old = [piece for piece in [*first, *late] if isinstance(piece, Piece)]
    assert {piece.generation for piece in old} == {1}
    assert sum(len(piece.data) for piece in old) <= 400_000
    assert {piece.generation for piece in pieces} == {2}
    assert {piece.segment for piece in pieces} == set(follows(plan))


def test_landings_of_a_fast_client_continue_what_was_begun(
    server: BackgroundServer, big: GridScene
) -> None:
    rng = random.Random(1)
    begun: tuple[int, bytearray] | None = None
    whole: dict[int, bytes] = {}
    keys: dict[int, int] = {}
    with PlainClient(server.scene_url("big"), max_queue=4) as client:
        client.hello()
        for newest in range(1, 13):
            place = (rng.uniform(0, 60), 0.0, rng.uniform(0, 60))
            client.land(newest, place, 20.0, have=[keys[segment] for segment in whole])
            wait_for_ready = newest == 12
            frames_left = rng.randint(1, 12)
            while wait_for_ready or frames_left:
                got = client.receive()
                if isinstance(got, Piece):
                    if got.offset == 0:
                        begun = (got.key, bytearray())
                    assert begun is not None
                    assert (got.key, got.offset) == (begun[0], len(begun[1]))
                    begun[1].extend(got.data)
                    frames_left = max(0, frames_left - 1)
                    if len(begun[1]) == got.total:
                        assert got.segment not in whole, "no payload twice"
                        whole[got.segment] = bytes(begun[1])
                        keys[got.segment], begun = got.key, None
                elif isinstance(got, Ready) and got.generation == newest:
                    break
    assert whole
    assert all(data == big.payloads[segment] for segment, data in whole.items())


def test_without_credit_nothing_comes_and_nobody_else_waits(
    server: BackgroundServer, big: GridScene
) -> None:
    url = server.scene_url("big")
    with PlainClient(url) as stalled, PlainClient(url) as other:
        stalled.hello(credit_bytes=1000)
        other.hello()
        stalled.land(1, CENTRE, EVERYWHERE_M)
        stalled.expect(Plan)
        assert len(stalled.receive().data) == 1000  # type: ignore[union-attr]
        other.land(1, CENTRE, EVERYWHERE_M)
        other.until(Ready)
        with pytest.raises(TimeoutError):
            stalled.receive(timeout_s=0.1)
        stalled.send(Credit(bytes=500))
        assert len(stalled.receive().data) == 500  # type: ignore[union-attr]


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
        plain = msgpack.unpackb(encode(make_land(1, CENTRE, 1.0)))
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
        client.land(1, CENTRE, EVERYWHERE_M)
        frames, pongs = [], []
        while not isinstance(got := client.receive(), Ready):
            if isinstance(got, Piece):
                frames.append(got)
                if len(frames) % 5 == 0:
                    pongs.append(client.socket.ping())
        assert all(pong.wait(5) for pong in pongs)
    assert assemble(frames) == dict(enumerate(big.payloads))
