"""Send buffers follow what a link carries; loopback is left alone."""

from __future__ import annotations

import socket
import struct
import sys

import pytest

from terraport_server.link_buffer import LinkBuffer, buffer_bytes


@pytest.mark.parametrize(
    ("min_rtt_us", "bytes_per_s", "expected"),
    [
        (50, 3e9, 0),  # loopback
        (1999, 12.5e6, 0),  # a local network
        (20_000, 0, 0),  # nothing known
        (20_000, 12.5e6, 237_500),  # 100 Mbit/s
        (20_000, 1e6, 96 << 10),
        (50_000, 12.5e6, 593_750),
        (50_000, 1.25e9, 4 << 20),
        (300_000, 12.5e6, 0),  # takes seconds to find its rate
    ],
)
def test_sizes(min_rtt_us: int, bytes_per_s: float, expected: int) -> None:
    assert buffer_bytes(min_rtt_us, bytes_per_s) == expected


class Link(socket.socket):
    """A socket that says what it is told to say of its link."""

    min_rtt_us = 20_000
    bytes_per_s = 12_500_000
    length = 168

    def getsockopt(self, *arguments: int) -> bytes:  # type: ignore[override]
        head = struct.pack("@I", self.min_rtt_us)
        info = bytes(148) + head + bytes(8) + struct.pack("@Q", self.bytes_per_s)
        return info[: self.length]

    def setsockopt(self, level: int, option: int, size: int) -> None:  # type: ignore[override]
        assert (level, option) == (socket.SOL_SOCKET, socket.SO_SNDBUF)
        self.sizes = [*getattr(self, "sizes", []), size]

    sizes: list[int]


def test_it_looks_now_and_then_and_follows() -> None:
    with Link() as link:
        link.sizes = []
        buffer = LinkBuffer(link, 10.0)
        buffer.look(10.1)
        assert link.sizes == [], "the first estimates are of a connection that speeds up"
        buffer.look(10.21)
        assert link.sizes == [237_500]
        link.bytes_per_s = 13_000_000
        buffer.look(10.22)
        buffer.look(10.27)
        assert link.sizes == [237_500], "too soon, then too little"
        link.bytes_per_s = 25_000_000
        buffer.look(10.4)
        assert link.sizes == [237_500, 475_000]
        link.bytes_per_s = 5_000_000
        for step in range(9):
            buffer.look(10.5 + 0.1 * step)
        assert link.sizes == [237_500, 475_000], "a dip is not the link"
        buffer.look(12.0)
        assert link.sizes == [237_500, 475_000, 96 << 10]


def test_a_slow_link_is_given_its_time() -> None:
    with Link() as link:
        link.sizes, link.min_rtt_us = [], 40_000
        buffer = LinkBuffer(link, 10.0)
        for now_s in (10.21, 10.3, 10.39):
            buffer.look(now_s)
        assert link.sizes == []
        buffer.look(10.41)
        assert link.sizes == [475_000]


def test_an_older_system_is_left_alone() -> None:
    with Link() as link:
        link.sizes, link.length = [], 100
        buffer = LinkBuffer(link, 0.0)
        buffer.look(1.0)
        link.length = 168
        buffer.look(2.0)
        assert link.sizes == []


@pytest.mark.skipif(sys.platform != "linux", reason="struct tcp_info is Linux's")
def test_loopback_is_left_alone() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as client,
        server.accept()[0] as peer,
    ):
        before = peer.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        buffer = LinkBuffer(peer, 0.0)
        for step in range(1, 5):
            peer.sendall(bytes(100_000))
            left = 100_000
            while left:
                left -= len(client.recv(left))
            buffer.look(float(step))
        assert peer.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) >= before
        info = peer.getsockopt(socket.IPPROTO_TCP, 11, 168)
    rtt_us, rate = struct.unpack_from("@I", info, 148)[0], struct.unpack_from("@Q", info, 160)[0]
    assert 0 < rtt_us < 1_000_000, "the field that is meant"
    assert rate > 0
