"""The scenes of a folder, or of an address in object storage, kept open and kept current.

A newer version is noticed by looking at ``scene.json`` again and again (its size, time and inode;
its ETag), opened beside the old one, and served to every session from then on. The old one stays
open until the last session that began with it has ended.

Labels of regions (``labels.json``) belong to no version: they are looked at in the same way, and
new ones are used at once, by sessions of every version.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Literal

from terraport_server.actions import SceneView
from terraport_server.errors import UnknownSceneError
from terraport_server.logs import log
from terraport_server.payload_desk import PayloadDesk
from terraport_server.scene_roots import FolderRoot, Look, SceneRoot
from terraport_server.selection import SegmentTable
from terraport_store import (
    OriginError,
    RegionNames,
    Scene,
    SceneBuilding,
    SceneFiles,
    StoreError,
    read_labels,
)

__all__ = ["SceneRegistry", "ServedScene"]


class ServedScene:
    """One version of one scene, open.

    Whoever uses it beyond the current step of the event loop holds it: :meth:`hold` and
    :meth:`release`, on the event loop's thread. It is closed when it is retired and nobody holds
    it.
    """

    def __init__(
        self,
        scene_id: str,
        scene: Scene,
        names: RegionNames,
        readers: Executor | None = None,
        *,
        fetch_threads: int = 0,
        ahead_bytes: int = 0,
    ) -> None:
        self.id = scene_id
        self.scene = scene
        # Threads. Whoever may wait for a network waits in the scene's own.
        self.fetchers: Executor | None = None
        """Threads that may wait for the scene's storage; None = it lies on this machine."""
        self.pickers: Executor | None = None
        """The thread of its picks; None = the service's."""
        if fetch_threads:
            self.fetchers = ThreadPoolExecutor(fetch_threads, thread_name_prefix="fetch")
            self.pickers = ThreadPoolExecutor(1, thread_name_prefix="pick")
        # What sessions ask: payload bytes, names of regions, the tables of the plans.
        self.desk = PayloadDesk(
            scene,
            readers,
            hold=self.hold,
            release=self.release,
            fetchers=self.fetchers,
            ahead_bytes=ahead_bytes,
        )
        """Its payloads, for all clients."""
        self.names = names
        """Stable ids and labels; replaced as a whole when labels change, so any thread may ask."""
        self.version = scene.manifest.version
        index = scene.index
        self.view = SceneView(
            id=scene_id,
            version=self.version,
            name=scene.manifest.name,
            encodings={
                encoding: SegmentTable(
                    bounds=index.bounds,
                    lengths=scene.index_for(encoding).length,
                    hashes=scene.index_for(encoding).xxh3,
                    faces=index.face_count,
                    vertices=index.vertex_count,
                )
                for encoding in scene.manifest.encodings
            },
            within=scene.within,
        )
        # Life: open while anybody holds it, or nothing has replaced it.
        self._holders = 0
        self._retired = False
        self.closed = False

    @classmethod
    def open(
        cls,
        scene_id: str,
        location: Path | SceneFiles,
        source: Literal["file", "mmap"],
        readers: Executor | None = None,
        *,
        fetch_threads: int = 0,
        ahead_bytes: int = 0,
    ) -> ServedScene:
        """Open the published version and build its R-tree. Blocks: call it in a thread.

        ``fetch_threads`` and ``ahead_bytes`` are for scenes behind a network: see
        :class:`~terraport_server.scene_roots.SceneRoot`.

        Raises
        ------
        StoreError
            When the scene is not there or not whole.
        OSError
            When a file cannot be read.
        """
        scene = Scene.open(location, source=source)
        # Built here, once, while no other thread knows the scene; asked on the loop's thread only.
        _ = scene.spatial
        try:
            names = RegionNames.of(scene.regions)
        except (StoreError, OSError) as error:
            # A name never takes the ground away: the scene is served without.
            log("regions not read", level=logging.ERROR, scene=scene_id, reason=str(error))
            names = RegionNames()
        # The facts are for tools, which read the file; here they would only take memory.
        scene.__dict__.pop("regions", None)
        return cls(
            scene_id,
            scene,
            names,
            readers,
            fetch_threads=fetch_threads,
            ahead_bytes=ahead_bytes,
        )

    async def read(self, path: str, limit: int) -> bytes:
        """Read a loose file of the scene in a thread; ``limit`` bytes at most.

        Raises
        ------
        FileNotFoundError
            When there is none.
        StoreError, OSError
            When it cannot be read.
        """
        self.hold()
        try:
            loop = asyncio.get_running_loop()
            data = await loop.run_in_executor(self.fetchers, self.scene.files.read, path, limit)
        finally:
            self.release()
        return data[:limit]

    def hold(self) -> None:
        """Keep the scene open until :meth:`release`."""
        self._holders += 1

    def release(self) -> None:
        """End one :meth:`hold`; the last one closes a scene that was retired."""
        self._holders -= 1
        self._close_if_idle()

    def retire(self) -> None:
        """Serve no new session; close as soon as nobody holds the scene."""
        self._retired = True
        self._close_if_idle()

    def _close_if_idle(self) -> None:
        if self._retired and self._holders == 0 and not self.closed:
            self.closed = True
            self.scene.close()
            for pool in (self.fetchers, self.pickers):
                if pool is not None:
                    pool.shutdown(wait=False)


class SceneRegistry:
    """The scenes of a directory. Lives on one event loop.

    Parameters
    ----------
    root
        Where they lie; a folder of scenes, or one scene, by its path. Closed with this.
    source
        How payloads are read; see ``Scene.open``.
    read_threads
        Threads that read payloads which are not in the page cache.
    published
        Called with the new version, on the event loop, when one replaces an older one.
    """

    def __init__(
        self,
        root: Path | SceneRoot,
        *,
        source: Literal["file", "mmap"] = "file",
        read_threads: int = 4,
        published: Callable[[ServedScene], None] | None = None,
    ) -> None:
        self.root = FolderRoot(root) if isinstance(root, Path) else root
        """Where the scenes lie."""
        self.building: list[SceneBuilding] = []
        """What is being built there, as of the last look."""
        self._source = source
        self._readers = ThreadPoolExecutor(read_threads, thread_name_prefix="read")
        self._published = published
        self._current: dict[str, ServedScene] = {}
        self._retired: list[ServedScene] = []
        self._stamps: dict[str, Hashable] = {}
        self._label_stamps: dict[str, Hashable | None] = {}
        self._labels: dict[str, Mapping[int, str]] = {}

    def ids(self) -> list[str]:
        """Ids of the scenes that are served, ascending."""
        return sorted(self._current)

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

    async def refresh(self) -> None:
        """Look at the root once; open what is new, retire what was replaced or is gone.

        A scene that cannot be opened is logged once per change, and what was served before stays;
        one whose storage does not answer is tried again with every look.

        Raises
        ------
        StoreError, OSError
            When the scenes cannot be listed; everything stays as it is.
        """
        looks = await asyncio.to_thread(self.root.look)
        for scene_id, seen in looks.items():
            await self._refresh_labels(scene_id, seen)
            if self._stamps.get(scene_id) == seen.manifest:
                continue
            self._stamps[scene_id] = seen.manifest
            try:
                served = await asyncio.to_thread(
                    ServedScene.open,
                    scene_id,
                    seen.files,
                    self._source,
                    self._readers,
                    fetch_threads=self.root.fetch_threads,
                    ahead_bytes=self.root.ahead_bytes,
                )
            except (StoreError, OSError) as error:
                if isinstance(error, OriginError):
                    del self._stamps[scene_id]
                log("scene not opened", level=logging.ERROR, scene=scene_id, reason=str(error))
                continue
            served.names = served.names.with_labels(self._labels.get(scene_id, {}))
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
        """Refresh again and again until cancelled."""
        while True:
            await asyncio.sleep(period_s)
            try:
                await self.refresh()
            except (StoreError, OSError) as error:
                log("scenes not listed", level=logging.ERROR, reason=str(error))

    def close(self) -> None:
        """Close every scene that nobody holds; the others follow when they are released."""
        self.root.interrupt()
        for served in [*self._current.values(), *self._retired]:
            if not served.closed:
                served.scene.interrupt()
            served.retire()
        self._current.clear()
        self._retired.clear()
        self.root.close()
        self._readers.shutdown(wait=False)  # what it still reads holds its scene

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
        """Read labels that have changed and hand them to every version that is open."""
        if self._label_stamps.get(scene_id) == seen.labels:
            return
        self._label_stamps[scene_id] = seen.labels
        try:
            labels = await asyncio.to_thread(read_labels, seen.files)
        except (StoreError, OSError) as error:
            # Once per change; the labels read before stay.
            if isinstance(error, OriginError):
                del self._label_stamps[scene_id]
            log("labels not read", level=logging.ERROR, scene=scene_id, reason=str(error))
            return
        self._labels[scene_id] = labels
        log("labels read", scene=scene_id, labels=len(labels))
        for served in [*self._current.values(), *self._retired]:
            if served.id == scene_id:
                served.names = served.names.with_labels(labels)
