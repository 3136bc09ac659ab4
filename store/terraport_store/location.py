"""Where a scene lies: a path, or an address in object storage, and which files that means."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from terraport_store.addresses import is_url
from terraport_store.errors import OriginError
from terraport_store.files import FolderFiles, SceneFiles

__all__ = ["REACH_S", "needing_obstore", "scene_files"]

REACH_S: Final = 2.5
"""Patience until storage has answered once, seconds: no attempt begins later, none takes longer.
Whoever waits for it is told within twice that; a landing's patience is another."""


def scene_files(location: str | Path | SceneFiles) -> SceneFiles:
    """Return the files of a scene by path, address, or as they are.

    Raises
    ------
    OriginError
        When an address cannot be used, or the package for it is not installed.
    """
    if isinstance(location, str) and is_url(location):
        return _object_files(location)
    if isinstance(location, str | Path):
        return FolderFiles(Path(location))
    return location


@contextmanager
def needing_obstore(url: str) -> Iterator[None]:
    """Say of an address that is asked for in the block what to install, where it is missing.

    Raises
    ------
    OriginError
        The package for object storage cannot be imported.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name != "obstore":
            raise
        what = "needs the package obstore; install it with: pip install 'terraport[s3]'"
        raise OriginError(url, what) from None


def _object_files(url: str) -> SceneFiles:
    with needing_obstore(url):
        from terraport_store.object_files import ObjectStorage
    storage = ObjectStorage()
    try:
        storage.reach(url, REACH_S)
        return storage.files(url, owned=True)
    except BaseException:
        storage.close()
        raise
