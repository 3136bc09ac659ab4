"""A quarry flown twice: what did not change keeps its samples, what changed takes the new ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terraport_payload.types import Bool, Float64, UInt8
from terraport_pipeline.engines.readers.point_order import curve_keys
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages import renew
from terraport_pipeline.stages.contract import Context, Facts
from terraport_pipeline.stages.partition import BLOCK_CELLS
from terraport_pipeline.stages.survey_change import load_height_changes
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise

ORIGIN = np.array([641_200.0, 8_594_700.0, 1_287.0])
SPACING_M = 0.39
LATTICE = Lattice((-130.0, -80.0, -130.0), 1.2 * SPACING_M)
BEYOND_M = 2**0.5 * (1 + 1 / 4) * BLOCK_CELLS * LATTICE.cell_m
"""How far changed blocks reach: across one cube that touches the change, and its block."""

PIT = np.array([-40.0, 15.0])
"""Level dry ground, about the origin."""


@dataclass(frozen=True)
class Flight:
    """A survey's columns."""

    points: Float64
    colours: UInt8
    grade: np.ndarray

    def of(self, rows: Bool) -> Flight:
        return Flight(self.points[rows], self.colours[rows], self.grade[rows])

    def write(self, folder: Path) -> Path:
        """Write the columns as the read stage does."""
        folder.mkdir()
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        order = np.argsort(curve_keys(self.points, low, high), kind="stable")
        np.save(folder / "points.npy", self.points[order])
        np.save(folder / "colours.npy", self.colours[order])
        np.save(folder / "attribute-0.npy", self.grade[order])
        return folder

    def away(self, from_m: Float64 = PIT) -> Float64:
        """Distance in plan, metres."""
        return np.hypot(*(self.points[:, :2] - ORIGIN[:2] - from_m).T)


@dataclass(frozen=True)
class Renewed:
    """What the stage left."""

    folder: Path
    values: dict[str, Any]
    facts: Facts

    @property
    def points(self) -> Float64:
        return np.load(self.folder / "points.npy")

    def changed(self, points: Float64) -> Bool:
        """Points in blocks that changed."""
        blocks = {tuple(index) for index in np.load(self.folder / "change-blocks.npy").tolist()}
        index = block_of(points)
        return np.array([tuple(row) in blocks for row in index.tolist()], dtype=bool)


def block_of(points: Float64) -> np.ndarray:
    local = points - ORIGIN
    cells = LATTICE.cells(np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1))
    return np.floor(cells / BLOCK_CELLS).astype(int)


def flown(sample: int) -> Flight:
    survey = synthesise(QuarryOptions(points=300_000, size_m=200.0, sample_seed=sample)).survey
    assert survey.colours is not None
    return Flight(survey.points, survey.colours, survey.attributes["grade"])


@pytest.fixture(scope="module")
def first() -> Flight:
    return flown(0)


@pytest.fixture(scope="module")
def second() -> Flight:
    """Another sample of the same ground, with 3 cm more of noise and 3 % more red."""
    flight = flown(1)
    noise = np.random.default_rng(1).normal(0, 0.03, flight.points.shape)
    redder = np.rint(flight.colours * np.array([1.03, 1.0, 1.0]))
    colours = np.minimum(redder, 255).astype(np.uint8)
    return replace(flight, points=flight.points + noise, colours=colours)


@pytest.fixture(scope="module")
def before(first: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return first.write(tmp_path_factory.mktemp("surveys") / "before")


def renewed(tmp_path: Path, before: Path, after: Flight | Path, threads: int = 1) -> Renewed:
    folder = tmp_path / f"renewed-{threads}"
    folder.mkdir()
    source = after if isinstance(after, Path) else after.write(tmp_path / "after")
    context = Context(tmp_path, threads=threads, result_folder=folder)
    values, facts = renew.run(before, source, 1, LATTICE, ORIGIN, SPACING_M, 0.015, context)
    return Renewed(folder, dict(values), facts)


def same_columns(one: Path, other: Path) -> bool:
    names = ("points", "colours", "attribute-0")
    pairs = [(np.load(one / f"{n}.npy"), np.load(other / f"{n}.npy")) for n in names]
    return all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in pairs)


def test_the_same_survey_changes_nothing(tmp_path: Path, before: Path) -> None:
    result = renewed(tmp_path, before, before)
    assert result.values["changed_blocks"] == 0
    assert result.values["kept_rows"] == 300_000
    assert result.values["new_rows"] == 0
    assert result.values["gains"] == [1.0, 1.0, 1.0]
    assert result.values["density_ratio"] == 1.0
    assert same_columns(before, result.folder)
    assert result.facts.counts["shift_m"] == 0.0
    assert not result.facts.warnings


def test_the_same_ground_flown_again_keeps_its_samples(
    tmp_path: Path, before: Path, second: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of a thousand blocks today; however the rows are read, and in however many threads."""
    result = renewed(tmp_path, before, second)
    assert result.values["blocks"] > 1000
    assert result.values["changed_blocks"] <= 0.005 * result.values["blocks"]
    assert same_columns(before, result.folder) == (result.values["changed_blocks"] == 0)
    np.testing.assert_allclose(result.values["gains"], [1.03, 1.0, 1.0], atol=0.002)
    assert result.values["density_ratio"] == pytest.approx(1.0, abs=0.01)
    assert not result.facts.warnings
    monkeypatch.setattr(renew, "_BLOCK_ROWS", 70_000)
    again = renewed(tmp_path, before, tmp_path / "after", threads=2)
    assert again.values == result.values
    assert again.facts == result.facts


@pytest.mark.parametrize("height_m", [-2.0, 3.0])
def test_a_pit_and_a_pile_take_the_new_samples(
    tmp_path: Path, before: Path, first: Flight, second: Flight, height_m: float
) -> None:
    """Ten metres wide. Their blocks and none beyond the next change; volumes are right."""
    steps = [height_m * np.maximum(1 - flight.away() ** 2 / 25, 0) for flight in (first, second)]
    points = second.points + steps[1][:, None] * np.array([0, 0, 1.0])
    result = renewed(tmp_path, before, replace(second, points=points))
    assert result.changed(first.points[np.abs(steps[0]) > 0.15]).mean() > 0.98
    assert result.changed(points[np.abs(steps[1]) > 0.15]).mean() > 0.98
    assert not result.changed(first.points[first.away() > 5 + BEYOND_M]).any()
    # Kept rows first, then new ones, each in the order of its survey.
    kept = np.load(before / "points.npy")
    kept = kept[~result.changed(kept)]
    new = np.load(tmp_path / "after" / "points.npy")
    new = new[result.changed(new)]
    assert (len(kept), len(new)) == (result.values["kept_rows"], result.values["new_rows"])
    np.testing.assert_array_equal(result.points, np.concatenate([kept, new]))
    colours, grade = (np.load(result.folder / f"{n}.npy") for n in ("colours", "attribute-0"))
    assert len(colours) == len(grade) == len(result.points)
    volumes = result.facts.counts["cut_m3"], result.facts.counts["fill_m3"]
    right, wrong = volumes if height_m < 0 else volumes[::-1]
    volume_m3 = np.pi * 25 * abs(height_m) / 2
    assert right == pytest.approx(volume_m3, rel=0.03)
    assert wrong < 0.01 * volume_m3
    raster = result.values["raster"]
    dz_m = np.load(result.folder / "change-dz.npy")
    assert list(dz_m.shape) == raster["shape"]
    x, z = np.unravel_index(np.nanargmax(np.where(np.load(
        result.folder / "change-moved.npy"), np.abs(dz_m), np.nan)), dz_m.shape)  # fmt: skip
    middle_m = np.array(raster["low_m"]) + (np.array([x, z]) + 0.5) * raster["cell_m"]
    np.testing.assert_allclose(middle_m, [PIT[0], -PIT[1]], atol=1.5 * raster["cell_m"])


def heights_at(folder: Path, points: Float64) -> Float64:
    """What vertices at these points would say of the last change, (N,) metres."""
    heights = load_height_changes(folder)
    assert heights is not None
    local = points - ORIGIN
    scene = np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1)
    return heights.at(LATTICE.cells(scene) / BLOCK_CELLS)


def test_the_last_change_of_all_ground_is_kept(
    tmp_path: Path, before: Path, first: Flight, second: Flight
) -> None:
    """A pit, then a pile elsewhere: the depth of the pit is still known, and nothing else."""
    assert load_height_changes(before) is None
    pit = -2.0 * np.maximum(1 - second.away() ** 2 / 100, 0)
    dug = replace(second, points=second.points + pit[:, None] * np.array([0, 0, 1.0]))
    one = renewed(tmp_path, before, dug)
    found = heights_at(one.folder, dug.points)
    inside = second.away() < 8
    assert np.isfinite(found[inside]).mean() > 0.99
    error = (found - pit)[inside & np.isfinite(found)]
    assert abs(np.median(error)) < 0.05  # cells of 1.9 m fill a bowl by 4 cm
    assert np.percentile(np.abs(error), 95) < 0.1
    assert np.isnan(found[second.away() > 10 + BEYOND_M]).all()
    # The next survey finds a pile, and the pit as it was left.
    heap_m = np.array([30.0, 15.0])
    heap = 2.0 * np.maximum(1 - second.away(heap_m) ** 2 / 100, 0)
    heaped = replace(dug, points=dug.points + heap[:, None] * np.array([0, 0, 1.0]))
    (tmp_path / "next").mkdir()
    two = renewed(tmp_path / "next", one.folder, heaped)
    assert two.facts.counts["cut_m3"] < 5.0
    again = heights_at(two.folder, heaped.points)
    far = second.away(heap_m) > 10 + BEYOND_M
    np.testing.assert_array_equal(again[far], heights_at(one.folder, heaped.points)[far])
    top = second.away(heap_m) < 2
    assert np.nanmedian(again[top]) == pytest.approx(np.median(heap[top]), abs=0.08)


def test_painted_ground_takes_the_new_samples(
    tmp_path: Path, before: Path, first: Flight, second: Flight
) -> None:
    colours = second.colours.astype(int)
    colours[second.away() < 8] += (30, -5, -25)
    painted = replace(second, colours=np.clip(colours, 0, 255).astype(np.uint8))
    result = renewed(tmp_path, before, painted)
    assert result.changed(second.points[second.away() < 8]).mean() > 0.98
    assert result.changed(first.points[first.away() < 8]).mean() > 0.98
    assert not result.changed(first.points[first.away() > 8 + BEYOND_M]).any()
    assert result.facts.counts["colour_alone_blocks"] == result.values["changed_blocks"]
    assert result.facts.counts["cut_m3"] == result.facts.counts["fill_m3"] == 0.0


def test_ground_no_longer_covered_is_gone_and_ground_beyond_is_new(
    tmp_path: Path, before: Path, first: Flight, second: Flight
) -> None:
    """The new survey covers the west alone; seen the other way round, the east is new."""
    west = second.of(second.points[:, 0] < ORIGIN[0])
    result = renewed(tmp_path, before, west)
    beyond = first.points[:, 0] > ORIGIN[0] + 4 * SPACING_M
    assert result.changed(first.points[beyond]).mean() > 0.995
    east = result.points[:, 0] > ORIGIN[0] + 4 * SPACING_M
    assert east.sum() < 0.005 * beyond.sum()  # what lies in crumbs between blocks
    block_m = BLOCK_CELLS * LATTICE.cell_m
    assert not result.changed(first.points[first.points[:, 0] < ORIGIN[0] - block_m]).any()
    assert result.facts.counts["gone_m2"] > 15_000
    assert result.facts.counts["added_m2"] == 0.0

    (tmp_path / "back").mkdir()
    back = renewed(tmp_path / "back", tmp_path / "after", before)
    assert back.values["changed_blocks"] == result.values["changed_blocks"]
    assert back.facts.counts["added_m2"] == result.facts.counts["gone_m2"]
    assert len(back.points) == pytest.approx(300_000, rel=0.01)


def test_surveys_side_by_side_are_all_new(tmp_path: Path, before: Path, second: Flight) -> None:
    moved = replace(second, points=second.points + np.array([1000.0, 0, 0]))
    result = renewed(tmp_path, before, moved)
    assert result.values["kept_rows"] < 1000  # strays alone
    assert result.values["new_rows"] > 299_000


def test_a_survey_that_lies_higher_throughout_is_told_of(
    tmp_path: Path, before: Path, second: Flight
) -> None:
    higher = replace(second, points=second.points + np.array([0, 0, 0.08]))
    result = renewed(tmp_path, before, higher)
    assert result.facts.counts["shift_m"] == pytest.approx(0.08, abs=0.02)
    assert "check how both are tied" in result.facts.warnings[0]
    assert result.values["changed_blocks"] <= 0.03 * result.values["blocks"]


def test_another_light_is_told_of(tmp_path: Path, before: Path, second: Flight) -> None:
    """Shadows fall elsewhere: stripes that no gain takes out."""
    stripes = 45 * np.sign(np.sin(second.points[:, :1] / 12))
    colours = np.clip(second.colours + stripes, 0, 255).astype(np.uint8)
    result = renewed(tmp_path, before, replace(second, colours=colours))
    assert "in another light" in result.facts.choices[0]


def test_a_wider_attribute_gives_the_wider_type(
    tmp_path: Path, before: Path, second: Flight
) -> None:
    result = renewed(tmp_path, before, replace(second, grade=second.grade.astype(np.float64)))
    assert np.load(result.folder / "attribute-0.npy").dtype == np.float64
    assert "no room for" in result.facts.choices[0]


def test_fewer_cubes_are_wider_ones(
    tmp_path: Path, before: Path, second: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = second.points.copy()
    points[second.away() < 10, 2] -= 1.5
    after = replace(second, points=points).write(tmp_path / "after")
    monkeypatch.setattr(renew, "MAX_CUBES", 8_000)
    result = renewed(tmp_path, before, after)
    assert result.values["raster"]["cell_m"] == pytest.approx(8 * LATTICE.cell_m)
    assert result.changed(points[second.away() < 9]).mean() > 0.98
    assert result.facts.counts["cut_m3"] == pytest.approx(np.pi * 100 * 1.5, rel=0.05)


def test_colours_in_one_survey_alone_are_refused(tmp_path: Path, before: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    np.save(bare / "points.npy", np.load(before / "points.npy")[:1000])
    np.save(bare / "attribute-0.npy", np.load(before / "attribute-0.npy")[:1000])
    with pytest.raises(ValueError, match="expected in both or none"):
        renewed(tmp_path, before, bare)


def test_surveys_without_colour_are_compared_by_their_ground(
    tmp_path: Path, first: Flight, second: Flight
) -> None:
    folders = []
    for name, flight in (("a", first), ("b", second)):
        folders.append(flight.write(tmp_path / name))
        (folders[-1] / "colours.npy").unlink()
    result = renewed(tmp_path, folders[0], folders[1])
    assert result.values["changed_blocks"] == 0
    assert not (result.folder / "colours.npy").exists()
