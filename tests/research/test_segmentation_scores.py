"""Princeton's measures against values computed by hand, and against their definitions."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from math import hypot, isnan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from terraport_research.segmentation_scores import (
    MeshFacts,
    compare,
    consistency_errors,
    rand_error,
)

PARTITIONS = st.integers(2, 14).flatmap(
    lambda n: st.tuples(
        *(st.lists(st.integers(-2, 4), min_size=n, max_size=n) for _ in range(2)),
        st.lists(st.integers(0, 8).map(float), min_size=n, max_size=n),
    )
)


def literal_rand_error(a, b, weights):
    """Sum over all pairs, as a fraction."""
    wrong = total = Fraction(0)
    for i, j in combinations(range(len(a)), 2):
        pair = Fraction(weights[i]) * Fraction(weights[j])
        total += pair
        if (a[i] == a[j]) != (b[i] == b[j]):
            wrong += pair
    return float(wrong / total) if total else 0.0


def literal_consistency(a, b, area):
    """Refinement errors of every face as shares of area; every face counts alike."""
    if 1 in (len(set(a)), len(set(b))) or len(a) in (len(set(a)), len(set(b))):
        return 0.0, 0.0

    def outside(first, second, i):
        region = [j for j in range(len(first)) if first[j] == first[i]]
        whole = sum(Fraction(area[j]) for j in region)
        common = sum(Fraction(area[j]) for j in region if second[j] == second[i])
        return 1 - common / whole if whole else Fraction(1)

    errors = [(outside(a, b, i), outside(b, a, i)) for i in range(len(a))]
    gce = min(sum(x for x, _ in errors), sum(y for _, y in errors)) / len(a)
    return float(gce), float(sum(min(x, y) for x, y in errors) / len(a))


@settings(max_examples=300)
@given(PARTITIONS)
def test_scores_are_their_definitions(partitions):
    """Weighted and not, against loops over pairs and faces."""
    a, b, weights = (np.array(values) for values in partitions)
    ones = np.ones(len(a))
    assert rand_error(a, b) == literal_rand_error(a, b, ones)
    assert rand_error(a, b, weights) == pytest.approx(literal_rand_error(a, b, weights), abs=1e-12)
    assert consistency_errors(a, b, weights) == pytest.approx(
        literal_consistency(a, b, weights), abs=1e-12
    )


@given(PARTITIONS)
def test_scores_do_not_depend_on_sides_or_names(partitions):
    """Symmetric; other label values change nothing; a partition agrees with itself."""
    a, b, weights = (np.array(values) for values in partitions)
    assert rand_error(a, b) == rand_error(b, a) == rand_error(-7 * a, b + 100)
    assert rand_error(a, a, weights) == 0.0


def test_a_refinement_is_consistent_but_not_equal():
    """GCE and LCE forgive a finer partition, the Rand error does not."""
    coarse, fine = np.array([0, 0, 0, 1, 1, 1]), np.array([0, 1, 1, 2, 3, 3])
    assert consistency_errors(coarse, fine, np.arange(1.0, 7.0)) == (0.0, 0.0)
    assert rand_error(coarse, fine) == 4 / 15


def test_large_counts_stay_whole_numbers():
    """12 M faces: squares of counts beyond 2^47 lose nothing."""
    n = 12_000_000
    a = np.zeros(n, np.int8)
    b = a.copy()
    b[-1] = 1  # n - 1 pairs disagree
    assert rand_error(a, b) == (n - 1) / (n * (n - 1) // 2)


def test_no_faces_and_one_face_agree():
    """Nothing to disagree on."""
    for n in (0, 1):
        labels = np.zeros(n, np.int32)
        assert rand_error(labels, labels) == 0.0
        assert rand_error(labels, labels, np.ones(n)) == 0.0
        assert consistency_errors(labels, labels, np.ones(n)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("a", "b", "weights", "message"),
    [
        (np.zeros(3, int), np.zeros(4, int), None, "two"),
        (np.zeros(3, int), np.zeros(3, int), np.ones(2), "weights"),
        (np.zeros(2, int), np.zeros(2, int), np.array([1.0, -1.0]), "face 1"),
        (np.zeros(2, int), np.zeros(2, int), np.array([np.nan, 1.0]), "face 0"),
    ],
)
def test_wrong_input_is_named(a, b, weights, message):
    """Each message says what came."""
    with pytest.raises(ValueError, match=message):
        rand_error(a, b, weights)


WIDTHS = (1.0, 1.0, 3.0, 3.0)
"""Of four rectangles in a row, one high; two triangles each: areas .5, .5, 1.5, 1.5."""


def strip():
    x = np.concatenate([[0.0], np.cumsum(WIDTHS)])
    lower = np.stack([x, np.zeros(5), np.zeros(5)], axis=1)
    vertices = np.concatenate([lower, lower + np.array([0, 1, 0])])
    i = np.arange(4)
    faces = np.stack([i, i + 1, i + 6, i, i + 6, i + 5], axis=1).reshape(-1, 3).astype(np.int32)
    return MeshFacts.of(vertices, faces)


def of_rectangles(*labels):
    return np.repeat(np.array(labels), 2)


def test_values_by_hand():
    """A is cut after three rectangles (6 | 2 faces, 5 | 3 of area), B after one (2 | 6, 1 | 7)."""
    mesh = strip()
    a, b = (mesh.split(of_rectangles(*labels)) for labels in ((0, 0, 0, 1), (4, 7, 7, 7)))
    scores = compare(mesh, a, b)
    # B's parts have 1 of 1 and 4 of 7 in their best match; A's have 4 of 5 and 3 of 3.
    assert (scores.rm, scores.rf, scores.hd) == pytest.approx((3 / 8, 1 / 8, 2 / 8))
    # Pairs together: A 15 + 1, B 1 + 15, in both 1 + 6 + 1, of 28.
    assert scores.ri == pytest.approx((16 + 16 - 2 * 8) / 28)
    # Cells of 2, 4, 2 faces. Outside B: 4/5, 1/5, 0 of A's area; outside A: 0, 3/7, 4/7 of B's.
    assert scores.gce == pytest.approx((2 * 4 / 5 + 4 * 1 / 5) / 8)
    assert scores.lce == pytest.approx((4 * 1 / 5) / 8)
    # The cuts, two vertices each, lie at 1 and 5: 4 apart along edges, there and back.
    centres = [(x + w * s, y) for x, w in zip((0, 1, 2, 5), WIDTHS, strict=True)
               for s, y in ((2 / 3, 1 / 3), (1 / 3, 2 / 3))]  # fmt: skip
    areas = np.repeat(WIDTHS, 2) / 2
    away = [hypot(x - 4, y - 1 / 2) for x, y in centres]  # the whole is 8 long
    assert scores.cd == pytest.approx(4 / (np.dot(areas, away) / 8))
    assert mesh.radius == pytest.approx(np.dot(areas, away) / 8)


def test_the_other_way_round_only_rm_and_rf_change_places():
    mesh = strip()
    a, b = (mesh.split(of_rectangles(*labels)) for labels in ((0, 0, 0, 1), (0, 1, 1, 1)))
    there, back = compare(mesh, a, b), compare(mesh, b, a)
    assert (there.rm, there.rf) == (back.rf, back.rm)
    assert there[0] == pytest.approx(back[0])
    assert there[4:] == pytest.approx(back[4:])


def test_parts_under_one_number_are_split():
    """Both ends under one number are two segments."""
    mesh = strip()
    ends = mesh.split(of_rectangles(0, 1, 1, 0))
    assert ends.count == 3
    same = compare(mesh, ends, mesh.split(of_rectangles(5, 2, 2, 9)))
    assert same == (0,) * 7


def test_a_side_without_a_cut():
    """One segment: no cut discrepancy, no consistency error, but the rest."""
    mesh = strip()
    one, two = mesh.split(of_rectangles(0, 0, 0, 0)), mesh.split(of_rectangles(0, 1, 1, 1))
    scores = compare(mesh, one, two)
    assert isnan(scores.cd)
    assert (scores.gce, scores.lce) == (0.0, 0.0)
    assert (scores.rm, scores.rf) == pytest.approx((0.0, 1 / 8))
    every = mesh.split(np.arange(8))
    assert compare(mesh, every, two)[5:] == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_the_shortest_along_edges(seed, terrain):
    mesh = terrain(seed, cells=12, holes=0.1)
    facts = MeshFacts.of(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(seed)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    labels = (middle[:, 0] > np.median(middle[:, 0])).astype(int) + 2 * rng.integers(0, 2)
    pieces = facts.split(labels)
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    sides = np.unique(np.sort(sides), axis=0)
    places = mesh.vertices.astype(float)
    length = np.linalg.norm(places[sides[:, 0]] - places[sides[:, 1]], axis=1)
    graph = coo_matrix((length, sides.T), (len(places),) * 2).tocsr()
    expected = dijkstra(graph, directed=False, indices=pieces.cut, min_only=True)
    np.testing.assert_allclose(pieces.distance, expected, rtol=1e-12)


def test_labels_of_another_mesh():
    with pytest.raises(ValueError, match=r"\(3,\), expected \(8,\)"):
        strip().split(np.zeros(3, int))
