"""What holds for every HTTP request, whatever it asks for.

An ASGI middleware: it refuses a Host that is not this service's, adds the
headers that keep browsers from guessing, and counts the answers.
"""

from __future__ import annotations

import json
from typing import Final, NamedTuple

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from terraport_server.auth.origins import host_is_ours
from terraport_server.http_connection import ANSWERED
from terraport_server.service import Service

__all__ = ["AppGuard"]

_NO_FRAMES: Final = (b"x-frame-options", b"DENY")
_EVERYWHERE: Final = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    _NO_FRAMES,
)
"""Headers of every answer of the application."""

# Pages without a policy of their own carry their pictures and styles with them, and have no
# scripts: the list of scenes, a build's report.
_PAGE_POLICY: Final = (
    b"default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'; "
    b"base-uri 'none'; form-action 'none'"
)

_DOCS: Final = "/docs"
"""FastAPI's page loads its script from elsewhere."""


class Refusal(NamedTuple):
    """Why a request is not answered."""

    reason: str
    """For metric and log."""
    status: int
    code: str
    text: str


class AppGuard:
    """Middleware that refuses requests before the application sees them, and counts answers.

    Parameters
    ----------
    app
        What answers.
    service
        For settings and metrics.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app = app
        self._service = service
        self._good_host = b"localhost"
        """Last accepted host: the next request mostly has the same one."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; WebSockets pass, their endpoint checks for itself."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._service.metrics.answered(message["status"])
                answered = scope.get("extensions", {}).get(ANSWERED)
                if answered is not None:
                    answered(message["status"])
                message["headers"] = [*message.get("headers", ()), *_added(scope, message)]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, counted)
        else:
            await _answer(counted, refusal)

    def _refusal(self, scope: Scope) -> Refusal | None:
        settings = self._service.settings
        if not settings.checks_host:
            return None
        hosts = [value for name, value in scope["headers"] if name == b"host"]
        host = b", ".join(hosts)  # two of them are never this service's
        if not hosts or host == self._good_host:
            return None
        if host_is_ours(host.decode("latin-1"), settings.allowed_hosts):
            self._good_host = host
            return None
        text = (
            "got a Host that is not this service's, expected an address, localhost, or one "
            "of allowed_hosts"
        )
        self._service.note_refusal("host", text, _client(scope))
        return Refusal("host", 421, "forbidden", text)


def _added(scope: Scope, message: Message) -> list[tuple[bytes, bytes]]:
    added = list(_EVERYWHERE)
    headers = dict(message.get("headers", ()))
    is_page = headers.get(b"content-type", b"").startswith(b"text/html")
    policy = headers.get(b"content-security-policy", b"")
    if b"frame-ancestors" in policy and b"frame-ancestors 'none'" not in policy:
        added.remove(_NO_FRAMES)  # the policy says who may; the older header knows no list
    if is_page and b"content-security-policy" not in headers and scope["path"] != _DOCS:
        added.append((b"content-security-policy", _PAGE_POLICY))
    return added


async def _answer(send: Send, refusal: Refusal) -> None:
    body = json.dumps({"error": {"code": refusal.code, "message": refusal.text}}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body))]
    await send({"type": "http.response.start", "status": refusal.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _client(scope: Scope) -> str:
    client = scope.get("client")
    return "unknown" if client is None else str(client[0])
