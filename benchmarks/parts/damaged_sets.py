"""Photo sets that something is wrong with, from one that is right."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

__all__ = ["DAMAGES", "write_set"]

_QUALITY: Final = 92


def write_set(damage: str, photos: Path, cameras: Path, folder: Path, other: Path | None) -> None:
    """Write ``images`` and ``colmap`` with one damage.

    Parameters
    ----------
    damage : str
        Of :data:`DAMAGES`.
    photos, cameras : Path
        The right set: a folder of JPEGs, and a folder of COLMAP's text files.
    folder : Path
        Replaced.
    other : Path or None
        Folder with photos of another place, for ``elsewhere``; without one the photos are dealt to
        each other's names, half of the set on.
    """
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    shutil.copytree(cameras, folder / "colmap")
    paths = _photos(photos)
    others = paths[len(paths) // 2 :] + paths if other is None else _photos(other)
    for number, path in enumerate(paths):
        target = folder / "images" / path.name
        shutil.copyfile(path, target)
        target.chmod(0o644)
        DAMAGES[damage](target, number, others[number % len(others)])
    if damage in ("2 m beside", "2 m about"):
        _move(folder / "colmap" / "images.txt", about=damage == "2 m about")


def _photos(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in (".jpg", ".jpeg"))


def _turn(target: Path) -> None:
    _rewrite(target, lambda levels: levels[::-1, ::-1])


def _expose(target: Path) -> None:
    """Four times the light, clipped."""

    def brighter(levels: np.ndarray) -> np.ndarray:
        light = (levels / 255.0) ** 2.2 * 4.0
        return np.rint(255.0 * np.minimum(light, 1.0) ** (1 / 2.2)).astype(np.uint8)

    _rewrite(target, brighter)


def _exchange(target: Path, other: Path) -> None:
    """Another photo under this name, of the same size."""
    with Image.open(target) as image:
        size = image.size
    with Image.open(other) as image:
        image.convert("RGB").resize(size).save(target, quality=_QUALITY)


def _cut_off(target: Path, number: int) -> None:
    """Every third file ends half way; every sixth is no picture at all."""
    if number % 3 == 0:
        data = target.read_bytes()
        target.write_bytes(b"not a picture" if number % 6 == 0 else data[: len(data) // 2])


def _resize(target: Path, number: int) -> None:
    """Every third is square; the others are halved, which fits their lenses."""
    with Image.open(target) as image:
        side = min(image.size)
        size = (side, side) if number % 3 == 0 else (image.width // 2, image.height // 2)
        small = image.convert("RGB").resize(size)
    small.save(target, quality=_QUALITY)


def _rewrite(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    with Image.open(path) as image:
        levels = np.asarray(image.convert("RGB"))
    Image.fromarray(np.ascontiguousarray(change(levels))).save(path, quality=_QUALITY)


def _move(path: Path, *, about: bool) -> None:
    """Move all cameras 2 m to the east, or each 2 m to a side of its own."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rng = np.random.default_rng(2)
    for row, line in enumerate(lines):
        words = line.split()
        if line.startswith("#") or len(words) != 10:
            continue
        w, x, y, z = (float(word) for word in words[1:5])
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        angle = rng.uniform(0.0, 2.0 * np.pi) if about else 0.0
        step = 2.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        moved = np.array([float(word) for word in words[5:8]]) - rotation @ step
        words[5:8] = [repr(float(value)) for value in moved]
        lines[row] = " ".join(words)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


DAMAGES: Final[dict[str, Callable[[Path, int, Path], object]]] = {
    "none": lambda *_: None,
    "half missing": lambda target, number, _: target.unlink() if number % 2 else None,
    "turned": lambda target, *_: _turn(target),
    "half turned": lambda target, number, _: _turn(target) if number % 2 else None,
    "over-exposed": lambda target, *_: _expose(target),
    "elsewhere": lambda target, _, other: _exchange(target, other),
    "half elsewhere": lambda target, number, other: (
        _exchange(target, other) if number % 2 else None
    ),
    "2 m beside": lambda *_: None,
    "2 m about": lambda *_: None,
    "cut off": lambda target, number, _: _cut_off(target, number),
    "other size": lambda target, number, _: _resize(target, number),
}
"""What may be wrong: by name, what is done to the copy of a photo, its number and another photo."""
