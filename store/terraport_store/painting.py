"""Strokes of a scene on disk, and what they have taught: the files beside the manifest.

Several processes may paint one scene, and teach it: each read and write of one of the two files is
under a lock of its own, for milliseconds. Nothing of a version is touched.
"""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from terraport_store.errors import SceneNotFoundError
from terraport_store.files import FolderFiles
from terraport_store.layout import (
    MAX_STROKES_BYTES,
    MAX_TAUGHT_BYTES,
    PAINTING,
    STROKES,
    STROKES_LOCK,
    TAUGHT,
)
from terraport_store.opening import read_manifest
from terraport_store.publishing import out_of_space_named, replace_file
from terraport_store.strokes import Strokes

__all__ = ["change_strokes", "read_strokes", "read_taught", "write_taught"]

_MODE: Final = 0o644


def read_strokes(scene_dir: Path, before: Strokes | None = None) -> Strokes:
    """Read what was painted on a scene; none where there is no file.

    Parameters
    ----------
    scene_dir : Path
    before : Strokes, optional
        Of an earlier reading: what is still the same is not read anew.

    Raises
    ------
    DamagedSceneError
        The file, or the manifest, is not what the format says.
    SceneNotFoundError
        There is no scene.
    """
    manifest = read_manifest(scene_dir)
    try:
        data = FolderFiles(scene_dir).read(STROKES, MAX_STROKES_BYTES)
    except FileNotFoundError:
        return Strokes()
    return Strokes.parsed(data, manifest, before)


def change_strokes(
    scene_dir: Path, change: Callable[[Strokes], Strokes], before: Strokes | None = None
) -> Strokes:
    """Change what was painted on a scene, all or nothing.

    Parameters
    ----------
    scene_dir : Path
    change : callable
        Makes the strokes before into those to be; what it raises leaves them as they are.
    before : Strokes, optional
        As of :func:`read_strokes`.

    Returns
    -------
    Strokes
        As they are now.

    Raises
    ------
    StrokeError
        They would be more than a scene may have.
    DamagedSceneError, SceneNotFoundError
        The scene, or the file, cannot be read.
    OutOfSpaceError
        The disk is full; the strokes before stand.
    """
    with _locked(scene_dir):
        manifest = read_manifest(scene_dir)
        changed = change(read_strokes(scene_dir, before))
        data = changed.encoded(manifest)
        _replace(scene_dir, STROKES, data)
        return Strokes.parsed(data, manifest, changed)


def read_taught(scene_dir: Path) -> bytes | None:
    """Read what the strokes have taught; None where there is nothing."""
    try:
        return FolderFiles(scene_dir).read(TAUGHT, MAX_TAUGHT_BYTES)
    except FileNotFoundError:
        return None


def write_taught(scene_dir: Path, data: bytes) -> None:
    """Say what the strokes have taught; at most MAX_TAUGHT_BYTES.

    Raises
    ------
    OutOfSpaceError
        The disk is full.
    """
    with _locked(scene_dir):
        _replace(scene_dir, TAUGHT, data)


def _replace(scene_dir: Path, name: str, data: bytes) -> None:
    for entry in list(scene_dir.iterdir()):
        if PAINTING.fullmatch(entry.name):
            entry.unlink()
    temporary = f".{name.partition('.')[0]}-{secrets.token_hex(8)}.tmp"
    with out_of_space_named(scene_dir):
        replace_file(scene_dir, name, temporary, data)


@contextmanager
def _locked(scene_dir: Path) -> Iterator[None]:
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        descriptor = os.open(scene_dir / STROKES_LOCK, flags, _MODE)
    except FileNotFoundError:
        raise SceneNotFoundError(str(scene_dir)) from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
