"""Every setting of the service, with its default.

Each is read from the environment or a ``.env`` file as ``TERRAPORT_`` and its name in capitals, and
many have an option of ``terraport serve``. docs/topics/settings.md lists them all; a test compares.
Limits that are no settings: :mod:`terraport_server.limits`.
"""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, SecretStr, ValidationError
from pydantic_settings import BaseSettings, DotEnvSettingsSource, SettingsConfigDict

from terraport_server.errors import SettingsError
from terraport_store import is_url, meant_url
from terraport_wire import MAX_INTEGER, MAX_RADIUS_M

__all__ = [
    "ENV_PREFIX",
    "Settings",
    "is_loopback",
    "read_settings",
    "typed_name",
    "unknown_variables",
]

ENV_PREFIX: Final = "TERRAPORT_"

_BASE_URL = r"^https?://[A-Za-z0-9._~:/\[\]%@!$&'()*+,;=-]{1,1900}$"
"""No query and no fragment: paths are appended."""

_FRAME_ANCESTOR = r"^(\*|https?://(\*\.)?[A-Za-z0-9.-]{1,253}(:(\*|[0-9]{1,5}))?)$"
"""An origin as Content-Security-Policy takes it; nothing that could end the header's directive."""

_Seconds = Annotated[float, Field(gt=0, le=86_400)]


class Settings(BaseSettings):
    """Settings of one server process; immutable.

    Raises
    ------
    pydantic.ValidationError
        When a value is out of its range or not of its type.
    """

    model_config = SettingsConfigDict(
        env_prefix=ENV_PREFIX, env_file=".env", extra="ignore", frozen=True
    )

    # Scenes
    scenes_dir: Path = Path("scenes")
    """A folder of scenes, or one scene."""
    scenes_url: str | None = None
    """Scenes in object storage (s3://BUCKET/PREFIX), or one scene; instead of scenes_dir."""
    object_endpoint: str | None = None
    """Address of the S3 service; AWS_ENDPOINT_URL or Amazon's by default."""
    object_cache_dir: Path | None = None
    """Folder of the cache; terraport/objects in XDG_CACHE_HOME or ~/.cache by default."""
    object_cache_bytes: Annotated[int, Field(ge=0, le=MAX_INTEGER)] = 8 << 30
    """Payloads kept on disk, of all processes that share the folder; 0 = in memory only."""
    pull_base_url: Annotated[str, Field(pattern=_BASE_URL)] | None = None
    """Address at which the scenes' folders are served by others (a CDN, nginx, a public bucket):
    clients that pull fetch payload there; none = from this service."""

    # Network
    host: str = "127.0.0.1"
    """Address to listen on."""
    port: Annotated[int, Field(ge=0, le=65_535)] = 8080
    """TCP port; 0 = any free one."""
    workers: Annotated[int, Field(ge=1, le=256)] = 1
    """Processes behind the port; with more than one, groups cannot be joined."""
    ssl_certfile: Path | None = None
    """PEM file of the certificate and its chain: the service speaks https and wss itself."""
    ssl_keyfile: Path | None = None
    """PEM file of its key."""
    forwarded_allow_ips: str = "127.0.0.1"
    """Proxies whose X-Forwarded-For is believed, comma-separated."""

    # Access
    token: SecretStr | None = None
    """One token that opens every scene."""
    tokens_file: Path | None = None
    """File of tokens, one per line: NAME TOKEN [+SCOPE ...] [SCENE ...]."""
    token_keys_file: Path | None = None
    """File of keys that signed, expiring tokens are accepted from; see terraport token."""
    token_audience: str | None = None
    """What a signed token's "aud" must be; none = it must have none."""
    allow_open: bool = False
    """Serve without any token although other machines can connect."""
    allowed_origins: tuple[str, ...] = ()
    """Origins of web pages that may connect, besides the service's own; "*" = all."""
    allowed_hosts: tuple[str, ...] = ()
    """Names of this service, besides addresses and localhost; checked only where it is open, on
    this machine alone, and without allow_open."""
    public_metrics: bool | None = None
    """Whether /metrics answers without a token; none = only where the service is open."""
    metrics_token: SecretStr | None = None
    """Token that opens /metrics and nothing else."""

    # Viewer
    viewer: bool = True
    """Serve the viewer at /, where it is built; otherwise / answers 404."""
    viewer_dir: Path | None = None
    """Folder of another built viewer."""
    frame_ancestors: tuple[Annotated[str, Field(pattern=_FRAME_ANCESTOR)], ...] = ()
    """Origins of web pages that may show the viewer in a frame; "*" = all. Such a page can draw
    over the viewer: name only trusted ones."""

    # Sessions
    max_sessions: Annotated[int, Field(ge=1)] = 256
    """Sessions of one process."""
    max_sessions_per_ip: Annotated[int, Field(ge=1)] = 32
    """Sessions of one address; the last eighth of max_sessions is for addresses with few."""
    max_messages_per_s: Annotated[float, Field(gt=0, le=1e9)] = 60.0
    """Messages of one client, averaged over 10 s."""
    max_credit_bytes: Annotated[int, Field(ge=1, le=MAX_INTEGER)] = 64 << 20
    """Payload bytes that one client may have outstanding; more credit is clamped."""
    max_radius_m: Annotated[float, Field(gt=0, le=MAX_RADIUS_M)] = 500.0
    """Largest landing radius."""
    idle_timeout_s: _Seconds = 60.0
    """Silence, pongs included, after which a client is closed."""
    drain_timeout_s: _Seconds = 10.0
    """Time for open landings to finish after SIGTERM."""
    group_routing: Literal["process", "query", "off"] = "process"
    """Where groups can be joined: anywhere on this process; only by URLs that name the group
    (?group=NAME, by which a proxy picks the replica); or not at all."""
    group_guides: Literal["first", "token"] = "first"
    """Who may guide a group: the first client that asks, or only tokens with the scope."""

    # Log
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = "text"

    @property
    def groups_served(self) -> Literal["none", "here", "query"]:
        """Where groups can be joined: a group lives in one process."""
        if self.group_routing == "off" or self.workers != 1:
            return "none"
        return "here" if self.group_routing == "process" else "query"

    def check(self) -> None:
        """Check the settings: valid, and safe to serve with.

        Raises
        ------
        SettingsError
            When a directory is missing, when TLS is half configured, or when anyone on the
            network could read the scenes without ``allow_open``.
        """
        if self.scenes_url is not None:
            if not is_url(self.scenes_url):
                what = f"got {self.scenes_url!r}, expected an address like s3://BUCKET/PREFIX"
                raise SettingsError("scenes_url", what)
        elif not self.scenes_dir.is_dir():
            raise SettingsError("scenes_dir", _no_folder(self.scenes_dir))
        if self.viewer_dir is not None and not (self.viewer_dir / "index.html").is_file():
            what = f"{self.viewer_dir} has no index.html, expected the folder of a built viewer"
            raise SettingsError("viewer_dir", what)
        if (self.ssl_certfile is None) != (self.ssl_keyfile is None):
            what = "got one of ssl_certfile and ssl_keyfile, expected both"
            raise SettingsError("ssl_keyfile", what)
        if self.workers > 1 and os.name == "nt":
            raise SettingsError("workers", f"got {self.workers} on Windows, expected 1")
        if self.is_open and not self.allow_open and not is_loopback(self.host):
            raise SettingsError(
                "token",
                f"got none while listening on {self.host}, expected a token, tokens file or "
                "token keys; set allow_open (--allow-open) if everyone may read these scenes",
            )

    @property
    def object_cache_folder(self) -> Path | None:
        """The cache's folder; None where nothing is kept on disk."""
        if not self.object_cache_bytes:
            return None
        if self.object_cache_dir is not None:
            return self.object_cache_dir
        caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(caches) / "terraport" / "objects"

    @property
    def is_open(self) -> bool:
        """Whether no token is needed."""
        return self.token is None and self.tokens_file is None and self.token_keys_file is None

    @property
    def serves_docs(self) -> bool:
        """Whether /docs needs no token."""
        return self.is_open

    @property
    def serves_metrics(self) -> bool:
        """Whether /metrics needs no token."""
        if self.public_metrics is None:
            return self.is_open and self.metrics_token is None
        return self.public_metrics

    @property
    def checks_host(self) -> bool:
        """Whether the Host header of requests is checked."""
        return self.is_open and not self.allow_open and is_loopback(self.host)


def _no_folder(path: Path) -> str:
    """Return the error text for a path that is not a folder of scenes."""
    meant = meant_url(path)
    if meant is not None:
        return f"got {str(path)!r}, expected {meant} for scenes in object storage"
    expected = "expected a folder of scenes, or one scene (terraport build makes them)"
    if path.is_file():
        return f"{path} is a file, {expected}; it lies in {path.absolute().parent}"
    return f"there is no folder {path}, {expected}"


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


_PHRASES: Final = (
    (r"^Input is not a valid path.*", "a path"),
    (r"^String should match pattern", "text that matches"),
    (r"^Input should be ", ""),
    (r"^(?=greater|less)", "a number "),
    (r"^a valid tuple", 'a JSON list such as ["one", "two"]'),
)
"""Parts of pydantic's messages, and what they become."""


def read_settings(given: Mapping[str, Any]) -> Settings:
    """Read all settings; `given` wins over the environment, and that over ``.env``.

    Raises
    ------
    SettingsError
        When a value is out of its range or not of its type; secrets are not repeated.
    """
    try:
        return Settings(**given)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name, value = str(first["loc"][0]), first["input"]
        expected = first["msg"].partition(", unable")[0]
        for theirs, ours in _PHRASES:
            expected = re.sub(theirs, ours, expected)
    except ValueError as error:  # pydantic-settings', for a list
        field = re.search(r'field "(\w+)"', str(error))
        if field is None:
            raise
        name, expected = field[1], 'a JSON list such as ["one", "two"]'
        value = _variables().get(f"{ENV_PREFIX}{name}".upper())
    is_secret = "Secret" in str(Settings.model_fields[name].annotation)
    shown = "another value" if is_secret else repr(str(value)[:60])
    raise SettingsError(name, f"got {shown}, expected {expected}") from None


def typed_name(setting: str, options: Mapping[str, str], given: Mapping[str, Any]) -> str:
    """Return the name by which the operator knows a setting.

    Parameters
    ----------
    setting
        Its field.
    options
        Option by field, for those that have one.
    given
        Fields that options gave a value.

    Returns
    -------
    str
        The option, or the environment variable where that gave the value.
    """
    variable = f"{ENV_PREFIX}{setting}".upper()
    is_variable = setting not in given and variable in _variables()
    return variable if is_variable else options.get(setting, variable)


def unknown_variables() -> list[str]:
    """Return the ``TERRAPORT_`` variables that are no settings."""
    known = {f"{ENV_PREFIX}{name}".upper() for name in Settings.model_fields}
    return sorted(
        name for name in _variables() if name.startswith(ENV_PREFIX) and name not in known
    )


def _variables() -> dict[str, str | None]:
    """Return the variables of ``.env`` and of the process; names in capitals."""
    variables = {**DotEnvSettingsSource(Settings).env_vars, **os.environ}
    return {name.upper(): value for name, value in variables.items()}
