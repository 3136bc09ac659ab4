"""The service in a thread of another program."""

from __future__ import annotations

import socket
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self
from urllib.parse import quote

from terraport_server.errors import ServerError
from terraport_server.http.viewer import has_viewer
from terraport_server.limits import DEFAULT_LIMITS
from terraport_server.service import Service
from terraport_server.serving import host_in_url, listen, make_server
from terraport_server.settings import Settings
from terraport_store import is_url

__all__ = ["BackgroundServer"]

_START_TIMEOUT_S: Final = 60.0


class BackgroundServer:
    """The service in a thread, on a free port of this machine; a context manager.

    ::

        with BackgroundServer(scenes_dir) as server:
            print(server.url)

    Parameters
    ----------
    scenes_dir
        A folder of scenes, or one scene; or the address of such in object storage, as a str.
    sockets
        Where it listens, from :func:`terraport_server.serving.listen`; closed at the end. By
        default on `host` and `port`.
    **overrides
        Any other fields of :class:`Settings` or of :class:`~terraport_server.limits.Limits`.

    Raises
    ------
    SettingsError
        If the settings are not valid.
    ServerError
        If the address cannot be bound.
    """

    def __init__(
        self,
        scenes_dir: Path | str,
        *,
        sockets: list[socket.socket] | None = None,
        **overrides: Any,
    ) -> None:
        overrides.setdefault("host", "127.0.0.1")
        overrides.setdefault("port", 0)
        overrides["workers"] = 1  # a thread of this process is all there is
        if is_url(scenes_dir):
            overrides["scenes_url"] = scenes_dir
        else:
            overrides["scenes_dir"] = Path(scenes_dir)
        limits = {name: overrides.pop(name) for name in set(overrides) - set(Settings.model_fields)}
        settings = Settings(**overrides)
        self._server, self._service = make_server(settings, DEFAULT_LIMITS.with_changes(**limits))
        self._sockets = sockets or listen(settings.host, settings.port)
        self.port: int = self._sockets[0].getsockname()[1]
        """Listening port."""
        self._thread = threading.Thread(target=self._run, name="terraport-server", daemon=True)
        self._failure: BaseException | None = None

    @property
    def service(self) -> Service:
        """The running service, read-only: it belongs to the event loop of another thread."""
        return self._service

    @property
    def url(self) -> str:
        """Address of the service, ``http://HOST:PORT``."""
        return f"http://{host_in_url(self._server.config.host)}:{self.port}"

    def scene_url(self, scene_id: str) -> str:
        """Address of one scene."""
        return f"{self.url}/scenes/{quote(scene_id, safe='')}"

    def viewer_url(self, scene_id: str) -> str | None:
        """Address of the viewer with one scene open; None where no viewer is served."""
        if not has_viewer(self.service.settings):
            return None
        return f"{self.url}/#scene={quote(scene_id, safe='')}"

    def start(self) -> None:
        """Start and wait until clients are served.

        Raises
        ------
        ServerError
            If it does not start.
        """
        self._thread.start()
        waited = threading.Event()
        for _ in range(int(_START_TIMEOUT_S / 0.01)):
            if self._server.started:
                return
            if not self._thread.is_alive():
                break
            waited.wait(0.01)
        self.stop()
        raise ServerError(f"the service did not start: {self._failure!r}")

    def stop(self) -> None:
        """Drain, stop and wait; can be called repeatedly."""
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join()
        for one in self._sockets:
            one.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            self._server.run(self._sockets)
        except BaseException as error:  # noqa: BLE001 - handed to the thread that asked
            self._failure = error
