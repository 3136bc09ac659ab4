"""TLS in this process: whole batches of records into one buffer, and one call for each batch.

Python's own ``ssl`` encrypts a record a call, 16 KiB, and copies it three times before the socket
has it; the event loops add a buffer of 256 KiB to each connection. Here OpenSSL, by pyOpenSSL,
encrypts a frame at once, without the interpreter's lock, into a buffer that all connections of the
process share. What the socket does not take of it is kept, a frame at most; what was not encrypted
yet stays with whoever sends it, so that a newer landing can take it back. Measured:
``docs/decisions/0104-tls-by-a-library-that-writes-batches.md``.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterable, Sequence
from typing import Any, Final

from cryptography.hazmat.bindings.openssl.binding import Binding
from OpenSSL import SSL

from terraport_server import secure_rooms
from terraport_server.secure_rooms import ROOM_BYTES, Rooms, said_by_openssl
from terraport_server.sending_transport import Data, SendingTransport

__all__ = ["READ_BYTES", "SecureTransport"]

READ_BYTES: Final = 16 << 10
"""Of the socket, at a time."""

_LIB: Final = Binding.lib
_FFI: Final = Binding.ffi
"""pyOpenSSL's own ``send`` and ``bio_read`` make objects of what passes: a tenth of what TLS costs.
"""


class SecureTransport(SendingTransport):
    """One TLS connection. Everything happens on the loop's thread.

    Parameters
    ----------
    loop
        Of those that can watch sockets: not Windows' proactor.
    connection
        Not blocking; closed with the transport.
    tls
        Its handshake done.
    protocol
        Told of it by :meth:`begin`.
    rooms
        Shared by all of the loop.
    """

    __slots__ = (
        "_backlog", "_backlog_bytes", "_connection", "_heard", "_high_bytes", "_is_closing",
        "_is_lost", "_is_paused", "_is_watched", "_loop", "_low_bytes", "_own_bytes", "_protocol",
        "_rest_is_due", "_rooms", "_said", "_ssl", "_tls", "_write_is_paused",
    )  # fmt: skip

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        connection: socket.socket,
        tls: SSL.Connection,
        protocol: asyncio.BaseProtocol,
        rooms: Rooms,
    ) -> None:
        super().__init__()
        self._rooms = rooms
        self._loop = loop
        self._connection = connection
        self._tls = tls
        # All that is used of pyOpenSSL's insides.
        self._ssl, self._heard, self._said = tls._ssl, tls._into_ssl, tls._from_ssl  # noqa: SLF001
        self._protocol: Any = protocol
        self._backlog: list[memoryview] = []  # short; and an empty deque takes 0.8 KB
        """Encrypted, for the socket."""
        self._backlog_bytes = self._own_bytes = 0
        self._high_bytes = secure_rooms.HIGH_WATER_BYTES
        self._low_bytes = secure_rooms.HIGH_WATER_BYTES // 4
        self._write_is_paused = False
        self._is_closing = False
        self._is_lost = False
        self._is_paused = False
        self._is_watched = False
        """Whether the loop watches for something to read; paused, it does until something comes."""
        self._rest_is_due = False
        """Whether what was read and not handed on is looked at in the loop's next step."""

    def begin(self) -> None:
        """Tell the protocol, and begin to read."""
        self._protocol.connection_made(self)
        self._watch()
        self._rest_soon()  # what came with the end of the handshake

    @property
    def raw(self) -> socket.socket:
        """The socket, to set its options."""
        return self._connection

    @property
    def read_room(self) -> memoryview:
        """Room to read into what is then sent; the loop's."""
        return self._rooms.read

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return what the socket tells; ``sslcontext`` as it is one of TLS."""
        if name == "sslcontext":
            return self._tls.get_context()
        return super().get_extra_info(name, default)

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Hand what comes to another one from now on."""
        self._protocol = protocol

    def get_protocol(self) -> Any:
        """Return whom what comes is handed to."""
        return self._protocol

    def is_closing(self) -> bool:
        """Whether nothing more is taken."""
        return self._is_closing

    def is_reading(self) -> bool:
        """Whether what comes is handed on."""
        return not (self._is_closing or self._is_paused)

    def pause_reading(self) -> None:
        """Hand nothing on; the socket is watched until something comes: most pauses are short."""
        self._is_paused = True

    def resume_reading(self) -> None:
        """Hand on again."""
        if self._is_paused and not self._is_closing:
            self._is_paused = False
            self._watch()
            self._rest_soon()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Set when the protocol is told to pause, and to go on."""
        if high is None:
            high = secure_rooms.HIGH_WATER_BYTES if low is None else 4 * low
        self._high_bytes, self._low_bytes = high, high // 4 if low is None else low
        self._tell_full()

    def get_write_buffer_size(self) -> int:
        """Return how many bytes wait for the socket."""
        return self._backlog_bytes

    def write(self, data: Data) -> None:
        """Send, or keep what the socket does not take."""
        self.writelines((data,))

    def writelines(self, list_of_data: Iterable[Data]) -> None:
        """Send by as few calls as that takes, or keep what the socket does not take."""
        if self._is_closing:
            return
        buffers = [data for data in list_of_data if len(data)]
        taken = self.send_now(buffers)
        for data in buffers:
            if taken < len(data):
                where, size = _FFI.from_buffer(data), len(data)
                for start in range(taken, size, secure_rooms.PIECE_BYTES):
                    count = min(secure_rooms.PIECE_BYTES, size - start)
                    self._keep(0, self._encrypt(where + start, count, 0))
            taken = max(0, taken - len(data))
        self._tell_full()

    def send_now(self, buffers: Sequence[Data]) -> int:
        """Send what the socket takes now; see :class:`SendingTransport`."""
        if self._backlog or self._is_closing:
            return 0
        taken = at = 0
        for data in buffers:
            where, size, start = _FFI.from_buffer(data), len(data), 0
            while start < size:
                count = min(secure_rooms.PIECE_BYTES, size - start)
                at = self._encrypt(where + start, count, at)
                start, taken = start + count, taken + count
                if at >= (secure_rooms.BATCH_BYTES if start == size else secure_rooms.MOST_BYTES):
                    if not self._push(at):
                        self._rooms.grew(self)
                        return taken
                    at = 0
        if at:
            self._push(at)
        if taken >= READ_BYTES:
            self._rooms.grew(self)
        return taken

    def close(self) -> None:
        """Send what waits, say that this was all, and close; ``connection_lost`` follows."""
        if not self._is_closing:
            self._is_closing = True
            self._unwatch()
            if not self._backlog:
                self._loop.call_soon(self._say_end)

    def abort(self) -> None:
        """Close now and drop what waits."""
        self._lose(None)

    def shrink(self) -> None:
        """Give back the buffer that OpenSSL writes to; it is empty, and grows again."""
        if not self._is_lost:
            self._said = _LIB.BIO_new(_LIB.BIO_s_mem())
            _LIB.SSL_set_bio(self._ssl, self._heard, self._said)  # frees the one before

    def _watch(self) -> None:
        if not (self._is_watched or self._is_paused or self._is_closing):
            self._is_watched = True
            self._loop.add_reader(self._connection.fileno(), self._on_readable)

    def _unwatch(self) -> None:
        if self._is_watched:
            self._is_watched = False
            self._loop.remove_reader(self._connection.fileno())

    def _on_readable(self) -> None:
        if not self._may_hear():
            self._unwatch()
            return
        if self._rest_is_due:
            return  # what was read goes first, or a peer's tiny records would gather here
        try:
            heard = self._connection.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error)
            return
        if heard:
            self._tls.bio_write(heard)
            self._hand_on()
        else:
            self._hear_end()

    def _rest_soon(self) -> None:
        if not self._rest_is_due:
            self._rest_is_due = True
            self._loop.call_soon(self._hand_on_rest)

    def _hand_on_rest(self) -> None:
        self._rest_is_due = False
        if self._may_hear():
            self._hand_on()

    def _may_hear(self) -> bool:
        """Whether anything is read: who takes no answers to changes of keys may ask for no more."""
        return self.is_reading() and self._own_bytes <= secure_rooms.MOST_OWN_BYTES

    def _hand_on(self) -> None:
        """Decrypt what came and hand it on, all at once; what has no room, in another step."""
        protocol = self._protocol
        is_buffered = isinstance(protocol, asyncio.BufferedProtocol)
        room: Any = protocol.get_buffer(-1) if is_buffered else None
        left, data, end = READ_BYTES if room is None else len(room), b"", None
        try:
            for _ in range(secure_rooms.RECORDS_AT_ONCE):
                piece = self._tls.recv(left)
                data, left = data + piece if data else piece, left - len(piece)
                if not left:
                    break
        except SSL.Error as error:  # nothing more is here, or will come
            end = error
        if data and room is not None:
            room[: len(data)] = data
            protocol.buffer_updated(len(data))
        elif data:
            protocol.data_received(data)
        if not self._is_lost:
            self._say_own()
        if end is None:
            self._rest_soon()
        elif isinstance(end, SSL.ZeroReturnError):
            self._hear_end()
        elif not isinstance(end, SSL.WantReadError):
            self._lose(ConnectionAbortedError(said_by_openssl(end)))

    def _hear_end(self) -> None:
        """Close as well, after what waits, whatever the protocol says: there is no half of it."""
        if not self._is_closing:
            self._protocol.eof_received()
            self.close()

    def _say_own(self) -> None:
        """Send what OpenSSL has to say by itself: alerts, answers to changes of keys."""
        count = self._read_out(0)
        if count and (self._backlog or self._is_closing):
            self._keep(0, count)
        elif count:
            self._push(count)
        if self._backlog:
            self._own_bytes += count

    def _encrypt(self, where: Any, count: int, at: int) -> int:
        """Put some bytes into the room for what is sent; return where they end there."""
        if self._is_lost:
            return at
        if _LIB.SSL_write(self._ssl, where, count) != count:
            _LIB.ERR_clear_error()  # or it would be taken for another connection's
            self._lose(ConnectionAbortedError("TLS: the connection was ended"))
            return at
        return at + int(_LIB.BIO_read(self._said, self._rooms.sent_at + at, ROOM_BYTES - at))

    def _read_out(self, at: int) -> int:
        """Take what OpenSSL wants to be sent; return how much that is."""
        return max(0, int(_LIB.BIO_read(self._said, self._rooms.sent_at + at, ROOM_BYTES - at)))

    def _push(self, count: int) -> bool:
        """Send what the room has; tell whether the socket took all. The rest is kept."""
        try:
            sent = self._connection.send(self._rooms.sent[:count])
        except BlockingIOError:
            sent = 0
        except OSError as error:
            self._lose(error)
            return False
        if sent < count:
            self._keep(sent, count)
            self._tell_full()
        return sent == count

    def _keep(self, start: int, stop: int) -> None:
        if self._is_lost or start == stop:
            return
        if not self._backlog:
            self._loop.add_writer(self._connection.fileno(), self._on_writable)
        self._backlog.append(memoryview(bytes(self._rooms.sent[start:stop])))
        self._backlog_bytes += stop - start

    def _on_writable(self) -> None:
        backlog = self._backlog
        try:
            while backlog:
                sent = self._connection.send(backlog[0])
                self._backlog_bytes -= sent
                backlog[0] = backlog[0][sent:]
                if backlog[0]:
                    break
                del backlog[0]
        except BlockingIOError:
            pass
        except OSError as error:
            self._lose(error)
            return
        if not backlog:
            self._loop.remove_writer(self._connection.fileno())
            was_deaf, self._own_bytes = self._own_bytes > secure_rooms.MOST_OWN_BYTES, 0
            if was_deaf:
                self._watch()
                self._rest_soon()
        if self._write_is_paused and self._backlog_bytes <= self._low_bytes:
            self._write_is_paused = False
            self._protocol.resume_writing()
        if self._is_closing and not (self._backlog or self._is_lost):
            self._say_end()

    def _tell_full(self) -> None:
        if self._backlog_bytes > self._high_bytes and not self._write_is_paused:
            self._write_is_paused = True
            self._protocol.pause_writing()

    def _say_end(self) -> None:
        """Say by TLS that this was all, where the socket takes it, and close.

        The peer's own word is not waited for: whoever has to know whether all has come counts bytes
        or frames.
        """
        if self._is_lost:
            return
        with contextlib.suppress(SSL.Error, OSError):
            self._tls.shutdown()
            self._connection.send(self._rooms.sent[: self._read_out(0)])
        self._lose(None)

    def _lose(self, error: OSError | None) -> None:
        if self._is_lost:
            return
        self._is_closing = self._is_lost = True
        self._unwatch()
        if self._backlog:
            self._loop.remove_writer(self._connection.fileno())
            self._backlog.clear()
            self._backlog_bytes = 0
        self._rooms.grown.pop(self, None)
        self._loop.call_soon(self._end, error)

    def _end(self, error: OSError | None) -> None:
        protocol, self._protocol = self._protocol, None  # no ring for the search for garbage
        try:
            protocol.connection_lost(error)
        finally:
            self._connection.close()
