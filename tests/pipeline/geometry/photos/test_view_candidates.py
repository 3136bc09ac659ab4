"""Which photos could colour a face: rated on hand-made faces, kept against a plain sort."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_blocks import MeshBlocks, mesh_blocks
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.geometry.photos.view_candidates import (
    SLOTS,
    Candidates,
    Rated,
    insert,
    median_area,
    new_candidates,
    project_blocks,
    rate_faces,
    sorted_by_view,
    visible_blocks,
)
from terraport_pipeline.geometry.photos.view_kernels import quality_level

LENS = Lens(200, 100, 100.0, 100.0, 100.0, 50.0)
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
ABOVE = View("above", LENS, DOWN, np.array([0.0, 10.0, 0.0]))
"""Ten metres up, looking down: ten pixels a metre, the ground from -10 to 10 m by -5 to 5 m."""
SHARP = np.ones((1, 1), np.float32)


def blocks_of(*triangles: list[list[float]]) -> MeshBlocks:
    vertices = np.array(triangles, np.float32).reshape(-1, 3)
    return mesh_blocks(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))


UP = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
"""Half a square metre of ground, seen from above: 50 square pixels."""


def moved(x: float, y: float = 0.0, z: float = 0.0) -> list[list[float]]:
    return (np.array(UP) + np.array((x, y, z))).tolist()


def rated(
    blocks: MeshBlocks,
    *,
    sharpness: np.ndarray = SHARP,
    candidates: Candidates | None = None,
    min_cosine: float = 0.1,
) -> dict[int, tuple[float, float]]:
    """Quality and area by the face's number before it was sorted."""
    packed = ABOVE.packed()
    seen = visible_blocks(blocks, ABOVE)
    uv = np.empty((len(blocks.vertices), 2), np.float32)
    project_blocks(blocks, packed, seen, uv)
    rating = rate_faces(
        blocks, packed, seen, uv, sharpness, candidates or new_candidates(len(blocks.faces)),
        min_cosine=min_cosine,
    )  # fmt: skip
    old = blocks.face_order[rating.face]
    return {
        int(f): (float(q), float(a))
        for f, q, a in zip(old, rating.quality, rating.area, strict=True)
    }


def test_area_times_cosine_times_sharpness() -> None:
    ((quality, area),) = rated(blocks_of(UP), sharpness=3 * SHARP).values()
    assert area == pytest.approx(50.0)
    assert quality == pytest.approx(3 * 50.0)  # the first corner lies right below


def test_what_looks_away_or_leaves_the_picture_is_left_out() -> None:
    away = UP[::-1]
    across_the_rim = moved(9.5)
    outside = moved(30.0)
    behind = moved(0.0, y=20.0)
    assert set(rated(blocks_of(away, UP, across_the_rim, outside, behind))) == {1}


def test_flat_angles_are_left_out() -> None:
    face = blocks_of(moved(8.0))  # seen at an angle of 8 to 10
    cosine = 10 / np.hypot(10, 8)
    assert rated(face, min_cosine=cosine - 0.01)
    assert not rated(face, min_cosine=cosine + 0.01)


def test_sharpness_is_read_where_the_face_lies() -> None:
    sharpness = np.array([[1.0, 2.0, 4.0, 8.0]], np.float32)
    faces = blocks_of(*(moved(x) for x in (-8.0, -3.0, 2.0, 7.0)))
    plain, sharp = rated(faces), rated(faces, sharpness=sharpness)
    assert [sharp[f][0] / plain[f][0] for f in range(4)] == pytest.approx([1, 2, 4, 8])


def test_a_face_with_better_views_in_all_its_places_is_left_out() -> None:
    candidates = new_candidates(1)
    candidates.quality[:] = quality_level(50.0) + 1
    assert not rated(blocks_of(UP), candidates=candidates)
    candidates.quality[0, 3] = quality_level(50.0) - 1
    assert rated(blocks_of(UP), candidates=candidates)


def test_blocks_outside_the_cone_are_left_out_and_none_inside() -> None:
    rng = np.random.default_rng(0)
    middle = np.repeat(rng.uniform(-60, 60, (20_000, 1, 3)) * (1, 0, 1), 3, axis=1)
    vertices = (middle + rng.uniform(-0.2, 0.2, middle.shape)).astype(np.float32).reshape(-1, 3)
    blocks = mesh_blocks(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    seen = visible_blocks(blocks, ABOVE)
    assert (np.diff(seen) > 0).all()
    assert len(seen) < len(blocks.spheres)
    pixels, _ = ABOVE.project(blocks.vertices)
    inside = ((pixels >= 0) & (pixels <= (200, 100))).all(axis=1)
    block = np.searchsorted(blocks.vertex_starts, np.flatnonzero(inside), side="right") - 1
    assert inside.any()
    assert np.isin(block, seen).all()


def test_vertices_of_blocks_not_seen_have_no_pixel() -> None:
    blocks = blocks_of(UP, moved(3.0))
    uv = np.zeros((6, 2), np.float32)
    project_blocks(blocks, ABOVE.packed(), np.zeros(0, np.intp), uv)
    assert np.isnan(uv).all()
    assert median_area(blocks, ABOVE.packed(), np.zeros(0, np.intp), uv) == 0.0


def test_the_best_stay() -> None:
    rng = np.random.default_rng(1)
    n_views = 3 * SLOTS
    quality = np.exp2(rng.permuted(np.tile(np.linspace(-3, 6, n_views), (40, 1)), axis=1).T)
    quality = quality.astype(np.float32)  # no two of a face are equal
    visible = rng.random((n_views, 40)) < 0.7
    candidates = new_candidates(40)
    for view in range(n_views):
        some = np.flatnonzero(rng.random(40) < 0.8).astype(np.int32)
        colours = np.full((len(some), 3), view, np.uint8)
        insert(
            candidates, view, Rated(some, quality[view, some], quality[view, some]),
            visible[view, some], colours,
        )  # fmt: skip
        visible[view, np.setdiff1d(np.arange(40), some)] = False
    sorted_by_view(candidates, threads=2)
    for f in range(40):
        seen = [v for v in range(n_views) if visible[v, f]]
        best = sorted(sorted(seen, key=lambda v: (-quality[v, f], v))[:SLOTS])
        assert candidates.view[f].tolist() == best + [-1] * (SLOTS - len(best))
        assert candidates.quality[f, : len(best)].tolist() == [
            quality_level(float(quality[v, f])) for v in best
        ]
        assert candidates.colour[f, : len(best), 0].tolist() == best
        assert (candidates.quality[f, len(best) :] == 0).all()


def test_a_view_as_good_as_the_worst_is_left_out() -> None:
    candidates = new_candidates(1)
    face, seen = np.zeros(1, np.int32), np.ones(1, np.bool_)
    for view in range(SLOTS + 3):
        quality = np.full(1, 8.0, np.float32)
        insert(candidates, view, Rated(face, quality, quality), seen, np.zeros((1, 3), np.uint8))
    assert candidates.view[0].tolist() == list(range(SLOTS))
