"""Names that people drew or taught, brought to the next build of the scene.

A build cuts regions by its engine and knows nothing of a plan or of strokes. Where people had named
ground on the scene, the build publishes beside it, in its work directory; what was named is then
cut into that, and the result is the scene's next version: nobody sees the one between. Every face
takes the name of the ground that lay nearest there, seen mostly from above, as an outline on a map
would say; ids are those of the version before, and only what is new ground takes a new one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float64, Int32
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.naming.recut import DRAWN, Cut, Earlier, recut
from terraport_pipeline.naming.republish import Republished, republish
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.ground import MAX_FACES, Ground, read_ground
from terraport_store import Scene, StoreError, read_labels

__all__ = ["NOTE_NAME", "UNNAMED_NAME", "NamedGround", "bring_names", "note_names"]

NOTE_NAME: Final = "named_ground.npz"
"""In the work directory: 28 bytes a face of the detail."""

UNNAMED_NAME: Final = "unnamed"
"""In the work directory while a build runs: the scene without its names."""

_HEIGHT: Final = 0.1
"""Share of a difference in height that counts as distance: names are of places on a map, and one
that is dug away is still the pit; but what hangs over is told from what lies under it."""

_REACH: Final = 3.0
"""Faces' widths within which ground had been there: beyond, nobody has named anything."""

_KEPT: Final = ("class", "confidence")
_NOTED: Final = ("stable_id", "label", DRAWN, *_KEPT)


@dataclass(frozen=True, slots=True, eq=False)
class NamedGround:
    """The faces of a version, and what was said of its regions."""

    version: str
    crs: str
    places: Float64
    """(F, 3) easting, height and northing of faces' centres, metres; heights count a tenth."""
    region: Int32
    """(F,) place in `rows`."""
    reach_m: float
    next_stable_id: int
    area_m2: Float64
    """(R,)"""
    rows: tuple[dict[str, Any], ...]
    """(R,) of regions.json: ``stable_id``, and what it says of names."""
    labels: tuple[str | None, ...]
    """(R,) what people call them."""
    named: tuple[int, ...]
    """Which of them people had drawn or taught."""


def note_names(scene: Path, note: Path, faces: int, progress: Progress) -> list[str]:
    """Write down what people drew or taught on a published scene; nothing where they did not.

    Parameters
    ----------
    scene : Path
        Scene directory, published before or not.
    note : Path
        :data:`NOTE_NAME` of the work directory. One that is there is of a build that was killed.
    faces : int
        Of the detail that the names shall be brought to.
    progress : Progress

    Returns
    -------
    list of str
        That names will be lost, and why.
    """
    note.unlink(missing_ok=True)
    has_drawn = False
    try:
        with Scene.open(scene) as opened:
            has_drawn = any(_is_drawn(row) for row in opened.regions.get("regions", []))
            if not has_drawn:
                return []
            if faces > MAX_FACES:
                return [_lost(f"{faces:,} faces, expected at most {MAX_FACES:,}")]
            ground = read_ground(opened, progress)
            crs, origin = _crs(opened), np.array(opened.manifest.origin)
    except (StoreError, PipelineError) as error:
        if not has_drawn:
            return []  # no scene, or none that can be read: the build says so where it reads it
        return [_lost(str(error))]
    old = ground.document["regions"]
    labels = [ground.names.label(region) for region in range(len(old))]
    named = [n for n, row in enumerate(old) if labels[n] is not None and _is_drawn(row)]
    if not named:
        return []
    about = {
        "version": ground.version, "crs": crs, "labels": labels, "named": named,
        "rows": [{key: row[key] for key in _NOTED if key in row} for row in old],
        "next_stable_id": ground.names.next_stable_id,
        "reach_m": _REACH * float(np.sqrt(2.0 * ground.area.mean())),
    }  # fmt: skip
    beside = note.with_name(f".{note.name}.tmp")
    with beside.open("wb") as out:
        np.savez(
            out,
            places=_places(ground, origin),
            region=ground.region_of_face,
            area_m2=np.bincount(ground.region_of_face, ground.area, len(old)),
            about=np.frombuffer(json.dumps(about).encode(), np.uint8),
        )
    beside.replace(note)
    return []


def bring_names(
    unnamed: Path, scene: Path, note: Path, progress: Progress
) -> tuple[list[str], str]:
    """Cut what was noted into a version that nobody has seen, and publish that.

    Parameters
    ----------
    unnamed : Path
        Scene directory of the build's version, without names.
    scene : Path
        Where to publish it; the version that was noted stands there.
    note : Path
        From :func:`note_names`.
    progress : Progress

    Returns
    -------
    said : list of str
        What was brought, and names that have no ground any more.
    version : str
        Of the scene with its names.

    Raises
    ------
    SceneBusyError
        Somebody has published since the names were noted.
    """
    named = _read(note)
    with Scene.open(unnamed) as opened:
        ground = read_ground(opened, progress)
        ground = replace(ground, names=ground.names.with_labels(read_labels(scene)))
        over = scene, named.version
        if named.crs != _crs(opened):
            done = republish(
                opened, ground, recut(ground, Cut(ground.region_of_face)), progress, over=over
            )
            said = "the scene before is in another coordinate reference system: the names that were"
            return [f"{said} drawn or taught on it were not brought; give them again"], done.version
        before = _nearest(named, _places(ground, np.array(opened.manifest.origin)))
        new = recut(ground, *_cut(ground, named, before))
        done = republish(opened, ground, new, progress, over=over)
    return _said(named, before, done), done.version


def _lost(why: str) -> str:
    said = f"names that were drawn or taught are not brought to this version ({why})"
    return f"{said}: bring the plan again, or teach it"


def _is_drawn(row: object) -> bool:
    return isinstance(row, dict) and row.get(DRAWN) is True


def _crs(scene: Scene) -> str:
    crs = scene.manifest.crs
    if crs is None:
        return ""
    return f"EPSG:{crs.epsg}" if crs.epsg is not None else f"{crs.name} {crs.wkt}"


def _places(ground: Ground, origin: Float64) -> Float64:
    """Centres of faces in the survey's metres: frames of two versions may differ."""
    east, north, height = origin
    x, y, z = ground.centres.T
    return np.stack([x + east, _HEIGHT * (y + height), north - z], axis=1)


def _read(note: Path) -> NamedGround:
    with np.load(note, allow_pickle=False) as arrays:
        about = json.loads(arrays["about"].tobytes())
        return NamedGround(
            about["version"], about["crs"], arrays["places"], arrays["region"],
            float(about["reach_m"]), int(about["next_stable_id"]), arrays["area_m2"],
            tuple(about["rows"]), tuple(about["labels"]), tuple(about["named"]),
        )  # fmt: skip


def _nearest(named: NamedGround, places: Float64) -> Int32:
    """Region before that every face lies in, (F,); -1 of ground that was not there."""
    middle = named.places.mean(axis=0)  # eastings of millions leave little to a float's last digits
    tree = cKDTree(named.places - middle)
    distance, at = tree.query(places - middle, distance_upper_bound=named.reach_m, workers=-1)
    known = np.append(named.region, np.int32(-1))
    return np.where(np.isfinite(distance), known[at], np.int32(-1)).astype(np.int32)


def _cut(ground: Ground, named: NamedGround, before: Int32) -> tuple[Cut, Earlier]:
    first = int(ground.region_of_face.max()) + 1
    is_named = np.isin(before, named.named)
    pieces = np.where(is_named, first + before, ground.region_of_face).astype(np.int32)
    there = np.unique(before[is_named]).tolist()
    cut = Cut(
        pieces,
        {first + at: str(named.labels[at]) for at in there},
        {first + at: {k: named.rows[at][k] for k in _KEPT if k in named.rows[at]} for at in there},
    )
    earlier = Earlier(
        before, named.area_m2, named.rows, named.labels, named.next_stable_id,
        {first + at: at for at in there},
    )  # fmt: skip
    return cut, earlier


def _said(named: NamedGround, before: Int32, done: Republished) -> list[str]:
    there = np.intersect1d(before, named.named)
    said = []
    if len(there):
        versions = f"{named.version[:12]}: version {done.version[:12]}"
        said = [
            f"{len(there)} regions that were drawn or taught were brought from version {versions}"
        ]
    lost = [str(named.labels[at]) for at in named.named if at not in there]
    if lost:
        listed = ", ".join(repr(name) for name in lost[:10])
        more = f" and {len(lost) - 10} more" if len(lost) > 10 else ""
        said.append(
            f"{len(lost)} names that were drawn or taught have no ground any more: {listed}{more}"
        )
    return said
