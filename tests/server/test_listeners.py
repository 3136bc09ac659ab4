"""Sockets of several workers on one port: dealt evenly, kept, given up, refused where taken."""

from __future__ import annotations

import re
import socket
import sys
from contextlib import ExitStack

import pytest

from terraport_server.errors import ServerError
from terraport_server.listeners import Listeners

linux = pytest.mark.skipif(sys.platform != "linux", reason="the kernel deals on Linux alone")


def accepted(listener: socket.socket) -> int:
    """Accept and close every connection that waits; return how many there were."""
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


def test_where_the_kernel_does_not_deal_all_share_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    listeners = Listeners("127.0.0.1", 0, 3)
    assert listeners.of(0)[0] is listeners.of(2)[0]
    assert not listeners.is_dealt
    listeners.close()


@pytest.mark.parametrize("slots", [1, 2])
def test_a_port_in_use_is_refused_and_a_free_one_is_named(slots: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(ServerError, match=rf"127\.0\.0\.1:{port}: .* does; stop") as raised:
            Listeners("127.0.0.1", port, slots)
        named = re.search(r"--port (\d+), which is free", str(raised.value))
        assert named
        assert int(named[1]) != port
        Listeners("127.0.0.1", int(named[1]), slots).close()


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(ServerError, match=r"192\.0\.2\.1:8080: .*expected an address or a name"):
        Listeners("192.0.2.1", 8080, 1)


def test_a_name_that_is_none_is_refused() -> None:
    with pytest.raises(ServerError, match="expected an address or a name of this machine"):
        Listeners("no.such.name.invalid", 8080, 1)


def test_a_machine_without_ipv6_listens_on_the_address_it_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    both = [
        (family, socket.SOCK_STREAM, 6, "", (address, 0))
        for family, address in ((socket.AF_INET6, "2001:db8::1"), (socket.AF_INET, "127.0.0.1"))
    ]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_arguments, **_options: both)
    listeners = Listeners("pit.example", 0, 1)
    assert [sock.getsockname()[0] for sock in listeners.of(0)] == ["127.0.0.1"]
    listeners.close()


def test_a_second_service_does_not_take_half_of_the_connections() -> None:
    first = Listeners("127.0.0.1", 0, 2)
    with pytest.raises(ServerError, match=r"(this very process|another program) does; stop it"):
        Listeners("127.0.0.1", first.port, 2)
    first.close()


def test_every_address_of_a_host_gets_the_same_port() -> None:
    listeners = Listeners("localhost", 0, 2)
    ports = {sock.getsockname()[1] for slot in range(2) for sock in listeners.of(slot)}
    assert ports == {listeners.port}
    listeners.close()
