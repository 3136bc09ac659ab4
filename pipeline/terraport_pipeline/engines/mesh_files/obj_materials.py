"""Material libraries beside an OBJ: which image, or which colour, each material has.

A file that a library names and that is not there is no error yet: whoever needs the image says so,
with the line that names it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from terraport_pipeline.errors import ReadError

__all__ = ["ObjMaterial", "obj_companions", "read_materials"]

_LIBRARY: Final = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_MAX_LIBRARY_BYTES: Final = 16 << 20
"""Largest material library: a hundred thousand materials."""

_CHANNELS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class ObjMaterial:
    """What colours the faces of one material."""

    name: str
    """Empty for faces before the first ``usemtl``."""
    image: Path | None = None
    """``map_Kd``, where that file is there."""
    colour: tuple[int, int, int] | None = None
    """``Kd``, 0 to 255, where it is stated."""
    missing: ReadError | None = None
    """Why there is no image although the file means one."""


def read_materials(path: Path, libraries: Sequence[tuple[int, str]]) -> dict[str, ObjMaterial]:
    """Read the libraries of an OBJ.

    Parameters
    ----------
    path : Path
        The OBJ.
    libraries : sequence of (int, str)
        Line and name of each ``mtllib``.

    Returns
    -------
    dict of str to ObjMaterial
        By name. Under the empty name what is missing where a whole library is.
    """
    found: dict[str, ObjMaterial] = {}
    for line, name in libraries:
        library = _beside(path, name)
        if library is None or library.stat().st_size > _MAX_LIBRARY_BYTES:
            reason = "is not beside it" if library is None else "is too large for one"
            found[""] = ObjMaterial(
                "",
                missing=ReadError(
                    path, f"its material library {name} {reason}", "copy it there with its images",
                    f"line {line:,}",
                ),
            )  # fmt: skip
            continue
        found |= {material.name: material for material in _materials(path, library)}
    return found


def obj_companions(path: Path) -> tuple[Path, ...]:
    """List the libraries and images that an OBJ is read with, each once."""
    names = _LIBRARY.findall(path.read_bytes())
    libraries = [(0, name.decode("utf-8", "replace")) for name in names]
    files = [library for _, name in libraries if (library := _beside(path, name)) is not None]
    images = [m.image for m in read_materials(path, libraries).values() if m.image is not None]
    return tuple(dict.fromkeys([*files, *images]))


def _materials(path: Path, library: Path) -> Iterator[ObjMaterial]:
    name: str | None = None
    image: Path | None = None
    colour: tuple[int, int, int] | None = None
    missing: ReadError | None = None
    text = library.read_text(encoding="utf-8-sig", errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if word == "newmtl":
            if name is not None:
                yield ObjMaterial(name, image, colour, missing)
            name, image, colour, missing = rest, None, None, None
        elif word == "Kd":
            colour = _colour(rest)
        elif word == "map_Kd" and rest:
            # The whole rest is the name where there is such a file; else options stand before it.
            image = _beside(path, rest) or _beside(path, rest.split()[-1])
            if image is None:
                missing = ReadError(
                    library, f"the texture {rest.split()[-1]} of material {name} is not there",
                    "copy it beside the OBJ", f"line {number:,}",
                )  # fmt: skip
    if name is not None:
        yield ObjMaterial(name, image, colour, missing)


def _colour(text: str) -> tuple[int, int, int] | None:
    try:
        red, green, blue = (
            round(min(max(float(word), 0.0), 1.0) * 255.0) for word in text.split()[:_CHANNELS]
        )
    except ValueError:  # not three, or no numbers
        return None
    return red, green, blue


def _beside(path: Path, name: str) -> Path | None:
    """Find a named file below the OBJ's folder, or by its bare name in it; None elsewhere.

    A name never leads outside that folder: what is written there is not ours.
    """
    given = PurePosixPath(name.replace("\\", "/"))
    within = not given.is_absolute() and ".." not in given.parts
    for candidate in (given if within else given.name, given.name):
        file = path.parent / candidate
        if given.name and file.is_file():
            return file
    return None
