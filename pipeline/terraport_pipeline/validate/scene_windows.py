"""A scene larger than memory, looked at in windows: which segments belong to each.

A window's model holds its segments and all base faces under any of them. The cover rule is then
the one of a world in which the segments outside do not exist: a base face hides iff all of *its
segments in the window* are loaded. That is the hardest case of the scene itself, where a segment
outside, loaded, would be one more surface, and, not loaded, would keep the base face shown. So what
is no hole in the window is none in the scene. Neighbouring windows overlap by the segments that
touch, so that every rim between two segments is in some window.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.validate.handoff import check_hand_off_in_windows
from terraport_pipeline.validate.handoff_report import HandOffOptions, HandOffReport
from terraport_store import Scene

__all__ = ["MAX_WINDOW_FACES", "prove_in_windows", "scene_windows", "segments_around", "windows_of"]

MAX_WINDOW_FACES: Final = 12_000_000
"""Faces of one window without its overlap: some 3.5 GB with the trees that rays need."""


def scene_windows(scene: Scene, max_faces: int = MAX_WINDOW_FACES) -> list[Int64]:
    """Cut a scene into windows.

    Parameters
    ----------
    scene : Scene
        Open.
    max_faces : int
        Most faces of a window, overlap not counted; one segment is never cut.

    Returns
    -------
    list of ndarray of int64
        Segments of every window, ascending. One window with all of them when they fit.
    """
    bounds = scene.index.bounds.astype(np.float64)
    faces = scene.index.face_count.astype(np.int64)
    return windows_of(bounds, faces, max_faces)


def prove_in_windows(
    scene: Scene, options: HandOffOptions, progress: Progress | None = None
) -> HandOffReport:
    """Look for holes in a scene too large to be held; see :func:`~.handoff.check_hand_off`.

    Parameters
    ----------
    scene : Scene
        Open.
    options : HandOffOptions
    progress : Progress, optional

    Returns
    -------
    HandOffReport
    """
    windows = scene_windows(scene)
    faces = scene.index.face_count.astype(np.int64)
    return check_hand_off_in_windows(
        windows,
        lambda segments: load_scene_model(
            scene, segments=segments, progress=progress
        ).hand_off_model(segments),
        [int(faces[segments].sum()) for segments in windows],
        options,
        progress=progress,
    )


def segments_around(
    scene: Scene, point: tuple[float, float, float], max_faces: int = MAX_WINDOW_FACES
) -> Int64:
    """Choose the segments nearest to a place, of so many faces in all; at least one.

    Parameters
    ----------
    scene : Scene
        Open.
    point : (float, float, float)
        Metres, scene frame.
    max_faces : int

    Returns
    -------
    ndarray of int64
        Ascending.
    """
    distance = box_distances_m(scene.index.bounds, np.array(point))
    order = np.argsort(distance, kind="stable")
    passed = np.cumsum(scene.index.face_count[order].astype(np.int64))
    return np.sort(order[: max(1, int(np.searchsorted(passed, max_faces, side="right")))])


def windows_of(bounds: Float64, faces: Int64, max_faces: int) -> list[Int64]:
    """Cut segments into windows by their boxes (S, 6) and faces (S,); see :func:`scene_windows`."""
    centre = (bounds[:, :3] + bounds[:, 3:]) * 0.5
    waiting, cores = [np.arange(len(faces))], []
    while waiting:
        some = waiting.pop()
        if len(some) < 2 or int(faces[some].sum()) <= max_faces:
            cores.append(some)
            continue
        axis = int(np.argmax(np.ptp(centre[some], axis=0)))
        along = some[np.argsort(centre[some, axis], kind="stable")]
        passed = np.cumsum(faces[along])
        cut = int(np.searchsorted(passed, passed[-1] / 2)) + 1
        cut = min(max(cut, 1), len(along) - 1)
        waiting += [along[cut:], along[:cut]]
    if len(cores) == 1:
        return [np.sort(cores[0])]
    windows = []
    for core in cores:
        low, high = bounds[core, :3].min(axis=0), bounds[core, 3:].max(axis=0)
        near = (bounds[:, :3] <= high).all(axis=1) & (bounds[:, 3:] >= low).all(axis=1)
        touching = np.flatnonzero(near)
        windows.append(np.union1d(core, touching[_touches(bounds, core, touching)]))
    return windows


def _touches(bounds: Float64, core: Int64, others: Int64) -> Bool:
    """Whether the boxes of some segments meet any box of the core's."""
    touches = np.zeros(len(others), np.bool_)
    own = bounds[core]
    for number, other in enumerate(others):  # a few thousand segments
        box = bounds[other]
        touches[number] = bool(
            ((own[:, :3] <= box[3:]) & (own[:, 3:] >= box[:3])).all(axis=1).any()
        )
    return touches
