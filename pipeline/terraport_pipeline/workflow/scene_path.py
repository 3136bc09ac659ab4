"""Output path of a build's scene, checked before any work."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from terraport_pipeline.errors import OptionError
from terraport_store import meant_url
from terraport_store.layout import MANIFEST_NAME

__all__ = ["check_scene_path"]


def check_scene_path(scene: Path, inputs: Sequence[Path], *, is_default: bool) -> None:
    """Refuse a path that is no scene's, before any work; make the folder that it stands in.

    Parameters
    ----------
    scene : Path
    inputs : sequence of Path
        What was given as the survey.
    is_default : bool
        Nobody has asked for this path: it must not lie within a folder of the survey.

    Raises
    ------
    OptionError
        It is an address, a file, or a folder that holds something else, or its folder cannot be
        made; says what to give.
    """
    advice = ""
    if is_default:
        advice = f"; give the scene another path: -o {shlex.quote(f'scenes/{scene.name}')}"
    url = meant_url(scene)
    if url is not None:
        raise OptionError(
            f"{url} is an address, expected a directory of this machine; terraport upload brings "
            "the scene there"
        )
    place = scene.absolute()
    for folder in (given.resolve() for given in inputs if is_default and given.is_dir()):
        if place.resolve().is_relative_to(folder):
            raise OptionError(f"{place} lies in the survey's own folder{advice}")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(
            f"cannot make {place.parent} for the scene to stand in: {error.strerror}"
        ) from error
    if place.exists() and not place.is_dir():
        what = f"{place} is a file; expected a scene directory or nothing"
        raise OptionError(f"{what}{advice}")
    if place.is_dir() and not (place / MANIFEST_NAME).exists():
        others = [path for path in place.iterdir() if not path.name.startswith((".v-", "v-"))]
        if others:
            raise OptionError(
                f"{place} holds other files ({others[0].name}); expected a scene, or an empty or "
                f"new directory{advice}"
            )
