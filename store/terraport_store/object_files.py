"""Scenes in object storage: the files of each, and what all of them share.

::

    with ObjectStorage(ObjectOptions(cache_dir=folder)) as storage:
        for name, url in storage.folders("s3://bucket/scenes").items():
            with Scene.open(storage.files(url)) as scene: ...

A scene is opened and read like one in a folder. Its small files are fetched whole, compared with
the manifest's hashes, and kept in the cache; base, cover and regions lie in a local folder of their
own while the version is open. The pack is read in ranges (:mod:`terraport_store.remote_source`).
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Hashable, Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import xxhash

from terraport_store.byte_cache import ByteCache, CacheKey
from terraport_store.errors import DamagedSceneError
from terraport_store.files import LocalCopy
from terraport_store.index import SegmentIndex
from terraport_store.layout import BASE, COVER, MANIFEST_NAME, OVERVIEW, REGIONS
from terraport_store.manifest import FileInfo, Manifest
from terraport_store.origin import ObjectCounts, ObjectOptions, Origin
from terraport_store.remote_source import RemoteSource
from terraport_store.shelf import Shelf

__all__ = ["ObjectFiles", "ObjectStorage"]

MAX_SCENES: Final = 1000
"""Scenes of one address that are looked at, lowest names first."""

_CHUNK_BYTES: Final = 8 << 20
"""Files are fetched in chunks of this size: a cut connection costs one chunk."""


class ObjectStorage:
    """What all scenes of a process share: cache, memory, counts. A context manager; any thread.

    Parameters
    ----------
    options : ObjectOptions, optional
    make_origin : callable, optional
        Makes an origin from an address; for stores that have none.

    Raises
    ------
    OSError
        When the cache's folder cannot be made or written to.
    """

    def __init__(
        self,
        options: ObjectOptions | None = None,
        *,
        make_origin: Callable[[str], Origin] | None = None,
    ) -> None:
        self.options = options or ObjectOptions()
        self.counts = ObjectCounts()
        self.shelf = Shelf(self.options.memory_bytes)
        self._make_origin = make_origin or self._origin
        self._listed: dict[str, Origin] = {}
        self._reaching: Origin | None = None
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self.cache: ByteCache | None = None
        folder = self.options.cache_dir
        if folder is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="terraport-")
            folder = Path(self._temporary.name)
        else:
            self.cache = ByteCache(folder, self.options.cache_bytes)
        self._open_dir = folder / "open"
        self._open_dir.mkdir(mode=0o700, exist_ok=True)
        _sweep_copies(self._open_dir)

    def files(self, url: str, *, owned: bool = False) -> ObjectFiles:
        """Return the files of the scene at an address.

        Parameters
        ----------
        url : str
        owned : bool, optional
            Whether closing them closes this too.

        Raises
        ------
        OriginError
            When the address cannot be used.
        """
        return ObjectFiles(self._make_origin(url), self, owned=owned)

    def folders(self, url: str) -> dict[str, str]:
        """Find what may be scenes at an address.

        Parameters
        ----------
        url : str
            Of one scene, or of a folder of scenes.

        Returns
        -------
        dict of str to str
            Address of each by its id (the folder's name), ascending; the first 1000. Whether there
            is a manifest is not looked at.

        Raises
        ------
        OriginError
            When the address cannot be listed.
        """
        url = url.rstrip("/")
        origin = self._listed.get(url)
        if origin is None:
            origin = self._listed[url] = self._make_origin(url)
        if origin.head(MANIFEST_NAME) is not None:
            return {url.rpartition("/")[2]: url}
        names = [name for name in origin.folders() if not name.startswith((".", "v-"))]
        return {name: f"{url}/{name}" for name in names[:MAX_SCENES]}

    def reach(self, url: str, patience_s: float) -> None:
        """Ask an address for a manifest, there or not, with less patience than a landing has.

        Raises
        ------
        OriginError
            Nothing answers within twice `patience_s`, or it refuses.
        """
        patience_s = min(patience_s, self.options.timeout_s)
        origin = Origin(url, replace(self.options, timeout_s=patience_s), self.counts)
        self._reaching = origin
        origin.head(MANIFEST_NAME)

    def interrupt(self) -> None:
        """Let looks that wait fail soon; files and sources have their own."""
        for origin in [*self._listed.values(), self._reaching]:
            if origin is not None:
                origin.interrupt()

    def close(self) -> None:
        """Free what is in memory; the cache on disk stays. May be called again."""
        self.shelf.clear()
        if self._temporary is not None:
            self._temporary.cleanup()

    def new_copy(self) -> LocalCopy:
        """Make a folder for one open version; it goes when it is closed, or this process dies."""
        folder = self._open_dir / f"{os.getpid()}-{secrets.token_hex(4)}"
        folder.mkdir(mode=0o700)
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        fcntl.flock(lock, fcntl.LOCK_SH)
        held = [lock]

        def close() -> None:
            if held:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(held.pop())

        return LocalCopy(folder, close)

    def _origin(self, url: str) -> Origin:
        return Origin(url, self.options, self.counts)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class ObjectFiles:
    """The files of one scene in object storage; see :class:`~terraport_store.files.SceneFiles`.

    Made by :meth:`ObjectStorage.files`.
    """

    def __init__(self, origin: Origin, storage: ObjectStorage, *, owned: bool = False) -> None:
        self.origin = origin
        self._storage = storage
        self._owned = owned
        # The endpoint too: two services may have buckets of one name.
        endpoint = origin.options.endpoint or os.environ.get("AWS_ENDPOINT_URL", "")
        text = f"{endpoint} {origin.url}".encode()
        self._scope = hashlib.blake2b(text, digest_size=8).hexdigest()

    @property
    def location(self) -> str:
        """Address of the scene."""
        return self.origin.url

    def read(self, path: str, limit: int) -> bytes:
        """Read a whole object; see :class:`SceneFiles`."""
        return self.origin.get(path, limit)

    def fetch(self, file: FileInfo) -> bytes:
        """Read a file of a version through the cache; see :class:`SceneFiles`."""
        key = CacheKey(self._scope, int(file.xxh3, 16), file.bytes)
        cache = self._storage.cache
        kept = None if cache is None else cache.open(key)
        if kept is not None:
            return kept.read()
        data = b"".join(self._chunks(file))
        if cache is not None and xxhash.xxh3_64_hexdigest(data) == file.xxh3:
            with contextlib.suppress(OSError):
                cache.put(key, data)
        return data

    def size(self, path: str) -> int:
        """Bytes of an object; see :class:`SceneFiles`."""
        seen = self.origin.head(path)
        if seen is None:
            raise FileNotFoundError(2, "no such object", path)
        return seen.size

    def blocks(self, file: FileInfo) -> Iterator[bytes]:
        """Read an object from end to end; see :class:`SceneFiles`."""
        return self._chunks(file)

    def stamp(self, path: str) -> Hashable | None:
        """Return its ETag, or time and size; see :class:`SceneFiles`."""
        seen = self.origin.head(path)
        return None if seen is None else seen.stamp

    def open_pack(
        self,
        file: FileInfo,
        index: SegmentIndex,
    ) -> RemoteSource:
        """Read a pack by ranges; see :class:`SceneFiles`."""
        return RemoteSource(
            self.origin.twin(),
            file.path,
            file.bytes,
            index,
            shelf=self._storage.shelf,
            cache=self._storage.cache,
            scope=self._scope,
        )

    def local_copy(self, manifest: Manifest) -> LocalCopy:
        """Fetch base, overview, cover and regions of a version into a folder of their own."""
        copy = self._storage.new_copy()
        try:
            for key in {BASE, OVERVIEW, COVER, REGIONS} & set(manifest.files):
                file = manifest.files[key]
                target = copy.path / file.path
                target.parent.mkdir(exist_ok=True)
                target.write_bytes(_checked(file, self.fetch(file)))
        except BaseException:
            copy.close()
            raise
        return copy

    def interrupt(self) -> None:
        """Let what waits fail soon."""
        self.origin.interrupt()

    def close(self) -> None:
        """Close the storage where it is ours alone; may be called again."""
        if self._owned:
            self._storage.close()

    def _chunks(self, file: FileInfo) -> Iterator[bytes]:
        """All of a file, checked for its size before anything is fetched."""
        size = self.size(file.path)
        if size != file.bytes:
            what = f"{size} bytes, expected {file.bytes} by scene.json"
            raise DamagedSceneError(file.path, what)
        for offset in range(0, size, _CHUNK_BYTES):
            yield self.origin.range(file.path, offset, min(_CHUNK_BYTES, size - offset))


def _checked(file: FileInfo, data: bytes) -> bytes:
    digest = xxhash.xxh3_64_hexdigest(data)
    if digest != file.xxh3:
        raise DamagedSceneError(file.path, f"hash {digest}, expected {file.xxh3} by scene.json")
    return data


def _sweep_copies(folder: Path) -> None:
    """Delete what dead processes left: folders that nobody has locked."""
    for entry in list(folder.iterdir()):
        try:
            lock = os.open(entry, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(entry, ignore_errors=True)
        except OSError:
            pass  # in use, or a file system without locks: better left than lost
        finally:
            os.close(lock)
