"""How large photos are, for files that do not say; and those whose photo is missing."""

from __future__ import annotations

from collections.abc import Callable

from terraport_pipeline.errors import PhotoError

__all__ = ["PhotoSize", "PhotoSizes"]

PhotoSize = Callable[[str], tuple[int, int]]
"""Width and height in pixels of the photo of a name, for formats that do not say."""


class PhotoSizes:
    """Asks how large photos are, and notes those that are missing or damaged: they are left out.

    Parameters
    ----------
    ask : PhotoSize
        Raises :class:`PhotoError` where there is no such photo.
    """

    def __init__(self, ask: PhotoSize) -> None:
        self._ask = ask
        self._missing: list[PhotoError] = []

    def of(self, name: str) -> tuple[int, int] | None:
        """Width and height of a photo, pixels; None where it is left out."""
        try:
            return self._ask(name)
        except PhotoError as error:
            self._missing.append(error)
            return None

    @property
    def left_out(self) -> int:
        """Number of photos that are left out."""
        return len(self._missing)

    def check(self, kept: int) -> None:
        """Refuse a file that no photo is left of.

        Raises
        ------
        PhotoError
            The first of them.
        """
        if self._missing and not kept:
            raise self._missing[0]

    def warnings(self, count: int) -> list[str]:
        """Say how many of `count` photos are left out, and the first; nothing where none is."""
        if not self._missing:
            return []
        missing = f"{len(self._missing):,} of {count:,} photos are left out"
        return [f"{missing}; the first: {self._missing[0]}."]
