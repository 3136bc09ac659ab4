"""The choice of segments against a brute-force model written with plain loops."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_payload import box_distances_m
from terraport_payload.types import Bool, Float32
from terraport_server.session.id_set import IdSet
from terraport_server.session.interface import SegmentTable
from terraport_server.session.planner import (
    Budgets,
    find_candidates,
    select,
)


def make_table(
    boxes: list[tuple[float, ...]], lengths: list[int], faces: list[int]
) -> SegmentTable:
    count = len(boxes)
    return SegmentTable(
        bounds=np.array(boxes, dtype=np.float32).reshape(count, 6),
        lengths=np.array(lengths, dtype=np.uint32),
        hashes=np.arange(count, dtype=np.uint64),
        faces=np.array(faces, dtype=np.uint32),
        vertices=np.array(faces, dtype=np.uint32),
        texture_bytes=np.arange(count, dtype=np.uint64) % 3 * 84,
    )


def row_of_boxes(count: int) -> SegmentTable:
    """Unit boxes at x = 0, 10, 20, ...; 100 bytes and 10 faces each."""
    boxes = [(10.0 * i, 0.0, 0.0, 10.0 * i + 1.0, 1.0, 1.0) for i in range(count)]
    return make_table(boxes, [100] * count, [10] * count)


def mask(count: int, ids: set[int]) -> Bool:
    out = np.zeros(count, dtype=np.bool_)
    out[list(ids)] = True
    out.setflags(write=False)
    return out


def brute_distance(box: Float32, centre: tuple[float, ...]) -> float:
    total = 0.0
    for axis in range(3):
        low, high, at = float(box[axis]), float(box[axis + 3]), centre[axis]
        gap = low - at if at < low else at - high if at > high else 0.0
        total += gap * gap
    return math.sqrt(total)


def gpu_size(table: SegmentTable, segment: int, budgets: Budgets) -> int:
    """Return what a segment takes on the client's GPU, by the wording of the specification."""
    vertices, face_bytes = int(table.vertices[segment]), budgets.gpu_face_bytes
    if vertices > 65534:
        face_bytes = max(face_bytes, 12)
    return (
        vertices * budgets.gpu_vertex_bytes
        + int(table.faces[segment]) * face_bytes
        + int(table.texture_bytes[segment])
    )


def brute_plan(
    table: SegmentTable,
    centre: tuple[float, float, float],
    radius_m: float,
    release_radius_m: float,
    resident: set[int],
    budgets: Budgets,
) -> tuple[list[int], list[int], int]:
    """Return what is to be shown, nearest first, what is kept nearby, and how many are left out."""
    by_distance = []
    for segment in range(len(table)):
        distance = brute_distance(table.bounds[segment], centre)
        if distance <= radius_m or (segment in resident and distance <= release_radius_m):
            by_distance.append((distance, segment))
    by_distance.sort()
    fitting: list[int] = []
    triangles = size = gpu = 0
    for _, segment in by_distance:
        gpu += gpu_size(table, segment, budgets)
        if budgets.max_gpu_bytes is not None and gpu > budgets.max_gpu_bytes:
            break
        triangles += int(table.faces[segment])
        size += int(table.lengths[segment])
        if budgets.max_triangles is not None and triangles > budgets.max_triangles:
            break
        if budgets.max_bytes is not None and size > budgets.max_bytes:
            break
        if budgets.max_segments is not None and len(fitting) + 1 > budgets.max_segments:
            break
        fitting.append(segment)
    within = [segment for distance, segment in by_distance if distance <= radius_m]
    plan = [segment for segment in fitting if segment in within]
    nearby = sorted(segment for segment in fitting if segment not in within)
    return plan, nearby, len(within) - len(plan)


def brute_first_exceeded(
    table: SegmentTable, plan: list[int], following: int, budgets: Budgets
) -> str | None:
    segments = [*plan, following]
    for name, limit, used in (
        ("max_segments", budgets.max_segments, len(segments)),
        ("max_triangles", budgets.max_triangles, sum(int(table.faces[s]) for s in segments)),
        ("max_bytes", budgets.max_bytes, sum(int(table.lengths[s]) for s in segments)),
        (
            "max_gpu_bytes",
            budgets.max_gpu_bytes,
            sum(gpu_size(table, s, budgets) for s in segments),
        ),
    ):
        if limit is not None and used > limit:
            return name
    return None


# Halves make equal distances, and so ties, common.
coordinate = st.integers(-40, 40).map(lambda v: v / 2)
box = st.tuples(
    coordinate, coordinate, coordinate, st.integers(0, 8), st.integers(0, 8), st.integers(0, 8)
).map(lambda b: (*b[:3], b[0] + b[3], b[1] + b[4], b[2] + b[5]))
limit = st.none() | st.integers(0, 400)


@st.composite
def scenes(draw: st.DrawFn) -> SegmentTable:
    boxes = draw(st.lists(box, min_size=1, max_size=25))
    sizes = st.lists(st.integers(1, 100), min_size=len(boxes), max_size=len(boxes))
    return make_table(boxes, draw(sizes), draw(sizes))


@settings(max_examples=250)
@given(
    data=st.data(),
    table=scenes(),
    centre=st.tuples(coordinate, coordinate, coordinate),
    radius_m=st.integers(0, 60).map(lambda v: v / 2),
    factor=st.sampled_from([1.0, 1.25, 2.0, 4.0]),
    nudge=st.sampled_from([0.0, 1e-9, -1e-9, 1e-12]),
    budgets=st.builds(
        Budgets, limit, limit, limit | st.integers(0, 6), st.none() | st.integers(0, 20_000)
    ),
)
def test_plan_equals_brute_force(
    data: st.DataObject,
    table: SegmentTable,
    centre: tuple[float, float, float],
    radius_m: float,
    factor: float,
    nudge: float,
    budgets: Budgets,
) -> None:
    """From every candidate, shuffled, and from those that are near or held."""
    held_ids = data.draw(st.sets(st.integers(0, len(table) - 1)), "held")
    # Centres a hair off, and radii that end just at the border of a box.
    centre = (centre[0] + nudge, centre[1], centre[2] - nudge)
    distances = box_distances_m(table.bounds, centre)
    if data.draw(st.booleans(), "to the border"):
        radius_m = float(data.draw(st.sampled_from(distances.tolist()))) / factor
    plan, nearby, omitted = brute_plan(
        table, centre, radius_m, radius_m * factor, held_ids, budgets
    )

    held = IdSet(sorted(held_ids))
    near = np.flatnonzero(distances <= radius_m)
    few, is_held = find_candidates(table, near, held, centre, radius_m * factor)
    everything = np.array(data.draw(st.permutations(range(len(table)))), dtype=np.int64)
    chosen, from_all = (
        select(
            table,
            candidates,
            centre,
            radius_m,
            release_radius_m=radius_m * factor,
            inner_radius_m=radius_m / 2,
            held=among,
            budgets=budgets,
        )
        for candidates, among in ((few, is_held), (everything, held.contains(everything)))
    )
    for name in ("load", "keep", "nearby", "order", "inner"):
        assert getattr(chosen, name).tolist() == getattr(from_all, name).tolist(), name
    in_half = [s for s in plan if brute_distance(table.bounds[s], centre) <= radius_m / 2]
    assert chosen.inner.tolist() == in_half
    assert chosen.order.tolist() == plan

    assert chosen.load.tolist() == [s for s in plan if s not in held_ids]
    assert chosen.keep.tolist() == sorted(s for s in plan if s in held_ids)
    assert chosen.nearby.tolist() == nearby
    assert chosen.omitted_segments == omitted
    assert (chosen.omitted_by is None) == (omitted == 0)
    if omitted:
        everything = brute_plan(table, centre, radius_m, radius_m * factor, held_ids, Budgets())[0]
        nearest = everything[len(plan)]
        assert chosen.omitted_by == brute_first_exceeded(table, plan, nearest, budgets)
    assert chosen.total_bytes == sum(int(table.lengths[s]) for s in plan)
    assert chosen.total_triangles == sum(int(table.faces[s]) for s in plan)
    assert chosen.load_bytes == sum(int(table.lengths[s]) for s in plan if s not in held_ids)
    # What is nearby counts for the budgets too.
    for limit_value, used in (
        (budgets.max_triangles, sum(int(table.faces[s]) for s in [*plan, *nearby])),
        (budgets.max_bytes, sum(int(table.lengths[s]) for s in [*plan, *nearby])),
        (budgets.max_segments, len(plan) + len(nearby)),
        (budgets.max_gpu_bytes, chosen.total_gpu_bytes or 0),
    ):
        assert limit_value is None or used <= limit_value
    if budgets.max_gpu_bytes is not None:
        on_gpu = sum(gpu_size(table, s, budgets) for s in [*plan, *nearby])
        assert chosen.total_gpu_bytes == on_gpu
    # The radius within which nothing is missing.
    outside = [
        brute_distance(table.bounds[s], centre) for s in range(len(table)) if s not in set(plan)
    ]
    assert chosen.effective_radius_m == min([radius_m, *outside])


def test_the_radius_is_inclusive() -> None:
    table, held = row_of_boxes(3), mask(3, set())
    for radius_m, load in ((10.0, [0, 1]), (float(np.nextafter(10.0, 0.0)), [0])):
        chosen = select(
            table,
            np.arange(3),
            (0.0, 0.0, 0.0),
            radius_m,
            release_radius_m=radius_m,
            inner_radius_m=None,
            held=held,
        )
        assert chosen.load.tolist() == load


@settings(max_examples=200)
@given(
    scene=scenes(),
    radius_m=st.floats(0, 40),
    further_m=st.floats(0, 40),
    held=st.sets(st.integers(0, 200)),
    most=st.none() | st.integers(0, 12),
)
def test_each_segment_is_planned_at_the_level_of_its_distance(
    scene: SegmentTable, radius_m: float, further_m: float, held: set[int], most: int | None
) -> None:
    """By loops: full within the radius, coarser in the ring, what is held a little further kept."""
    count, coarse_m, centre = len(scene), radius_m + further_m, (0.0, 0.0, 0.0)
    table = SegmentTable(
        bounds=np.concatenate([scene.bounds] * 2),
        lengths=np.concatenate([scene.lengths, scene.lengths // 3]),
        hashes=np.arange(2 * count, dtype=np.uint64),
        faces=np.concatenate([scene.faces, scene.faces // 5]),
        vertices=np.concatenate([scene.vertices] * 2),
        texture_bytes=np.concatenate([scene.texture_bytes] * 2),
        levels=2,
    )
    held_rows = {row for row in held if row < 2 * count}
    chosen = select(
        table,
        np.arange(2 * count),
        centre,
        radius_m,
        release_radius_m=radius_m * 1.25,
        inner_radius_m=None,
        held=mask(2 * count, held_rows),
        budgets=Budgets(max_segments=most),
        coarse=(coarse_m, coarse_m * 1.25),
    )
    shown, kept = [], []
    for segment in range(count):
        distance = float(box_distances_m(scene.bounds[segment : segment + 1], centre)[0])
        if distance <= coarse_m:
            shown.append((distance, segment + count * (distance > radius_m)))
        if segment in held_rows and radius_m < distance <= radius_m * 1.25:
            kept.append((distance, segment))
        if segment + count in held_rows and coarse_m < distance <= coarse_m * 1.25:
            kept.append((distance, segment + count))
    order = [row for _, row in sorted(shown)]
    wanted = (order + [row for _, row in sorted(kept)])[:most]
    assert chosen.order.tolist() == wanted[: len(order)]
    assert chosen.nearby.tolist() == sorted(wanted[len(order) :])
    assert chosen.load.tolist() == [row for row in wanted[: len(order)] if row not in held_rows]
    assert chosen.omitted_segments == max(0, len(order) - len(wanted))
    if len(wanted) >= len(order):
        assert chosen.effective_radius_m == coarse_m
    assert len({row % count for row in chosen.order.tolist()}) == len(chosen.order)


some_ids = st.lists(st.sampled_from([0, 1, 2, 5, 4000, 2**32 - 1]), max_size=8)
id_changes = st.tuples(
    st.sampled_from(["add", "discard", "update", "difference_update", "many"]), some_ids
)


@settings(max_examples=150)
@given(first=some_ids, script=st.lists(id_changes, max_size=12), queried=some_ids)
def test_an_id_set_equals_a_python_set(
    first: list[int], script: list[tuple[str, list[int]]], queried: list[int]
) -> None:
    ours, model = IdSet(first), set(first)
    for name, ids in script:
        if name in {"add", "discard"}:
            for segment in ids:
                getattr(ours, name)(segment)
                getattr(model, name)(segment)
        elif name == "many":  # more than it keeps unsorted
            for segment in range(1500):
                ours.add(segment)
            model.update(range(1500))
        else:
            getattr(ours, name)(np.array(ids, dtype=np.uint32))
            getattr(model, name)(ids)
        assert len(ours) == len(model)
    assert [segment in ours for segment in queried] == [segment in model for segment in queried]
    contained = ours.contains(np.array(queried, dtype=np.int64)).tolist()
    assert contained == [segment in model for segment in queried]
    assert ours.array().tolist() == sorted(model)
