"""Command ``terraport serve``."""

from __future__ import annotations

import ipaddress
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import quote

import typer

if TYPE_CHECKING:
    from terraport_server.settings import Settings

__all__ = ["register", "serve"]

_DIRECTORY = typer.Argument(
    help="A folder of scenes, or one scene (what terraport build wrote); or its address in object "
    "storage, s3://BUCKET/PREFIX.",
    show_default=False,
)

_OPTIONS: Final = {
    "scenes_dir": "DIRECTORY",
    "scenes_url": "DIRECTORY",
    "token_keys_file": "--token-keys",
    "allowed_origins": "--allow-origin",
    "max_radius_m": "--max-radius",
}
"""What is typed for a setting, where that is not its name with hyphens."""

_HELP = """Serve scenes to VR clients: landings over WebSocket, files over HTTP.

Every client lands with land(position, radius) and receives what it does not hold yet. New versions
of a scene are picked up while running. SIGTERM or Ctrl-C lets open landings finish first. With
--workers, SIGHUP replaces the processes one by one.

Try it:

  terraport serve scenes/

  terraport serve s3://bucket/scenes

  terraport land http://127.0.0.1:8080/scenes/quarry 0 0 0 --radius 60

  curl http://127.0.0.1:8080/scenes

Every option and many more can be set in the environment as TERRAPORT_NAME, e.g. TERRAPORT_TOKEN,
TERRAPORT_MAX_RADIUS_M; docs/topics/settings.md lists them. An option given here wins over it.
"""


_WITHOUT_PROXY: Final = """\
  Without a proxy in front, nothing limits idle connections, slow requests, the size of headers,
  or connections per address: on an open network put Caddy or the like before it
  (docs/how-to/deploy.md)."""


def serve(
    directory: Annotated[str, _DIRECTORY],
    host: Annotated[
        str | None, typer.Option(help="Address to listen on. [default: 127.0.0.1]")
    ] = None,
    port: Annotated[int | None, typer.Option(help="Port. [default: 8080]")] = None,
    token: Annotated[
        str | None,
        typer.Option(help="Token that clients must show (16 characters or more)."),
    ] = None,
    tokens_file: Annotated[
        Path | None,
        typer.Option(help="File of tokens: lines of NAME TOKEN [+SCOPE] [SCENE ...]."),
    ] = None,
    token_keys: Annotated[
        Path | None,
        typer.Option(help="File of keys; tokens that they signed are accepted (terraport token)."),
    ] = None,
    allow_open: Annotated[
        bool | None,
        typer.Option("--allow-open", help="Serve without tokens although others can connect."),
    ] = None,
    allow_origin: Annotated[
        list[str] | None,
        typer.Option(help="Origin of web pages that may connect; repeatable; '*' = all."),
    ] = None,
    ssl_certfile: Annotated[
        Path | None, typer.Option(help="PEM file of the certificate, for https.")
    ] = None,
    ssl_keyfile: Annotated[Path | None, typer.Option(help="PEM file of its key.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes behind the port. [default: 1]")
    ] = None,
    max_radius: Annotated[
        float | None, typer.Option(help="Largest landing radius, metres. [default: 500]")
    ] = None,
    max_sessions: Annotated[
        int | None, typer.Option(help="Most clients at once. [default: 256]")
    ] = None,
    viewer: Annotated[
        bool | None,
        typer.Option("--viewer/--no-viewer", help="Show the viewer at /. [default: viewer]"),
    ] = None,
    log_format: Annotated[str | None, typer.Option(help="text or json. [default: text]")] = None,
    log_level: Annotated[
        str | None, typer.Option(help="debug, info, warning or error. [default: info]")
    ] = None,
) -> None:
    """Serve scenes until a signal; the text for people is ``_HELP``.

    An option that is not given is left to the environment, then to the default of ``Settings``: no
    default stands here twice.
    """
    # Options by the names of the settings.
    from terraport_server.errors import ServerError, SettingsError
    from terraport_server.serving import run
    from terraport_server.settings import read_settings, typed_name
    from terraport_store import StoreError, is_url

    given: dict[str, Any] = {
        "scenes_url" if is_url(directory) else "scenes_dir": directory,
        "host": host,
        "port": port,
        "token": token,
        "tokens_file": tokens_file,
        "token_keys_file": token_keys,
        "allow_open": allow_open,
        "allowed_origins": tuple(allow_origin) if allow_origin else None,
        "ssl_certfile": ssl_certfile,
        "ssl_keyfile": ssl_keyfile,
        "workers": workers,
        "max_radius_m": max_radius,
        "max_sessions": max_sessions,
        "viewer": viewer,
        "log_format": log_format,
        "log_level": log_level,
    }
    options = {name: value for name, value in given.items() if value is not None}
    if "scenes_dir" in options:
        options["scenes_url"] = None  # which would win, from the environment, over what is given
    # Serve; errors that the operator can fix are one line without a trace.
    try:
        settings = read_settings(options)

        def announce(port: int) -> None:
            _announce(settings.model_copy(update={"port": port}))

        run(settings, options, announce)
    except SettingsError as error:
        names = {name: _OPTIONS.get(name, f"--{name.replace('_', '-')}") for name in given}
        typer.echo(f"error: {typed_name(error.setting, names, options)}: {error.what}", err=True)
        raise typer.Exit(1) from None
    except (ServerError, StoreError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None


def register(app: typer.Typer) -> None:
    """Add the server's commands to the command line."""
    app.command("serve", help=_HELP)(serve)


def _announce(settings: Settings) -> None:
    """Print address, scenes and access, after the port is bound and before the log starts."""
    from terraport_server.settings import is_loopback
    from terraport_store import StoreError, list_scenes, read_manifest

    scheme = "https" if settings.ssl_certfile else "http"
    address = _address(settings, scheme)
    access = "open to everyone who can connect" if settings.is_open else "with a token"
    location = settings.scenes_url or settings.scenes_dir
    if _is_every_address(settings.host):
        access = f"all addresses of this machine; {access}"
    typer.echo(f"terraport serves {location} at {address} ({access})")
    if not is_loopback(settings.host):
        typer.echo(_WITHOUT_PROXY)
    typer.echo(f"  viewer: {_viewer_line(settings, scheme)}")
    if settings.scenes_url is not None:
        typer.echo("  the log names each scene as it is opened")
        return
    scenes = list_scenes(settings.scenes_dir)
    for scene_id, directory in scenes.items():
        url = f"{address}/scenes/{quote(scene_id, safe='')}"
        try:
            manifest = read_manifest(directory)
        except (StoreError, OSError) as error:
            typer.echo(f"  {url}  not served: {error}")
            continue
        counts = manifest.counts
        typer.echo(
            f"  {url}  {manifest.name}: {counts.segments} segments, {counts.detail_faces} triangles"
        )
    if not scenes:
        output = shlex.quote(str(settings.scenes_dir / "NAME"))
        typer.echo("  no scene yet; one that appears is served within seconds:")
        typer.echo(f"  terraport build SURVEY -o {output}")


def _address(settings: Settings, scheme: str) -> str:
    """Return an address that can be opened on this machine: no wildcard, IPv6 in brackets."""
    # An address that stands for all of them is none that a browser could be pointed at.
    from terraport_server.serving import host_in_url

    host = "localhost" if _is_every_address(settings.host) else settings.host
    return f"{scheme}://{host_in_url(host)}:{settings.port}"


def _viewer_line(settings: Settings, scheme: str) -> str:
    """Return the viewer's address, or why there is no viewer."""
    from terraport_server.http.viewer import has_viewer

    if not settings.viewer:
        return "switched off"
    if not has_viewer(settings):
        return "not built; in a checkout `pip install -e .` builds it"
    return f"{_address(settings, scheme)}/"


def _is_every_address(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False  # a name
