"""Bundler's ``bundle.out`` with its list of photos.

Conventions (N. Snavely, "Bundler v0.4 User's Manual", section VI): ``P = R X + t`` with the camera
looking along -z, x right, y up; ``p = -P / P.z``; ``f (1 + k1 r^2 + k2 r^4) p`` pixels from the
middle of the picture, y up. A camera with focal length 0 was not aligned. The file does not say how
large the photos are: they are asked, or OpenSfM's ``camera_models.json`` beside it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.camera_files.photo_sizes import PhotoSize, PhotoSizes
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    FLIP,
    MAX_CAMERAS,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    check_size,
    make_lens,
    nearest_rotation,
)
from terraport_pipeline.engines.camera_files.stated_frames import stated_frames
from terraport_pipeline.engines.camera_files.text_files import (
    next_numbers,
    plain_name,
    read_small_text,
    text_lines,
)
from terraport_pipeline.errors import ReadError

__all__ = ["MAGIC", "read_bundler"]

MAGIC: Final = "# Bundle file"

_MAX_LIST_BYTES: Final = 64 << 20

_LISTS: Final = ("list.txt", "list_r000.out", "list_focal.txt", "image_list.txt")
"""Names of the list of photos, after those made from the file's own name."""

_ADVICE: Final = (
    "a Bundler file has no place on Earth of its own: georeference the project before the export, "
    "or write its offset as E N H into OFFSET.txt beside it; of OpenDroneMap give the project's "
    "folder instead"
)


def read_bundler(path: Path, photo_size: PhotoSize) -> RawCameras:
    """Read the aligned cameras.

    Parameters
    ----------
    path : Path
        ``bundle.out`` or ``bundle_r000.out``; the names are in ``list.txt``, ``list_r000.out``,
        ``<stem>.list.txt`` or the like, beside it or one folder above.
    photo_size : callable
        Asked for width and height of every aligned photo. A camera whose photo is missing or
        damaged is left out, with a warning.

    Raises
    ------
    ReadError
        Damaged or cut off, or no list of as many photos.
    PhotoError
        No aligned camera has a photo.
    """
    # (1) The header: how many cameras; as many names beside it.
    lines = ((n, text) for n, text in text_lines(path) if text and not text.startswith("#"))
    number, first = next(lines, (1, ""))
    words = first.split()
    if len(words) != 2 or not all(word.isdecimal() for word in words):
        raise ReadError(
            path, f"{first[:80]!r} is no count of cameras and points", AGAIN, f"line {number:,}"
        )
    count = int(words[0])
    if not 0 < count <= MAX_CAMERAS:
        check_count(path, count, f"line {number:,}")
    names = _read_names(path, count)
    stated_size = _stated_size(path)
    # (2) Five lines a camera. Invariant: every camera's five lines are read before it is judged,
    # so a camera that is left out does not shift the next.
    cameras = []
    sizes = PhotoSizes(photo_size)
    unaligned = 0
    for name in names:
        focal, k1, k2 = next_numbers(path, lines, "focal length, k1, k2", 3)
        rows = [next_numbers(path, lines, "a row of a rotation", 3) for _ in range(3)]
        translation = np.array(next_numbers(path, lines, "a translation", 3))
        if focal == 0.0:
            unaligned += 1
            continue
        check_position(path, f"camera {name!r}", translation)
        rotation = nearest_rotation(path, f"camera {name!r}", np.array(rows))
        size = stated_size or sizes.of(name)
        if size is None:
            continue
        width, height = size
        lens = make_lens(
            path,
            f"camera {name!r}",
            width=width,
            height=height,
            fx=focal,
            fy=focal,
            cx=0.5 * width,
            cy=0.5 * height,
            radial=(k1, k2),
        )
        cameras.append(RawCamera(name, lens, FLIP @ rotation, -rotation.T @ translation))
    # (3) What was left out, and the frame.
    sizes.check(len(cameras))
    check_count(path, len(cameras))
    warnings = []
    if unaligned:
        warnings.append(f"{unaligned:,} of {count:,} photos were not aligned by Bundler.")
    warnings += sizes.warnings(count)
    return RawCameras("Bundler", tuple(cameras), stated_frames(path), tuple(warnings), _ADVICE)


def _read_names(path: Path, count: int) -> list[str]:
    """Read the list beside the file, or one folder above, that has as many names as cameras.

    Other lists are of other photos: Bundler lists all, and those of a known focal length apart.
    """
    tried: list[str] = []
    seen: set[Path] = set()
    for folder in (path.parent, path.parent.parent):
        names_of_list = (
            f"{path.stem}.list.txt",
            f"{path.name}.list.txt",
            path.name.replace("bundle", "list", 1),
            *_LISTS,
        )
        for name in names_of_list:
            candidate = folder / name
            if candidate in seen or candidate == path or not candidate.is_file():
                continue
            seen.add(candidate)
            check_size(candidate, _MAX_LIST_BYTES, "give Bundler's list of photos")
            # "name", or "name 0 focal" where Bundler knew the focal length
            names = [_photo_name(text) for _, text in text_lines(candidate) if text]
            if len(names) == count:
                return names
            tried.append(f"{candidate} has {len(names):,}")
    attempts = "; ".join(tried) or (
        f"no {', '.join(_LISTS)} or {path.stem}.list.txt beside it or one folder above"
    )
    raise ReadError(
        path,
        f"{count:,} cameras need as many names ({attempts})",
        "put the list that was written with it beside it: Bundler's list.txt, OpenDroneMap's "
        "list_r000.out",
    )


def _stated_size(path: Path) -> tuple[int, int] | None:
    """Read the size that OpenSfM worked at, to which its focal lengths belong; None elsewhere.

    OpenDroneMap may align smaller copies of the photos. ``camera_models.json`` beside its Bundler
    file says their size where all cameras have one.
    """
    models = path.parent / "camera_models.json"
    if not models.is_file():
        return None
    try:
        document = json.loads(read_small_text(models))
        sizes = {(int(one["width"]), int(one["height"])) for one in document.values()}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ReadError(
            models, f"no cameras of OpenSfM ({error!r})", "export the reconstruction again"
        ) from error
    return sizes.pop() if len(sizes) == 1 else None


def _photo_name(text: str) -> str:
    words = text.rsplit(maxsplit=2)
    if len(words) == 3 and words[1].isdecimal():
        text = words[0]
    return plain_name(text)
