"""Seams between photos on four faces, written out."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET
from terraport_pipeline.geometry.photos.view_candidates import Candidates, new_candidates
from terraport_pipeline.geometry.textures.seams import Seams, find_seams, label_nodes

VERTICES = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1], [2, 0, 0], [2, 0, 1]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]], np.int32)
"""A strip: the faces meet at the edges (1, 2), (2, 3), (3, 4)."""


def shown(*seen_levels: dict[int, int]) -> Candidates:
    """Grey levels of each face by view."""
    candidates = new_candidates(len(seen_levels))
    for f, levels in enumerate(seen_levels):
        for s, view in enumerate(sorted(levels)):
            candidates.view[f, s] = view
            candidates.colour[f, s] = levels[view]
    return candidates


def seams_of(
    view: list[int], candidates: Candidates, gains: tuple[float, ...] = (1, 1, 1)
) -> Seams:
    views = np.array(view, np.int32)
    pairs, edges = face_pairs(FACES, len(VERTICES))
    own = np.full((4, 3), 90, np.uint8)
    factor = np.repeat(np.array(gains, np.float32)[:, None], 3, axis=1)
    nodes = label_nodes(FACES, views, len(VERTICES))
    return find_seams(nodes, FACES, views, candidates, own, factor, pairs, edges, VERTICES)


BOTH = {0: 100, 1: 112}


def test_a_node_for_every_view_around_a_vertex() -> None:
    views = np.array([0, 1, 1, 0], np.int32)
    nodes = label_nodes(FACES, views, len(VERTICES))
    assert (nodes.vertex[nodes.corner] == FACES).all()
    assert (nodes.view[nodes.corner] == views[:, None]).all()
    pairs = set(zip(nodes.vertex.tolist(), nodes.view.tolist(), strict=True))
    assert len(pairs) == len(nodes.vertex) == 6 + 4  # 1, 2, 3 and 4 are seen by both


def test_a_vertex_without_faces_has_a_node_of_no_view() -> None:
    nodes = label_nodes(FACES[:1], np.array([-1], np.int32), 6)
    assert nodes.view.tolist() == [-1, -1, -1, -2, -2, -2]


def test_one_view_has_no_seam() -> None:
    assert len(seams_of([1, 1, 1, 1], shown(*[BOTH] * 4)).face) == 0


def test_a_step_is_the_mean_of_both_sides_faces() -> None:
    seams = seams_of([0, 0, 1, 1], shown(BOTH, {0: 100, 1: 108}, {0: 100, 1: 116}, BOTH))
    assert seams.face.tolist() == [[1, 2]]
    assert seams.step.tolist() == [[-12.0] * 3]
    nodes = label_nodes(FACES, np.array([0, 0, 1, 1], np.int32), 6)
    assert {tuple(nodes.vertex[end]) for end in seams.node[0]} == {(2, 2), (3, 3)}
    assert (nodes.view[seams.node[0]] == [0, 1]).all()


def test_a_face_seen_by_one_alone_is_left_out_of_the_step() -> None:
    seams = seams_of([0, 0, 1, 1], shown(BOTH, {0: 250}, {0: 100, 1: 108}, BOTH))
    assert seams.step.tolist() == [[-8.0] * 3]


def test_faces_that_no_view_shares_are_compared_with_little_trust() -> None:
    apart = seams_of([0, 0, 1, 1], shown(BOTH, {0: 100}, {1: 112}, BOTH))
    shared = seams_of([0, 0, 1, 1], shown(*[BOTH] * 4))
    assert apart.step.tolist() == shared.step.tolist() == [[-12.0] * 3]
    assert apart.trust[0] == pytest.approx(0.2 * shared.trust[0])


def test_large_steps_are_clipped_and_trusted_less() -> None:
    steps = (0, 12, 24, 200)
    seams_by_step = [seams_of([0, 0, 1, 1], shown(*[{0: 20, 1: 20 + step}] * 4)) for step in steps]
    assert [seams.step[0, 0] for seams in seams_by_step] == [0, -12, -24, -48]
    assert [seams.raw_step[0, 0] for seams in seams_by_step] == [0, -12, -24, -200]
    assert [seams.trust[0] for seams in seams_by_step] == pytest.approx([1, 1 / 2, 1 / 5, 1 / 17])


def test_gains_are_undone_in_the_raw_step() -> None:
    seams = seams_of([0, 0, 1, 1], shown(*[BOTH] * 4), (2.0, 1.0, 1.0))
    raw = (100 + SRGB_OFFSET) / 2 - (112 + SRGB_OFFSET)
    assert seams.raw_step[0] == pytest.approx([raw] * 3)


def test_vertex_colours_are_a_side_like_any_other() -> None:
    seams = seams_of([0, 0, -1, -1], shown(*[BOTH] * 4))
    assert seams.step.tolist() == [[10.0] * 3]  # 100 of view 0 against 90 of its own


def test_weights_go_by_length() -> None:
    seams = seams_of([0, 1, 0, 1], shown(*[BOTH] * 4))
    by_edge = {
        tuple(sorted(face)): weight
        for face, weight in zip(seams.face.tolist(), seams.weight, strict=True)
    }
    assert by_edge[0, 1] == by_edge[2, 3] == pytest.approx(2**0.5 * by_edge[1, 2])


def test_an_edge_to_a_face_that_took_its_neighbours_photo_says_nothing() -> None:
    """Face 2 has a photo whose colour there is not known; face 1 lies between two photos."""
    seams = seams_of([0, 0, 1, 1], shown(BOTH, {0: 100}, {}, {1: 90}))
    assert seams.face.tolist() == [[1, 2]]
    assert (seams.weight == 0.0).all()
    assert (seams.trust == 0.0).all()
    assert (seams.step == 0.0).all()
    assert (seams.raw_step == 0.0).all()
