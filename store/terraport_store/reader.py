"""Open a published scene and read from it.

Opening reads the manifest, index and cover (checked by their hashes) and opens the packs; payloads
are read one at a time, so memory use does not grow with the scene but for the index: 64 bytes per
segment, and 29 for the R-tree.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
import xxhash

from terraport_payload import Cover, SegmentMesh, decode_segment, encode_glb
from terraport_payload.cover import MAX_COVER_BYTES
from terraport_payload.types import Int64
from terraport_store.errors import (
    CorruptPayloadError,
    DamagedSceneError,
    RangeError,
)
from terraport_store.files import LocalCopy, SceneFiles, path_inside
from terraport_store.index import SegmentIndex
from terraport_store.layout import (
    BASE,
    COVER,
    ENCODING,
    MANIFEST_NAME,
    MAX_INDEX_BYTES,
    MAX_REGIONS_BYTES,
    REGIONS,
)
from terraport_store.location import scene_files
from terraport_store.manifest import Manifest
from terraport_store.opening import (
    check_agreement,
    check_size,
    largest_texture,
    open_pack,
    read_checked,
    read_manifest,
    read_parsed,
)
from terraport_store.packed_rtree import PackedRTree
from terraport_store.source import PayloadRange, PayloadSource

__all__ = ["Scene"]

_OPEN_ATTEMPTS: Final = 5
"""A version can vanish between reading scene.json and opening its files only if two newer ones were
published in between; five times in a row means something else is wrong."""


class Scene:
    """A published scene, open for reading.

    Made by :meth:`open`; a context manager. May be used from several threads. The version that was
    opened stays readable after newer ones are published.

    Attributes
    ----------
    files : SceneFiles
        Where it lies.
    path : Path
        The scene directory; for a scene in object storage a local folder with base, cover and
        regions, but no packs, that goes when this is closed.
    manifest : Manifest
    rows : SegmentIndex
        Payloads of all levels in segment format 2: that of segment s at level k is row
        ``k * S + s``. Bounds and counts are the same in all encodings.
    index : SegmentIndex
        The S segments at full detail: the first of ``rows``.
    cover : Cover
        Segments over each base face.
    """

    def __init__(
        self,
        files: SceneFiles,
        manifest: Manifest,
        indexes: dict[str, SegmentIndex],
        cover: Cover,
        sources: dict[str, PayloadSource],
        copy: LocalCopy,
    ) -> None:
        self.files = files
        self.path = copy.path
        self.manifest = manifest
        self.rows = indexes[ENCODING]
        self.index = self.rows.first(manifest.counts.segments)
        self.cover = cover
        self._indexes = indexes
        self._sources = sources
        self._copy = copy
        self.owns_files = False
        """Whether :meth:`close` closes the files too: nobody else has them."""
        self._verified = {name: np.zeros(len(index), dtype=bool) for name, index in indexes.items()}

    @classmethod
    def open(cls, path: str | Path | SceneFiles) -> Scene:
        """Open the version that is published now.

        Parameters
        ----------
        path : str, Path or SceneFiles
            The scene directory; an address like ``s3://bucket/scene`` (a str), cached in memory; or
            files of an ObjectStorage, which are not closed with the scene.

        Returns
        -------
        Scene
            Close it, or use it in a ``with`` statement.

        Raises
        ------
        SceneNotFoundError
            When there is no scene.json.
        DamagedSceneError
            Naming the file and what is wrong: missing, another size, another hash, not what the
            format says.
        OSError
            When a file cannot be read (permissions, device).
        """
        files = scene_files(path)
        try:
            return cls._open_newest(files, owned=files is not path)
        except BaseException:
            if files is not path:
                files.close()
            raise

    @classmethod
    def _open_newest(cls, files: SceneFiles, *, owned: bool) -> Scene:
        manifest = read_manifest(files)
        for _ in range(_OPEN_ATTEMPTS):
            try:
                scene = cls._open_version(files, manifest)
            except FileNotFoundError as error:
                newer = read_manifest(files)
                if newer.version == manifest.version and newer.folder == manifest.folder:
                    what = "no such file, expected by scene.json"
                    raise DamagedSceneError(str(error.filename), what) from None
                manifest = newer
            else:
                scene.owns_files = owned
                return scene
        raise DamagedSceneError(MANIFEST_NAME, f"{_OPEN_ATTEMPTS} versions vanished while opening")

    @classmethod
    def _open_version(cls, files: SceneFiles, manifest: Manifest) -> Scene:
        with ExitStack() as undo:
            indexes = {
                name: read_parsed(
                    files,
                    manifest,
                    info.index,
                    MAX_INDEX_BYTES,
                    lambda data: SegmentIndex.from_bytes(data, largest=largest_texture(manifest)),
                )
                for name, info in manifest.encodings.items()
            }
            cover = read_parsed(
                files,
                manifest,
                COVER,
                MAX_COVER_BYTES,
                lambda data: Cover.from_bytes(data, manifest.counts.base_faces),
            )
            check_agreement(manifest, indexes, cover)
            sources: dict[str, PayloadSource] = {}
            for name, info in manifest.encodings.items():
                sources[name] = open_pack(files, manifest, name, info, indexes[name])
                undo.callback(sources[name].close)
            for key in (BASE, REGIONS):
                check_size(files, manifest, key)
            copy = files.local_copy(manifest)
            undo.pop_all()
        return cls(files, manifest, indexes, cover, sources, copy)

    @cached_property
    def spatial(self) -> PackedRTree:
        """R-tree over the segments, built on first use (0.03 s per 100,000)."""
        return PackedRTree(self.index.bounds)

    @property
    def base_path(self) -> Path:
        """The file of this version's base mesh."""
        return self.file_path(BASE)

    @cached_property
    def regions(self) -> dict[str, Any]:
        """Contents of regions.json, read on first use.

        Raises
        ------
        DamagedSceneError
            When it is not what the manifest says, or not a JSON object.
        """
        data = read_checked(self.files, self.manifest, REGIONS, MAX_REGIONS_BYTES)
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DamagedSceneError(
                self._relative(REGIONS), f"does not parse as JSON: {error}"
            ) from None
        if not isinstance(document, dict):
            raise DamagedSceneError(
                self._relative(REGIONS), f"a {type(document).__name__}, expected an object"
            )
        return document

    def file_path(self, key: str) -> Path:
        """Path of one file of this version by its key in ``manifest.files``.

        Of a scene in object storage only base, cover and regions are there.

        Raises
        ------
        KeyError
            When the manifest has no such file.
        PermissionError
            When a link leads out of the scene.
        """
        return path_inside(self.path, self.manifest.files[key].path)

    def index_for(self, encoding: str) -> SegmentIndex:
        """Index of one encoding; lengths, offsets and hashes differ between encodings.

        Raises
        ------
        KeyError
            When the scene has no such encoding.
        """
        return self._indexes[encoding]

    def within(self, centre: Sequence[float], radius_m: float) -> Int64:
        """Find every segment whose box comes within a radius; see :class:`PackedRTree`."""
        return self.spatial.within(centre, radius_m)

    def payload(
        self,
        segment_id: int,
        encoding: str = ENCODING,
        verify: bool = True,
        *,
        recheck: bool = False,
    ) -> bytes | memoryview:
        """Read one segment's payload.

        Parameters
        ----------
        segment_id : int
            0 to S - 1; from S on, rows of coarser levels.
        encoding : str, optional
            Key of ``manifest.encodings``.
        verify : bool, optional
            Compare with the index's hash, the first time each segment is read; later reads trust
            it.
        recheck : bool, optional
            Compare again even if it was found right before (for a client that reports a wrong
            hash).

        Returns
        -------
        bytes or memoryview
            A view stays valid until :meth:`close`.

        Raises
        ------
        CorruptPayloadError
            When the hash is wrong; the segment counts as unverified from then on.
        IndexError
            When there is no such segment.
        KeyError
            When the scene has no such encoding.
        DamagedSceneError
            When the pack has become shorter than it was.
        """
        index = self._indexes[encoding]
        if not 0 <= segment_id < len(index):
            raise IndexError(f"segment {segment_id}, expected 0 to {len(index) - 1}")
        offset = int(index.offset[segment_id])
        data = self._sources[encoding].read(offset, int(index.length[segment_id]))
        if verify and (recheck or not self._verified[encoding][segment_id]):
            expected, actual = self._compare(segment_id, encoding, data)
            if actual != expected:
                pack = self._relative(self.manifest.encodings[encoding].pack)
                raise CorruptPayloadError(segment_id, offset, expected, actual, file=pack)
        return data

    def mesh(self, segment_id: int, *, recheck: bool = False) -> SegmentMesh:
        """Read and decode one segment; parameters and errors as for :meth:`payload`.

        Raises
        ------
        PayloadError
            When the payload is not a whole segment.
        """
        data = self.payload(segment_id, recheck=recheck)
        return decode_segment(data, scales=self.manifest.scales)

    def glb(self, segment_id: int, *, unlit: bool = False) -> bytes:
        """Make a GLB of one segment, for programs that know glTF; errors as for :meth:`mesh`.

        Where it is *unlit*, its colours are shown without any light, as all content of a tileset.
        """
        return self._as_glb(self.mesh(segment_id), unlit=unlit)

    def file_mesh(self, key: str) -> SegmentMesh:
        """Read and decode the base or the overview.

        Parameters
        ----------
        key : str
            ``base.tsg`` or ``overview.tsg``.

        Raises
        ------
        KeyError
            When the scene has no such file.
        OSError
            When it cannot be read.
        PayloadError
            When it is damaged.
        """
        return decode_segment(self.file_path(key).read_bytes(), scales=self.manifest.scales)

    def file_glb(self, key: str) -> bytes:
        """Make a GLB of the base or the overview; arguments and errors as for :meth:`file_mesh`."""
        return self._as_glb(self.file_mesh(key))

    def compare(self, segment_id: int, encoding: str, data: bytes | memoryview) -> bool:
        """Compare a whole payload that the caller has read with its hash, as :meth:`payload` does.

        Never waits: 0.02 ms a megabyte. Raises as :meth:`is_verified`.

        Returns
        -------
        bool
            Whether it is right; :meth:`is_verified` says so from then on.
        """
        expected, actual = self._compare(segment_id, encoding, data)
        return actual == expected

    def is_verified(self, segment_id: int, encoding: str = ENCODING) -> bool:
        """Tell whether :meth:`payload` found the segment's hash right when it last looked.

        True always where nothing is handed out unchecked: see :meth:`payload_range`.

        Raises
        ------
        IndexError
            When there is no such segment.
        KeyError
            When the scene has no such encoding.
        """
        verified = bool(self._verified[encoding][segment_id])
        return verified or self._sources[encoding].checks_hashes

    def distrust(self, segment_id: int, encoding: str = ENCODING) -> None:
        """Let the next :meth:`payload` compare the hash again; raises as :meth:`is_verified`."""
        self._verified[encoding][segment_id] = False
        self._sources[encoding].distrust(*self._payload_range(segment_id, encoding))

    def payload_range(
        self, segment_id: int, encoding: str, start: int, length: int
    ) -> PayloadRange | None:
        """Tell where in an open file a part of a payload lies, for ``sendfile``.

        Parameters
        ----------
        segment_id : int
        encoding : str
        start, length : int
            Bytes within the payload.

        Returns
        -------
        PayloadRange or None
            None where payloads are not read from a file. Good until :meth:`close`. Nothing is
            compared: see :meth:`is_verified`.

        Raises
        ------
        IndexError
            When there is no such segment.
        KeyError
            When the scene has no such encoding.
        RangeError
            When the bytes do not all lie in the payload.
        """
        index = self._indexes[encoding]
        total = int(index.length[segment_id])
        if start < 0 or length < 0 or start + length > total:
            raise RangeError(start, length, total)
        return self._sources[encoding].file_range(int(index.offset[segment_id]) + start, length)

    def pack_range(self, encoding: str, start: int, length: int) -> PayloadRange | None:
        """Tell where in an open file a part of a pack lies; as :meth:`payload_range`.

        Raises
        ------
        KeyError
            When the scene has no such encoding.
        RangeError
            When the bytes do not all lie in the pack.
        """
        return self._sources[encoding].file_range(start, length)

    def held(
        self, segment_id: int, encoding: str, start: int, length: int
    ) -> bytes | memoryview | None:
        """Return a part of a payload that is in memory; arguments as for :meth:`payload_range`.

        None where it is in a file or still elsewhere. Never waits; nothing is compared.
        """
        offset = int(self._indexes[encoding].offset[segment_id])
        return self._sources[encoding].held(offset + start, length)

    def view(self, segment_id: int, encoding: str, start: int, length: int) -> memoryview | None:
        """Return a part of a payload for a system call to read; None where that would wait.

        Python must not read the bytes, see :meth:`PayloadSource.view`. Nothing is compared.
        """
        offset = int(self._indexes[encoding].offset[segment_id])
        return self._sources[encoding].view(offset + start, length)

    def recall(self, segment_id: int, encoding: str) -> bool:
        """Bring a payload to hand if that takes no network, and tell whether it is.

        May read a disk; raises as :meth:`is_verified`.
        """
        return self._sources[encoding].recall(*self._payload_range(segment_id, encoding))

    def expect(self, segment_ids: Sequence[int], encoding: str) -> None:
        """Hear which payloads will be read soon, in this order; raises as :meth:`is_verified`."""
        ranges = [self._payload_range(segment_id, encoding) for segment_id in segment_ids]
        self._sources[encoding].expect(ranges)

    def interrupt(self) -> None:
        """Let what waits for a network fail soon, now and from now on."""
        for source in self._sources.values():
            source.interrupt()

    def close(self) -> None:
        """Close the packs; may be called again.

        Views handed out before must not be used any more.
        """
        for source in self._sources.values():
            source.close()
        self._copy.close()
        if self.owns_files:
            self.files.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _as_glb(self, mesh: SegmentMesh, *, unlit: bool = False) -> bytes:
        return encode_glb(
            mesh,
            step_m=self.manifest.step_m,
            attribute_scales=self.manifest.scales,
            unlit=unlit,
        )

    def _compare(self, segment_id: int, encoding: str, data: bytes | memoryview) -> tuple[int, int]:
        """Note whether a payload has its hash; return the one that it should have, and has."""
        expected = int(self._indexes[encoding].xxh3[segment_id])
        actual = xxhash.xxh3_64_intdigest(data)
        self._verified[encoding][segment_id] = actual == expected
        return expected, actual

    def _payload_range(self, segment_id: int, encoding: str) -> tuple[int, int]:
        index = self._indexes[encoding]
        return int(index.offset[segment_id]), int(index.length[segment_id])

    def _relative(self, key: str) -> str:
        return self.manifest.files[key].path
