"""Errors of the store.

::

    StoreError
    ├── SceneNotFoundError      no scene.json at that path
    ├── DamagedSceneError       a file of a published scene is not what the manifest says (``file``)
    │   └── CorruptPayloadError one segment's bytes fail their hash (``segment``, ``offset``)
    ├── RangeError              bytes asked for outside a pack
    ├── OriginError             object storage did not give what was asked for (``url``)
    ├── LabelError              labels that cannot be set; those before stand
    ├── StrokeError             a stroke that cannot be kept; those before stand
    └── PublishError            a new version could not be published; the old one stands
        ├── OutOfSpaceError     the disk (or a quota) is full
        └── SceneBusyError      another process is publishing the same scene

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from terraport_store.addresses import is_url, meant_url

__all__ = [
    "CorruptPayloadError",
    "DamagedSceneError",
    "LabelError",
    "OriginError",
    "OutOfSpaceError",
    "PublishError",
    "RangeError",
    "SceneBusyError",
    "SceneNotFoundError",
    "StoreError",
    "StrokeError",
]


_NAMED: Final = 8
"""Scenes that a message names."""


class StoreError(Exception):
    """Base of all errors of the store."""


class SceneNotFoundError(StoreError):
    """No scene at a path.

    Parameters
    ----------
    path : str
        The directory that was asked for.
    inside : sequence of str, optional
        Names of scenes in it: one of them was meant.
    """

    def __init__(self, path: str, inside: Sequence[str] = ()) -> None:
        super().__init__(_no_scene(path, inside))
        self.path = path
        self.inside = tuple(inside)


def _no_scene(path: str, inside: Sequence[str]) -> str:
    if is_url(path):
        return f"no scene at {path}, expected scene.json there"
    url = meant_url(path)
    if url is not None:
        return (
            f"{url} was taken for a path of this machine; an address has two slashes, and in "
            "Python it is a str"
        )
    more = f" and {len(inside) - _NAMED} more" if len(inside) > _NAMED else ""
    there = f"; scenes in it: {', '.join(inside[:_NAMED])}{more}" if inside else ""
    return f"no scene at {path}, expected a directory with scene.json{there}"


class DamagedSceneError(StoreError):
    """A file of a published scene is not what it should be.

    Parameters
    ----------
    file : str
        Path of the file, relative to the scene directory.
    what : str
        What was found and what was expected, lower-case, no full stop.
    offset : int, optional
        Byte offset in the file, where one is known.
    """

    def __init__(self, file: str, what: str, *, offset: int | None = None) -> None:
        super().__init__(file, what)
        self.file = file
        self.what = what
        self.offset = offset

    def __str__(self) -> str:
        at = "" if self.offset is None else f" at byte {self.offset}"
        return f"{self.file}{at}: {self.what}"


class CorruptPayloadError(DamagedSceneError):
    """One segment's bytes do not have the hash that the index names.

    Parameters
    ----------
    segment : int
        Segment id.
    offset : int
        Where the payload starts in the pack, bytes.
    expected, actual : int
        XXH3-64 by the index, and of the bytes read.
    file : str
        Path of the pack, relative to the scene directory.
    """

    def __init__(self, segment: int, offset: int, expected: int, actual: int, *, file: str) -> None:
        super().__init__(
            file,
            f"segment {segment} has hash {actual:016x}, expected {expected:016x}; "
            "restore the file or build the scene again",
            offset=offset,
        )
        self.segment = segment
        self.expected = expected
        self.actual = actual


class RangeError(StoreError):
    """Bytes asked for outside a source.

    Parameters
    ----------
    offset, length : int
        What was asked for, bytes.
    size : int
        What there is, bytes.
    """

    def __init__(self, offset: int, length: int, size: int) -> None:
        super().__init__(f"{length} bytes at {offset}, expected within 0 to {size}")
        self.offset = offset
        self.length = length
        self.size = size


class OriginError(StoreError):
    """Object storage did not give what was asked for; it may later.

    Parameters
    ----------
    url : str
        What was asked for.
    what : str
        What came instead, and how often it was tried; lower-case, no full stop.
    passing : bool, optional
        Whether another try may fare better.
    """

    def __init__(self, url: str, what: str, *, passing: bool = True) -> None:
        super().__init__(f"{url}: {what}")
        self.url = url
        self.what = what
        self.passing = passing


class StrokeError(StoreError):
    """A stroke that cannot be kept; those before stand.

    Parameters
    ----------
    what : str
        What was received and what was expected, lower-case, no full stop.
    is_full : bool
        It is good, but there is no room for it.
    """

    def __init__(self, what: str, *, is_full: bool = False) -> None:
        super().__init__(what)
        self.what = what
        self.is_full = is_full


class LabelError(StoreError):
    """Labels that cannot be set: an unknown region or a bad label; the labels before stand."""


class PublishError(StoreError):
    """A new version could not be published; what was published before is untouched."""


class OutOfSpaceError(PublishError):
    """The disk or a quota is full.

    Parameters
    ----------
    path : str
        Where it was written to.
    needed_bytes : int, optional
        What is still to be written, where it is known.
    free_bytes : int, optional
        What is free, where it is known.
    """

    def __init__(
        self, path: str, *, needed_bytes: int | None = None, free_bytes: int | None = None
    ) -> None:
        self.path = path
        self.needed_bytes = needed_bytes
        self.free_bytes = free_bytes
        if needed_bytes is None or free_bytes is None:
            text = f"no space left at {path}; nothing was published, free some space and run again"
        else:
            text = (
                f"{free_bytes} bytes free at {path}, expected at least {needed_bytes}; "
                "nothing was published, free some space and run again"
            )
        super().__init__(text)


class SceneBusyError(PublishError):
    """Another process is publishing the same scene.

    Parameters
    ----------
    path : str
        The scene directory.
    """

    def __init__(self, path: str) -> None:
        super().__init__(f"another process is publishing {path}; wait for it and run again")
        self.path = path
