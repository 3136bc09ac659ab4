"""Access control by bearer tokens."""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from terraport_server.auth.keys import KeyRing, read_keys
from terraport_server.auth.tokens import (
    EVERYTHING,
    LAND,
    Scope,
    SignedClaims,
    StaticToken,
    check_token,
    read_token,
    read_tokens,
)
from terraport_server.settings import Settings
from terraport_wire import MAX_TOKEN_BYTES, ErrorCode

__all__ = ["Gate", "TokenPass", "Withdrawal", "bearer_token", "static_tokens"]

Withdrawal = Literal["expired", "revoked"]
"""Why a token no longer opens a scene."""


@dataclass(frozen=True, slots=True)
class TokenPass:
    """The rights of one token, without the token itself."""

    name: str
    """For logs; never the token."""
    scenes: frozenset[str] | None
    """Ids; ``None`` = every scene."""
    scopes: frozenset[Scope] = LAND
    digest: bytes = b""
    """SHA-256 over this process's salt and a static token; empty for a signed one."""
    signed: SignedClaims | None = None

    def opens(self, scene_id: str) -> bool:
        """Return whether the token opens the scene; its expiry is not checked."""
        return "land" in self.scopes and (self.scenes is None or scene_id in self.scenes)

    @property
    def guide(self) -> bool:
        """Whether the token allows guiding a group."""
        return "guide" in self.scopes


_OPEN_PASS = TokenPass("open", None, EVERYTHING)
"""Rights of every client where no token is required."""


class Gate:
    """Checks tokens, static and signed.

    A static token is looked up by its salted digest: the time reveals nothing about the tokens
    and does not grow with their number. PyJWT compares signatures in constant time.

    Parameters
    ----------
    tokens
        Static ones; ``None`` and no keys = no token is required.
    keys
        Accepted keys of signed tokens.
    audience
        Required ``aud`` of a signed token; ``None`` = it must have none.
    leeway_s
        Allowed difference between this clock and that of the token's maker.
    clock
        Seconds since 1970.
    """

    def __init__(
        self,
        tokens: Sequence[StaticToken] | None,
        keys: KeyRing | None = None,
        *,
        audience: str | None = None,
        leeway_s: float = 0.0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.is_open = tokens is None and keys is None
        """Whether no token is required."""
        self._salt = secrets.token_bytes(32)
        self._audience = audience
        self._leeway_s = leeway_s
        self._clock = clock
        self._keys = keys
        self._static: dict[bytes, TokenPass] = {}
        """By digest."""
        self.use_tokens(tokens or ())

    @classmethod
    def from_settings(cls, settings: Settings, leeway_s: float = 0.0) -> Gate:
        """Make the gate that the settings describe.

        Raises
        ------
        SettingsError
            When a file cannot be read or is not valid, or a token is too short.
        """
        if settings.metrics_token is not None:
            check_token("metrics_token", settings.metrics_token.get_secret_value())
        if settings.is_open:
            return cls(None)
        keys = None if settings.token_keys_file is None else read_keys(settings.token_keys_file)
        return cls(
            static_tokens(settings),
            keys,
            audience=settings.token_audience,
            leeway_s=leeway_s,
        )

    def use_tokens(self, tokens: Sequence[StaticToken]) -> None:
        """Replace the static tokens."""
        digests = [self._digest(one.token) for one in tokens]
        self._static = {
            digest: TokenPass(one.name, one.scenes, one.scopes, digest)
            for digest, one in zip(digests, tokens, strict=True)
        }

    def use_keys(self, keys: KeyRing) -> None:
        """Replace the accepted keys."""
        self._keys = keys

    def find(self, token: str | None) -> TokenPass | None:
        """Return the rights of a token; ``None`` if it is not valid now."""
        if self.is_open:
            return _OPEN_PASS
        if token is None:
            return None
        static_pass = self._static.get(self._digest(token[: MAX_TOKEN_BYTES + 1]))
        if static_pass is None and self._keys is not None and len(token) <= MAX_TOKEN_BYTES:
            claims = read_token(token, self._keys, audience=self._audience)
            if claims is not None and self._is_in_time(claims):
                return TokenPass(claims.name, claims.scenes, claims.scopes, signed=claims)
        return static_pass

    def admit(self, token: str | None, scene_id: str) -> TokenPass | ErrorCode:
        """Return the rights of a token that opens the scene, or the error code."""
        token_pass = self.find(token)
        if token_pass is None:
            return ErrorCode.UNAUTHORISED
        return token_pass if token_pass.opens(scene_id) else ErrorCode.FORBIDDEN

    def check(self, token: str | None, scene_id: str) -> ErrorCode | None:
        """Return ``None`` if the token opens the scene, else the error code."""
        admission = self.admit(token, scene_id)
        return None if isinstance(admission, TokenPass) else admission

    def withdrawal(self, token_pass: TokenPass, scene_id: str) -> Withdrawal | None:
        """Return why rights to a scene have ended; ``None`` while they last."""
        if self.is_open:
            return None
        if token_pass.signed is not None:
            return self._signed_withdrawal(token_pass.signed)
        still = self._static.get(token_pass.digest)
        return None if still is not None and still.opens(scene_id) else "revoked"

    def _signed_withdrawal(self, claims: SignedClaims) -> Withdrawal | None:
        key = None if self._keys is None else self._keys.find(claims.key.id)
        if self._keys is None or key != claims.key:
            return "revoked"
        if claims.token_id in self._keys.revoked:
            return "revoked"
        # nbf is not checked again: a clock that is set back ends no session.
        return "expired" if self._clock() >= claims.expires_s + self._leeway_s else None

    def _is_in_time(self, claims: SignedClaims) -> bool:
        now_s = self._clock()
        return claims.begins_s - self._leeway_s <= now_s < claims.expires_s + self._leeway_s

    def _digest(self, token: str) -> bytes:
        return hashlib.sha256(self._salt + token.encode("utf-8", "surrogatepass")).digest()


def static_tokens(settings: Settings) -> list[StaticToken]:
    """Return the tokens of ``token`` and ``tokens_file``.

    Raises
    ------
    SettingsError
        When the file cannot be read or holds something else, or a token is too short.
    """
    tokens: list[StaticToken] = []
    if settings.token is not None:
        token = settings.token.get_secret_value()
        check_token("token", token)
        tokens.append(StaticToken("token", token, scopes=LAND | {"guide"}))
    if settings.tokens_file is not None:
        tokens.extend(read_tokens(settings.tokens_file))
    return tokens


def bearer_token(authorization: str | None) -> str | None:
    """Return the token of an ``Authorization`` header; ``""`` where it has another scheme.

    ``None`` is an absent header: then another way of showing a token may count.
    """
    if authorization is None:
        return None
    scheme, _, token = authorization.partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""
