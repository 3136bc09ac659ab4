"""Frame headers against the websockets library, and the socket's options."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient
from websockets.frames import Frame, Opcode

from terraport_server import BackgroundServer
from terraport_server.transport import (
    TCP_NOTSENT_LOWAT,
    Connection,
    _frame_header,
    connection_of,
    protocol_class,
)


@pytest.mark.parametrize("length", [0, 1, 125, 126, 127, 65_535, 65_536, 131_072])
def test_frame_headers_are_those_of_the_library(length: int) -> None:
    data = b"x" * length
    assert _frame_header(length) + data == Frame(Opcode.BINARY, data).serialize(mask=False)


def test_a_scope_of_another_server_has_no_connection() -> None:
    assert connection_of({"extensions": {}}) is None
    assert connection_of({}) is None


def test_socket_options_are_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, int]] = []
    made = Connection.connection_made

    def spy(self: Connection, transport: object) -> None:
        made(self, transport)  # type: ignore[arg-type]
        raw = self.transport.get_extra_info("socket")
        seen.append(
            (
                raw.getsockopt(socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT),
                raw.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF),
            )
        )

    monkeypatch.setattr(Connection, "connection_made", spy)
    write_grid_scene(tmp_path / "pit", cells=2)
    with (
        BackgroundServer(tmp_path, notsent_lowat_bytes=64_000, send_buffer_bytes=100_000) as server,
        PlainClient(server.scene_url("pit")) as client,
    ):
        client.hello()
    ((lowat, send_buffer),) = seen
    assert lowat == 64_000
    assert send_buffer >= 100_000


def test_each_service_has_its_own_options() -> None:
    one = protocol_class(notsent_lowat_bytes=1, send_buffer_bytes=2)
    two = protocol_class(notsent_lowat_bytes=3, send_buffer_bytes=4)
    assert (one.notsent_lowat_bytes, two.notsent_lowat_bytes) == (1, 3)
    assert Connection.notsent_lowat_bytes == 0
