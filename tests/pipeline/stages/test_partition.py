"""Every sample goes to each tile whose data box it lies in, whole and in file order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tile_plan import Lattice, plan_tiles, tile_shape
from terraport_pipeline.model import to_scene
from terraport_pipeline.stages import partition
from terraport_pipeline.stages.contract import Context

ORIGIN = np.array([641_000.0, 8_594_000.0, 1_200.0])
LATTICE = Lattice((-60.0, -20.0, -60.0), 0.5)


def test_samples_find_their_tiles(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(partition, "_BLOCK_ROWS", 300)
    rng = np.random.default_rng(2)
    points = ORIGIN + np.column_stack(
        [rng.uniform(-60, 60, 1000), rng.uniform(-60, 60, 1000), rng.uniform(0, 9, 1000)]
    )
    colours = rng.integers(0, 256, (1000, 3)).astype(np.uint8)
    grade = rng.uniform(0, 1, 1000).astype(np.float32)
    source = tmp_path / "read"
    source.mkdir()
    np.save(source / "points.npy", points)
    np.save(source / "colours.npy", colours)
    np.save(source / "attribute-0.npy", grade)
    context = Context(tmp_path)
    blocks, counts = partition.count_blocks(source, LATTICE, ORIGIN, 16, context)
    assert counts.sum() == 1000
    plan = plan_tiles(LATTICE, tile_shape(7, 12.0), blocks, counts, 16)
    folder = tmp_path / "out"
    folder.mkdir()
    values, facts = partition.run(source, 1, plan, ORIGIN, replace(context, result_folder=folder))
    cells = LATTICE.cells(to_scene(points, ORIGIN).astype(np.float64))
    seen = np.zeros(1000, dtype=int)
    for tile in range(plan.count):
        samples = np.load(folder / f"{partition.samples_name(tile)}.npy")
        assert values["samples"][tile] == len(samples) <= plan.points[tile]
        low, high = plan.data(tile)
        inside = np.flatnonzero(((cells >= low - 1e-3) & (cells <= high + 1e-3)).all(axis=1))
        rows = inside[np.isin(points[inside, 0], samples["position"][:, 0])]
        np.testing.assert_array_equal(samples["position"], points[rows])  # in file order
        np.testing.assert_array_equal(samples["colour"], colours[rows])
        np.testing.assert_array_equal(samples["a0"], grade[rows])
        seen[rows] += 1
    assert (seen >= 1).all()
    assert facts.counts["samples"] == seen.sum()
    assert len(set(values["digests"])) == plan.count


def test_strays_far_away_are_left_out_of_the_plan(tmp_path: Path) -> None:
    points = ORIGIN + np.array([[0.0, 0, 0], [1e9, 0, 0]])
    np.save(tmp_path / "points.npy", points)
    _, counts = partition.count_blocks(tmp_path, LATTICE, ORIGIN, 16, Context(tmp_path))
    assert counts.tolist() == [1]


def test_a_tile_in_whose_core_nothing_changed_keeps_what_it_had(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points = ORIGIN + np.column_stack(
        [rng.uniform(-60, 60, 2000), rng.uniform(-60, 60, 2000), rng.uniform(0, 9, 2000)]
    )
    folders = [tmp_path / name for name in ("read", "first", "second", "third")]
    for folder in folders:
        folder.mkdir()
    source, first, second, third = folders
    np.save(source / "points.npy", points)
    context = Context(tmp_path)
    blocks, counts = partition.count_blocks(source, LATTICE, ORIGIN, 16, context)
    plan = plan_tiles(LATTICE, tile_shape(7, 12.0), blocks, counts, 16)
    assert plan.count > 4
    values, _ = partition.run(source, 0, plan, ORIGIN, replace(context, result_folder=first))
    # One block changes, in the core of one tile and in the margins of others.
    cells = LATTICE.cells(to_scene(points, ORIGIN).astype(np.float64))
    low, high = plan.core(1)
    inside = cells[((cells >= low) & (cells < high)).all(axis=1)]
    block = inside[inside[:, 0].argmax()].astype(np.int64) // 16
    mine = (np.floor(cells / 16) == block).all(axis=1)
    points[mine, 2] += 0.5
    np.save(source / "points.npy", points)
    changed = np.append(block[None], [[4000, 0, 0]], axis=0)  # and one where no tile is
    earlier = partition.Earlier(first, values, changed)
    now, facts = partition.run(
        source, 0, plan, ORIGIN, replace(context, result_folder=second), earlier
    )
    hashes = np.array([values["digests"], now["digests"]])
    anew = np.flatnonzero(hashes[0] != hashes[1]).tolist()
    alone, _ = partition.run(source, 0, plan, ORIGIN, replace(context, result_folder=third))
    in_core = [
        tile
        for tile in range(plan.count)
        if (block * 16 < plan.core(tile)[1]).all() and (block * 16 + 16 > plan.core(tile)[0]).all()
    ]
    assert anew == in_core
    assert facts.counts["kept_tiles"] == plan.count - len(in_core)
    assert (np.array(alone["digests"]) != hashes[0]).sum() > len(in_core)
    for tile in range(plan.count):
        for stem in (partition.samples_name(tile), partition.above_name(tile)):
            expected = (third if tile in in_core else first) / f"{stem}.npy"
            assert (second / f"{stem}.npy").read_bytes() == expected.read_bytes()
        samples = np.load(second / f"{partition.samples_name(tile)}.npy")
        assert now["samples"][tile] == len(samples)
    # Another lattice: nothing of before fits.
    coarse = replace(plan, lattice=Lattice(LATTICE.anchor_m, 0.55))
    _, facts = partition.run(
        source, 0, coarse, ORIGIN, replace(context, result_folder=third), earlier
    )
    assert facts.counts["kept_tiles"] == 0


def test_a_tile_is_told_what_lies_above_its_box(tmp_path: Path) -> None:
    """A brow 120 m over the floor, in another tile: its heights, a cell apart, and only there."""
    rng = np.random.default_rng(4)
    floor = np.column_stack([rng.uniform(-20, 20, (3000, 2)), np.zeros(3000)])
    brow = np.column_stack([rng.uniform(0, 20, (3000, 2)), np.full(3000, 120.0)])
    source, folder = tmp_path / "read", tmp_path / "out"
    source.mkdir()
    folder.mkdir()
    np.save(source / "points.npy", ORIGIN + np.concatenate([floor, brow]))
    context = Context(tmp_path)
    blocks, counts = partition.count_blocks(source, LATTICE, ORIGIN, 16, context)
    plan = plan_tiles(LATTICE, tile_shape(7, 12.0), blocks, counts, 16)
    partition.run(source, 0, plan, ORIGIN, replace(context, result_folder=folder))
    east, up, north = [], [], []
    for tile in range(plan.count):
        samples = np.load(folder / f"{partition.samples_name(tile)}.npy")["position"] - ORIGIN
        above = np.load(folder / f"{partition.above_name(tile)}.npy")
        metres = LATTICE.metres(above + plan.core(tile)[0])
        if not len(samples) or samples[:, 2].max() > 100:
            assert not len(above)
            continue
        low, high = (LATTICE.metres(corner[None])[0] for corner in plan.data(tile))
        assert (metres[:, 1] > high[1]).all()
        assert (metres[:, ::2] > low[::2] - 1).all()
        assert (metres[:, ::2] < high[::2] + 1).all()
        east.append(metres[:, 0])
        up.append(metres[:, 1])
        north.append(-metres[:, 2])
    assert np.abs(np.concatenate(up) - 120.0).max() < 0.01
    for axis in (np.concatenate(east), np.concatenate(north)):
        assert axis.min() == pytest.approx(0.0, abs=1.5)
        assert axis.max() == pytest.approx(20.0, abs=1.5)
