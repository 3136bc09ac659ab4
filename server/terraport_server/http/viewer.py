"""The viewer as it was built: its files in memory, and which form of each a client takes.

The build writes compressed twins (``NAME.br``, ``NAME.gz``) beside what they make smaller; nothing
is compressed while serving. All files are read once, at the start: 2 MB, and a request can name
nothing that was not there then.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import xxhash

__all__ = ["BUILT_PAGE", "PageFile", "ViewerPage", "chosen_coding"]

BUILT_PAGE: Final = Path(__file__).parents[1] / "page"
"""Where ``client_sdk/web`` builds to, and a wheel brings it."""

INDEX: Final = "index.html"
ASSETS: Final = "assets/"
"""What lies there has a hash of its content in its name."""

_CODINGS: Final = (("br", ".br"), ("gzip", ".gz"))
"""Content codings, the smallest first, and how the files that hold them end."""

_MEDIA_TYPES: Final = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".ico": "image/x-icon",
    ".jpg": "image/jpeg",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
}
"""Of our own: the tables of operating systems differ, and ``nosniff`` makes that an error."""


@dataclass(frozen=True, slots=True)
class PageFile:
    """One file of the page: plain, and compressed by each coding that the build made."""

    name: str
    """Path below the page's folder, with slashes."""
    media_type: str
    digest: str
    """XXH3-64 of the file itself, hexadecimal."""
    forms: Mapping[str, bytes]
    """Bytes by content coding; "" is the file itself."""

    @property
    def is_fixed(self) -> bool:
        """Whether its name says its content, so that it can be kept for ever."""
        return self.name.startswith(ASSETS)

    def etag(self, coding: str) -> str:
        """Return the strong entity tag of a form, quotes included."""
        return f'"{self.digest}-{coding}"' if coding else f'"{self.digest}"'


class ViewerPage:
    """The viewer as built: every file by its path.

    Parameters
    ----------
    files
        All of it; one is ``index.html``.
    """

    def __init__(self, files: Iterator[PageFile]) -> None:
        self._files = {file.name: file for file in files}
        self.index = self._files[INDEX]

    @classmethod
    def read(cls, folder: Path) -> ViewerPage | None:
        """Read what was built into `folder`; None where nothing was."""
        if not (folder / INDEX).is_file():
            return None
        return cls(_read(folder))

    def find(self, name: str) -> PageFile | None:
        """Return a file by its path below the folder; None where there was none at the start."""
        return self._files.get(name)


def chosen_coding(accepted: str | None, available: Collection[str]) -> str:
    """Return the content coding to answer with (RFC 9110, 12.5.3).

    Parameters
    ----------
    accepted
        ``Accept-Encoding``; None where the request has none.
    available
        Codings that there are; "" always is.

    Returns
    -------
    str
        The first of ours that the client takes; "" for the file itself. Which of several a client
        would rather have is not asked: the smaller is better for both.
    """
    taken: dict[str, bool] = {}
    for entry in (accepted or "").lower().split(","):
        coding, _, parameters = entry.partition(";")
        weight = parameters.replace(" ", "").removeprefix("q=")
        taken[coding.strip()] = not weight or weight.strip("0.") != ""
    for coding, _ in _CODINGS:
        if coding in available and taken.get(coding, taken.get("*", False)):
            return coding
    return ""


def _read(folder: Path) -> Iterator[PageFile]:
    endings = {ending for _, ending in _CODINGS}
    for path in sorted(folder.rglob("*")):
        names = path.relative_to(folder).parts
        # Names with a dot in front are notes of the build's own.
        if path.suffix in endings or not path.is_file() or any(p.startswith(".") for p in names):
            continue
        data = path.read_bytes()
        forms = {"": data}
        for coding, ending in _CODINGS:
            twin = path.with_name(path.name + ending)
            if twin.is_file():
                forms[coding] = twin.read_bytes()
        media_type = _MEDIA_TYPES.get(path.suffix, "application/octet-stream")
        yield PageFile("/".join(names), media_type, xxhash.xxh3_64_hexdigest(data), forms)
