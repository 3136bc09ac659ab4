"""One version of one scene, open, with all that sessions and requests ask of it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Self
from urllib.parse import quote

import xxhash

from terraport_payload.texture import gpu_texture_bytes
from terraport_server.session.interface import PullView, SceneView
from terraport_server.descriptors import is_shortage
from terraport_server.logging import SomePerMinute, log
from terraport_server.scenes.payload_reader import PayloadDesk
from terraport_server.scenes.pick_queue import PickLine
from terraport_server.session.interface import SegmentTable
from terraport_store import (
    RegionNames,
    Scene,
    SceneFiles,
    StoreError,
)
from terraport_store.labels import encode_labels
from terraport_wire import BLOCK_BYTES, Hit, PullInfo

__all__ = ["LabelsFile", "ServedScene"]

_FAILURES_PER_MINUTE: Final = 6
"""Lines about segments of a scene that cannot be read: of a pack that is gone they are all the
same, and each landing meets some of them."""


_SETTLED_S: Final = 1.0

_Said = tuple[dict[str, str], bytes]
"""Links, and the line in the list of all."""


@dataclass(frozen=True, slots=True)
class LabelsFile:
    """Labels of users by stable id, and the answer to who asks for them."""

    labels: Mapping[int, str]
    data: bytes
    etag: str
    """Quotes included."""

    @classmethod
    def of(cls, labels: Mapping[int, str]) -> Self:
        """Write the answer; of as many as there may be it takes long: call it in a thread."""
        data = encode_labels(labels)
        return cls(labels, data, f'"{xxhash.xxh3_64_hexdigest(data)}"')


_NO_LABELS: Final = LabelsFile.of({})


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
        pull_base: str | None = None,
    ) -> None:
        self.id = scene_id
        self.scene = scene
        # Threads. Whoever may wait for a network waits in the scene's own.
        self.fetchers: Executor | None = None
        """Threads that may wait for the scene's storage; None = it lies on this machine."""
        self.pickers: PickLine[Hit | None] | None = None
        """The line of its picks; None = the service's."""
        if fetch_threads:
            self.fetchers = ThreadPoolExecutor(fetch_threads, thread_name_prefix="fetch")
            self.pickers = PickLine(1)
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
        self.labels_file = _NO_LABELS
        """What ``labels.json`` answers: written once for all who ask."""
        self._said: tuple[int, _Said] | None = None
        """What was last found to say of it, and the stamp of its folder then."""
        self._seen_since = (-1, 0.0)
        """Stamp of the scene's folder, and when by the monotonic clock it was first seen."""
        self.manifest_json = scene.manifest.model_dump_json().encode()
        self.version = scene.manifest.version
        index = scene.rows
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
                    texture_bytes=gpu_texture_bytes(index.texture),
                    levels=scene.manifest.levels,
                )
                for encoding in scene.manifest.encodings
            },
            within=scene.within,
            pull=None if pull_base is None else _pull_view(scene, pull_base),
        )
        # As memory, not arrays: one item of an array takes four times as long.
        self.hashes = index.xxh3.data
        """xxh3 of each GLB."""
        self.lengths = index.length.data
        """Bytes of each GLB."""
        self._failures: dict[str, SomePerMinute] = {}
        """By event."""
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
        pull_base_url: str | None = None,
    ) -> ServedScene:
        """Open the published version and build its R-tree. Blocks: call it in a thread.

        ``fetch_threads`` and ``ahead_bytes`` are for scenes behind a network: see
        :class:`~terraport_server.scenes.roots.SceneRoot`. ``pull_base_url`` is where others serve
        the scenes' folders; without it packs are fetched from this service, where they are files.

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
            if is_shortage(error):
                scene.close()
                raise
            # A name never takes the ground away: the scene is served without.
            log("regions not read", level=logging.ERROR, scene=scene_id, reason=str(error))
            names = RegionNames()
        # The facts are for tools, which read the file; here they would only take memory.
        scene.__dict__.pop("regions", None)
        pull_base = None
        if pull_base_url is not None:
            pull_base = f"{pull_base_url.rstrip('/')}/{quote(scene_id, safe='')}/"
        elif not fetch_threads and source == "file":
            pull_base = f"scenes/{quote(scene_id, safe='')}/"
        return cls(
            scene_id,
            scene,
            names,
            readers,
            fetch_threads=fetch_threads,
            ahead_bytes=ahead_bytes,
            pull_base=pull_base,
        )

    @property
    def pack_path(self) -> str:
        """Path of the GLB pack within the scene's folder: it names the version."""
        manifest = self.scene.manifest
        return manifest.files[manifest.encodings["glb"].pack].path

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

    def tell_failure(
        self,
        event: str,
        segment: int | None,
        error: Exception,
        *,
        landing: str | None = None,
        level: int = logging.ERROR,
    ) -> None:
        """Log that a segment, or a file, could not be read, or a pick answered; from any thread.

        A few times a minute, and then how many more there were.
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

    def while_folder_rests(self, find: Callable[[], _Said]) -> _Said:
        """Return what *find* finds; what it found before where nothing came to the folder or went.

        A scene in object storage has none that could be looked at.
        """
        stamp = 0
        if self.fetchers is None:
            with contextlib.suppress(OSError):
                stamp = self.scene.path.stat().st_mtime_ns
        if self._said is not None and self._said[0] == stamp:
            return self._said[1]
        said = find()
        # What changed a moment ago may change again within what the files' clock tells apart.
        now_s = time.monotonic()
        if self._seen_since[0] != stamp:
            self._seen_since = stamp, now_s
        elif now_s - self._seen_since[1] > _SETTLED_S:
            self._said = stamp, said
        return said

    def use_labels(self, kept: LabelsFile) -> None:
        """Take these labels in place of those before."""
        self.labels_file = kept
        self.names = self.names.with_labels(kept.labels)

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


def _pull_view(scene: Scene, base: str) -> PullView | None:
    """Return where clients fetch a scene's payloads; None where the wire has no number for it."""
    manifest = scene.manifest
    pack = manifest.files[manifest.encodings["glb"].pack]
    offsets = scene.rows.offset
    if int(offsets[-1]) // BLOCK_BYTES >= 1 << 32 or (offsets % BLOCK_BYTES).any():
        return None
    info = PullInfo(base=base, pack=pack.path, pack_bytes=pack.bytes)
    return PullView(info=info, offsets=offsets)
