"""``terraport mv`` and ``terraport rm``: scenes with all that belongs to them.

What belongs to a scene in a folder: its directory (versions, labels, report) and the work directory
that its builds keep beside it. Both go together, under the lock that a build holds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from terraport_pipeline.errors import OptionError
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.workdir import is_work_directory
from terraport_store import (
    DamagedSceneError,
    PublishError,
    SceneNotFoundError,
    is_url,
    meant_url,
    needing_obstore,
    read_manifest,
)
from terraport_store.layout import MANIFEST_NAME, VERSION_FOLDER
from terraport_store.publishing import PublishLock
from terraport_store.scene_folder import (
    folder_bytes,
    foreign_entries,
    move_folder,
    remove_folder,
    sweep_unfinished,
)

__all__ = ["Moved", "Owned", "move_scene", "owned_by", "remove_scene", "target_of"]


@dataclass(frozen=True, slots=True)
class Moved:
    """What a move did."""

    target: str
    has_work: bool = False
    was_copied: bool = False
    """To another disk, or through this machine: it took its time."""
    kept_objects: int = 0
    """That an interrupted move had brought there."""


@dataclass(frozen=True, slots=True)
class Owned:
    """What a removal takes away."""

    location: str
    scene_bytes: int
    """0 where only the work directory goes."""
    work_bytes: int


def target_of(source: str, target: str) -> str:
    """Return where a scene moves to: into a folder that is there, under its own name, as mv(1)."""
    if is_url(target):
        name = source.rstrip("/").rpartition("/")[2]
        return f"{target}{name}" if target.endswith("/") else target
    path = Path(target)
    if path.is_dir() and not (path / MANIFEST_NAME).is_file():
        return str(path / Path(source).absolute().name)
    return target


def move_scene(source: str, target: str, progress: Progress | None = None) -> Moved:
    """Move a scene, or give it another name.

    Parameters
    ----------
    source, target : str
        Two paths, or two addresses; :func:`target_of` has been asked.
    progress : Progress, optional
        A step of bytes, where they have to be copied.

    Returns
    -------
    Moved

    Raises
    ------
    SceneNotFoundError
        No scene at the source.
    OptionError
        One is a path and the other an address, or the target's folder is missing.
    PublishError
        Something is at the target; nothing was done.
    BuildLockedError, SceneBusyError
        A build or another program writes to one of them.
    """
    if is_url(source) != is_url(target):
        far, near = (source, target) if is_url(source) else (target, source)
        raise OptionError(
            f"{far} is in object storage and {near} on this machine; terraport upload brings a "
            "scene there, terraport rm takes the other away"
        )
    progress = progress or NullProgress()
    if is_url(source):
        return _move_objects(source, target, progress)
    _require_path(source)
    _require_path(target)
    return _move_folder(Path(source), Path(target), progress)


def owned_by(location: str, *, only_work: bool) -> Owned:
    """Look at what a removal would take away, and whether it may.

    Parameters
    ----------
    location : str
        Path or address of a scene.
    only_work : bool
        Only its work directory; there need not be a scene then.

    Raises
    ------
    SceneNotFoundError
        No scene there, or with `only_work` no work directory.
    OptionError
        It holds other files, is a link, or has no work directory because it is in storage.
    """
    if is_url(location):
        if only_work:
            raise OptionError(
                f"{location}: builds keep no work in object storage, leave out --work"
            )
        with needing_obstore(location):
            from terraport_store.object_scene import scene_objects
        return Owned(location, sum(one.size for one in scene_objects(location)), 0)
    _require_path(location)
    path = Path(location)
    work = _work_of(path)
    work_bytes = 0 if work is None else folder_bytes(work)
    if only_work:
        if work is None:
            raise OptionError(
                f"{location} has no work directory: there is no {default_work_directory(path)} "
                "of a build"
            )
        return Owned(location, 0, work_bytes)
    _require_scene(path)
    others = foreign_entries(path)
    if others:
        raise OptionError(
            f"{location} holds other files ({others[0]}), expected nothing but the scene; move "
            "them away first"
        )
    return Owned(location, folder_bytes(path), work_bytes)


def remove_scene(location: str, *, only_work: bool) -> int:
    """Remove a scene with its work directory, or the latter alone.

    Parameters
    ----------
    location, only_work
        As for :func:`owned_by`, which is asked again under the lock.

    Returns
    -------
    int
        Bytes that are free now.

    Raises
    ------
    SceneNotFoundError, OptionError
        As :func:`owned_by`.
    BuildLockedError, SceneBusyError
        A build or another program writes to it.
    """
    if is_url(location):
        owned_by(location, only_work=only_work)
        from terraport_store.object_scene import remove_objects

        return remove_objects(location)[1]
    _require_path(location)
    path = Path(location).absolute()
    if not path.parent.is_dir():
        raise SceneNotFoundError(location)
    with scene_locked(path):
        swept = sweep_unfinished(path) + sweep_unfinished(default_work_directory(path))
        owned_by(location, only_work=only_work)
        freed = 0
        if not only_work:
            with _unpublished(path):
                freed = remove_folder(path)
        work = _work_of(path)
        return swept + freed + (0 if work is None else remove_folder(work))


def _move_folder(source: Path, target: Path, progress: Progress) -> Moved:
    source, target = source.absolute(), target.absolute()
    # (1) What can be refused without a lock, in the order in which people would see to it.
    _require_scene(source)
    if not target.parent.is_dir():
        raise OptionError(f"there is no folder {target.parent} to move {source.name} into")
    outer = next((up for up in target.parents if (up / MANIFEST_NAME).is_file()), None)
    if outer is not None and outer != source:
        raise OptionError(f"{outer} is a scene itself, expected a folder of scenes")
    if source == target:
        raise OptionError(f"{source} and {target} are one scene, expected another name or folder")
    if target.is_relative_to(source):
        raise OptionError(f"{target} lies in {source} itself, expected another folder")
    # (2) Neither is built now. In the order of names, so that two moves cannot wait in a ring;
    # they do not wait at all.
    with _locked(*sorted((source, target))):
        for path in (target, default_work_directory(target)):
            sweep_unfinished(path)
            if path.exists():
                what = f"a scene is at {path}" if path == target else f"{path} is there"
                raise PublishError(f"{what}, expected nothing; remove it first (terraport rm)")
        work = _work_of(source)
        # (3) The scene first: without its work directory it is whole, and not the other way round.
        size = folder_bytes(source) + (0 if work is None else folder_bytes(work))
        with _unpublished(source), _copying(progress, size) as advance:
            was_copied = move_folder(source, target, advance)
            if work is not None:
                move_folder(work, default_work_directory(target), advance)
    return Moved(str(target), work is not None, was_copied)


def _move_objects(source: str, target: str, progress: Progress) -> Moved:
    if source.rstrip("/") == target.rstrip("/"):
        raise OptionError(f"{source} and {target} are one scene, expected another address")
    with needing_obstore(source):
        from terraport_store.object_scene import move_objects
    with _copying(progress, None) as advance:
        moved = move_objects(source, target, progress=advance)
    return Moved(target, was_copied=True, kept_objects=moved.kept)


@contextmanager
def _copying(progress: Progress, total: int | None) -> Iterator[Callable[[int], None]]:
    """Give what shows bytes; the step begins with the first of them, if there are any."""
    has_begun = False

    def advance(count: int) -> None:
        nonlocal has_begun
        if not has_begun:
            progress.start("move", total, "bytes")
            has_begun = True
        progress.advance(count)

    yield advance
    if has_begun:
        progress.done({})


@contextmanager
def _locked(*scenes: Path) -> Iterator[None]:
    first, second = scenes
    with scene_locked(first), scene_locked(second):
        yield


@contextmanager
def _unpublished(scene: Path) -> Iterator[None]:
    """Keep labels and programs that publish without a build from writing meanwhile."""
    lock = PublishLock(scene)
    try:
        yield
    finally:
        lock.release()


def _require_path(location: str) -> None:
    """Refuse an address with one slash, before it is made absolute."""
    if meant_url(location) is not None:
        raise SceneNotFoundError(location)


def _require_scene(path: Path) -> None:
    """Refuse what is no scene itself: a folder of scenes, a link to one, anything else."""
    if path.is_symlink():
        raise OptionError(f"{path} is a link, expected the scene itself: {path.resolve()}")
    try:
        read_manifest(path)
    except DamagedSceneError:
        # A manifest that cannot be read is one all the same where versions lie beside it.
        if not any(VERSION_FOLDER.fullmatch(entry.name) for entry in path.iterdir()):
            raise


def _work_of(scene: Path) -> Path | None:
    work = default_work_directory(scene)
    return work if is_work_directory(work) and not work.is_symlink() else None
