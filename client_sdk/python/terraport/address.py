"""Scene URLs, in every form that a user may paste, and access tokens.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import quote, unquote, urlsplit

from terraport.errors import UsageError

__all__ = ["Access", "SceneUrl", "Token"]

Token = str | Callable[[], str] | None
"""A bearer token, or what gives the present one; it is called on the event loop and must not
wait."""


class Access:
    """Gives the token of each connection, and knows when another attempt is worth while.

    Parameters
    ----------
    token : str or callable or None
        With a callable, a token that expires is replaced without the session's end.
    """

    def __init__(self, token: Token) -> None:
        self._token = token
        self._shown: str | None = None

    def headers(self) -> dict[str, str]:
        """Return the headers that show the present token."""
        self._shown = self._token() if callable(self._token) else self._token
        return {} if self._shown is None else {"Authorization": f"Bearer {self._shown}"}

    def has_newer(self) -> bool:
        """Whether there is another token than the one shown last, which was refused."""
        return callable(self._token) and self._token() != self._shown

    def __repr__(self) -> str:
        return "<Access>"


_HOST_FIRST = re.compile(r"[\w.-]+(:\d+)?(/[^@?#]*)?\Z")
"""What people copy without its beginning: ``localhost:8080/scenes/pit``."""

_HTTP_OF = {"http": "http", "https": "https", "ws": "http", "wss": "https"}


@dataclass(frozen=True, slots=True)
class SceneUrl:
    """Where a server, and perhaps one scene of it, is.

    Examples
    --------
    >>> url = SceneUrl.parse("https://mine.example:8443/tp/scenes/north%20pit")
    >>> url.scene, url.stream
    ('north pit', 'wss://mine.example:8443/tp/scenes/north%20pit/stream')
    >>> SceneUrl.parse("ws://localhost:8080").scene is None
    True
    """

    server: str
    """``http(s)://host[:port][/prefix]`` without a slash at the end."""
    scene: str | None
    """Scene id; None for a server URL, whose only scene is meant."""

    @classmethod
    def parse(cls, url: str) -> SceneUrl:
        """Read a scene URL or a server URL (``spec/protocol.md``, section 2).

        Raises
        ------
        UsageError
            Not such a URL, or one with credentials, query or fragment in it.
        """
        try:
            address = urlsplit(url)
            port = address.port
        except ValueError as error:
            raise UsageError(f"URL {url!r}: {error}") from None
        scheme = _HTTP_OF.get(address.scheme)
        if scheme is None or not address.hostname:
            perhaps = f"; perhaps http://{url}" if _HOST_FIRST.match(url) else ""
            # Before an @ or behind a ? there may be a secret.
            got = "URL" if "@" in url or "?" in url else f"URL {url!r}"
            raise UsageError(
                f"{got}, expected http(s)://host[:port][/prefix]/scenes/ID (or ws, wss){perhaps}"
            )
        if address.username is not None or address.query or address.fragment:
            raise UsageError(
                f"URL of {address.hostname} has credentials, a query or a fragment, "
                "expected none: give the token as token="
            )
        host = f"[{address.hostname}]" if ":" in address.hostname else address.hostname
        origin = f"{scheme}://{host}" + (f":{port}" if port is not None else "")
        prefix, marker, rest = address.path.partition("/scenes")
        scene = rest.strip("/").removesuffix("/stream")
        if not marker or not scene:
            return cls(origin + prefix.rstrip("/"), None)
        if "/" in scene or not rest.startswith("/"):
            raise UsageError(f"URL path {address.path!r}, expected [/prefix]/scenes/ID")
        return cls(origin + prefix, unquote(scene))

    def with_scene(self, scene: str) -> SceneUrl:
        """Return the URL of one scene of the same server."""
        return SceneUrl(self.server, scene)

    @property
    def scenes(self) -> str:
        """Address of the list of scenes."""
        return f"{self.server}/scenes"

    @property
    def http(self) -> str:
        """Address of the scene over HTTP."""
        if self.scene is None:
            raise UsageError(f"{self.server} names no scene, expected .../scenes/ID")
        return f"{self.scenes}/{quote(self.scene, safe='')}"

    @property
    def stream(self) -> str:
        """Address of the scene's WebSocket."""
        return "ws" + self.http.removeprefix("http") + "/stream"

    @property
    def key(self) -> str:
        """16 hexadecimal digits that stand for the scene in a cache directory."""
        return hashlib.sha256(self.http.encode()).hexdigest()[:16]
