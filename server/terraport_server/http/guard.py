"""ASGI middleware of all HTTP requests: Host check, security headers, response counts."""

from __future__ import annotations

import json
from typing import Final, NamedTuple

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from terraport_server.auth.origins import host_is_ours
from terraport_server.descriptors import NO_DESCRIPTOR, has_free_descriptors
from terraport_server.service import Service

__all__ = ["AppGuard"]

_NO_FRAMES: Final = (b"x-frame-options", b"DENY")
_EVERYWHERE: Final = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    _NO_FRAMES,
)
"""Headers of every response."""

# Of pages without a policy of their own, a build's report: its pictures and styles are inline, and
# it has no scripts.
_PAGE_POLICY: Final = (
    b"default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'; "
    b"base-uri 'none'; form-action 'none'"
)

_DOCS: Final = "/docs"
"""FastAPI's page, which loads its script from another origin."""


class Refusal(NamedTuple):
    """Reason for refusing a request."""

    reason: str
    """Label of metric and log."""
    status: int
    code: str
    text: str


class AppGuard:
    """The middleware.

    Parameters
    ----------
    app
    service
        Its settings and metrics.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app = app
        self._service = service
        self._good_host = b"localhost"
        """Last accepted host: the next request mostly has the same one."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request; WebSockets pass, since their endpoint has its own checks."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._service.metrics.answered(message["status"])
                message["headers"] = [*message.get("headers", ()), *_added(scope, message)]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, counted)
        else:
            await _answer(counted, refusal)

    def _refusal(self, scope: Scope) -> Refusal | None:
        if not has_free_descriptors():
            self._service.note_refusal("connections", NO_DESCRIPTOR, _client(scope))
            return Refusal("connections", 503, "connections", NO_DESCRIPTOR)
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
        added.remove(_NO_FRAMES)  # the policy lists them; the older header cannot
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
