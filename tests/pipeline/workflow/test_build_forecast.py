"""Forecasts of builds: what they follow from, and that they are bounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tile_plan import Lattice, plan_tiles, tile_shape
from terraport_pipeline.workflow.build_forecast import (
    BuildForecast,
    PhotoSet,
    SolvedGround,
    forecast_build,
    time_terms,
    with_photos,
)

BLOCKS = np.stack([*np.meshgrid(np.arange(60), [3], np.arange(60))], axis=-1).reshape(-1, 3)
PLAN = plan_tiles(
    Lattice((0.0, 0.0, 0.0), 0.24), tile_shape(9), BLOCKS, np.full(3600, 111), block_cells=16
)
LEVEL = SolvedGround(
    points=400_000, surface_m2=53_000.0, cell_m=0.24, slant=1.0, voxels=57_509,
    voxel_m=0.96, noise_m=0.0, smoothing_spacings=0.0,
    plan=PLAN, row_bytes=27, attributes=0,
)  # fmt: skip


def _forecast(ground: SolvedGround) -> BuildForecast:
    return forecast_build(ground, max_memory_bytes=8 << 30, threads=2)


def test_level_ground_has_two_faces_for_every_cell() -> None:
    made = _forecast(LEVEL)
    assert made.faces == pytest.approx(2 * 53_000 / 0.24**2, rel=0.1)
    assert (made.tiles, made.tile_depth) == (PLAN.count, 9)
    assert made.base_faces == 200_000


def test_rough_ground_has_more_and_noise_has_not() -> None:
    made = _forecast(LEVEL)
    rough = _forecast(replace(LEVEL, voxels=86_263))
    assert rough.faces == pytest.approx(1.5 * made.faces, rel=1e-4)
    noisy = replace(LEVEL, voxels=86_263, noise_m=0.3)
    assert _forecast(noisy).faces == pytest.approx(made.faces, rel=0.05)
    unknown = _forecast(replace(LEVEL, voxels=None))
    assert unknown.faces == pytest.approx(made.faces, rel=0.05)
    steep = replace(noisy, slant=1.5, noise_m=0.5)
    assert _forecast(steep).faces == pytest.approx(1.5 * _forecast(noisy).faces, rel=0.01)


def test_time_grows_with_faces_and_smoothing_and_falls_with_cores() -> None:
    def seconds(ground: SolvedGround, threads: int = 2) -> float:
        return forecast_build(ground, max_memory_bytes=8 << 30, threads=threads).seconds

    assert time_terms(LEVEL)[0] == 1.0
    assert seconds(replace(LEVEL, voxels=115_018)) > seconds(LEVEL)
    assert seconds(replace(LEVEL, smoothing_spacings=6.0)) > seconds(LEVEL)
    assert seconds(LEVEL, 1) > seconds(LEVEL, 2) > seconds(LEVEL, 16) > 0.5 * seconds(LEVEL, 2)


def test_memory_is_at_most_what_it_may_take() -> None:
    much = forecast_build(LEVEL, max_memory_bytes=32 << 30, threads=8)
    little = forecast_build(LEVEL, max_memory_bytes=1 << 30, threads=8)
    assert little.workers < much.workers
    assert little.memory_bytes <= 1 << 30 < much.memory_bytes < 32 << 30


def test_attributes_and_colours_take_disk() -> None:
    bare = forecast_build(LEVEL, max_memory_bytes=8 << 30, threads=2)
    more = replace(LEVEL, row_bytes=39, attributes=3)
    rich = forecast_build(more, max_memory_bytes=8 << 30, threads=2)
    assert rich.scene_bytes > bare.scene_bytes
    assert rich.work_bytes - bare.work_bytes > 12 * LEVEL.points * 2


def test_photos_take_time_by_their_pixels_and_disk_by_the_texels_on_the_ground() -> None:
    bare, photos = _forecast(LEVEL), PhotoSet(100.0, 0.05, LEVEL.surface_m2)
    textured = with_photos(bare, photos, threads=2)
    assert (textured.faces, textured.memory_bytes) == (bare.faces, bare.memory_bytes)
    more = with_photos(bare, replace(photos, megapixels=200.0), threads=2)
    assert more.seconds - textured.seconds == pytest.approx(18.0, rel=0.01)
    assert textured.seconds > bare.seconds
    finer = with_photos(bare, replace(photos, pixel_m=0.025), threads=2)
    texels = LEVEL.surface_m2 / 0.05**2
    assert finer.scene_bytes - textured.scene_bytes == pytest.approx(3 * 0.33 * texels, rel=0.01)
