"""The choice of segments against a brute-force model written with plain loops."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_payload import Cover, box_distances_m
from terraport_payload.hidden import HiddenFaces
from terraport_payload.types import Float32
from terraport_server.session.interface import SceneView, SegmentTable
from terraport_server.session.plan import Budgets, choose

Box = tuple[float, ...]


def scene_of(table: SegmentTable) -> SceneView:
    bounds = table.bounds[: table.segment_count]

    def within(centre: Any, radius_m: float) -> Any:
        return np.flatnonzero(box_distances_m(bounds, centre) <= radius_m)

    cover = Cover(np.zeros(1, np.uint32), np.zeros(0, np.uint32))  # a base of no face
    hidden = HiddenFaces(cover, table.segment_count)
    return SceneView(id="s", version="v", name="S", table=table, within=within, hidden_faces=hidden)


def make_table(boxes: list[Box], sizes: list[int], *, levels: int = 1) -> SegmentTable:
    """Return a table of which bytes, faces and vertices differ by row, also over the levels."""
    count = len(boxes)
    rows = np.arange(count * levels)
    size = np.array(sizes, np.uint32)[rows % count]
    return SegmentTable(
        bounds=np.array(boxes, np.float32).reshape(count, 6)[rows % count],
        lengths=size + rows.astype(np.uint32),
        hashes=(rows + 1000).astype(np.uint64),
        faces=size // (1 + rows // count).astype(np.uint32),
        vertices=size * 1000,
        texture_bytes=rows.astype(np.uint64) % 3 * 84,
        levels=levels,
    )


def brute_distance_m(box: Float32, centre: Box) -> float:
    total = 0.0
    for axis in range(3):
        low, high, at = float(box[axis]), float(box[axis + 3]), centre[axis]
        gap = low - at if at < low else at - high if at > high else 0.0
        total += gap * gap
    return math.sqrt(total)


def exceeded(table: SegmentTable, rows: list[int], budgets: Budgets) -> str | None:
    """Return the first budget that some rows exceed, by the wording of the specification."""
    gpu_bytes = 0
    for row in rows:
        face_bytes = budgets.gpu_face_bytes
        if table.vertices[row] > 65534:
            face_bytes = max(face_bytes, 12)
        gpu_bytes += int(table.vertices[row]) * budgets.gpu_vertex_bytes
        gpu_bytes += int(table.faces[row]) * face_bytes + int(table.texture_bytes[row])
    for name, used in (
        ("max_segments", len(rows)),
        ("max_triangles", sum(int(table.faces[row]) for row in rows)),
        ("max_bytes", sum(int(table.lengths[row]) for row in rows)),
        ("max_gpu_bytes", gpu_bytes),
    ):
        limit = getattr(budgets, name)
        if limit is not None and used > limit:
            return name
    return None


# Halves make equal distances, and so ties, common.
coordinate = st.integers(-40, 40).map(lambda value: value / 2)
side = st.integers(0, 8)
box = st.tuples(coordinate, coordinate, coordinate, side, side, side).map(
    lambda b: (*b[:3], b[0] + b[3], b[1] + b[4], b[2] + b[5])
)
limit = st.none() | st.integers(0, 400)


@st.composite
def tables(draw: st.DrawFn) -> SegmentTable:
    boxes = draw(st.lists(box, min_size=1, max_size=25))
    sizes = st.lists(st.integers(1, 100), min_size=len(boxes), max_size=len(boxes))
    return make_table(boxes, draw(sizes), levels=draw(st.sampled_from([1, 2])))


@settings(max_examples=300)
@given(
    data=st.data(),
    table=tables(),
    centre=st.tuples(coordinate, coordinate, coordinate),
    nudge=st.sampled_from([0.0, 1e-9, -1e-9, 1e-12]),
    radius_m=st.integers(0, 60).map(lambda value: value / 2),
    further_m=st.none() | st.integers(0, 30).map(lambda value: value / 2),
    budgets=st.builds(
        Budgets,
        limit,
        limit,
        limit | st.integers(0, 6),
        st.none() | st.integers(0, 20_000_000),
        st.sampled_from([24, 60]),
        st.sampled_from([6, 20]),
    ),
)
def test_a_choice_equals_brute_force(
    data: st.DataObject,
    table: SegmentTable,
    centre: tuple[float, float, float],
    nudge: float,
    radius_m: float,
    further_m: float | None,
    budgets: Budgets,
) -> None:
    count, scene = table.segment_count, scene_of(table)
    # Centres a hair off, and radii that end just at the border of a box.
    centre = (centre[0] + nudge, centre[1], centre[2] - nudge)
    distances = [brute_distance_m(table.bounds[segment], centre) for segment in range(count)]
    if data.draw(st.booleans(), "to the border"):
        radius_m = data.draw(st.sampled_from(distances))
    coarse_radius_m = None if further_m is None else radius_m + further_m
    without = data.draw(st.sets(st.integers(0, len(table) - 1), max_size=4), "without")

    outer_m = radius_m if coarse_radius_m is None or table.levels == 1 else coarse_radius_m
    wanted = [
        (distance, segment + count * (distance > radius_m))
        for distance, segment in sorted(zip(distances, range(count), strict=True))
        if distance <= outer_m
    ]
    left_out = {row for _, row in wanted if row in without}
    wanted = [(distance, row) for distance, row in wanted if row not in without]
    shown = 0
    while shown < len(wanted) and not exceeded(
        table, [row for _, row in wanted[: shown + 1]], budgets
    ):
        shown += 1

    ball = choose(
        scene,
        centre,
        radius_m,
        coarse_radius_m=coarse_radius_m,
        without=table.hashes[sorted(without)],
        budgets=budgets,
    )
    assert ball.rows.tolist() == [row for _, row in wanted[:shown]]
    assert ball.distances_m.tolist() == [distance for distance, _ in wanted[:shown]]
    assert set(ball.left_out.tolist()) == left_out
    assert ball.omitted == len(wanted) - shown
    if ball.omitted:
        assert ball.effective_radius_m == wanted[shown][0]
        first = [row for _, row in wanted[: shown + 1]]
        assert ball.omitted_by == exceeded(table, first, budgets)
    else:
        assert (ball.effective_radius_m, ball.omitted_by) == (outer_m, None)


def test_the_radius_is_inclusive() -> None:
    table = make_table([(10.0 * i, 0.0, 0.0, 10.0 * i + 1.0, 1.0, 1.0) for i in range(3)], [9] * 3)
    for radius_m, rows in ((10.0, [0, 1]), (float(np.nextafter(10.0, 0.0)), [0])):
        ball = choose(scene_of(table), (0.0, 0.0, 0.0), radius_m, budgets=Budgets())
        assert ball.rows.tolist() == rows


def test_budgets_are_those_of_the_specification() -> None:
    named = {"max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"}
    sizes = {"gpu_vertex_bytes": 24, "gpu_face_bytes": 6}
    assert dataclasses.asdict(Budgets()) == dict.fromkeys(named) | sizes
