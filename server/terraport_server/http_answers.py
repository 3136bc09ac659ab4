"""What endpoints share: the service behind a request, and what an answer says of its keeping."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Depends, Request

from terraport_server.service import Service

__all__ = ["CHECK", "FOREVER", "PRIVATE_FOREVER", "ServiceOfRequest", "is_unchanged"]

FOREVER: Final = "public, max-age=31536000, immutable"
PRIVATE_FOREVER: Final = "private, max-age=31536000, immutable"
CHECK: Final = "no-cache"
"""Keep it, and ask each time whether it is still the same."""


def _service(request: Request) -> Service:
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


ServiceOfRequest = Annotated[Service, Depends(_service)]
"""Type of a parameter that is given the service."""


def is_unchanged(request: Request, etag: str) -> bool:
    """Whether the client has what `etag` (quotes included) names (RFC 9110, 13.1.2)."""
    asked = request.headers.get("if-none-match", "")
    return asked.strip() == "*" or etag in {
        entry.strip().removeprefix("W/") for entry in asked.split(",")
    }
