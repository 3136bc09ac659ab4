"""What strokes have taught, for who painted them: the contents of ``taught.json``.

Format in ``spec/scene-format.md``, section "taught.json". PURE: no I/O, no clock.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping
from typing import Any, Final, Literal

import numpy as np

from terraport_payload.types import UInt8
from terraport_pipeline.naming.doubt import next_places
from terraport_pipeline.naming.teacher import Answer, Teacher

__all__ = ["MAX_SQUARES", "NO_GROUND", "State", "refused_file", "taught_file"]

MAX_SQUARES: Final = 1_048_576
"""A megabyte for each of the two pictures; wider ground has larger squares."""

NO_GROUND: Final = 255

State = Literal["taught", "published"]

_COLOURS: Final = (
    "#c1653f", "#2f8f9d", "#c9a227", "#6b57b8", "#4f9d45", "#b8478a", "#3b6fb6", "#8a7a52",
)  # fmt: skip
"""Of names that nobody painted, in turn: drawn in a GIS they have no colour."""


def taught_file(
    teacher: Teacher,
    answer: Answer,
    colours: Mapping[str, str],
    revision: str,
    state: State,
    text: str,
) -> bytes:
    """Say what strokes have taught.

    Parameters
    ----------
    teacher : Teacher
    answer : Answer
    colours : mapping of str to str
        ``#rrggbb`` of names.
    revision : str
        Of the strokes.
    state : {"taught", "published"}
    text : str
        For people.
    """
    ground, units = teacher.ground, teacher.units
    area = np.bincount(answer.best, ground.area, len(answer.names))
    sure = np.bincount(answer.best, ground.area * answer.sure, len(answer.names))
    factor = max(1, math.ceil(math.sqrt(units.rows * units.columns / MAX_SQUARES)))
    rows, columns = -(-units.rows // factor), -(-units.columns // factor)
    while rows * columns > MAX_SQUARES:  # rounding up
        factor += 1
        rows, columns = -(-units.rows // factor), -(-units.columns // factor)
    row, column = np.divmod(units.square, units.columns)
    square = (row // factor) * columns + column // factor
    kind = np.full(rows * columns, NO_GROUND, np.uint8)
    # Of several units of a square the largest is written last.
    order = np.lexsort((np.bincount(units.of_face, ground.area, units.count), square))
    kind[square[order]] = answer.votes.argmax(axis=1)[order]
    doubt = np.zeros(rows * columns, np.float64)
    np.maximum.at(doubt, square, answer.unsure)
    return _encoded(
        revision,
        state,
        text,
        names=[
            {
                "name": name,
                "colour": colours.get(name, _COLOURS[n % len(_COLOURS)]),
                "area_m2": round(float(area[n]), 1),
                "confidence": round(float(sure[n] / area[n]), 3) if area[n] > 0 else 0.0,
            }
            for n, name in enumerate(answer.names)
        ],
        corner_m=list(units.corner_m),
        cell_m=units.cell_m * factor,
        rows=rows,
        columns=columns,
        kind=_packed(kind),
        doubt=_packed(np.rint(doubt * 255).astype(np.uint8)),
        places=[
            {
                "position": [round(value, 2) for value in place.position_m],
                "doubt": round(place.doubt, 3),
                "likeliest": place.likeliest,
                "or": place.other,
            }
            for place in next_places(teacher, answer)
        ],
    )


def refused_file(revision: str, text: str) -> bytes:
    """Say why nothing can be learned of strokes."""
    return _encoded(revision, "refused", text)


def _encoded(revision: str, state: str, text: str, **rest: Any) -> bytes:
    head = {"format": "terraport-taught", "format_version": "1.0"}
    body = {"strokes": revision, "state": state, "text": text}
    return json.dumps({**head, **body, **rest}, ensure_ascii=False).encode()


def _packed(picture: UInt8) -> str:
    return base64.b64encode(zlib.compress(picture.tobytes(), 6)).decode("ascii")
