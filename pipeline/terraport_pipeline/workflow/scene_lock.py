"""One build at a time per scene."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from terraport_pipeline.errors import BuildLockedError

__all__ = ["build_process", "scene_locked"]


@contextlib.contextmanager
def scene_locked(scene: Path) -> Iterator[None]:
    """Hold the lock of a scene.

    The lock is a file beside the scene, ``.<scene>.lock``; the system frees it when this process
    dies, however it dies, and it is deleted when the block ends.

    Parameters
    ----------
    scene : Path
        Need not exist; its parent must.

    Raises
    ------
    BuildLockedError
        Another process holds it.
    """
    path = _lock_path(scene)
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = _holder(descriptor)
            os.close(descriptor)
            raise BuildLockedError(
                f"another build of {scene} is running (process {holder}); wait for it"
            ) from None
        # The holder before us may have deleted the file between our open and our lock.
        with contextlib.suppress(FileNotFoundError):
            if os.fstat(descriptor).st_ino == path.stat().st_ino:
                break
        os.close(descriptor)
    try:
        os.ftruncate(descriptor, 0)
        with contextlib.suppress(OSError):  # the number is for people only; a full disk may refuse
            os.pwrite(descriptor, str(os.getpid()).encode("ascii"), 0)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)


def build_process(scene: Path) -> str | None:
    """Tell which process builds a scene now.

    Parameters
    ----------
    scene : Path

    Returns
    -------
    str or None
        Its number, or ``unknown``; None where nobody does.
    """
    try:
        descriptor = os.open(_lock_path(scene), os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        # Had for a moment only where a build was killed and left its file.
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return _holder(descriptor)
    finally:
        os.close(descriptor)
    return None


def _lock_path(scene: Path) -> Path:
    return scene.parent / f".{scene.name}.lock"


def _holder(descriptor: int) -> str:
    number = os.pread(descriptor, 32, 0).decode("ascii", "replace").strip()
    return number or "unknown"
