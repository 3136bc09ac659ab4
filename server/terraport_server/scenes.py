"""The scenes of a directory, kept open and kept current.

A newer version is noticed by looking at ``scene.json`` again and again (its size, time and inode),
opened beside the old one, and served to every session from then on. The old one stays open until
the last session that began with it has ended.

Labels of regions (``labels.json``) belong to no version: they are looked at in the same way, and
new ones are used at once, by sessions of every version.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from terraport_server.actions import SceneView
from terraport_server.errors import UnknownSceneError
from terraport_server.logs import log
from terraport_server.payload_desk import PayloadDesk
from terraport_server.selection import SegmentTable
from terraport_store import RegionNames, Scene, StoreError, list_scenes, read_labels

__all__ = ["SceneRegistry", "ServedScene"]

_MANIFEST: Final = "scene.json"
_LABELS: Final = "labels.json"

_Stamp = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class _Look:
    """What is seen of a scene directory without opening anything."""

    directory: Path
    manifest: _Stamp
    labels: _Stamp | None
    """None where nobody has set any."""


class ServedScene:
    """One version of one scene, open.

    Whoever uses it beyond the current step of the event loop holds it: :meth:`hold` and
    :meth:`release`, on the event loop's thread. It is closed when it is retired and nobody holds
    it.
    """

    def __init__(
        self, scene_id: str, scene: Scene, names: RegionNames, readers: Executor | None = None
    ) -> None:
        self.id = scene_id
        self.scene = scene
        self.desk = PayloadDesk(scene, readers, hold=self.hold, release=self.release)
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
        self._holders = 0
        self._retired = False
        self.closed = False

    @classmethod
    def open(
        cls,
        scene_id: str,
        directory: Path,
        source: Literal["file", "mmap"],
        readers: Executor | None = None,
    ) -> ServedScene:
        """Open the published version and build its R-tree. Blocks: call it in a thread.

        Raises
        ------
        StoreError
            When the scene is not there or not whole.
        OSError
            When a file cannot be read.
        """
        scene = Scene.open(directory, source=source)
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
        return cls(scene_id, scene, names, readers)

    def hold(self) -> None:
        """Keep it open."""
        self._holders += 1

    def release(self) -> None:
        """Give up one hold."""
        self._holders -= 1
        self._close_if_idle()

    def retire(self) -> None:
        """Close it as soon as nobody holds it."""
        self._retired = True
        self._close_if_idle()

    def _close_if_idle(self) -> None:
        if self._retired and self._holders == 0 and not self.closed:
            self.closed = True
            self.scene.close()


class SceneRegistry:
    """The scenes of a directory. Lives on one event loop.

    Parameters
    ----------
    directory
        A folder of scenes, or one scene.
    source
        How payloads are read; see ``Scene.open``.
    read_threads
        Threads that read payloads which are not in the page cache.
    published
        Called with the new version, on the event loop, when one replaces an older one.
    """

    def __init__(
        self,
        directory: Path,
        *,
        source: Literal["file", "mmap"] = "file",
        read_threads: int = 4,
        published: Callable[[ServedScene], None] | None = None,
    ) -> None:
        self._directory = directory
        self._source = source
        self._readers = ThreadPoolExecutor(read_threads, thread_name_prefix="read")
        self._published = published
        self._current: dict[str, ServedScene] = {}
        self._retired: list[ServedScene] = []
        self._stamps: dict[str, _Stamp] = {}
        self._label_stamps: dict[str, _Stamp | None] = {}
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
        """Look at the directory once; open what is new, retire what was replaced or is gone.

        A scene that cannot be opened is logged once per change, and what was served before stays.
        """
        found = await asyncio.to_thread(self._look)
        for scene_id, seen in found.items():
            await self._refresh_labels(scene_id, seen)
            if self._stamps.get(scene_id) == seen.manifest:
                continue
            self._stamps[scene_id] = seen.manifest
            try:
                served = await asyncio.to_thread(
                    ServedScene.open, scene_id, seen.directory, self._source, self._readers
                )
            except (StoreError, OSError) as error:
                log("scene not opened", level=logging.ERROR, scene=scene_id, reason=str(error))
                continue
            served.names = served.names.with_labels(self._labels.get(scene_id, {}))
            self._take(served)
        for scene_id in self._stamps.keys() - found.keys():
            del self._stamps[scene_id]
            self._label_stamps.pop(scene_id, None)
            self._labels.pop(scene_id, None)
            gone = self._current.pop(scene_id, None)
            if gone is not None:
                self._retire(gone)
                log("scene gone", scene=scene_id, version=gone.version)
        self._retired = [served for served in self._retired if not served.closed]

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
        for served in [*self._current.values(), *self._retired]:
            served.retire()
        self._current.clear()
        self._retired.clear()
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

    async def _refresh_labels(self, scene_id: str, seen: _Look) -> None:
        """Read labels that have changed and hand them to every version that is open."""
        if self._label_stamps.get(scene_id) == seen.labels:
            return
        self._label_stamps[scene_id] = seen.labels
        try:
            labels = await asyncio.to_thread(read_labels, seen.directory)
        except (StoreError, OSError) as error:
            # Once per change; the labels read before stay.
            log("labels not read", level=logging.ERROR, scene=scene_id, reason=str(error))
            return
        self._labels[scene_id] = labels
        log("labels read", scene=scene_id, labels=len(labels))
        for served in [*self._current.values(), *self._retired]:
            if served.id == scene_id:
                served.names = served.names.with_labels(labels)

    def _look(self) -> dict[str, _Look]:
        found = {}
        for scene_id, directory in list_scenes(self._directory).items():
            manifest = _stamp(directory / _MANIFEST)
            if manifest is not None:  # else gone since it was listed
                found[scene_id] = _Look(directory, manifest, _stamp(directory / _LABELS))
        return found


def _stamp(path: Path) -> _Stamp | None:
    """Time, size and inode of a file; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return (status.st_mtime_ns, status.st_size, status.st_ino)
