"""Bundler's ``bundle.out`` with its list of photos.

Conventions (N. Snavely, "Bundler v0.4 User's Manual", section VI): ``P = R X + t`` with the camera
looking along -z, x right, y up; ``p = -P / P.z``; ``f (1 + k1 r^2 + k2 r^4) p`` pixels from the
middle of the picture, y up. A camera with focal length 0 was not aligned. The file does not say how
large the photos are: they are asked.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.colmap import stated_offset
from terraport_pipeline.engines.camera_files.raw_cameras import (
    AGAIN,
    MAX_CAMERAS,
    Frame,
    PhotoSize,
    RawCamera,
    RawCameras,
    check_count,
    check_position,
    check_size,
    make_lens,
    parse_numbers,
    text_lines,
)
from terraport_pipeline.errors import PhotoError, ReadError

__all__ = ["MAGIC", "read_bundler"]

MAGIC: Final = "# Bundle file"

_FLIP: Final = np.diag([1.0, -1.0, -1.0])
"""Bundler's camera axes (x right, y up, z backward) to ours."""

_MAX_LIST_BYTES: Final = 64 << 20


def read_bundler(path: Path, photo_size: PhotoSize) -> RawCameras:
    """Read the aligned cameras.

    Parameters
    ----------
    path : Path
        ``bundle.out``; the names are in ``list.txt``, ``<stem>.list.txt`` or
        ``<name>.list.txt`` beside it or one folder above.
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
    # (2) Five lines a camera. Invariant: every camera's five lines are read before it is judged,
    # so a camera that is left out does not shift the next.
    cameras = []
    without_photo: list[PhotoError] = []
    unaligned = 0
    for name in names:
        focal, k1, k2 = _next(path, lines, "focal length, k1, k2")
        rows = [_next(path, lines, "a row of a rotation") for _ in range(3)]
        translation = np.array(_next(path, lines, "a translation"))
        if focal == 0.0:
            unaligned += 1
            continue
        check_position(path, f"camera {name!r}", translation)
        rotation = _nearest_rotation(path, name, np.array(rows))
        try:
            width, height = photo_size(name)
        except PhotoError as error:
            without_photo.append(error)
            continue
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
        cameras.append(RawCamera(name, lens, _FLIP @ rotation, -rotation.T @ translation))
    # (3) What was left out, and the frame.
    if without_photo and not cameras:
        raise without_photo[0]
    check_count(path, len(cameras))
    own = Frame("offset", "no offset")
    stated = stated_offset(path.parent)
    warnings = []
    if unaligned:
        warnings.append(f"{unaligned:,} of {count:,} photos were not aligned by Bundler.")
    if without_photo:
        warnings.append(
            f"{len(without_photo):,} of {count:,} photos are left out; the first: "
            f"{without_photo[0]}."
        )
    frames = (own,) if stated is None else (stated, own)
    return RawCameras("Bundler", tuple(cameras), frames, tuple(warnings))


def _next(path: Path, lines: Iterator[tuple[int, str]], what: str) -> list[float]:
    number, text = next(lines, (0, ""))
    if not number:
        raise ReadError(path, f"the file ends before {what}", "copy or export it again")
    return parse_numbers(path, number, text.split(), 3, what)


def _nearest_rotation(path: Path, name: str, matrix: Float64) -> Float64:
    """Remove rounding; refuse what is far from a rotation."""
    left, _, right = np.linalg.svd(matrix)
    rotation: Float64 = left @ right
    if np.abs(rotation - matrix).max() > 1e-3 or np.linalg.det(rotation) < 0.0:
        raise ReadError(path, f"no rotation: {matrix.round(4).tolist()}", AGAIN, f"camera {name!r}")
    return rotation


def _read_names(path: Path, count: int) -> list[str]:
    tried = []
    for folder in (path.parent, path.parent.parent):
        for name in ("list.txt", f"{path.stem}.list.txt", f"{path.name}.list.txt"):
            candidate = folder / name
            if not candidate.is_file():
                continue
            check_size(candidate, _MAX_LIST_BYTES, "give Bundler's list of photos")
            # "name", or "name 0 focal" where Bundler knew the focal length
            names = [_photo_name(text) for _, text in text_lines(candidate) if text]
            if len(names) == count:
                return names
            tried.append(f"{candidate} has {len(names):,}")
    attempts = "; ".join(tried) or "no list.txt beside it or one folder above"
    raise ReadError(
        path,
        f"{count:,} cameras need as many names ({attempts})",
        "put Bundler's list.txt beside it",
    )


def _photo_name(text: str) -> str:
    words = text.rsplit(maxsplit=2)
    if len(words) == 3 and words[1].isdecimal():
        text = words[0]
    return text.replace("\\", "/").removeprefix("./")
