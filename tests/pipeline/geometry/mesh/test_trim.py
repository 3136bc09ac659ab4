from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from terraport_pipeline.geometry.mesh.trim import (
    close_small_gaps,
    compact,
    island_mask,
    near_mask,
    support_mask,
)


def sheet(side: int, step_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A flat square of side x side cells, two faces each."""
    x, z = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    vertices = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1) * step_m
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    first = np.stack([corner, corner + side + 1, corner + 1], axis=1)
    second = np.stack([corner + 1, corner + side + 1, corner + side + 2], axis=1)
    return vertices.astype(np.float32), np.concatenate([first, second]).astype(np.int32)


def test_support_keeps_what_lies_near_samples() -> None:
    vertices, faces = sheet(20)
    samples = vertices[vertices[:, 0] <= 10]
    keep = support_mask(
        vertices, faces, cKDTree(samples), np.ones(len(samples), np.float32), spacings=3.0
    )
    reach = vertices[faces][:, :, 0].max(axis=1)
    assert keep[reach <= 13].all()
    assert not keep[reach > 13].any()


def test_support_reaches_farther_where_samples_are_thin_but_not_without_end() -> None:
    vertices, faces = sheet(60)
    samples = vertices[vertices[:, 0] <= 10]
    spacing = np.ones(len(samples), np.float32)
    spacing[samples[:, 2] > 40] = 100.0  # a hole's rim: few points in reach
    keep = support_mask(vertices, faces, cKDTree(samples), spacing, spacings=4.0)
    corners = vertices[faces]
    thin = corners[:, :, 2].min(axis=1) > 55
    dense = corners[:, :, 2].max(axis=1) < 30
    assert corners[keep & dense][:, :, 0].max() == 14
    assert corners[keep & thin][:, :, 0].max() == 22  # three spacings of the cloud, times four


def test_near_keeps_every_face_that_could_touch() -> None:
    vertices, faces = sheet(20)
    point = np.array([[10.3, 0.0, 10.3]])
    keep = near_mask(vertices, faces, cKDTree(point), margin_m=2.0)
    distance_m = np.linalg.norm(vertices - point[0], axis=1)[faces].min(axis=1)
    assert keep[distance_m <= 2.0].all()
    assert not keep[distance_m > 4.5].any()


def test_islands_go_and_the_largest_piece_stays() -> None:
    vertices, faces = sheet(10)
    island = faces[:3] + len(vertices)
    both = np.concatenate([faces, island]).astype(np.int32)
    keep, dropped = island_mask(both, 2 * len(vertices), min_faces=10)
    assert dropped == 1
    assert keep[: len(faces)].all()
    assert not keep[len(faces) :].any()
    keep, dropped = island_mask(island, 2 * len(vertices), min_faces=10)
    assert keep.all()
    assert dropped == 0


def test_islands_of_nothing() -> None:
    keep, dropped = island_mask(np.zeros((0, 3), np.int32), 0, min_faces=10)
    assert len(keep) == dropped == 0


def test_small_gaps_close_and_large_ones_stay_open() -> None:
    vertices, faces = sheet(30)
    centre = vertices[faces].mean(axis=1)
    small = (np.abs(centre[:, ::2] - 6) < 1.5).all(axis=1)
    large = (np.abs(centre[:, ::2] - 20) < 6).all(axis=1)
    keep = close_small_gaps(vertices, faces, ~(small | large), max_extent_m=4.0)
    assert keep[small].all()
    assert not keep[large].any()


def test_gaps_that_touch_nothing_stay_open() -> None:
    vertices, faces = sheet(4)
    keep = close_small_gaps(vertices, faces, np.zeros(len(faces), dtype=bool), max_extent_m=99.0)
    assert not keep.any()


def test_compact_keeps_faces_and_order() -> None:
    vertices, faces = sheet(5)
    keep = np.arange(len(faces)) % 3 == 0
    fewer, kept = compact(vertices, faces, keep)
    assert (fewer[kept] == vertices[faces[keep]]).all()
    assert len(fewer) == len(np.unique(faces[keep]))
