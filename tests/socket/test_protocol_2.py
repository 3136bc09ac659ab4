"""Protocol 2 over real sockets and HTTP: exact bytes, returns, plans without a session."""

from __future__ import annotations

from typing import Any, Self

import httpx
import msgpack
import numpy as np
import pytest
import websockets.sync.client
from server.client_2 import Client2
from server.grid_scene import SIDE, TILE_M, GridScene
from server.plain_client import TIMEOUT_S
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from terraport_server import BackgroundServer
from terraport_store import Scene
from terraport_wire import Budgets, Direction, Error, Message, Pick, Picked, encode, is_payload
from terraport_wire.protocol_2 import (
    FOLLOWS,
    SUBPROTOCOL,
    Hello,
    Plan,
    Ready,
    Welcome,
    decode,
    decode_frame,
)

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
PLENTY = 1 << 30


class Socket:
    """A connection of the `websockets` library that feeds a client."""

    def __init__(self, url: str, client: Client2, **hello: Any) -> None:
        self.client = client
        self._context = websockets.sync.client.connect(
            url.replace("http", "ws", 1) + "/stream",
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            compression=None,
            max_size=None,
        )
        self.socket = self._context.__enter__()
        client.connected()
        fields = {"client": "t", "budgets": Budgets(), "credit_bytes": PLENTY} | hello
        self.send(Hello(**fields))

    def __enter__(self) -> Self:
        self.welcome = self.expect(Welcome)
        return self

    def __exit__(self, *error: object) -> None:
        self._context.__exit__(*error)

    def send(self, message: Message) -> None:
        self.socket.send(encode(message))

    def receive(self) -> Message | None:
        """Receive one message, or None for a frame; the client takes both."""
        data = self.socket.recv(timeout=TIMEOUT_S)
        if is_payload(data):
            assert isinstance(data, bytes)
            frame = decode_frame(data)
            assert frame is not None
            self.client.take_frame(frame)
            return None
        message = decode(data, Direction.SERVER_TO_CLIENT)
        assert isinstance(message, Message)
        self.client.take_message(message)
        return message

    def expect(self, kind: Any) -> Any:
        """Receive up to a message of a kind."""
        while not isinstance(message := self.receive(), kind):
            assert message is None or isinstance(message, Plan), message
        return message


def keys_of(grid: GridScene) -> dict[int, bytes]:
    """Payloads by key, as the scene on disk has them."""
    with Scene.open(grid.path) as scene:
        hashes = scene.rows.xxh3.tolist()
    return dict(zip(hashes, grid.payloads, strict=True))


def test_a_landing_and_a_return(server: BackgroundServer, grid: GridScene) -> None:
    client = Client2()
    with Socket(server.scene_url("grid"), client) as socket:
        assert socket.welcome.scene.version == grid.manifest.version
        assert socket.welcome.scene.base_faces == grid.manifest.counts.base_faces
        socket.send(client.land(CENTRE, 12.0))
        plan = socket.expect(Plan)
        ready = socket.expect(Ready)
        assert ready.missing is None
        payloads = keys_of(grid)
        assert client.have == {key: payloads[key] for key in plan.show["key"].tolist()}
        with Scene.open(grid.path) as scene:
            near = set(scene.within(CENTRE, 12.0).tolist())
            bits = np.unpackbits(np.frombuffer(client.hidden, np.uint8), bitorder="little")
            cover = scene.cover
            for face in range(cover.base_faces):
                assert bits[face] == (set(cover.over(face).tolist()) <= near)
        assert {segment for segment, _ in client.shown} == near
        # The same place again: no payload.
        socket.send(client.land(CENTRE, 12.0))
        again = socket.expect(Plan)
        socket.expect(Ready)
        assert not (again.show["flags"] & FOLLOWS).any()
        assert len(client.arrived) == len(near)
    # And on a new connection, which is the same landing.
    with Socket(server.scene_url("grid"), client) as socket:
        socket.send(client.land(CENTRE, 12.0))
        socket.expect(Ready)
        assert client.taken_bytes == 0
        assert not client.is_landing


def test_a_newer_landing_while_payload_flows(server: BackgroundServer, big: GridScene) -> None:
    client = Client2()
    with Socket(server.scene_url("big"), client) as socket:
        for radius_m in (100.0, 5.0, 30.0, 100.0):
            socket.send(client.land(CENTRE, radius_m))
            for _ in range(9):
                if client.is_landing:
                    socket.receive()
        while client.is_landing:
            socket.receive()
        assert len(client.arrived) == len(set(client.arrived)) == SIDE * SIDE
        assert client.have == keys_of(big)


def test_a_bad_prefetch_is_refused_and_the_session_goes_on(server: BackgroundServer) -> None:
    with Socket(server.scene_url("grid"), Client2()) as socket:
        bad = {"type": "prefetch", "generation": 5, "position": [0, 1], "radius_m": 3}
        socket.socket.send(msgpack.packb(bad | {"have": b"", "taken_bytes": 0}))
        error = socket.receive()
        assert isinstance(error, Error)
        assert (error.code, error.fatal, error.generation) == ("invalid_field", False, 5)
        socket.send(Pick(request=4, origin=CENTRE))
        socket.expect(Picked)


def test_a_pick(server: BackgroundServer) -> None:
    with Socket(server.scene_url("grid"), Client2()) as socket:
        socket.send(Pick(request=4, origin=CENTRE))
        assert socket.expect(Picked).hit is not None


def test_a_plan_over_http_and_its_ranges(server: BackgroundServer, grid: GridScene) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    url = f"{server.scene_url('grid')}/{folder}/plan"
    query = {"x": CENTRE[0], "y": CENTRE[1], "z": CENTRE[2], "radius_m": 12.0}
    answer = httpx.get(url, params=query | {"inner_radius_m": 4.0})
    assert "immutable" in answer.headers["cache-control"]
    plan = decode(answer.content, Direction.SERVER_TO_CLIENT)
    assert isinstance(plan, Plan)
    client = Client2()
    with Socket(server.scene_url("grid"), client) as socket:
        socket.send(client.land(CENTRE, 12.0, inner_radius_m=4.0))
        streamed = socket.expect(Plan)
    assert (plan.show == streamed.show).all()
    assert (plan.hidden, plan.inner_hidden) == (streamed.hidden, streamed.inner_hidden)
    assert plan.inner_count == streamed.inner_count
    assert plan.offsets is not None
    assert plan.pack is not None
    payloads = keys_of(grid)
    for row, offset in zip(plan.show.tolist(), plan.offsets.tolist(), strict=True):
        span = {"Range": f"bytes={offset}-{offset + row[2] - 1}"}
        data = httpx.get(httpx.URL(url).join(plan.pack), headers=span)
        assert (data.status_code, data.content) == (206, payloads[row[0]])
    # Without what cannot be had, and within a budget.
    first, second = (f"{key:016x}" for key in plan.show["key"][:2].tolist())
    less = {"without": f"{first},{second}", "max_segments": 3}
    cut = decode(httpx.get(url, params=query | less).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(cut, Plan)
    assert cut.show["key"].tolist() == plan.show["key"][2:5].tolist()
    assert cut.omitted_by == "max_segments"
    # Budgets of the GPU as the stream counts them.
    gpu = {"max_gpu_bytes": 60_000, "gpu_vertex_bytes": 77}
    narrow = decode(httpx.get(url, params=query | gpu).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(narrow, Plan)
    with Socket(server.scene_url("grid"), Client2(), budgets=Budgets(**gpu)) as socket:
        socket.send(socket.client.land(CENTRE, 12.0))
        streamed = socket.expect(Plan)
    assert (narrow.omitted_by, len(narrow.show)) == ("max_gpu_bytes", len(streamed.show))
    assert 0 < len(narrow.show) < len(plan.show)


@pytest.mark.parametrize(
    ("wrong", "status"),
    [
        ({"radius_m": 501}, 400),
        ({"radius_m": "nan"}, 400),
        ({"radius_m": -1}, 400),
        ({"x": "inf"}, 400),
        ({"without": "12"}, 400),
        ({"inner_radius_m": 20}, 400),
        ({"max_bytes": -1}, 400),
        ({"gpu_face_bytes": 5000}, 400),
    ],
)
def test_bad_questions_over_http(
    server: BackgroundServer, grid: GridScene, wrong: dict[str, Any], status: int
) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    query = {"x": 0, "y": 0, "z": 0, "radius_m": 12.0} | wrong
    answer = httpx.get(f"{server.scene_url('grid')}/{folder}/plan", params=query)
    assert answer.status_code == status
    assert answer.json()["error"]["message"]


def test_a_plan_names_the_pack_where_others_serve_it(scenes_dir: Any, grid: GridScene) -> None:
    path = grid.manifest.files["segments.pack"].path
    query = {"x": CENTRE[0], "y": CENTRE[1], "z": CENTRE[2], "radius_m": 12.0}
    with BackgroundServer(scenes_dir, pull_base_url="https://cdn.example/scenes") as running:
        url = f"{running.scene_url('grid')}/{path.partition('/')[0]}/plan"
        plan = decode(httpx.get(url, params=query).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(plan, Plan)
    assert plan.pack == f"https://cdn.example/scenes/grid/{path}"


def test_a_plan_of_an_unknown_version(server: BackgroundServer) -> None:
    url = f"{server.scene_url('grid')}/v-000000000000/plan?x=0&y=0&z=0&radius_m=1"
    assert httpx.get(url).status_code == 404


def test_tokens_are_checked(scenes_dir: Any, token: str) -> None:
    with BackgroundServer(scenes_dir, token=token) as running:
        url = running.scene_url("grid")
        stranger = Socket(url, Client2(), token="wrong")
        error = stranger.receive()
        assert isinstance(error, Error)
        assert error.code == "unauthorised"
        with pytest.raises(ConnectionClosed) as closed:
            stranger.receive()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4401
        with Socket(url, Client2(), token=token) as socket:
            assert socket.welcome.scene.id == "grid"
        plan = f"{url}/v-000000000000/plan?x=0&y=0&z=0&radius_m=1"
        assert httpx.get(plan).status_code == 401
