"""Sockets of several workers on one port: dealt evenly, kept, given up, refused where taken."""

from __future__ import annotations

import socket
import sys
from contextlib import ExitStack

import pytest

from terraport_server.errors import ServerError
from terraport_server.listeners import Listeners

linux = pytest.mark.skipif(sys.platform != "linux", reason="the kernel deals on Linux alone")


def accepted(listener: socket.socket) -> int:
    """Accept all that waits."""
    count = 0
    while True:
        try:
            listener.accept()[0].close()
        except BlockingIOError:
            return count
        count += 1


@linux
def test_connections_are_dealt_and_wait_for_a_worker() -> None:
    """Nobody accepts while they come, as while a worker is replaced; none is lost."""
    listeners = Listeners("127.0.0.1", 0, 4)
    with ExitStack() as stack:
        for _ in range(200):
            address = ("127.0.0.1", listeners.port)
            stack.enter_context(socket.create_connection(address, timeout=5))
        counts = [accepted(listeners.of(slot)[0]) for slot in range(4)]
    assert sum(counts) == 200
    assert min(counts) > 20
    listeners.close()


@linux
def test_what_is_given_up_goes_to_the_others_until_it_is_wanted_again() -> None:
    listeners = Listeners("127.0.0.1", 0, 2)
    listeners.give_up(0)
    listeners.give_up(1)  # the last one stays: nobody would hear of the service else
    with ExitStack() as stack:
        for _ in range(20):
            address = ("127.0.0.1", listeners.port)
            stack.enter_context(socket.create_connection(address, timeout=5))
        assert accepted(listeners.of(1)[0]) == 20
        assert accepted(listeners.of(0)[0]) == 0  # open again
    listeners.close()


def test_where_the_kernel_does_not_deal_all_share_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    listeners = Listeners("127.0.0.1", 0, 3)
    assert listeners.of(0)[0] is listeners.of(2)[0]
    listeners.give_up(0)
    assert listeners.of(1)[0].fileno() >= 0
    listeners.close()


def test_a_port_in_use_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ServerError, match=f"could not listen on 127.0.0.1:{port}, expected"):
            Listeners("127.0.0.1", port, 2)


def test_a_second_service_does_not_take_half_of_the_connections() -> None:
    first = Listeners("127.0.0.1", 0, 2)
    with pytest.raises(ServerError, match="expected a free address and port"):
        Listeners("127.0.0.1", first.port, 2)
    first.close()


def test_every_address_of_a_host_gets_the_same_port() -> None:
    listeners = Listeners("localhost", 0, 2)
    ports = {one.getsockname()[1] for slot in range(2) for one in listeners.of(slot)}
    assert ports == {listeners.port}
    listeners.close()
