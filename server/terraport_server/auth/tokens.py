"""Access tokens: static ones from a file, and signed ones that expire (JSON Web Tokens).

=========== ================================================================================
scope       allows
=========== ================================================================================
``land``    see the token's scenes: list, files and segments over HTTP, landings
``guide``   move a group (settings page, ``group_guides``), and what ``land`` allows
``teach``   paint strokes that teach a scene names, and what ``land`` allows
``metrics`` read ``/metrics``, and nothing of any scene
=========== ================================================================================

=========== ======== =====================================================================
claim       required meaning
=========== ======== =====================================================================
``sub``     yes      name of the bearer, for the logs
``exp``     yes      end of validity, seconds since 1970
``scenes``  yes      list of ids, or "*" for every scene
``nbf``              start of validity
``aud``              must equal the service's ``token_audience``; absent where that is not set
``jti``              id by which the token can be revoked
``scope``            scopes, separated by spaces; without it ``land``
=========== ======== =====================================================================

The header's ``kid`` names the key, and the key's line in the file decides the algorithm. Times are
compared by the caller and not by PyJWT, because a running session's token is checked again and
again, by the same clock and the same rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

from terraport_server.auth.keys import KeyRing, TokenKey, read_lines
from terraport_server.errors import SettingsError
from terraport_wire import MAX_TOKEN_BYTES

__all__ = [
    "EVERYTHING",
    "LAND",
    "SCOPES",
    "Scope",
    "SignedClaims",
    "StaticToken",
    "check_token",
    "decode_unverified",
    "make_token",
    "read_token",
    "read_tokens",
    "scopes_of",
]

Scope = Literal["land", "guide", "teach", "metrics"]

SCOPES: Final[tuple[Scope, ...]] = get_args(Scope)
LAND: Final[frozenset[Scope]] = frozenset({"land"})
"""Scopes of a token that names none."""
EVERYTHING: Final[frozenset[Scope]] = frozenset(SCOPES)

MIN_TOKEN_CHARACTERS: Final = 16
"""Shorter ones can be guessed; ``python -c "import secrets; print(secrets.token_urlsafe())"``."""

EVERY_SCENE: Final = "*"

_MAX_NAME: Final = 64
_OPTIONS: Final[Any] = {
    "require": ["exp", "sub", "scenes"],
    "verify_signature": True,
    "verify_aud": True,
    "strict_aud": True,
    "verify_exp": False,
    "verify_nbf": False,
    "verify_iat": False,
}


@dataclass(frozen=True, slots=True)
class StaticToken:
    """A token that does not expire: one line of the tokens file."""

    name: str
    token: str = field(repr=False)
    scenes: frozenset[str] | None = None
    """Ids; ``None`` = every scene."""
    scopes: frozenset[Scope] = LAND


@dataclass(frozen=True, slots=True)
class SignedClaims:
    """Claims of a token whose signature is valid; its times are not checked."""

    name: str
    scenes: frozenset[str] | None
    """``None`` = every scene."""
    expires_s: float
    """Seconds since 1970."""
    begins_s: float
    """Seconds since 1970; 0 without ``nbf``."""
    token_id: str | None
    scopes: frozenset[Scope]
    key: TokenKey


def scopes_of(words: Iterable[str]) -> frozenset[Scope]:
    """Return the scopes that words name; other words are ignored.

    Examples
    --------
    >>> sorted(scopes_of(["guide"])), sorted(scopes_of(["metrics", "email"]))
    (['guide', 'land'], ['metrics'])
    """
    named = set(words)
    scopes: frozenset[Scope] = frozenset(scope for scope in SCOPES if scope in named)
    return scopes | LAND if scopes & {"guide", "teach"} else scopes


def read_tokens(path: Path) -> list[StaticToken]:
    """Read a file of static tokens.

    Parameters
    ----------
    path
        UTF-8 text; each line ``NAME TOKEN [+SCOPE ...] [SCENE ...]``, empty lines and those that
        begin with ``#`` skipped. No scope named = ``land``, no scene = every scene.

    Raises
    ------
    SettingsError
        With the line, never with the token.
    """
    tokens: list[StaticToken] = []
    for number, words in read_lines("tokens_file", path):
        where = f"{path} line {number}: "
        if len(words) < 2:
            what = f"{where}got one word, expected NAME TOKEN [SCENE ...]"
            raise SettingsError("tokens_file", what)
        check_token("tokens_file", words[1], where)
        named = {word[1:] for word in words[2:] if word.startswith("+")}
        if not named <= set(SCOPES):
            wrong = ", ".join(sorted(f"+{word[:32]}" for word in named.difference(SCOPES)))
            expected = ", ".join(f"+{scope}" for scope in SCOPES)
            what = f"{where}got {wrong}, expected scopes out of {expected}"
            raise SettingsError("tokens_file", what)
        scenes = frozenset(word for word in words[2:] if not word.startswith("+"))
        scopes = scopes_of(named) if named else LAND
        tokens.append(StaticToken(words[0], words[1], scenes or None, scopes))
    if not tokens:
        raise SettingsError("tokens_file", f"{path} holds no token, expected at least one")
    return tokens


def check_token(setting: str, token: str, where: str = "") -> None:
    """Refuse a static token that is too short to be secret, or too long to be sent.

    Raises
    ------
    SettingsError
        With the token's length, never with the token.
    """
    if not MIN_TOKEN_CHARACTERS <= len(token) <= MAX_TOKEN_BYTES:
        what = f"got a token of {len(token)} characters, expected {MIN_TOKEN_CHARACTERS} to"
        raise SettingsError(setting, f"{where}{what} {MAX_TOKEN_BYTES}")


# PyJWT is imported where it is used: a service without keys starts .05 s sooner.


def make_token(
    key: TokenKey,
    *,
    name: str,
    scenes: frozenset[str] | None,
    expires_s: int,
    begins_s: int | None = None,
    audience: str | None = None,
    token_id: str | None = None,
    scopes: frozenset[Scope] = LAND,
) -> str:
    """Return a signed token.

    Raises
    ------
    SettingsError
        When the key is public.
    """
    import jwt

    claims: dict[str, Any] = {
        "sub": name,
        "exp": expires_s,
        "scenes": EVERY_SCENE if scenes is None else sorted(scenes),
        "nbf": begins_s,
        "aud": audience,
        "jti": token_id,
        "scope": None if scopes == LAND else " ".join(sorted(scopes)),
    }
    claims = {claim: value for claim, value in claims.items() if value is not None}
    return jwt.encode(claims, key.signing(), algorithm=key.jwt_algorithm, headers={"kid": key.id})


def read_token(token: str, ring: KeyRing, *, audience: str | None) -> SignedClaims | None:
    """Return the claims of a signed token; ``None`` where it is not valid, or was revoked.

    Parameters
    ----------
    token
        At most as long as the protocol allows.
    ring
        The accepted keys.
    audience
        Required ``aud``; ``None`` = the token must have no ``aud``.
    """
    if token.count(".") != 2 or not token.isascii():
        return None
    import jwt

    try:
        key_id = jwt.get_unverified_header(token).get("kid")
        key = ring.find(key_id) if isinstance(key_id, str) else None
        if key is None:
            return None
        claims = jwt.decode(
            token,
            key.verifying(),
            algorithms=[key.jwt_algorithm],
            audience=audience,
            options=_OPTIONS,
        )
    # Anybody can have written it. Beside the library's own errors, deep nesting raises
    # RecursionError and huge numbers ValueError.
    except (jwt.PyJWTError, ValueError, RecursionError, OverflowError, TypeError):
        return None
    read = _claims(claims, key)
    return None if read is None or read.token_id in ring.revoked else read


def decode_unverified(token: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Return header and claims without any check, for people to read; ``None`` if undecodable."""
    import jwt

    try:
        read = jwt.decode_complete(token, options={"verify_signature": False})
    except (jwt.PyJWTError, ValueError, RecursionError):
        return None
    return dict(read["header"]), dict(read["payload"])


def _claims(claims: dict[str, Any], key: TokenKey) -> SignedClaims | None:
    """Check the types of the claims; None if one is wrong."""
    name, token_id, scope = claims["sub"], claims.get("jti"), claims.get("scope")
    expires_s, begins_s = _seconds(claims["exp"]), _seconds(claims.get("nbf", 0))
    scenes = claims["scenes"]
    every = scenes == EVERY_SCENE
    if (
        not (isinstance(name, str) and 1 <= len(name) <= _MAX_NAME and name.isprintable())
        or not isinstance(token_id, str | None)
        or not isinstance(scope, str | None)
        or expires_s is None
        or begins_s is None
        or not (every or (isinstance(scenes, list) and all(isinstance(s, str) for s in scenes)))
    ):
        return None
    return SignedClaims(
        name=name,
        scenes=None if every else frozenset(scenes),
        expires_s=expires_s,
        begins_s=begins_s,
        token_id=token_id,
        scopes=LAND if scope is None else scopes_of(scope.split()),
        key=key,
    )


def _seconds(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    seconds = float(value)
    return seconds if math.isfinite(seconds) else None
