"""Put a published scene into object storage, so that its publication stays one step.

The files of the version go first, each under its own path, which no older version uses; then labels
and reports; ``scene.json`` last. Whoever reads meanwhile sees the old version, or the new one
whole. What an interrupted upload has put there whole is found by its hash and not sent again.

Needs ``terraport[s3]``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import xxhash

from terraport_store.errors import DamagedSceneError, SceneNotFoundError
from terraport_store.files import FolderFiles
from terraport_store.layout import (
    LABELS,
    MANIFEST_NAME,
    MAX_MANIFEST_BYTES,
    PREVIEW,
    REPORT,
    REPORT_PDF,
    VERSION_FOLDER,
)
from terraport_store.location import REACH_S
from terraport_store.manifest import FileInfo, Manifest
from terraport_store.origin import ObjectOptions, Origin

__all__ = [
    "HASH",
    "MOST_PARTS",
    "PART_BYTES",
    "PART_RETRIES",
    "TIMEOUT_S",
    "UploadReport",
    "upload_scene",
]

PART_BYTES: Final = 8 << 20
MOST_PARTS: Final = 9000
"""S3 takes 10,000 parts of one object."""

TIMEOUT_S: Final = 120.0
"""For one part: 8 MiB at 0.6 Mbit/s."""

PART_RETRIES: Final = 8

HASH: Final = "xxh3"
"""Metadata of an object: the hash that the manifest names, so that a half-done upload resumes."""

UploadProgress = Callable[[str, int, int], None]
"""Called with a file's path, bytes of it that are done now, and bytes done over all files."""


@dataclass(frozen=True, slots=True)
class UploadReport:
    """What an upload did."""

    version: str
    sent_bytes: int
    sent_files: int
    kept_files: int
    """Were there whole."""
    removed_versions: tuple[str, ...]
    """Folders of old versions that were deleted."""


def upload_scene(
    scene_dir: str | Path,
    url: str,
    options: ObjectOptions | None = None,
    *,
    prune: bool = False,
    progress: UploadProgress | None = None,
) -> UploadReport:
    """Upload the published version of a scene.

    Parameters
    ----------
    scene_dir : str or Path
        The scene directory; each file is compared with the manifest while it is read.
    url : str
        Where the scene shall lie: ``s3://BUCKET/PREFIX/NAME``.
    options : ObjectOptions, optional
        Endpoint and region; what concerns reading is not used.
    prune : bool, optional
        Delete older versions afterwards, but the one published before: sessions may be reading it.
    progress : callable, optional

    Returns
    -------
    UploadReport

    Raises
    ------
    SceneNotFoundError
        When there is no scene at *scene_dir*.
    DamagedSceneError
        When a file is not what the manifest says; nothing was published.
    OriginError
        When the storage does not take it; nothing was published.
    """
    asked = options or ObjectOptions()
    origin = Origin(url, replace(asked, timeout_s=TIMEOUT_S, part_retries=PART_RETRIES))
    local = FolderFiles(Path(scene_dir))
    try:
        text = local.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
    except FileNotFoundError:
        raise SceneNotFoundError(local.location) from None
    manifest = Manifest.from_bytes(text)
    # The first request brings nothing: what is wrong with address, credentials or network is said
    # within seconds, not after the patience that a part deserves.
    Origin(url, replace(asked, timeout_s=REACH_S)).head(MANIFEST_NAME)
    before = _published_folder(origin)
    upload = _Upload(origin, local, progress or _nobody)
    for file in sorted(manifest.files.values(), key=lambda file: file.bytes):
        upload.file(file)
    for name in (LABELS, PREVIEW, REPORT, REPORT_PDF):
        if os.path.lexists(local.directory / name):
            upload.loose(name)
    origin.put(MANIFEST_NAME, text)
    removed = _prune(origin, {manifest.folder, before}) if prune else ()
    return UploadReport(
        manifest.version, upload.sent_bytes, upload.sent_files, upload.kept_files, removed
    )


class _Upload:
    """Sends files and counts."""

    def __init__(self, origin: Origin, files: FolderFiles, progress: UploadProgress) -> None:
        self._origin = origin
        self._files = files
        self._progress = progress
        self._done_bytes = 0
        self.sent_bytes = 0
        self.sent_files = 0
        self.kept_files = 0

    def file(self, file: FileInfo) -> None:
        """Send a file of the version, unless it is there."""
        size = self._files.size(file.path)
        if size != file.bytes:
            what = f"{size} bytes, expected {file.bytes} by scene.json"
            raise DamagedSceneError(file.path, what)
        seen = self._origin.head(file.path)
        if seen is not None and seen.size == file.bytes and seen.attributes.get(HASH) == file.xxh3:
            self.kept_files += 1
            self._advance(file.path, file.bytes)
            return
        attributes = {HASH: file.xxh3}
        part_bytes = max(PART_BYTES, -(-file.bytes // MOST_PARTS))
        if file.bytes <= part_bytes:
            data = b"".join(self._parts(file, part_bytes))
            self._origin.put(file.path, data, attributes)
        else:
            self._origin.put_parts(file.path, self._parts(file, part_bytes), part_bytes, attributes)
        self.sent_files += 1
        self.sent_bytes += file.bytes

    def loose(self, name: str) -> None:
        """Send a file that belongs to no version."""
        try:
            with self._files.open(name) as opened:
                data = opened.read()
        except PermissionError as error:  # a link would publish what lies elsewhere
            raise DamagedSceneError(name, error.strerror or str(error)) from None
        self._origin.put(name, data)
        self.sent_files += 1
        self.sent_bytes += len(data)

    def _parts(self, file: FileInfo, part_bytes: int) -> Iterator[bytes]:
        """Read a file; raises DamagedSceneError instead of the last part of a wrong one."""
        digest = xxhash.xxh3_64()
        with self._files.open(file.path) as opened:
            chunk = opened.read(part_bytes)
            while chunk:
                digest.update(chunk)
                following = opened.read(part_bytes)
                if not following and digest.hexdigest() != file.xxh3:
                    what = f"hash {digest.hexdigest()}, expected {file.xxh3} by scene.json"
                    raise DamagedSceneError(file.path, what)
                yield chunk
                self._advance(file.path, len(chunk))
                chunk = following

    def _advance(self, path: str, done_bytes: int) -> None:
        self._done_bytes += done_bytes
        self._progress(path, done_bytes, self._done_bytes)


def _published_folder(origin: Origin) -> str | None:
    try:
        return Manifest.from_bytes(origin.get(MANIFEST_NAME, MAX_MANIFEST_BYTES)).folder
    except (FileNotFoundError, DamagedSceneError):
        return None


def _prune(origin: Origin, keep: set[str | None]) -> tuple[str, ...]:
    old = [name for name in origin.folders() if VERSION_FOLDER.fullmatch(name) and name not in keep]
    for folder in old:
        origin.delete([listed.path for listed in origin.objects(folder)])
    return tuple(old)


def _nobody(_path: str, _done_bytes: int, _all_bytes: int) -> None:
    return
