"""Parts of a body: sums that merging adds up, and unions in the order of their likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.part_merge import (
    PartWeights,
    fact_names,
    merge_parts,
    part_weights,
)
from terraport_pipeline.geometry.graph.part_table import FACTS, BodyFacts, PartTable
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres

ROUND = 12


def ring_of_faces(copies: int = 1) -> tuple[BodyFacts, Int32]:
    """Tubes beside each other, in eight bands each, with thickness and sight by lot."""
    i, j = np.meshgrid(np.arange(ROUND), np.arange(8), indexing="ij")
    a, b = i * 9 + j, (i + 1) % ROUND * 9 + j
    faces = np.stack([a, b, a + 1, b, b + 1, a + 1], axis=-1).reshape(-1, 3).astype(np.int32)
    turn, z = np.meshgrid(np.arange(ROUND) * 2 * np.pi / ROUND, np.arange(9.0), indexing="ij")
    wide = np.where(np.abs(z - 4) < 1, 0.3, 1.0)
    tube = np.stack([wide * np.cos(turn), wide * np.sin(turn), z], axis=-1).reshape(-1, 3)
    bands = (np.arange(len(faces)) // 2 % 8).astype(np.int32)
    faces = np.concatenate([faces + k * len(tube) for k in range(copies)])
    vertices = np.concatenate([tube + np.array([5.0 * k, 0, 0]) for k in range(copies)])
    labels = np.concatenate([bands + 8 * k for k in range(copies)]).astype(np.int32)
    rng = np.random.default_rng(1)
    pairs, edges = face_pairs(faces, len(vertices))
    p, q, r = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(q - p, r - p)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    samples = rng.integers(0, len(faces), 60).astype(np.int32)
    sees = rng.random((60, 60)) < 0.4
    body = BodyFacts(
        face_areas(vertices, faces),
        face_centres(vertices, faces),
        normals,
        pairs,
        np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1),
        np.where(rng.random(len(faces)) < 0.1, np.nan, 0.5 + rng.random(len(faces))),
        samples,
        sees | sees.T,
    )
    return body, labels


def test_a_merged_table_is_the_table_of_the_merged_parts() -> None:
    body, labels = ring_of_faces()
    merged = PartTable(body, labels, 8)
    merged.merge(2, 3)
    merged.merge(2, 1)
    anew = PartTable(body, np.where(np.isin(labels, (1, 3)), 2, labels).astype(np.int32), 8)
    small, large = merged.neighbours()
    np.testing.assert_array_equal((small, large), anew.neighbours())
    assert {frozenset(two) for two in zip(small.tolist(), large.tolist(), strict=True)} == {
        frozenset(two) for two in ((0, 2), (2, 4), (4, 5), (5, 6), (6, 7))
    }
    facts = merged.facts(small, large)
    assert facts.shape == (5, len(FACTS))
    assert np.isfinite(facts).all()
    np.testing.assert_allclose(facts, anew.facts(small, large), rtol=1e-9, atol=1e-12)
    of_one = merged.neighbours_of(2)
    assert sorted(np.concatenate(of_one).tolist()) == [0, 2, 2, 4]


def test_facts_know_no_unit() -> None:
    body, labels = ring_of_faces()
    larger = BodyFacts(
        body.area * 49.0, body.centres * 7.0, body.normals, body.pairs, body.edge_lengths * 7.0,
        body.thickness * 7.0, body.samples, body.sees,
    )  # fmt: skip
    tables = [PartTable(one, labels, 8) for one in (body, larger)]
    facts = [table.facts(*table.neighbours()) for table in tables]
    np.testing.assert_allclose(*facts, rtol=1e-9, atol=1e-9)


def by_border_alone() -> PartWeights:
    """Long borders are likely inside a part."""
    weight = np.zeros(len(FACTS))
    weight[FACTS.index("log border")] = 4.0
    mean = np.zeros(len(FACTS))
    return PartWeights(mean, np.ones(len(FACTS)), weight, 0.0)


def test_the_likeliest_go_first_and_the_neck_last() -> None:
    body, labels = ring_of_faces()
    done = merge_parts(body, labels, 8, by_border_alone())
    assert done.merges.shape == (7, 2)
    two, count = done.cut_by_count(2)
    assert count == 2
    # Bands 3 and 4 lie at the neck, which is the shortest border.
    assert (two == (labels >= 4)).all()
    for k in range(1, 9):
        cut, count = done.cut_by_count(k)
        assert count == k == len(np.unique(cut))
    assert done.cut_by_count(20)[1] == 8
    assert done.cut_by_likelihood(2.0)[1] == 8
    assert done.cut_by_likelihood(0.0)[1] == 1
    least = float(done.likelihood[-1])
    assert done.cut_by_likelihood(least)[1] == 1
    assert done.cut_by_likelihood(least + 1e-9)[1] >= 2


def test_what_does_not_touch_stays_apart() -> None:
    body, labels = ring_of_faces(copies=2)
    done = merge_parts(body, labels, 16)
    cut, count = done.cut_by_count(1)
    assert count == 2
    assert (cut == labels // 8).all()


def test_the_kept_weights_are_of_these_facts() -> None:
    weights = part_weights()
    assert len(set(fact_names())) == len(FACTS)
    assert weights.weight.shape == weights.mean.shape == (len(FACTS),)
    assert (weights.deviation > 0.0).all()
    far = weights.likelihood(np.full((1, len(FACTS)), 1e9))
    assert 0.0 < far[0] < 1.0
    # What any person knows: two that see little of each other over a short, sharp border are two.
    usual = weights.mean.copy()
    sharp = usual.copy()
    sharp[FACTS.index("border's weight, smoothed")] = 0.0
    sharp[FACTS.index("sight between over the lesser within")] = 0.0
    low, high = weights.likelihood(np.stack([sharp, usual]))
    assert low < high
    with pytest.raises(ValueError, match="shape"):
        weights.likelihood(np.zeros((1, 3)))
