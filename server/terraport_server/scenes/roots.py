"""Location of the served scenes: a folder, or an address in object storage."""

from __future__ import annotations

import logging
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prometheus_client import CollectorRegistry

from terraport_server.errors import SettingsError
from terraport_server.limits import Limits
from terraport_server.logging import log
from terraport_server.metrics import ObjectMetrics
from terraport_server.settings import Settings
from terraport_store import (
    REACH_S,
    FolderFiles,
    OriginError,
    SceneBuilding,
    SceneFiles,
    list_building,
    list_scenes,
)

if TYPE_CHECKING:
    from terraport_store.object_files import ObjectFiles, ObjectStorage

__all__ = ["Look", "ObjectRoot", "SceneRoot", "root_of"]

_MANIFEST: Final = "scene.json"
_LABELS: Final = "labels.json"


@dataclass(frozen=True, slots=True)
class Look:
    """State of a scene, found without opening it."""

    files: SceneFiles
    manifest: Hashable
    """Changes when scene.json is replaced."""
    labels: Hashable | None
    """Changes with labels.json; None where there is none."""


class SceneRoot:
    """A folder of scenes, or one scene."""

    fetch_threads = 0
    """Threads of each scene that may wait for a network; 0 = no network."""
    ahead_bytes = 0
    """Payload bytes that are prefetched for each landing; 0 = none."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def look(self) -> dict[str, Look]:
        """Return the state of every scene by id, ascending. Blocks; not concurrently.

        Raises
        ------
        StoreError, OSError
            When the scenes cannot be listed.
        """
        looks = {}
        for scene_id, directory in list_scenes(self._directory).items():
            files = FolderFiles(directory)
            manifest = files.stamp(_MANIFEST)
            if manifest is not None:  # else removed since it was listed
                looks[scene_id] = Look(files, manifest, files.stamp(_LABELS))
        return looks

    def building(self) -> list[SceneBuilding]:
        """List the scenes that are being built there; called as :meth:`look` is.

        Raises
        ------
        OSError
            When they cannot be listed.
        """
        return list_building(self._directory)

    def show_counts(self, registry: CollectorRegistry) -> None:
        """Register the metrics of object storage, where it is one."""

    def interrupt(self) -> None:
        """Make a waiting :meth:`look` fail soon."""

    def close(self) -> None:
        """Close what :meth:`look` opened; may be called again."""


class ObjectRoot(SceneRoot):
    """An address of scenes, or of one scene, in object storage.

    Parameters
    ----------
    url
        For example ``s3://bucket/scenes``.
    storage
        Closed with this.
    """

    def __init__(self, url: str, storage: ObjectStorage) -> None:
        self._url = url
        self._storage = storage
        self.fetch_threads = storage.options.requests
        self.ahead_bytes = storage.options.read_ahead_bytes
        self._files: dict[str, ObjectFiles] = {}
        self._seen: dict[str, Look] = {}
        self._missing: set[str] = set()
        self._has_answered = False

    @property
    def storage(self) -> ObjectStorage:
        """Storage that all scenes share, with its metrics and cache."""
        return self._storage

    def look(self) -> dict[str, Look]:
        """See :class:`SceneRoot`.

        A scene whose files cannot be read keeps its last state. One that is missing counts as
        gone when it is missing twice in a row, since lists can be late. Until the storage has
        answered once, the timeout is short.
        """
        if not self._has_answered:
            self._storage.reach(self._url, REACH_S)
            self._has_answered = True
        urls = self._storage.folders(self._url)
        self._files = {url: self._files[url] for url in urls.values() if url in self._files}
        looks = {}
        for scene_id, url in urls.items():
            try:
                files = self._files.get(url)
                if files is None:
                    files = self._files[url] = self._storage.files(url)
                manifest = files.stamp(_MANIFEST)
                if manifest is not None:
                    looks[scene_id] = Look(files, manifest, files.stamp(_LABELS))
            except OriginError as error:
                log("scene not read", level=logging.ERROR, scene=scene_id, reason=str(error))
                if scene_id in self._seen:
                    looks[scene_id] = self._seen[scene_id]
        missing = {name for name in self._seen if name not in looks} - self._missing
        looks |= {name: self._seen[name] for name in missing}
        self._seen, self._missing = dict(sorted(looks.items())), missing
        return self._seen

    def building(self) -> list[SceneBuilding]:
        """Return nothing: builds write to folders."""
        return []

    def show_counts(self, registry: CollectorRegistry) -> None:
        """Register requests, bytes, retries."""
        ObjectMetrics(self._storage, registry)

    def interrupt(self) -> None:
        """Make a waiting :meth:`look` fail soon."""
        self._storage.interrupt()
        for files in list(self._files.values()):
            files.interrupt()

    def close(self) -> None:
        """Close the storage; the cache on disk stays."""
        self._storage.close()


def root_of(settings: Settings, limits: Limits) -> SceneRoot:
    """Return the folder or the address that the settings name.

    Raises
    ------
    SettingsError
        When the package for object storage is missing, the address is not valid, or the cache
        folder is not writable.
    """
    if settings.scenes_url is None:
        return SceneRoot(settings.scenes_dir)
    try:
        from terraport_store.object_files import ObjectStorage  # needs an extra
        from terraport_store.origin import ObjectOptions, Origin
    except ModuleNotFoundError as missing:
        if missing.name != "obstore":
            raise
        what = "needs the package obstore; install it with: pip install 'terraport[s3]'"
        raise SettingsError("scenes_url", what) from None
    options = ObjectOptions(
        endpoint=settings.object_endpoint,
        cache_dir=settings.object_cache_folder,
        cache_bytes=settings.object_cache_bytes,
        memory_bytes=limits.object_memory_bytes,
        requests=limits.object_requests,
        read_ahead_bytes=limits.object_read_ahead_bytes,
        timeout_s=limits.object_timeout_s,
    )
    try:
        Origin(settings.scenes_url, options)  # sends no request
    except OriginError as error:
        if not error.passing:
            raise SettingsError("scenes_url", str(error)) from None
    try:
        return ObjectRoot(settings.scenes_url, ObjectStorage(options))
    except OSError as error:
        what = f"{error}; expected a folder to write to, or object_cache_bytes = 0 for none"
        raise SettingsError("object_cache_dir", what) from None
