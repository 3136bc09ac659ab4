"""From strokes, or a model of a survey before, to a scene whose regions have those names."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.errors import OptionError, PlanError, ResourceError
from terraport_pipeline.export.frame import survey_frame
from terraport_pipeline.free_memory import default_memory_bytes
from terraport_pipeline.naming.doubt import write_doubt
from terraport_pipeline.naming.drawings import Drawing, read_drawings
from terraport_pipeline.naming.model_file import GroundModel, read_model, write_model
from terraport_pipeline.naming.plan import published_text
from terraport_pipeline.naming.recut import recut
from terraport_pipeline.naming.republish import republish
from terraport_pipeline.naming.teacher import STROKE_CELLS, Answer, Teacher, stroke_areas
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.ground import read_ground
from terraport_store import Scene, read_manifest
from terraport_store.layout import STROKES

__all__ = [
    "FACE_BYTES",
    "Lesson",
    "check_memory",
    "learn",
    "painted_lesson",
    "read_drawn",
    "teach",
    "teach_again",
]

_POLL_S = 0.25

FACE_BYTES: Final = 600
"""Of a face: 150 as it is read, and 446 measured on 147,124 faces, .22 squares each, while patches
are made."""


@dataclass(frozen=True, slots=True)
class Lesson:
    """What a scene shall be taught."""

    scene: Path
    strokes: Path | None
    """Without strokes and model: what was painted in the viewer."""
    model: Path | None
    """Instead of strokes: what an earlier survey was taught."""
    save_model: Path | None = None
    uncertainty: Path | None = None
    name_field: str | None = None
    layer: str | None = None
    crs: str | None = None
    stroke_width_m: float | None = None
    """Of lines and points; None: four squares."""
    cell_m: float | None = None
    least_m2: float | None = None
    max_memory_bytes: int | None = None
    """That reading and measuring the ground may take; None: most of what is free."""
    force: bool = False
    dry_run: bool = False
    """Say and write everything, and leave the scene as it is."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if self.strokes is not None and self.model is not None:
            raise OptionError("expected strokes to learn from, or --model, one of the two")
        for option in ("stroke_width_m", "cell_m", "least_m2"):
            value = getattr(self, option)
            if value is not None and not (np.isfinite(value) and value > 0):
                shown = option.replace("_", "-")
                raise OptionError(f"--{shown} {value}; expected a number above 0")
        if self.model is not None and self.cell_m is not None:
            raise OptionError("--cell-m is of strokes: a model has the one that it was taught with")

    @property
    def is_painted(self) -> bool:
        """Whether it is of the strokes that were painted in the viewer."""
        return self.strokes is None and self.model is None

    def of(self, scene: Path) -> Lesson:
        """Return the same lesson for another scene."""
        return replace(self, scene=scene)


def teach(
    lesson: Lesson, progress: Progress, before: Teacher | None = None
) -> tuple[list[str], Teacher]:
    """Teach a scene its names and publish it.

    Parameters
    ----------
    lesson : Lesson
    progress : Progress
    before : Teacher, optional
        Of the same scene: its features are kept.

    Returns
    -------
    list of str
        What was learned and done.
    Teacher
        To teach again with.

    Raises
    ------
    PlanError, OptionError
        Strokes or model cannot be used; nothing was changed.
    SceneStoreError
        The scene cannot be read, or not be published.
    """
    said: list[str] = []
    threads = os.cpu_count() or 1
    if lesson.is_painted:
        lesson = painted_lesson(lesson)
    with Scene.open(lesson.scene) as scene:
        # (1) What is wrong with the files, before minutes of measuring.
        model = None if lesson.model is None else read_model(lesson.model)
        drawn = None if lesson.strokes is None else read_drawn(lesson)
        # (2) The ground and its features.
        check_memory(scene.manifest.counts.detail_faces, lesson.max_memory_bytes)
        ground = read_ground(scene, progress)
        if not scene.manifest.has_colour and scene.manifest.textures is None:
            said.append("warning: the scene has no colour: names are told by form alone")
        cell_m = lesson.cell_m if model is None else model.cell_m
        teacher = Teacher(
            ground,
            cell_m=cell_m,
            attributes=None if model is None else model.attributes,
            threads=threads,
            before=before,
        )
        progress.start("features", None, "squares")
        features = teacher.features
        progress.done({"squares": teacher.units.count, "features": features.shape[1]})
        # (3) Learn, and say what everything is.
        progress.start("names", None, "squares")
        if model is None:
            assert drawn is not None
            model, counts = learn(lesson, drawn, teacher)
            listed = ", ".join(f"{name} {count:,}" for name, count in counts.items())
            said.append(
                f"learned from {len(drawn)} strokes, in squares of {teacher.cell_m:g} m: {listed}"
            )
        answer = teacher.answer(model)
        progress.done({"names": len(model.names)})
        said += _summary(teacher, answer)
        # (4) Files first: they do no harm where the scene cannot be published.
        said += _files(lesson, teacher, model, answer)
        if lesson.dry_run:
            return [*said, "the scene is as it was (--dry-run)"], teacher
        new = recut(ground, teacher.cut(answer, lesson.least_m2))
        said.append(published_text(republish(scene, ground, new, progress)))
    return said, teacher


def check_memory(faces: int, allowed: int | None) -> None:
    """Refuse ground that would take more memory than there is.

    Raises
    ------
    ResourceError
        Says how much it would take.
    """
    most = default_memory_bytes() if allowed is None else allowed
    need = FACE_BYTES * faces
    if need > most:
        raise ResourceError(
            f"{faces:,} faces take about {need / 2**30:.2f} GiB to be taught; allowed are "
            f"{most / 2**30:.2f} GiB: raise --max-memory, or teach a scene of fewer points "
            "(terraport build --max-points)"
        )


def painted_lesson(lesson: Lesson) -> Lesson:
    """Return the lesson with the strokes that were painted in the viewer.

    Raises
    ------
    OptionError
        Nothing was painted on the scene.
    """
    strokes = lesson.scene / STROKES
    manifest = read_manifest(lesson.scene)
    if not strokes.exists():
        raise OptionError(
            f"nothing was painted on {lesson.scene} yet, and neither strokes nor --model are named"
        )
    crs = None
    if manifest.crs is not None and survey_frame(manifest).crs is not None:
        crs = manifest.crs.wkt or f"EPSG:{manifest.crs.epsg}"
    return replace(lesson, strokes=strokes, crs=crs, name_field=None, layer=None)


def read_drawn(lesson: Lesson) -> tuple[Drawing, ...]:
    """Read the strokes of a lesson.

    Raises
    ------
    PlanError
        They cannot be read, or one has no name.
    """
    assert lesson.strokes is not None
    drawn = read_drawings(
        lesson.strokes, survey_frame(read_manifest(lesson.scene)), crs=lesson.crs,
        layer=lesson.layer, name_field=lesson.name_field, points=True,
    )  # fmt: skip
    nameless = [d.number for d in drawn.drawings if d.name is None]
    if nameless:
        raise PlanError(
            lesson.strokes,
            f"{len(nameless)} strokes without a name (the first is feature {nameless[0]})",
            "name each in a property name, label or layer, or say which (--name-field)",
        )
    return drawn.drawings


def learn(
    lesson: Lesson, drawn: Sequence[Drawing], teacher: Teacher
) -> tuple[GroundModel, dict[str, int]]:
    """Learn from strokes; see :meth:`Teacher.learn`."""
    width_m = lesson.stroke_width_m or STROKE_CELLS * teacher.cell_m
    return teacher.learn(stroke_areas(drawn, width_m))


def teach_again(lesson: Lesson, say: Callable[[list[str]], None], progress: Progress) -> None:
    """Teach a scene, and anew whenever its file of strokes is saved; until it is stopped.

    Parameters
    ----------
    lesson : Lesson
        With strokes.
    say : callable
        Gets what was done, and what was wrong with the strokes, each time.
    progress : Progress
        Of the first time.
    """
    assert lesson.strokes is not None
    teacher: Teacher | None = None
    seen = None
    while True:
        stamp = lesson.strokes.stat().st_mtime_ns if lesson.strokes.exists() else None
        if stamp is not None and stamp != seen:
            seen = stamp
            start = time.perf_counter()
            try:
                said, teacher = teach(
                    lesson, progress if teacher is None else NullProgress(), teacher
                )
                say([*said, f"{time.perf_counter() - start:.1f} s; waiting for the next stroke"])
            except (PlanError, OptionError) as error:
                if teacher is None:
                    raise
                say([f"error: {error}; waiting for the strokes to be saved again"])
        time.sleep(_POLL_S)


def _summary(teacher: Teacher, answer: Answer) -> list[str]:
    """Area of every name, and how sure it is."""
    area = teacher.ground.area
    said = []
    for kind in np.argsort(-np.bincount(answer.best, area, len(answer.names))).tolist():
        here = answer.best == kind
        m2 = float(area[here].sum())
        if m2 == 0.0:
            said.append(f"  {answer.names[kind]}: nowhere")
            continue
        sure = float((area[here] * answer.sure[here]).sum() / m2)
        said.append(f"  {answer.names[kind]}: {m2:,.0f} m², confidence {sure:.2f}")
    return said


def _files(lesson: Lesson, teacher: Teacher, model: GroundModel, answer: Answer) -> list[str]:
    said = []
    if lesson.save_model is not None:
        write_model(lesson.save_model, model, force=lesson.force)
        said.append(
            f"{lesson.save_model}: for the next survey, terraport teach SCENE --model "
            f"{lesson.save_model}"
        )
    if lesson.uncertainty is not None:
        frame = survey_frame(read_manifest(lesson.scene))
        count = write_doubt(lesson.uncertainty, teacher, answer, frame, force=lesson.force)
        said.append(f"{lesson.uncertainty}: where the next stroke pays ({count:,})")
    return said
