"""Steps of opening a scene: its manifest, its files checked one by one, its packs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import xxhash

from terraport_payload import Cover, PayloadError
from terraport_store.errors import DamagedSceneError, SceneNotFoundError
from terraport_store.files import SceneFiles
from terraport_store.index import SegmentIndex
from terraport_store.layout import (
    COVER,
    MANIFEST_NAME,
    MAX_MANIFEST_BYTES,
    PACK_HEADER_BYTES,
    check_pack_header,
)
from terraport_store.location import scene_files
from terraport_store.manifest import EncodingInfo, Manifest
from terraport_store.source import PayloadSource

__all__ = [
    "check_agreement",
    "check_size",
    "largest_texture",
    "list_scenes",
    "open_pack",
    "read_checked",
    "read_manifest",
    "read_parsed",
]

_T = TypeVar("_T")


def read_manifest(directory: str | Path | SceneFiles) -> Manifest:
    """Read ``scene.json`` alone: which version is published now.

    Parameters
    ----------
    directory : str, Path or SceneFiles
        The scene directory, or where else the scene lies.

    Returns
    -------
    Manifest

    Raises
    ------
    SceneNotFoundError
        When there is none.
    DamagedSceneError
        When it is not a manifest of format 1.x.
    """
    files = scene_files(directory)
    try:
        data = files.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
    except FileNotFoundError:
        folder = Path(files.location)
        inside = [*list_scenes(folder)] if folder.is_dir() else []
        raise SceneNotFoundError(files.location, inside) from None
    finally:
        if files is not directory:
            files.close()
    return Manifest.from_bytes(data)


def largest_texture(manifest: Manifest) -> tuple[int, int, int]:
    """Return what the index's ``texture`` is taken to be where the file does not say it.

    Returns
    -------
    (int, int, int)
        The largest that any segment of the scene can have: width and height, pixels, and bits a
        texel on a GPU.
    """
    side = 0 if manifest.textures is None else manifest.textures.max_side
    return (side, side, 32) if side else (0, 0, 0)


def list_scenes(directory: str | Path) -> dict[str, Path]:
    """Find the scenes in a directory.

    Parameters
    ----------
    directory : str or Path
        A folder of scenes, or one scene itself.

    Returns
    -------
    dict of str to Path
        Scene directory by its id (the folder's name), ascending. Whether they are whole is not
        looked at. Hidden folders are left out.

    Raises
    ------
    SceneNotFoundError
        When *directory* is not a directory.
    """
    root = Path(directory)
    if not root.is_dir():
        raise SceneNotFoundError(str(directory))
    if (root / MANIFEST_NAME).is_file():
        return {root.resolve().name: root}
    folders = (child for child in root.iterdir() if not child.name.startswith("."))
    return {child.name: child for child in sorted(folders) if (child / MANIFEST_NAME).is_file()}


def read_checked(files: SceneFiles, manifest: Manifest, key: str, limit: int) -> bytes:
    """Read one file of a version, whole, and compare its hash.

    Raises
    ------
    DamagedSceneError
        When it is larger than the limit, or not what the manifest says.
    """
    info = manifest.files[key]
    if info.bytes > limit:
        raise DamagedSceneError(info.path, f"{info.bytes} bytes, expected at most {limit}")
    data = files.fetch(info)
    if len(data) != info.bytes:
        raise DamagedSceneError(info.path, f"not the {info.bytes} bytes that scene.json expects")
    actual = f"{xxhash.xxh3_64_intdigest(data):016x}"
    if actual != info.xxh3:
        raise DamagedSceneError(info.path, f"hash {actual}, expected {info.xxh3} by scene.json")
    return data


def read_parsed(
    files: SceneFiles, manifest: Manifest, key: str, limit: int, parse: Callable[[bytes], _T]
) -> _T:
    """Read one file of a version and parse it; raises DamagedSceneError naming the file."""
    try:
        return parse(read_checked(files, manifest, key, limit))
    except PayloadError as error:
        raise DamagedSceneError(manifest.files[key].path, error.what, offset=error.offset) from None


def check_size(files: SceneFiles, manifest: Manifest, key: str) -> None:
    """Compare the size of a file with the manifest; raises DamagedSceneError."""
    info = manifest.files[key]
    size = files.size(info.path)
    if size != info.bytes:
        raise DamagedSceneError(info.path, f"{size} bytes, expected {info.bytes} by scene.json")


def open_pack(
    files: SceneFiles,
    manifest: Manifest,
    encoding: str,
    info: EncodingInfo,
    index: SegmentIndex,
) -> PayloadSource:
    """Open the pack of one encoding and check its header and size.

    Raises
    ------
    DamagedSceneError
        When it is not what the manifest and the index say.
    """
    file = manifest.files[info.pack]
    check_size(files, manifest, info.pack)
    source = files.open_pack(file, index)
    try:
        check_pack_header(source.read(0, min(PACK_HEADER_BYTES, source.size)), encoding)
    except PayloadError as error:
        source.close()
        raise DamagedSceneError(file.path, error.what, offset=error.offset) from None
    except BaseException:
        source.close()
        raise
    if index.end > source.size:
        source.close()
        raise DamagedSceneError(
            file.path, f"{source.size} bytes, expected {index.end} by the index"
        )
    return source


def check_agreement(manifest: Manifest, indexes: dict[str, SegmentIndex], cover: Cover) -> None:
    """Check that manifest, indexes and cover count the same segments."""
    segments, levels = manifest.counts.segments, manifest.levels
    for name, index in indexes.items():
        if len(index) != segments * levels:
            key = manifest.encodings[name].index
            raise DamagedSceneError(
                manifest.files[key].path,
                f"{len(index)} segments, expected {segments * levels} by scene.json",
            )
    path = manifest.files[COVER].path
    if len(cover.segments) and int(cover.segments.max()) >= segments:
        raise DamagedSceneError(
            path, f"segment {int(cover.segments.max())}, expected below {segments}"
        )
