"""Memory that all TLS connections of one event loop share, and what OpenSSL says."""

from __future__ import annotations

from typing import Final, Protocol

from cryptography.hazmat.bindings.openssl.binding import Binding
from OpenSSL import SSL

from terraport_server.sending_transport import READ_ROOM_BYTES

__all__ = [
    "BATCH_BYTES",
    "HIGH_WATER_BYTES",
    "MOST_BYTES",
    "MOST_OWN_BYTES",
    "PIECE_BYTES",
    "RECORDS_AT_ONCE",
    "ROOM_BYTES",
    "Rooms",
    "said_by_openssl",
]

ROOM_BYTES: Final = 256 << 10
"""For what is encrypted and not sent yet."""

PIECE_BYTES: Final = 128 << 10
"""Encrypted by one call."""

BATCH_BYTES: Final = 96 << 10
"""So much is sent by one call as soon as a buffer of the caller's ends."""

MOST_BYTES: Final = ROOM_BYTES - PIECE_BYTES - (8 << 10)
"""In the room when another piece is put there: TLS adds 22 bytes to each 16 KiB."""

RECORDS_AT_ONCE: Final = 32
"""Of one read; more, which are tiny, in another step of the loop."""

HIGH_WATER_BYTES: Final = 64 << 10
"""As the event loops have it."""

MOST_OWN_BYTES: Final = 16 << 10
"""Of OpenSSL's own that waits for the socket; then nothing more is read until all of it is gone."""

_GROWN: Final = 64
"""Connections that keep OpenSSL's own buffer, 170 KiB: those that sent last."""


class Shrinks(Protocol):
    """A connection whose buffer can be given back."""

    def shrink(self) -> None:
        """Give it back; it is empty, and grows again."""


class Rooms:
    """What bytes of all connections of one event loop go through, one batch at a time."""

    __slots__ = ("grown", "read", "sent", "sent_at")

    def __init__(self) -> None:
        self.read = memoryview(bytearray(READ_ROOM_BYTES))
        self.sent = memoryview(bytearray(ROOM_BYTES))
        self.sent_at = Binding.ffi.from_buffer(self.sent)
        self.grown: dict[Shrinks, None] = {}
        """Whose buffers are large, the one that sent last in the end."""

    def grew(self, transport: Shrinks) -> None:
        """Note that one has sent; another one's buffer is given back where there are many."""
        self.grown.pop(transport, None)
        self.grown[transport] = None
        if len(self.grown) > _GROWN:
            oldest = next(iter(self.grown))
            del self.grown[oldest]
            oldest.shrink()


def said_by_openssl(error: SSL.Error) -> str:
    """Return OpenSSL's words."""
    if error.args and isinstance(error.args[0], list):
        return "; ".join(words[-1] for words in error.args[0])
    return str(error) or type(error).__name__
