"""Raggedness of segments whose shapes are given."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.segments.segment_shapes import (
    box_diagonals,
    raggedness,
)
from terraport_pipeline.geometry.segments.segments import SegmentOptions, build_segments


def plane(width, depth):
    """A flat grid of unit squares."""
    x, z = np.meshgrid(np.arange(width + 1.0), np.arange(depth + 1.0), indexing="ij")
    i, j = np.divmod(np.arange(width * depth), depth)
    a = i * (depth + 1) + j
    b = a + depth + 1
    faces = np.stack([a, a + 1, b, b, a + 1, b + 1], axis=1).reshape(-1, 3)
    return np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1), faces


@pytest.mark.parametrize(("width", "depth", "expected"), [(6, 6, 1.41), (40, 4, 3.18)])
def test_squares_and_strips(width, depth, expected):
    vertices, faces = plane(width, depth)
    zeros = np.zeros(len(faces), np.int32)
    segments = build_segments(
        vertices, faces, zeros, zeros.astype(np.float32), zeros,
        SegmentOptions(min_faces=1, max_faces=1000, max_extent_m=100.0),
    )  # fmt: skip
    assert raggedness(vertices, faces, segments, threads=2) == pytest.approx([expected], abs=0.005)
    assert box_diagonals(segments) == pytest.approx(np.hypot(width, depth))


def test_no_area_is_no_error():
    zeros = np.zeros(1, np.int32)
    vertices, faces = np.eye(3)[[0, 1, 0]], np.array([[0, 1, 2]])
    segments = build_segments(vertices, faces, zeros, zeros.astype(np.float32), zeros)
    assert np.isfinite(raggedness(vertices, faces, segments)).all()
