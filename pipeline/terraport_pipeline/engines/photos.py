"""The photos themselves: found by name, and those left out that cannot be used.

Programs that align photos work on stored pixels and leave the orientation that EXIF states alone,
so this does too; only where the stored sides fit the lens turned by a quarter and EXIF says so, the
photo is turned.

One damaged photo must not end a build of hundreds: what is missing, cannot be opened, or has sides
that do not fit its lens is left out and named.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final, Protocol

from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize
from terraport_pipeline.engines.photo_store import (
    PhotoStore,
    exif_orientation,
    photo_size,
)
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.photos.lens import Lens, View

__all__ = [
    "OpenPhotos",
    "find_photos",
    "fit_lens",
    "named",
    "none_usable",
    "open_photos",
    "sizes_below",
]

MAX_FILES: Final = 500_000
"""Files that are looked through for photos."""

_ENDINGS: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".jp2"})

_TURNED: Final = frozenset({5, 6, 7, 8})
"""Values of EXIF's orientation that exchange the sides."""

_ASPECT_TOLERANCE: Final = 0.005
"""Sides that scale more differently than this are another photo than the lens's."""

_NAMED: Final = 5
"""Photos that a message names."""


class Named(Protocol):
    """As much of a view or camera as finding its photo needs."""

    @property
    def name(self) -> str:
        """Name of the photo as the file of cameras states it; may be a path."""
        ...


def find_photos(directory: Path, views: Iterable[Named]) -> dict[str, Path]:
    """Find the file of every view below a directory.

    Names are compared without upper and lower case, and with accents composed (macOS decomposes
    them); a view named without an ending (``DJI_0018``, as Metashape writes) matches any picture of
    that stem. Where several folders hold the same name, the one whose folders agree with the
    view's longest is taken, and of names that differ in case alone the one that is spelled alike.

    Parameters
    ----------
    directory : Path
    views : iterable of View or of anything with a name

    Returns
    -------
    dict of str to Path
        By name of the view; views without a file are not in it.

    Raises
    ------
    PhotoError
        No directory, too many files, no view has a file, or a name means several files equally.
    """
    by_name, by_stem = _index(directory)
    path_of_view: dict[str, Path] = {}
    views = list(views)
    for view in views:
        path = _look_up(view.name, by_name, by_stem)
        if path is not None:
            path_of_view[view.name] = path
    if not path_of_view:
        names = ", ".join(view.name for view in views[:_NAMED])
        raise PhotoError(
            f"none of the {len(views):,} photos that the cameras name ({names}, ..) is below "
            f"{directory}, which has {sum(map(len, by_name.values())):,} pictures; give the "
            "folder of the original photos with --photos"
        )
    return path_of_view


def _index(directory: Path) -> tuple[dict[str, list[Path]], dict[str, list[Path]]]:
    if not directory.is_dir():
        raise PhotoError(f"{directory} is not a folder; give the folder of the original photos")
    by_name: dict[str, list[Path]] = {}
    by_stem: dict[str, list[Path]] = {}
    for count, path in enumerate(directory.rglob("*")):
        if count >= MAX_FILES:
            raise PhotoError(
                f"{directory} holds more than {MAX_FILES:,} files; give the folder of the photos"
            )
        if path.suffix.lower() in _ENDINGS and path.is_file():
            by_name.setdefault(_comparable(path.name), []).append(path)
            by_stem.setdefault(_comparable(path.stem), []).append(path)
    return by_name, by_stem


_Index = dict[str, list[Path]]


def _comparable(name: str) -> str:
    """Normalise a name to lower case and composed accents, for comparison."""
    return unicodedata.normalize("NFC", name.lower())


def _look_up(stated: str, by_name: _Index, by_stem: _Index) -> Path | None:
    name = PurePosixPath(_comparable(stated.replace("\\", "/")))
    candidates = by_name.get(name.name, [])
    if not candidates and name.suffix not in _ENDINGS:
        candidates = by_stem.get(name.name, [])
    return _pick(stated, name, candidates) if candidates else None


def _pick(stated: str, name: PurePosixPath, candidates: Sequence[Path]) -> Path:
    if len(candidates) == 1:
        return candidates[0]

    spelled = stated.replace("\\", "/").rpartition("/")[2]

    def shared(path: Path) -> tuple[int, bool]:
        folders = zip(reversed(name.parent.parts), reversed(path.parent.parts), strict=False)
        count = 0
        for ours, theirs in folders:
            if ours != _comparable(theirs):
                break
            count += 1
        return count, path.name == spelled

    ranked = sorted(sorted(candidates), key=shared, reverse=True)
    if shared(ranked[0]) == shared(ranked[1]):
        raise PhotoError(
            f"photo {stated} may be {ranked[0]} or {ranked[1]}; give a folder that has it once"
        )
    return ranked[0]


def sizes_below(directory: Path | None) -> PhotoSize | None:
    """Tell how large photos are, for cameras of a format that does not say.

    Parameters
    ----------
    directory : Path or None

    Returns
    -------
    callable or None
        Takes a name, gives width and height; looks through the folder once, when first asked.
        None without a folder.
    """
    if directory is None:
        return None
    index: list[tuple[_Index, _Index]] = []

    def size(name: str) -> tuple[int, int]:
        if not index:
            index.append(_index(directory))
        path = _look_up(name, *index[0])
        if path is None:
            raise PhotoError(f"photo {name} is not below {directory}, and its size is needed")
        return photo_size(path)

    return size


@dataclass(frozen=True, slots=True)
class OpenPhotos:
    """Views that have a photo, and the photos."""

    views: tuple[View, ...]
    """Those with a file; each lens fits the stored size."""
    photos: PhotoStore
    """In the order of `views`."""
    warnings: tuple[str, ...]
    left_out: int = 0
    """Views whose photo is missing or cannot be used."""

    def only(self, kept: Sequence[int], warnings: Iterable[str]) -> OpenPhotos:
        """Leave out all but some views; of each the number."""
        return OpenPhotos(
            tuple(self.views[number] for number in kept),
            self.photos.only(kept),
            (*self.warnings, *warnings),
            self.left_out + len(self.views) - len(kept),
        )


def open_photos(views: Sequence[View], directory: Path, *, max_bytes: int) -> OpenPhotos:
    """Find the photos of all views and make each lens fit its photo.

    Parameters
    ----------
    views : sequence of View
    directory : Path
    max_bytes : int
        Bound of the decoded photos that are kept.

    Raises
    ------
    PhotoError
        No photo found, or all are damaged or of sides that do not fit their lenses.
    """
    path_of_view = find_photos(directory, views)
    kept, paths, turned, scaled = [], [], [], 0
    refused: dict[str, PhotoError] = {}
    # (1) Fit each lens to its photo's size and turn.
    for view in views:
        path = path_of_view.get(view.name)
        if path is None:
            continue
        try:
            lens, turn = fit_lens(view.lens, path)
        except PhotoError as error:
            refused[view.name] = error
            continue
        scaled += lens != view.lens
        kept.append(replace(view, lens=lens))
        paths.append(path)
        turned.append(turn)
    if not kept:
        raise none_usable(refused)
    # (2) What is missing, unusable or scaled, in words.
    warnings = []
    missing = [view.name for view in views if view.name not in path_of_view]
    if missing:
        warnings.append(
            f"{len(missing):,} of {len(views):,} photos are not below {directory} "
            f"({named(missing)}); they are left out."
        )
    if refused:
        warnings.append(
            f"{len(refused):,} of {len(views):,} photos cannot be used and are left out: "
            f"{next(iter(refused.values()))}"
        )
    if scaled:
        warnings.append(
            f"{scaled:,} photos are stored at another size than they were calibrated at; their "
            "lenses were scaled."
        )
    return OpenPhotos(
        tuple(kept), PhotoStore(paths, max_bytes, turned), tuple(warnings), len(views) - len(kept)
    )


def named(names: Sequence[str]) -> str:
    """List the first few photo names for a message, and how many more there are."""
    return ", ".join(names[:_NAMED]) + (", .." if len(names) > _NAMED else "")


def none_usable(refused: Mapping[str, PhotoError]) -> PhotoError:
    """Say that no photo is left, by the first of them."""
    return PhotoError(
        f"none of the {len(refused):,} photos can be used: {next(iter(refused.values()))}"
    )


def fit_lens(lens: Lens, path: Path) -> tuple[Lens, bool]:
    """Scale a lens to the stored size; tell whether the photo must be turned for that.

    Raises
    ------
    PhotoError
        The photo cannot be opened, or has sides that the lens does not.
    """
    width, height = photo_size(path)
    if (lens.width, lens.height) == (width, height):
        return lens, False
    orientation = exif_orientation(path)
    for turn in (False, orientation in _TURNED):
        wide, high = (height, width) if turn else (width, height)
        across, down = wide / lens.width, high / lens.height
        # a side is rounded to whole pixels, so small pictures may differ by a pixel
        if abs(across / down - 1.0) <= _ASPECT_TOLERANCE + 1.0 / min(wide, high):
            return lens.scaled(wide, high), turn
    raise PhotoError(
        f"{path} has {width} x {height} pixels (EXIF orientation {orientation}), but its camera "
        f"was calibrated for {lens.width} x {lens.height}; give the photos that were aligned, or "
        "the same scaled evenly"
    )
