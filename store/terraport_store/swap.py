"""Make a staged version the published one."""

from __future__ import annotations

import shutil
from pathlib import Path

from terraport_store.errors import DamagedSceneError, SceneNotFoundError
from terraport_store.manifest import FileInfo, Manifest
from terraport_store.opening import read_manifest
from terraport_store.publishing import hash_file, remove_versions, replace_manifest, sync_folder

__all__ = ["swap_in"]


def swap_in(scene_dir: Path, staging: Path, unnamed: Manifest) -> Manifest:
    """Rename the staging folder and replace ``scene.json``: the publication itself.

    Parameters
    ----------
    scene_dir : Path
        Locked by the caller.
    staging : Path
        Holds every file of the new version, synced.
    unnamed : Manifest
        With its version; the folder in its files' paths is put right here.

    Returns
    -------
    Manifest
        As published. The version before it is kept, older ones are deleted.

    Raises
    ------
    OSError
        When the disk does not take it; the old version then stands.
    """
    before = _published_folder(scene_dir)
    name, there = _folder_for(scene_dir, unnamed)
    files = {
        key: file.model_copy(update={"path": f"{name}/{key}"})
        for key, file in unnamed.files.items()
    }
    manifest = unnamed.model_copy(update={"files": files})
    folder = scene_dir / name
    try:
        if there:
            shutil.rmtree(staging)
        else:
            staging.rename(folder)
            sync_folder(scene_dir)
        replace_manifest(scene_dir, manifest.to_bytes())
    except BaseException:
        if not there and _published_folder(scene_dir) != name:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    if before != name:
        remove_versions(scene_dir, keep={name} if before is None else {name, before})
    return manifest


def _published_folder(scene_dir: Path) -> str | None:
    """Name the folder published now; None for none, or for a manifest that cannot be read."""
    try:
        return read_manifest(scene_dir).folder
    except (SceneNotFoundError, DamagedSceneError):
        return None


def _folder_for(scene_dir: Path, manifest: Manifest) -> tuple[str, bool]:
    """Choose the version's folder, and say whether its files are there already, whole.

    The same version published again keeps its folder; if that one is damaged, the new files go
    beside it under the next free number, because a folder cannot be replaced in one step.
    """
    name = f"v-{manifest.version[:12]}"
    number = 0
    while (scene_dir / name).exists():
        if all(_is_whole(scene_dir / name / key, file) for key, file in manifest.files.items()):
            return name, True
        number += 1
        name = f"v-{manifest.version[:12]}-{number}"
    return name, False


def _is_whole(path: Path, expected: FileInfo) -> bool:
    try:
        if path.stat().st_size != expected.bytes:
            return False
        return hash_file(path) == expected.xxh3
    except OSError:
        return False
