"""How far a build is, said beside its scene too, where the service that lists it reads it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from terraport_pipeline.progress import Progress
from terraport_store import end_building, say_building

__all__ = ["announced"]

_PERIOD_S: Final = 1.0
"""As often as the service looks."""


@contextlib.contextmanager
def announced(scene: Path, name: str, progress: Progress) -> Iterator[Progress]:
    """Announce a scene as being built while the block runs.

    Parameters
    ----------
    scene : Path
        Directory of the scene; the folder that it is in must exist.
    name : str
        The scene's name for people.
    progress : Progress
        Is told what the yielded one is told.

    Yields
    ------
    Progress
        For the build. A folder that refuses the announcement costs the announcement alone.
    """
    try:
        yield _Announced(scene, name, progress)
    finally:
        end_building(scene)


class _Announced:
    """Passes everything on, and says it once a second."""

    def __init__(self, scene: Path, name: str, progress: Progress) -> None:
        self._scene, self._name, self._progress = scene, name, progress
        self._step = ""
        self._total: float | None = None
        self._amount = 0.0
        self._due_s = 0.0

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Begin a step; see :meth:`Progress.start`."""
        self._step, self._total, self._amount = stage, total, 0.0
        self._say()
        self._progress.start(stage, total, unit)

    def advance(self, n: float) -> None:
        """Add `n` units to the step that runs."""
        self._amount += n
        self._say()
        self._progress.advance(n)

    def done(self, facts: Mapping[str, object]) -> None:
        """End the step."""
        self._progress.done(facts)

    def _say(self) -> None:
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _PERIOD_S
        share = None if not self._total else min(1.0, max(0.0, self._amount / self._total))
        with contextlib.suppress(OSError):
            say_building(self._scene, self._name, self._step, share)
