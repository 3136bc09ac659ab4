"""Material libraries of an OBJ: the image or colour of each material.

A missing image file is not an error here. The error is raised where the image is needed, with the
line that names it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final

from terraport_pipeline.errors import ReadError

__all__ = ["ObjMaterial", "decode_text", "find_beside", "obj_companions", "read_materials"]

_LIBRARY: Final = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_OPTION: Final = re.compile(
    r"-([a-z]+)((?:\s+(?:[-+]?[0-9.]+(?:e[-+]?[0-9]+)?|on|off|[rgbmlz])(?=\s)){1,3})\s+",
    re.IGNORECASE,
)
"""An option before the file name of ``map_Kd``, with its values."""
_UNCHANGED: Final = {"o": {"0"}, "s": {"1"}, "t": {"0"}, "mm": {"0", "1"}, "cc": {"off"}}
"""Values with which an option that moves, scales or changes an image has no effect."""
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
    has_mask: bool = False
    """True if it has an opacity map (``map_d``), which is not read."""


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
    for line, text in libraries:
        for name in _library_names(path, text):
            library = find_beside(path, name)
            if library is None or library.stat().st_size > _MAX_LIBRARY_BYTES:
                reason = "is not beside it" if library is None else "is too large for one"
                found[""] = ObjMaterial(
                    "",
                    missing=ReadError(
                        path, f"its material library {name} {reason}",
                        "copy it there with its images", f"line {line:,}",
                    ),
                )  # fmt: skip
                continue
            found |= {material.name: material for material in _materials(path, library)}
    return found


def obj_companions(path: Path) -> tuple[Path, ...]:
    """List the libraries and images that an OBJ is read with, each once."""
    texts = [decode_text(name) for name in _LIBRARY.findall(path.read_bytes())]
    names = [name for text in texts for name in _library_names(path, text)]
    files = [library for name in names if (library := find_beside(path, name)) is not None]
    materials = read_materials(path, [(0, text) for text in texts]).values()
    images = [material.image for material in materials if material.image is not None]
    return tuple(dict.fromkeys([*files, *images]))


def _library_names(path: Path, text: str) -> list[str]:
    """Split an ``mtllib`` line into one name, which may contain blanks, or several."""
    words = text.split()
    if len(words) < 2 or find_beside(path, text) is not None:
        return [text]
    # If no file has this name, it is still a single name, unless a part of it names a file.
    return words if any(find_beside(path, word) is not None for word in words) else [text]


def _materials(path: Path, library: Path) -> Iterator[ObjMaterial]:
    material: ObjMaterial | None = None
    text = decode_text(library.read_bytes())
    for number, line in enumerate(text.splitlines(), 1):
        word, *more = line.split(maxsplit=1)[:2] or [""]
        word, rest = word.lower(), "".join(more).strip()
        if word == "newmtl":
            if material is not None:
                yield material
            material = ObjMaterial(rest)
        elif material is None or not rest:
            continue
        elif word == "kd":
            material = replace(material, colour=_colour(rest))
        elif word == "map_d":
            material = replace(material, has_mask=True)
        elif word == "map_kd":
            image, reason = _image(path, rest)
            missing = None
            if reason:
                missing = ReadError(
                    library, f"the texture {reason[0]} of material {material.name} {reason[1]}",
                    reason[2], f"line {number:,}",
                )  # fmt: skip
            material = replace(material, image=image, missing=missing)
    if material is not None:
        yield material


def _image(path: Path, text: str) -> tuple[Path | None, tuple[str, str, str] | None]:
    """Find the image that ``map_Kd`` names, or return its name, the reason and advice."""
    # If a file has the whole text as its name, that is the image; else options precede the name.
    whole = find_beside(path, text)
    if whole is not None:
        return whole, None
    name = text
    while (option := _OPTION.match(name)) is not None:
        values = [_plain_number(value) for value in option[2].lower().split()]
        if not _UNCHANGED.get(option[1].lower(), set(values)).issuperset(values):
            what = f"is moved, scaled or changed (-{option[1]}{option[2]})"
            return None, (text, what, "export it again with its coordinates applied")
        name = name[option.end() :]
    # After unknown options, the last word is the name.
    image = find_beside(path, name) or find_beside(path, name.split()[-1])
    return image, None if image else (name, "is not there", "copy it beside the OBJ")


def _plain_number(word: str) -> str:
    try:
        return f"{float(word):g}"
    except ValueError:
        return word


def _colour(text: str) -> tuple[int, int, int] | None:
    try:
        red, green, blue = (
            round(min(max(float(word), 0.0), 1.0) * 255.0) for word in text.split()[:_CHANNELS]
        )
    except ValueError:  # not three, or no numbers
        return None
    return red, green, blue


def decode_text(data: bytes) -> str:
    """Decode UTF-8, else the encoding of older Windows programs."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def find_beside(path: Path, name: str) -> Path | None:
    """Find a named file below a mesh's folder, or by its bare name in it; None elsewhere.

    Case is ignored unless two names differ only in case, since Windows, where many of these files
    are written, ignores it. A name never leads outside the folder.
    """
    given = PurePosixPath(name.strip().strip('"').replace("\\", "/"))
    within = not given.is_absolute() and ".." not in given.parts
    for candidate in (given if within else PurePosixPath(given.name), PurePosixPath(given.name)):
        file = path.parent / candidate
        if given.name and file.is_file():
            return file
    for candidate in (given if within else PurePosixPath(given.name), PurePosixPath(given.name)):
        folder = path.parent
        for part in candidate.parts:
            wanted = unicodedata.normalize("NFC", part).casefold()
            like = [
                entry
                for entry in (folder.iterdir() if folder.is_dir() else ())
                if unicodedata.normalize("NFC", entry.name).casefold() == wanted
            ]
            folder = like[0] if len(like) == 1 else folder / part
        if given.name and folder.is_file():
            return folder
    return None
