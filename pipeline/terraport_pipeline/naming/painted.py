"""Teaching by the strokes that are painted in the viewer, while they are painted.

The service keeps strokes beside the scene and learns nothing; this is the program beside it. Each
change of the strokes is answered at once, in ``taught.json``: features are kept, so a forest and
its answer are all that is computed. The regions of the scene are published once nobody has painted
for a while: that writes the scene, and would come late for every stroke.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.naming.plan import published_text
from terraport_pipeline.naming.recut import recut
from terraport_pipeline.naming.republish import republish
from terraport_pipeline.naming.taught_file import State, refused_file, taught_file
from terraport_pipeline.naming.teacher import Answer, Teacher
from terraport_pipeline.naming.teaching import (
    Lesson,
    check_memory,
    learn,
    painted_lesson,
    read_drawn,
)
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.ground import read_ground
from terraport_store import (
    LabelError,
    Scene,
    SceneBusyError,
    StoreError,
    Strokes,
    list_scenes,
    read_manifest,
    read_strokes,
    read_taught,
    write_taught,
)
from terraport_store.layout import STROKES

__all__ = ["REST_S", "Classroom", "teach_painted"]

REST_S: Final = 10.0
"""So long nobody has painted before the scene is published."""

_POLL_S: Final = 0.25

Say = Callable[[list[str]], None]


class Classroom:
    """One scene that is painted on.

    Parameters
    ----------
    lesson : Lesson
        What is asked of all its teaching; strokes are the scene's own.
    """

    def __init__(self, lesson: Lesson) -> None:
        self._lesson = lesson
        self._scene = lesson.scene
        self._teacher: Teacher | None = None
        self._versions: set[str] = set()
        """Of the very ground that the teacher has measured."""
        self._stamp: tuple[int, int] | None = None
        self._answer: Answer | None = None
        self._strokes = Strokes()
        self._text = ""
        self._changed_s = 0.0

    @property
    def is_waiting(self) -> bool:
        """Whether something was taught that is not published."""
        return self._answer is not None

    def forget(self) -> None:
        """Give back the memory of features; the next stroke measures anew."""
        self._teacher, self._versions = None, set()

    def look(self, now_s: float) -> list[str] | None:
        """Answer new strokes, or publish what was taught once nobody paints.

        Parameters
        ----------
        now_s : float
            Any steady clock.

        Returns
        -------
        list of str or None
            What was done; None where there was nothing to do.
        """
        stamp = self._stamp_now()
        if stamp is not None and stamp != self._stamp:
            self._stamp = stamp
            self._changed_s = now_s
            return self._answer_them()
        if self.is_waiting and now_s - self._changed_s >= REST_S:
            self._changed_s = now_s
            return self._publish()
        return None

    def _stamp_now(self) -> tuple[int, int] | None:
        try:
            found = (self._scene / STROKES).stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_ino

    def _answer_them(self) -> list[str] | None:
        start_s = time.perf_counter()
        self._answer = None
        self._strokes = read_strokes(self._scene)
        revision = self._strokes.revision
        if _is_answered(self._scene, revision):
            return None
        try:
            teacher = self._taught_by()
            lesson = painted_lesson(self._lesson)
            model, counts = learn(lesson, read_drawn(lesson), teacher)
        except (PipelineError, LabelError) as error:
            write_taught(self._scene, refused_file(revision, str(error)))
            return [f"{self._scene.name}: {error}"]
        self._answer = teacher.answer(model)
        listed = ", ".join(f"{name} {count:,}" for name, count in counts.items())
        self._text = f"learned from squares of {teacher.cell_m:g} m: {listed}"
        self._write("taught")
        taken_s = time.perf_counter() - start_s
        return [f"{self._scene.name}: {self._text}; answered in {taken_s:.1f} s"]

    def _taught_by(self) -> Teacher:
        """Return a teacher of the ground as it is published now."""
        if self._teacher is None or read_manifest(self._scene).version not in self._versions:
            with Scene.open(self._scene) as scene:
                faces = scene.manifest.counts.detail_faces
                check_memory(faces, self._lesson.max_memory_bytes)
                ground = read_ground(scene, NullProgress())
            self._teacher = Teacher(
                ground,
                cell_m=self._lesson.cell_m,
                threads=os.cpu_count() or 1,
                before=self._teacher,
            )
            self._versions = {ground.version}
        return self._teacher

    def _publish(self) -> list[str] | None:
        assert self._answer is not None
        assert self._teacher is not None
        teacher = self._teacher
        with Scene.open(self._scene) as scene:
            if scene.manifest.version not in self._versions:
                # Built anew meanwhile: the strokes are of the ground, and are asked again.
                self._answer, self._stamp = None, None
                return [f"{self._scene.name}: published by somebody else; learning again"]
            ground = teacher.ground
            if scene.manifest.version != ground.version:
                # Our own regions since: the same faces under other numbers.
                ground = read_ground(scene, NullProgress())
                teacher = Teacher(ground, cell_m=teacher.cell_m, before=teacher)
                self._teacher = teacher
            new = recut(ground, teacher.cut(self._answer, self._lesson.least_m2))
            try:
                done = republish(scene, ground, new, NullProgress())
            except SceneBusyError as error:
                return [f"{self._scene.name}: {error}; tried again after {REST_S:g} s"]
        self._versions.add(done.version)
        self._write("published")
        self._answer = None
        return [f"{self._scene.name}: {published_text(done)}"]

    def _write(self, state: State) -> None:
        assert self._answer is not None
        assert self._teacher is not None
        colours = {stroke.name: stroke.colour for stroke in self._strokes.strokes}
        data = taught_file(
            self._teacher, self._answer, colours, self._strokes.revision, state, self._text
        )
        write_taught(self._scene, data)


def teach_painted(lesson: Lesson, say: Say) -> None:
    """Teach a scene, or all scenes of a folder, by what is painted on them; until it is stopped.

    One scene's features are held at a time, those of the last one painted on.

    Parameters
    ----------
    lesson : Lesson
        ``scene`` may be a folder of scenes.
    say : callable
        Gets what was done.

    Raises
    ------
    OptionError
        It shall write a model or where it is unsure.
    SceneNotFoundError
        There is no folder at that path.
    """
    if lesson.save_model is not None or lesson.uncertainty is not None:
        raise OptionError(
            "--watch of painted strokes writes no --save-model and no --uncertainty; run it once "
            "more without --watch"
        )
    rooms: dict[Path, Classroom] = {}
    at: Path | None = None
    while True:
        for scene in list_scenes(lesson.scene).values():
            room = rooms.setdefault(scene, Classroom(lesson.of(scene)))
            try:
                said = room.look(time.monotonic())
            except StoreError as error:
                said = [f"{scene.name}: error: {error}"]
            if said is None:
                continue
            say(said)
            if at is not None and at != scene and not rooms[at].is_waiting:
                rooms[at].forget()
            at = scene
        time.sleep(_POLL_S)


def _is_answered(scene: Path, revision: str) -> bool:
    """Whether the scene has the regions of these very strokes."""
    data = read_taught(scene)
    if data is None:
        return False
    try:
        document = json.loads(data)
        return bool(document["strokes"] == revision and document["state"] == "published")
    except (ValueError, KeyError, TypeError):
        return False
