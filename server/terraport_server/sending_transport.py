"""A transport that says how much the socket took, instead of keeping the rest."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Final

__all__ = ["READ_ROOM_BYTES", "Data", "SendingTransport"]

READ_ROOM_BYTES: Final = 128 << 10
"""Of a file, before it is encrypted: still in the processor's cache then."""

Data = bytes | bytearray | memoryview


class SendingTransport(asyncio.Transport):
    """What a sender of payload needs where it cannot go past its transport: under TLS."""

    __slots__ = ()

    @property
    @abstractmethod
    def raw(self) -> socket.socket:
        """The socket, to set its options."""

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return the socket, or an address of it."""
        if name == "socket":
            return self.raw
        with contextlib.suppress(OSError):
            if name == "peername":
                return self.raw.getpeername()
            if name == "sockname":
                return self.raw.getsockname()
        return default

    def can_write_eof(self) -> bool:
        """TLS has no half of a connection."""
        return False

    @property
    @abstractmethod
    def read_room(self) -> memoryview:
        """Room of `READ_ROOM_BYTES` to read into what is then sent; the loop's."""

    @abstractmethod
    def send_now(self, buffers: Sequence[Data]) -> int:
        """Send what the socket takes now; what is behind it is the caller's to send again.

        Where that is not all, something waits in the transport, and ``resume_writing`` follows; or
        the transport is closing.

        Parameters
        ----------
        buffers
            None of them empty; they may change after the call.

        Returns
        -------
        int
            Bytes taken, some of which may be kept here: of frames one at most.
        """
