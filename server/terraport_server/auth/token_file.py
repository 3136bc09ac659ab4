"""The file of static tokens."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from terraport_server.auth.scopes import LAND, SCOPES, Scope, scopes_of
from terraport_server.errors import SettingsError
from terraport_wire import MAX_TOKEN_BYTES

__all__ = ["MIN_TOKEN_CHARACTERS", "StaticToken", "check_token", "read_lines", "read_tokens"]

MIN_TOKEN_CHARACTERS: Final = 16
"""Shorter ones can be guessed; ``python -c "import secrets; print(secrets.token_urlsafe())"``."""

_MAX_FILE_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class StaticToken:
    """A token that does not expire: one line of the tokens file."""

    name: str
    token: str = field(repr=False)
    scenes: frozenset[str] | None = None
    """Ids; ``None`` = every scene."""
    scopes: frozenset[Scope] = LAND
    """What its bearer may do."""


def read_tokens(path: Path) -> list[StaticToken]:
    """Read a tokens file.

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
        if len(words) < 2:
            what = f"{path} line {number}: got one word, expected NAME TOKEN [SCENE ...]"
            raise SettingsError("tokens_file", what)
        check_token("tokens_file", words[1], where=f"{path} line {number}: ")
        named = {word[1:] for word in words[2:] if word.startswith("+")}
        if not named <= set(SCOPES):
            wrong = ", ".join(sorted(f"+{word[:32]}" for word in named.difference(SCOPES)))
            expected = ", ".join(f"+{scope}" for scope in SCOPES)
            what = f"{path} line {number}: got {wrong}, expected scopes out of {expected}"
            raise SettingsError("tokens_file", what)
        scenes = frozenset(word for word in words[2:] if not word.startswith("+"))
        scopes = scopes_of(named) if named else LAND
        tokens.append(StaticToken(words[0], words[1], scenes or None, scopes))
    if not tokens:
        raise SettingsError("tokens_file", f"{path} holds no token, expected at least one")
    return tokens


def read_lines(setting: str, path: Path) -> list[tuple[int, list[str]]]:
    """Return the number and the words of every line that is neither empty nor a comment.

    Raises
    ------
    SettingsError
        When the file cannot be read, is too large, or is no UTF-8 text.
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
        raise SettingsError(setting, f"{path} is no UTF-8 text") from None
    words = ((number, line.split()) for number, line in enumerate(lines, start=1))
    return [(number, line) for number, line in words if line and not line[0].startswith("#")]


def check_token(setting: str, token: str, where: str = "") -> None:
    """Refuse a token that is too short to be secret, or too long to be sent.

    `where` in a file it stands goes before the message.

    Raises
    ------
    SettingsError
        With the token's length, never with the token.
    """
    if not MIN_TOKEN_CHARACTERS <= len(token) <= MAX_TOKEN_BYTES:
        what = (
            f"{where}got a token of {len(token)} characters, expected {MIN_TOKEN_CHARACTERS} to "
            f"{MAX_TOKEN_BYTES}"
        )
        raise SettingsError(setting, what)
