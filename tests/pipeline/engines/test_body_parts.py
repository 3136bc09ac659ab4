"""Bodies cut into parts: at the waist, whichever way they are numbered, wound, or fine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.engines import body_parts
from terraport_pipeline.engines.body_parts import PIECES, BodySegmenter
from terraport_pipeline.engines.body_sight import body_sight
from terraport_pipeline.geometry.graph.graph_options import BODY_GRAPH
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_research.procedural_bodies import procedural_models
from terraport_research.segmentation_scores import rand_error

MODEL = next(procedural_models())
MESH = SegmenterMesh(MODEL.vertices.astype(np.float32), MODEL.faces)


def test_a_dumb_bell_is_two_balls_and_a_waist() -> None:
    found = BodySegmenter().segment(MESH)
    assert found.region_count == 3
    assert rand_error(found.regions, MODEL.people[0]) < 0.05
    assert found.facts["pieces"] == found.fine_count <= PIECES
    # Every pool lies in one region.
    both = np.unique(np.stack([found.fine, found.regions]), axis=1)
    assert both.shape[1] == found.fine_count
    for k in (1, 2, 3, 8, PIECES + 20):
        told = BodySegmenter(count=k).segment(MESH)
        assert told.region_count == len(np.unique(told.regions)) == k


def test_numbers_of_vertices_and_winding_change_nothing() -> None:
    usual = BodySegmenter().segment(MESH).regions
    order = np.random.default_rng(2).permutation(len(MESH.vertices))
    place = np.argsort(order)
    turned = SegmenterMesh(MESH.vertices[order], place[MESH.faces].astype(np.int32))
    np.testing.assert_array_equal(BodySegmenter().segment(turned).regions, usual)
    inwards = SegmenterMesh(MESH.vertices, np.ascontiguousarray(MESH.faces[:, ::-1]))
    np.testing.assert_array_equal(BodySegmenter().segment(inwards).regions, usual)


def test_a_fine_body_is_cut_on_a_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = BodySegmenter().segment(MESH)
    monkeypatch.setattr(body_parts, "_MOST_FACES", 4000)
    monkeypatch.setattr(body_parts, "_COPY_FACES", 3000)
    carried = BodySegmenter().segment(MESH)
    assert len(carried.regions) == len(MESH.faces)
    assert carried.region_count == usual.region_count
    assert rand_error(carried.regions, usual.regions) < 0.06


def test_a_stated_least_share_holds() -> None:
    area = face_areas(MODEL.vertices, MODEL.faces)
    options = replace(BODY_GRAPH, small_share=0.2)
    found = BodySegmenter(options).segment(MESH)
    assert np.bincount(found.regions, area).min() >= 0.2 * area.sum() * (1 - 1e-6)


def test_places_of_one_ball_see_each_other_and_not_the_other_balls() -> None:
    centres = face_centres(MODEL.vertices, MODEL.faces)
    area = face_areas(MODEL.vertices, MODEL.faces)
    a, b, c = (MODEL.vertices[MODEL.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
    if (normals * centres).sum() < 0:
        normals = -normals
    none = np.full(len(area), np.nan)
    samples, sees = body_sight(MESH.vertices, MESH.faces, area, centres, normals, none)
    assert (sees == sees.T).all()
    assert sees.diagonal().all()
    assert (area[samples] > 0).all()
    height = centres[samples][:, 2]
    top, bottom = height > 0.4, height < -0.4
    assert sees[np.ix_(top, top)].mean() > 0.9
    assert sees[np.ix_(top, bottom)].mean() < 0.3
    empty = body_sight(
        MESH.vertices, np.zeros((0, 3), np.int32), np.zeros(0), np.zeros((0, 3)),
        np.zeros((0, 3)), np.zeros(0),
    )  # fmt: skip
    assert [len(one) for one in empty] == [0, 0]
