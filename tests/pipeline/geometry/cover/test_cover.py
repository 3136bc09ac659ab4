"""The cover rule by brute-force rays: no hole for any subset of loaded segments."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.cover.cover import build_cover


def height(x, z, seed):
    """A smooth hill."""
    phase = np.random.default_rng(seed).uniform(0, 6.28, 3)
    return 2 * np.sin(0.25 * x + phase[0]) + 1.5 * np.cos(0.3 * z + phase[1]) + 0.05 * x


def grid_mesh(n, size, lift):
    """Grid of n x n cells over size x size metres with heights lift(x, z), and its own plan."""
    axis = np.linspace(0, size, n + 1)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x.ravel(), lift(x, z).ravel(), z.ravel()], axis=1)
    i, j = np.divmod(np.arange(n * n), n)
    a = i * (n + 1) + j
    b = a + n + 1
    return vertices, np.stack([a, a + 1, b, b, a + 1, b + 1], axis=1).reshape(-1, 3)


def two_resolutions(seed, *, per_face):
    """Base and detail of one hill; the detail has rocks, a pit, plants, an overhang and holes."""
    rng = np.random.default_rng(seed)
    size = 20.0
    rocks = rng.uniform(0, size, (3, 2))

    def detailed(x, z):
        y = height(x, z, seed) + 0.1 * np.sin(5 * x) * np.cos(4 * z)
        for rx, rz in rocks:  # bumps of 2.5 m that the base smooths away
            y = y + 2.5 * np.exp(-(((x - rx) ** 2 + (z - rz) ** 2) / 0.5))
        return y - 3.0 * ((x > 12) & (x < 14) & (z > 5) & (z < 9))  # a pit with vertical walls

    base_v, base_f = grid_mesh(7, size, lambda x, z: height(x, z, seed))
    detail_v, detail_f = grid_mesh(34, size, detailed)
    shear = detail_v[:, 2] > 15  # the far side leans over: heights are no function of (x, z) there
    detail_v[shear, 0] += 1.5 * np.maximum(detail_v[shear, 1], 0)
    detail_f = detail_f[rng.random(len(detail_f)) >= 0.04]
    plants = rng.uniform([0, 3, 0], [size, 6, size], (25, 3))
    leaves = plants[:, None] + rng.normal(0, 0.25, (25, 3, 3))
    n = len(detail_v)
    detail_v = np.concatenate([detail_v, leaves.reshape(-1, 3)])
    detail_f = np.concatenate([detail_f, n + np.arange(75).reshape(-1, 3)])
    if per_face:
        segment = rng.permutation(len(detail_f))
    else:
        centre = detail_v[detail_f].mean(axis=1)
        segment = (centre[:, 0] // 4 * 5 + centre[:, 2] // 4).astype(int)
        segment = np.unique(segment, return_inverse=True)[1]
    return (base_v, base_f), (detail_v, detail_f), segment.astype(np.int32)


def hidden_faces(cover, loaded):
    """The run-time rule: hidden iff the list is not empty and all of it is loaded."""
    lists = np.split(cover.segments, cover.offsets[1:-1])
    return np.array([len(segments) > 0 and bool(loaded[segments].all()) for segments in lists])


def vertical_rays(seed, count):
    """Rays from far above, straight down."""
    rng = np.random.default_rng(seed)
    origins = np.stack(
        [rng.uniform(0, 20, count), np.full(count, 99.0), rng.uniform(0, 20, count)], 1
    )
    return origins, np.tile([0.0, -1.0, 0.0], (count, 1))


def count_holes(meets_base, meets_detail, segment, cover, seed, subsets=25):
    """Rays that met full detail and a base face, and meet neither loaded detail nor shown base."""
    rng = np.random.default_rng(seed)
    probed = meets_detail.any(axis=1) & meets_base.any(axis=1)
    holes = 0
    for share in rng.uniform(0.05, 0.98, subsets):
        loaded = rng.random(segment.max() + 1) < share
        shown = ~hidden_faces(cover, loaded)
        solid = (meets_detail[:, loaded[segment]]).any(axis=1) | meets_base[:, shown].any(axis=1)
        holes += np.count_nonzero(probed & ~solid)
    return holes


@pytest.mark.parametrize("per_face", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_no_hole_on_vertical_lines(rays, seed, per_face):
    """Proven in the docstring; here on rocks, plants, overhangs, even segments of one face."""
    base, detail, segment = two_resolutions(seed, per_face=per_face)
    cover = build_cover(*base, *detail, segment, tolerance_m=0.15, hide_partly_covered=True)
    origins, directions = vertical_rays(seed, 300)
    meets_base = rays(*base, origins, directions)
    meets_detail = rays(*detail, origins, directions)
    assert count_holes(meets_base, meets_detail, segment, cover, seed) == 0


def test_a_shorter_list_makes_holes(rays):
    """The ray test can fail: with one segment struck from each list it finds holes."""
    base, detail, segment = two_resolutions(0, per_face=False)
    cover = build_cover(*base, *detail, segment, tolerance_m=0.15, hide_partly_covered=True)
    origins, directions = vertical_rays(0, 300)
    meets = rays(*base, origins, directions), rays(*detail, origins, directions)
    rows = np.repeat(np.arange(len(base[1])), np.diff(cover.offsets.astype(int)))
    keep = np.ones(len(rows), bool)
    keep[cover.offsets[:-1][np.diff(cover.offsets.astype(int)) > 1]] = False

    class Shorter:
        offsets = np.searchsorted(rows[keep], np.arange(len(base[1]) + 1)).astype(np.uint32)
        segments = cover.segments[keep]

    assert count_holes(*meets, segment, Shorter, 0) > 0


@pytest.mark.parametrize("seed", range(4))
def test_no_hole_on_slanting_rays(rays, seed):
    """No proof, but none found from 8 degrees of elevation up, on ground without holes in it."""
    rng = np.random.default_rng(seed)
    size, tolerance = 20.0, 0.12
    base = grid_mesh(8, size, lambda x, z: height(x, z, seed))
    detail = grid_mesh(
        32, size, lambda x, z: height(x, z, seed) + 0.1 * np.sin(5 * x) * np.cos(4 * z)
    )
    centre = detail[0][detail[1]].mean(axis=1)
    segment = (centre[:, 0] // 2.6 * 8 + centre[:, 2] // 2.6).astype(np.int32)
    segment = np.unique(segment, return_inverse=True)[1]
    cover = build_cover(*base, *detail, segment, tolerance_m=tolerance)
    count = 400
    target = detail[0][rng.integers(0, len(detail[0]), count)]
    target = target * [0.7, 1, 0.7] + [3, 0, 3]
    target[:, 1] = height(target[:, 0], target[:, 2], seed)
    turn, rise = rng.uniform(0, 6.28, count), np.radians(rng.uniform(8, 80, count))
    towards = np.stack([np.cos(turn) * np.cos(rise), -np.sin(rise), np.sin(turn) * np.cos(rise)], 1)
    origins = target - 30 * towards
    meets = rays(*base, origins, towards), rays(*detail, origins, towards)
    assert meets[1].any(axis=1).mean() > 0.9
    assert count_holes(*meets, segment, cover, seed, subsets=60) == 0


@pytest.mark.parametrize(("tolerances", "listed"), [(3.0, True), (3.9, True), (6.5, False)])
def test_a_base_face_waits_for_detail_within_four_tolerances(tolerances, listed):
    """On a steep face the base beside the detail, along its normal, is what stands in for it."""
    tolerance = 0.3
    base_v, base_f = grid_mesh(2, 20.0, lambda x, z: 0 * x)
    detail_v, detail_f = grid_mesh(200, 20.0, lambda x, z: 0 * x)
    first_x = detail_v[detail_f][:, :, 0].min(axis=1)
    segment = (first_x > 10.0 + tolerances * tolerance - 0.05).astype(int)
    cover = build_cover(base_v, base_f, detail_v, detail_f, segment, tolerance_m=tolerance)
    left = np.flatnonzero(base_v[base_f][:, :, 0].max(axis=1) <= 10.0)
    lists = np.split(cover.segments, cover.offsets[1:-1])
    assert {(1 in lists[face]) for face in left} == {listed}


def test_recess_is_listed_by_the_face_that_bridges_it():
    """Detail set back 3 m into a wall: the base wall before it waits for the recess (rule 2)."""
    y, z = np.meshgrid(np.linspace(0, 12, 13), np.linspace(0, 12, 13), indexing="ij")
    deep = (y > 3) & (y < 9) & (z > 3) & (z < 9)
    i, j = np.divmod(np.arange(144), 12)
    a = i * 13 + j
    faces = np.stack([a, a + 13, a + 1, a + 1, a + 13, a + 14], axis=1).reshape(-1, 3)
    detail = np.stack([np.where(deep, 3.0, 0.0).ravel(), y.ravel(), z.ravel()], axis=1)
    segment = deep.ravel()[faces].all(axis=1).astype(np.int32)
    corners = np.array([[0, 0, 0], [0, 0, 12], [0, 12, 0], [0, 12, 12]], float)
    cover = build_cover(
        corners, np.array([[0, 2, 1], [1, 2, 3]]), detail, faces, segment, tolerance_m=0.1
    )
    assert cover.segments.reshape(2, 2).tolist() == [[0, 1], [0, 1]]
    assert cover.far_detail_faces > 0


def test_lists_are_short():
    """Flat on flat with aligned tiles: a face lists what lies within its reach, nothing beyond."""
    base_v, base_f = grid_mesh(10, 40.0, lambda x, z: 0 * x)
    detail_v, detail_f = grid_mesh(80, 40.0, lambda x, z: 0 * x)
    centre = detail_v[detail_f].mean(axis=1)
    tile = (centre[:, 0] // 10).astype(int) * 4 + (centre[:, 2] // 10).astype(int)
    cover = build_cover(base_v, base_f, detail_v, detail_f, tile, tolerance_m=0.2)
    margin = cover.reach_m + 2 * cover.cell_m
    for f, members in enumerate(np.split(cover.segments, cover.offsets[1:-1])):
        low, high = base_v[base_f[f]].min(axis=0)[::2], base_v[base_f[f]].max(axis=0)[::2]
        for s in members.tolist():
            corner = np.array(divmod(s, 4)) * 10.0
            gap = np.maximum(np.maximum(corner - high, low - corner - 10.0), 0)
            assert gap.max() <= margin
    assert cover.uncovered_faces == 0


def test_base_beyond_the_detail_is_never_hidden():
    """Rule 3: a base face that reaches past the detail's rim stays, so that no slit opens."""
    base_v, base_f = grid_mesh(5, 20.0, lambda x, z: 0 * x)
    detail_v, detail_f = grid_mesh(40, 10.0, lambda x, z: 0 * x)
    segment = np.zeros(len(detail_f), np.int32)
    cover = build_cover(base_v, base_f, detail_v, detail_f, segment, tolerance_m=0.05)
    hidden = hidden_faces(cover, np.array([True]))
    far_corner = base_v[base_f].max(axis=1)
    inside = (far_corner[:, ::2] <= 10.0).all(axis=1)
    beyond = base_v[base_f].min(axis=1)[:, ::2].max(axis=1) >= 12.0
    assert hidden[inside].all()
    assert not hidden[~inside].any()
    assert cover.partly_covered_faces > 0
    assert cover.uncovered_faces >= np.count_nonzero(beyond)
    lax = build_cover(
        base_v, base_f, detail_v, detail_f, segment, tolerance_m=0.05, hide_partly_covered=True
    )
    assert np.count_nonzero(hidden_faces(lax, np.array([True]))) > np.count_nonzero(hidden)


def test_storeys_apart_with_a_gap():
    """Ground over a tunnel: everything in the column by default, the near storey with a gap."""
    base_v, base_f = grid_mesh(4, 20.0, lambda x, z: 0 * x)
    ground_v, ground_f = grid_mesh(40, 20.0, lambda x, z: 0 * x)
    tunnel_v, tunnel_f = grid_mesh(40, 20.0, lambda x, z: 0 * x - 30)
    detail_v = np.concatenate([ground_v, tunnel_v])
    detail_f = np.concatenate([ground_f, tunnel_f + len(ground_v)])
    segment = np.repeat([0, 1], len(ground_f))
    arrays = (base_v, base_f, detail_v, detail_f, segment)
    whole = build_cover(*arrays, tolerance_m=0.1)
    assert (np.diff(whole.offsets.astype(int)) == 2).all()
    near = build_cover(*arrays, tolerance_m=0.1, max_gap_m=5.0)
    lists = np.split(near.segments, near.offsets[1:-1])
    # the tunnel is far from any base: rule 2 lists it nowhere, its distance being beyond all reach
    assert {tuple(segments.tolist()) for segments in lists} == {(0,)}


def test_deterministic_and_free_of_vertex_order():
    """Shuffled detail vertices and a second run give the same bytes; inputs stay as they were."""
    base, detail, segment = two_resolutions(2, per_face=False)
    order = np.random.default_rng(0).permutation(len(detail[0]))
    for array in (*base, *detail, segment):
        array.flags.writeable = False
    first = build_cover(*base, *detail, segment, tolerance_m=0.15)
    second = build_cover(
        *base, detail[0][order], np.argsort(order)[detail[1]], segment, tolerance_m=0.15
    )
    assert first.offsets.tobytes() == second.offsets.tobytes()
    assert first.segments.tobytes() == second.segments.tobytes()
    assert first.offsets.dtype == first.segments.dtype == np.uint32


def test_empty_and_degenerate_meshes():
    """No base, no detail, faces of no area."""
    none = np.zeros((0, 3), np.int32)
    square, face = np.eye(3), np.array([[0, 1, 2]])
    cover = build_cover(square, none, square, face, np.zeros(1, int), tolerance_m=0.1)
    assert (cover.offsets.tolist(), len(cover.segments), cover.baseless_detail_faces) == ([0], 0, 1)
    cover = build_cover(square, face, square, none, np.zeros(0, int), tolerance_m=0.1)
    assert (cover.offsets.tolist(), cover.uncovered_faces) == ([0, 0], 1)
    point = np.zeros((3, 3))
    cover = build_cover(point, face, point, face, np.zeros(1, int), tolerance_m=0.1)
    assert cover.segments.tolist() == [0]


def test_threads_change_no_byte():
    """Several pieces of base and detail faces, far detail among them."""
    base_v, base_f = grid_mesh(190, 60.0, lambda x, z: height(x, z, 1))
    detail_v, detail_f = grid_mesh(
        380, 60.0, lambda x, z: height(x, z, 1) + 3.0 * ((x > 20) & (x < 22))
    )
    assert len(base_f) > 2**16
    assert len(detail_f) > 2**18
    segment = np.arange(len(detail_f)) // 5000
    one_thread, two_threads = (
        build_cover(base_v, base_f, detail_v, detail_f, segment, tolerance_m=0.3, threads=threads)
        for threads in (1, 2)
    )
    assert one_thread.far_detail_faces == two_threads.far_detail_faces > 0
    assert one_thread.offsets.tobytes() == two_threads.offsets.tobytes()
    assert one_thread.segments.tobytes() == two_threads.segments.tobytes()


def test_long_lists_are_ascending():
    """Two base faces over eight hundred segments: every one once, in order."""
    base_v, base_f = grid_mesh(1, 20.0, lambda x, z: 0 * x)
    detail_v, detail_f = grid_mesh(20, 20.0, lambda x, z: 0 * x)
    segment = np.random.default_rng(0).permutation(len(detail_f))
    cover = build_cover(base_v, base_f, detail_v, detail_f, segment, tolerance_m=0.1)
    for face in range(2):
        mine = cover.segments[cover.offsets[face] : cover.offsets[face + 1]]
        assert len(mine) > 400
        assert (np.diff(mine.astype(np.int64)) > 0).all()
    assert set(cover.segments.tolist()) == set(range(len(detail_f)))


def test_bad_input_is_named():
    """What was received, what was expected."""
    square, face, zero = np.eye(3), np.array([[0, 1, 2]]), np.zeros(1, int)
    with pytest.raises(ValueError, match=r"tolerance_m is 0.0, expected a finite length above 0"):
        build_cover(square, face, square, face, zero, tolerance_m=0.0)
    with pytest.raises(ValueError, match=r"detail: face indices 0..2, expected 0..1"):
        build_cover(square, face, square[:2], face, zero, tolerance_m=0.1)
    with pytest.raises(ValueError, match=r"segment_of_face has shape \(2,\), expected \(1,\)"):
        build_cover(square, face, square, face, np.zeros(2, int), tolerance_m=0.1)
    with pytest.raises(ValueError, match=r"base: some vertices are not finite"):
        build_cover(square * np.nan, face, square, face, zero, tolerance_m=0.1)
    with pytest.raises(ValueError, match=r"least segment number is -1"):
        build_cover(square, face, square, face, zero - 1, tolerance_m=0.1)
