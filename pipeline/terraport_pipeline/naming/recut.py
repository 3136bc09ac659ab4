"""What another cut of the same faces into regions does to numbers, names and facts.

Pieces are matched to the regions before by the area that they share, as a build matches them
(:mod:`~terraport_pipeline.geometry.regions.region_match`), but exactly: the faces are the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE
from terraport_pipeline.geometry.regions.region_match import Overlaps, carry_ids, match_regions
from terraport_pipeline.geometry.regions.region_plan import RASTER, measure_plan, with_plan
from terraport_pipeline.geometry.regions.region_totals import (
    slope_bins,
    tile_totals,
    totals_document,
)
from terraport_pipeline.geometry.volumes.toe_volumes import SurveyNoise
from terraport_pipeline.geometry.volumes.top_surface import TopSurface
from terraport_pipeline.naming.views import best_views
from terraport_pipeline.published.ground import Ground

__all__ = ["DRAWN", "MAX_REGIONS", "Cut", "Earlier", "Recut", "carried_unions", "recut"]

MAX_REGIONS: Final = 65_536
"""Numbers of regions are 16 bits in a payload."""

_LEAST_M2: Final = 1e-9
"""What a face without area counts."""

DRAWN: Final = "drawn"
"""What regions.json says of a region that a plan or strokes have cut and named: a build over the
scene brings it again (``carried.py``)."""

_OF_NAMES: Final = ("label", "class", "confidence", DRAWN)
"""What regions.json says of a region's name."""

_OF_SHARES: Final = ("cut_m3", "fill_m3", "area_m2", "uncertainty_m3")


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """How faces shall be cut into pieces."""

    pieces: Int32
    """(F,) number of the piece of every face; any numbers, gaps allowed."""
    names: Mapping[int, str] = field(default_factory=dict)
    """What pieces are called, by number."""
    facts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """What regions.json says of pieces beyond their measures, by number."""


@dataclass(frozen=True, slots=True, eq=False)
class Earlier:
    """The version that a cut follows, where that is not the ground itself: whose ids go on."""

    region_of_face: Int32
    """(F,) region there of the ground that every face is; -1 of ground that it does not have."""
    area_m2: Float64
    """(R,) of its regions."""
    rows: Sequence[Mapping[str, Any]]
    """(R,) what it says of them in regions.json, with ``stable_id``."""
    labels: Sequence[str | None]
    """(R,) what people call them."""
    next_stable_id: int
    held: Mapping[int, int]
    """Region there, by number of the piece: these are the same whatever they share."""


@dataclass(frozen=True, slots=True, eq=False)
class Recut:
    """The regions of the next version."""

    regions: Int32
    """(F,) region of every face."""
    document: dict[str, Any]
    """Contents of regions.json."""
    labels: dict[int, str]
    """What to call regions, by stable id."""
    kept: int
    """Regions that have their stable id from the version before."""

    @property
    def count(self) -> int:
        """Number of regions."""
        return len(self.document["regions"])


def recut(ground: Ground, cut: Cut, earlier: Earlier | None = None) -> Recut:
    """Give the pieces of a cut their numbers, and measure them.

    Parameters
    ----------
    ground : Ground
    cut : Cut
    earlier : Earlier, optional
        The published version, where the ground is of one that nobody has seen: stable ids are
        those of the published one, and none that only the other gave is used up. None where the
        ground is published.

    Returns
    -------
    Recut
        A piece that is the same ground as a region (intersection over union of 0.3 or more, most
        similar first) has its number and stable id; of a region that is not cut everything but its
        neighbours stays. Of a region with a label that is cut, the rest keeps the label.

    Raises
    ------
    OptionError
        More than :data:`MAX_REGIONS` pieces, or all stable ids are used.
    """
    # (1) Pieces without gaps, in order of their numbers.
    numbers, piece_of_face = np.unique(cut.pieces, return_inverse=True)
    pieces: Int32 = piece_of_face.astype(np.int32)
    count = len(numbers)
    if count > MAX_REGIONS:
        raise OptionError(
            f"{count:,} regions, expected at most {MAX_REGIONS:,}: leave out what is smallest"
        )
    # (2) The same ground as before.
    before = ground.region_of_face
    weight = np.maximum(ground.area, _LEAST_M2)
    new, old = match_regions(_overlaps(pieces, before, weight))
    region_of_piece = _numbered(count, new, old)
    regions = region_of_piece[pieces]
    ids, first_free, kept = _stable_ids(ground, (new, old), earlier, numbers, pieces, weight)
    # (3) Facts.
    rows = _rows(ground, regions, count)
    piece_of_region = np.argsort(region_of_piece)
    assert ground.names.stable_ids is not None
    region_of_id = {int(n): region for region, n in enumerate(ground.names.stable_ids)}
    called = {n: ground.names.label(region) for n, region in region_of_id.items()}
    if earlier is not None:
        rows_before = {int(row["stable_id"]): row for row in earlier.rows}
        called = dict(zip(rows_before, earlier.labels, strict=True))
    old_of_piece = _lies_in(pieces, before, count)
    labels: dict[int, str] = {}
    for row, piece in zip(rows, piece_of_region.tolist(), strict=True):
        given, number, was = int(numbers[piece]), int(ids[piece]), int(old_of_piece[piece])
        row["stable_id"] = number
        name = cut.names.get(given)
        is_drawn = name is not None
        rest = None if was < 0 else ground.document["regions"][was]
        if earlier is not None and (is_drawn or number in called):
            # What goes on from the published version is called as there.
            rest = rows_before.get(number)
            name = called.get(number) if name is None else name
        elif name is None:
            name = None if was < 0 else ground.names.label(was)
        elif name == called.get(number):
            # The same under the same name, a few faces apart.
            rest = ground.document["regions"][region_of_id[number]]
        else:
            rest = None
        if rest is not None:
            # What is left of a region is still what it was.
            row.update({key: rest[key] for key in _OF_NAMES if key in rest})
        if name is not None:
            labels[number] = name
            # Published with the version: who reads it before labels.json is written sees the name.
            if name != called.get(number):
                row["label"] = name
        row.update(cut.facts.get(given, {}))
        row.pop(DRAWN, None)
        if is_drawn:
            row[DRAWN] = True
    # (4) Where to see them from; a region that is as it was keeps its place.
    open_ = [n for n, row in enumerate(rows) if row["stable_id"] in labels and "place" not in row]
    for region, place in best_views(ground, regions, open_).items():
        rows[region]["place"] = place
    # (5) What they are part of: what unites the regions before, from those that they lie in.
    document = {**ground.document, "next_stable_id": first_free, "regions": rows}
    if "unions" in document:
        document["unions"] = carried_unions(
            ground.document["unions"], len(ground.names.stable_ids), _home(regions, before, weight)
        )
    return Recut(regions, document, labels, kept)


def carried_unions(unions: Any, count: int, home: Int64) -> list[list[float]]:
    """Say what unites regions that were cut anew, by what united those before.

    Parameters
    ----------
    unions : list of [one, other, cost]
        Of the regions before, as regions.json has them; what follows one that cannot be is left
        out.
    count : int
        Regions before.
    home : ndarray of shape (R,), int64
        Region before that most of each region's ground lies in.

    Returns
    -------
    list of [one, other, cost]
        What one region was is united first, at cost 1: people parted it. The rest goes on as
        before; what has no ground any more is left out.
    """
    first = len(home)
    united: list[list[float]] = []
    now: dict[int, int] = {}
    for region, old in enumerate(home.tolist()):
        if old in now:
            united.append([*sorted((now[old], region)), 1.0])
            now[old] = first + len(united) - 1
        else:
            now[old] = region
    for place, union in enumerate(unions if isinstance(unions, list) else []):
        if not isinstance(union, list) or len(union) != 3:
            break
        one, other, cost = union
        ends = [end for end in (now.pop(one, None), now.pop(other, None)) if end is not None]
        if len(ends) == 2:
            united.append([*sorted(ends), cost])
            ends = [first + len(united) - 1]
        if ends:
            now[count + place] = ends[0]
    return united


def _home(regions: Int32, before: Int32, area: Float64) -> Int64:
    """Region before in which most of every region's ground lies, (R,)."""
    span = int(before.max()) + 1
    keys, row = np.unique(regions.astype(np.int64) * span + before, return_inverse=True)
    new, old = np.divmod(keys, span)
    order = np.lexsort((-np.bincount(row, area), new))
    _, first = np.unique(new[order], return_index=True)
    home: Int64 = old[order[first]]
    return home


def _overlaps(
    pieces: Int32,
    before: Int32,
    area: Float64,
    new_m2: Float64 | None = None,
    old_m2: Float64 | None = None,
) -> Overlaps:
    """Area that pieces share with regions before; wholes are stated where faces are not all."""
    span = int(before.max(initial=0)) + 1
    keys = pieces.astype(np.int64) * span + before
    pairs, row = np.unique(keys, return_inverse=True)
    shared: Float64 = np.bincount(row, area).astype(np.float64)
    new, old = np.divmod(pairs, span)
    whole_new = np.bincount(pieces, area) if new_m2 is None else new_m2
    whole_old = np.bincount(before, area) if old_m2 is None else old_m2
    both = whole_new[new] + whole_old[old]
    similarity = np.minimum(shared / np.maximum(both - shared, 0.5 * both), 1.0)
    return Overlaps(new.astype(np.int32), old.astype(np.int32), shared, similarity)


def _stable_ids(
    ground: Ground,
    matched: tuple[Int32, Int32],
    earlier: Earlier | None,
    numbers: Int32,
    pieces: Int32,
    weight: Float64,
) -> tuple[Int64, int, int]:
    """Give every piece its stable id; say which is free next, and how many were there before."""
    count = len(numbers)
    if earlier is None:
        assert ground.names.stable_ids is not None
        ids, first_free = carry_ids(
            count, matched, ground.names.stable_ids, ground.names.next_stable_id
        )
        return ids, first_free, len(matched[0])
    known = earlier.region_of_face >= 0
    shared = _overlaps(
        pieces[known], earlier.region_of_face[known], weight[known],
        np.bincount(pieces, weight).astype(np.float64), earlier.area_m2,
    )  # fmt: skip
    held_new = np.flatnonzero(np.isin(numbers, list(earlier.held))).astype(np.int32)
    held_old = np.array([earlier.held[int(n)] for n in numbers[held_new]], np.int32)
    open_ = ~np.isin(shared.new, held_new) & ~np.isin(shared.old, held_old)
    new, old = match_regions(
        Overlaps(shared.new[open_], shared.old[open_], shared.area[open_], shared.similarity[open_])
    )
    both = np.concatenate([held_new, new]), np.concatenate([held_old, old])
    old_ids = np.array([row["stable_id"] for row in earlier.rows], np.int64)
    ids, first_free = carry_ids(count, both, old_ids, earlier.next_stable_id)
    return ids, first_free, len(both[0])


def _numbered(count: int, new: Int32, old: Int32) -> Int32:
    """Give pieces the numbers of the regions that they are, others what is free below the count."""
    number = np.full(count, -1, np.int32)
    fits = old < count  # a region beyond has to move down
    number[new[fits]] = old[fits]
    free = np.setdiff1d(np.arange(count, dtype=np.int32), number)
    number[number < 0] = free
    return number


def _lies_in(pieces: Int32, before: Int32, count: int) -> Int64:
    """Say which region before every piece lies in; -1 of one that lies across several."""
    most = np.full(count, -1, np.int64)
    least = np.full(count, np.iinfo(np.int64).max)
    np.maximum.at(most, pieces, before)
    np.minimum.at(least, pieces, before)
    return np.where(most == least, most, -1)


def _rows(ground: Ground, regions: Int32, count: int) -> list[dict[str, Any]]:
    """Measure all regions; of those that are as before take what was said of them."""
    mesh, document = ground.mesh, ground.document
    attributes = {n: v for n, v in mesh.attributes.items() if n != HEIGHT_CHANGE}
    scale_m = float(document.get("roughness_scale_m") or 1.0)
    totals = tile_totals(
        mesh.vertices,
        mesh.faces,
        mesh.colours,
        regions,
        count,
        attributes=attributes,
        pairs=ground.pairs,
        roughness_scale_m=scale_m,
        bins=slope_bins(count),
    )
    old_rows = document["regions"]
    was, is_now = np.bincount(ground.region_of_face), np.bincount(regions)
    same = np.zeros(count, np.bool_)
    stays = min(count, len(was))
    in_place = np.bincount(regions[regions == ground.region_of_face], minlength=count)
    same[:stays] = (was[:stays] == is_now[:stays]) & (in_place[:stays] == is_now[:stays])
    plan = _plan(ground, regions, count, frozenset(np.flatnonzero(~same).tolist()))
    facts = with_plan(totals_document(totals, list(attributes), scale_m), plan)
    rows: list[dict[str, Any]] = facts["regions"]
    for number in np.flatnonzero(same).tolist():
        rows[number] = {
            **old_rows[number],
            "id": number,
            "neighbours": rows[number]["neighbours"],
        }
    _share_changes(ground, regions, rows, same)
    return rows


def _plan(ground: Ground, regions: Int32, count: int, wanted: frozenset[int]) -> dict[str, Any]:
    """Measure regions in plan, on the same raster as the build."""
    mesh, raster = ground.mesh, ground.document.get(RASTER, {})
    spacing_m = raster.get("spacing_m")
    cell_m = raster.get("cell_m") or float(np.sqrt(2.0 * ground.area.mean()))
    survey = None if spacing_m is None else SurveyNoise(spacing_m, raster["noise_m"])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    top = TopSurface.over(low, high, count, cell_m)
    top.add(mesh.vertices, mesh.faces, regions)
    return measure_plan(top, survey, wanted)


def _share_changes(ground: Ground, regions: Int32, rows: list[dict[str, Any]], same: Any) -> None:
    """Distribute the volumes of cut and fill of regions over the pieces that replace them.

    In proportion to the height difference of faces times their plan area; if no face has moved, to
    the plan area. A region's volumes keep their sum; its uncertainties do not become smaller.
    """
    old_rows = ground.document["regions"]
    changed = [n for n, row in enumerate(old_rows) if isinstance(row.get("change"), dict)]
    open_ = ~same[regions]
    if not changed or not open_.any():
        return
    mesh = ground.mesh
    faces = mesh.faces[open_]
    a, b, c = (mesh.vertices[faces[:, corner]][:, [0, 2]].astype(np.float64) for corner in range(3))
    ab, ac = b - a, c - a
    plan = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2
    dz = np.zeros(len(faces))
    if HEIGHT_CHANGE in mesh.attributes:
        dz = np.nan_to_num(mesh.attributes[HEIGHT_CHANGE][faces].mean(axis=1))
    was, now = ground.region_of_face[open_], regions[open_]
    weights = {
        "cut_m3": plan * np.maximum(-dz, 0.0),
        "fill_m3": plan * np.maximum(dz, 0.0),
        "area_m2": plan * (dz != 0.0),
        "uncertainty_m3": plan * (dz != 0.0),
    }
    for number in changed:
        here = was == number
        if not here.any():
            continue
        heirs, at = np.unique(now[here], return_inverse=True)
        by_plan = np.bincount(at, np.maximum(plan[here], _LEAST_M2))
        for key in _OF_SHARES:
            share = np.bincount(at, weights[key][here])
            share = by_plan if share.sum() <= 0.0 else share
            share = share / share.sum()
            if key == "uncertainty_m3":
                # Treated as independent errors, so that the sum is not less than that of the whole.
                share = np.sqrt(share)
            part = float(old_rows[number]["change"].get(key, 0.0)) * share
            for heir, value in zip(heirs.tolist(), part.tolist(), strict=True):
                if value > 0.0:
                    volumes = rows[heir].setdefault("change", dict.fromkeys(_OF_SHARES, 0.0))
                    volumes[key] += value
    for row in rows:
        if isinstance(row.get("change"), dict):
            row["change"] = {key: round(value, 3) for key, value in row["change"].items()}
