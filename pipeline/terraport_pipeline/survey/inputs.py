"""Paths and patterns of a survey's input files."""

from __future__ import annotations

import re
from pathlib import Path

from terraport_pipeline.errors import SurveyError

__all__ = ["expand_input", "natural_order"]


def expand_input(given: Path) -> list[Path]:
    """Return the files and folders that a path or a pattern names, in natural order.

    Raises
    ------
    SurveyError
        The file does not exist, no file matches, or the path is a URL.
    """
    if given.exists():
        return [given]
    if re.match(r"\w+:/", str(given)):
        from terraport_store import meant_url  # slow to import, and URLs are rare

        url = meant_url(given)
        if url is not None:
            raise SurveyError(
                f"{url} is an address; surveys are read from this machine: download it first"
            )
    anchor = given
    while re.search(r"[*?\[]", str(anchor)):
        anchor = anchor.parent
    if anchor == given:
        raise SurveyError(f"{given}: no such file or folder")
    paths = list(anchor.glob(str(given.relative_to(anchor))))
    if not paths:
        raise SurveyError(f"no file matches {given}; check the folder and the ending")
    return sorted(paths, key=lambda path: natural_order(str(path)))


def natural_order(name: str) -> list[tuple[int, int, str]]:
    """Return a sort key that orders numbers in names by value.

    Examples
    --------
    >>> sorted(["t10", "t9", "a"], key=natural_order)
    ['a', 't9', 't10']
    """
    pieces = re.split(r"([0-9]+)", name)
    return [(0, int(p), "") if i % 2 else (1, 0, p) for i, p in enumerate(pieces)]
