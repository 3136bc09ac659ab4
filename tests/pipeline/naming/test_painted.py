"""Strokes that are painted are answered at once, and published when nobody paints any more."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pipeline.naming.named_ground import ground_at, is_dark, line, write_geojson, write_named_ground
from pipeline.naming.test_teach import accuracy

from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.naming.painted import REST_S, Classroom
from terraport_pipeline.naming.taught_file import MAX_SQUARES, NO_GROUND
from terraport_pipeline.naming.teaching import Lesson, teach
from terraport_pipeline.progress import NullProgress
from terraport_store import (
    Stroke,
    Strokes,
    change_strokes,
    read_manifest,
    read_taught,
    validate_scene,
)

DARK = [[(30.0, 40.0), (38.0, 42.0)], [(20.0, 90.0), (30.0, 92.0)], [(70.0, 95.0), (80.0, 95.0)]]
PALE = [[(70.0, 20.0), (80.0, 25.0)], [(10.0, 10.0), (14.0, 16.0)], [(55.0, 70.0), (65.0, 70.0)]]


def paint(scene: Path, name: str, colour: str, *lines: list[tuple[float, float]]) -> str:
    """Paint strokes; the revision then."""
    revision = ""
    for places in lines:
        body = {"name": name, "colour": colour, "width_m": 3.0, "line": [list(p) for p in places]}

        def more(strokes: Strokes, body: dict[str, Any] = body) -> Strokes:
            stroke_id = f"{len(strokes.strokes):016x}"
            return strokes.with_one(
                Stroke.painted(body, stroke_id=stroke_id, who="a", when="2026-11-24T09:12:07Z")
            )

        revision = change_strokes(scene, more).revision
    return revision


def answer_of(scene: Path) -> dict[str, Any]:
    data = read_taught(scene)
    assert data is not None
    return json.loads(data)


def picture(answer: dict[str, Any], key: str) -> np.ndarray:
    data = zlib.decompress(base64.b64decode(answer[key]))
    return np.frombuffer(data, np.uint8).reshape(answer["rows"], answer["columns"])


def test_each_stroke_is_answered_and_the_last_published(scene: Path) -> None:
    room = Classroom(Lesson(scene, None, None))
    assert room.look(0.0) is None, "nobody has painted"
    version = read_manifest(scene).version
    # (1) One name alone teaches nothing, and it says so.
    first = paint(scene, "tailings", "#336699", *DARK)
    assert room.look(1.0) is not None
    refused = answer_of(scene)
    assert (refused["state"], refused["strokes"]) == ("refused", first)
    assert "strokes of 1 names, expected 2" in refused["text"]
    assert "kind" not in refused
    # (2) With a second name all ground has one.
    revision = paint(scene, "limestone", "#ccaa66", *PALE)
    (said,) = room.look(2.0) or [""]
    assert "answered in" in said
    answer = answer_of(scene)
    assert (answer["state"], answer["strokes"]) == ("taught", revision)
    assert [row["colour"] for row in answer["names"]] == ["#ccaa66", "#336699"]
    assert 1 <= len(answer["places"]) <= 20
    kind, doubt = picture(answer, "kind"), picture(answer, "doubt")
    assert kind.size <= MAX_SQUARES
    rows, columns = np.nonzero(kind != NO_GROUND)
    x = answer["corner_m"][0] + (columns + 0.5) * answer["cell_m"]
    z = answer["corner_m"][1] + (rows + 0.5) * answer["cell_m"]
    assert ((kind[rows, columns] == 1) == is_dark(x, z)).mean() > 0.95
    border = np.abs(np.hypot(x - 35, z - 40) - 18) < 2
    assert doubt[rows, columns][border].mean() > 2 * doubt[rows, columns][~border].mean()
    assert read_manifest(scene).version == version, "nothing is published while somebody paints"
    assert room.look(2.0 + REST_S / 2) is None
    # (3) Nobody paints any more.
    (said,) = room.look(2.0 + REST_S) or [""]
    assert "stable id that they had" in said
    assert answer_of(scene)["state"] == "published"
    assert read_manifest(scene).version != version
    assert accuracy(scene) > 0.98
    assert validate_scene(scene) == []
    assert room.look(100.0) is None
    # (4) The next stroke is answered by the features that are there.
    published = read_manifest(scene).version
    paint(scene, "limestone", "#ccaa66", [(90.0, 10.0), (92.0, 12.0)])
    features = room._teacher.features  # type: ignore[union-attr]
    assert room.look(101.0) is not None
    assert room._teacher.features is features  # type: ignore[union-attr]
    assert room.look(101.0 + REST_S) is not None
    assert read_manifest(scene).version != published
    # (5) Another who comes later finds it done.
    assert Classroom(Lesson(scene, None, None)).look(0.0) is None


def test_taken_back_a_stroke_teaches_no_more(scene: Path) -> None:
    room = Classroom(Lesson(scene, None, None))
    paint(scene, "tailings", "#336699", *DARK)
    paint(scene, "limestone", "#ccaa66", *PALE)
    room.look(0.0)
    for _ in PALE:
        change_strokes(scene, lambda s: s.without(s.strokes[-1].id))
    room.look(1.0)
    assert answer_of(scene)["state"] == "refused"
    assert room.look(1.0 + REST_S) is None, "what was taken back is not published"


def test_over_another_build_it_learns_again(scene: Path, tmp_path: Path) -> None:
    room = Classroom(Lesson(scene, None, None))
    paint(scene, "tailings", "#336699", *DARK)
    paint(scene, "limestone", "#ccaa66", *PALE)
    room.look(0.0)
    write_named_ground(scene, seed=1)
    (said,) = room.look(REST_S) or [""]
    assert "learning again" in said
    assert "answered in" in (room.look(REST_S + 1) or [""])[0]
    assert "stable id" in (room.look(2 * REST_S + 1) or [""])[0]
    assert accuracy(scene) > 0.98


def test_without_watching_painted_strokes_are_taught_too(scene: Path) -> None:
    lesson = Lesson(scene, None, None)
    with pytest.raises(OptionError, match="nothing was painted on"):
        teach(lesson, NullProgress())
    paint(scene, "tailings", "#336699", *DARK)
    paint(scene, "limestone", "#ccaa66", *PALE)
    said, teacher = teach(lesson, NullProgress())
    assert said[0].startswith("learned from 6 strokes")
    assert accuracy(scene) > 0.98
    # 3 m wide, as painted: an area of 10 m by 3 m and its round ends, in squares of teacher.cell_m.
    assert teacher.cell_m < 3.0


def test_a_strokes_own_width_counts(scene: Path, tmp_path: Path) -> None:
    counts = []
    for width_m in (1.0, 8.0):
        path = write_geojson(
            tmp_path / f"{width_m}.geojson",
            [("tailings", line((30, -40), (38, -42))), ("limestone", line((70, -20), (80, -25)))],
        )
        document = json.loads(path.read_text())
        for feature in document["features"]:
            feature["properties"]["width_m"] = width_m
        path.write_text(json.dumps(document))
        said, _ = teach(Lesson(scene, path, None, dry_run=True), NullProgress())
        counts.append(int(said[0].rsplit(" ", 1)[1].replace(",", "")))
    assert counts[1] > 3 * counts[0]
    assert len(ground_at(scene).area) > 0


def test_a_scene_that_would_not_fit_is_refused_and_says_so(scene: Path) -> None:
    paint(scene, "tailings", "#336699", *DARK)
    paint(scene, "limestone", "#ccaa66", *PALE)
    small = Lesson(scene, None, None, max_memory_bytes=2**20)
    with pytest.raises(ResourceError, match=r"GiB to be taught; allowed are 0\.00 GiB: raise"):
        teach(small, NullProgress())
    room = Classroom(small)
    assert "raise --max-memory" in (room.look(0.0) or [""])[0]
    assert answer_of(scene)["state"] == "refused"
    assert room.look(REST_S) is None
