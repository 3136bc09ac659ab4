"""Samples stand for the area of their label, and no label is forgotten."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.mesh.surface_samples import SurfaceSamples, surface_samples


@given(
    st.integers(0, 2**32 - 1), st.integers(1, 200), st.integers(1, 20), st.sampled_from([1, 4, 64])
)
@settings(max_examples=80)
def test_every_label_keeps_its_area(seed, n_faces, faces_per_sample, at_least):
    """Counts as promised, areas to rounding, points on faces of the label."""
    rng = np.random.default_rng(seed)
    vertices = rng.integers(-4, 5, (30, 3)).astype(np.float32)
    faces = rng.integers(0, 30, (n_faces, 3)).astype(np.int32)
    labels = rng.integers(0, 5, n_faces).astype(np.int32) * 3
    for array in (vertices, faces, labels):
        array.flags.writeable = False
    samples = surface_samples(
        vertices, faces, labels, faces_per_sample=faces_per_sample, at_least=at_least
    )
    corners = vertices[faces].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    centres = corners.mean(axis=1)
    assert (np.diff(samples.labels) >= 0).all()
    assert set(samples.labels.tolist()) == set(labels.tolist())
    for label in set(labels.tolist()):
        mine, here = samples.labels == label, labels == label
        n = int(here.sum())
        assert mine.sum() == min(n, max(-(-n // faces_per_sample), at_least))
        assert samples.areas[mine].sum() == pytest.approx(area[here].sum())
        distance = np.abs(samples.points[mine][:, None] - centres[here][None]).max(axis=2)
        assert distance.min(axis=1).max() < 1e-6


def test_each_face_is_its_own_sample_where_there_is_room():
    """Equal areas: every face once, in order."""
    vertices = np.array([[x, 0, z] for x in range(5) for z in (0, 1)], float)
    faces = np.array([[2 * i, 2 * i + 1, 2 * i + 2] for i in range(4)])
    samples = surface_samples(vertices, faces, np.zeros(4, int), faces_per_sample=1)
    assert samples.points[:, 0].tolist() == pytest.approx([i + 1 / 3 for i in range(4)])
    assert samples.areas.tolist() == [0.5] * 4


def test_large_faces_are_taken_more_often():
    """Nine tenths of the area lie in one of two faces."""
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [9, 0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3]])
    samples = surface_samples(vertices, faces, np.zeros(2, int), faces_per_sample=2, at_least=1)
    assert samples.points.tolist() == [[3.0, 0.0, 1 / 3]]
    assert samples.areas.tolist() == [5.0]


def test_nothing_and_bad_input():
    empty = np.zeros((0, 3))
    samples = surface_samples(empty, empty.astype(int), np.zeros(0, int), faces_per_sample=1)
    assert samples.points.shape == (0, 3)
    assert SurfaceSamples.joined([samples, samples]).areas.shape == (0,)
    with pytest.raises(ValueError, match=r"labels have shape \(1,\), expected \(0,\)"):
        surface_samples(empty, empty.astype(int), np.zeros(1, int), faces_per_sample=1)
    with pytest.raises(ValueError, match="0 faces per sample, expected at least 1"):
        surface_samples(empty, empty.astype(int), np.zeros(0, int), faces_per_sample=0)
