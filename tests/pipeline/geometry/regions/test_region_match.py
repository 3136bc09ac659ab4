"""Matching of regions between two surfaces: literal oracles, and what must hold for any pair."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.mesh.surface_samples import SurfaceSamples
from terraport_pipeline.geometry.regions.region_match import (
    CommonGround,
    Overlaps,
    carry_ids,
    match_regions,
    region_overlaps,
)


def samples(points, labels, areas=None):
    labels = np.asarray(labels, np.int32)
    areas = np.ones(len(labels)) if areas is None else np.asarray(areas, float)
    return SurfaceSamples(np.asarray(points, float).reshape(-1, 3), labels, areas)


def line(labels, start=0.0):
    """One point per metre along x."""
    x = start + np.arange(len(labels))
    return samples(np.stack([x, 0 * x, 0 * x], axis=1), labels)


def as_dict(overlaps):
    return {
        (new, old): (area, similarity)
        for new, old, area, similarity in zip(
            overlaps.new.tolist(),
            overlaps.old.tolist(),
            overlaps.area.tolist(),
            overlaps.similarity.tolist(),
            strict=True,
        )
    }


def test_overlaps_written_out():
    """Old 000011, new 0aaab.: the second place is a metre apart and out of reach."""
    old = line([0, 0, 0, 0, 1, 1])
    new = line([0, 1, 1, 1, 2])
    overlaps = as_dict(region_overlaps(new, old, max_distance_m=0.5))
    assert overlaps == {
        (0, 0): (1.0, pytest.approx(1 / 4)),
        (1, 0): (3.0, pytest.approx(3 / 4)),
        (2, 1): (1.0, pytest.approx(1 / 2)),
    }
    far = line([0, 1, 1, 1, 2], start=50.0)
    assert as_dict(region_overlaps(far, old, max_distance_m=0.5)) == {}


def test_a_split_leaves_the_number_to_the_larger_piece_and_a_merge_to_the_more_alike():
    split = region_overlaps(line([0] * 4 + [1] * 6), line([0] * 10), max_distance_m=0.1)
    assert [pair.tolist() for pair in match_regions(split)] == [[1], [0]]
    merge = region_overlaps(line([0] * 10), line([0] * 4 + [1] * 6), max_distance_m=0.1)
    assert [pair.tolist() for pair in match_regions(merge)] == [[0], [1]]


def test_ties_go_to_the_lower_old_and_then_the_lower_new_region():
    halves = region_overlaps(line([0] * 10), line([0] * 5 + [1] * 5), max_distance_m=0.1)
    assert [pair.tolist() for pair in match_regions(halves)] == [[0], [0]]
    halves = region_overlaps(line([0] * 5 + [1] * 5), line([0] * 10), max_distance_m=0.1)
    assert [pair.tolist() for pair in match_regions(halves)] == [[0], [0]]


def test_below_the_threshold_nothing_is_the_same():
    quarter = region_overlaps(line([0] * 4), line([0]), max_distance_m=0.1)
    assert match_regions(quarter)[0].tolist() == []
    assert match_regions(quarter, min_similarity=0.25)[0].tolist() == [0]


def literal_overlaps(new, old, limit):
    """Every sample's nearest by a loop over all; pairs in a dictionary."""
    common: dict[tuple[int, int], float] = {}
    for source, target, turned in ((new, old, False), (old, new, True)):
        for point, label, area in zip(source.points, source.labels, source.areas, strict=True):
            distances = np.linalg.norm(target.points - point, axis=1)
            if len(distances) == 0 or distances.min() > limit:
                continue
            other = int(target.labels[int(np.argmin(distances))])
            key = (other, int(label)) if turned else (int(label), other)
            common[key] = common.get(key, 0.0) + area / 2
    overlaps = {}
    for (a, b), area in common.items():
        both = new.areas[new.labels == a].sum() + old.areas[old.labels == b].sum()
        overlaps[a, b] = (area, area / (both - area))
    return overlaps


@st.composite
def surfaces(draw):
    """Random samples at random places: no two distances are equal."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pair = []
    for _ in range(2):
        count = draw(st.integers(0, 40))
        labels = rng.integers(0, draw(st.integers(1, 6)), count)
        pair.append(samples(rng.normal(size=(count, 3)), labels, rng.uniform(0.1, 2, count)))
    return pair


@given(surfaces(), st.floats(0.1, 2.0))
@settings(max_examples=80)
def test_equal_to_a_literal_loop(pair, limit):
    new, old = pair
    overlaps, expected = (
        as_dict(region_overlaps(new, old, max_distance_m=limit)),
        literal_overlaps(new, old, limit),
    )
    assert overlaps.keys() == expected.keys()
    for key, row in expected.items():
        assert overlaps[key] == pytest.approx(row)
        assert 0 < overlaps[key][1] <= 1
    turned = as_dict(region_overlaps(old, new, max_distance_m=limit))
    assert {(b, a): pytest.approx(row) for (a, b), row in turned.items()} == overlaps


@given(surfaces(), st.floats(0.05, 0.9))
@settings(max_examples=80)
def test_matches_are_one_to_one_stable_and_above_the_threshold(pair, least):
    """And no unmatched pair would rather have each other than what they got."""
    overlaps = region_overlaps(*pair, max_distance_m=1.0)
    new, old = match_regions(overlaps, min_similarity=least)
    assert len(set(new.tolist())) == len(new) == len(set(old.tolist()))
    assert new.tolist() == sorted(new.tolist())
    similarity = {key: row[1] for key, row in as_dict(overlaps).items()}
    got_new = {a: similarity[a, b] for a, b in zip(new.tolist(), old.tolist(), strict=True)}
    got_old = {b: similarity[a, b] for a, b in zip(new.tolist(), old.tolist(), strict=True)}
    assert min(got_new.values(), default=1.0) >= least
    for (a, b), s in similarity.items():
        assert s < least or s <= max(got_new.get(a, 0.0), got_old.get(b, 0.0))


@given(surfaces(), st.randoms(use_true_random=False))
@settings(max_examples=50)
def test_the_numbering_of_the_new_regions_does_not_matter(pair, random):
    """Renamed new regions get the same old ones."""
    new, old = pair
    names = list(range(int(new.labels.max(initial=0)) + 1))
    random.shuffle(names)
    renamed = SurfaceSamples(new.points, np.array(names, np.int32)[new.labels], new.areas)
    a, b = match_regions(region_overlaps(new, old, max_distance_m=1.0))
    c, d = match_regions(region_overlaps(renamed, old, max_distance_m=1.0))
    renumbered = {names[x]: y for x, y in zip(a.tolist(), b.tolist(), strict=True)}
    assert renumbered == dict(zip(c.tolist(), d.tolist(), strict=True))


@given(surfaces())
@settings(max_examples=50)
def test_a_surface_matches_itself(pair):
    """Every region, with similarity 1: a rebuild of the same survey changes no number."""
    surface, _ = pair
    overlaps = region_overlaps(surface, surface)
    new, old = match_regions(overlaps)
    assert new.tolist() == old.tolist() == sorted(set(surface.labels.tolist()))
    assert overlaps.similarity == pytest.approx(np.ones(len(new)))


@given(st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=30), min_size=1, max_size=8))
@settings(max_examples=80)
def test_numbers_over_many_rebuilds(history):
    """All different in every version, and one that went out of use never comes back."""
    before, ids, free = line([]), np.zeros(0, np.int64), 0
    retired: set[int] = set()
    for labels in history:
        surface = line(np.unique(labels, return_inverse=True)[1])
        count = int(surface.labels.max()) + 1
        matched = match_regions(region_overlaps(surface, before, max_distance_m=0.5))
        now, free_now = carry_ids(count, matched, ids, free)
        assert len(set(now.tolist())) == count
        assert not retired & set(now.tolist())
        assert free_now == free + len(set(now.tolist()) - set(ids.tolist()))
        assert max(now.tolist()) < free_now
        retired |= set(ids.tolist()) - set(now.tolist())
        before, ids, free = surface, now, free_now


def test_a_fresh_place_counts_from_0():
    nothing = np.zeros(0, np.int32)
    ids, free = carry_ids(3, (nothing, nothing), np.zeros(0, np.int64), 0)
    assert (ids.tolist(), free) == ([0, 1, 2], 3)


def test_inputs_stay_as_they_are():
    overlaps = region_overlaps(line([0, 1]), line([0, 1]))
    for array in (overlaps.new, overlaps.old, overlaps.area, overlaps.similarity):
        array.flags.writeable = False
    assert isinstance(overlaps, Overlaps)
    assert match_regions(overlaps)[0].tolist() == [0, 1]


def test_common_ground_counts_without_being_sampled():
    """Half of both regions is bit for bit the same; the other half lies elsewhere now."""
    common = CommonGround(np.int32([0, 1]), np.int32([3, 4]), np.array([10.0, 5.0]))
    new, old = line([0] * 10), line([3] * 10, start=50.0)
    overlaps = as_dict(region_overlaps(new, old, common=common, max_distance_m=0.5))
    assert overlaps == {(0, 3): (10.0, pytest.approx(1 / 3)), (1, 4): (5.0, 1.0)}
    nothing = samples([], [])
    assert as_dict(region_overlaps(nothing, nothing, common=common)) == {
        (0, 3): (10.0, 1.0),
        (1, 4): (5.0, 1.0),
    }
    moved = line([3] * 10)
    assert as_dict(region_overlaps(new, moved, common=common))[0, 3] == (20.0, 1.0)
