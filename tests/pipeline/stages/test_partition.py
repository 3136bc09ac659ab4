"""Every sample goes to each tile whose data box it lies in, whole and in file order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

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
        name = f"{partition.samples_name(tile)}.npy"
        expected = (third if tile in in_core else first) / name
        assert (second / name).read_bytes() == expected.read_bytes()
        assert now["samples"][tile] == len(np.load(second / name))
    # Another lattice: nothing of before fits.
    coarse = replace(plan, lattice=Lattice(LATTICE.anchor_m, 0.55))
    _, facts = partition.run(
        source, 0, coarse, ORIGIN, replace(context, result_folder=third), earlier
    )
    assert facts.counts["kept_tiles"] == 0
