"""What a session measures: changes of detail per minute of head motion, frames, forms.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64
from terraport_research.study.questionnaires import ssq_scores, vrsq_scores
from terraport_research.study.session_log import SessionLog

__all__ = ["LEAST_DEG_S", "LEAST_M_S", "SessionMeasures", "between_landings", "measure"]

LEAST_DEG_S: Final = 5.0
LEAST_M_S: Final = 0.05
"""A head turns, or moves, from these speeds on; slower is holding still."""
_LONGEST_STEP_MS: Final = 500.0
"""A longer pause between frames (the page was hidden) is no time of the session."""
_MS_PER_MIN: Final = 60_000.0


@dataclass(frozen=True, slots=True)
class SessionMeasures:
    """One session in numbers; all but landings and frames is of the time between landings."""

    moving_min: float
    """Minutes of head motion."""
    watched_min: float
    """Minutes, head at rest too."""
    changes_in_view: int
    """Segments shown or hidden that met the view."""
    events_in_view: int
    """Frames with any of these."""
    changes: int
    """Segments shown or hidden, wherever."""
    landings: int
    wait_ms: float
    """Mean from a landing's request to the frame that shows it whole; NaN without one."""
    frame_ms_p50: float
    frame_ms_p95: float
    ssq: dict[str, float]
    """By scale, after less before; empty where one was not filled in."""
    vrsq: dict[str, float]

    @property
    def changes_per_min(self) -> float:
        """Changes in view per minute of head motion; NaN where no head moved."""
        return self.changes_in_view / self.moving_min if self.moving_min > 0 else float("nan")

    @property
    def events_per_min(self) -> float:
        """Frames with a change in view per minute of head motion."""
        return self.events_in_view / self.moving_min if self.moving_min > 0 else float("nan")


def measure(log: SessionLog) -> SessionMeasures:
    """Measure a session."""
    time = log.frames["t_ms"]
    step = np.diff(time, prepend=time[:1])
    counted = between_landings(log) & (step <= _LONGEST_STEP_MS)
    moving = counted & _moves(log.frames, step)
    after = [change for change in log.changes if not change.by_landing]
    waits = [one.arrived_ms - one.asked_ms for one in log.landings if one.arrived_ms is not None]
    frame_ms = log.frames["frame_ms"]
    p50, p95 = np.percentile(frame_ms, [50, 95]) if len(frame_ms) else (np.nan, np.nan)
    return SessionMeasures(
        float(step[moving].sum() / _MS_PER_MIN),
        float(step[counted].sum() / _MS_PER_MIN),
        sum(change.in_view for change in after),
        sum(change.in_view > 0 for change in after),
        sum(change.segments for change in after),
        len(log.landings),
        float(np.mean(waits)) if waits else float("nan"),
        float(p50),
        float(p95),
        _difference(log, "SSQ"),
        _difference(log, "VRSQ"),
    )


def between_landings(log: SessionLog) -> Bool:
    """Say which frames lie between a landing that is shown and the next one's request, (N,)."""
    time = log.frames["t_ms"]
    inside = np.zeros(len(time), np.bool_)
    for number, landing in enumerate(log.landings):
        if landing.arrived_ms is None:
            continue
        later = log.landings[number + 1 :]
        end = later[0].asked_ms if later else np.inf
        inside |= (time > landing.arrived_ms) & (time < end)
    return inside


def _moves(frames: dict[str, Float64], step_ms: Float64) -> Bool:
    """Say in which frames the head turned or moved since the one before, (N,)."""
    yaw, pitch = (np.radians(frames[key]) for key in ("yaw_deg", "pitch_deg"))
    forward = np.stack(
        [np.cos(pitch) * np.sin(yaw), np.sin(pitch), -np.cos(pitch) * np.cos(yaw)], axis=1
    )
    place = np.stack([frames[key] for key in ("x_m", "y_m", "z_m")], axis=1)
    cosine = np.clip((forward[1:] * forward[:-1]).sum(axis=1), -1.0, 1.0)
    turned = np.concatenate([[0.0], np.degrees(np.arccos(cosine))])
    roll = np.abs(np.diff(frames["roll_deg"], prepend=frames["roll_deg"][:1]))
    turned = np.maximum(turned, np.minimum(roll, 360.0 - roll))
    walked = np.concatenate([[0.0], np.linalg.norm(np.diff(place, axis=0), axis=1)])
    seconds = np.where(step_ms > 0, step_ms / 1000.0, np.inf)
    moves: Bool = (turned / seconds >= LEAST_DEG_S) | (walked / seconds >= LEAST_M_S)
    return moves


def _difference(log: SessionLog, name: str) -> dict[str, float]:
    score = ssq_scores if name == "SSQ" else vrsq_scores
    by_when = {form.when: score(form.answers) for form in log.forms if form.name == name}
    if not {"before", "after"} <= set(by_when):
        return {}
    return {scale: by_when["after"][scale] - by_when["before"][scale] for scale in by_when["after"]}
