"""Scenes that are being built: what a build says of itself, for whoever lists its folder.

A build writes ``.NAME.building.json`` beside the scene NAME, anew while it goes on, and deletes it
at its end. A build that was killed leaves it: what has not been written for
:data:`SILENT_AFTER_S` counts as gone.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from terraport_store.files import open_regular
from terraport_store.layout import MANIFEST_NAME

__all__ = [
    "MAX_LISTED",
    "SILENT_AFTER_S",
    "SceneBuilding",
    "end_building",
    "list_building",
    "say_building",
]

SILENT_AFTER_S: Final = 300.0
"""Longer than any step of a build is silent."""

MAX_LISTED: Final = 32
"""Builds that are listed of one folder."""

_MAX_BYTES: Final = 4096
_MAX_TEXT: Final = 200
_ENDING: Final = ".building.json"


@dataclass(frozen=True, slots=True)
class SceneBuilding:
    """A scene that is being built, and how far it is."""

    id: str
    """Name of the scene's directory."""
    name: str
    """Name for people."""
    step: str
    """What is being done, as the build's bar names it."""
    share: float | None
    """Of that step, 0 to 1; None where it cannot be known."""


def say_building(scene: Path, name: str, step: str, share: float | None) -> None:
    """Say how far the build of a scene is.

    Parameters
    ----------
    scene : Path
        The scene's directory, which need not exist; the folder that it will stand in must.
    name, step, share
        As of :class:`SceneBuilding`.

    Raises
    ------
    OSError
        When the folder cannot be written to.
    """
    path = _path(scene)
    draft = path.with_name(f"{path.name}.part")
    draft.write_text(json.dumps({"name": name, "step": step, "share": share}), encoding="utf-8")
    draft.replace(path)


def end_building(scene: Path) -> None:
    """Say that the build has ended, however it did; may be called again."""
    path = _path(scene)
    for left in (path, path.with_name(f"{path.name}.part")):
        with contextlib.suppress(OSError):
            left.unlink()


def list_building(directory: Path) -> list[SceneBuilding]:
    """List the builds that said something lately, by id; at most :data:`MAX_LISTED`.

    Parameters
    ----------
    directory : Path
        A folder of scenes. One scene has none beside it that would be listed with it.

    Raises
    ------
    OSError
        When the folder cannot be read.
    """
    if (directory / MANIFEST_NAME).is_file():
        return []
    oldest = time.time() - SILENT_AFTER_S
    builds: list[SceneBuilding] = []
    for path in sorted(directory.glob(f".*{_ENDING}")):
        if len(builds) == MAX_LISTED:
            break
        build = _read(path, oldest)
        if build is not None:
            builds.append(build)
    return builds


def _path(scene: Path) -> Path:
    return scene.parent / f".{scene.name}{_ENDING}"


def _read(path: Path, oldest: float) -> SceneBuilding | None:
    """Read what one build says; None for what is silent, gone, or not written by a build."""
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            if os.fstat(file.fileno()).st_mtime < oldest:
                return None
            document: Any = json.loads(file.read(_MAX_BYTES))
        name, step, share = document["name"], document["step"], document["share"]
    except (OSError, ValueError, TypeError, KeyError):
        return None
    is_share = isinstance(share, (int, float)) and not isinstance(share, bool) and 0 <= share <= 1
    if not isinstance(name, str) or not isinstance(step, str) or not (share is None or is_share):
        return None
    scene_id = path.name[1 : -len(_ENDING)]
    return SceneBuilding(scene_id, name[:_MAX_TEXT], step[:_MAX_TEXT], share)
