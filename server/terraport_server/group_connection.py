"""HTTP connections of a worker that pass a group's stream on to the worker where the group lives.

``?group=NAME`` in the URL says so before anything else is known; see ``limits.groups`` in the
protocol (16.6). The connection's own socket goes, with the request that was read of it: nothing
stands between the client and its group's worker afterwards. Connections that name no group never
leave the worker that accepted them.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from http import HTTPStatus
from typing import Final

from starlette.datastructures import QueryParams

from terraport_server.http_connection import HttpConnection
from terraport_server.mailbox import Parcel

__all__ = ["GroupConnection", "PassOn", "group_named_by", "passing_class"]

_NAME: Final = re.compile(r"[A-Za-z0-9_.~-]{1,64}")
"""As the protocol has it (16.1)."""

PassOn = Callable[[str, bytes, int], bool]
"""Takes group, head and descriptor; False where it could not go."""


class GroupConnection(HttpConnection):
    """One connection, accepted here or passed on to here."""

    pass_on: PassOn | None = None
    """None: this process has all groups."""

    parcel: Parcel | None = None
    """What it came with from another process; its group lives here."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Read again what another process had read."""
        super().connection_made(transport)
        if self.parcel is not None and not transport.is_closing():
            self.data_received(self.parcel.head)

    def handle_websocket_upgrade(self) -> None:
        """Pass the connection on where its URL names a group, else go on here."""
        group = None
        if self.pass_on is not None and self.parcel is None and not self._over:
            group = group_named_by(self.url)
        if group is None:
            super().handle_websocket_upgrade()
            return
        assert self.pass_on is not None
        self._header_deadline.stop()
        head = [self.scope["method"].encode(), b" ", self.url, b" HTTP/1.1\r\n"]
        for name, value in self.headers:
            head += [name, b": ", value, b"\r\n"]
        head.append(b"\r\n")
        raw = self.transport.get_extra_info("socket")
        if self.pass_on(group, b"".join(head), raw.fileno()):
            # Closes this process's descriptor alone: the connection goes on in the other one's.
            self._over = True
            self.transport.abort()
        else:
            text = "could not reach the worker of this group, expected to; connect again"
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "connections", text)


def group_named_by(url: bytes) -> str | None:
    """Return the group that a request's target names.

    Examples
    --------
    >>> group_named_by(b"/scenes/pit/stream?group=tour-1"), group_named_by(b"/scenes/pit/stream")
    ('tour-1', None)
    """
    _, _, query = url.partition(b"?")
    if not query:
        return None
    # Read as the session will read it, or the two could differ about who belongs together.
    group = QueryParams(query.decode("latin-1")).get("group", "")
    return group if _NAME.fullmatch(group) else None


def passing_class(base: type[HttpConnection]) -> type[GroupConnection]:
    """Return a class for uvicorn's ``http`` option, on top of one with its bounds set."""
    return type("GroupConnection", (GroupConnection, base), {})
