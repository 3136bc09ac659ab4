"""The demo's scenes: the sample quarry, and a bench of it that comes along, there before any build.

``data/make_sample_scene.py`` makes it; a wheel has it in this package, a checkout in ``data``.
"""

from __future__ import annotations

import secrets
import shutil
from pathlib import Path
from typing import Final

from terraport_pipeline.errors import PipelineError

__all__ = [
    "QUARRY_ID",
    "QUARRY_NAME",
    "SHIPPED_ID",
    "SHIPPED_VIEW",
    "place_shipped_scene",
    "shipped_scene",
]

QUARRY_ID: Final = "quarry"
"""Name of the scene directory, and so of the scene on the server."""

QUARRY_NAME: Final = "Sample quarry"

SHIPPED_ID: Final = "bench"

SHIPPED_VIEW: Final = "at=5,1,3&radius=60&look=290,-6&view=walk"
"""Where the viewer begins in it, as its address has it: on the floor, before a face."""

_FOLDER: Final = "sample_scene"


def shipped_scene() -> Path:
    """Return where it lies.

    Raises
    ------
    PipelineError
        When the installation lacks it.
    """
    here = Path(__file__)
    for folder in (here.with_name(_FOLDER), here.parents[2] / "data" / _FOLDER):
        if folder.is_dir():
            return folder
    raise PipelineError(
        f"this installation lacks the scene that comes along ({here.with_name(_FOLDER)}); "
        "install terraport again, or python data/make_sample_scene.py makes it in a checkout"
    )


def place_shipped_scene(scenes: Path) -> Path:
    """Copy it into a folder of scenes, unless it is there; return the scene's directory.

    Raises
    ------
    PipelineError
        When the installation lacks it.
    OSError
        When the folder cannot be written to.
    """
    scene = scenes / SHIPPED_ID
    if not scene.exists():
        # Beside its name first: the service that looks at the folder must never see a part of it.
        draft = scenes / f".{SHIPPED_ID}.{secrets.token_hex(4)}.part"
        try:
            shutil.copytree(shipped_scene(), draft)
            draft.rename(scene)
        except OSError:
            shutil.rmtree(draft, ignore_errors=True)
            raise
    return scene
