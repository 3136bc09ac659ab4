"""Registry of the open scenes of a folder, or of an address in object storage.

``scene.json`` is polled (its size, time and inode; its ETag). A newer version is opened, and every
new session uses it. The old one stays open until its last session has ended.

Labels of regions (``labels.json``) belong to no version: they are polled in the same way, and
sessions of every version use new ones immediately.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import thread_time
from typing import Final, TypeVar

from terraport_server.descriptors import is_shortage, most_packs
from terraport_server.errors import UnknownSceneError
from terraport_server.logging import LOGGER, log
from terraport_server.scenes.roots import Look, SceneRoot
from terraport_server.scenes.served_scene import LabelsFile, ServedScene
from terraport_store import (
    OriginError,
    SceneBuilding,
    StoreError,
    read_labels,
)

__all__ = ["SceneRegistry"]

_LOOK_SHARE: Final = 0.05
"""Maximum share of a core for polling: its thread takes the interpreter from the event loop."""

_READ_THREADS: Final = 4
"""Threads that read payloads which are not in the page cache, for all scenes."""

T = TypeVar("T")


class SceneRegistry:
    """Open scenes by id. Used on one event loop.

    Parameters
    ----------
    root
        Location of the scenes; a folder of scenes, or one scene, by its path. Closed with this.
    published
        Called with the new version, on the event loop, when one replaces an older one.
    pull_base_url
        See :class:`ServedScene`.
    """

    def __init__(
        self,
        root: Path | SceneRoot,
        *,
        published: Callable[[ServedScene], None] | None = None,
        pull_base_url: str | None = None,
    ) -> None:
        self.root = SceneRoot(root) if isinstance(root, Path) else root
        """Location of the scenes."""
        self.building: list[SceneBuilding] = []
        """Scenes being built, as of the last poll."""
        self._readers = ThreadPoolExecutor(_READ_THREADS, thread_name_prefix="read")
        self._published = published
        self._pull_base_url = pull_base_url
        self._current: dict[str, ServedScene] = {}
        self._retired: list[ServedScene] = []
        self._stamps: dict[str, Hashable] = {}
        self._label_stamps: dict[str, Hashable | None] = {}
        self._labels: dict[str, LabelsFile] = {}
        self._look_cpu_s = 0.0
        """CPU time of the last poll."""

    def ids(self) -> list[str]:
        """Ids of the scenes that are served, ascending."""
        return sorted(self._current)

    @property
    def is_empty(self) -> bool:
        """Whether no scene is served."""
        return not self._current

    def get(self, scene_id: str, version: str | None = None) -> ServedScene:
        """Return a scene, newest version first.

        Raises
        ------
        UnknownSceneError
            When there is none of that id, or that version of it is not open any more.
        """
        served = self._current.get(scene_id)
        if served is None:
            raise UnknownSceneError(scene_id)
        if version is None or served.version == version:
            return served
        for old in self._retired:
            if old.id == scene_id and old.version == version and not old.closed:
                return old
        raise UnknownSceneError(scene_id, version)

    def find_pack(self, scene_id: str, path: str) -> ServedScene:
        """Return the open version whose pack has a path in the scene's folder.

        Raises
        ------
        UnknownSceneError
            When there is none.
        """
        newest = self.get(scene_id)
        for served in (newest, *self._retired):
            if served.id == scene_id and not served.closed and served.pack_path == path:
                return served
        raise UnknownSceneError(scene_id)

    async def refresh(self) -> None:
        """Scan the root once; open new scenes, retire replaced and removed ones.

        A scene that cannot be opened is logged once per change, and its previous version stays
        open; where the storage does not answer or no file descriptor is free, the next scan tries
        again.

        Raises
        ------
        StoreError, OSError
            When the scenes cannot be listed; the open scenes are unchanged.
        """
        looks, self._look_cpu_s = await asyncio.to_thread(_timed, self.root.look)
        for scene_id, seen in looks.items():
            await self._refresh_labels(scene_id, seen)
            if self._stamps.get(scene_id) == seen.manifest:
                continue
            self._stamps[scene_id] = seen.manifest
            full = self._is_full()
            if full is not None:
                log("scene not opened", level=logging.ERROR, scene=scene_id, reason=full)
                continue
            try:
                served = await asyncio.to_thread(
                    ServedScene,
                    scene_id,
                    seen.files,
                    self._readers,
                    fetch_threads=self.root.fetch_threads,
                    ahead_bytes=self.root.ahead_bytes,
                    pull_base_url=self._pull_base_url,
                )
            except (StoreError, OSError) as error:
                if _is_temporary(error):
                    del self._stamps[scene_id]
                log("scene not opened", level=logging.ERROR, scene=scene_id, reason=str(error))
                continue
            labels = self._labels.get(scene_id)
            if labels is not None:
                served.use_labels(labels)
            self._take(served)
        for scene_id in (self._stamps.keys() | self._current.keys()) - looks.keys():
            self._stamps.pop(scene_id, None)
            self._label_stamps.pop(scene_id, None)
            self._labels.pop(scene_id, None)
            gone = self._current.pop(scene_id, None)
            if gone is not None:
                self._retire(gone)
                log("scene gone", scene=scene_id, version=gone.version)
        self._retired = [served for served in self._retired if not served.closed]
        self.building = await asyncio.to_thread(self.root.building)

    async def watch(self, period_s: float) -> None:
        """Refresh periodically until cancelled; less often where that takes long."""
        while True:
            await asyncio.sleep(max(period_s, self._look_cpu_s / _LOOK_SHARE))
            try:
                await self.refresh()
            except (StoreError, OSError) as error:
                log("scenes not listed", level=logging.ERROR, reason=str(error))
            except Exception:  # noqa: BLE001 - the watch must not end while the service runs
                LOGGER.exception("scenes not refreshed")

    def close(self) -> None:
        """Close every scene that is not held; the others close when they are released."""
        self.root.interrupt()
        for served in [*self._current.values(), *self._retired]:
            if not served.closed:
                served.scene.interrupt()
            served.retire()
        self._current.clear()
        self._retired.clear()
        self.root.close()
        self._readers.shutdown(wait=False)  # a running read holds its scene

    def _is_full(self) -> str | None:
        """Return why no other scene can be opened, or None: connections need descriptors too."""
        most = most_packs()
        if self.root.fetch_threads or most is None:  # packs in object storage are no open files
            return None
        scenes = [*self._current.values(), *self._retired]
        count = sum(len(served.scene.manifest.encodings) for served in scenes if not served.closed)
        if count < most:
            return None
        return (
            f"{count} packs are open, expected fewer than {most}, half of the files that this "
            "process may open; raise that limit and start again"
        )

    def _take(self, served: ServedScene) -> None:
        old = self._current.get(served.id)
        if old is not None and old.version == served.version:
            served.retire()  # the manifest was touched, not changed
            return
        self._current[served.id] = served
        log(
            "scene opened",
            scene=served.id,
            version=served.version,
            segments=len(served.scene.index),
        )
        if old is not None:
            self._retire(old)
            if self._published is not None:
                self._published(served)

    def _retire(self, served: ServedScene) -> None:
        self._retired.append(served)
        served.retire()

    async def _refresh_labels(self, scene_id: str, seen: Look) -> None:
        """Read labels that have changed and give them to every open version."""
        if self._label_stamps.get(scene_id) == seen.labels:
            return
        self._label_stamps[scene_id] = seen.labels
        try:
            kept = await asyncio.to_thread(lambda: LabelsFile.of(read_labels(seen.files)))
        except (StoreError, OSError) as error:
            # Logged once per change; the last valid labels stay.
            if _is_temporary(error):
                del self._label_stamps[scene_id]
            log("labels not read", level=logging.ERROR, scene=scene_id, reason=str(error))
            return
        self._labels[scene_id] = kept
        log("labels read", scene=scene_id, labels=len(kept.labels))
        for served in [*self._current.values(), *self._retired]:
            if served.id == scene_id:
                served.use_labels(kept)


def _is_temporary(error: Exception) -> bool:
    """Return whether an error is temporary, so that the next scan may read the file."""
    return isinstance(error, OriginError) or is_shortage(error)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return what *work* returns and the CPU seconds that its thread took for it."""
    began_s = thread_time()
    return work(), thread_time() - began_s
