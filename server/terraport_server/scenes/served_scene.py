"""One open version of one scene, with the data that sessions and requests need."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self
from urllib.parse import quote

import xxhash

from terraport_payload.hidden import HiddenFaces
from terraport_payload.texture import gpu_texture_bytes
from terraport_server.descriptors import is_shortage
from terraport_server.fair_queue import PickQueue
from terraport_server.logging import SomePerMinute, log
from terraport_server.scenes.payload_reader import PayloadReader
from terraport_server.session.interface import SceneView, SegmentTable
from terraport_store import (
    RegionNames,
    Scene,
    SceneFiles,
    StoreError,
)
from terraport_store.labels import encode_labels
from terraport_store.layout import ENCODING
from terraport_wire import Hit

__all__ = ["LabelsFile", "ServedScene"]

_FAILURES_PER_MINUTE: Final = 6
"""Log lines about unreadable segments of a scene: for a lost pack they are all the same."""


@dataclass(frozen=True, slots=True)
class LabelsFile:
    """Labels of users by stable id, and the response with them."""

    labels: Mapping[int, str]
    data: bytes
    etag: str
    """Quotes included."""

    @classmethod
    def of(cls, labels: Mapping[int, str]) -> Self:
        """Encode the response. Slow for many labels: call it in a thread."""
        data = encode_labels(labels)
        return cls(labels, data, f'"{xxhash.xxh3_64_hexdigest(data)}"')


_NO_LABELS: Final = LabelsFile.of({})


class ServedScene:
    """One open version of one scene.

    Code that uses it across an ``await`` holds it: :meth:`hold` and :meth:`release`, on the event
    loop's thread. It is closed when it is retired and not held.
    """

    def __init__(
        self,
        scene_id: str,
        location: Path | SceneFiles,
        readers: Executor | None = None,
        *,
        fetch_threads: int = 0,
        ahead_bytes: int = 0,
        pull_base_url: str | None = None,
    ) -> None:
        """Open the published version and build its R-tree. Blocks: call it in a thread.

        Parameters
        ----------
        scene_id
        location
        readers
            Threads that may wait for the disk.
        fetch_threads, ahead_bytes
            See :class:`~terraport_server.scenes.roots.SceneRoot`.
        pull_base_url
            Address under which others serve the scenes' folders; without it packs are fetched from
            this service, where they are files.

        Raises
        ------
        StoreError
            When the scene does not exist or is damaged.
        OSError
            When a file cannot be read.
        """
        scene, names = _open(scene_id, location)
        self.id = scene_id
        self.scene = scene
        # Reads that may wait for a network have threads of this scene alone.
        self.fetchers: Executor | None = None
        """Threads that may wait for object storage; None = the scene is on this machine."""
        self.pickers: PickQueue[Hit | None] | None = None
        """Queue of its picks; None = the service's."""
        if fetch_threads:
            self.fetchers = ThreadPoolExecutor(fetch_threads, thread_name_prefix="fetch")
            self.pickers = PickQueue(1)
        self.payloads = PayloadReader(
            scene,
            readers,
            hold=self.hold,
            release=self.release,
            fetchers=self.fetchers,
            ahead_bytes=ahead_bytes,
        )
        """Reader of its payloads."""
        self.names = names
        """Stable ids and labels; replaced as a whole when labels change, so any thread may read."""
        self.labels_file = _NO_LABELS
        """Response of ``labels.json``, encoded once."""
        self.manifest_json = scene.manifest.model_dump_json().encode()
        self.version = scene.manifest.version
        index = scene.rows
        self.view = SceneView(
            id=scene_id,
            version=self.version,
            name=scene.manifest.name,
            table=SegmentTable(
                bounds=index.bounds,
                lengths=index.length,
                hashes=index.xxh3,
                faces=index.face_count,
                vertices=index.vertex_count,
                texture_bytes=gpu_texture_bytes(index.texture),
                levels=scene.manifest.levels,
            ),
            within=scene.within,
            hidden_faces=HiddenFaces(scene.cover, scene.manifest.counts.segments),
        )
        self.pack_address: str | None = None
        """Address of the pack for clients, absolute or relative to the plan's; None where they
        cannot fetch it: in object storage without a base URL."""
        folder, _, name = self.pack_path.rpartition("/")
        if pull_base_url is not None:
            base = f"{pull_base_url.rstrip('/')}/{quote(scene_id, safe='')}"
            self.pack_address = f"{base}/{folder}/{name}"
        elif not fetch_threads:
            self.pack_address = name
        self.hashes = index.xxh3.data
        """xxh3 of each payload. A memoryview: one item of an array takes four times as long."""
        self._readers = readers
        self._glbs: dict[str, asyncio.Future[bytes]] = {}
        """Base and overview as GLB, by the key of their file, from when they are first asked for."""
        self._failures: dict[str, SomePerMinute] = {}
        """Rate limit of log lines by event."""
        self._holders = 0
        self._retired = False
        self.closed = False

    @property
    def pack_path(self) -> str:
        """Path of the pack within the scene's folder; it contains the version."""
        manifest = self.scene.manifest
        return manifest.files[manifest.encodings[ENCODING].pack].path

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

    async def glb(self, key: str) -> bytes:
        """Return the base or the overview as GLB, made in a thread when it is first asked for.

        Raises
        ------
        PayloadError
            When it is damaged.
        OSError
            When it cannot be read.
        """
        making = self._glbs.get(key)
        if making is None or (making.done() and making.exception() is not None):
            making = self._glbs[key] = asyncio.ensure_future(self._make_glb(key))
        return await asyncio.shield(making)

    async def _make_glb(self, key: str) -> bytes:
        self.hold()
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self._readers, self.scene.file_glb, key)
        finally:
            self.release()

    def tell_failure(
        self,
        event: str,
        segment: int | None,
        error: Exception,
        *,
        landing: str | None = None,
        level: int = logging.ERROR,
    ) -> None:
        """Log an unreadable segment or file, or a failed pick; from any thread.

        A few times a minute; the next line has the number of those left out.
        """
        some = self._failures.setdefault(event, SomePerMinute(_FAILURES_PER_MINUTE))
        left_out = some.left_out(time.monotonic())
        if left_out is not None:
            log(
                event,
                level=level,
                landing=landing,
                scene=self.id,
                version=self.version,
                segment=segment,
                reason=str(error) or repr(error),
                lines_left_out=left_out or None,
            )

    def use_labels(self, kept: LabelsFile) -> None:
        """Replace the labels."""
        self.labels_file = kept
        self.names = self.names.with_labels(kept.labels)

    def hold(self) -> None:
        """Keep the scene open until :meth:`release`."""
        self._holders += 1

    def release(self) -> None:
        """End one :meth:`hold`; the last one closes a retired scene."""
        self._holders -= 1
        self._close_if_idle()

    def retire(self) -> None:
        """Take no new session; close as soon as the scene is not held."""
        self._retired = True
        self._close_if_idle()

    def _close_if_idle(self) -> None:
        if self._retired and self._holders == 0 and not self.closed:
            self.closed = True
            self.scene.close()
            for pool in (self.fetchers, self.pickers):
                if pool is not None:
                    pool.shutdown(wait=False)


def _open(scene_id: str, location: Path | SceneFiles) -> tuple[Scene, RegionNames]:
    """Open a scene with its R-tree; where the regions cannot be read, without their names."""
    scene = Scene.open(location)
    _ = scene.spatial  # built here, while no other thread has the scene
    try:
        names = RegionNames.of(scene.regions)
    except (StoreError, OSError) as error:
        if is_shortage(error):
            scene.close()
            raise
        log("regions not read", level=logging.ERROR, scene=scene_id, reason=str(error))
        names = RegionNames()
    # Facts about regions are for tools, which read the file; here they would take memory.
    scene.__dict__.pop("regions", None)
    return scene, names
