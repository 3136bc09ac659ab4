"""Signing keys of expiring tokens, and the key file.

One key a line: ``ID ALGORITHM KEY``, the key as base64url. Tokens are signed by the first key and
accepted from every one. To replace a key, put the new one on top, and remove the old one when its
last token has expired. A line ``revoke TOKEN_ID`` revokes one token.

=================== ================================================ ==========================
algorithm           key                                              holder
=================== ================================================ ==========================
``HS256``           secret of 32 bytes or more                       the issuer of tokens, and
                                                                     the service
``EdDSA``           public Ed25519 key, 32 bytes                     the service: it can check
                                                                     tokens, not make any
``EdDSA-private``   private Ed25519 key, 32 bytes                    the issuer of tokens
=================== ================================================ ==========================
"""

from __future__ import annotations

import base64
import binascii
import os
import re
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from terraport_server.errors import SettingsError

__all__ = ["ALGORITHMS", "KeyRing", "TokenKey", "new_key", "read_keys", "read_lines", "write_keys"]

ALGORITHMS: Final = ("HS256", "EdDSA", "EdDSA-private")
"""Algorithms of the file. Those of a token are decided by its key's line alone."""

MAX_KEYS: Final = 16

_KEY_BYTES: Final = 32
"""SHA-256's own width: a shorter HMAC secret is weaker than its hash (RFC 7518, section 3.2)."""
_MAX_KEY_BYTES: Final = 1024
_REVOKE: Final = "revoke"
_MAX_FILE_BYTES: Final = 1 << 20
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass(frozen=True, slots=True)
class TokenKey:
    """A key that signs or checks tokens: one line of the key file."""

    id: str
    algorithm: str
    secret: bytes
    """Not part of :func:`repr`."""

    def __repr__(self) -> str:
        return f"TokenKey({self.id!r}, {self.algorithm!r})"

    @property
    def jwt_algorithm(self) -> str:
        """Name in a token's header."""
        return self.algorithm.removesuffix("-private")

    def verifying(self) -> Any:
        """Return the key object that PyJWT verifies with."""
        if self.algorithm == "HS256":
            return self.secret
        if self.algorithm == "EdDSA":
            return _ed25519().Ed25519PublicKey.from_public_bytes(self.secret)
        return self.signing().public_key()

    def signing(self) -> Any:
        """Return the key object that PyJWT signs with.

        Raises
        ------
        SettingsError
            When it is a public key.
        """
        if self.algorithm == "HS256":
            return self.secret
        if self.algorithm == "EdDSA-private":
            return _ed25519().Ed25519PrivateKey.from_private_bytes(self.secret)
        what = f"key {self.id} is public, expected HS256 or EdDSA-private to make tokens with"
        raise SettingsError("token_keys_file", what)

    def public(self) -> TokenKey:
        """Return the public key of an EdDSA key."""
        raw = self.signing().public_key().public_bytes_raw()
        return TokenKey(self.id, "EdDSA", raw)

    def line(self) -> str:
        """Return the key's line of the key file."""
        text = base64.urlsafe_b64encode(self.secret).rstrip(b"=").decode()
        return f"{self.id} {self.algorithm} {text}"


@dataclass(frozen=True, slots=True)
class KeyRing:
    """Contents of a key file."""

    keys: tuple[TokenKey, ...]
    """The first one signs."""
    revoked: frozenset[str]
    """Ids of revoked tokens."""

    def find(self, key_id: str) -> TokenKey | None:
        """Return the key with an id; None if there is none."""
        return next((key for key in self.keys if key.id == key_id), None)


def new_key(key_id: str, algorithm: str) -> TokenKey:
    """Make a key from the system's random source.

    Parameters
    ----------
    key_id
        1 to 64 letters, digits, ``.``, ``_``, ``-``.
    algorithm
        "HS256" or "EdDSA"; the latter gives the private key.

    Raises
    ------
    SettingsError
        When the id or the algorithm is not valid.
    """
    _check_id("key", key_id)
    if algorithm == "HS256":
        return TokenKey(key_id, algorithm, secrets.token_bytes(_KEY_BYTES))
    if algorithm == "EdDSA":
        raw = _ed25519().Ed25519PrivateKey.generate().private_bytes_raw()
        return TokenKey(key_id, "EdDSA-private", raw)
    raise SettingsError("algorithm", f"got {algorithm!r}, expected HS256 or EdDSA")


def read_keys(path: Path) -> KeyRing:
    """Read a key file.

    Raises
    ------
    SettingsError
        With the line, never with a key.
    """
    keys: list[TokenKey] = []
    revoked: set[str] = set()
    for number, words in read_lines("token_keys_file", path):
        where = f"{path} line {number}"
        if words[0] == _REVOKE:
            if len(words) != 2:
                raise SettingsError("token_keys_file", f"{where}: expected revoke TOKEN_ID")
            revoked.add(words[1])
            continue
        if len(words) != 3:
            what = f"{where}: got {len(words)} words, expected ID ALGORITHM KEY"
            raise SettingsError("token_keys_file", what)
        keys.append(_read_key(where, *words))
    if not keys:
        raise SettingsError("token_keys_file", f"{path} holds no key, expected at least one")
    if len(keys) > MAX_KEYS:
        what = f"{path} holds {len(keys)} keys, expected at most {MAX_KEYS}"
        raise SettingsError("token_keys_file", what)
    if len({key.id for key in keys}) < len(keys):
        raise SettingsError("token_keys_file", f"{path} has two keys of one id, expected one each")
    return KeyRing(tuple(keys), frozenset(revoked))


def read_lines(setting: str, path: Path) -> list[tuple[int, list[str]]]:
    """Return the number and the words of every line that is neither empty nor a comment.

    Raises
    ------
    SettingsError
        When the file cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_FILE_BYTES + 1)
    except OSError as error:
        raise SettingsError(setting, f"{path}: {error.strerror}, expected a file") from None
    if len(data) > _MAX_FILE_BYTES:
        raise SettingsError(setting, f"{path} is larger than {_MAX_FILE_BYTES} bytes")
    try:
        lines = data.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise SettingsError(setting, f"{path} is not UTF-8 text") from None
    words = ((number, line.split()) for number, line in enumerate(lines, start=1))
    return [(number, line) for number, line in words if line and not line[0].startswith("#")]


def write_keys(path: Path, lines: list[str]) -> None:
    """Write a key file atomically, readable by its owner only.

    Raises
    ------
    OSError
        When it cannot be written; the old file is unchanged.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    # Created with its final mode, so that others can never open it.
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write("".join(f"{line}\n" for line in lines))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _read_key(where: str, key_id: str, algorithm: str, text: str) -> TokenKey:
    _check_id(where, key_id)
    if algorithm not in ALGORITHMS:
        expected = ", ".join(ALGORITHMS)
        what = f"{where}: got algorithm {algorithm[:32]!r}, expected one of: {expected}"
        raise SettingsError("token_keys_file", what)
    try:
        raw = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        raise SettingsError("token_keys_file", f"{where}: the key is not base64url") from None
    most = _MAX_KEY_BYTES if algorithm == "HS256" else _KEY_BYTES
    if not _KEY_BYTES <= len(raw) <= most:
        expected = f"{_KEY_BYTES}" if most == _KEY_BYTES else f"{_KEY_BYTES} to {most}"
        what = f"{where}: got a key of {len(raw)} bytes, expected {expected}"
        raise SettingsError("token_keys_file", what)
    key = TokenKey(key_id, algorithm, raw)
    try:
        key.verifying()  # now, not at the first token
    except ValueError:
        what = f"{where}: expected the 32 bytes of an Ed25519 key"
        raise SettingsError("token_keys_file", what) from None
    return key


def _check_id(where: str, key_id: str) -> None:
    if not _ID.fullmatch(key_id) or key_id == _REVOKE:
        what = (
            f"{where}: got id {key_id[:64]!r}, expected 1 to 64 letters, digits, '.', '_', '-', "
            f"not {_REVOKE!r}"
        )
        raise SettingsError("token_keys_file", what)


def _ed25519() -> Any:
    """Import Ed25519: only EdDSA keys need its 10 MB.

    Raises
    ------
    SettingsError
        When it is not installed.
    """
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ModuleNotFoundError:
        what = 'EdDSA keys need cryptography, expected "terraport[eddsa]" to be installed'
        raise SettingsError("token_keys_file", what) from None
    return ed25519
