"""Who may see what: bearer tokens, and the origins of web pages."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from terraport_server.errors import SettingsError
from terraport_server.settings import Settings
from terraport_wire import MAX_TOKEN_BYTES, ErrorCode

__all__ = ["Gate", "Grant", "bearer_token", "origin_is_allowed", "read_tokens"]

MIN_TOKEN_CHARACTERS = 16
"""Shorter ones can be guessed; ``python -c "import secrets; print(secrets.token_urlsafe())"``."""

_MAX_TOKENS_FILE_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Grant:
    """What one token opens."""

    name: str
    """For logs; never the token."""
    digest: bytes
    """SHA-256 over this process's salt and the token."""
    scenes: frozenset[str] | None
    """Ids; ``None`` = every scene."""


class Gate:
    """Checks tokens.

    Every check takes the same time whatever the token: all grants are compared, as digests of one
    length, by a comparison that does not stop early.

    Parameters
    ----------
    tokens
        (name, token, scenes) each; ``None`` = no token is asked for.
    """

    def __init__(self, tokens: list[tuple[str, str, frozenset[str] | None]] | None) -> None:
        self._salt = secrets.token_bytes(32)
        self._grants: tuple[Grant, ...] | None = None
        if tokens is not None:
            self._grants = tuple(
                Grant(name, self._digest(token), scenes) for name, token, scenes in tokens
            )

    @classmethod
    def from_settings(cls, settings: Settings) -> Gate:
        """Make the gate that settings ask for.

        Raises
        ------
        SettingsError
            When the tokens file cannot be read, holds something else, or a token is too short.
        """
        if settings.is_open:
            return cls(None)
        tokens: list[tuple[str, str, frozenset[str] | None]] = []
        if settings.token is not None:
            token = settings.token.get_secret_value()
            _check_token("token", token)
            tokens.append(("token", token, None))
        if settings.tokens_file is not None:
            tokens.extend(read_tokens(settings.tokens_file))
        return cls(tokens)

    @property
    def is_open(self) -> bool:
        """Whether no token is asked for."""
        return self._grants is None

    def check(self, token: str | None, scene_id: str) -> ErrorCode | None:
        """Return ``None`` if the token opens the scene, else why not."""
        grant = self._find(token)
        if self._grants is None:
            return None
        if grant is None:
            return ErrorCode.UNAUTHORISED
        if grant.scenes is not None and scene_id not in grant.scenes:
            return ErrorCode.FORBIDDEN
        return None

    def is_known(self, token: str | None) -> bool:
        """Whether the token opens anything at all."""
        return self._grants is None or self._find(token) is not None

    def opens(self, token: str | None, scene_id: str) -> bool:
        """Whether the token opens the scene."""
        return self.check(token, scene_id) is None

    def _find(self, token: str | None) -> Grant | None:
        if self._grants is None or token is None:
            return None
        digest = self._digest(token[: MAX_TOKEN_BYTES + 1])
        found = None
        for grant in self._grants:
            if hmac.compare_digest(grant.digest, digest):
                found = grant
        return found

    def _digest(self, token: str) -> bytes:
        return hashlib.sha256(self._salt + token.encode("utf-8", "surrogatepass")).digest()


def read_tokens(path: Path) -> list[tuple[str, str, frozenset[str] | None]]:
    """Read a tokens file.

    Parameters
    ----------
    path
        UTF-8 text; each line ``NAME TOKEN [SCENE ...]``, empty lines and those that begin with
        ``#`` skipped. No scene named = every scene.

    Returns
    -------
    list
        (name, token, scenes) each.

    Raises
    ------
    SettingsError
        With the line, never with the token.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_TOKENS_FILE_BYTES + 1)
    except OSError as error:
        raise SettingsError("tokens_file", f"{path}: {error.strerror}, expected a file") from None
    if len(data) > _MAX_TOKENS_FILE_BYTES:
        raise SettingsError("tokens_file", f"{path} is larger than {_MAX_TOKENS_FILE_BYTES} bytes")
    try:
        lines = data.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise SettingsError("tokens_file", f"{path} is no UTF-8 text") from None
    tokens = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 2:
            what = f"{path} line {number}: got one word, expected NAME TOKEN [SCENE ...]"
            raise SettingsError("tokens_file", what)
        _check_token(f"tokens_file: {path} line {number}", words[1])
        scenes = frozenset(words[2:]) if words[2:] else None
        tokens.append((words[0], words[1], scenes))
    if not tokens:
        raise SettingsError("tokens_file", f"{path} holds no token, expected at least one")
    return tokens


def bearer_token(authorization: str | None) -> str | None:
    """Return the token of an ``Authorization`` header; ``""`` where it is of another kind.

    A header that is there decides, right or wrong, so another kind must not read as absent.
    """
    if authorization is None:
        return None
    scheme, _, token = authorization.partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def origin_is_allowed(origin: str | None, host: str | None, allowed: tuple[str, ...]) -> bool:
    """Whether a web page of that origin may connect.

    Programs send no origin and pass: the check protects people whose browser shows a foreign page
    beside an open service, not the service from programs.

    Parameters
    ----------
    origin
        ``Origin`` header, ``scheme://host[:port]``.
    host
        ``Host`` header.
    allowed
        Origins beside the service's own; "*" = all.
    """
    if origin is None or "*" in allowed or origin in allowed:
        return True
    return host is not None and urlsplit(origin).netloc.lower() == host.lower()


def _check_token(setting: str, token: str) -> None:
    if not MIN_TOKEN_CHARACTERS <= len(token) <= MAX_TOKEN_BYTES:
        what = (
            f"got a token of {len(token)} characters, expected {MIN_TOKEN_CHARACTERS} to "
            f"{MAX_TOKEN_BYTES}"
        )
        raise SettingsError(setting, what)
