"""Photos as pixels: decoded when asked for, kept within a bound.

Decoded rows are as stored in the file; who opens a photo says whether it is turned as EXIF states.
An embedded colour profile is not used: drones write sRGB.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageOps

from terraport_payload.types import UInt8
from terraport_pipeline.errors import PhotoError

__all__ = ["MAX_PIXELS", "SCALES", "PhotoStore", "exif_orientation", "open_image", "photo_size"]

MAX_PIXELS: Final = 500_000_000
"""Largest photo: survey cameras have 150 million pixels; decoded it takes 1.5 GB."""

SCALES: Final = (1, 2, 4, 8)
"""What a photo may be divided by; a JPEG is decoded at that size straight away."""

_ORIENTATION_TAG: Final = 0x0112
"""EXIF tag that says how the photo is turned."""

Image.MAX_IMAGE_PIXELS = MAX_PIXELS  # Pillow warns at 89 million, below what survey cameras have


def photo_size(path: Path) -> tuple[int, int]:
    """Read width and height as stored, without decoding.

    Raises
    ------
    PhotoError
        No picture, or one beyond :data:`MAX_PIXELS`.
    """
    with open_image(path) as image:
        return image.size


def exif_orientation(path: Path) -> int:
    """Read how EXIF says that a photo is turned; 1 where it says nothing.

    Raises
    ------
    PhotoError
        As :func:`photo_size`; some formats have to be decoded for it.
    """
    with open_image(path) as image:
        try:
            return int(image.getexif().get(_ORIENTATION_TAG, 1))
        except (OSError, ValueError, SyntaxError, EOFError, TypeError) as error:
            raise _unreadable(path, error) from error


def open_image(path: Path) -> Image.Image:
    """Open a picture without decoding it.

    Raises
    ------
    PhotoError
        No picture, or one beyond :data:`MAX_PIXELS`.
    """
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
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return PhotoError(
        f"photo {path} cannot be read ({reason}); copy it again from the camera, or remove it"
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

    def only(self, numbers: Sequence[int]) -> PhotoStore:
        """Make a store of some of the photos, in that order; nothing is decoded yet."""
        return PhotoStore(
            [self.paths[number] for number in numbers],
            self.max_bytes,
            [self._turned[number] for number in numbers],
        )

    def __len__(self) -> int:
        """Count the photos of the store, decoded or not."""
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
    with open_image(path) as image:
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
