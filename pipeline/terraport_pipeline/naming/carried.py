"""Names that people drew or taught, brought to the next build of the scene.

A build cuts regions by its engine and knows nothing of a plan or of strokes. What people had named
is noted before it publishes, in a file of the work directory, and cut into what it has published:
every face takes the name of the ground that lay nearest there, seen mostly from above, as an
outline on a map would say. The note goes once that is done, so a build that was killed in between
does it next time.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float64, Int32
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.naming.recut import DRAWN, Cut, recut
from terraport_pipeline.naming.republish import Republished, republish
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.ground import Ground, read_ground
from terraport_store import Scene, StoreError

__all__ = ["NOTE_NAME", "NamedGround", "bring_names", "note_names"]

NOTE_NAME: Final = "named_ground.npz"
"""In the work directory: 28 bytes a face of the detail."""

_HEIGHT: Final = 0.1
"""Share of a difference in height that counts as distance: names are of places on a map, and one
that is dug away is still the pit; but what hangs over is told from what lies under it."""

_REACH: Final = 3.0
"""Faces' widths within which ground had been there: beyond, nobody has named anything."""

_KEPT: Final = ("class", "confidence")


@dataclass(frozen=True, slots=True, eq=False)
class NamedGround:
    """The faces of a version, and which of its regions people had drawn or taught."""

    version: str
    crs: str
    places: Float64
    """(F, 3) easting, height and northing of faces' centres, metres; heights count a tenth."""
    named: Int32
    """(F,) place in `regions`; -1 of ground that nobody drew."""
    reach_m: float
    regions: tuple[dict[str, Any], ...]
    """``name``, ``stable_id``, and what regions.json said of it besides."""


def note_names(scene: Path, note: Path, progress: Progress) -> list[str]:
    """Write down what people drew or taught on a published scene; nothing where they did not.

    Parameters
    ----------
    scene : Path
        Scene directory, published before or not.
    note : Path
        :data:`NOTE_NAME` of the work directory. A note that is there is of a build that was killed
        after publishing: it stays, since the scene has not got its names back yet.
    progress : Progress

    Returns
    -------
    list of str
        That names will be lost, and why.
    """
    if note.exists():
        return []
    has_drawn = False
    try:
        with Scene.open(scene) as opened:
            has_drawn = any(_is_drawn(row) for row in opened.regions.get("regions", []))
            if not has_drawn:
                return []
            ground = read_ground(opened, progress)
            crs, origin = _crs(opened), np.array(opened.manifest.origin)
    except (StoreError, PipelineError) as error:
        if not has_drawn:
            return []  # no scene, or none that can be read: the build says so where it reads it
        said = f"names that were drawn or taught are not brought to this version ({error})"
        return [f"{said}: bring the plan again, or teach it"]
    rows: list[dict[str, Any]] = []
    number = np.full(len(ground.document["regions"]), -1, np.int32)
    for region, row in enumerate(ground.document["regions"]):
        name = ground.names.label(region)
        if name is not None and _is_drawn(row):
            number[region] = len(rows)
            facts = {key: row[key] for key in _KEPT if key in row}
            rows.append({"name": name, "stable_id": row["stable_id"], "facts": facts})
    if not rows:
        return []
    about = {
        "version": ground.version, "crs": crs, "regions": rows,
        "reach_m": _REACH * float(np.sqrt(2.0 * ground.area.mean())),
    }  # fmt: skip
    beside = note.with_name(f".{note.name}.tmp")
    with beside.open("wb") as out:
        np.savez(
            out,
            places=_places(ground, origin),
            named=number[ground.region_of_face],
            about=np.frombuffer(json.dumps(about).encode(), np.uint8),
        )
    beside.replace(note)
    return []


def bring_names(scene: Path, note: Path, progress: Progress) -> tuple[list[str], str | None]:
    """Cut what was noted into the version that was published since, and publish that.

    Parameters
    ----------
    scene : Path
    note : Path
        From :func:`note_names`; taken away once the names are there.
    progress : Progress

    Returns
    -------
    said : list of str
        What was brought, and names that have no ground any more.
    version : str or None
        Of the scene with its names; None where there was nothing to bring.
    """
    if not note.exists():
        return [], None
    named = _read(note)
    with Scene.open(scene) as opened:
        if named.crs != _crs(opened):
            note.unlink()
            said = "the scene before is in another coordinate reference system: the names that were"
            return [f"{said} drawn or taught on it were not brought; give them again"], None
        ground = read_ground(opened, progress)
        before = _nearest(named, _places(ground, np.array(opened.manifest.origin)))
        if not (before >= 0).any():
            note.unlink()
            return [_gone(named, before)], None
        new = recut(ground, _cut(ground, named, before))
        done = republish(opened, ground, new, progress)
    note.unlink()
    return _said(named, before, done), done.version


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
            about["version"], about["crs"], arrays["places"], arrays["named"],
            float(about["reach_m"]), tuple(about["regions"]),
        )  # fmt: skip


def _nearest(named: NamedGround, places: Float64) -> Int32:
    """Region before that every face lies in, (F,); -1 of ground that nobody drew."""
    middle = named.places.mean(axis=0)  # eastings of millions leave little to a float's last digits
    tree = cKDTree(named.places - middle)
    distance, at = tree.query(places - middle, distance_upper_bound=named.reach_m, workers=-1)
    known = np.append(named.named, np.int32(-1))
    return np.where(np.isfinite(distance), known[at], np.int32(-1)).astype(np.int32)


def _cut(ground: Ground, named: NamedGround, before: Int32) -> Cut:
    first = int(ground.region_of_face.max()) + 1
    pieces = np.where(before >= 0, first + before, ground.region_of_face).astype(np.int32)
    there = np.unique(before[before >= 0]).tolist()
    return Cut(
        pieces,
        {first + at: named.regions[at]["name"] for at in there},
        {first + at: named.regions[at]["facts"] for at in there},
        {first + at: named.regions[at]["stable_id"] for at in there},
    )


def _said(named: NamedGround, before: Int32, done: Republished) -> list[str]:
    there = np.unique(before[before >= 0])
    versions = f"{named.version[:12]}: version {done.version[:12]}"
    said = [f"{len(there)} regions that were drawn or taught were brought from version {versions}"]
    if len(there) < len(named.regions):
        said.append(_gone(named, before))
    return said


def _gone(named: NamedGround, before: Int32) -> str:
    there = set(before.tolist())
    lost = [row["name"] for at, row in enumerate(named.regions) if at not in there]
    listed = ", ".join(repr(name) for name in lost[:10])
    more = f" and {len(lost) - 10} more" if len(lost) > 10 else ""
    return f"{len(lost)} names that were drawn or taught have no ground any more: {listed}{more}"
