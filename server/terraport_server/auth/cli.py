"""Command ``terraport token``: signing keys and expiring tokens."""

from __future__ import annotations

import datetime as dt
import functools
import json
import re
import secrets
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

if TYPE_CHECKING:
    from terraport_server.auth.keys import TokenKey
    from terraport_server.auth.tokens import Scope

__all__ = ["register"]

_UNITS_S: Final = {"s": 1, "m": 60, "h": 3600, "d": 86_400}
_LONGEST_S: Final = 400 * 86_400
"""Maximum validity: a year and a month."""
_MIN_ID_BYTES: Final = 8
_STANDARD_INPUT: Final = "-"

_HELP = """Create signing keys and expiring tokens for a service that needs tokens.

A token contains a user, scenes and an expiry. It is signed with a key, so the service needs no list
of tokens. For example:

  terraport token new-key keys                                  once; keep the file secret

  terraport serve scenes --host 0.0.0.0 --token-keys keys       accept its tokens

  terraport token create --keys keys --name anna --scene pit --valid 8h

  terraport token show - < token                                show its contents

To rotate the key, run new-key again: the new key signs, and the old one is still accepted. Remove
its line when its last token has expired. See docs/how-to/tokens.md.
"""

_KEYS = Annotated[Path, typer.Option(help="Key file written by new-key.", show_default=False)]


def new_key_command(
    file: Annotated[Path, typer.Argument(help="Key file, created if missing.", show_default=False)],
    algorithm: Annotated[
        str,
        typer.Option(help="HS256: one secret for both. EdDSA: the service only verifies."),
    ] = "HS256",
    key_id: Annotated[
        str | None, typer.Option("--id", help="Name of the key. [default: today's date]")
    ] = None,
) -> None:
    """Create a key and put it first in the file, readable only by its owner.

    With --algorithm EdDSA the public keys are written to FILE.public: give that file to the
    service, and keep FILE where tokens are created.

    For example:

      terraport token new-key keys

      terraport token new-key keys --algorithm EdDSA --id 2027
    """
    from terraport_server.auth.keys import new_key, read_keys, write_keys
    from terraport_server.errors import SettingsError

    old = read_keys(file) if file.exists() else None
    keys = () if old is None else old.keys
    name = key_id or _free_id({key.id for key in keys})
    if any(key.id == name for key in keys):
        raise SettingsError("--id", f"got {name}, which is already in {file}, expected a new id")
    signing_key = new_key(name, algorithm)
    revoked = () if old is None else sorted(old.revoked)
    write_keys(file, _lines((signing_key, *keys), revoked))
    typer.echo(f"wrote key {name} ({algorithm}) to {file}: it signs now, {len(keys)} other")
    served = file
    private = [key for key in (signing_key, *keys) if key.algorithm == "EdDSA-private"]
    if private:
        served = file.with_name(f"{file.name}.public")
        shown = [k.public() if k.algorithm == "EdDSA-private" else k for k in (signing_key, *keys)]
        write_keys(served, _lines(tuple(shown), revoked))
        typer.echo(f"wrote the public keys to {served}: for the service")
    checking, signing = shlex.quote(str(served)), shlex.quote(str(file))
    typer.echo(f"the service: terraport serve DIRECTORY --token-keys {checking}")
    typer.echo(
        f"a token:     terraport token create --keys {signing} --name NAME --scene ID --valid 8h"
    )


def create(
    keys: _KEYS,
    name: Annotated[str, typer.Option(help="Name of the user, for the service's log.")],
    valid: Annotated[str, typer.Option(help="Validity: 30m, 8h, 7d; at most 400d.")] = "8h",
    scene: Annotated[
        list[str] | None, typer.Option(help="Id of a scene that the token opens; repeatable.")
    ] = None,
    all_scenes: Annotated[bool, typer.Option("--all-scenes", help="Open every scene.")] = False,
    begins: Annotated[
        str | None, typer.Option("--in", help="Time until the token becomes valid: 30m, 8h, 7d.")
    ] = None,
    audience: Annotated[
        str | None, typer.Option(help="The service's TERRAPORT_TOKEN_AUDIENCE, if it has one.")
    ] = None,
    scope: Annotated[
        list[str] | None,
        typer.Option(
            help="Allowed actions: land (the default), guide, teach, metrics; repeatable."
        ),
    ] = None,
) -> None:
    """Print a token to standard output, and its contents to standard error.

    For example:

      terraport token create --keys keys --name anna --scene pit --valid 8h

      terraport token create --keys keys --name tour --all-scenes --scope guide > token
    """
    from terraport_server.auth.keys import read_keys
    from terraport_server.auth.tokens import LAND, make_token, read_token
    from terraport_server.errors import SettingsError
    from terraport_wire import MAX_TOKEN_BYTES

    scopes = _scopes(scope)
    if "land" in scopes and all_scenes == bool(scene):
        raise SettingsError("--scene", "expected --scene ID, once or more, or --all-scenes")
    ring = read_keys(keys)
    now_s = int(time.time())
    begins_s = None if begins is None else now_s + _seconds("--in", begins)
    token = make_token(
        ring.keys[0],
        name=name,
        scenes=None if all_scenes else frozenset(scene or ()),
        expires_s=(now_s if begins_s is None else begins_s) + _seconds("--valid", valid),
        begins_s=begins_s,
        audience=audience,
        token_id=secrets.token_hex(_MIN_ID_BYTES),
        scopes=scopes,
    )
    # Verify as the service does.
    claims = read_token(token, ring, audience=audience)
    if claims is None:
        raise SettingsError("--name", f"got {name[:80]!r}, expected 1 to 64 printable characters")
    if len(token) > MAX_TOKEN_BYTES:
        what = f"got a token of {len(token)} characters, expected at most {MAX_TOKEN_BYTES}"
        raise SettingsError("--scene", f"{what}; use --all-scenes, or several tokens")
    typer.echo(token)
    opens = "every scene" if claims.scenes is None else ", ".join(sorted(claims.scenes))
    opens = "; ".join(filter(None, [opens, ", ".join(sorted(scopes - LAND))]))
    typer.echo(f"for {name}: {opens}, until {_time(claims.expires_s)}", err=True)
    typer.echo(f"revocation: add the line  revoke {claims.token_id}  to {keys}", err=True)


def show(
    token: Annotated[
        str,
        typer.Argument(help="The token, or - to read it from standard input.", show_default=False),
    ],
    keys: Annotated[
        Path | None, typer.Option(help="Key file: also check the signature.", show_default=False)
    ] = None,
    audience: Annotated[
        str | None, typer.Option(help="The service's TERRAPORT_TOKEN_AUDIENCE, if it has one.")
    ] = None,
) -> None:
    """Show the contents of a token, which is signed but not encrypted.

    For example:

      terraport token show - < token

      terraport token show - --keys keys < token          also check the signature
    """
    from terraport_server.auth.keys import read_keys
    from terraport_server.auth.tokens import decode_unverified, read_token
    from terraport_server.errors import SettingsError
    from terraport_wire import MAX_TOKEN_BYTES

    text = sys.stdin.readline(MAX_TOKEN_BYTES + 2).strip() if token == _STANDARD_INPUT else token
    decoded = decode_unverified(text)
    if decoded is None:
        raise SettingsError("token", "not a signed token, expected three parts separated by dots")
    header, claims = decoded
    typer.echo(json.dumps({"header": header, "claims": claims}, indent=1))
    for name in ("nbf", "exp"):
        if isinstance(claims.get(name), int | float):
            typer.echo(f"{'valid from' if name == 'nbf' else 'expires'} {_time(claims[name])}")
    if isinstance(claims.get("exp"), int | float) and claims["exp"] <= time.time():
        typer.echo("it has expired")
    if keys is None:
        typer.echo("signature not checked: give --keys")
        return
    if read_token(text, read_keys(keys), audience=audience) is None:
        what = "not signed by a key of the file, or revoked, or a claim is missing or wrong"
        raise SettingsError("token", f"{what}; the service refuses it")
    typer.echo("signature and claims are valid")


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    group = typer.Typer(
        help=_HELP, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
    )
    group.command("new-key")(_with_plain_errors(new_key_command, keys="FILE"))
    group.command("create")(_with_plain_errors(create))
    group.command("show")(_with_plain_errors(show))
    app.add_typer(group, name="token")


def _with_plain_errors(command: Any, keys: str = "--keys") -> Any:
    """Return the command with expected errors as one line and exit code 1.

    `keys` is the command's name of its key file, which the service calls ``token_keys_file``.
    """

    @functools.wraps(command)
    def checked(*arguments: Any, **options: Any) -> None:
        from terraport_server.errors import ServerError, SettingsError

        try:
            command(*arguments, **options)
        except SettingsError as error:
            name = keys if error.setting == "token_keys_file" else error.setting
            typer.echo(f"error: {name}: {error.what}", err=True)
            raise typer.Exit(1) from None
        except (ServerError, OSError) as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(1) from None

    return checked


def _lines(keys: tuple[TokenKey, ...], revoked: Any) -> list[str]:
    return [
        "# Keys of terraport tokens: ID ALGORITHM KEY, the first one signs. Keep this file secret.",
        *(key.line() for key in keys),
        *(f"revoke {token_id}" for token_id in revoked),
    ]


def _scopes(words: list[str] | None) -> frozenset[Scope]:
    from terraport_server.auth.tokens import LAND, SCOPES, scopes_of
    from terraport_server.errors import SettingsError

    wrong = [word for word in words or () if word not in SCOPES]
    if wrong:
        expected = ", ".join(SCOPES)
        raise SettingsError("--scope", f"got {wrong[0][:32]!r}, expected one of {expected}")
    return scopes_of(words) if words else LAND


def _free_id(taken: set[str]) -> str:
    today = dt.datetime.now(tz=dt.UTC).date().isoformat()
    names = [today, *(f"{today}.{number}" for number in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)


def _seconds(option: str, text: str) -> int:
    from terraport_server.errors import SettingsError

    match = re.fullmatch(r"([1-9][0-9]{0,8})([smhd])", text.strip())
    seconds = 0 if match is None else int(match[1]) * _UNITS_S[match[2]]
    if not 0 < seconds <= _LONGEST_S:
        raise SettingsError(option, f"got {text[:40]!r}, expected like 30m, 8h, 7d, at most 400d")
    return seconds


def _time(seconds: float) -> str:
    try:
        return dt.datetime.fromtimestamp(seconds, tz=dt.UTC).isoformat(timespec="seconds")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:g} s after 1970"
