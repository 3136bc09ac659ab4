from __future__ import annotations

import numpy as np
import pytest
from terraport_pipeline.stages.trim_detail import (
    HEM_SPACINGS,
    TrimmedDetail,
    sampled_ground,
    trim_detail,
)

from terraport_pipeline.errors import SurveyError
from terraport_pipeline.model import Cloud
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Facts

HALF_M = 20.0
SPACING_M = 0.5


@pytest.fixture(scope="module")
def cleaned() -> Cleaned:
    """Flat ground, a sample on every cell's middle give or take."""
    rng = np.random.default_rng(1)
    middle = np.arange(-HALF_M, HALF_M, SPACING_M) + SPACING_M / 2
    x, z = np.meshgrid(middle, middle)
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    points[:, ::2] += rng.uniform(-0.2, 0.2, (x.size, 2))
    up = np.tile(np.array([0, 1, 0], np.float32), (x.size, 1))
    cloud = Cloud(
        points.astype(np.float32), up, np.zeros((x.size, 3), np.uint8), {}, np.zeros(3), SPACING_M
    )
    return Cleaned(cloud, np.full(x.size, SPACING_M, np.float32), (), Facts({}))


def sheet(half_m: float, cell_m: float = 0.4) -> tuple[np.ndarray, np.ndarray]:
    """What a solver makes of it: a surface that runs on."""
    side = int(2 * half_m / cell_m) + 1
    x, z = np.meshgrid(np.arange(side) * cell_m - half_m, np.arange(side) * cell_m - half_m)
    vertices = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1).astype(np.float32)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + side, corner + 1], axis=1),
            np.stack([corner + 1, corner + side, corner + side + 1], axis=1),
        ]
    )
    return vertices, faces.astype(np.int32)


def cut(cleaned: Cleaned, half_m: float, *, threads: int = 1) -> TrimmedDetail:
    return trim_detail(
        *sheet(half_m),
        cleaned,
        sampled_ground(cleaned),
        largest=4.0,
        island_faces=50,
        threads=threads,
    )


def test_the_surface_ends_with_its_samples_and_the_hem_beyond(cleaned: Cleaned) -> None:
    trimmed = cut(cleaned, 30.0)
    reach_m = np.abs(trimmed.vertices).max()
    assert HALF_M - SPACING_M < reach_m < HALF_M + 1.5 * SPACING_M
    hem_m = np.abs(trimmed.wide[0]).max() - reach_m
    assert 0.5 * HEM_SPACINGS * SPACING_M < hem_m < 2.0 * HEM_SPACINGS * SPACING_M
    assert trimmed.islands == 0
    assert (
        trimmed.counts["outside_footprint_m2_after"] < trimmed.counts["outside_footprint_m2_before"]
    )


def test_threads_change_nothing(cleaned: Cleaned) -> None:
    one_thread, two_threads = (cut(cleaned, 25.0, threads=threads) for threads in (1, 2))
    assert np.array_equal(one_thread.vertices, two_threads.vertices)
    assert np.array_equal(one_thread.faces, two_threads.faces)
    assert all(np.array_equal(a, b) for a, b in zip(one_thread.wide, two_threads.wide, strict=True))
    assert one_thread.counts == two_threads.counts


def test_a_surface_far_from_all_samples_is_refused(cleaned: Cleaned) -> None:
    vertices, faces = sheet(5.0)
    with pytest.raises(SurveyError, match="no surface lies within"):
        trim_detail(
            vertices + np.float32(500),
            faces,
            cleaned,
            sampled_ground(cleaned),
            largest=4.0,
            island_faces=50,
        )
