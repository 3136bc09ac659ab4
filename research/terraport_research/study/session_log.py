"""Logs of sessions, read and checked (``spec/study-log.md``)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.errors import SurveyError

__all__ = ["CONDITIONS", "Change", "Condition", "Form", "Landing", "SessionLog", "read_log"]

Condition = Literal["landings", "head"]
CONDITIONS: Final[tuple[Condition, ...]] = ("landings", "head")

MAX_LOG_BYTES: Final = 256 << 20
"""An hour at 90 frames a second takes 25 MB."""
_COLUMNS: Final = ("t_ms", "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "frame_ms")
_ROWS: Final = {"SSQ": 16, "VRSQ": 9}
_HIGHEST: Final = 3


@dataclass(frozen=True, slots=True)
class Landing:
    """From the request to the frame that shows it whole."""

    asked_ms: float
    arrived_ms: float | None
    position: tuple[float, float, float]
    radius_m: float


@dataclass(frozen=True, slots=True)
class Change:
    """A frame that drew other segments than the one before."""

    t_ms: float
    by_landing: bool
    segments: int
    """Shown and hidden."""
    in_view: int
    """Of these, those that meet the view."""


@dataclass(frozen=True, slots=True)
class Form:
    """A filled-in form."""

    name: str
    when: str
    answers: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SessionLog:
    """One session."""

    name: str
    """Of its file."""
    condition: Condition
    scene: str
    scene_version: str
    viewer: str
    participant: str
    order: int
    walk: str
    max_error_px: float | None
    cut: bool
    frames: dict[str, Float64]
    """Columns, each (N,)."""
    landings: tuple[Landing, ...]
    changes: tuple[Change, ...]
    forms: tuple[Form, ...]


def read_log(path: Path) -> SessionLog:
    """Read a log.

    Raises
    ------
    SurveyError
        It is not there, too large, of another form, or damaged; the text says which.
    """
    try:
        size = path.stat().st_size
        if size > MAX_LOG_BYTES:
            raise SurveyError(f"{path} has {size:,} bytes, expected at most {MAX_LOG_BYTES:,}")
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SurveyError(f"{path} cannot be read as a log of the study: {error}") from error
    try:
        if document["form"] != 1:
            raise SurveyError(f"{path} is of form {document['form']!r}, expected 1")
        return _log(path.stem, document)
    except (KeyError, TypeError, ValueError) as error:
        raise SurveyError(f"{path} is a damaged log: {error!r} (spec/study-log.md)") from error


def _log(name: str, document: dict[str, Any]) -> SessionLog:
    condition = document["condition"]
    if condition not in CONDITIONS:
        raise ValueError(f"condition {condition!r}; expected {' or '.join(CONDITIONS)}")
    error_px = document["max_error_px"]
    return SessionLog(
        name,
        condition,
        str(document["scene"]),
        str(document["scene_version"]),
        str(document["viewer"]),
        str(document["participant"]),
        int(document["order"]),
        str(document["walk"]),
        None if error_px is None else float(error_px),
        bool(document["cut"]),
        _frames(document["frames"]),
        tuple(_landing(one) for one in document["landings"]),
        tuple(_change(one) for one in document["changes"]),
        tuple(_form(one) for one in document["forms"]),
    )


def _frames(columns: dict[str, list[float]]) -> dict[str, Float64]:
    frames = {key: np.array(columns[key], np.float64) for key in _COLUMNS}
    lengths = {len(column) for column in frames.values()}
    if len(lengths) != 1 or not all(np.isfinite(column).all() for column in frames.values()):
        raise ValueError("frames are columns of equal length, of numbers")
    if (np.diff(frames["t_ms"]) < 0).any():
        raise ValueError("times of frames do not ascend")
    return frames


def _landing(one: dict[str, Any]) -> Landing:
    x, y, z = map(float, one["position"])
    arrived = one["arrived_ms"]
    return Landing(
        float(one["asked_ms"]),
        None if arrived is None else float(arrived),
        (x, y, z),
        float(one["radius_m"]),
    )


def _change(one: dict[str, Any]) -> Change:
    return Change(
        float(one["t_ms"]),
        bool(one["by_landing"]),
        len(one["shown"]) + len(one["hidden"]),
        int(one["shown_in_view"]) + int(one["hidden_in_view"]),
    )


def _form(one: dict[str, Any]) -> Form:
    answers = tuple(map(int, one["answers"]))
    if len(answers) != _ROWS[one["name"]] or not all(0 <= a <= _HIGHEST for a in answers):
        raise ValueError(f"{one['name']} with answers {answers}")
    return Form(one["name"], str(one["when"]), answers)
