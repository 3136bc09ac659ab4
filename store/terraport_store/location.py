"""Where a scene lies: a path, or an address in object storage, and which files that means."""

from __future__ import annotations

from pathlib import Path

from terraport_store.addresses import is_url
from terraport_store.errors import OriginError
from terraport_store.files import FolderFiles, SceneFiles

__all__ = ["scene_files"]


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


def _object_files(url: str) -> SceneFiles:
    try:
        from terraport_store.object_files import ObjectStorage
    except ModuleNotFoundError as missing:
        if missing.name != "obstore":
            raise
        what = "needs the package obstore; install it with: pip install 'terraport[s3]'"
        raise OriginError(url, what) from None
    storage = ObjectStorage()
    try:
        return storage.files(url, owned=True)
    except BaseException:
        storage.close()
        raise
