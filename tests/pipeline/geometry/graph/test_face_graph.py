"""Measures of faces and their borders."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.graph.face_graph import (
    LAB_STEPS,
    face_graph,
    smooth_colours,
    sum_facts,
)
from terraport_pipeline.geometry.regions.colour import srgb_to_lab

SQUARE = np.array([[0, 0, 0], [3, 0, 0], [0, 0, 4], [3, 0, 4]], np.float32)
HALVES = np.array([[0, 2, 1], [1, 2, 3]], np.int32)


def test_lengths_and_areas_in_steps():
    graph = face_graph(SQUARE, HALVES)
    assert graph.length.tolist() == [2**30]
    assert graph.area.tolist() == [2**30, 2**30]
    # one step of length over one of area, times the root of the whole area (5 / 6 * sqrt(12))
    assert graph.scale == pytest.approx(5 / 6 * np.sqrt(12))
    assert graph.facts.normal.tolist() == [[0, 2**14, 0]] * 2


def test_pairs_that_share_several_edges_add_them_up():
    twice = np.array([[0, 2, 1], [0, 2, 1]], np.int32)
    graph = face_graph(SQUARE, np.concatenate([twice, HALVES[1:]]))
    length = dict(zip(map(tuple, graph.pairs.tolist()), graph.length.tolist(), strict=True))
    assert length[0, 1] == 2**30, "3 + 4 + 5 is the longest"
    assert length[0, 2] == pytest.approx(5 / 12 * 2**30, abs=1)


def test_colours_are_lab_of_the_mean(soup):
    mesh = soup(3)
    graph = face_graph(mesh.vertices, mesh.faces, colours=mesh.colours)
    lab = srgb_to_lab(mesh.colours[mesh.faces].astype(np.float64).mean(axis=1))
    np.testing.assert_allclose(graph.facts.lab / LAB_STEPS, lab, atol=0.51 / LAB_STEPS)


def test_scalar_is_stretched_over_a_hue():
    graph = face_graph(SQUARE, HALVES, scalar=np.array([-3.0, 7.0]))
    assert (graph.facts.lab / LAB_STEPS).tolist() == [[0, 0, 0], [0, 100, 0]]


def test_smoothing_averages_over_neighbours():
    colours = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [255, 255, 255]], np.uint8)
    graph = face_graph(SQUARE, HALVES, colours=colours)
    before, after = graph.facts.lab, smooth_colours(graph, 1).facts.lab
    mean = (before.astype(int).sum(axis=0) + 1) // 2
    assert after.tolist() == [mean.tolist()] * 2
    assert smooth_colours(graph, 0) is graph


def test_sums_over_unions(terrain):
    mesh = terrain(0)
    facts = face_graph(mesh.vertices, mesh.faces, colours=mesh.colours).facts
    nodes = (np.arange(len(mesh.faces)) % 7).astype(np.int32)
    whole = sum_facts(facts, nodes, 7)
    for rows, total in ((facts.normal, whole.normal), (facts.centre, whole.centre)):
        for union in range(7):
            assert total[union].tolist() == rows[nodes == union].astype(int).sum(axis=0).tolist()
    assert whole.faces.sum() == len(mesh.faces)


def test_flat_and_empty_meshes():
    point = face_graph(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    assert point.area.tolist() == [1]
    none = face_graph(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert (len(none.area), len(none.pairs)) == (0, 0)


def test_values_that_are_not_finite_are_refused():
    broken = SQUARE.copy()
    broken[2, 1] = np.nan
    with pytest.raises(ValueError, match=r"vertex 2 is .* expected finite"):
        face_graph(broken, HALVES)
    with pytest.raises(ValueError, match="scalar of face 1 is inf"):
        face_graph(SQUARE, HALVES, scalar=np.array([0.0, np.inf]))
