"""A scene's folder as a whole: what is in it, how large it is, moved, removed.

A move or a removal is one rename for whoever reads meanwhile: the scene is there whole, or it is
not. What is copied to another disk, and what is being deleted, has a hidden name until it is done
(:data:`UNFINISHED`); the next move or removal of that name sweeps it.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from terraport_store.errors import PublishError
from terraport_store.layout import (
    LABELS,
    MANIFEST_NAME,
    STAGING,
    STROKES,
    STROKES_LOCK,
    TAUGHT,
    VERSION_FOLDER,
)
from terraport_store.publishing import out_of_space_named, require_space, sync_folder

__all__ = [
    "RECORDS",
    "folder_bytes",
    "foreign_entries",
    "move_folder",
    "remove_folder",
    "sweep_unfinished",
]

RECORDS: Final = re.compile(r"build\.json|report\.[a-z]{1,8}|\..*\.tmp")
"""What a build and its report write beside the manifest."""

UNFINISHED: Final = r"\.{name}\.[0-9a-f]{{16}}\.moved\.tmp"

_COPY_BYTES: Final = 8 << 20

CopyProgress = Callable[[int], None]
"""Called with bytes that were copied since it was last called."""


def folder_bytes(path: Path) -> int:
    """Add up the files below a folder; what vanishes meanwhile counts nothing, nor do links."""
    total = 0
    for root, _, names in os.walk(path):
        for name in names:
            with suppress(OSError):
                total += Path(root, name).lstat().st_size
    return total


def foreign_entries(scene_dir: Path) -> list[str]:
    """Names in a scene directory that are no part of a scene, ascending."""
    own = {MANIFEST_NAME, LABELS, STROKES, STROKES_LOCK, TAUGHT}
    return sorted(
        entry.name
        for entry in scene_dir.iterdir()
        if entry.name not in own
        and not any(form.fullmatch(entry.name) for form in (VERSION_FOLDER, STAGING, RECORDS))
    )


def remove_folder(path: Path) -> int:
    """Delete a folder; it is gone for readers at once, and then file by file.

    Returns
    -------
    int
        Bytes of its files.
    """
    size = folder_bytes(path)
    hidden = _hidden(path)
    path.rename(hidden)
    sync_folder(path.parent)
    shutil.rmtree(hidden)
    return size


def move_folder(source: Path, target: Path, progress: CopyProgress | None = None) -> bool:
    """Move a folder: by a rename, or to another disk by a copy beside the target.

    Parameters
    ----------
    source : Path
    target : Path
        Does not exist; its parent does.
    progress : callable, optional
        Called while files are copied.

    Returns
    -------
    bool
        Whether it was copied.

    Raises
    ------
    PublishError
        The target exists.
    OutOfSpaceError
        The other disk is full; the source stands, and nothing is at the target.
    """
    if target.exists():
        raise PublishError(f"{target} exists, expected nothing there")
    try:
        source.rename(target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
    else:
        sync_folder(target.parent)
        sync_folder(source.parent)
        return False
    # (1) Another disk: all of it under a hidden name, on the disk before it is seen.
    require_space(target.parent, folder_bytes(source))
    hidden = _hidden(target)
    try:
        with out_of_space_named(target.parent):
            _copy(source, hidden, progress or (lambda _bytes: None))
        # (2) Seen at the target, then no more at the source.
        hidden.rename(target)
    except BaseException:
        shutil.rmtree(hidden, ignore_errors=True)
        raise
    sync_folder(target.parent)
    remove_folder(source)
    return True


def sweep_unfinished(path: Path) -> int:
    """Delete what a move or a removal of this name left that was killed; return its bytes."""
    form = re.compile(UNFINISHED.format(name=re.escape(path.name)))
    size = 0
    if path.parent.is_dir():
        for entry in list(path.parent.iterdir()):
            if form.fullmatch(entry.name):
                size += folder_bytes(entry)
                shutil.rmtree(entry, ignore_errors=True)
    return size


def _hidden(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(8)}.moved.tmp")


def _copy(source: Path, target: Path, progress: CopyProgress) -> None:
    """Copy a folder with times and links as they are, and wait until it is on the disk."""
    target.mkdir()
    for entry in list(source.iterdir()):
        copy = target / entry.name
        if entry.is_symlink():
            copy.symlink_to(entry.readlink())
        elif entry.is_dir():
            _copy(entry, copy, progress)
        else:
            with entry.open("rb") as read, copy.open("xb") as written:
                while block := read.read(_COPY_BYTES):
                    written.write(block)
                    progress(len(block))
                written.flush()
                os.fsync(written.fileno())
            shutil.copystat(entry, copy)
    shutil.copystat(source, target)
    sync_folder(target)
