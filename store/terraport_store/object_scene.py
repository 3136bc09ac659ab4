"""A scene in object storage as a whole: its objects, moved, removed.

Storage knows no folders and no renames: a move is a copy of every object, ``scene.json`` last, and
then a removal, ``scene.json`` first. Readers see the scene whole at the one address, at both, or at
the other. An interrupted move goes on when it is asked for again.

Needs ``terraport[s3]``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final
from urllib.parse import urlsplit

from terraport_store.errors import PublishError, SceneNotFoundError
from terraport_store.layout import LABELS, MANIFEST_NAME, MAX_MANIFEST_BYTES, VERSION_FOLDER
from terraport_store.location import REACH_S
from terraport_store.origin import Listed, ObjectOptions, Origin
from terraport_store.scene_folder import RECORDS
from terraport_store.upload import HASH, MOST_PARTS, PART_BYTES, PART_RETRIES, TIMEOUT_S

__all__ = [
    "MovedObjects",
    "move_objects",
    "reached_origin",
    "remove_objects",
    "scene_objects",
]

_WHOLE_BYTES: Final = 4 << 30
"""Largest object that is copied by one request; S3 takes 5 GiB."""

MoveProgress = Callable[[int], None]
"""Called with bytes that are done since it was last called."""


@dataclass(frozen=True, slots=True)
class MovedObjects:
    """What a move did."""

    copied: int
    kept: int
    """Objects that an interrupted move had copied."""
    bytes: int
    """Of all objects."""


def reached_origin(url: str, options: ObjectOptions | None = None) -> Origin:
    """Ask an address for a scene's manifest, with little patience: what is wrong is said soon.

    Raises
    ------
    OriginError
        Nothing answers, or it refuses.
    """
    origin = Origin(url, replace(options or ObjectOptions(), timeout_s=REACH_S))
    origin.head(MANIFEST_NAME)
    return origin


def scene_objects(url: str, options: ObjectOptions | None = None) -> tuple[Listed, ...]:
    """List the objects of a scene, all its versions, ``scene.json`` last.

    Parameters
    ----------
    url : str
    options : ObjectOptions, optional

    Returns
    -------
    tuple of Listed
        What else lies there is not among them.

    Raises
    ------
    SceneNotFoundError
        There is no scene.json.
    OriginError
        The address cannot be listed.
    """
    origin = reached_origin(url, options)
    objects = _own(origin)
    if not objects or objects[-1].path != MANIFEST_NAME:
        raise SceneNotFoundError(url)
    return objects


def remove_objects(url: str, options: ObjectOptions | None = None) -> tuple[int, int]:
    """Delete a scene; ``scene.json`` first, so that no reader meets half of it.

    Returns
    -------
    tuple of int
        Objects and bytes that are gone.

    Raises
    ------
    SceneNotFoundError
        There is no scene.json; nothing was deleted.
    OriginError
        The storage does not take it.
    """
    objects = scene_objects(url, options)
    _delete(_origin(url, options), objects)
    return len(objects), sum(one.size for one in objects)


def move_objects(
    source_url: str,
    target_url: str,
    options: ObjectOptions | None = None,
    *,
    progress: MoveProgress | None = None,
) -> MovedObjects:
    """Move a scene within object storage, or from one to another; asked again, it goes on.

    Parameters
    ----------
    source_url, target_url : str
        Of the scene itself.
    options : ObjectOptions, optional
        Endpoint and region of both.
    progress : callable, optional

    Returns
    -------
    MovedObjects

    Raises
    ------
    SceneNotFoundError
        There is no scene at the source, and nothing that an interrupted move left.
    PublishError
        Another scene is at the target; nothing was done.
    OriginError
        The storage does not answer or refuses; the same call goes on.
    """
    reached_origin(source_url, options)
    source, target = _origin(source_url, options), _origin(target_url, options)
    # (1) What is there: nothing, this very scene (an earlier move came so far), or another.
    text, published = _manifest(source), _manifest(target)
    objects = _own(source)
    there = {one.path: one.size for one in _own(target)}
    if text is None:
        # Deleting begins with scene.json. Whatever is left here must lie there whole.
        left = {one.path: one.size for one in objects}
        if not left or published is None or not left.items() <= there.items():
            raise SceneNotFoundError(source_url)
    elif published is not None and published != text:
        raise PublishError(f"a scene is at {target_url}, expected none; remove it first")
    # (2) Copy, scene.json last: readers see the scene at the target when it is whole.
    copied = 0
    for one in objects:
        if text is not None and not _is_copied(source, target, one, there):
            _copy(source, target, one)
            copied += 1
        if progress is not None:
            progress(one.size)
    # (3) Delete, scene.json first.
    _delete(source, objects)
    return MovedObjects(copied, len(objects) - copied, sum(one.size for one in objects))


def _origin(url: str, options: ObjectOptions | None) -> Origin:
    asked = options or ObjectOptions()
    return Origin(url, replace(asked, timeout_s=TIMEOUT_S, part_retries=PART_RETRIES))


def _manifest(origin: Origin) -> bytes | None:
    try:
        return origin.get(MANIFEST_NAME, MAX_MANIFEST_BYTES)
    except FileNotFoundError:
        return None


def _own(origin: Origin) -> tuple[Listed, ...]:
    """Objects of a scene in the order in which they are copied."""
    loose = (MANIFEST_NAME, LABELS)
    own = [
        one
        for one in origin.objects()
        if one.path in loose
        or RECORDS.fullmatch(one.path)
        or VERSION_FOLDER.fullmatch(one.path.partition("/")[0])
    ]
    return tuple(sorted(own, key=lambda one: (one.path == MANIFEST_NAME, "/" not in one.path)))


def _is_copied(source: Origin, target: Origin, one: Listed, there: dict[str, int]) -> bool:
    """Whether the target has the object; of loose files only scene.json's absence is sure."""
    if "/" not in one.path or there.get(one.path) != one.size:
        return False
    digest = _hash(source, one)
    return bool(digest) and digest == _hash(target, one)


def _copy(source: Origin, target: Origin, one: Listed) -> None:
    here, there = urlsplit(source.url), urlsplit(target.url)
    is_within = (here.scheme, here.netloc) == (there.scheme, there.netloc)
    if is_within and one.size <= _WHOLE_BYTES:
        # By the storage itself: no byte comes here.
        bucket = Origin(f"{here.scheme}://{here.netloc}", source.options)
        names = (f"{address.path.strip('/')}/{one.path}" for address in (here, there))
        bucket.copy(*names)
        return
    digest = _hash(source, one)
    attributes = {HASH: digest} if digest else {}
    part_bytes = max(PART_BYTES, -(-one.size // MOST_PARTS))
    if one.size <= part_bytes:
        target.put(one.path, source.get(one.path, one.size), attributes)
    else:
        with ThreadPoolExecutor(1) as reader:
            parts = _parts(source, one, part_bytes, reader)
            target.put_parts(one.path, parts, part_bytes, attributes)


def _parts(source: Origin, one: Listed, part_bytes: int, reader: Executor) -> Iterator[bytes]:
    """Read an object part by part, the next one while the last is sent.

    In a thread: who writes asks for parts within obstore's own loop, which no other call may enter.
    """
    coming: Future[bytes] | None = None
    for offset in range(0, one.size, part_bytes):
        length = min(part_bytes, one.size - offset)
        before, coming = coming, reader.submit(source.range, one.path, offset, length)
        if before is not None:
            yield before.result()
    if coming is not None:
        yield coming.result()


def _hash(origin: Origin, one: Listed) -> str | None:
    """Return what the upload noted of the object; None where another program put it there."""
    seen = origin.head(one.path)
    return None if seen is None else seen.attributes.get(HASH)


def _delete(origin: Origin, objects: tuple[Listed, ...]) -> None:
    if objects and objects[-1].path == MANIFEST_NAME:
        origin.delete([MANIFEST_NAME])
    rest = [one.path for one in objects if one.path != MANIFEST_NAME]
    if rest:
        origin.delete(rest)
