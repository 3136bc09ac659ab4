"""The interface of region engines, and TPA behind it."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import face_pairs, vertex_pairs
from terraport_pipeline.geometry.regions import triangle_pool
from terraport_pipeline.geometry.regions.engine_options import (
    FINE_POOLS,
    REGION_POOLS,
    TrianglePoolOptions,
)
from terraport_pipeline.geometry.regions.segmenter import (
    SEGMENTERS,
    SegmenterMesh,
    TriangleSegmenter,
    segmenter_by_name,
)
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools


def test_tpa_gives_what_two_runs_give(terrain):
    mesh = terrain(1)
    segmentation = TriangleSegmenter().segment(
        SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    )
    regions = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=REGION_POOLS)
    fine = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=FINE_POOLS)
    assert segmentation.regions.tobytes() == regions.labels.tobytes()
    assert segmentation.fine.tobytes() == fine.labels.tobytes()
    assert segmentation.similarity.tobytes() == fine.similarity.tobytes()
    assert (segmentation.region_count, segmentation.fine_count) == (regions.count, fine.count)


@pytest.mark.parametrize(
    "fine",
    [
        TrianglePoolOptions(threshold=0.2, small_threshold=0.0, tau=0.5),
        TrianglePoolOptions(threshold=0.2, small_threshold=0.0, contiguity="vertex"),
    ],
)
def test_tpa_with_options_that_share_nothing(terrain, fine):
    mesh = terrain(2, holes=0.2)
    segmentation = TriangleSegmenter(fine=fine).segment(
        SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    )
    pairs = (
        vertex_pairs(mesh.faces, len(mesh.vertices))
        if fine.contiguity == "vertex"
        else face_pairs(mesh.faces, len(mesh.vertices))[0]
    )
    alone = triangle_pools(
        mesh.vertices, mesh.faces, colours=mesh.colours, options=fine, pairs=pairs
    )
    assert segmentation.fine.tobytes() == alone.labels.tobytes()
    assert segmentation.similarity.tobytes() == alone.similarity.tobytes()


def test_similarity_is_computed_once_where_the_options_agree(terrain, monkeypatch):
    mesh = SegmenterMesh(terrain(3).vertices, terrain(3).faces, terrain(3).colours)
    calls = []
    original = triangle_pool.similarity_index
    monkeypatch.setattr(
        "terraport_pipeline.geometry.regions.triangle_pool.similarity_index",
        lambda *a, **k: calls.append(1) or original(*a, **k),
    )
    TriangleSegmenter().segment(mesh)
    assert len(calls) == 1
    TriangleSegmenter(fine=TrianglePoolOptions(mu=2.0)).segment(mesh)
    assert len(calls) == 3


def test_scalar_stands_for_colour(terrain):
    mesh = terrain(4)
    scalar = np.linspace(0.0, 1.0, len(mesh.faces))
    both = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours, scalar)
    alone = SegmenterMesh(mesh.vertices, mesh.faces, None, scalar)
    assert (
        TriangleSegmenter().segment(both).regions.tobytes()
        == TriangleSegmenter().segment(alone).regions.tobytes()
    )


def test_mesh_without_colour_is_one_region(terrain):
    mesh = terrain(5)
    segmentation = TriangleSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces))
    assert segmentation.region_count == 1


def test_no_faces():
    mesh = SegmenterMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    segmentation = TriangleSegmenter().segment(mesh)
    assert (segmentation.region_count, segmentation.fine_count, len(segmentation.regions)) == (
        0,
        0,
        0,
    )


def test_arrays_that_do_not_belong_together_are_refused(terrain):
    mesh = terrain(6)
    with pytest.raises(ValueError, match=r"colours have shape \(1, 3\), expected"):
        SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours[:1])
    with pytest.raises(ValueError, match=r"scalar has shape \(3,\), expected"):
        SegmenterMesh(mesh.vertices, mesh.faces, None, np.zeros(3))
    with pytest.raises(ValueError, match=r"expected \(V, 3\) and \(F, 3\)"):
        SegmenterMesh(mesh.vertices[0], mesh.faces)


@pytest.mark.parametrize("name", SEGMENTERS)
def test_every_engine_keeps_the_interface(terrain, name):
    mesh = terrain(7, 24, holes=0.05)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    engine = segmenter_by_name(name)
    assert engine.name == name
    segmentation = engine.segment(subject)
    for labels in (segmentation.regions, segmentation.fine):
        first = np.unique(labels, return_index=True)[1]
        assert (labels.dtype, labels.shape) == (np.int32, (len(mesh.faces),))
        assert (labels[np.sort(first)] == np.arange(len(first))).all(), "numbered by first face"
    assert segmentation.region_count == segmentation.regions.max() + 1
    assert segmentation.similarity.dtype == np.float32
    again = segmenter_by_name(name).segment(subject)
    assert segmentation.regions.tobytes() == again.regions.tobytes()
    assert segmentation.fine.tobytes() == again.fine.tobytes()


def test_unknown_engine_is_refused():
    with pytest.raises(ValueError, match="engine is 'magic', expected one of"):
        segmenter_by_name("magic")
