"""Who is turned away at the door, how many are let in at once, and TLS that goes nowhere."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.test_access_watch import write_certificate

from terraport_server import BackgroundServer
from terraport_server.doorway import _LET_IN_AT_ONCE, Doorway
from terraport_server.entrance import Entrance
from terraport_server.secure_context import SecureContext

KEY = "127.0.0.1"


class Guest(asyncio.Protocol):
    def __init__(self, entrance: Entrance) -> None:
        self.entrance = entrance

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.entrance.addresses.enter(KEY)


def at_door(
    count: int, entrance: Entrance, watch: Callable[[list[Guest]], Awaitable[None]]
) -> list[str]:
    """Have so many connections wait, then open the door; return what those turned away are told."""
    told: list[str] = []

    async def work() -> None:
        with (
            socket.create_server(("127.0.0.1", 0), backlog=count) as listener,
            ExitStack() as stack,
        ):
            listener.setblocking(False)
            for _ in range(count):
                stack.enter_context(socket.create_connection(listener.getsockname()))
            guests: list[Guest] = []

            def come() -> Guest:
                guests.append(Guest(entrance))
                return guests[-1]

            doorway = Doorway(
                listener,
                come,
                entrance,
                lambda reason, text, host: told.append(f"{reason} {host}: {text}"),
                tls=None,
                handshake_timeout_s=1.0,
                max_coming=1000,
            )
            await watch(guests)
            doorway.close()
            await doorway.wait_closed()

    asyncio.run(work())
    return told


def test_one_is_let_in_in_a_step_of_the_loop() -> None:
    """All that waited were, 2,048 of them 0.1 to 0.2 ms each, before anybody else had a turn."""
    most = 0

    async def watch(guests: list[Guest]) -> None:
        nonlocal most
        before = 0
        while len(guests) < 100:
            await asyncio.sleep(0)
            most, before = max(most, len(guests) - before), len(guests)

    assert at_door(100, Entrance("", 1 << 20, 1000), watch) == []
    assert most == 1


def test_who_is_one_too_many_gets_no_protocol() -> None:
    entrance = Entrance("", 1 << 20, 2)

    async def watch(guests: list[Guest]) -> None:
        await asyncio.sleep(0.2)
        assert len(guests) <= 2 * 2 + _LET_IN_AT_ONCE  # those on their way when it is full

    told = at_door(40, entrance, watch)
    assert len(told) >= 40 - 4 - _LET_IN_AT_ONCE
    assert told[0].startswith("connections 127.0.0.1: got connection")


def test_who_came_in_vain_again_and_again_is_turned_away() -> None:
    entrance = Entrance("", 1 << 20, 2)
    now_s = 0.0
    for _ in range(4):
        entrance.addresses.came_in_vain("a", now_s)
    assert entrance.turns_away("a", now_s) is None
    entrance.addresses.came_in_vain("a", now_s)
    assert "for nothing" in (entrance.turns_away("a", now_s) or "")
    assert entrance.turns_away("b", now_s) is None


def test_silent_handshakes_leave_room_for_another_address(tmp_path: Path) -> None:
    """As many as may be under way kept everybody out until their time was over."""

    async def work() -> None:
        write_certificate(tmp_path, "localhost")
        context = SecureContext(tmp_path / "cert.pem", tmp_path / "key.pem")
        entrance = Entrance("", 1 << 20, 1000)
        with socket.create_server(("127.0.0.1", 0)) as listener, ExitStack() as stack:
            listener.setblocking(False)
            doorway = Doorway(
                listener,
                asyncio.Protocol,
                entrance,
                lambda *_: None,
                tls=context,
                handshake_timeout_s=60.0,
                max_coming=4,
            )
            name = listener.getsockname()
            for _ in range(6):
                stack.enter_context(socket.create_connection(name))
            await asyncio.sleep(0.1)
            client = ssl.create_default_context()
            client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
            async with asyncio.timeout(5):
                _, writer = await asyncio.open_connection(
                    *name, ssl=client, local_addr=("127.0.0.2", 0)
                )
            writer.transport.abort()
            assert entrance.addresses.in_vain("127.0.0.2", 0.0) == 0
            doorway.close()
            for waiting in list(doorway._coming):
                waiting.cancel()
            await doorway.wait_closed()

    asyncio.run(work())


def test_who_gives_way_is_not_half_let_in() -> None:
    """Given up between `connection_made` and the next step, it was never told of its end.

    uvloop closes such a transport without a word, and the connection counted for its address, and
    for all, for ever.
    """
    uvloop = pytest.importorskip("uvloop")
    made: list[Host] = []

    class Host(asyncio.Protocol):
        is_lost = False

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            made.append(self)
            # The next one is greeted in the same step, and the room is his.
            assert doorway is not None
            doorway._make_room("127.0.0.2")

        def connection_lost(self, exc: Exception | None) -> None:
            self.is_lost = True

    doorway: Doorway | None = None

    async def work() -> None:
        nonlocal doorway
        with socket.create_server(("127.0.0.1", 0)) as listener:
            listener.setblocking(False)
            doorway = Doorway(
                listener, Host, Entrance("", 1 << 20, 1000), lambda *_: None,
                tls=None, handshake_timeout_s=1.0, max_coming=1,
            )  # fmt: skip
            with socket.create_connection(listener.getsockname()):
                await asyncio.sleep(0.2)
                assert not made[0].is_lost
            await asyncio.sleep(0.2)
            assert made[0].is_lost  # now that the client left
            doorway.close()
            await doorway.wait_closed()

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(work())


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's filters are Linux'")
def test_who_is_turned_away_for_a_time_is_not_even_accepted() -> None:
    """Each was accepted and closed, 50 to 100 us of everybody's: 1,000 a second of an address."""
    told: list[str] = []

    async def work() -> None:
        entrance = Entrance("", 1 << 20, 2)
        with socket.create_server(("127.0.0.1", 0)) as listener, ExitStack() as stack:
            listener.setblocking(False)
            doorway = Doorway(
                listener, lambda: Guest(entrance), entrance, lambda _, text, __: told.append(text),
                tls=None, handshake_timeout_s=1.0, max_coming=1000,
            )  # fmt: skip
            for _ in range(5):
                entrance.addresses.came_in_vain(KEY, asyncio.get_running_loop().time())

            def come(source: str) -> socket.socket:
                name = listener.getsockname()
                made = socket.create_connection(name, 0.2, source_address=(source, 0))
                return stack.enter_context(made)

            def is_closed(source: str) -> bool:
                return come(source).recv(1) == b""

            assert await asyncio.to_thread(is_closed, KEY)
            assert len(told) == 1
            for _ in range(3):
                with pytest.raises(TimeoutError):
                    await asyncio.to_thread(come, KEY)
            assert len(told) == 1
            come("127.0.0.2")
            doorway._dropped.lift(float("inf"))  # its time is over
            entrance.addresses._in_vain.clear()
            come(KEY)
            await asyncio.sleep(0.05)
            assert len(told) == 1
            doorway.close()
            await doorway.wait_closed()

    asyncio.run(work())


def test_a_handshake_that_fails_came_for_nothing(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "scenes" / "grid", cells=2)
    write_certificate(tmp_path, "localhost")
    with BackgroundServer(
        tmp_path / "scenes",
        tls_certificate=tmp_path / "cert.pem",
        tls_key=tmp_path / "key.pem",
        max_connections_per_ip=2,
        forwarded_allow_ips="",
    ) as server:

        def is_turned_away() -> bool:
            with socket.create_connection(("127.0.0.1", server.port)) as raw:
                raw.sendall(b"GET / HTTP/1.1\r\n\r\n")
                raw.settimeout(5)
                try:
                    return raw.recv(100) == b""  # else an alert
                except ConnectionError:
                    return True

        assert sum(is_turned_away() for _ in range(12)) >= 12 - 2 * 2 - 2


@pytest.mark.parametrize("first", [b"", b"\x16\x03\x01\x02\x00\x01"], ids=["silent", "half"])
def test_half_a_tls_handshake_counts_and_ends(tmp_path: Path, first: bytes) -> None:
    """It had a minute, and counted for nobody."""
    write_grid_scene(tmp_path / "scenes" / "grid", cells=2)
    write_certificate(tmp_path, "localhost")
    with (
        BackgroundServer(
            tmp_path / "scenes",
            tls_certificate=tmp_path / "cert.pem",
            tls_key=tmp_path / "key.pem",
            http_header_timeout_s=1.0,
            max_connections_per_ip=2,
            forwarded_allow_ips="",
        ) as server,
        ExitStack() as stack,
    ):
        began_s = time.monotonic()
        raws = []
        for _ in range(12):
            raw = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            raw.setblocking(False)
            with contextlib.suppress(OSError):
                raw.sendall(first)
            raws.append(raw)

        def ended() -> int:
            return sum(has_ended(raw) for raw in raws)

        eventually(lambda: ended() >= 12 - 2 * 2 - _LET_IN_AT_ONCE)
        eventually(lambda: ended() == 12, 20)
        assert time.monotonic() - began_s < 30


def has_ended(raw: socket.socket) -> bool:
    try:
        while raw.recv(4096, socket.MSG_PEEK):
            raw.recv(4096)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
