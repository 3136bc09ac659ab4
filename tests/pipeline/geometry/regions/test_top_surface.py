"""The highest surface seen from above: plan areas that add up, and space under overhangs."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.regions.region_plan import measure_plan, with_plan
from terraport_pipeline.geometry.volumes.top_surface import TopSurface


def sheet(low: float, high: float, y: float, cells: int, *, is_down: bool = False) -> tuple:
    """A level square, and its faces; vertices off the raster's middles."""
    line = np.linspace(low, high, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, np.full_like(x, y), z], -1).reshape(-1, 3).astype(np.float32)
    index = np.arange((cells + 1) ** 2, dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    )
    return vertices, faces[:, ::-1] if is_down else faces


def table() -> TopSurface:
    """A plate of 6 x 6 m (region 1) with its underside (region 2) over ground of 20 x 20 m."""
    top = TopSurface.over(np.array([-10.0, 0, -10]), np.array([10.0, 3, 10]), 3, 0.1)
    for region, (vertices, faces) in enumerate(
        (sheet(-10, 10, 0, 41), sheet(-3, 3, 3, 7), sheet(-3, 3, 2.5, 5, is_down=True))
    ):
        top.add(vertices, faces, np.full(len(faces), region))
    return top


def test_plan_areas_count_the_highest_surface_and_add_up() -> None:
    drawn = [400.0, 36.0, 36.0]
    document = {"regions": [{"id": n, "plan_area_m2": m2} for n, m2 in enumerate(drawn)]}
    areas = [
        row["plan_area_m2"] for row in with_plan(document, measure_plan(table(), None))["regions"]
    ]
    assert areas == pytest.approx([364.0, 36.0, 0.0], abs=0.4)
    assert sum(areas) == pytest.approx(400.0, abs=0.01)


def test_the_order_of_the_parts_does_not_count() -> None:
    parts = [sheet(-3, 3, 3, 7), sheet(-10, 10, 0, 41)]
    found = []
    for order in ((0, 1), (1, 0)):
        top = TopSurface.over(np.array([-10.0, 0, -10]), np.array([10.0, 3, 10]), 2, 0.1)
        for part in order:
            vertices, faces = parts[part]
            top.add(vertices, faces, np.full(len(faces), part))
        found.append(top)
    np.testing.assert_array_equal(found[0].region, found[1].region)
    np.testing.assert_allclose(found[0].hidden_m2, found[1].hidden_m2, atol=1e-9)


def test_the_space_below_an_overhang() -> None:
    assert float(table().empty_m.sum()) * 0.01 == pytest.approx(36 * 2.5, rel=0.01)


def test_each_cell_of_a_surface_is_met_once_also_on_its_edges() -> None:
    """Vertices on the middles of cells: of the triangles that meet there one has the cell."""
    top = TopSurface.over(np.array([0.0, 0, 0]), np.array([8.0, 0, 8]), 1, 1.0)
    vertices, faces = sheet(0.5, 7.5, 1.0, 7)
    top.add(vertices, faces, np.zeros(len(faces)))
    assert top.hidden_m2[0] == 0.0
    assert int(top.net.max()) == 1


def test_a_raster_is_bounded() -> None:
    top = TopSurface.over(np.zeros(3), np.array([1e5, 0, 2.0]), 1, 1e-4)
    assert top.height_m.size < 2.5 * (1 << 22)
