"""Tokens of a session that may outlive them.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Access", "Token"]

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
