"""``terraport evaluate study``: tables and figures of one session or of many."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import t as student

from terraport_payload.types import Float64
from terraport_pipeline.errors import OptionError
from terraport_research.booklet import Booklet, write_pages
from terraport_research.booklet_model import Column, Figure, Page, Picture, Row, Stamp, Table
from terraport_research.line_chart import Line, line_chart
from terraport_research.study.measures import LEAST_DEG_S, LEAST_M_S, SessionMeasures, measure
from terraport_research.study.session_log import CONDITIONS, Condition, SessionLog, read_log
from terraport_research.versions import versions_of_this

__all__ = ["MAX_SESSIONS", "evaluate_study"]

MAX_SESSIONS: Final = 1000
_BOOKLET: Final = Booklet(
    "study",
    "terraport evaluate study",
    "Detail frozen between landings, and detail that follows the head",
    "Condition landings: what is drawn changes by landings alone. Condition head: between landings "
    "it follows the head by screen-space error, as usual tilers do. Scene, landings, budgets and "
    "viewer are the same.",
)
_CHART_STEPS: Final = 8
_STYLE: Final = (
    "text{font:10px sans-serif;fill:#56616f}line{stroke:#d9dee5}polyline{fill:none;stroke-width:2}"
    "circle{stroke:none}.line0{stroke:#2563c9}.line1{stroke:#c2410c}.line2{stroke:#15803d}"
    ".line3{stroke:#7e22ce}circle.line0{fill:#2563c9}circle.line1{fill:#c2410c}"
    "circle.line2{fill:#15803d}circle.line3{fill:#7e22ce}"
)
_MOST_LINES: Final = 4
_COLUMNS: Final = (
    Column("changes", "changes in view", 1, "per min of head motion"),
    Column("events", "frames with one", 1, "per min of head motion"),
    Column("everywhere", "changes, also out of view", 0),
    Column("moving", "head motion", 2, "min"),
    Column("landings", "landings", 0),
    Column("p50", "frame, median", 1, "ms"),
    Column("p95", "frame, 95 %", 1, "ms"),
)
_SCALES: Final = (
    ("ssq", "total"), ("ssq", "nausea"), ("ssq", "oculomotor"), ("ssq", "disorientation"),
    ("vrsq", "total"),
)  # fmt: skip


def evaluate_study(paths: Sequence[Path], folder: Path) -> Page:
    """Read logs and write ``study.html``, ``.md``, ``.csv``, ``.json``.

    Raises
    ------
    OptionError
        None, or too many.
    SurveyError
        A log is damaged.
    """
    start = time.process_time()
    if not 1 <= len(paths) <= MAX_SESSIONS:
        raise OptionError(
            f"{len(paths)} logs; expected 1 to {MAX_SESSIONS}, or --play SCENE to make some"
        )
    logs = [read_log(path) for path in paths]
    sessions = [(log, measure(log)) for log in logs]
    pictures = _charts(logs)
    versions = versions_of_this()
    machine = ", ".join(f"{k} {v}" for k, v in versions.items() if k != "commit")
    walks = " and ".join(sorted({log.walk for log in logs}))
    scenes = ", ".join(sorted({f"{log.scene} {log.scene_version}" for log in logs}))
    viewers = ", ".join(sorted({log.viewer for log in logs}))
    page = Page(
        "sessions",
        f"{len(logs)} sessions of {scenes}",
        _words(logs),
        tuple(_tables(sessions)),
        (
            Figure(
                "changes",
                "Changes of detail in view between landings, summed over the session",
                tuple(
                    Picture(name, title, "x: seconds of the session") for name, title, _ in pictures
                ),
            ),
        ),
        Stamp(
            versions["terraport"],
            versions["commit"],
            f"{walks} walk, viewer {viewers}",
            0,
            machine,
            round(time.process_time() - start, 2),
        ),
    )
    write_pages([page], {name: svg for name, _, svg in pictures}, folder, _BOOKLET)
    return page


def _words(logs: Sequence[SessionLog]) -> tuple[str, ...]:
    errors = sorted({f"{log.max_error_px:.3g}" for log in logs if log.max_error_px is not None})
    words = []
    words.append(
        f"A head moves from {LEAST_DEG_S:g} degrees or {LEAST_M_S:g} m a second on. A change is a "
        "segment that is shown or hidden in a frame between landings while its box meets the view."
    )
    if errors:
        words.append(f"The baseline draws finely above {', '.join(errors)} pixels of error.")
    cut = [log.name for log in logs if log.cut]
    if cut:
        words.append(f"Longer than a log may be, and cut: {', '.join(cut)}.")
    return tuple(words)


def _tables(sessions: list[tuple[SessionLog, SessionMeasures]]) -> list[Table]:
    by_condition = {
        condition: [m for log, m in sessions if log.condition == condition]
        for condition in CONDITIONS
    }
    rows = [
        Row(f"{condition}, {len(found)} sessions", tuple(_means(found)))
        for condition, found in by_condition.items()
        if found
    ]
    tables = [
        Table("conditions", "By condition: means over sessions", "condition", _COLUMNS, tuple(rows))
    ]
    single = [
        Row(f"{log.name}: participant {log.participant}, {log.condition}", tuple(_values(measures)))
        for log, measures in sessions
    ]
    tables.append(Table("sessions", "Each session", "session", _COLUMNS, tuple(single)))
    forms = _forms(by_condition, sessions)
    return [*tables, forms] if forms else tables


def _values(measures: SessionMeasures) -> list[float]:
    return [
        measures.changes_per_min,
        measures.events_per_min,
        float(measures.changes),
        measures.moving_min,
        float(measures.landings),
        measures.frame_ms_p50,
        measures.frame_ms_p95,
    ]


def _means(measures: list[SessionMeasures]) -> list[float | None]:
    table = np.array([_values(one) for one in measures])
    return [
        float(column[np.isfinite(column)].mean()) if np.isfinite(column).any() else None
        for column in table.T
    ]


def _forms(
    by_condition: dict[Condition, list[SessionMeasures]],
    sessions: list[tuple[SessionLog, SessionMeasures]],
) -> Table | None:
    """Sickness after less before: means by condition, and each participant's own difference."""
    rows: list[Row] = []
    for condition, found in by_condition.items():
        filled = [one for one in found if one.ssq]
        if filled:
            means = [
                float(np.mean([getattr(m, form)[scale] for m in filled])) for form, scale in _SCALES
            ]
            rows.append(Row(f"{condition}, {len(filled)} sessions", tuple(means)))
    if not rows:
        return None
    pairs = _pairs(sessions)
    if len(pairs) > 1:
        apart = np.array([_sickness(head) - _sickness(landings) for landings, head in pairs])
        half = student.ppf(0.975, len(pairs) - 1) * apart.std(axis=0, ddof=1) / np.sqrt(len(pairs))
        title = f"head less landings, {len(pairs)} participants"
        rows.append(Row(title, tuple(map(float, apart.mean(axis=0)))))
        rows.append(Row("half of its 95 % interval (Student's t)", tuple(map(float, half))))
    columns = tuple(
        Column(f"{form}_{scale}", f"{form.upper()} {scale}", 1) for form, scale in _SCALES
    )
    return Table("forms", "SSQ and VRSQ, after less before", "condition", columns, tuple(rows))


def _sickness(measures: SessionMeasures) -> Float64:
    """Return after less before, by scale."""
    return np.array([getattr(measures, form)[scale] for form, scale in _SCALES])


def _pairs(
    sessions: list[tuple[SessionLog, SessionMeasures]],
) -> list[tuple[SessionMeasures, SessionMeasures]]:
    """Both conditions of every participant who filled in the forms of both; first sessions."""
    firsts: dict[tuple[str, str], SessionMeasures] = {}
    for log, measures in sorted(sessions, key=lambda one: one[0].order):
        if measures.ssq:
            firsts.setdefault((log.participant, log.condition), measures)
    participants = sorted({participant for participant, _ in firsts})
    return [
        (firsts[who, "landings"], firsts[who, "head"])
        for who in participants
        if (who, "landings") in firsts and (who, "head") in firsts
    ]


def _charts(logs: Sequence[SessionLog]) -> list[tuple[str, str, bytes]]:
    """File, title and SVG of each participant's sessions."""
    charts = []
    for who in sorted({log.participant for log in logs}):
        chosen = [log for log in logs if log.participant == who][:_MOST_LINES]
        lines = [Line(f"{log.condition}, {log.name}", _summed(log)) for log in chosen]
        names = " and ".join(
            f"{log.condition} ({colour})"
            for log, colour in zip(chosen, ("blue", "orange", "green", "violet"), strict=False)
        )
        title = f"Participant {who}: {names}"
        svg = line_chart(lines, x_title="seconds", y_title="", title=title)
        styled = svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1).replace(
            ">", f"><style>{_STYLE}</style>", 1
        )
        charts.append((f"changes-{who}.svg", title, styled.encode()))
    return charts


def _summed(log: SessionLog) -> tuple[tuple[float, float], ...]:
    """Sum changes in view up to a few times of the session."""
    after = [change for change in log.changes if not change.by_landing]
    at = np.array([change.t_ms for change in after]) / 1000.0
    sums = np.concatenate([[0.0], np.cumsum([change.in_view for change in after])])
    end = float(log.frames["t_ms"][-1]) / 1000.0 if len(log.frames["t_ms"]) else 0.0
    times = np.unique(np.round(np.linspace(0.0, end, _CHART_STEPS)))
    return tuple((float(t), float(sums[np.searchsorted(at, t, side="right")])) for t in times)
