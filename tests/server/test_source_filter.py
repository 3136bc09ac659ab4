"""What a listening socket drops, and what it lets in again."""

from __future__ import annotations

import contextlib
import socket
import sys
from collections.abc import Iterator

import pytest

from terraport_server import source_filter
from terraport_server.source_filter import MOST_SOURCES, SourceFilter, filter_program

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the kernel's filters are Linux'")

DROPPED = "127.0.0.2"


@contextlib.contextmanager
def listening(host: str = "127.0.0.1") -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family, dualstack_ipv6=host == "::") as listener:
        yield listener


def comes_in(listener: socket.socket, source: str, to: str = "127.0.0.1") -> bool:
    """Whether a connection from there is made; closed at once."""
    name = (to, listener.getsockname()[1])
    try:
        socket.create_connection(name, 0.1, source_address=(source, 0)).close()
    except TimeoutError:
        return False
    return True


def test_who_is_dropped_is_not_heard_until_the_time_is_over() -> None:
    with listening() as listener:
        dropped = SourceFilter(listener)
        assert dropped.drop(DROPPED, 5.0)
        assert DROPPED in dropped
        assert not comes_in(listener, DROPPED)
        assert comes_in(listener, "127.0.0.3")
        assert dropped.lift(4.0) == 5.0
        assert not comes_in(listener, DROPPED)
        assert dropped.lift(5.0) is None
        assert comes_in(listener, DROPPED)


def test_of_several_each_has_a_time_of_its_own() -> None:
    with listening() as listener:
        dropped = SourceFilter(listener)
        assert dropped.drop(DROPPED, 5.0)
        assert dropped.drop("127.0.0.3", 9.0)
        assert dropped.lift(6.0) == 9.0
        assert comes_in(listener, DROPPED)
        assert not comes_in(listener, "127.0.0.3")


def test_version_4_is_told_apart_on_a_socket_of_both() -> None:
    with contextlib.ExitStack() as stack:
        try:
            listener = stack.enter_context(listening("::"))
        except OSError:
            pytest.skip("this machine has no IPv6")
        dropped = SourceFilter(listener)
        for number in range(MOST_SOURCES - 2):  # all of version 6 are behind as many of version 4
            assert dropped.drop(f"10.0.0.{number}", 5.0)
        assert dropped.drop(DROPPED, 5.0)
        assert not comes_in(listener, DROPPED)
        assert comes_in(listener, "127.0.0.3")
        assert comes_in(listener, "::1", to="::1")
        assert dropped.drop("::/64", 5.0)
        assert not comes_in(listener, "::1", to="::1")
        assert not dropped.drop("127.0.0.3", 5.0)  # one too many: closed, as before
        assert comes_in(listener, "127.0.0.3")


def test_what_was_accepted_is_heard_whatever_is_dropped_later() -> None:
    with listening() as listener:
        dropped = SourceFilter(listener)
        assert dropped.drop("127.0.0.9", 5.0)
        name = listener.getsockname()
        with socket.create_connection(name, source_address=(DROPPED, 0)) as client:
            connection, _ = listener.accept()
            with connection:
                dropped.let_go(connection)
                with pytest.raises(FileNotFoundError):  # there is none to take off
                    connection.setsockopt(socket.SOL_SOCKET, 27, 0)
                assert dropped.drop(DROPPED, 5.0)
                client.sendall(b"x")
                connection.settimeout(5)
                assert connection.recv(1) == b"x"


def test_whoever_listens_next_begins_with_nothing() -> None:
    """A worker that died, or hangs, cannot say that the time is over."""
    with listening() as listener:
        assert SourceFilter(listener).drop(DROPPED, 1e9)
        assert not comes_in(listener, DROPPED)
        SourceFilter(listener)
        assert comes_in(listener, DROPPED)


def test_where_the_system_takes_no_longer_program_nothing_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with listening() as listener:
        dropped = SourceFilter(listener)
        assert dropped.drop(DROPPED, 5.0)
        monkeypatch.setattr(source_filter, "filter_program", lambda _: bytes(8 * 5000))
        assert not dropped.drop("127.0.0.3", 5.0)
        assert comes_in(listener, DROPPED)
        assert dropped.lift(0.0) is None


def test_as_many_as_may_be_of_version_6() -> None:
    with listening("::") as listener:
        dropped = SourceFilter(listener)
        for number in range(MOST_SOURCES):
            assert dropped.drop(f"2001:db8:0:{number:x}::/64", 5.0)


def test_a_program_in_bytes() -> None:
    words = filter_program(["1.2.3.4", "2001:db8::/64"])
    codes = [words[at] for at in range(0, len(words), 8)]
    assert codes == [0x30, 0x74, 0x15, 5, 0x20, 0x15, 6, 6, 0x20, 0x15, 0x20, 0x15, 6, 6]
    assert 0x01020304.to_bytes(4, sys.byteorder) in words
    with pytest.raises(ValueError, match="nowhere"):
        filter_program(["nowhere"])
