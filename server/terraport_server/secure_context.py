"""The service's certificate, and the handshake of whoever comes with TLS."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

from cryptography.hazmat.bindings.openssl.binding import Binding
from OpenSSL import SSL

from terraport_server.secure_rooms import Rooms, said_by_openssl
from terraport_server.secure_transport import READ_BYTES, SecureTransport

__all__ = ["SecureContext"]

_MAX_PIECES: Final = 64
"""Of a handshake, as they are read; by a line of small packets it comes in ten."""


class SecureContext:
    """Certificate and key of this service; read again while it runs.

    Parameters
    ----------
    certificate, key
        Of PEM.

    Raises
    ------
    OSError
        As of :meth:`load`.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self._paths = certificate, key
        self._rooms = Rooms()
        self._current = self.load()

    def load(self) -> SSL.Context:
        """Read both again; :meth:`use` puts what was read in force.

        Raises
        ------
        OSError
            When one cannot be read, is no PEM, or they do not belong together.
        """
        certificate, key = self._paths
        context = SSL.Context(SSL.TLS_SERVER_METHOD)
        context.set_min_proto_version(SSL.TLS1_2_VERSION)
        context.set_options(SSL.OP_NO_RENEGOTIATION | SSL.OP_CIPHER_SERVER_PREFERENCE)
        # A send encrypts all it is given; and who waits for something to read has no buffer.
        context.clear_mode(Binding.lib.SSL_MODE_ENABLE_PARTIAL_WRITE)
        context.set_mode(SSL.MODE_RELEASE_BUFFERS)
        context.set_session_cache_mode(SSL.SESS_CACHE_OFF)  # clients keep theirs, as tickets
        for path in (certificate, key):
            path.read_bytes()  # OpenSSL does not say which is missing
        try:
            context.use_certificate_chain_file(str(certificate))
            context.use_privatekey_file(str(key))
            context.check_privatekey()
        except SSL.Error as error:
            raise OSError(said_by_openssl(error)) from None
        return context

    def use(self, context: SSL.Context) -> None:
        """Show this certificate to whoever comes from now on."""
        self._current = context

    async def accept(
        self,
        connection: socket.socket,
        make_protocol: Callable[[], asyncio.BaseProtocol],
        timeout_s: float,
        take_turn: Callable[[Callable[[], None]], None],
    ) -> SecureTransport:
        """Shake hands, then connect a protocol.

        Parameters
        ----------
        connection
            Accepted, not blocking; the transport's from then on.
        make_protocol
            Called after the handshake.
        timeout_s
            Of the handshake.
        take_turn
            Has each step of the handshake done, in a later step of the loop.

        Raises
        ------
        OSError
            When it fails, takes longer (`TimeoutError`), or comes in more than 64 pieces.
        """
        loop = asyncio.get_running_loop()
        if connection.family in {socket.AF_INET, socket.AF_INET6}:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        handshake = _Handshake(loop, connection, self._current, take_turn)
        try:
            async with asyncio.timeout(timeout_s):
                tls = await handshake.done
        finally:
            handshake.stop()
        transport = SecureTransport(loop, connection, tls, make_protocol(), self._rooms)
        transport.begin()
        return transport


class _Handshake:
    """Reads, computes and answers one piece at a time, each when it is this client's turn.

    That something came costs a callback; a coroutine that reads by itself cost everybody who shook
    hands a step at once, and six hundred who send a byte at a time took the loop.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        connection: socket.socket,
        context: SSL.Context,
        take_turn: Callable[[Callable[[], None]], None],
    ) -> None:
        self.done: asyncio.Future[SSL.Connection] = loop.create_future()
        """Set when hands are shaken; fails with `OSError`."""
        self._loop = loop
        self._connection = connection
        self._context = context
        self._tls: SSL.Connection | None = None
        """Made when something came, and it is this client's turn: OpenSSL takes 0.1 MB."""
        self._take_turn = take_turn
        self._pieces = 0
        self._unsent = b""
        self._is_shaken = False
        loop.add_reader(connection.fileno(), self._on_readable)

    def stop(self) -> None:
        """Watch the socket no more."""
        self._loop.remove_reader(self._connection.fileno())
        self._loop.remove_writer(self._connection.fileno())

    def _on_readable(self) -> None:
        self._loop.remove_reader(self._connection.fileno())
        try:
            is_gone = not self._connection.recv(1, socket.MSG_PEEK)
        except OSError:
            is_gone = True
        if not is_gone:
            self._take_turn(self._step)
        elif not self.done.done():  # its turn would be for nothing, and its memory is wanted
            self.done.set_exception(ConnectionResetError())

    def _step(self) -> None:
        if self.done.done():  # it took too long meanwhile
            return
        try:
            self._read()
            self._send()
        except BlockingIOError:
            self._loop.add_reader(self._connection.fileno(), self._on_readable)
        except OSError as error:
            self.done.set_exception(error)

    def _read(self) -> None:
        heard = self._connection.recv(READ_BYTES)
        if not heard:
            raise ConnectionResetError
        self._pieces += 1
        if self._pieces > _MAX_PIECES:
            raise ConnectionAbortedError(f"got no handshake in {_MAX_PIECES} pieces, expected one")
        if self._tls is None:
            self._tls = SSL.Connection(self._context, None)
            self._tls.set_accept_state()
        self._tls.bio_write(heard)
        self._is_shaken = _shakes_hands(self._tls, self._connection)
        self._unsent = _said_by(self._tls)

    def _send(self) -> None:
        """Send what there is to say, then end or go on reading."""
        if self._unsent:
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[self._connection.send(self._unsent) :]
        if self._unsent:
            self._loop.add_writer(self._connection.fileno(), self._on_writable)
        elif self._is_shaken and self._tls is not None:
            self.done.set_result(self._tls)
        else:
            self._loop.add_reader(self._connection.fileno(), self._on_readable)

    def _on_writable(self) -> None:
        self._loop.remove_writer(self._connection.fileno())
        try:
            self._send()
        except OSError as error:
            self.done.set_exception(error)


def _shakes_hands(tls: SSL.Connection, connection: socket.socket) -> bool:
    """Go on with a handshake; tell whether it is done."""
    try:
        tls.do_handshake()
    except SSL.WantReadError:
        return False
    except SSL.Error as error:
        with contextlib.suppress(SSL.Error, OSError):
            connection.send(tls.bio_read(READ_BYTES))  # the alert
        raise ConnectionAbortedError(said_by_openssl(error)) from None
    return True


def _said_by(tls: SSL.Connection) -> bytes:
    """Return what a handshake wants to be sent."""
    said = b""
    with contextlib.suppress(SSL.WantReadError):
        while True:
            said += tls.bio_read(READ_BYTES)
    return said
