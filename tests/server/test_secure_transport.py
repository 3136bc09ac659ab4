"""TLS by real sockets and Python's own client: bytes, bounds, ends."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import ctypes.util
import hashlib
import os
import random
import socket
import ssl
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.bindings.openssl.binding import Binding
from server.test_access_watch import write_certificate

from terraport_server import secure_rooms
from terraport_server.secure_context import SecureContext
from terraport_server.secure_transport import READ_BYTES, SecureTransport
from terraport_server.small_reads import SmallReads

MIB = 1 << 20
PATTERN = random.Random(1).randbytes(4 * MIB)


class Peer(asyncio.Protocol):
    """The service's side: keeps what comes, and notes what it is told."""

    transport: SecureTransport

    def __init__(self) -> None:
        self.came = b""
        self.reads: list[int] = []
        self.told: list[str] = []
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()
        self.room = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, SecureTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.reads.append(len(data))
        self.came += data

    def eof_received(self) -> None:
        self.told.append("end")

    def pause_writing(self) -> None:
        self.told.append("pause")
        self.room.clear()

    def resume_writing(self) -> None:
        self.told.append("resume")
        self.room.set()

    def connection_lost(self, error: Exception | None) -> None:
        self.lost.set_result(error)


Client = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def client_context() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def with_peer(
    folder: Path,
    work: Callable[[Peer, Client], Awaitable[None]],
    *,
    client: ssl.SSLContext | None = None,
    small: bool = False,
    receive_bytes: int = 0,
) -> None:
    """Connect a client of asyncio's to a transport, and work with both."""

    async def run() -> None:
        write_certificate(folder, "localhost")
        context = SecureContext(folder / "cert.pem", folder / "key.pem")
        loop = asyncio.get_running_loop()
        with socket.create_server(("127.0.0.1", 0)) as listener:
            if receive_bytes:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, receive_bytes)
            listener.setblocking(False)
            raw = socket.socket()
            if receive_bytes:
                raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
            raw.connect(listener.getsockname())
            raw.setblocking(False)
            accepted, _ = await loop.sock_accept(listener)
        peer = Peer()
        room = memoryview(bytearray(8 << 10))
        protocol: asyncio.BaseProtocol = SmallReads(peer, room) if small else peer
        coming = asyncio.open_connection(
            sock=raw, ssl=client or client_context(), server_hostname="localhost", limit=MIB
        )
        (reader, writer), _ = await asyncio.gather(
            coming, context.accept(accepted, lambda: protocol, 5.0, loop.call_soon)
        )
        try:
            async with asyncio.timeout(20):
                await work(peer, (reader, writer))
        finally:
            peer.transport.abort()
            writer.transport.abort()
            await peer.lost

    asyncio.run(run())


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(10):
        while not condition():  # noqa: ASYNC110 - what a protocol was told sets no event
            await asyncio.sleep(0.005)


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize("small", [False, True])
def test_bytes_arrive_both_ways(tmp_path: Path, version: ssl.TLSVersion, small: bool) -> None:
    client = client_context()
    client.minimum_version = client.maximum_version = version

    async def work(peer: Peer, ends: Client) -> None:
        reader, writer = ends
        writer.write(PATTERN[:MIB])
        got = b""
        peer.transport.write(b"")
        peer.transport.writelines([b"head", b"", memoryview(PATTERN), b"tail"])
        peer.transport.write(b"more")
        while not got.endswith(b"tailmore"):
            got += await reader.read(MIB)
        assert got == b"head" + PATTERN + b"tailmore"
        await until(lambda: len(peer.came) == MIB)
        assert peer.came == PATTERN[:MIB]
        assert max(peer.reads) <= (8 << 10 if small else 16 << 10)

    with_peer(tmp_path, work, client=client, small=small)


def test_what_the_socket_does_not_take_stays_with_the_sender(tmp_path: Path) -> None:
    """A landing is superseded by not sending on: one frame at most is in the transport."""
    frame = 128 << 10

    async def work(peer: Peer, ends: Client) -> None:
        transport = peer.transport
        transport.set_write_buffer_limits(0)
        head = bytes(40)
        room = bytearray(4 * frame)
        sent, hashed = 0, hashlib.sha256()
        while transport.get_write_buffer_size() == 0:  # until the socket is full
            room[:] = random.Random(sent).randbytes(len(room))
            buffers = [
                part for n in range(4) for part in (head, memoryview(room)[n * frame :][:frame])
            ]
            taken = transport.send_now(buffers)
            hashed.update(b"".join(buffers)[:taken])
            room[:] = bytes(len(room))  # it may change after the call
            sent += taken
        assert peer.told[-1] == "pause"
        assert taken % (frame + len(head)) == 0  # whole frames
        assert transport.get_write_buffer_size() <= 1.6 * frame
        assert transport.send_now([b"later"]) == 0
        got = hashlib.sha256()
        for count in range(0, sent, frame):
            got.update(await ends[0].readexactly(min(frame, sent - count)))
        assert got.digest() == hashed.digest()
        await peer.room.wait()
        assert transport.send_now([b"later"]) == 5
        assert await ends[0].readexactly(5) == b"later"

    with_peer(tmp_path, work, receive_bytes=64 << 10)


def test_a_paused_reader_hears_nothing_until_it_goes_on(tmp_path: Path) -> None:
    async def work(peer: Peer, ends: Client) -> None:
        peer.transport.pause_reading()
        assert not peer.transport.is_reading()
        ends[1].write(PATTERN[:100_000])
        await asyncio.sleep(0.05)
        assert peer.came == b""
        peer.transport.resume_reading()
        await until(lambda: len(peer.came) == 100_000)
        assert peer.came == PATTERN[:100_000]

    with_peer(tmp_path, work)


def test_a_reader_may_pause_within_what_one_read_brought(tmp_path: Path) -> None:
    """What OpenSSL has decrypted then is not seen by the event loop."""

    async def work(peer: Peer, ends: Client) -> None:
        hear = peer.data_received

        def pause(data: bytes) -> None:
            hear(data)
            peer.transport.pause_reading()

        peer.data_received = pause  # type: ignore[method-assign]
        ends[1].write(PATTERN[: 12 << 10])
        await until(lambda: bool(peer.came))
        await asyncio.sleep(0.02)
        assert len(peer.came) == 8 << 10
        peer.transport.resume_reading()
        await until(lambda: len(peer.came) == 12 << 10)

    with_peer(tmp_path, work, small=True)


def test_tiny_records_are_handed_on_together(tmp_path: Path) -> None:
    async def work(peer: Peer, ends: Client) -> None:
        peer.transport.pause_reading()
        for number in range(600):
            ends[1].write(bytes((number % 256,)))
        await asyncio.sleep(0.05)
        peer.transport.resume_reading()
        await until(lambda: len(peer.came) == 600)
        assert peer.came == bytes(number % 256 for number in range(600))
        assert 600 / 32 - 1 < len(peer.reads) < 100

    with_peer(tmp_path, work)


def test_tiny_records_do_not_gather(tmp_path: Path) -> None:
    """They were read faster than they were taken apart."""
    library = Binding.lib
    waiting: list[int] = []

    async def work(peer: Peer, ends: Client) -> None:
        hear = peer.data_received

        def note(data: bytes) -> None:
            hear(data)
            where = Binding.ffi.new("char **")
            waiting.append(library.BIO_get_mem_data(peer.transport._heard, where))

        peer.data_received = note  # type: ignore[method-assign]
        for number in range(8000):  # 184 kB
            ends[1].write(bytes((number % 256,)))
        await until(lambda: len(peer.came) == 8000)

    with_peer(tmp_path, work)
    assert 0 < max(waiting) <= READ_BYTES + 16_500


def test_a_close_sends_what_waits_and_says_that_it_was_all(tmp_path: Path) -> None:
    async def work(peer: Peer, ends: Client) -> None:
        peer.transport.write(PATTERN)
        assert peer.transport.get_write_buffer_size()
        peer.transport.close()
        peer.transport.write(b"too late")
        assert peer.transport.is_closing()
        assert await ends[0].read(-1) == PATTERN  # a cut would raise, in Python's client
        assert await peer.lost is None

    with_peer(tmp_path, work, receive_bytes=64 << 10)


def test_a_clients_end_is_heard_and_answered(tmp_path: Path) -> None:
    async def work(peer: Peer, ends: Client) -> None:
        ends[1].write(b"bye")
        ends[1].close()
        assert await peer.lost is None
        assert (peer.came, peer.told) == (b"bye", ["end"])

    with_peer(tmp_path, work)


def test_bytes_that_are_no_tls_end_the_connection(tmp_path: Path) -> None:
    async def work(peer: Peer, ends: Client) -> None:
        raw = ends[1].get_extra_info("socket")
        with socket.socket(fileno=os.dup(raw.fileno())) as same:
            same.send(b"no record of TLS" * 10)
        error = await peer.lost
        assert isinstance(error, ConnectionAbortedError)
        assert str(error)

    with_peer(tmp_path, work)


def test_an_abort_drops_what_waits(tmp_path: Path) -> None:
    async def work(peer: Peer, _: Client) -> None:
        peer.transport.write(PATTERN)
        peer.transport.abort()
        assert peer.transport.get_write_buffer_size() == 0
        assert await peer.lost is None
        assert peer.transport.raw.fileno() == -1

    with_peer(tmp_path, work, receive_bytes=64 << 10)


def test_buffers_are_given_back_but_those_of_who_sent_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(secure_rooms, "_GROWN", 0)

    async def work(peer: Peer, ends: Client) -> None:
        for _ in range(3):  # given back each time
            peer.transport.write(PATTERN[: 200 << 10])
            assert await ends[0].readexactly(200 << 10) == PATTERN[: 200 << 10]
        assert peer.transport._rooms.grown == {}

    with_peer(tmp_path, work)


def accept(folder: Path, first: bytes, timeout_s: float) -> str:
    """Return why somebody who sends this is not let in."""

    async def run() -> str:
        write_certificate(folder, "localhost")
        context = SecureContext(folder / "cert.pem", folder / "key.pem")
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            theirs.send(first)

            def never() -> Any:
                raise AssertionError

            with pytest.raises(OSError) as raised:
                await context.accept(ours, never, timeout_s, asyncio.get_running_loop().call_soon)
            return f"{type(raised.value).__name__}: {raised.value}"

    return asyncio.run(run())


@pytest.mark.parametrize(
    ("first", "text"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "ConnectionAbortedError: http request"),
        (b"\x16\x03\x01\x02\x00\x01", "TimeoutError: "),
    ],
)
def test_who_shakes_no_hands_gets_no_protocol(tmp_path: Path, first: bytes, text: str) -> None:
    assert accept(tmp_path, first, 0.2) == text


def client_hello() -> bytes:
    said = ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        client_context().wrap_bio(ssl.MemoryBIO(), said, server_hostname="localhost").do_handshake()
    return said.read()


def test_a_handshake_takes_turns_and_has_few_pieces(tmp_path: Path) -> None:
    """Whoever sent a byte at a time had a step each; six hundred of them took the loop."""

    async def run() -> None:
        write_certificate(tmp_path, "localhost")
        context = SecureContext(tmp_path / "cert.pem", tmp_path / "key.pem")
        ours, theirs = socket.socketpair()
        steps: list[Callable[[], None]] = []
        with ours, theirs:
            ours.setblocking(False)
            coming = asyncio.ensure_future(context.accept(ours, Peer, 10.0, steps.append))
            hello = client_hello()
            for at in range(65):
                assert not coming.done()
                theirs.send(hello[at : at + 1])
                await until(lambda: bool(steps))
                assert ours.recv(9, socket.MSG_PEEK) == hello[at : at + 1]  # not read before
                steps.pop()()
            with pytest.raises(ConnectionAbortedError, match="in 64 pieces"):
                await coming

    asyncio.run(run())


def test_who_left_a_handshake_waits_for_no_turn(tmp_path: Path) -> None:
    async def run() -> None:
        write_certificate(tmp_path, "localhost")
        context = SecureContext(tmp_path / "cert.pem", tmp_path / "key.pem")
        ours, theirs = socket.socketpair()
        steps: list[Callable[[], None]] = []
        with ours:
            ours.setblocking(False)
            theirs.close()
            with pytest.raises(ConnectionResetError):
                await context.accept(ours, Peer, 10.0, steps.append)
            assert steps == []

    asyncio.run(run())


@pytest.mark.parametrize("name", ["cert.pem", "key.pem"])
def test_what_is_no_certificate_is_refused(tmp_path: Path, name: str) -> None:
    write_certificate(tmp_path, "localhost")
    (tmp_path / name).write_text("no PEM")
    with pytest.raises(OSError, match=r"(?i)pem|start line"):
        SecureContext(tmp_path / "cert.pem", tmp_path / "key.pem")


def test_a_key_of_another_certificate_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    write_certificate(tmp_path, "localhost")
    write_certificate(tmp_path / "other", "localhost")
    with pytest.raises(OSError, match="mismatch"):
        SecureContext(tmp_path / "cert.pem", tmp_path / "other" / "key.pem")


class KeyChanger:
    """A client that changes keys again and again and asks for the same; by OpenSSL itself.

    Python's ``ssl`` and pyOpenSSL cannot.
    """

    def __init__(self, raw: socket.socket) -> None:
        name = ctypes.util.find_library("ssl")
        if name is None:
            pytest.skip("this machine has no libssl to load")
        self.lib = ctypes.CDLL(name)
        for call in ("TLS_client_method", "SSL_CTX_new", "SSL_new"):
            getattr(self.lib, call).restype = ctypes.c_void_p
        raw.setblocking(True)
        self.context = ctypes.c_void_p(
            self.lib.SSL_CTX_new(ctypes.c_void_p(self.lib.TLS_client_method()))
        )
        self.ssl = ctypes.c_void_p(self.lib.SSL_new(self.context))
        assert self.lib.SSL_set_fd(self.ssl, raw.fileno()) == 1

    def shake_hands(self) -> None:
        assert self.lib.SSL_connect(self.ssl) == 1

    def change(self, times: int) -> int:
        """Return how often it could: no more once the socket takes nothing for half a second."""
        for done in range(times):
            self.lib.SSL_key_update(self.ssl, 1)  # and asks for the peer's
            if self.lib.SSL_do_handshake(self.ssl) != 1:
                return done
        return times

    def close(self) -> None:
        self.lib.SSL_free(self.ssl)
        self.lib.SSL_CTX_free(self.context)


def test_answers_to_changes_of_keys_are_bounded(tmp_path: Path) -> None:
    """A client that reads nothing had as many of them kept as it asked for."""

    async def run() -> None:
        write_certificate(tmp_path, "localhost")
        context = SecureContext(tmp_path / "cert.pem", tmp_path / "key.pem")
        loop = asyncio.get_running_loop()
        with socket.create_server(("127.0.0.1", 0)) as listener, socket.socket() as raw:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
            listener.setblocking(False)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
            raw.connect(listener.getsockname())
            accepted, _ = await loop.sock_accept(listener)
            client, peer = KeyChanger(raw), Peer()
            timeout = struct.pack("ll", 0, 500_000)
            await asyncio.gather(
                asyncio.to_thread(client.shake_hands),
                context.accept(accepted, lambda: peer, 5.0, loop.call_soon),
            )
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)
            done = await asyncio.to_thread(client.change, 20_000)
            most_bytes = peer.transport.get_write_buffer_size()
            assert 0 < most_bytes < 64 << 10
            assert done < 20_000
            # All is answered as soon as it reads, and heard again.
            raw.setblocking(False)
            async with asyncio.timeout(10):
                while peer.transport.get_write_buffer_size():
                    await loop.sock_recv(raw, 1 << 16)
            assert peer.transport._may_hear()
            peer.transport.abort()
            await peer.lost
            client.close()

    asyncio.run(run())
