"""Regions of the next survey over a scene, by those of the survey before.

The join of all tiles (``tiled_segment.regions``) numbers regions as they come. Where there is a
survey before, tiles that did not change keep their regions, their numbers and the pools that they
are cut by; regions of the other tiles are matched to those before by the ground that they share
(``region_match.py``): of units in tiles that did not change exactly, of others by samples.

Memory: 20 bytes per sample, of which a tile has some 65,000, and one per unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Float64, Int32
from terraport_pipeline.geometry.mesh.surface_samples import SurfaceSamples
from terraport_pipeline.geometry.regions.region_match import (
    CommonGround,
    match_regions,
    region_overlaps,
)
from terraport_pipeline.geometry.regions.region_numbers import (
    RegionNumbers,
    carry_numbers,
    local_numbers,
)
from terraport_pipeline.geometry.tiles.tiled_means import JoinedRegions
from terraport_pipeline.options.regions import MAX_REGIONS
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored

__all__ = [
    "NAME",
    "NUMBERS_FORM",
    "SAMPLES_NAME",
    "NumberedRegions",
    "number",
    "samples_of",
]

NAME: Final = "segment-numbers"
SAMPLES_NAME: Final = "segment-samples"


@dataclass(frozen=True, slots=True, eq=False)
class NumberedRegions:
    """Regions of all units as they are published."""

    tiles: tuple[str, ...]
    """Name of every tile."""
    units: tuple[str, ...]
    """Hash of every tile's units."""
    region: tuple[Int32, ...]
    """For every tile (U,) the region of its units."""
    fine: tuple[Int32, ...]
    """For every tile (U,) the fine pool of its units, numbered within the tile."""
    before: Int32
    """(R,) number of every region in the version before; -1 of a new one."""

    @property
    def count(self) -> int:
        """Number of regions."""
        return len(self.before)

    def in_joined(self, joined: JoinedRegions) -> JoinedRegions:
        """Put regions and pools in the place of those of the join."""
        unions, costs = _unions_of(self, joined)
        return replace(
            joined,
            region=self.region,
            fine=self.fine,
            count=self.count,
            unions=unions,
            union_costs=costs,
        )


NUMBERS_FORM: Final[Form[NumberedRegions]] = Form(
    store=lambda result: Stored(
        {
            "region": np.concatenate(result.region),
            "fine": np.concatenate(result.fine),
            "starts": np.cumsum([len(units) for units in result.region])[:-1],
            "before": result.before,
        },
        {"tiles": list(result.tiles), "units": list(result.units)},
    ),
    restore=lambda stored, _facts: NumberedRegions(
        tuple(stored.values["tiles"]),
        tuple(stored.values["units"]),
        tuple(np.split(np.asarray(stored.arrays["region"], np.int32), stored.arrays["starts"])),
        tuple(np.split(np.asarray(stored.arrays["fine"], np.int32), stored.arrays["starts"])),
        np.asarray(stored.arrays["before"], np.int32),
    ),
    facts=lambda result: Facts(
        {"regions": result.count, "continued": int(np.count_nonzero(result.before >= 0))}
    ),
)


@dataclass(slots=True)
class _Ground:
    """Samples of two surfaces, and the ground that they have in common, as it is gathered."""

    new: list[SurfaceSamples] = field(default_factory=list)
    old: list[SurfaceSamples] = field(default_factory=list)
    common: list[CommonGround] = field(default_factory=list)

    def matched(self) -> tuple[Int32, Int32]:
        """Match the new regions to the old ones."""
        common = CommonGround(
            *(
                np.concatenate(
                    [getattr(piece, name) for piece in (CommonGround.none(), *self.common)]
                )
                for name in ("new", "old", "area")
            )
        )
        overlaps = region_overlaps(
            SurfaceSamples.joined(self.new), SurfaceSamples.joined(self.old), common=common
        )
        return match_regions(overlaps)


def number(
    tiles: Sequence[str],
    digests: Sequence[str],
    units: Sequence[Stored],
    joined: JoinedRegions,
    before: tuple[Stored, Stored] | None,
    context: Context,
) -> NumberedRegions:
    """Give the regions of a surface their numbers.

    Parameters
    ----------
    tiles : sequence of str
        Name of every tile.
    digests : sequence of str
        Hash of every tile's units.
    units : sequence of Stored
        From ``tiled_segment.units``; read where they changed, so they may be mapped.
    joined : JoinedRegions
    before : pair of Stored, optional
        What this stage and :func:`samples_of` left of the survey before, in the same frame; None in
        a new place: regions have the numbers of the join.
    context : Context

    Returns
    -------
    NumberedRegions
    """
    pools = tuple(local_numbers(fine) for fine in joined.fine)
    of_join = np.concatenate(joined.region)
    if before is None:
        return _numbered(tiles, digests, pools, joined, RegionNumbers.anew(of_join))
    # (1) Tiles that did not change keep the pools that they were cut by.
    context.progress.start("segment: regions before", float(len(tiles)), "tiles")
    old = NUMBERS_FORM.restore(before[0], Facts())
    held = _held(tiles, digests, old)
    pools = tuple(
        fine if row is None else old.fine[row] for fine, row in zip(pools, held, strict=True)
    )
    # (2) Regions of the join matched to those before, by all ground.
    ground, areas = _Ground(), []
    for tile, row in enumerate(held):
        of_units = joined.region[tile]
        areas.append(_areas(units[tile], len(of_units)))
        if row is None:
            ground.new.append(_samples(units[tile].arrays, of_units))
        else:
            ground.common.append(CommonGround(of_units, old.region[row], areas[-1]))
        context.progress.advance(1.0)
    gone = set(range(len(old.tiles))).difference(held)
    ground.old.extend(_samples_before(before[1], sorted(gone)))
    matched = ground.matched()
    # (3) Numbers. Units of tiles that did not change keep their region whatever the join says, but
    # where those and the new ones are too many: the join's alone are not.
    nothing = [np.full(len(of_units), -1, np.int32) for of_units in joined.region]
    held_regions = [
        none if row is None else old.region[row] for none, row in zip(nothing, held, strict=True)
    ]
    area = np.concatenate(areas)
    numbers = carry_numbers(of_join, np.concatenate(held_regions), area, matched)
    if numbers.count > MAX_REGIONS:
        numbers = carry_numbers(of_join, np.concatenate(nothing), area, matched)
    kept = sum(row is not None for row in held)
    context.progress.done({"matched": len(matched[0]), "tiles_kept": kept})
    return _numbered(tiles, digests, pools, joined, numbers)


def _unions_of(numbered: NumberedRegions, joined: JoinedRegions) -> tuple[Int32, Float64]:
    """Give the unions of a join the numbers of its regions.

    Where tiles hold regions of the survey before, one region of the join may have several numbers:
    they are united first, at no cost beyond a region's own.
    """
    if not len(joined.unions):
        return joined.unions, joined.union_costs
    # (1) The region of the join that every number has most of its units in (tie: lower).
    now = np.concatenate(numbered.region).astype(np.int64)
    keys, units = np.unique(now * joined.count + np.concatenate(joined.region), return_counts=True)
    number, region = np.divmod(keys, joined.count)
    order = np.lexsort((region, -units, number))
    number, region = number[order], region[order]
    is_most = np.append(True, number[1:] != number[:-1])
    # (2) Pieces of the join, as pieces of these numbers; -1 of those that none is.
    piece = np.full(joined.count + len(joined.unions), -1, np.int64)
    unions: list[tuple[int, int]] = []
    costs: list[float] = []

    def united(one: int, other: int, cost: float) -> int:
        if one < 0 or other < 0:
            return max(one, other)
        unions.append((min(one, other), max(one, other)))
        costs.append(cost)
        return numbered.count + len(unions) - 1

    for one, of in zip(number[is_most].tolist(), region[is_most].tolist(), strict=True):
        piece[of] = united(int(piece[of]), one, 1.0)
    for place, (low, high) in enumerate(joined.unions.tolist()):
        cost = float(joined.union_costs[place])
        piece[joined.count + place] = united(int(piece[low]), int(piece[high]), cost)
    return np.array(unions, np.int32).reshape(-1, 2), np.array(costs, np.float64)


def _numbered(
    tiles: Sequence[str],
    digests: Sequence[str],
    pools: tuple[Int32, ...],
    joined: JoinedRegions,
    numbers: RegionNumbers,
) -> NumberedRegions:
    starts = np.cumsum([len(of_units) for of_units in joined.region])[:-1]
    region = tuple(np.split(numbers.region, starts))
    return NumberedRegions(tuple(tiles), tuple(digests), region, pools, numbers.before)


def _held(tiles: Sequence[str], digests: Sequence[str], old: NumberedRegions) -> list[int | None]:
    """For every tile its row in the survey before, where its units are what they were."""
    rows = {name: row for row, name in enumerate(old.tiles)}
    return [
        rows[name] if name in rows and old.units[rows[name]] == digest else None
        for name, digest in zip(tiles, digests, strict=True)
    ]


def samples_of(units: Sequence[Stored], numbered: NumberedRegions) -> Stored:
    """Gather the samples of all tiles, for the next survey to be matched by.

    Parameters
    ----------
    units : sequence of Stored
        From ``tiled_segment.units``.
    numbered : NumberedRegions

    Returns
    -------
    Stored
        ``point`` (N, 3) metres, ``region``, ``area``; ``starts`` of the tiles.
    """
    pieces = [
        _samples(tile.arrays, region) for tile, region in zip(units, numbered.region, strict=True)
    ]
    every = SurfaceSamples.joined(pieces)
    return Stored(
        {
            "point": every.points.astype(np.float32),
            "region": every.labels,
            "area": every.areas.astype(np.float32),
            "starts": np.cumsum([0, *(len(piece.labels) for piece in pieces)]),
        },
        {},
    )


def _samples(arrays: Mapping[str, AnyArray], region: Int32) -> SurfaceSamples:
    """Read a tile's samples, labelled with their regions."""
    return SurfaceSamples(
        np.array(arrays["sample_point"], np.float64),
        region[arrays["sample_unit"]],
        np.array(arrays["sample_area"], np.float64),
    )


def _samples_before(stored: Stored, rows: Sequence[int]) -> Iterator[SurfaceSamples]:
    """Give the samples of some tiles of the survey before."""
    starts = stored.arrays["starts"]
    for row in rows:
        chosen = slice(int(starts[row]), int(starts[row + 1]))
        yield SurfaceSamples(
            stored.arrays["point"][chosen].astype(np.float64),
            np.asarray(stored.arrays["region"][chosen], np.int32),
            stored.arrays["area"][chosen].astype(np.float64),
        )


def _areas(units: Stored, count: int) -> Float64:
    """Area of every unit, square metres, (count,)."""
    unit, area = (np.array(units.arrays[name]) for name in ("sample_unit", "sample_area"))
    return np.bincount(unit, area, count).astype(np.float64)
