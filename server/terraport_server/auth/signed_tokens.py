"""Signed tokens that expire: JSON Web Tokens, made and checked by PyJWT.

=========== ======== =====================================================================
claim       needed   meaning
=========== ======== =====================================================================
``sub``     yes      who it was made for; stands in the logs
``exp``     yes      from when it opens nothing, seconds since 1970
``scenes``  yes      list of ids, or "*" for every scene
``nbf``               from when it opens something
``aud``              must be the service's ``token_audience``, where that is set; must not
                     be there where it is not
``jti``              id by which it can be revoked
``scope``             words out of "land guide teach metrics", see :mod:`token_scopes
                     <terraport_server.auth.scopes>`; without it "land"
=========== ======== =====================================================================

The header's ``kid`` names the key, and the key's line in the file says by which algorithm: what the
token says of its algorithm must be the same. Times are compared here and not by PyJWT, because a
running session's token is judged again and again, by the same clock and the same rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import jwt

from terraport_server.auth.keys import KeyRing, TokenKey
from terraport_server.auth.scopes import LAND, Scope, scopes_of

__all__ = ["SignedClaims", "look_into", "make_token", "read_token"]

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
class SignedClaims:
    """What a token says whose signature is right. Whether its time is right is not looked at."""

    name: str
    scenes: frozenset[str] | None
    """``None`` = every scene."""
    expires_s: float
    """Seconds since 1970."""
    begins_s: float
    """Seconds since 1970; minus infinity without ``nbf``."""
    token_id: str | None
    scopes: frozenset[Scope]
    key: TokenKey


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
    claims: dict[str, Any] = {
        "sub": name,
        "exp": expires_s,
        "scenes": EVERY_SCENE if scenes is None else sorted(scenes),
    }
    if begins_s is not None:
        claims["nbf"] = begins_s
    if audience is not None:
        claims["aud"] = audience
    if token_id is not None:
        claims["jti"] = token_id
    if scopes != LAND:
        claims["scope"] = " ".join(sorted(scopes))
    return jwt.encode(claims, key.signing(), algorithm=key.jwt_algorithm, headers={"kid": key.id})


def read_token(token: str, ring: KeyRing, *, audience: str | None) -> SignedClaims | None:
    """Return what a token says; ``None`` where it is not of ours, or was revoked.

    Parameters
    ----------
    token
        At most as long as the protocol allows.
    ring
        The keys that are accepted.
    audience
        What ``aud`` must be; ``None`` = there must be no ``aud``.
    """
    if token.count(".") != 2 or not token.isascii():
        return None
    try:
        key = _key_of(token, ring)
        if key is None:
            return None
        claims = jwt.decode(
            token,
            key.verifying(),
            algorithms=[key.jwt_algorithm],
            audience=audience,
            options=_OPTIONS,
        )
    # A stranger wrote it: whatever the library makes of it, it is no token of ours. Beside its own
    # errors, deep nesting raises RecursionError and huge numbers ValueError.
    except (jwt.PyJWTError, ValueError, RecursionError, OverflowError, TypeError):
        return None
    read = _claims(claims, key)
    return None if read is None or read.token_id in ring.revoked else read


def look_into(token: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Return header and claims as they stand there, nothing checked; ``None`` where there are none.

    For people; nothing may be decided by it.
    """
    try:
        read = jwt.decode_complete(token, options={"verify_signature": False})
    except (jwt.PyJWTError, ValueError, RecursionError):
        return None
    return dict(read["header"]), dict(read["payload"])


def _key_of(token: str, ring: KeyRing) -> TokenKey | None:
    header = jwt.get_unverified_header(token)
    key_id = header.get("kid")
    return ring.find(key_id) if isinstance(key_id, str) else None


def _claims(claims: dict[str, Any], key: TokenKey) -> SignedClaims | None:
    """Check what is in a token by type; who holds a key can still make a mistake."""
    name, token_id = claims["sub"], claims.get("jti")
    expires_s, begins_s = _seconds(claims["exp"]), _seconds(claims.get("nbf", 0))
    scenes, scope = claims["scenes"], claims.get("scope")
    if scope is not None and not isinstance(scope, str):
        return None
    if not isinstance(name, str) or not 1 <= len(name) <= _MAX_NAME or not name.isprintable():
        return None
    if token_id is not None and not isinstance(token_id, str):
        return None
    if expires_s is None or begins_s is None:
        return None
    every = scenes == EVERY_SCENE
    if not every and not (isinstance(scenes, list) and all(isinstance(one, str) for one in scenes)):
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
