from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.surface import GROUND, Surface


def draw(site: Surface, count: int) -> tuple[np.ndarray, object]:
    rng = np.random.default_rng(0)
    cumulative = np.cumsum(site.triangle_areas)
    triangle = np.searchsorted(cumulative, rng.uniform(0, cumulative[-1], count))
    return triangle, site.evaluate(triangle, rng.uniform(size=(count, 2)))


def test_samples_lie_within_their_triangles_neighbourhood() -> None:
    site = Surface(QuarryOptions(seed=7))
    triangle, points = draw(site, 20_000)
    away = np.linalg.norm(points.positions - site.triangle_middles[triangle], axis=1)
    assert np.quantile(away, 0.99) < 2.5
    np.testing.assert_allclose(np.linalg.norm(points.normals, axis=1), 1.0, atol=1e-9)


def test_areas_add_up() -> None:
    """The surface has more area than its plan, and less than twice as much."""
    site = Surface(QuarryOptions(seed=7, rocks=0, trees=0, bushes=0))
    plan = 4 * HALF_X * HALF_Y
    assert 1.05 * plan < site.triangle_areas.sum() < 1.6 * plan


def test_triangles_name_their_body_and_never_join_two() -> None:
    site = Surface(QuarryOptions(seed=7))
    body, parameters, positions, faces = site.triangles(4.0)
    assert (body[faces] == body[faces[:, :1]]).all()
    assert set(np.unique(body)) == {GROUND, *range(len(site.blobs.kind))}
    ground = body == GROUND
    np.testing.assert_array_equal(
        site.terrain.positions(parameters[ground, 0], parameters[ground, 1]), positions[ground]
    )


def test_hidden_points_are_below_the_ground_or_in_a_body() -> None:
    site = Surface(QuarryOptions(seed=7))
    _, points = draw(site, 60_000)
    stone = points.material == Material.BOULDER
    x, y, z = points.positions[stone].T
    below = z < site.terrain.positions(x, y)[:, 2]
    np.testing.assert_array_equal(points.hidden[stone], below)
    assert 0.2 < below.mean() < 0.7  # boulders are sunk into the ground
    covered = points.hidden & ~np.isin(points.material, [9, 10, 11])
    assert 0 < covered.sum() < 0.05 * len(covered)


def test_height_map_has_the_pit_and_the_trees() -> None:
    site = Surface(QuarryOptions(seed=7))
    height = site.height_map(1.0)
    assert height.shape == (2 * HALF_Y + 1, 2 * HALF_X + 1)
    tree = int(np.flatnonzero(site.blobs.kind == 1)[0])
    x, y, z = site.blobs.centres[tree]
    assert height[round(y + HALF_Y), round(x + HALF_X)] > z
