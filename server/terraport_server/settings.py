"""Every setting of the service, with its default.

Each is read from the environment or a ``.env`` file as ``TERRAPORT_`` and its name in capitals, and
most have an option of ``terraport serve``. docs/topics/limits.md lists them all; a test compares.
"""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from terraport_server.errors import SettingsError
from terraport_server.groups.state import GroupLimits
from terraport_server.session.interface import SessionLimits
from terraport_store import is_url, meant_url
from terraport_wire import (
    MAX_CLIENT_MESSAGE_BYTES,
    MAX_DEADLINE_MS,
    MAX_GROUP_MEMBERS,
    MAX_HELD_SEGMENTS,
    MAX_INTEGER,
    MAX_PLAN_SEGMENTS,
    MAX_RADIUS_M,
    MAX_RELEASE_FACTOR,
)

__all__ = ["ENV_PREFIX", "Settings", "is_loopback"]

ENV_PREFIX = "TERRAPORT_"

_BASE_URL = r"^https?://[A-Za-z0-9._~:/\[\]%@!$&'()*+,;=-]{1,1900}$"
"""No query and no fragment: paths are appended."""

_FRAME_ANCESTOR = r"^(\*|https?://(\*\.)?[A-Za-z0-9.-]{1,253}(:(\*|[0-9]{1,5}))?)$"
"""An origin as Content-Security-Policy takes it; nothing that could end the header's directive."""

_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Bytes = Annotated[int, Field(ge=1, le=MAX_INTEGER)]


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

    scenes_dir: Path = Path("scenes")
    """A folder of scenes, or one scene."""
    scene_poll_s: _Seconds = 1.0
    """How often scene.json files are looked at for newer versions."""
    scenes_url: str | None = None
    """Scenes in object storage (s3://BUCKET/PREFIX), or one scene; in place of scenes_dir."""

    pull_base_url: Annotated[str, Field(pattern=_BASE_URL)] | None = None
    """Address under which the scenes' folders are served by others (a CDN, nginx, a public
    bucket): clients that pull fetch payload there; none = from this service."""

    object_endpoint: str | None = None
    """Address of the S3 service; AWS_ENDPOINT_URL or Amazon's by default."""
    object_region: str | None = None
    """AWS_REGION or us-east-1 by default."""
    object_poll_s: _Seconds = 10.0
    """As scene_poll_s, for scenes_url: each look costs a list and two heads per scene."""
    object_cache_dir: Path | None = None
    """Folder of the cache; terraport/objects in XDG_CACHE_HOME or ~/.cache by default."""
    object_cache_bytes: Annotated[int, Field(ge=0, le=MAX_INTEGER)] = 8 << 30
    """Payloads kept on disk, over all processes that share the folder; 0 = in memory alone."""
    object_memory_bytes: Annotated[int, Field(ge=0, le=MAX_INTEGER)] = 64 << 20
    """Payloads kept in memory while the disk takes none."""
    object_requests: Annotated[int, Field(ge=1, le=256)] = 16
    """Requests under way at once for one scene, and as many ahead of need."""
    object_read_ahead_bytes: Annotated[int, Field(ge=0, le=MAX_INTEGER)] = 8 << 20
    """What is fetched ahead for one landing; 0 = nothing."""
    object_timeout_s: _Seconds = 20.0
    """No attempt at a request begins later than this after the first, and none takes longer."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65_535)] = 8080
    workers: Annotated[int, Field(ge=1, le=256)] = 1
    """Processes behind the one port. Most limits below hold for each of them; groups cannot be
    joined with more than one."""
    ssl_certfile: Path | None = None
    """PEM file of the certificate and its chain: the service speaks https and wss itself."""
    ssl_keyfile: Path | None = None
    """PEM file of its key."""
    forwarded_allow_ips: str = "127.0.0.1"
    """Proxies whose X-Forwarded-For is believed, comma-separated."""

    token: SecretStr | None = None
    """One token that opens every scene."""
    tokens_file: Path | None = None
    """File of tokens, one a line: NAME TOKEN [+SCOPE ...] [SCENE ...]; no scene named = every
    scene, no scope = land; see docs/how-to/tokens.md."""
    token_keys_file: Path | None = None
    """File of keys that signed, expiring tokens are accepted from; see terraport token."""
    token_audience: str | None = None
    """What a signed token's "aud" must be; none = it must have none."""
    token_leeway_s: Annotated[float, Field(ge=0, le=600)] = 30.0
    """How far the clock of whoever signs tokens may be from this one's."""
    access_check_s: Annotated[float, Field(ge=0.05, le=60)] = 1.0
    """How often the files above are looked at, and the tokens of running sessions."""
    allow_open: bool = False
    """Serve without any token although the host is not this machine alone."""
    allowed_origins: tuple[str, ...] = ()
    """Origins of web pages that may connect, beside the service's own; "*" = all."""
    allowed_hosts: tuple[str, ...] = ()
    """Names that this service is called by, beside addresses and localhost; asked only where it is
    open, on this machine alone, and not said to be so (allow_open)."""
    viewer: bool = True
    """Whether / is the viewer, where it is built."""
    viewer_dir: Path | None = None
    """Folder of another built viewer; none = the one that this installation brings."""
    frame_ancestors: tuple[Annotated[str, Field(pattern=_FRAME_ANCESTOR)], ...] = ()
    """Origins of web pages that may show the viewer in a frame; "*" = all, none = no page. Such a
    page can lay its own picture over the viewer: name those that are trusted."""
    public_docs: bool | None = None
    """Whether /docs answers; none = only where the service is open."""
    public_metrics: bool | None = None
    """Whether /metrics answers without a token; none = only where the service is open."""
    metrics_token: SecretStr | None = None
    """Token that opens /metrics and nothing else; of tokens_file, +metrics does the same."""

    max_connections: Annotated[int, Field(ge=1)] = 1024
    """Open connections of any kind; more are answered 503."""
    max_connections_per_ip: Annotated[int, Field(ge=1)] = 64
    """Open connections of one address, WebSockets among them as long as they live."""
    max_stranger_bytes: Annotated[int, Field(ge=1 << 20, le=MAX_INTEGER)] = 32 << 20
    """What all who are not let in have sent and was not answered, together; an eighth of it from
    one address."""
    max_sessions: Annotated[int, Field(ge=1)] = 256
    max_sessions_per_ip: Annotated[int, Field(ge=1)] = 32
    max_message_bytes: Annotated[int, Field(ge=1024, le=MAX_CLIENT_MESSAGE_BYTES)] = 1 << 20
    max_messages_per_s: Annotated[float, Field(gt=0, le=1e9)] = 60.0
    """Averaged over 10 s."""
    max_radius_m: Annotated[float, Field(gt=0, le=MAX_RADIUS_M)] = 500.0
    release_factor: Annotated[float, Field(ge=1, le=MAX_RELEASE_FACTOR)] = 1.25
    """Within so many radii of a landing what is held is kept, where the client does not say."""
    max_held_segments: Annotated[int, Field(ge=0, le=MAX_HELD_SEGMENTS)] = MAX_HELD_SEGMENTS
    max_plan_segments: Annotated[int, Field(ge=1, le=MAX_PLAN_SEGMENTS)] = MAX_PLAN_SEGMENTS
    max_credit_bytes: _Bytes = 64 << 20
    """Outstanding credit of one client; more is clamped."""
    max_pending_actions: Annotated[int, Field(ge=1, le=10_000)] = 64
    """Messages waiting for one client; above it the service stops reading from that client."""
    handshake_timeout_s: _Seconds = 10.0
    idle_timeout_s: _Seconds = 60.0
    """Silence, pongs included, after which a client is closed."""
    close_timeout_s: _Seconds = 5.0
    """How long a closing client may take to read what is left."""
    drain_timeout_s: _Seconds = 10.0
    """How long open landings may take to finish after SIGTERM."""
    reconnect_after_ms: Annotated[int, Field(ge=0, le=600_000)] = 1000
    """What a draining service tells its clients."""

    http_header_bytes: Annotated[int, Field(ge=8192, le=1 << 20)] = 32 << 10
    """Request line and headers of one request."""
    http_body_bytes: Annotated[int, Field(ge=0, le=1 << 20)] = 16 << 10
    """Body of one request; none is ever needed."""
    http_header_timeout_s: _Seconds = 10.0
    """From connecting, or the last answer, to the end of the next request's headers."""
    http_keep_alive_s: _Seconds = 5.0
    """How long a connection may stay without a request after an answer."""
    http_stall_timeout_s: _Seconds = 30.0
    """How long a client may take no byte of an answer."""

    notsent_lowat_bytes: Annotated[int, Field(ge=0)] = 128 << 10
    """TCP_NOTSENT_LOWAT of client sockets, so that a supersede is not stuck behind megabytes; 0 =
    leave the system's."""
    send_buffer_bytes: Annotated[int, Field(ge=0)] = 0
    """SO_SNDBUF of client sockets; 0 = the system's."""
    congestion_control: Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,15}$")] | None = None
    """TCP_CONGESTION of client sockets, such as "bbr" for lossy links; None = the system's."""

    group_routing: Literal["process", "query", "off"] = "process"
    """Where groups can be joined: anywhere on this process; only by URLs that name the group
    (?group=NAME, by which a proxy picks the replica); or not at all, as with several workers."""
    group_guides: Literal["first", "token"] = "first"
    """Who may guide a group: whoever asks first, or only tokens that say so."""
    max_groups: Annotated[int, Field(ge=1, le=100_000)] = 64
    max_groups_per_client: Annotated[int, Field(ge=1, le=100_000)] = 8
    max_group_members: Annotated[int, Field(ge=1, le=MAX_GROUP_MEMBERS)] = 32
    group_absence_s: Annotated[float, Field(gt=0, le=3600)] = 30.0
    """How long the seat of a lost member is kept."""
    group_deadline_s: Annotated[float, Field(gt=0, le=MAX_DEADLINE_MS / 1000)] = 60.0
    """Longest that a group landing's barrier stays shut; the default where the guide names none."""

    max_picks: Annotated[int, Field(ge=1, le=1000)] = 8
    """Picks of one client under way at once."""
    pick_timeout_s: _Seconds = 2.0
    pick_max_segments: Annotated[int, Field(ge=1)] = 64
    """Segments that one pick may decode."""
    pick_cache_bytes: Annotated[int, Field(ge=0)] = 64 << 20
    """Decoded segments kept for picks, over all clients."""
    pick_threads: Annotated[int, Field(ge=1, le=64)] = 1

    max_strokes_per_s: Annotated[float, Field(gt=0, le=1000)] = 2.0
    """Strokes that one token may paint or take back, averaged over 10 s."""

    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = "text"

    def session_limits(self, server: str) -> SessionLimits:
        """Return what one client may do.

        Parameters
        ----------
        server
            Name and version of the service, for ``welcome``.
        """
        return SessionLimits(
            server=server,
            release_factor=self.release_factor,
            max_radius_m=self.max_radius_m,
            max_message_bytes=self.max_message_bytes,
            max_messages_per_s=self.max_messages_per_s,
            max_held_segments=self.max_held_segments,
            max_plan_segments=self.max_plan_segments,
            max_credit_bytes=self.max_credit_bytes,
            max_picks=self.max_picks,
            handshake_timeout_s=self.handshake_timeout_s,
            idle_timeout_s=self.idle_timeout_s,
            reconnect_after_ms=self.reconnect_after_ms,
            groups=self.groups_served,
        )

    @property
    def groups_served(self) -> Literal["none", "here", "query"]:
        """Where groups can be joined: a group lives in one process."""
        if self.group_routing == "off" or self.workers != 1:
            return "none"
        return "here" if self.group_routing == "process" else "query"

    def group_limits(self) -> GroupLimits:
        """Return what bounds all groups of this process."""
        return GroupLimits(
            max_groups=self.max_groups,
            max_groups_per_client=self.max_groups_per_client,
            max_group_members=self.max_group_members,
            group_absence_s=self.group_absence_s,
            group_deadline_s=self.group_deadline_s,
        )

    def check(self) -> None:
        """Refuse settings that cannot be served with, or not safely.

        Raises
        ------
        SettingsError
            When a directory is missing, when TLS is half configured, or when anyone on the
            network could read the scenes and nobody said so.
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
    def poll_s(self) -> float:
        """How often the scenes are looked at, where they lie."""
        return self.scene_poll_s if self.scenes_url is None else self.object_poll_s

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
        """Whether no token is asked for."""
        return self.token is None and self.tokens_file is None and self.token_keys_file is None

    @property
    def serves_docs(self) -> bool:
        """Whether anybody may read /docs."""
        return self.is_open if self.public_docs is None else self.public_docs

    @property
    def serves_metrics(self) -> bool:
        """Whether anybody may read /metrics."""
        if self.public_metrics is None:
            return self.is_open and self.metrics_token is None
        return self.public_metrics

    @property
    def checks_host(self) -> bool:
        """Whether a request must call the service by a name that is its own."""
        return self.is_open and not self.allow_open and is_loopback(self.host)


def _no_folder(path: Path) -> str:
    """Say what a path is instead of a folder of scenes."""
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
