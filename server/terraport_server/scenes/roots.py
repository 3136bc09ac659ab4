"""Where the scenes that are served lie: a folder, or an address in object storage."""

from __future__ import annotations

import logging
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from prometheus_client import CollectorRegistry

from terraport_server.errors import SettingsError
from terraport_server.logging import log
from terraport_server.object_metrics import ObjectMetrics
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

__all__ = ["FolderRoot", "Look", "ObjectRoot", "SceneRoot", "root_of"]

_MANIFEST: Final = "scene.json"
_LABELS: Final = "labels.json"


@dataclass(frozen=True, slots=True)
class Look:
    """What is seen of a scene without opening anything."""

    files: SceneFiles
    manifest: Hashable
    """Another one when scene.json was replaced."""
    labels: Hashable | None
    """None where nobody has set any."""


class SceneRoot(Protocol):
    """A folder or an address with scenes. :meth:`look` is called in a thread, by one at a time."""

    @property
    def fetch_threads(self) -> int:
        """Threads of each scene that may wait for a network; 0 = there is none to wait for."""
        ...

    @property
    def ahead_bytes(self) -> int:
        """Payload bytes fetched ahead for each landing; 0 = nothing is."""
        ...

    def look(self) -> dict[str, Look]:
        """Look at every scene; by id, ascending.

        Raises
        ------
        StoreError, OSError
            When the scenes cannot be listed.
        """
        ...

    def building(self) -> list[SceneBuilding]:
        """List the scenes that are being built there just now; called as :meth:`look` is.

        Raises
        ------
        OSError
            When they cannot be listed.
        """
        ...

    def show_counts(self, registry: CollectorRegistry) -> None:
        """Register the counters of object storage, where it is one."""
        ...

    def interrupt(self) -> None:
        """Let a look that waits fail soon."""
        ...

    def close(self) -> None:
        """Close what is open for looking; may be called again."""
        ...


class FolderRoot:
    """A folder of scenes, or one scene."""

    fetch_threads = 0
    ahead_bytes = 0

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def look(self) -> dict[str, Look]:
        """Look at every scene; see :class:`SceneRoot`."""
        looks = {}
        for scene_id, directory in list_scenes(self._directory).items():
            files = FolderFiles(directory)
            manifest = files.stamp(_MANIFEST)
            if manifest is not None:  # else gone since it was listed
                looks[scene_id] = Look(files, manifest, files.stamp(_LABELS))
        return looks

    def building(self) -> list[SceneBuilding]:
        """List what is being built there; see :class:`SceneRoot`."""
        return list_building(self._directory)

    def show_counts(self, registry: CollectorRegistry) -> None:
        """Register nothing: a folder counts nothing."""

    def interrupt(self) -> None:
        """Do nothing: a look at a folder waits for no network."""

    def close(self) -> None:
        """Do nothing: between two looks nothing is open."""


class ObjectRoot:
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
        self._files: dict[str, ObjectFiles] = {}
        self._seen: dict[str, Look] = {}
        self._doubted: set[str] = set()
        self._has_answered = False

    @property
    def fetch_threads(self) -> int:
        """As many threads as requests may be under way at once."""
        return self._storage.options.requests

    @property
    def ahead_bytes(self) -> int:
        """Bytes, ``object_read_ahead_bytes``."""
        return self._storage.options.read_ahead_bytes

    @property
    def storage(self) -> ObjectStorage:
        """What all its scenes share: counts, cache."""
        return self._storage

    def look(self) -> dict[str, Look]:
        """Look at every scene; see :class:`SceneRoot`.

        One that cannot be looked at is as it was before. One that is not there counts as gone when
        it is not there twice in a row: the root may be vanishing as a whole, or its lists be late.
        Until the storage has answered once, it is asked with little patience.
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
                log("scene not looked at", level=logging.ERROR, scene=scene_id, reason=str(error))
                if scene_id in self._seen:
                    looks[scene_id] = self._seen[scene_id]
        doubted = {name for name in self._seen if name not in looks} - self._doubted
        looks |= {name: self._seen[name] for name in doubted}
        self._seen, self._doubted = dict(sorted(looks.items())), doubted
        return self._seen

    def building(self) -> list[SceneBuilding]:
        """List nothing: builds write to folders."""
        return []

    def show_counts(self, registry: CollectorRegistry) -> None:
        """Add requests, bytes, retries and the like."""
        ObjectMetrics(self._storage, registry)

    def interrupt(self) -> None:
        """Let a look that waits fail soon."""
        self._storage.interrupt()
        for files in list(self._files.values()):
            files.interrupt()

    def close(self) -> None:
        """Close the storage; the cache on disk stays."""
        self._storage.close()


def root_of(settings: Settings) -> SceneRoot:
    """Return the folder or the address that the settings name.

    Raises
    ------
    SettingsError
        When the package for object storage is missing, the address can never be used, or the
        cache's folder cannot be written to.
    """
    if settings.scenes_url is None:
        return FolderRoot(settings.scenes_dir)
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
        region=settings.object_region,
        cache_dir=settings.object_cache_folder,
        cache_bytes=settings.object_cache_bytes,
        memory_bytes=settings.object_memory_bytes,
        requests=settings.object_requests,
        read_ahead_bytes=settings.object_read_ahead_bytes,
        timeout_s=settings.object_timeout_s,
    )
    try:
        Origin(settings.scenes_url, options)  # asks for nothing
    except OriginError as error:
        if not error.passing:
            raise SettingsError("scenes_url", str(error)) from None
    try:
        return ObjectRoot(settings.scenes_url, ObjectStorage(options))
    except OSError as error:
        what = f"{error}; expected a folder to write to, or object_cache_bytes = 0 for none"
        raise SettingsError("object_cache_dir", what) from None
