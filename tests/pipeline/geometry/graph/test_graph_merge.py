"""The graph engine's merging against a slow, literal one written in plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.graph.border_weights import border_weights
from terraport_pipeline.geometry.graph.face_graph import face_graph
from terraport_pipeline.geometry.graph.graph_merge import merge_faces
from terraport_pipeline.geometry.graph.graph_options import EdgeWeights
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs

# --- the literal reference: dictionaries and exact integers --------------------------------------

MASK = 2**64 - 1


def scrambled(a, b):
    """Finaliser of splitmix64 on the two names, lower first."""
    x = (min(a, b) << 32) | max(a, b)
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & MASK
    return x ^ (x >> 31)


class ReferenceGraph:
    """Units by name (their lowest face), with area and the weight of every border."""

    def __init__(self, area, borders):
        self.area = dict(area)
        self.border = {u: {} for u in area}
        for (u, v), weight in borders.items():
            self.border[u][v] = self.border[v][u] = weight

    def order(self, u, v):
        """What the order of merges sorts by."""
        p, q = sum(self.border[u].values()), sum(self.border[v].values())
        a, b = self.area[u], self.area[v]
        d = (p + q - 2 * self.border[u][v]) / (a + b) - (p / a + q / b)
        return (d, scrambled(u, v))

    def edges(self):
        return [(u, v) for u in self.border for v in self.border[u] if u < v]

    def unite(self, u, v):
        """The union keeps the lower name."""
        u, v = min(u, v), max(u, v)
        self.area[u] += self.area.pop(v)
        for other, weight in self.border.pop(v).items():
            del self.border[other][v]
            if other != u:
                self.border[u][other] = self.border[u].get(other, 0) + weight
                self.border[other][u] = self.border[u][other]


def reference_heap(area, borders):
    """One merge after the other, the first of all in the order."""
    graph, merges = ReferenceGraph(area, borders), []
    while graph.edges():
        u, v = min(graph.edges(), key=lambda edge: graph.order(*edge))
        merges.append((u, v, graph.order(u, v)[0]))
        graph.unite(u, v)
    return merges


def reference_rounds(area, borders, most_faces, faces):
    """All pairs that are each other's first choice, round after round."""
    graph, merges, faces = ReferenceGraph(area, borders), [], dict(faces)
    while True:
        choice = {}
        for u in graph.border:
            allowed = [v for v in graph.border[u] if faces[u] + faces[v] <= most_faces]
            if allowed:
                choice[u] = min(allowed, key=lambda v: graph.order(u, v))
        mutual = sorted((u, v) for u, v in choice.items() if u < v and choice.get(v) == u)
        if not mutual:
            return merges, graph, faces
        units = len(graph.border)
        merges += [(u, v, graph.order(u, v)[0]) for u, v in mutual]
        for u, v in mutual:
            graph.unite(u, v)
            faces[u] += faces.pop(v)
        if len(mutual) * 32 < units:
            return merges, graph, faces


def reference_merges(graph, weights, seed_faces):
    """Levels of rounds, each with borders weighed anew, then the heap."""
    members = {f: [f] for f in range(len(graph.area))}
    lengths = {tuple(p): int(n) for p, n in zip(graph.pairs.tolist(), graph.length, strict=True)}
    faces = dict.fromkeys(members, 1)
    area = {f: int(a) for f, a in enumerate(graph.area)}
    merges = []
    for level in (*seed_faces, None):
        borders = weighed(graph, weights, members, lengths)
        if level is None:
            return merges + reference_heap(area, borders)
        round_merges, merged, faces = reference_rounds(area, borders, level, faces)
        merges += round_merges
        for u, v, _ in round_merges:
            members[u] += members.pop(v)
        area = merged.area
        home = {f: u for u, all_of_it in members.items() for f in all_of_it}
        between = {}
        for (f, g), n in zip(graph.pairs.tolist(), graph.length, strict=True):
            u, v = sorted((home[f], home[g]))
            if u != v:
                between[u, v] = between.get((u, v), 0) + int(n)
        lengths = between
    return merges


def weighed(graph, weights, members, lengths):
    """Borders between units; the weighing itself has its own test (test_face_graph.py)."""
    names = sorted(members)
    number = {name: i for i, name in enumerate(names)}
    facts = type(graph.facts)(
        np.array([len(members[n]) for n in names], np.int32),
        *(
            None
            if rows is None
            else np.array([rows[members[n]].astype(np.int64).sum(axis=0) for n in names])
            for rows in (graph.facts.normal, graph.facts.centre, graph.facts.lab)
        ),
    )
    edges = list(lengths)
    pairs = np.array([[number[u], number[v]] for u, v in edges], np.int32).reshape(-1, 2)
    border, _ = border_weights(pairs, np.array(list(lengths.values()), np.int64), facts, weights)
    return dict(zip(edges, border.tolist(), strict=True))


def merges_of(tree):
    """Names and costs of the tree's merges, as the reference lists them."""
    name = list(range(tree.leaf_count))
    merges = []
    for (a, b), cost in zip(tree.children.tolist(), tree.cost.tolist(), strict=True):
        merges.append((name[a], name[b], cost))
        name.append(min(name[a], name[b]))
    return merges


def assert_like_reference(mesh, weights, seed_faces, *, colour=True):
    graph = face_graph(mesh.vertices, mesh.faces, colours=mesh.colours if colour else None)
    tree = merge_faces(graph, weights, seed_faces).tree
    expected = [
        (u, v, cost * graph.scale) for u, v, cost in reference_merges(graph, weights, seed_faces)
    ]
    assert merges_of(tree) == expected


# --- against it ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(150))
def test_heap_merges_random_soups_in_the_reference_order(soup, seed):
    assert_like_reference(soup(seed), EdgeWeights(), ())


@pytest.mark.parametrize("seed", range(150))
def test_rounds_and_heap_merge_random_soups_in_the_reference_order(soup, seed):
    assert_like_reference(soup(seed), EdgeWeights(), (3, 9))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("seed_faces", [(), (8,)])
def test_terrains_with_holes(terrain, seed, seed_faces):
    assert_like_reference(terrain(seed, 5, holes=0.15), EdgeWeights(), seed_faces)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("seed_faces", [(), (4,)])
def test_ties_on_flat_ground_of_one_colour(terrain, seed, seed_faces):
    mesh = terrain(seed, 5, noise=0.0)
    flat = mesh.vertices * np.array([1, 0, 1], np.float32)
    like = type(mesh)(flat, mesh.faces, np.full_like(mesh.colours, 90))
    assert_like_reference(like, EdgeWeights(), seed_faces)


@pytest.mark.parametrize("seed", range(20))
def test_without_colour(soup, seed):
    assert_like_reference(soup(seed), EdgeWeights(), (4,), colour=False)


def test_flat_ground_does_not_merge_in_chains(terrain):
    mesh = terrain(0, 64, noise=0.0)
    flat = mesh.vertices * np.array([1, 0, 1], np.float32)
    graph = face_graph(flat, mesh.faces)
    merged = merge_faces(graph, EdgeWeights(), (32,))
    assert merged.seed_count < len(mesh.faces) / 8


# --- properties ----------------------------------------------------------------------------------


@pytest.fixture(params=[0, 1, 2, 3])
def merged(request, soup, terrain):
    mesh = soup(request.param) if request.param % 2 else terrain(request.param, 16, holes=0.2)
    graph = face_graph(mesh.vertices, mesh.faces, colours=mesh.colours)
    return mesh, graph, merge_faces(graph, EdgeWeights(), (8,)).tree


def test_roots_are_the_edge_connected_pieces(merged):
    mesh, graph, tree = merged
    labels, count = tree.cut_by_cost(np.inf)
    expected, pieces = components(len(mesh.faces), graph.pairs)
    assert labels.tobytes() == expected.tobytes()
    assert count == pieces == tree.root_count


def test_every_region_of_every_cut_is_edge_connected(merged):
    mesh, graph, tree = merged
    for count in (2, 5, 20):
        labels, regions = tree.cut_by_count(count)
        _, pieces = components(len(mesh.faces), graph.pairs, labels=labels)
        assert pieces == regions


def test_same_bytes_again_and_with_vertices_renumbered(merged):
    mesh, graph, tree = merged
    again = merge_faces(graph, EdgeWeights(), (8,)).tree
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    back = np.argsort(order).astype(np.int32)
    turned = face_graph(mesh.vertices[order], back[mesh.faces], colours=mesh.colours[order])
    other = merge_faces(turned, EdgeWeights(), (8,)).tree
    for name in ("children", "cost", "height", "faces", "area", "parents"):
        assert getattr(tree, name).tobytes() == getattr(again, name).tobytes()
        assert getattr(tree, name).tobytes() == getattr(other, name).tobytes()


def test_cost_is_free_of_scale(terrain):
    mesh = terrain(3)
    small = face_graph(mesh.vertices, mesh.faces)
    large = face_graph(mesh.vertices * np.float32(1024), mesh.faces)
    a, b = (merge_faces(g, EdgeWeights()).tree for g in (small, large))
    assert a.children.tobytes() == b.children.tobytes()
    np.testing.assert_allclose(a.cost, b.cost, rtol=1e-12)


def test_no_faces_and_one_face():
    for n in (0, 1):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
        faces = np.array([[0, 1, 2]], np.int32)[:n]
        graph = face_graph(vertices, faces, pairs=face_pairs(faces, 3)[0])
        tree = merge_faces(graph, EdgeWeights(), (8,)).tree
        labels, count = tree.cut_by_cost(0.0)
        assert (len(labels), count, tree.root_count) == (n, n, n)
