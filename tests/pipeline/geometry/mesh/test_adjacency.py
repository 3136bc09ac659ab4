"""Pairs and components against dictionaries and a breadth-first search."""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh import adjacency
from terraport_pipeline.geometry.mesh.adjacency import (
    MAX_FACES_PER_EDGE,
    components,
    face_pairs,
    vertex_pairs,
)


def pairs_by_dictionary(faces, size):
    """All pairs of faces that share `size` vertices, with the lowest shared corner set."""
    around = defaultdict(set)
    for f, face in enumerate(faces.tolist()):
        for corner in combinations(sorted(face), size):
            if len(set(corner)) == size:
                around[corner].add(f)
    lowest = {}
    for corner, members in sorted(around.items()):
        for pair in combinations(sorted(members), 2):
            lowest.setdefault(pair, corner)
    return lowest


@pytest.mark.parametrize("seed", range(80))
def test_face_pairs_equal_the_dictionary(soup, seed):
    """Every pair once, with its lowest shared edge, on soups full of non-manifold edges."""
    mesh = soup(seed)
    expected = pairs_by_dictionary(mesh.faces, 2)
    pairs, edges = face_pairs(mesh.faces, len(mesh.vertices))
    edge_of_pair = dict(zip(map(tuple, pairs.tolist()), map(tuple, edges.tolist()), strict=True))
    assert len(pairs) == len(edge_of_pair)
    assert edge_of_pair == expected
    assert edges.tolist() == sorted(edges.tolist())


@pytest.mark.parametrize("seed", range(40))
def test_vertex_pairs_equal_the_dictionary(soup, seed):
    """Every pair of faces with a common vertex once."""
    mesh = soup(seed)
    pairs = vertex_pairs(mesh.faces, len(mesh.vertices)).tolist()
    assert sorted(map(tuple, pairs)) == sorted(pairs_by_dictionary(mesh.faces, 1))


def test_crowded_edge_stays_connected_and_bounded():
    """Beyond the limit an edge's faces are chained: linear in faces, one component."""
    n = 500
    faces = np.stack([np.zeros(n), np.ones(n), np.arange(2, n + 2)], axis=1).astype(np.int32)
    pairs, _ = face_pairs(faces, n + 2)
    assert len(pairs) < n * MAX_FACES_PER_EDGE
    assert components(n, pairs)[1] == 1


def test_no_faces_and_one_face():
    """Empty in, empty out."""
    for faces in (np.zeros((0, 3), np.int32), np.array([[0, 1, 2]], np.int32)):
        pairs, edges = face_pairs(faces, 3)
        assert pairs.shape == edges.shape == (0, 2)
        assert pairs.dtype == edges.dtype == np.int32


@pytest.mark.parametrize("seed", range(40))
def test_components_equal_a_search(soup, seed):
    """Same partition as breadth-first search over equal labels, numbered by first face."""
    mesh = soup(seed)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    labels = np.random.default_rng(seed).integers(0, 3, len(mesh.faces)).astype(np.int32)
    near = defaultdict(list)
    for a, b in pairs.tolist():
        if labels[a] == labels[b]:
            near[a].append(b)
            near[b].append(a)
    expected = np.full(len(labels), -1)
    count = 0
    for start in range(len(labels)):
        if expected[start] >= 0:
            continue
        front = [start]
        expected[start] = count
        while front:
            for other in near[front.pop()]:
                if expected[other] < 0:
                    expected[other] = count
                    front.append(other)
        count += 1
    component, n_components = components(len(labels), pairs, labels=labels)
    assert n_components == count
    np.testing.assert_array_equal(component, expected)


def test_bad_index_names_the_face():
    """The error says which face, what it holds, and what was expected."""
    with pytest.raises(ValueError, match=r"face 1 is \[0, 1, 3\], expected indices in 0..2"):
        face_pairs(np.array([[0, 1, 2], [0, 1, 3]]), 3)
    with pytest.raises(ValueError, match=r"shape \(2,\), expected \(F, 3\)"):
        face_pairs(np.array([0, 1]), 3)
    with pytest.raises(ValueError, match=r"2 entries, expected one per item \(3\)"):
        components(3, np.zeros((0, 2), np.int32), labels=np.zeros(2, np.int32))


@pytest.mark.parametrize("seed", range(20))
def test_an_order_of_scattered_faces_changes_no_byte(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 40))
    faces = rng.integers(0, count, (int(rng.integers(2, 300)), 3)).astype(np.int32)
    plain = adjacency.face_pairs(faces, count)
    assert adjacency.order_of_scattered(faces, count) is None  # so few are in the cache
    monkeypatch.setattr(adjacency, "_MANY_VERTICES", 0)
    monkeypatch.setattr(adjacency, "_FAR_SHARE", 10**9)
    order = adjacency.order_of_scattered(faces, count)
    assert order is not None
    assert sorted(order.tolist()) == list(range(len(faces)))
    assert (np.diff(faces[order].min(axis=1)) >= 0).all()
    ordered = adjacency.face_pairs(faces, count)
    assert [a.tobytes() for a in plain] == [a.tobytes() for a in ordered]
