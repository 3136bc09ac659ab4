"""Stable ids of a new version's regions, carried over from the version published before.

The thin shell around :mod:`~terraport_pipeline.geometry.regions.region_match`: it reads the
published scene, brings both surfaces into one frame and writes the numbers into the region facts.
Rules in ``spec/scene-format.md``, section "regions.json".

Where the build that published the version before is at hand, regions were matched already, before
they were numbered (``tiles/numbered_regions.py``), and ids go by the numbers. In a new place a
build takes nothing from before, and numbers are 0, 1, 2, ...
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from terraport_payload import PayloadError, SegmentMesh
from terraport_payload.types import Float32, Float64, Int32, UInt32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.surface_samples import SurfaceSamples, surface_samples
from terraport_pipeline.geometry.regions.region_match import (
    carry_ids,
    match_regions,
    region_overlaps,
)
from terraport_pipeline.progress import Progress
from terraport_store import (
    CorruptPayloadError,
    CrsInfo,
    DamagedSceneError,
    RegionNames,
    Scene,
    SceneNotFoundError,
    read_labels,
)
from terraport_store.labels import MAX_STABLE_ID
from terraport_store.manifest import Manifest

__all__ = ["CarriedNumbers", "NumberedRegions", "Surface", "number_regions"]

_SAMPLES: Final = 500_000
"""Faces of one surface that are looked at; all of them where it has no more. Two trees of so many
points take three seconds and 60 MB."""

_LEAST_SAMPLES: Final = (32, 64)
"""Fewest samples of a region in a segment, however small: the second, or less down to the first
where there are so many such pieces that they would take more than _SAMPLES. The border of a region
is known to about a quarter of the distance of its samples: with 8 of them, two thirds in common
look like 0.39, and a third of 65,000 regions lost their number (``benchmarks/regions.py``)."""

_INHERITED: Final = 0.6
"""Share of a new region's ground within one old region, from which on it has that one's name. Who
taught or drew names has cut the ground in another way than an engine does: few of the engine's
regions are the same ground as one of theirs, and most lie within one."""

_LISTED_LABELS: Final = 10
"""Labels that a warning spells out."""


class Surface(Protocol):
    """What is about to be published, read piece by piece."""

    @property
    def face_count(self) -> int:
        """Number of faces of the detail."""
        ...

    @property
    def origin(self) -> Float64:
        """Easting, northing and height of the scene's origin, (3,) metres."""
        ...

    @property
    def crs(self) -> CrsInfo | None:
        """Coordinate reference system of the survey; None where it states none."""
        ...

    def pieces(self) -> Iterator[tuple[Float32, Int32, Int32]]:
        """Give every segment's vertices, faces (F, 3) and their regions (F,), always in one order.

        Vertices may be those of more than the segment.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CarriedNumbers:
    """Regions that go on from a version, by their numbers in it."""

    version: str
    before: Int32
    """(R,) number there of every region; -1 of a new one."""

    def is_of(self, manifest: Manifest, surface: Surface) -> bool:
        """Whether a published scene is that version, and in the frame of the new surface."""
        return self.version == manifest.version and tuple(surface.origin) == tuple(manifest.origin)


@dataclass(frozen=True, slots=True)
class NumberedRegions:
    """Region facts with stable ids, and how they came about."""

    document: dict[str, Any]
    """Contents of regions.json."""
    counts: dict[str, int]
    """``regions_kept``, ``regions_new``, ``regions_retired``."""
    warnings: tuple[str, ...] = ()


@dataclass(slots=True)
class _Before:
    """Ids and labels of the version before, as far as they could be read, and what goes on."""

    first_free: int = 0
    ids: UInt32 = field(default_factory=lambda: np.zeros(0, np.uint32))
    matched: tuple[Int32, Int32] = field(
        default_factory=lambda: (np.zeros(0, np.int32), np.zeros(0, np.int32))
    )
    """Regions that are the same, by their numbers now and then."""
    labels: Mapping[int, str] = field(default_factory=dict)
    lies_in: Mapping[int, int] = field(default_factory=dict)
    """Region before that most of a region's ground lies in, by its number now."""
    given: RegionNames = field(default_factory=RegionNames)
    """Names that the version before gave."""
    drawn: frozenset[int] = frozenset()
    """Stable ids of regions that people cut: they are cut anew, with their names."""
    warnings: list[str] = field(default_factory=list)


def number_regions(
    scene: Path,
    facts: Mapping[str, Any],
    surface: Surface,
    progress: Progress,
    carried: CarriedNumbers | None = None,
) -> NumberedRegions:
    """Give every region its stable id.

    Parameters
    ----------
    scene : Path
        Scene directory, published before or not; locked by the caller.
    facts : mapping
        Contents of regions.json without stable ids; not modified.
    surface : Surface
    progress : Progress
        Advances by segments of the version before.
    carried : CarriedNumbers, optional
        What is known of that version, or of another; used where it is that one.

    Returns
    -------
    NumberedRegions
        Of the same inputs and the same version before, always the same. Labels count for the
        warnings alone, and for the lowest number where the version before cannot be read.

    Raises
    ------
    OptionError
        All 2^32 numbers are used.
    DamagedSceneError
        Neither the scene before nor its labels can be read.
    """
    # (1) Match the regions to those of the version before, by the surface they share.
    before = _before(scene, surface, progress, carried)
    rows = facts["regions"]
    ids, first_free = carry_ids(len(rows), before.matched, before.ids, before.first_free)
    if first_free > MAX_STABLE_ID + 1:
        raise OptionError(
            f"stable ids up to {first_free - 1}; expected at most {MAX_STABLE_ID}: build the scene "
            "in a new place"
        )
    # (2) The document: stable ids beside the numbers of this version. Invariant: an id is never
    # given to another region, not even after its own has gone.
    document = {
        "next_stable_id": first_free,
        **{key: value for key, value in facts.items() if key != "regions"},
        "regions": [
            {"id": row["id"], "stable_id": number, **row}
            for row, number in zip(rows, ids.tolist(), strict=True)
        ],
    }
    # (3) Names of ground that was cut in another way.
    heirs = _inherited(document["regions"], before)
    # (4) What was carried over, and labels that lost their region.
    kept = len(before.matched[0])
    counts = {
        "regions_kept": kept,
        "regions_new": len(rows) - kept,
        "regions_retired": len(before.ids) - kept,
    }
    gone = set(before.ids.tolist()) - set(ids.tolist())
    lost = [
        f"{label!r} ({n})"
        for n, label in before.labels.items()
        if n in gone and n not in before.drawn and label not in heirs
    ]
    if lost:
        more = len(lost) - _LISTED_LABELS
        listed = ", ".join(lost[:_LISTED_LABELS]) + (f" and {more} more" if more > 0 else "")
        before.warnings.append(
            f"{len(lost)} labels have no region any more: {listed}; give them again with "
            "terraport label"
        )
    return NumberedRegions(document, counts, tuple(before.warnings))


def _inherited(rows: list[dict[str, Any]], before: _Before) -> set[str]:
    """Give regions that are new the name of the ground that they lie in; say which names."""
    names = before.given.with_labels(before.labels)
    kept = set(before.matched[0].tolist())
    heirs: set[str] = set()
    for region, old in before.lies_in.items():
        if int(before.ids[old]) in before.drawn:
            continue
        name = names.label(old)
        if name is not None and region not in kept and "label" not in rows[region]:
            rows[region]["label"] = name
            heirs.add(name)
    return heirs


def _before(
    scene: Path, surface: Surface, progress: Progress, carried: CarriedNumbers | None
) -> _Before:
    """Read ids and labels of the published version, as far as they can be read, and match it."""
    before = _Before()
    try:
        with Scene.open(scene) as opened:
            names = RegionNames.of(opened.regions, file=opened.manifest.files["regions.json"].path)
            if names.stable_ids is not None:
                before.first_free, before.ids = names.next_stable_id, names.stable_ids
                before.given = names
                before.drawn = frozenset(
                    row["stable_id"]
                    for row in opened.regions["regions"]
                    if isinstance(row, dict) and row.get("drawn") is True
                )
                if not _same_crs(opened.manifest.crs, surface.crs):
                    before.warnings.append(
                        "the scene published before is in another coordinate reference system: all "
                        "regions get new stable ids"
                    )
                elif carried is not None and carried.is_of(opened.manifest, surface):
                    goes_on = np.flatnonzero(carried.before >= 0).astype(np.int32)
                    before.matched = goes_on, carried.before[goes_on]
                elif len(before.ids):
                    before.matched = _matched(opened, before, surface, progress)
    except SceneNotFoundError:
        return before
    except DamagedSceneError as error:
        labels = read_labels(scene)
        before.first_free = max(labels, default=-1) + 1
        before.warnings.append(
            f"the scene published before cannot be read ({error}): all regions get new stable ids"
        )
        return before
    try:
        before.labels = read_labels(scene)
    except DamagedSceneError as error:
        before.warnings.append(f"labels cannot be read ({error}); restore or delete labels.json")
    return before


def _matched(
    scene: Scene, before: _Before, surface: Surface, progress: Progress
) -> tuple[Int32, Int32]:
    """Match regions by the ground that they share with those of a published scene."""
    pieces = int(scene.index.region_count.sum(dtype=np.int64))
    fewest, most = _LEAST_SAMPLES
    at_least = min(most, max(fewest, _SAMPLES // max(1, pieces)))
    old = _old_samples(scene, before, surface, progress, at_least)
    new = SurfaceSamples.joined(_new_samples(surface, at_least))
    overlaps = region_overlaps(new, old)
    whole = np.bincount(new.labels, new.areas)
    within = overlaps.area >= _INHERITED * whole[overlaps.new]
    before.lies_in = dict(
        zip(overlaps.new[within].tolist(), overlaps.old[within].tolist(), strict=True)
    )
    return match_regions(overlaps)


def _old_samples(
    scene: Scene, before: _Before, surface: Surface, progress: Progress, at_least: int
) -> SurfaceSamples:
    """Sample a published scene's detail, in the new surface's frame."""
    shift = _shift(np.array(scene.manifest.origin), surface.origin)
    per_sample = _faces_per_sample(int(scene.index.face_count.sum(dtype=np.int64)))
    progress.start("pack: regions before", float(len(scene.index)), "segments")
    samples_of_segments, unread = [], 0
    for segment in range(len(scene.index)):
        try:
            mesh = scene.mesh(segment)
        except (CorruptPayloadError, PayloadError):
            unread += 1  # its ground counts as new; the rest is still matched
        else:
            samples = surface_samples(
                mesh.positions,
                mesh.faces,
                _labels(mesh, int(scene.index.region[segment])),
                faces_per_sample=per_sample,
                at_least=at_least,
            )
            has_region = samples.labels < len(
                before.ids
            )  # regions.json may lack what a payload names
            samples_of_segments.append(
                SurfaceSamples(
                    samples.points[has_region] + shift,
                    samples.labels[has_region],
                    samples.areas[has_region],
                )
            )
        progress.advance(1)
    if unread:
        before.warnings.append(
            f"{unread} of {len(scene.index)} segments of the scene published before cannot be "
            "read: regions there may get new stable ids"
        )
    progress.done({"samples": sum(len(samples.labels) for samples in samples_of_segments)})
    return SurfaceSamples.joined(samples_of_segments)


def _labels(mesh: SegmentMesh, region: int) -> Int32:
    """Region of every face; vertices on region borders are split, so any corner tells."""
    if mesh.region_ids is None:
        return np.full(len(mesh.faces), region, np.int32)
    return mesh.region_ids[mesh.faces[:, 0]].astype(np.int32)


def _new_samples(surface: Surface, at_least: int) -> Iterator[SurfaceSamples]:
    """Sample the new detail, segment by segment as a published scene is sampled."""
    per_sample = _faces_per_sample(surface.face_count)
    for vertices, faces, regions in surface.pieces():
        yield surface_samples(
            vertices, faces, regions, faces_per_sample=per_sample, at_least=at_least
        )


def _faces_per_sample(faces: int) -> int:
    return max(1, -(-faces // _SAMPLES))


def _shift(old: Float64, new: Float64) -> Float64:
    """Compute what takes a place from the frame about `old` to that about `new`."""
    east, north, height = old - new
    # x east, y up, z south
    return np.array([east, height, -north])


def _same_crs(old: CrsInfo | None, new: CrsInfo | None) -> bool:
    if old is None or new is None:
        return old is new
    if old.epsg is not None and new.epsg is not None:
        return old.epsg == new.epsg
    return (old.name, old.wkt) == (new.name, new.wkt)
