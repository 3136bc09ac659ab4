"""Connections from process to process: socket and bytes together, bounded, never waiting."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import Iterator

import pytest

from terraport_server.mailbox import MAX_HEAD_BYTES, Mailbox, Parcel, mailbox_pair

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone passes connections")


@pytest.fixture
def connection() -> Iterator[tuple[socket.socket, socket.socket]]:
    ends = socket.socketpair()
    yield ends
    for end in ends:
        end.close()


def test_a_connection_and_its_head_arrive_and_it_goes_on(
    connection: tuple[socket.socket, socket.socket],
) -> None:
    client, accepted = connection

    async def work() -> None:
        ours, theirs = mailbox_pair()
        came: asyncio.Queue[Parcel] = asyncio.Queue()
        receiving, sending = Mailbox(ours, came.put_nowait), Mailbox(theirs, came.put_nowait)
        for head in (b"GET / HTTP/1.1\r\n\r\n", b"", b"\n" * MAX_HEAD_BYTES):
            assert sending.send("tour", head, accepted.fileno())
            parcel = await asyncio.wait_for(came.get(), 10)
            assert (parcel.group, parcel.head) == ("tour", head)
            with parcel.connection as passed:
                assert not os.get_inheritable(passed.fileno())
                passed.sendall(b"hello")
                assert client.recv(5) == b"hello"
        accepted.sendall(b"still open")  # the sender's own is the sender's to close
        assert client.recv(10) == b"still open"
        receiving.close()
        receiving.close()
        assert not sending.send("tour", b"", accepted.fileno())
        sending.close()

    asyncio.run(work())


def test_what_is_too_long_or_not_taken_is_refused(
    connection: tuple[socket.socket, socket.socket],
) -> None:
    async def work() -> None:
        ours, theirs = mailbox_pair()
        sending = Mailbox(theirs, lambda _: None)
        number = connection[1].fileno()
        assert not sending.send("tour", b"x" * (MAX_HEAD_BYTES + 1), number)
        sent = 0
        while sending.send("tour", b"x" * MAX_HEAD_BYTES, number):
            sent += 1
            assert sent < 100, "a mailbox that nobody reads takes everything"
        assert sent
        sending.close()
        ours.close()

    asyncio.run(work())
