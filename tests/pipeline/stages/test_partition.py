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
