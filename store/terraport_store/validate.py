"""Check everything that a scene directory promises.

Hashes, sizes, counts, boxes, the grid, ids; every payload is decoded. Memory use is one payload
(and the index). Whether the cover leaves no hole is a question for rays: the pipeline's
``validate`` command asks it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np
import xxhash

from terraport_payload import PayloadError, SegmentMesh
from terraport_store.errors import DamagedSceneError
from terraport_store.files import SceneFiles
from terraport_store.findings import Finding, Findings
from terraport_store.labelling import read_labels
from terraport_store.layout import (
    ALIGNMENT,
    BASE,
    ENCODING,
    LABELS,
    MANIFEST_NAME,
    MAX_MANIFEST_BYTES,
    OVERVIEW,
    PACK_HEADER_BYTES,
    REGIONS,
)
from terraport_store.location import scene_files
from terraport_store.manifest import Manifest, manifest_digest
from terraport_store.opening import read_manifest
from terraport_store.reader import Scene
from terraport_store.regions import RegionNames
from terraport_store.validate_mesh import box_of, check_mesh_fits, check_segment

__all__ = ["Finding", "validate_scene"]

_AHEAD: Final = 64
"""Segments that are fetched ahead, where that takes a network."""


def validate_scene(
    path: str | Path | SceneFiles, *, progress: Callable[[int, int], None] | None = None
) -> list[Finding]:
    """Check a published scene.

    Parameters
    ----------
    path : str, Path or SceneFiles
        The scene directory, or where else the scene lies; an address (``s3://...``) too.
    progress : callable, optional
        Called with (segments done, segments in all) after each.

    Returns
    -------
    list of Finding
        Empty for a whole scene; at most 1000.

    Raises
    ------
    SceneNotFoundError
        When there is no scene.json. Everything else that is wrong is a finding.
    """
    out = Findings()
    files = scene_files(path)
    check = _SceneCheck(files, out)
    try:
        try:
            manifest = read_manifest(files)
        except DamagedSceneError as error:
            out.damaged("manifest", error)
            return out.all
        check.manifest(manifest)
        check.hashes(manifest)
        try:
            with Scene.open(files) as scene:
                check.scene(scene, progress)
        except DamagedSceneError as error:
            out.damaged("open", error)
    finally:
        if files is not path:
            files.close()
    return out.all


class _SceneCheck:
    """Checks one scene; what it finds goes into ``out``."""

    def __init__(self, files: SceneFiles, out: Findings) -> None:
        self.files = files
        self.out = out

    def manifest(self, manifest: Manifest) -> None:
        document = json.loads(self.files.read(MANIFEST_NAME, MAX_MANIFEST_BYTES))
        digest = manifest_digest(document)
        if digest != manifest.version:
            self.out.error(
                "version",
                MANIFEST_NAME,
                f"version {manifest.version}, expected {digest} by its contents",
            )
        folders = {file.path.partition("/")[0] for file in manifest.files.values()}
        if len(folders) != 1:
            self.out.error(
                "folder", MANIFEST_NAME, f"files lie in {sorted(folders)}, expected one folder"
            )
        if float(np.frexp(manifest.step_m)[0]) != 0.5:
            self.out.error(
                "step", MANIFEST_NAME, f"step_m {manifest.step_m!r}, expected a power of two"
            )

    def hashes(self, manifest: Manifest) -> None:
        """Check size and hash of every file, whoever reads it later."""
        for info in manifest.files.values():
            try:
                size = self.files.size(info.path)
                if size != info.bytes:
                    self.out.error(
                        "file-size", info.path, f"{size} bytes, expected {info.bytes} by scene.json"
                    )
                    continue
                digest = xxhash.xxh3_64()
                for block in self.files.blocks(info):
                    digest.update(block)
                actual = digest.hexdigest()
            except OSError as error:
                self.out.error(
                    "file-missing",
                    info.path,
                    f"cannot be read ({error.strerror}), expected by scene.json",
                )
                continue
            if actual != info.xxh3:
                self.out.error(
                    "file-hash", info.path, f"hash {actual}, expected {info.xxh3} by scene.json"
                )

    def scene(self, scene: Scene, progress: Callable[[int, int], None] | None) -> None:
        """Check what files say of each other: manifest, indexes, base, regions, every payload.

        Invariant: a finding never ends the check, except where nothing is left to compare with.
        """
        manifest, index, rows = scene.manifest, scene.index, scene.rows
        if len(index) == 0:
            self.out.error("count", MANIFEST_NAME, "no segment, expected at least one")
            return
        # (1) The scene's box is that of index and base together.
        base = self.base(scene)
        self.overview(scene)
        boxes = index.bounds
        if base is not None:
            boxes = np.vstack([boxes, box_of(base)[None]])
        actual = (*boxes[:, :3].min(axis=0).tolist(), *boxes[:, 3:].max(axis=0).tolist())
        stated = (*manifest.bounds.min, *manifest.bounds.max)
        if base is not None and actual != stated:
            self.out.error(
                "bounds", MANIFEST_NAME, f"bounds {stated}, expected {actual} by index and base"
            )
        # (2) Counts and limits of the manifest are sums and maxima of the index.
        sides = (index.bounds[:, 3:].astype(np.float64) - index.bounds[:, :3]).max()
        counts, limits = manifest.counts, manifest.limits
        longest = max(int(scene.index_for(name).length.max()) for name in manifest.encodings)
        for label, stated_value, expected in (
            (
                "counts.detail_vertices",
                counts.detail_vertices,
                int(index.vertex_count.sum(dtype=np.uint64)),
            ),
            (
                "counts.detail_faces",
                counts.detail_faces,
                int(index.face_count.sum(dtype=np.uint64)),
            ),
            ("limits.max_segment_faces", limits.max_segment_faces, int(rows.face_count.max())),
            ("limits.max_segment_bytes", limits.max_segment_bytes, longest),
            ("limits.max_extent_m", limits.max_extent_m, float(sides)),
        ):
            if stated_value != expected:
                self.out.error(
                    "count",
                    MANIFEST_NAME,
                    f"{label} {stated_value}, expected {expected} by the index",
                )
        # (3) Every encoding has an index of its own, which may differ in offsets and lengths alone.
        for name, info in manifest.encodings.items():
            other = scene.index_for(name)
            if other.payload_bytes != info.payload_bytes:
                self.out.error(
                    "count",
                    MANIFEST_NAME,
                    f"encodings.{name}.payload_bytes {info.payload_bytes}, "
                    f"expected {other.payload_bytes} by its index",
                )
            for column in (
                "bounds",
                "vertex_count",
                "face_count",
                "region",
                "region_count",
                "texture",
            ):
                if not np.array_equal(getattr(other, column), getattr(rows, column)):
                    path = manifest.files[info.index].path
                    self.out.error(
                        "index-agreement",
                        path,
                        f"{column} differ from the {ENCODING} index, expected equal",
                    )
            self.padding(scene, name)
        # (4) Each level has the boxes of the segments.
        self.levels(scene)
        # (5) Regions: names, and that the index uses none beyond them.
        self.names(scene)
        regions = np.flatnonzero(rows.region >= counts.regions)
        if len(regions):
            self.out.error(
                "region",
                manifest.files[manifest.encodings[ENCODING].index].path,
                f"region {int(rows.region[regions[0]])}, expected below {counts.regions}",
                segment=int(regions[0]),
            )
        # (6) Every payload, decoded; the next ones are fetched meanwhile.
        for segment in range(len(rows)):
            if segment % _AHEAD == 0:
                coming = range(segment, min(segment + 2 * _AHEAD, len(rows)))
                for name in manifest.encodings:
                    scene.expect(coming, name)
            check_segment(self.out, scene, segment)
            if progress is not None:
                progress(segment + 1, len(rows))

    def levels(self, scene: Scene) -> None:
        """Check that what decides which level is shown is the same for all of a segment's."""
        manifest, count = scene.manifest, len(scene.index)
        path = manifest.files[manifest.encodings[ENCODING].index].path
        for level in range(1, manifest.levels):
            boxes = scene.rows.bounds[level * count : (level + 1) * count]
            for segment in np.flatnonzero((boxes != scene.index.bounds).any(axis=1)):
                self.out.error(
                    "level-bounds",
                    path,
                    f"box {boxes[segment].tolist()} at level {level}, expected the segment's, "
                    f"{scene.index.bounds[segment].tolist()}",
                    segment=int(segment),
                )

    def names(self, scene: Scene) -> None:
        """Check region ids, stable ids and labels."""
        path = scene.manifest.files[REGIONS].path
        try:
            document = scene.regions
            names = RegionNames.of(document, file=path)
        except DamagedSceneError as error:
            self.out.damaged("regions", error)
            return
        for number, row in enumerate(document["regions"]):
            row_id = row.get("id") if isinstance(row, dict) else row
            if row_id != number:
                self.out.error(
                    "regions", path, f"region {number} has id {row_id!r}, expected {number}"
                )
        try:
            highest = max(read_labels(self.files), default=-1)
        except DamagedSceneError as error:
            self.out.damaged("labels", error)
            return
        if names.stable_ids is not None and highest >= names.next_stable_id:
            self.out.error(
                "labels",
                LABELS,
                f"a label for stable id {highest}, expected below {names.next_stable_id}",
            )

    def base(self, scene: Scene) -> SegmentMesh | None:
        file, counts = scene.manifest.files[BASE].path, scene.manifest.counts
        try:
            mesh = scene.file_mesh(BASE)
        except PayloadError as error:
            self.out.error("base-decode", file, error.what, offset=error.offset)
            return None
        counted = (len(mesh.positions), len(mesh.faces))
        if counted != (counts.base_vertices, counts.base_faces):
            self.out.error(
                "base-count",
                file,
                f"{counted[0]} vertices and {counted[1]} faces, "
                f"expected {counts.base_vertices} and {counts.base_faces} by scene.json",
            )
        check_mesh_fits(self.out, scene.manifest, mesh, file, None)
        return mesh

    def overview(self, scene: Scene) -> None:
        if OVERVIEW not in scene.manifest.files:
            return
        file = scene.manifest.files[OVERVIEW].path
        try:
            mesh = scene.file_mesh(OVERVIEW)
        except PayloadError as error:
            self.out.error("overview-decode", file, error.what, offset=error.offset)
            return
        if len(mesh.faces) > scene.manifest.counts.base_faces:
            self.out.error(
                "overview-count",
                file,
                f"{len(mesh.faces)} faces, expected at most the base's "
                f"{scene.manifest.counts.base_faces}",
            )
        check_mesh_fits(self.out, scene.manifest, mesh, file, None)

    def padding(self, scene: Scene, encoding: str) -> None:
        """Check that payloads are aligned and only zeros, fewer than 64, lie between them."""
        index = scene.index_for(encoding)
        info = scene.manifest.files[scene.manifest.encodings[encoding].pack]
        offsets = index.offset.astype(np.int64)
        ends = offsets + index.length
        gaps = np.concatenate([[PACK_HEADER_BYTES], ends[:-1]])
        with closing(self.files.open_pack(info, index)) as pack:
            for segment in np.flatnonzero(offsets > gaps):
                start, stop = int(gaps[segment]), int(offsets[segment])
                if stop - start >= ALIGNMENT or any(pack.read(start, stop - start)):
                    self.out.error(
                        "padding",
                        info.path,
                        f"{stop - start} bytes before the payload, "
                        f"expected fewer than {ALIGNMENT}, all zero",
                        segment=int(segment),
                        offset=start,
                    )
        for segment in np.flatnonzero((offsets % ALIGNMENT != 0) | (offsets < PACK_HEADER_BYTES)):
            self.out.error(
                "alignment",
                info.path,
                f"payload at {int(offsets[segment])}, "
                f"expected a multiple of {ALIGNMENT} after the header",
                segment=int(segment),
            )
        if int(ends[-1]) != info.bytes:
            self.out.error(
                "pack-end", info.path, f"{info.bytes} bytes, expected {int(ends[-1])} by the index"
            )
