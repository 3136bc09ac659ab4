"""Write a new version of a scene and publish it atomically.

::

    with SceneWriter(directory) as writer:
        for payload in payloads:                   # in Morton or Hilbert order
            writer.add_segment(payload, region=region)
        # where there are two levels, the coarser one of each segment now, in the same order
        writer.set_base(base, cover)
        writer.set_regions(facts)
        manifest = writer.publish(info)

Until :meth:`SceneWriter.publish` returns, the scene that readers see is the old one; leaving the
``with`` block earlier, or being killed, leaves it so.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
import xxhash
from pydantic import JsonValue

from terraport_payload import Cover, decode_segment
from terraport_payload.segment_format import segment_texture
from terraport_store.assembly import MeshShape, SceneInfo, assemble_manifest
from terraport_store.errors import PublishError
from terraport_store.index import SegmentIndex
from terraport_store.layout import (
    BASE,
    COVER,
    ENCODING,
    INDEX,
    OVERVIEW,
    PACK,
    REGIONS,
    pack_header,
)
from terraport_store.manifest import FileInfo, Manifest
from terraport_store.pack_writer import PackWriter
from terraport_store.publishing import (
    PublishLock,
    new_staging_folder,
    out_of_space_named,
    require_space,
    sync_folder,
    write_synced,
)
from terraport_store.swap import swap_in

__all__ = ["SceneInfo", "SceneWriter"]

_UNNAMED: Final = "unnamed"
"""Stands for the version's folder until the version is known; it is no part of the digest."""


class SceneWriter:
    """Writes one new version of a scene.

    A context manager; not thread-safe. Holds a lock on the scene directory from construction to the
    end.

    Parameters
    ----------
    scene_dir : Path
        Created if it is not there; its parent must be.
    expected_bytes : int, optional
        What the whole version will take, as far as known; checked against the free space at once.

    Raises
    ------
    OutOfSpaceError
        When there is not enough free space for expected_bytes; nothing was written.
    SceneBusyError
        When another process is publishing the same scene.
    PublishError
        When the parent directory is not there.
    """

    def __init__(self, scene_dir: str | Path, *, expected_bytes: int = 0) -> None:
        self._scene_dir = Path(scene_dir)
        parent = self._scene_dir.absolute().parent
        if not parent.is_dir():
            raise PublishError(f"no directory {parent}, expected one for the scene to stand in")
        require_space(parent, expected_bytes)
        self._created = not self._scene_dir.exists()
        self._scene_dir.mkdir(exist_ok=True)
        self._lock = PublishLock(self._scene_dir)
        self._shapes: list[MeshShape] = []
        self._textures: list[tuple[int, int, int]] = []
        self._regions: list[tuple[int, int]] = []
        self._base: MeshShape | None = None
        self._last_covering = 0
        self._files: dict[str, FileInfo] = {}
        self._pack: PackWriter | None = None
        self._open = True
        self._staging: Path | None = None
        try:
            with out_of_space_named(self._scene_dir):
                self._staging = new_staging_folder(self._scene_dir)
                self._pack = PackWriter((self._staging / PACK).open("xb"))
                self._pack.write(pack_header(ENCODING))
        except BaseException:
            self.abort()
            raise

    def add_segment(
        self,
        payload: bytes,
        *,
        region: int,
        region_count: int = 1,
        bounds: Sequence[float] | None = None,
        vertices: int | None = None,
        faces: int | None = None,
        texture: tuple[int, int, int] | None = None,
    ) -> int:
        """Append one segment to the pack.

        Parameters
        ----------
        payload : bytes
            From ``encode_segment``.
        region : int
            Id of the region with most faces in the segment.
        region_count : int, optional
            Number of regions in it.
        bounds : sequence of 6 floats, optional
            x, y, z minimum and maximum of the **decoded** (grid-snapped) positions, metres, scene
            frame.
        vertices, faces : int, optional
            Counts. When any of bounds, vertices and faces is left out, all are decoded (2 ms
            per 10 k faces).
        texture : (int, int, int), optional
            Width and height of its image, pixels, and what a GPU keeps of a texel, bits; zeros
            without one. When it is left out, it is read from the image's header (2 us).

        Returns
        -------
        int
            The segment's id: 0, 1, 2, ...

        Raises
        ------
        OutOfSpaceError
            When the disk is full; everything written so far is deleted.
        PayloadError
            When the payload has to be read and cannot be.
        PublishError
            When a payload is empty, or the writer is closed.
        """
        self._require_open()
        if bounds is None or vertices is None or faces is None:
            shape = MeshShape.of(decode_segment(payload, scales=None))
        else:
            shape = MeshShape(tuple(float(value) for value in bounds), vertices, faces)
        with self._aborting():
            assert self._pack is not None
            self._pack.append(payload)
        self._shapes.append(shape)
        self._textures.append(segment_texture(payload) if texture is None else texture)
        self._regions.append((region, region_count))
        return len(self._shapes) - 1

    def set_base(self, base: bytes, cover: Cover, overview: bytes | None = None) -> None:
        """Write the base mesh, the table of segments over its faces, and what is shown before.

        Parameters
        ----------
        base : bytes
            From ``encode_segment(..., may_be_wide=True)``.
        cover : Cover
            One row per face of the base, in its order.
        overview : bytes, optional
            From the same; None where the base is small enough to be the first picture.

        Raises
        ------
        OutOfSpaceError
            When the disk is full; everything written so far is deleted.
        PayloadError
            When a mesh cannot be decoded, or the cover is beyond the format's limits.
        PublishError
            When the cover has another number of faces, or a base was set before.
        """
        self._require_open()
        if self._base is not None:
            raise PublishError("base set twice, expected once")
        shape = MeshShape.of(decode_segment(base, scales=None))
        if cover.base_faces != shape.faces:
            raise PublishError(f"cover of {cover.base_faces} base faces, expected {shape.faces}")
        if overview is not None:
            decode_segment(overview, scales=None)
            self._write(OVERVIEW, overview)
        self._write(BASE, base)
        self._write(COVER, cover.to_bytes())
        self._base = shape
        self._last_covering = int(cover.segments.max(initial=0))

    def set_regions(self, regions: Mapping[str, JsonValue]) -> None:
        """Write regions.json.

        Parameters
        ----------
        regions : mapping
            A JSON object; see ``spec/scene-format.md``, section "regions.json".

        Raises
        ------
        OutOfSpaceError
            When the disk is full; everything written so far is deleted.
        PublishError
            When it was set before, or holds NaN or infinity.
        """
        self._require_open()
        if REGIONS in self._files:
            raise PublishError("regions set twice, expected once")
        try:
            text = json.dumps(regions, separators=(",", ":"), allow_nan=False)
        except ValueError as error:
            raise PublishError(f"regions are not JSON: {error}") from None
        self._write(REGIONS, text.encode("ascii"))

    def publish(self, info: SceneInfo) -> Manifest:
        """Finish the version and make it the published one.

        Parameters
        ----------
        info : SceneInfo
            Everything the files do not say.

        Returns
        -------
        Manifest
            As published. The version before it is kept for sessions that still use it, older ones
            are deleted.

        Raises
        ------
        OutOfSpaceError
            When the disk is full; what was published before stands, everything new is deleted.
        PublishError
            When the base is missing, there is no segment, or the cover names a segment that is not
            there.
        """
        self._require_open()
        if self._base is None or not self._shapes:
            raise PublishError(
                f"{len(self._shapes)} segments and {'no' if self._base is None else 'a'} base, "
                "expected at least one segment and a base"
            )
        segments, over = divmod(len(self._shapes), info.levels)
        if over:
            raise PublishError(
                f"{len(self._shapes)} payloads, expected one of each segment for {info.levels} "
                "levels"
            )
        if self._last_covering >= segments:
            raise PublishError(
                f"cover names segment {self._last_covering}, expected below {segments}"
            )
        if REGIONS not in self._files:
            self.set_regions({"regions": []})
        index = self._index()
        with self._aborting():
            assert self._staging is not None
            require_space(self._scene_dir, len(index) * 64)
            self._finish_pack()
            self._write(INDEX, index.to_bytes())
            sync_folder(self._staging)
            unnamed = assemble_manifest(info, index, self._base, self._files)
            manifest = swap_in(self._scene_dir, self._staging, unnamed)
        self._open = False
        self._lock.release()
        return manifest

    def abort(self) -> None:
        """Delete everything written; the published scene stays as it is. May be called again."""
        if not self._open:
            return
        self._open = False
        if self._pack is not None:
            self._pack.discard()
        if self._staging is not None:
            shutil.rmtree(self._staging, ignore_errors=True)
        if self._created:
            with suppress(OSError):  # not empty: somebody else put something there
                self._scene_dir.rmdir()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.abort()

    def _require_open(self) -> None:
        if not self._open:
            raise PublishError(
                "the writer is closed, expected one that is neither published nor aborted"
            )

    @contextmanager
    def _aborting(self) -> Iterator[None]:
        """Delete everything on any error, and name a full disk."""
        try:
            with out_of_space_named(self._scene_dir):
                yield
        except BaseException:
            self.abort()
            raise

    def _write(self, key: str, data: bytes) -> None:
        with self._aborting():
            assert self._staging is not None
            write_synced(self._staging / key, data)
        self._register(key, len(data), xxhash.xxh3_64_hexdigest(data))

    def _register(self, key: str, size: int, xxh3: str) -> None:
        self._files[key] = FileInfo(path=f"{_UNNAMED}/{key}", bytes=size, xxh3=xxh3)

    def _finish_pack(self) -> None:
        assert self._pack is not None
        self._pack.finish()
        self._register(PACK, self._pack.size, self._pack.digest.hexdigest())

    def _index(self) -> SegmentIndex:
        assert self._pack is not None
        rows = self._pack.rows
        return SegmentIndex(
            bounds=np.array([shape.bounds for shape in self._shapes], dtype="<f4"),
            vertex_count=np.array([shape.vertices for shape in self._shapes], dtype="<u4"),
            face_count=np.array([shape.faces for shape in self._shapes], dtype="<u4"),
            offset=np.array([row[0] for row in rows], dtype="<u8"),
            length=np.array([row[1] for row in rows], dtype="<u4"),
            xxh3=np.array([row[2] for row in rows], dtype="<u8"),
            region=np.array([region for region, _ in self._regions], dtype="<u4"),
            region_count=np.array([count for _, count in self._regions], dtype="<u2"),
            texture=np.array(self._textures, dtype="<u2"),
        )
