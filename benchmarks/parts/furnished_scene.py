"""What people leave beside a scene, in large: strokes that they painted, names that they gave."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final

from terraport_store import Stroke, Strokes, change_strokes
from terraport_store.labels import encode_labels
from terraport_store.strokes import MAX_PLACES

__all__ = ["furnish"]

STROKES: Final = 400
LABELS: Final = 30_000


def furnish(scene: Path, *, strokes: int = STROKES, labels: int = LABELS) -> None:
    """Paint strokes of as many places as one may have, and name regions.

    Parameters
    ----------
    scene : Path
        A published scene.
    strokes, labels : int, optional
        How many; 1,900 and 131,000 are near what there may be, and take some seconds.
    """
    draw = random.Random(1)

    def painted(before: Strokes) -> Strokes:
        for number in range(strokes):
            stroke = Stroke(
                id=f"{number:016x}",
                name="haul road",
                colour="#c08a2e",
                width_m=3.0,
                line=tuple((draw.uniform(0, 900), draw.uniform(0, 900)) for _ in range(MAX_PLACES)),
                who="anna",
                when="2026-11-24T09:12:07Z",
            )
            before = before.with_one(stroke)
        return before

    change_strokes(scene, painted)
    names = {number: f"label {number} of a region" for number in range(labels)}
    (scene / "labels.json").write_bytes(encode_labels(names))
