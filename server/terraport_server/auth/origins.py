"""Checks of the ``Origin`` and ``Host`` headers of browsers' requests. PURE: no I/O, no clock."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit

__all__ = ["host_is_ours", "origin_is_allowed"]


def host_is_ours(host: str | None, allowed: tuple[str, ...]) -> bool:
    """Return whether a ``Host`` header names a service of this machine.

    A web page can point a name of its own at 127.0.0.1 and then reads an open service as its own
    origin (DNS rebinding); it cannot make the browser call it by an address or ``localhost``.
    """
    if host is None:
        return True  # HTTP/1.0, or a program: browsers always send one
    name = host.strip().lower()
    if name.startswith("["):
        name = name[1:].partition("]")[0]
    elif name.count(":") <= 1:
        name = name.partition(":")[0]
    if name == "localhost" or name.endswith(".localhost") or name in allowed or host in allowed:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def origin_is_allowed(origin: str | None, host: str | None, allowed: tuple[str, ...]) -> bool:
    """Return whether a web page of that origin may connect.

    Programs send no origin and pass: the check protects people whose browser shows a page of
    another origin, not the service from programs.

    Parameters
    ----------
    origin
        ``Origin`` header, ``scheme://host[:port]``.
    host
        ``Host`` header.
    allowed
        Origins in addition to the service's own; "*" = all.
    """
    if origin is None or "*" in allowed or origin in allowed:
        return True
    try:
        netloc = urlsplit(origin).netloc
    except ValueError:
        return False
    return host is not None and netloc.lower() == host.lower()
