"""What must hold of segments on any mesh, and what a few small ones must look like."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.chunks import CHUNK
from terraport_pipeline.geometry.regions.engine_options import FINE_POOLS, TrianglePoolOptions
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools, triangle_pools_many
from terraport_pipeline.geometry.segments.segments import SegmentOptions, build_segments

REGIONS = TrianglePoolOptions(threshold=0.5, small_threshold=0.03)
BOUNDS = {
    "wide": SegmentOptions(min_faces=20, max_faces=120),
    "tight": SegmentOptions(min_faces=40, max_faces=60),
    "narrow": SegmentOptions(min_faces=10, max_faces=500, max_extent_m=9.0),
    "one": SegmentOptions(min_faces=1, max_faces=1),
    "all": SegmentOptions(min_faces=10_000, max_faces=20_000),
}


def pools_of(mesh):
    """Fine pools, similarity and regions of a mesh."""
    fine = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=FINE_POOLS)
    coarse = triangle_pools(mesh.vertices, mesh.faces, colours=mesh.colours, options=REGIONS)
    return fine.labels, fine.similarity, coarse.labels


def segment(mesh, options):
    """Segments of a mesh with pools and regions by the algorithm."""
    return build_segments(mesh.vertices, mesh.faces, *pools_of(mesh), options)


def check_invariants(mesh, regions, result, options):
    """Everything `segmentation.md` section 3 promises, recomputed from the labels."""
    n_faces = len(mesh.faces)
    labels = result.labels
    assert labels.shape == (n_faces,)
    assert labels.dtype == np.int32
    counts = np.bincount(labels, minlength=result.count)
    assert (counts > 0).all()
    assert len(counts) == result.count
    np.testing.assert_array_equal(counts, result.face_counts)
    # bounds: hold, or the exception is counted
    corners = mesh.vertices[mesh.faces]
    low = np.array([corners[labels == s].min(axis=(0, 1)) for s in range(result.count)])
    high = np.array([corners[labels == s].max(axis=(0, 1)) for s in range(result.count)])
    np.testing.assert_array_equal(result.bounds, np.concatenate([low, high], axis=1))
    wide = (high - low).max(axis=1) > result.max_extent_m
    exceptions = result.exceptions
    assert exceptions.below_min_faces == np.count_nonzero(counts < options.min_faces)
    assert exceptions.above_max_faces == np.count_nonzero(counts > options.max_faces) == 0
    assert exceptions.above_max_extent == np.count_nonzero(wide)
    assert (counts[wide] == 1).all(), "only single faces may be wider than the bound"
    # regions
    share = Counter(zip(labels.tolist(), regions.tolist(), strict=True))
    for s in range(result.count):
        mine = {r: n for (t, r), n in share.items() if t == s}
        assert result.region_counts[s] == len(mine)
        assert result.main_region[s] == min(mine, key=lambda r: (-mine[r], r))
    assert exceptions.across_regions == np.count_nonzero(result.region_counts > 1)
    # a segment crosses a region border only for pieces below min_faces: at most one piece is not
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    both = labels.astype(np.int64) * (int(regions.max()) + 1) + regions
    dense = np.unique(both, return_inverse=True)[1].astype(np.int32)
    piece, n_pieces = components(n_faces, pairs, labels=dense)
    size = np.bincount(piece, minlength=n_pieces)
    for s in range(result.count):
        if result.region_counts[s] > 1:
            in_segment = np.unique(piece[labels == s])
            assert np.count_nonzero(size[in_segment] >= options.min_faces) <= 1
    # connected, except for debris that touches nothing
    component, n_components = components(n_faces, pairs, labels=labels)
    whole, n_wholes = components(n_faces, pairs)
    whole_size = np.bincount(whole, minlength=n_wholes)
    part_size = np.bincount(component, minlength=n_components)
    first = np.array([np.flatnonzero(component == p)[0] for p in range(n_components)])
    parts_of = np.bincount(labels[first], minlength=result.count)
    assert exceptions.disconnected == np.count_nonzero(parts_of > 1)
    for s in np.flatnonzero(parts_of > 1):
        mine = first[labels[first] == s]
        is_debris = (part_size[component[mine]] == whole_size[whole[mine]]) & (
            whole_size[whole[mine]] < options.min_faces
        )
        assert np.count_nonzero(~is_debris) <= 1


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("seed", range(12))
def test_invariants_on_terrains(terrain, name, seed):
    """Whole and torn terrains, calm and noisy colours."""
    mesh = terrain(seed, cells=16, noise=10.0 * (seed % 3), holes=0.15 * (seed % 4))
    fine, similarity, regions = pools_of(mesh)
    result = build_segments(mesh.vertices, mesh.faces, fine, similarity, regions, BOUNDS[name])
    check_invariants(mesh, regions, result, BOUNDS[name])


@pytest.mark.parametrize("seed", range(40))
def test_invariants_on_soups_with_any_labels(soup, seed):
    """Pools and regions need not be connected, nor agree with each other."""
    mesh = soup(seed)
    rng = np.random.default_rng(seed)
    fine = rng.integers(0, 5, len(mesh.faces)).astype(np.int32)
    regions = rng.integers(0, 3, len(mesh.faces)).astype(np.int32)
    similarity = rng.random(len(mesh.faces)).astype(np.float32)
    options = SegmentOptions(min_faces=6, max_faces=15, max_extent_m=(None, 9.0)[seed % 2])
    result = build_segments(mesh.vertices, mesh.faces, fine, similarity, regions, options)
    check_invariants(mesh, regions, result, options)


@pytest.mark.parametrize("seed", range(8))
def test_whole_terrain_has_no_exceptions(terrain, seed):
    """On a connected mesh with room between the bounds nothing is too small or too big."""
    mesh = terrain(seed, cells=40, noise=15.0)
    result = segment(mesh, SegmentOptions(min_faces=50, max_faces=500))
    exceptions = result.exceptions
    assert (
        exceptions.below_min_faces,
        exceptions.above_max_faces,
        exceptions.above_max_extent,
    ) == (0, 0, 0)
    assert (exceptions.across_regions, exceptions.disconnected, exceptions.debris_alone) == (
        0,
        0,
        0,
    )
    assert result.count <= len(mesh.faces) // 50


@pytest.mark.parametrize("seed", range(6))
def test_vertex_numbering_changes_nothing(terrain, seed):
    """Shuffled vertices give the same bytes, and so does a second run."""
    mesh = terrain(seed, cells=20, holes=0.1)
    fine, similarity, regions = pools_of(mesh)
    order = np.random.default_rng(seed).permutation(len(mesh.vertices))
    shuffled = np.argsort(order)[mesh.faces]
    options = SegmentOptions(min_faces=20, max_faces=100)
    first = build_segments(mesh.vertices, mesh.faces, fine, similarity, regions, options)
    again = build_segments(mesh.vertices, mesh.faces, fine, similarity, regions, options)
    second = build_segments(mesh.vertices[order], shuffled, fine, similarity, regions, options)
    assert first.labels.tobytes() == again.labels.tobytes() == second.labels.tobytes()
    assert first.bounds.tobytes() == second.bounds.tobytes()


def test_threads_and_reruns_change_no_byte(terrain):
    """Adjacency, regions, fine pools and segments of more faces than one piece of work holds."""
    mesh = terrain(3, cells=400, noise=12.0, holes=0.02)
    assert len(mesh.faces) > CHUNK
    outputs = set()
    for threads in (1, 2, 2):
        pairs = face_pairs(mesh.faces, len(mesh.vertices), threads=threads)
        coarse, fine = triangle_pools_many(
            mesh.vertices, mesh.faces, (REGIONS, FINE_POOLS), colours=mesh.colours, threads=threads
        )
        segments = build_segments(
            mesh.vertices, mesh.faces, fine.labels, fine.similarity, coarse.labels,
            SegmentOptions(min_faces=500, max_faces=5000), pairs=pairs, threads=threads,
        )  # fmt: skip
        arrays = (*pairs, coarse.labels, fine.labels, fine.similarity, segments.labels)
        outputs.add(b"".join(a.tobytes() for a in (*arrays, segments.bounds, segments.main_region)))
    assert len(outputs) == 1


@pytest.mark.parametrize("seed", range(6))
def test_moving_changes_nothing(terrain, seed):
    """Moved by whole metres (exact in float32): the same partition and numbers."""
    mesh = terrain(seed, cells=20, holes=0.1)
    pools = pools_of(mesh)
    options = SegmentOptions(min_faces=20, max_faces=100)
    moved = mesh.vertices + np.array([512, -64, 1024], np.float32)
    first = build_segments(mesh.vertices, mesh.faces, *pools, options)
    second = build_segments(moved, mesh.faces, *pools, options)
    assert first.labels.tobytes() == second.labels.tobytes()


def strip(n):
    """A flat strip of n squares along x, two faces each."""
    x = np.repeat(np.arange(n + 1.0), 2)
    z = np.tile([0.0, 1.0], n + 1)
    vertices = np.stack([x, 0 * x, z], axis=1).astype(np.float32)
    a = 2 * np.arange(n)
    return vertices, np.stack([a, a + 1, a + 2, a + 2, a + 1, a + 3], axis=1).reshape(-1, 3)


def test_small_pools_join_the_most_similar_neighbour():
    """A strip of three pools: the small middle one goes to the side it is more alike."""
    vertices, faces = strip(10)
    pools = np.repeat([0, 1, 2], [8, 4, 8]).astype(np.int32)
    for middle, expected in ((0.2, [0] * 12 + [1] * 8), (0.8, [0] * 8 + [1] * 12)):
        similarity = np.repeat([0.0, middle, 1.0], [8, 4, 8]).astype(np.float32)
        result = build_segments(
            vertices, faces, pools, similarity, np.zeros(20, np.int32),
            SegmentOptions(min_faces=6, max_faces=20, max_extent_m=100.0),
        )  # fmt: skip
        assert result.labels.tolist() == expected


def test_regions_are_borders_unless_a_piece_is_too_small():
    """Alike or not, a large piece keeps to its region; a small one may cross."""
    vertices, faces = strip(10)
    same = np.zeros(20, np.float32)
    pools = np.zeros(20, np.int32)
    options = SegmentOptions(min_faces=6, max_faces=20, max_extent_m=100.0)
    halves = np.repeat([0, 1], 10).astype(np.int32)
    result = build_segments(vertices, faces, pools, same, halves, options)
    assert result.labels.tolist() == halves.tolist()
    tail = np.repeat([0, 1], [16, 4]).astype(np.int32)
    result = build_segments(vertices, faces, pools, same, tail, options)
    assert (result.count, result.exceptions.across_regions) == (1, 1)
    assert result.main_region.tolist() == [0]


def test_a_large_pool_is_cut_into_equal_compact_pieces():
    """One pool of 200 faces in at most 50 each: five pieces of forty along the strip."""
    vertices, faces = strip(100)
    zeros = np.zeros(200, np.int32)
    options = SegmentOptions(min_faces=10, max_faces=50, max_extent_m=1000.0)
    result = build_segments(vertices, faces, zeros, zeros.astype(np.float32), zeros, options)
    assert result.face_counts.tolist() == [40] * 5
    assert (np.diff(result.labels) >= 0).all()  # numbered along the curve, here along the strip


def test_wide_segments_are_cut():
    """The longest side of every box keeps the bound."""
    vertices, faces = strip(100)
    zeros = np.zeros(200, np.int32)
    options = SegmentOptions(min_faces=2, max_faces=1000, max_extent_m=30.0)
    result = build_segments(vertices, faces, zeros, zeros.astype(np.float32), zeros, options)
    assert result.count == 4
    assert ((result.bounds[:, 3:] - result.bounds[:, :3]).max(axis=1) <= 30.0).all()


def test_debris_joins_the_nearest_segment_within_reach():
    """Of three loose triangles one lies close to the strip, two far off beside each other."""
    vertices, faces = strip(20)
    loose = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0, 0.5]], np.float32)
    offsets = np.array([[5, 2, 0], [5, 80, 0], [6, 80, 0]], np.float32)
    extra = (loose[None] + offsets[:, None]).reshape(-1, 3)
    vertices = np.concatenate([vertices, extra])
    faces = np.concatenate([faces, 42 + np.arange(9).reshape(3, 3)])
    zeros = np.zeros(43, np.int32)
    options = SegmentOptions(min_faces=8, max_faces=43, max_extent_m=40.0)
    result = build_segments(vertices, faces, zeros, zeros.astype(np.float32), zeros, options)
    assert result.count == 2
    assert result.labels[40] == result.labels[0]
    assert result.labels[41] == result.labels[42] != result.labels[0]
    exceptions = result.exceptions
    assert (exceptions.debris_joined, exceptions.debris_alone, exceptions.below_min_faces) == (
        3,
        0,
        1,
    )
    assert exceptions.disconnected == 2


def test_scattered_debris_does_not_make_a_segment_each(terrain):
    """A thousand loose triangles around a terrain end in few segments."""
    mesh = terrain(1, cells=20)
    rng = np.random.default_rng(1)
    centres = rng.uniform([0, 2, 0], [32, 6, 32], (1000, 3))
    corners = centres[:, None] + rng.normal(0, 0.1, (1000, 3, 3))
    vertices = np.concatenate([mesh.vertices, corners.reshape(-1, 3).astype(np.float32)])
    faces = np.concatenate([mesh.faces, len(mesh.vertices) + np.arange(3000).reshape(-1, 3)])
    zeros = np.zeros(len(faces), np.int32)
    options = SegmentOptions(min_faces=100, max_faces=400)
    result = build_segments(vertices, faces, zeros, zeros.astype(np.float32), zeros, options)
    assert result.count < 40
    assert result.exceptions.debris_joined + result.exceptions.debris_alone == 1000


def test_pools_as_segments(terrain):
    """The literal thesis behaviour: the partition is the pools', exceptions are counted."""
    mesh = terrain(4, cells=16)
    fine, similarity, regions = pools_of(mesh)
    options = SegmentOptions(min_faces=10, max_faces=100, units="pools")
    result = build_segments(mesh.vertices, mesh.faces, fine, similarity, regions, options)
    assert result.count == fine.max() + 1
    assert len(set(zip(fine.tolist(), result.labels.tolist(), strict=True))) == result.count
    sizes = np.bincount(fine)
    assert result.exceptions.below_min_faces == np.count_nonzero(sizes < 10) > 0
    assert result.exceptions.above_max_faces == np.count_nonzero(sizes > 100)


def test_degenerate_meshes():
    """No faces; one face; every vertex in one place."""
    none = np.zeros(0, np.int32)
    result = build_segments(
        np.zeros((3, 3)), none.reshape(0, 3), none, none.astype(np.float32), none
    )
    assert (result.count, result.bounds.shape, result.labels.shape) == (0, (0, 6), (0,))
    zeros = np.zeros(1, np.int32)
    single = build_segments(
        np.eye(3), np.array([[0, 1, 2]]), zeros, zeros.astype(np.float32), zeros
    )
    assert (single.count, single.exceptions.below_min_faces, single.exceptions.debris_alone) == (
        1,
        1,
        1,
    )
    zeros = np.zeros(30, np.int32)
    point = build_segments(
        np.zeros((3, 3)), np.tile([0, 1, 2], (30, 1)), zeros, zeros.astype(np.float32), zeros,
        SegmentOptions(min_faces=1, max_faces=10),
    )  # fmt: skip
    assert point.face_counts.max() <= 10


def test_bad_input_is_named():
    """What was received, what was expected."""
    with pytest.raises(ValueError, match=r"min_faces is 30, expected 1..max_faces \(20\)"):
        SegmentOptions(min_faces=30, max_faces=20)
    with pytest.raises(ValueError, match=r"max_extent_m is -1.0, expected a finite length"):
        SegmentOptions(max_extent_m=-1.0)
    with pytest.raises(ValueError, match=r"units is 'tiles', expected 'segments' or 'pools'"):
        SegmentOptions(units="tiles")
    zeros = np.zeros(2, np.int32)
    with pytest.raises(ValueError, match=r"pools_fine has shape \(2,\), expected \(1,\)"):
        build_segments(np.eye(3), np.array([[0, 1, 2]]), zeros, zeros, zeros)
    zeros = np.zeros(1, np.int32)
    with pytest.raises(ValueError, match=r"least region -1, least pool 0, expected 0 or more"):
        build_segments(np.eye(3), np.array([[0, 1, 2]]), zeros, zeros, zeros - 1)
    with pytest.raises(ValueError, match=r"vertex 1 is \[0.0, nan, 0.0\]"):
        build_segments(np.diag([1, np.nan, 1]), np.array([[0, 1, 2]]), zeros, zeros, zeros)
