"""Small surveys of one hill, flown again and again, that build into a dozen tiles in seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

__all__ = ["BUILD_OPTIONS", "write_hill"]

BUILD_OPTIONS: Final = (
    "--tile-depth", "7", "--base-faces", "1000", "--min-faces", "100", "--max-faces", "600",
    "--no-report", "--quiet",
)  # fmt: skip
"""Of ``terraport build``: tiles of the least size, and segments to match."""

_SIDES_M: Final = (34.0, 17.0)
_POINTS: Final = 1_250
_WORKS: Final = ((0.0, 0.0, 0.0), (-9.0, -3.0, -1.5), (10.0, 2.0, 1.8), (-1.0, 3.0, 1.5))
"""Where each survey finds ground moved since the one before, and by how much: x, y, height."""

_WORKS_RADIUS_M: Final = 4.0


def write_hill(path: Path, flight: int = 0) -> None:
    """Write the survey of a flight, 0 to 3, as text: another sample, and ground that was moved."""
    rng = np.random.default_rng(flight)
    x, y = (rng.uniform(-side / 2, side / 2, _POINTS) for side in _SIDES_M)
    z = 0.3 * np.sin(x / 9.0) * np.cos(y / 11.0)
    for at_x, at_y, height_m in _WORKS[: flight + 1]:
        z[np.hypot(x - at_x, y - at_y) < _WORKS_RADIUS_M] += height_m
    red = np.where(x + 4.0 * np.sin(y / 5.0) > 0.0, 190, 90)
    rows = [
        f"{500000 + a:.3f} {8000000 + b:.3f} {100 + c:.3f} {r} 120 80"
        for a, b, c, r in zip(x, y, z, red, strict=True)
    ]
    path.write_text("\n".join(["x y z r g b", *rows, ""]), encoding="ascii")
