"""The proof of the hand-off: it passes right covers, and finds every kind of wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions

FEW = HandOffOptions(rays=40_000, subsets=20, seed=7)


def test_a_right_cover_has_no_holes(model) -> None:
    report = check_hand_off(model, FEW)
    assert (report.holes_hidden, report.holes_uncovered) == (0, 0)
    assert report.rays == 40_000
    assert report.hits > 0.9 * report.rays
    assert 0 < report.distance_m["p99.9"] <= model.tolerance_m
    assert report.distance_m["p50"] <= report.distance_m["p99"] <= report.distance_m["p99.9"]
    assert report.down_distance_m["max"] < 2 * model.tolerance_m
    assert report.worst is not None
    assert not report.worst.hole
    assert report.holes_per_million == 0.0
    assert {kind.kind for kind in report.kinds} == {"down", "above", "eye", "grazing"}


def test_a_cover_that_forgets_segments_has_holes_where_they_are_missing(model) -> None:
    # Only the first of each base face's segments is kept: faces hide too early.
    first = model.cover_segments[model.cover_offsets[:-1]]
    wrong = replace(
        model,
        cover_offsets=np.arange(len(model.base_faces) + 1, dtype=np.uint32),
        cover_segments=first,
    )
    report = check_hand_off(wrong, FEW)
    assert report.holes_hidden > 50
    assert report.holes_uncovered == 0
    assert report.unverified < report.holes_hidden  # at most 16 models are built
    assert report.holes == sum(kind.holes for kind in report.kinds)
    assert all(kind.holes > 0 for kind in report.kinds)
    worst = report.worst
    assert worst is not None
    assert worst.hole
    # The hole lies on a segment that is not loaded.
    tile = np.clip(np.array(worst.target)[[0, 2]] // 12.5, 0, 7).astype(int)
    assert tile[0] * 8 + tile[1] not in worst.loaded


def test_a_base_that_is_too_small_is_told_apart(detail, make_terrain, make_model) -> None:
    small = make_terrain(18, 5.0, 95.0)
    report = check_hand_off(make_model(detail, small), FEW)
    assert report.holes_uncovered > 20
    assert report.holes_hidden == 0


def test_a_slit_in_the_base_is_seen_where_nothing_is_loaded(detail, base, make_model) -> None:
    # The middle face of the base is gone: 12 m2 of 10,000.
    centre = base.vertices[base.faces].mean(axis=1)
    gone = int(np.argmin(np.abs(centre[:, [0, 2]] - 50).sum(axis=1)))
    slit = make_model(detail, replace(base, faces=np.delete(base.faces, gone, axis=0)))
    down = check_hand_off(slit, replace(FEW, rays=100_000)).kinds[0]
    assert down.strict_misses >= 10
    assert down.holes >= 10


def test_same_seed_same_report_and_other_seed_other_rays(model) -> None:
    options = HandOffOptions(rays=4_000, subsets=8, seed=3)
    first, second = check_hand_off(model, options), check_hand_off(model, options)
    assert first == second
    assert check_hand_off(model, replace(options, seed=4)).distance_m != first.distance_m


def test_progress_counts_every_ray(model) -> None:
    class Count:
        total = 0.0
        ended = False

        def start(self, stage: str, total: float | None, unit: str) -> None:
            assert (total, unit) == (1_003, "rays")

        def advance(self, n: float) -> None:
            self.total += n

        def done(self, facts) -> None:
            self.ended = facts["holes"] == 0

    count = Count()
    check_hand_off(model, HandOffOptions(rays=1_003, subsets=10), progress=count)
    assert count.total == 1_003
    assert count.ended


@pytest.mark.parametrize(("rays", "subsets"), [(5, 10), (10, 0), (-1, 1)])
def test_impossible_options_are_refused(rays, subsets) -> None:
    with pytest.raises(OptionError, match=f"received {rays} rays and {subsets} subsets"):
        HandOffOptions(rays=rays, subsets=subsets)


def test_an_empty_model_is_refused(model) -> None:
    empty = replace(model, segment_count=0)
    with pytest.raises(OptionError, match="received 0 segments"):
        check_hand_off(empty, FEW)


def test_a_floating_thing_that_the_base_lacks_is_smoothed_away(detail, base, make_model) -> None:
    # A sheet of 60 m x 60 m, 12 m over the ground, loaded or not with the first tile.
    sheet = np.float32([[20, 20, 20], [20, 20, 80], [80, 20, 80], [80, 20, 20]])
    model = make_model(detail, base)
    floating = replace(
        model,
        detail_vertices=np.concatenate([model.detail_vertices, sheet]),
        detail_faces=np.concatenate(
            [model.detail_faces, np.int32([[0, 1, 2], [0, 2, 3]]) + len(model.detail_vertices)]
        ),
        segment_of_face=np.concatenate([model.segment_of_face, np.int32([0, 0])]),
    )
    # What hides the base below the sheet must wait for the sheet's segment too.
    counts = np.diff(model.cover_offsets.astype(np.int64))
    rows = np.split(model.cover_segments, np.cumsum(counts)[:-1])
    rows = [np.union1d(row, [0]) for row in rows]
    right = replace(
        floating,
        cover_offsets=np.concatenate([[0], np.cumsum([len(row) for row in rows])]),
        cover_segments=np.concatenate(rows).astype(np.uint32),
    )
    report = check_hand_off(right, FEW)
    assert report.holes == 0
    assert report.smoothed > 100
    assert report.base_misses >= report.smoothed


def test_base_that_was_too_fat_may_be_hidden(detail, base, make_model) -> None:
    # A wall of the base in the middle tiles, where the detail has nothing: hidden with tile 0.
    wall = np.float32([[50, 0, 20], [50, 12, 20], [50, 12, 80], [50, 0, 80]])
    model = make_model(detail, base)
    fat = replace(
        model,
        base_vertices=np.concatenate([model.base_vertices, wall]),
        base_faces=np.concatenate(
            [model.base_faces, np.int32([[0, 1, 2], [0, 2, 3]]) + len(model.base_vertices)]
        ),
        cover_offsets=np.concatenate([model.cover_offsets, model.cover_offsets[-1] + [1, 2]]),
        cover_segments=np.concatenate([model.cover_segments, np.uint32([0, 0])]),
    )
    report = check_hand_off(fat, FEW)
    assert report.holes == 0


def test_ground_far_behind_is_no_excuse_where_the_base_stands_near(
    detail, base, make_model
) -> None:
    # The base lies three tolerances above the detail: well before it on every ray. It is hidden by
    # a list that names the wrong segments. What a ray then finds is a second ground 40 m below.
    right = make_model(detail, base)
    lift = np.float32([0, 3 * right.tolerance_m, 0])
    cellar = np.float32([[-50, -40, -50], [-50, -40, 150], [150, -40, 150], [150, -40, -50]])
    faces = np.int32([[0, 1, 2], [0, 2, 3]])
    rows = len(right.base_faces)
    wrong = replace(
        right,
        base_vertices=np.concatenate([right.base_vertices + lift, cellar]),
        base_faces=np.concatenate([right.base_faces, faces + len(right.base_vertices)]),
        cover_offsets=np.append(np.arange(rows + 1), [rows, rows]).astype(np.uint32),
        cover_segments=np.zeros(rows, np.uint32),
    )
    report = check_hand_off(wrong, FEW)
    down = report.kinds[0]
    assert down.strict_misses == 0  # the cellar stops every ray: base as far as base goes
    assert down.holes > 1_000
    assert report.holes_hidden > 3_000


def test_visitors_below_the_base_are_counted_apart(detail, base, make_model) -> None:
    model = make_model(detail, base)
    high = replace(model, base_vertices=model.base_vertices + np.float32([0, 3, 0]))
    report = check_hand_off(high, FEW)
    assert report.under_base > 100
    assert check_hand_off(model, FEW).under_base < 10  # the loose outer border alone


def test_a_ray_past_a_missing_twig_is_judged_by_what_is_behind_it(detail, base, make_model) -> None:
    # A twig that only tile 63 has, 6 m over the ground at its middle; far behind it a vane of the
    # base that the detail has nothing of, hidden with tile 0.
    twig = np.float32([[50, 16, 50], [51, 16, 50], [50, 16, 51], [50.3, 22, 50.3]])
    outward = np.int32([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    vane = np.float32([[10, 12, 20], [10, 30, 20], [10, 12, 80], [10, 30, 80]])
    model = make_model(detail, base)
    counts = np.diff(model.cover_offsets.astype(np.int64))
    rows = [np.union1d(row, [63]) for row in np.split(model.cover_segments, np.cumsum(counts)[:-1])]
    rows += [np.array([0]), np.array([0])]
    two = np.int32([[0, 1, 2], [2, 1, 3]])
    fat = replace(
        model,
        detail_vertices=np.concatenate([model.detail_vertices, twig]),
        detail_faces=np.concatenate([model.detail_faces, outward + len(model.detail_vertices)]),
        segment_of_face=np.concatenate([model.segment_of_face, np.full(4, 63, np.int32)]),
        base_vertices=np.concatenate([model.base_vertices, vane]),
        base_faces=np.concatenate([model.base_faces, two + len(model.base_vertices)]),
        cover_offsets=np.concatenate([[0], np.cumsum([len(row) for row in rows])]),
        cover_segments=np.concatenate(rows).astype(np.uint32),
    )
    report = check_hand_off(fat, FEW)
    assert report.holes == 0
    assert next(kind for kind in report.kinds if kind.kind == "grazing").strict_misses > 0
