"""The photos themselves: found by name, decoded when asked for, kept within a bound.

Decoded rows are as stored in the file. Programs that align photos work on stored pixels and leave
the orientation that EXIF states alone, so this does too; only where the stored sides fit the lens
turned by a quarter and EXIF says so, the photo is turned. An embedded colour profile is not used:
drones write sRGB.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np
from PIL import Image, ImageOps

from terraport_pipeline.engines.camera_files.raw_cameras import PhotoSize
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.lens import View
from terraport_pipeline.model import UInt8

__all__ = [
    "MAX_PIXELS",
    "OpenPhotos",
    "PhotoStore",
    "find_photos",
    "open_photos",
    "photo_size",
    "sizes_below",
]

MAX_PIXELS: Final = 500_000_000
"""Largest photo: survey cameras have 150 million pixels; decoded it takes 1.5 GB."""

MAX_FILES: Final = 500_000
"""Files that are looked through for photos."""

SCALES: Final = (1, 2, 4, 8)
"""What a photo may be divided by; a JPEG is decoded at that size straight away."""

_ENDINGS: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".jp2"})

_TURNED: Final = frozenset({5, 6, 7, 8})
"""Values of EXIF's orientation that exchange the sides."""

_ORIENTATION_TAG: Final = 0x0112

_ASPECT_TOLERANCE: Final = 0.005
"""Sides that scale more differently than this are another photo than the lens's."""

_NAMED: Final = 5
"""Missing photos that a message names."""

Image.MAX_IMAGE_PIXELS = MAX_PIXELS  # Pillow warns at 89 million, below what survey cameras have


def find_photos(directory: Path, views: Iterable[View]) -> dict[str, Path]:
    """Find the file of every view below a directory.

    Names are compared without upper and lower case; a view named without an ending
    (``DJI_0018``, as Metashape writes) matches any picture of that stem. Where several folders
    hold the same name, the one whose folders agree with the view's longest is taken.

    Parameters
    ----------
    directory : Path
    views : iterable of View

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
    found: dict[str, Path] = {}
    views = list(views)
    for view in views:
        path = _look_up(view.name, by_name, by_stem)
        if path is not None:
            found[view.name] = path
    if not found:
        names = ", ".join(view.name for view in views[:_NAMED])
        raise PhotoError(
            f"none of the {len(views):,} photos that the cameras name ({names}, ..) is below "
            f"{directory}, which has {sum(map(len, by_name.values())):,} pictures; give the "
            "folder of the original photos with --photos"
        )
    return found


def _index(directory: Path) -> tuple[dict[str, list[Path]], dict[str, list[Path]]]:
    if not directory.is_dir():
        raise PhotoError(f"{directory} is no folder; give the folder of the original photos")
    by_name: dict[str, list[Path]] = {}
    by_stem: dict[str, list[Path]] = {}
    for count, path in enumerate(directory.rglob("*")):
        if count >= MAX_FILES:
            raise PhotoError(
                f"{directory} holds more than {MAX_FILES:,} files; give the folder of the photos"
            )
        if path.suffix.lower() in _ENDINGS and path.is_file():
            by_name.setdefault(path.name.lower(), []).append(path)
            by_stem.setdefault(path.stem.lower(), []).append(path)
    return by_name, by_stem


_Index = dict[str, list[Path]]


def _look_up(told: str, by_name: _Index, by_stem: _Index) -> Path | None:
    name = PurePosixPath(told.replace("\\", "/").lower())
    candidates = by_name.get(name.name, [])
    if not candidates and name.suffix not in _ENDINGS:
        candidates = by_stem.get(name.name, [])
    return _pick(told, name, candidates) if candidates else None


def _pick(told: str, name: PurePosixPath, candidates: Sequence[Path]) -> Path:
    if len(candidates) == 1:
        return candidates[0]

    def shared(path: Path) -> int:
        folders = zip(reversed(name.parent.parts), reversed(path.parent.parts), strict=False)
        count = 0
        for ours, theirs in folders:
            if ours != theirs.lower():
                break
            count += 1
        return count

    ranked = sorted(candidates, key=lambda path: (-shared(path), str(path)))
    if shared(ranked[0]) == shared(ranked[1]):
        raise PhotoError(
            f"photo {told} may be {ranked[0]} or {ranked[1]}; give a folder that has it once"
        )
    return ranked[0]


def photo_size(path: Path) -> tuple[int, int]:
    """Read width and height as stored, without decoding.

    Raises
    ------
    PhotoError
        No picture, or one beyond :data:`MAX_PIXELS`.
    """
    with _open(path) as image:
        return image.size


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


def _open(path: Path) -> Image.Image:
    try:
        image = Image.open(path)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise _unreadable(path, error) from error
    width, height = image.size
    if width * height > MAX_PIXELS:
        image.close()
        raise PhotoError(
            f"{path} has {width} x {height} pixels, expected at most {MAX_PIXELS:,} in all"
        )
    return image


def _unreadable(path: Path, error: Exception) -> PhotoError:
    told = " ".join(str(error).split())[:120] or type(error).__name__
    return PhotoError(
        f"photo {path} cannot be read ({told}); copy it again from the camera, or remove it"
    )


@dataclass(frozen=True, slots=True)
class OpenPhotos:
    """Views that have a photo, and the photos."""

    views: tuple[View, ...]
    """Those with a file; each lens fits the stored size."""
    photos: PhotoStore
    """In the order of `views`."""
    warnings: tuple[str, ...]


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
        No photo found, one is damaged, or its sides do not fit its lens.
    """
    found = find_photos(directory, views)
    kept, paths, turned, scaled = [], [], [], 0
    for view in views:
        path = found.get(view.name)
        if path is None:
            continue
        fitted, turn = _fit(view, path)
        scaled += fitted.lens != view.lens
        kept.append(fitted)
        paths.append(path)
        turned.append(turn)
    warnings = []
    missing = [view.name for view in views if view.name not in found]
    if missing:
        names = ", ".join(missing[:_NAMED]) + (", .." if len(missing) > _NAMED else "")
        warnings.append(
            f"{len(missing):,} of {len(views):,} photos are not below {directory} ({names}); they "
            "are left out."
        )
    if scaled:
        warnings.append(
            f"{scaled:,} photos are stored at another size than they were calibrated at; their "
            "lenses were scaled."
        )
    return OpenPhotos(tuple(kept), PhotoStore(paths, max_bytes, turned), tuple(warnings))


def _fit(view: View, path: Path) -> tuple[View, bool]:
    """Scale the lens to the stored size; tell whether the photo must be turned for that."""
    with _open(path) as image:
        width, height = image.size
        orientation = image.getexif().get(_ORIENTATION_TAG, 1)
    lens = view.lens
    if (lens.width, lens.height) == (width, height):
        return view, False
    for turn in (False, orientation in _TURNED):
        wide, high = (height, width) if turn else (width, height)
        across, down = wide / lens.width, high / lens.height
        # a side is rounded to whole pixels, so small pictures may differ by a pixel
        if abs(across / down - 1.0) <= _ASPECT_TOLERANCE + 1.0 / min(wide, high):
            return replace(view, lens=lens.scaled(wide, high)), turn
    raise PhotoError(
        f"{path} has {width} x {height} pixels (EXIF orientation {orientation}), but its camera "
        f"was calibrated for {lens.width} x {lens.height}; give the photos that were aligned, or "
        "the same scaled evenly"
    )


class PhotoStore:
    """Decoded photos by index, the least lately used dropped first. Safe from several threads.

    Two threads that ask for the same photo decode it once.

    Parameters
    ----------
    paths : sequence of Path, or mapping of name to Path
        In the order of the views.
    max_bytes : int
        Bound of what is kept. A photo beyond it is decoded for its caller and not kept. What
        callers still hold counts on top: one photo per thread.
    turned : sequence of bool, optional
        Photos to turn as EXIF says.
    """

    def __init__(
        self,
        paths: Sequence[Path] | Mapping[str, Path],
        max_bytes: int,
        turned: Sequence[bool] | None = None,
    ) -> None:
        self.paths = tuple(paths.values() if isinstance(paths, Mapping) else paths)
        self.max_bytes = max_bytes
        self._turned = tuple(turned) if turned is not None else (False,) * len(self.paths)
        self._kept: OrderedDict[tuple[int, int], UInt8] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._busy: dict[tuple[int, int], threading.Event] = {}

    def __len__(self) -> int:
        """Count the photos."""
        return len(self.paths)

    @property
    def kept_bytes(self) -> int:
        """Bytes of the decoded photos that are kept now."""
        return self._bytes

    def get(self, view_index: int, scale: int = 1) -> UInt8:
        """Decode a photo, or take it from what is kept.

        Parameters
        ----------
        view_index : int
        scale : int
            1, 2, 4 or 8: both sides divided by it, rounded up.

        Returns
        -------
        ndarray of shape (H, W, 3), uint8
            sRGB, read only. Row 0 is the top.

        Raises
        ------
        PhotoError
            The file is damaged, cut off or of a kind that is not understood.
        ValueError
            Another scale.
        """
        if scale not in SCALES:
            raise ValueError(f"a scale of {SCALES} expected, got {scale}")
        key = (view_index, scale)
        while True:
            with self._lock:
                pixels = self._kept.get(key)
                if pixels is not None:
                    self._kept.move_to_end(key)
                    return pixels
                busy = self._busy.get(key)
                if busy is None:
                    self._busy[key] = threading.Event()
                    break
            busy.wait()
        try:
            pixels = _decode(self.paths[view_index], scale, self._turned[view_index])
            with self._lock:
                self._keep(key, pixels)
            return pixels
        finally:
            with self._lock:
                self._busy.pop(key).set()

    def _keep(self, key: tuple[int, int], pixels: UInt8) -> None:
        if pixels.nbytes > self.max_bytes:
            return
        self._kept[key] = pixels
        self._bytes += pixels.nbytes
        while self._bytes > self.max_bytes:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= dropped.nbytes


def _decode(path: Path, scale: int, turned: bool) -> UInt8:
    with _open(path) as image:
        width, height = image.size
        size = (-(-width // scale), -(-height // scale))
        if image.mode not in ("RGB", "L", "CMYK", "RGBA", "P", "LA", "YCbCr"):
            raise PhotoError(
                f"photo {path} has pixels of kind {image.mode}, expected 8 bits of colour; give "
                "the photos as JPEG"
            )
        try:
            if scale > 1:
                image.draft("RGB", size)  # JPEG only: decodes at 1/2, 1/4 or 1/8
            decoded = image.convert("RGB")
            if decoded.size != size:
                decoded = decoded.resize(size, Image.Resampling.BOX)
            if turned:
                decoded.getexif()[_ORIENTATION_TAG] = image.getexif().get(_ORIENTATION_TAG, 1)
                decoded = ImageOps.exif_transpose(decoded)
        except (OSError, ValueError, SyntaxError, EOFError) as error:
            raise _unreadable(path, error) from error
        pixels: UInt8 = np.array(decoded, dtype=np.uint8)
    pixels.setflags(write=False)
    return pixels
