"""The Triangle Pool Algorithm against a slow, literal one written in plain loops."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh import adjacency
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.colour import white_distance
from terraport_pipeline.geometry.regions.engine_options import (
    FINE_POOLS,
    REGION_POOLS,
    TrianglePoolOptions,
)
from terraport_pipeline.geometry.regions.triangle_pool import (
    chain_count,
    face_similarity,
    triangle_pools,
    triangle_pools_many,
)

# --- the literal reference: thesis section 3.5, one paragraph after another ---------------------


def reference_similarity(mesh, options, index):
    """Equations (3.2) and (3.3); `index` is l, one value per face."""
    low, high = min(index), max(index)
    if options.normalise == "minmax":
        scale = options.attribute_range / (high - low) if high > low else 0.0
        index = [(value - low) * scale for value in index]
    elif options.normalise == "max":
        largest = max(abs(low), abs(high))
        index = [value * options.attribute_range / largest if largest else 0.0 for value in index]
    centres = reference_centres(mesh)
    if options.origin == "first":
        start = centres[0]
    elif options.origin == "centroid":
        start = [math.fsum(c[axis] for c in centres) / len(centres) for axis in range(3)]
    else:
        start = [min(c[axis] for c in centres) for axis in range(3)]
    distance = [math.dist(start, centre) for centre in centres]
    largest = max(distance)
    return [
        options.mu * value + options.tau * (d / largest if largest else 0.0)
        for value, d in zip(index, distance, strict=True)
    ]


def reference_centres(mesh):
    """Mean of the corners."""
    return [
        [sum(float(mesh.vertices[v][axis]) for v in face) / 3 for axis in range(3)]
        for face in mesh.faces.tolist()
    ]


def reference_k(similarity, threshold):
    """Steps 1 to 4 below equation (3.4), removing faces from consideration as it says."""
    remaining = sorted(similarity)
    k = 0
    while remaining:
        first = remaining[0]
        n = 0
        while n < len(remaining) and not remaining[n] - first > threshold:
            n += 1
        remaining = remaining[n:]
        k += 1
    return k


def reference_level2(similarity, k):
    """Optimal 1-D k-means: all distinct values, all last borders, leftmost of equals."""
    values = sorted(set(similarity))
    weight = [similarity.count(value) for value in values]
    m, k = len(values), min(k, len(values))

    def cost(i, j):
        n = sum(weight[i:j])
        mean = math.fsum(w * v for w, v in zip(weight[i:j], values[i:j], strict=True)) / n
        return math.fsum(w * (v - mean) ** 2 for w, v in zip(weight[i:j], values[i:j], strict=True))

    costs = {(i, j): cost(i, j) for i in range(m) for j in range(i + 1, m + 1)}
    margin = 1e-12 * costs[0, m]
    best = {(1, j): (costs[0, j], 0) for j in range(1, m + 1)}
    for c in range(2, k + 1):
        for j in range(c, m + 1):
            chosen = None
            for i in range(c - 1, j):
                total = best[c - 1, i][0] + costs[i, j]
                if chosen is None or total < chosen[0] - margin:
                    chosen = (total, i)
            best[c, j] = chosen
    cluster = {}
    j = m
    for c in range(k, 0, -1):
        i = best[c, j][1]
        for position in range(i, j):
            cluster[values[position]] = c - 1
        j = i
    return [cluster[s] for s in similarity]


def reference_neighbours(mesh, contiguity):
    """The lookup table of contiguous faces."""
    faces = mesh.faces.tolist()
    needed = 2 if contiguity == "edge" else 1
    near = [set() for _ in faces]
    for a in range(len(faces)):
        for b in range(a + 1, len(faces)):
            if len(set(faces[a]) & set(faces[b])) >= needed:
                near[a].add(b)
                near[b].add(a)
    return near


def reference_level3(level2, near):
    """Greedy search from seeds (section 3.5.5.2), seeds in face order."""
    pool = [-1] * len(level2)
    count = 0
    for seed in range(len(level2)):
        if pool[seed] >= 0:
            continue
        pool[seed] = count
        stack = [seed]
        while stack:
            face = stack.pop()
            for other in near[face]:
                if pool[other] < 0 and level2[other] == level2[face]:
                    pool[other] = count
                    stack.append(other)
        count += 1
    return pool


def reference_refine(mesh, pool, near, similarity, options):
    """Section 3.5.5.3 with the rounds and tie rules that triangle_pool.py states."""
    n_faces = len(pool)

    def sizes_and_means():
        members = {}
        for face, p in enumerate(pool):
            members.setdefault(p, []).append(face)
        return (
            {p: len(f) for p, f in members.items()},
            {p: sum(similarity[i] for i in f) / len(f) for p, f in members.items()},
        )

    def touching():
        contacts = {p: set() for p in pool}
        for face in range(n_faces):
            for other in near[face]:
                if pool[face] != pool[other]:
                    contacts[pool[face]].add(pool[other])
        return contacts

    def renumber(mapping):
        names = {}
        return [names.setdefault(mapping[p], len(names)) for p in pool]

    # Rounds: small pools join large ones; small ones among themselves unite and go again.
    while True:
        size, mean = sizes_and_means()
        contacts = touching()
        settled = {p: p for p in size if not size[p] / n_faces < options.small_threshold}
        while True:  # small pools join the large pools they touch, round after round
            joins = {}
            for p in size:
                large = {settled[q] for q in contacts[p] if q in settled}
                if p not in settled and large:
                    joins[p] = min(large, key=lambda t: (abs(mean[t] - mean[p]), -size[t], t))
            if not joins:
                break
            settled.update(joins)
        # Pools that touch no large one unite with the most similar of their kind.
        loose = [p for p in size if p not in settled]
        choice = {}
        for p in loose:
            others = [q for q in contacts[p] if q in loose]
            if others:
                choice[p] = min(others, key=lambda q: (abs(mean[q] - mean[p]), -size[q], q))
        if not choice:
            break
        union = {p: p for p in size}
        for p, q in choice.items():
            a, b = union[p], union[q]
            for r, name in union.items():
                if name == max(a, b):
                    union[r] = min(a, b)
        pool = renumber(union)
    # Islands are left: small pools that touch nothing; the option says what becomes of them.
    pool = [settled.get(p, p) for p in pool]
    lost = set(loose)
    kept = [f for f in range(n_faces) if pool[f] not in lost]
    if options.islands == "nearest" and kept and lost:
        centres = reference_centres(mesh)
        moves = {}
        for p in lost:
            _, _, target = min(
                (sum((x - y) ** 2 for x, y in zip(centres[f], centres[g], strict=True)), f, g)
                for f in range(n_faces)
                if pool[f] == p
                for g in kept
            )
            moves[p] = pool[target]
        pool = [moves.get(p, p) for p in pool]
    names = {}
    return [names.setdefault(p, len(names)) for p in pool]


def reference_pools(mesh, similarity, options):
    """The whole algorithm on given s: labels, k, number of level 3 pools."""
    similarity = [float(s) for s in similarity]
    k = reference_k(similarity, options.threshold)
    near = reference_neighbours(mesh, options.contiguity)
    level3 = reference_level3(reference_level2(similarity, k), near)
    labels = level3
    if options.small_threshold > 0:
        labels = reference_refine(mesh, level3, near, similarity, options)
    return labels, k, max(level3) + 1


# --- tests --------------------------------------------------------------------------------------

OPTIONS = {
    "regions": REGION_POOLS,
    "fine": FINE_POOLS,
    "coarse": TrianglePoolOptions(threshold=0.3, small_threshold=0.1),
    "all small": TrianglePoolOptions(threshold=0.15, small_threshold=0.4, origin="first"),
    "stay": TrianglePoolOptions(threshold=0.2, small_threshold=0.15, islands="stay", tau=0.0),
    "vertex": TrianglePoolOptions(threshold=0.25, small_threshold=0.12, contiguity="vertex"),
    "centroid": TrianglePoolOptions(
        threshold=0.1, small_threshold=0.08, origin="centroid", tau=0.5
    ),
}


@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("seed", range(40))
def test_pools_of_soups_equal_the_reference(soup, name, seed):
    """Identical labels, k and level 3 count on random faces with every kind of degeneracy."""
    mesh = soup(seed)
    result = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=OPTIONS[name])
    expected = reference_pools(mesh, result.similarity, OPTIONS[name])
    assert (result.labels.tolist(), result.k, result.level3_count) == expected
    assert result.count == max(expected[0]) + 1


GRID = [
    TrianglePoolOptions(
        threshold=threshold, small_threshold=small, tau=tau, attribute_range=2.0,
        normalise=normalise, origin=origin, contiguity=contiguity, islands=islands,
    )
    for normalise in ("minmax", "max", "raw")
    for origin in ("min_corner", "first", "centroid")
    for contiguity in ("edge", "vertex")
    for islands in ("nearest", "stay")
    for threshold, small, tau in ((0.35, 0.12, 0.2),)
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(GRID)))
def test_every_combination_of_options_equals_the_reference(soup, terrain, number):
    """Index, pools, k and level 3 count, from colours and from scalars, on soups and torn grids."""
    options = GRID[number]
    for seed in range(4):
        rng = np.random.default_rng(100 * number + seed)
        mesh = soup(1000 * number + seed) if seed < 3 else terrain(number, cells=5, holes=0.3)
        # raw colour runs to 100: chain it at a scale where pools form
        scale = 30.0 if options.normalise == "raw" else 1.0
        scalar = rng.choice([-2.0, -0.5, 0.0, 0.25, 1.0], len(mesh.faces))
        for source in ({"colours": mesh.colours}, {"scalar": scalar}):
            mine = replace(options, threshold=options.threshold * (scale if seed % 2 else 1.0))
            result = triangle_pools(mesh.vertices, mesh.faces, options=mine, **source)
            expected = reference_pools(mesh, result.similarity, mine)
            assert (result.labels.tolist(), result.k, result.level3_count) == expected
            index = scalar if "scalar" in source else reference_index(mesh)
            formula = reference_similarity(mesh, mine, list(index))
            np.testing.assert_allclose(
                result.similarity, np.array(formula, np.float32), rtol=3e-7, atol=2e-6
            )


def reference_index(mesh):
    """Equation (3.1), colour by colour."""
    means = [mesh.colours[face].astype(np.float64).sum(axis=0) / 3 for face in mesh.faces]
    return [float(white_distance(mean[None])[0]) for mean in means]


@pytest.mark.parametrize("seed", range(30))
def test_one_colour_equals_the_reference(soup, seed):
    """Every face alike: k is 1 and pools are the connected pieces, before and after refining."""
    mesh = soup(seed)
    grey = np.full(mesh.colours.shape, 90 + seed, np.uint8)
    for name, options in OPTIONS.items():
        result = triangle_pools(
            mesh.vertices, mesh.faces, colours=grey, options=replace(options, tau=0.0)
        )
        expected = reference_pools(mesh, result.similarity, options)
        assert (result.labels.tolist(), result.k, result.level3_count) == expected, name
        assert result.k == 1


@pytest.mark.parametrize("seed", range(30))
def test_fans_and_isolated_faces_equal_the_reference(seed):
    """Many faces on one edge, repeated faces, and faces that touch nothing."""
    rng = np.random.default_rng(seed)
    fan = [[0, 1, 2 + i] for i in range(int(rng.integers(3, 20)))]
    n = 2 + len(fan)
    loose = [[n + 3 * i, n + 3 * i + 1, n + 3 * i + 2] for i in range(int(rng.integers(1, 8)))]
    faces = np.array(fan + loose + fan[:3] + loose[:1], np.int32)
    faces = faces[rng.permutation(len(faces))]
    vertices = 3.0 * rng.integers(0, 8, (n + 3 * len(loose), 3))
    mesh = SimpleNamespace(vertices=vertices, faces=faces)
    values = rng.choice([0.0, 0.5, 1.0], len(faces))
    for options in OPTIONS.values():
        result = triangle_pools(vertices, faces, scalar=values, options=options)
        expected = reference_pools(mesh, result.similarity, options)
        assert (result.labels.tolist(), result.k, result.level3_count) == expected


@pytest.mark.parametrize("seed", range(6))
def test_many_at_once_and_threads_change_no_byte(terrain, seed):
    """Each of many results is what it is alone."""
    mesh = terrain(seed, cells=14, holes=0.2)
    sets = list(OPTIONS.values())
    for threads in (1, 2):
        many = triangle_pools_many(
            mesh.vertices, mesh.faces, sets, colours=mesh.colours, threads=threads
        )
        for options, pools in zip(sets, many, strict=True):
            alone = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=options)
            assert pools.labels.tobytes() == alone.labels.tobytes()
            assert pools.similarity.tobytes() == alone.similarity.tobytes()
            assert (pools.k, pools.level3_count, pools.count, pools.islands) == (
                alone.k, alone.level3_count, alone.count, alone.islands,
            )  # fmt: skip
    assert many[0].similarity is many[1].similarity


@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("seed", range(12))
def test_pools_of_torn_terrains_equal_the_reference(terrain, name, seed):
    """The same on coloured grids with holes, which fall into islands."""
    mesh = terrain(seed, cells=6, size_m=18.0, holes=0.35)
    result = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=OPTIONS[name])
    expected = reference_pools(mesh, result.similarity, OPTIONS[name])
    assert (result.labels.tolist(), result.k, result.level3_count) == expected


@pytest.mark.parametrize("small", [0.04, 0.08, 0.3])
@pytest.mark.parametrize("seed", range(40))
def test_equal_means_equal_the_reference(terrain, seed, small):
    """Whole-number values without separation: nearly every join is a tie in mean, many in size."""
    mesh = terrain(seed, cells=5, size_m=15.0, holes=0.1 * (seed % 4))
    values = np.random.default_rng(seed).choice([0.0, 1.0, 2.0], len(mesh.faces), p=[0.4, 0.2, 0.4])
    options = TrianglePoolOptions(threshold=0.3, small_threshold=small, tau=0.0)
    result = triangle_pools(mesh.vertices, mesh.faces, scalar=values, options=options)
    expected = reference_pools(mesh, result.similarity, options)
    assert (result.labels.tolist(), result.k, result.level3_count) == expected


@pytest.mark.parametrize("normalise", ["minmax", "max", "raw"])
@pytest.mark.parametrize("origin", ["min_corner", "first", "centroid"])
def test_similarity_equals_the_formula(terrain, normalise, origin):
    """Equation (3.3), with every scale and every origin."""
    mesh = terrain(5)
    values = np.random.default_rng(5).normal(3.0, 2.0, len(mesh.faces))
    options = TrianglePoolOptions(
        normalise=normalise, origin=origin, mu=0.7, tau=0.3, attribute_range=2.0
    )
    similarity = face_similarity(mesh.vertices, mesh.faces, scalar=values, options=options)
    expected = reference_similarity(mesh, options, values.tolist())
    np.testing.assert_allclose(similarity, np.array(expected, np.float32), rtol=2e-7, atol=1e-7)


def test_chaining_at_equality_stays_in_the_bin():
    """The text says greater than Th."""
    assert chain_count(np.array([0, 1, 2, 3], np.float32), 1.0) == 2
    assert chain_count(np.array([0, 1, 2, 3], np.float32), 0.999) == 4
    assert chain_count(np.zeros(0, np.float32), 1.0) == 0


def test_two_fields_and_a_speck():
    """A dark and a light field; a single light face inside the dark one is refined away."""
    axis = np.arange(11.0)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    i, j = np.divmod(np.arange(100), 10)
    a = i * 11 + j
    faces = np.stack([a, a + 1, a + 11, a + 11, a + 1, a + 12], axis=1).reshape(-1, 3)
    light = np.repeat(i >= 5, 2)
    scalar = light.astype(float)
    scalar[44] = 1.0
    result = triangle_pools(vertices, faces, scalar=scalar)
    assert (result.k, result.level3_count, result.count) == (2, 3, 2)
    np.testing.assert_array_equal(result.labels, light)


@pytest.mark.parametrize("seed", range(10))
def test_vertex_numbering_changes_nothing(terrain, seed):
    """Shuffled vertices give the same bytes."""
    mesh = terrain(seed, holes=0.2)
    order = np.random.default_rng(seed).permutation(len(mesh.vertices))
    number = np.argsort(order)
    for options in OPTIONS.values():
        first = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=options)
        second = triangle_pools(
            mesh.vertices[order], number[mesh.faces], colours=mesh.colours[order], options=options
        )
        assert first.labels.tobytes() == second.labels.tobytes()
        assert first.similarity.tobytes() == second.similarity.tobytes()


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("origin", ["first", "centroid"])
def test_rigid_motion_changes_nothing(terrain, origin, seed):
    """Turned and moved: the same pools (for origins that turn with the mesh)."""
    mesh = terrain(seed, holes=0.2)
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = mesh.vertices.astype(np.float64) @ turn.T + rng.normal(0, 50, 3)
    options = TrianglePoolOptions(threshold=0.2, small_threshold=0.02, origin=origin)
    first = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=options)
    second = triangle_pools(moved, mesh.faces, colours=mesh.colours, options=options)
    np.testing.assert_array_equal(first.labels, second.labels)


def test_moving_keeps_the_default_origin(terrain):
    """The least corner moves with the mesh: a shift by whole metres changes no byte."""
    mesh = terrain(2)
    first = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours)
    second = triangle_pools(mesh.vertices + np.float32(256), mesh.faces, colours=mesh.colours)
    assert first.labels.tobytes() == second.labels.tobytes()


def test_given_pairs_and_repeated_runs_give_the_same_bytes(terrain):
    """Precomputed neighbours are only a saving."""
    mesh = terrain(7, holes=0.1)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    first = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours)
    second = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, pairs=pairs)
    assert first.labels.tobytes() == second.labels.tobytes()


def test_degenerate_meshes():
    """No faces, one face, faces of no area, one colour everywhere."""
    grey = np.full((4, 3), 128, np.uint8)
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], np.float32)
    none = triangle_pools(square, np.zeros((0, 3), np.int32), colours=grey)
    assert (none.labels.shape, none.k, none.count) == ((0,), 0, 0)
    single = triangle_pools(square, np.array([[0, 1, 2]]), colours=grey)
    assert (single.labels.tolist(), single.k, single.count) == ([0], 1, 1)
    flat = triangle_pools(
        np.zeros((4, 3)), np.array([[0, 1, 2], [2, 1, 3], [3, 3, 3]]), colours=grey
    )
    assert flat.similarity.tolist() == [0.0, 0.0, 0.0]
    assert flat.labels.tolist() == [0, 0, 1]
    same = triangle_pools(square, np.array([[0, 1, 2], [2, 1, 3]]), colours=grey)
    assert same.labels.tolist() == [0, 0]


def test_bad_input_is_named():
    """What was received, what was expected."""
    square, face = np.zeros((3, 3)), np.array([[0, 1, 2]])
    with pytest.raises(ValueError, match=r"received neither of colours and scalar"):
        triangle_pools(square, face)
    with pytest.raises(ValueError, match=r"scalar of face 0 is nan, expected a finite number"):
        triangle_pools(square, face, scalar=np.array([np.nan]))
    with pytest.raises(ValueError, match=r"vertex 2 is \[inf, 0.0, 0.0\]"):
        triangle_pools(np.array([[0, 0, 0], [0, 0, 0], [np.inf, 0, 0]]), face, scalar=np.zeros(1))
    with pytest.raises(ValueError, match=r"face indices 0..2, expected 0..1"):
        triangle_pools(square[:2], face, scalar=np.zeros(1))
    with pytest.raises(ValueError, match=r"colours are float64 \(3, 3\), expected uint8 \(3, 3\)"):
        triangle_pools(square, face, colours=np.zeros((3, 3)))
    with pytest.raises(ValueError, match=r"scalar has shape \(2,\), expected \(1,\)"):
        triangle_pools(square, face, scalar=np.zeros(2))
    with pytest.raises(ValueError, match=r"threshold is 0\.0, expected a finite number"):
        TrianglePoolOptions(threshold=0.0)
    with pytest.raises(ValueError, match=r"small_threshold is 2\.0"):
        TrianglePoolOptions(small_threshold=2.0)
    with pytest.raises(ValueError, match=r"origin is 'last', expected one of min_corner"):
        TrianglePoolOptions(origin="last")


@pytest.mark.parametrize("options", [REGION_POOLS, FINE_POOLS])
def test_scattered_faces_give_the_same_bytes_in_whatever_order_they_are_worked_on(
    options: TrianglePoolOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    side = 40
    x, z = np.meshgrid(np.arange(side, dtype=np.float32), np.arange(side, dtype=np.float32))
    vertices = np.stack([x.ravel(), np.sin(x).ravel(), z.ravel()], axis=1)
    at = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    faces = rng.permutation(faces.astype(np.int32))
    level = np.where(np.hypot(x - 15, z - 20) < 9, 60, 170).ravel()[:, None]
    colours = np.clip(level + rng.normal(0, 40, (side * side, 3)), 0, 255).astype(np.uint8)
    plain = triangle_pools(vertices, faces, colours=colours, options=options)
    monkeypatch.setattr(adjacency, "_MANY_VERTICES", 0)
    assert adjacency.order_of_scattered(faces, len(vertices)) is not None
    ordered = triangle_pools(vertices, faces, colours=colours, options=options)
    assert plain.count > 1
    assert plain.labels.tobytes() == ordered.labels.tobytes()
    assert plain.similarity.tobytes() == ordered.similarity.tobytes()
    assert plain.islands == ordered.islands
