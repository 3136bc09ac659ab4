"""``terraport evaluate study``: logs, measures, forms, walks, tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terraport_pipeline.demo_scenes import shipped_scene
from terraport_pipeline.errors import OptionError, SurveyError
from terraport_research.study.evaluate import evaluate_study
from terraport_research.study.measures import measure
from terraport_research.study.questionnaires import ssq_scores, vrsq_scores
from terraport_research.study.session_log import SessionLog, read_log
from terraport_research.study.walks import made_walk, read_walk, walk_of_log

RATE_S = 0.02


def document(**other: Any) -> dict[str, Any]:
    """A session of 10 s: a landing in the first, the head turns from 2 to 8 s, at 20 degrees/s."""
    t = np.arange(0.0, 10.0, RATE_S)
    yaw = np.clip(t - 2.0, 0.0, 6.0) * 20.0
    zero = [0.0] * len(t)
    log: dict[str, Any] = {
        "form": 1, "condition": "head", "scene": "pit", "scene_version": "v-1", "viewer": "0.1",
        "participant": "7", "order": 1, "radius_m": 40, "max_error_px": 8.0, "walk": "live",
        "started": "2026-11-24T10:00:00Z", "device": "test", "cut": False,
        "frames": {
            "t_ms": (t * 1000).tolist(), "x_m": zero, "y_m": zero, "z_m": zero,
            "yaw_deg": yaw.tolist(), "pitch_deg": zero, "roll_deg": zero,
            "frame_ms": [20.0] * len(t),
        },
        "landings": [
            {"landing": 1, "asked_ms": 0, "arrived_ms": 1000, "position": [0, 0, 0],
             "radius_m": 40}
        ],
        "changes": [
            change(1000, by_landing=True, shown=9),
            change(3000, shown=2),
            change(5000, shown=1, hidden=3),
            {**change(6000, hidden=4), "hidden_in_view": 0},
        ],
        "forms": [],
    }  # fmt: skip
    return log | other


def change(t_ms: float, *, shown: int = 0, hidden: int = 0, by_landing: bool = False):
    return {
        "t_ms": t_ms, "landing": 1, "by_landing": by_landing, "shown": list(range(shown)),
        "hidden": list(range(hidden)), "shown_in_view": shown, "hidden_in_view": hidden,
    }  # fmt: skip


def log_of(tmp_path: Path, name: str = "log", **other: Any) -> SessionLog:
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps(document(**other)))
    return read_log(path)


def test_changes_are_counted_per_minute_of_head_motion(tmp_path: Path) -> None:
    measures = measure(log_of(tmp_path))
    assert measures.moving_min == pytest.approx(6.0 / 60.0, rel=0.01)
    assert measures.watched_min == pytest.approx(9.0 / 60.0, rel=0.01)
    # Of the landing's own 9 none; of what nobody saw none.
    assert (measures.changes_in_view, measures.events_in_view, measures.changes) == (6, 2, 10)
    assert measures.changes_per_min == pytest.approx(60.0, rel=0.01)
    assert measures.wait_ms == 1000.0


def test_a_frozen_session_has_none(tmp_path: Path) -> None:
    only_landing = [change(1000, by_landing=True, shown=9)]
    assert measure(log_of(tmp_path, changes=only_landing)).changes_per_min == 0.0


def test_walking_and_tilting_are_motion_and_a_hidden_page_is_no_time(tmp_path: Path) -> None:
    frames = document()["frames"]
    still = frames | {"yaw_deg": [0.0] * len(frames["t_ms"])}
    assert measure(log_of(tmp_path, frames=still)).moving_min == 0.0
    walking = still | {"x_m": (np.array(frames["t_ms"]) / 1000.0).tolist()}
    assert measure(log_of(tmp_path, frames=walking)).moving_min == pytest.approx(0.15, rel=0.01)
    tilting = still | {"roll_deg": (np.array(frames["t_ms"]) / 100.0).tolist()}
    assert measure(log_of(tmp_path, frames=tilting)).moving_min == pytest.approx(0.15, rel=0.01)
    t = np.array(frames["t_ms"])
    paused = walking | {"t_ms": np.where(t > 5000, t + 60_000, t).tolist()}
    assert measure(log_of(tmp_path, frames=paused)).moving_min < 0.16


def test_time_of_a_landing_under_way_does_not_count(tmp_path: Path) -> None:
    first = document()["landings"][0]
    second = first | {"landing": 2, "asked_ms": 4000, "arrived_ms": 7000}
    measures = measure(log_of(tmp_path, landings=[first, second]))
    assert measures.moving_min == pytest.approx(3.0 / 60.0, rel=0.02)
    never = second | {"arrived_ms": None}
    assert measure(log_of(tmp_path, landings=[first, never])).moving_min == pytest.approx(
        2.0 / 60.0, rel=0.02
    )


def test_questionnaires_against_their_papers() -> None:
    # Kennedy's weights on one symptom of each kind.
    nausea_only = [0] * 16
    nausea_only[15] = 1  # burping
    assert ssq_scores(nausea_only) == {
        "nausea": 9.54, "oculomotor": 0.0, "disorientation": 0.0, "total": 3.74,
    }  # fmt: skip
    both = [0] * 16
    both[4] = 2  # difficulty focusing counts as oculomotor and disorientation
    assert ssq_scores(both)["oculomotor"] == pytest.approx(15.16)
    assert ssq_scores(both)["disorientation"] == pytest.approx(27.84)
    assert ssq_scores(both)["total"] == pytest.approx(4 * 3.74)
    assert vrsq_scores([1, 0, 0, 0, 0, 0, 0, 0, 3])["total"] == pytest.approx(
        (100 / 12 + 300 / 15) / 2
    )


def test_sickness_is_after_less_before(tmp_path: Path) -> None:
    before, after = [0] * 16, [1] * 16
    forms = [
        {"name": "SSQ", "when": "before", "t_ms": 0, "answers": before},
        {"name": "SSQ", "when": "after", "t_ms": 9, "answers": after},
    ]
    measures = measure(log_of(tmp_path, forms=forms))
    assert measures.ssq["total"] == ssq_scores(after)["total"]
    assert measures.vrsq == {}


@pytest.mark.parametrize(
    ("change_of", "message"),
    [
        ({"form": 2}, "form 2, expected 1"),
        ({"condition": "both"}, "damaged log"),
        ({"frames": {"t_ms": [0]}}, "damaged log"),
        ({"changes": [{}]}, "damaged log"),
        ({"forms": [{"name": "SSQ", "when": "after", "answers": [4] * 16}]}, "damaged log"),
    ],
)
def test_damaged_logs_are_refused(change_of: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match=message):
        log_of(tmp_path, **change_of)


def both_forms(after: int) -> list[dict[str, Any]]:
    return [
        {"name": name, "when": when, "t_ms": 0, "answers": [value] * rows}
        for name, rows in (("SSQ", 16), ("VRSQ", 9))
        for when, value in (("before", 0), ("after", after))
    ]


def test_tables_of_many_sessions(tmp_path: Path) -> None:
    paths = []
    for who in ("1", "2", "3"):
        for condition, after in (("landings", 0), ("head", 2 if who != "3" else 1)):
            changes = document()["changes"] if condition == "head" else []
            path = tmp_path / f"{who}-{condition}.json"
            path.write_text(
                json.dumps(
                    document(
                        participant=who, condition=condition, changes=changes,
                        forms=both_forms(after),
                    )
                )
            )  # fmt: skip
            paths.append(path)
    page = evaluate_study(paths, tmp_path / "out")
    conditions, sessions, forms = page.tables
    assert [row.title for row in conditions.rows] == ["landings, 3 sessions", "head, 3 sessions"]
    assert conditions.rows[0].values[0] == 0.0
    assert conditions.rows[1].values[0] == pytest.approx(60.0, rel=0.01)
    assert len(sessions.rows) == 6
    difference = forms.rows[2]
    assert difference.title == "head less landings, 3 participants"
    vrsq = [row.values[-1] for row in forms.rows]
    assert vrsq[2] == pytest.approx(np.mean([200 / 3, 200 / 3, 100 / 3]))
    # Student's t of three: 4.303 standard errors.
    assert vrsq[3] == pytest.approx(
        4.303 * np.std([200 / 3, 200 / 3, 100 / 3], ddof=1) / 3**0.5, rel=1e-3
    )
    html = (tmp_path / "out/study.html").read_text()
    assert html.count("data:image/svg+xml;base64,") == 3
    with (tmp_path / "out/study.csv").open() as file:
        assert all(row["commit"] for row in csv.DictReader(file))


def test_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="--play SCENE"):
        evaluate_study([], tmp_path)


def test_a_log_gives_its_walk(tmp_path: Path) -> None:
    log = log_of(tmp_path)
    walk = walk_of_log(log)
    [leg] = walk["legs"]
    assert leg["position"] == [0.0, 0.0, 0.0]
    assert leg["poses"][0][0] == pytest.approx(RATE_S)
    assert leg["poses"][-1][4] == pytest.approx(120.0)
    assert read_walk(tmp_path / "log.json") == walk
    (tmp_path / "walk.json").write_text(json.dumps(walk))
    assert read_walk(tmp_path / "walk.json") == walk
    with pytest.raises(SurveyError, match="no landing was shown"):
        walk_of_log(log_of(tmp_path, "none", landings=[]))


def test_a_made_walk_stays_on_the_ground() -> None:
    walk = made_walk(shipped_scene(), 15.0, 4.0)
    assert walk == made_walk(shipped_scene(), 15.0, 4.0)
    assert 1 <= len(walk["legs"]) <= 3
    for leg in walk["legs"]:
        poses = np.array(leg["poses"])
        assert (np.diff(poses[:, 0]) > 0).all()
        assert poses[-1, 0] == pytest.approx(4.0)
        steps = np.linalg.norm(np.diff(poses[:, [1, 3]], axis=0), axis=1)
        assert steps.max() < 0.2
        np.testing.assert_allclose(poses[0, 1:4], np.add(leg["position"], [0, 1.7, 0]), atol=2e-3)
