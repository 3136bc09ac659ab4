"""Regions by mean colour: against a literal version on small meshes, and what they are for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import edge_steps
from terraport_pipeline.geometry.regions.colour import face_lab
from terraport_pipeline.geometry.regions.mean_colour import (
    LAB_STEPS,
    LEAST_LIMIT,
    MOST_LIMIT,
    MeanColourSegmenter,
)
from terraport_pipeline.geometry.regions.merge_order import scramble
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh, segmenter_by_name
from terraport_research.segmentation_scores import rand_error


def literal(mesh, engine):
    """Rounds over sets of faces; differences from sums over the faces each time."""
    # Borders in steps of length, colours in steps of Lab; the limit follows the colours' spread.
    n = len(mesh.faces)
    pairs, edges = face_pairs(mesh.faces, len(mesh.vertices))
    border = {}
    for (a, b), steps in zip(pairs.tolist(), edge_steps(mesh.vertices, edges), strict=True):
        border[a, b] = border[b, a] = int(steps)
    lab = face_lab(mesh.colours, mesh.faces, LAB_STEPS).astype(np.int64)
    weight = np.array([engine.lightness, 1.0, 1.0]) / LAB_STEPS
    limit = max(engine.spread * np.sqrt((lab * weight).var(axis=0).sum()), LEAST_LIMIT)
    limit = engine.difference or min(limit, MOST_LIMIT)
    least = max(int(np.ceil(engine.small_share * n)), 1)
    units = [frozenset([i]) for i in range(n)]
    mean_step = sum(border.values()) // max(len(border), 1)

    # Lengths of the border between two units, and of all of one unit's border.
    def between(u, v):
        return sum(border.get((a, b), 0) for a in u for b in v)

    def around(u):
        return sum(steps for (a, b), steps in border.items() if a in u and b not in u)

    def rounds(most, small_only):
        nonlocal units
        while True:
            choice = {}
            # Every unit chooses its nearest neighbour within the limit; ties by scrambled name.
            for u in units:
                options = []
                for v in units:
                    shared = between(u, v) if u != v else 0
                    small = [
                        len(w) < least or len(w) * mean_step < 2 * around(w)
                        for w in ((u, v) if small_only else ())
                    ]
                    if not shared or (small_only and not any(small)):
                        continue
                    d = 0.0
                    for c in range(3):
                        means = [lab[sorted(w), c].sum() / len(w) for w in (u, v)]
                        d += ((means[0] - means[1]) * weight[c]) ** 2
                    if not small_only:
                        if min(len(u), len(v)) < least:
                            d *= min(len(u), len(v)) / least
                        if engine.leak:
                            d *= (min(around(u), around(v)) / shared) ** (2 * engine.leak)
                    if d <= most * most:
                        options.append((d, int(scramble(min(u), min(v))), min(v), v))
                if options:
                    choice[u] = min(options, key=lambda o: o[:3])[3]
            # Those that chose each other unite; a unit also joins one four times as large.
            mutual = {u for u, v in choice.items() if choice.get(v) == u}
            star = {u for u, v in choice.items() if u not in mutual and len(v) >= 4 * len(u)}
            united = {u: {u} for u in units}
            for u, v in choice.items():
                if u in mutual or (u in star and v not in star):
                    together = united[u] | united[v]
                    for w in together:
                        united[w] = together
            new = sorted({frozenset().union(*group) for group in united.values()}, key=min)
            if len(new) == len(units):
                return
            units = new

    # Eight rounds of growing limits; the units after the second are the fine pools.
    for level in range(1, 9):
        rounds(limit * level / 8, False)
        if level == 2:
            fine = units
    rounds(np.inf, True)
    return fine, units, least


def as_sets(labels):
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize(
    "engine",
    [
        MeanColourSegmenter(),
        MeanColourSegmenter(small_share=0.1, leak=0.0),
        MeanColourSegmenter(small_share=0.2, difference=20.0, lightness=1.0),
    ],
)
def test_units_are_the_literal_ones(seed, engine, soup):
    """Identical on soups with non-manifold edges, repeated faces, islands and ties."""
    mesh = soup(seed)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    segmentation = engine.segment(subject)
    fine, units, least = literal(mesh, engine)
    assert as_sets(segmentation.fine) == set(fine)
    small = {unit for unit in units if len(unit) < least}
    assert segmentation.facts["region_islands"] == len(small)
    if not small or len(small) == len(units):
        assert as_sets(segmentation.regions) == set(units)
    else:  # islands went to the nearest: every other region holds its unit
        assert segmentation.region_count == len(units) - len(small)
        for unit in set(units) - small:
            assert len({int(segmentation.regions[face]) for face in unit}) == 1


def patches(terrain, seed, *, shade=0.0, noise=0.0):
    """Terrain of green and brown patches, a shadow over half of it, and the patches' labels."""
    mesh = terrain(seed, cells=70, noise=0.0)
    green = mesh.colours[:, 0] < 100
    colours = np.where(green[:, None], [70, 105, 50], [140, 120, 95]).astype(float)
    shadow = mesh.vertices[:, 0] > np.median(mesh.vertices[:, 0])
    colours *= np.where(shadow, 1.0 - shade, 1.0)[:, None]
    colours += np.random.default_rng(seed).normal(0.0, noise, colours.shape)
    colours = np.clip(np.rint(colours), 0, 255).astype(np.uint8)
    segmentation = MeanColourSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces, colours))
    clean = np.where(green[:, None], [70, 105, 50], [140, 120, 95]).astype(np.uint8)
    truth = MeanColourSegmenter(difference=10.0).segment(
        SegmenterMesh(mesh.vertices, mesh.faces, clean)
    )
    return segmentation, truth


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("shade", "noise"), [(0.0, 0.0), (0.3, 0.0), (0.0, 12.0), (0.3, 8.0)])
def test_shadow_and_noise_do_not_part_a_material(terrain, seed, shade, noise):
    """Patches of two materials come out under a shadow and sensor noise."""
    segmentation, truth = patches(terrain, seed, shade=shade, noise=noise)
    assert truth.region_count >= 2
    assert rand_error(segmentation.regions, truth.regions) < 0.06


def test_lightness_alone_still_parts_greys(terrain):
    """A grey survey has no chroma: the spread, and so the limit, is that of lightness."""
    mesh = terrain(5, cells=50, noise=0.0)
    grey = np.repeat((mesh.colours[:, :1] // 2 + 60), 3, axis=1).astype(np.uint8)
    segmentation = MeanColourSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces, grey))
    assert segmentation.region_count >= 2


def test_renumbering_vertices_changes_nothing(terrain):
    """Every sum is exact; same bytes again too."""
    mesh = terrain(7, cells=30, noise=10.0, holes=0.1)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    first, again = (MeanColourSegmenter().segment(subject) for _ in range(2))
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    rank = np.argsort(order).astype(np.int32)
    turned = MeanColourSegmenter().segment(
        SegmenterMesh(mesh.vertices[order], rank[mesh.faces], mesh.colours[order])
    )
    for other in (again, turned):
        assert other.regions.tobytes() == first.regions.tobytes()
        assert other.fine.tobytes() == first.fine.tobytes()


def test_bounds_and_nesting(terrain):
    """No region below its share; every fine pool lies in one unit of its own limit or coarser."""
    mesh = terrain(9, cells=50, noise=6.0, holes=0.15)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    segmentation = MeanColourSegmenter(small_share=0.01).segment(subject)
    assert np.bincount(segmentation.regions).min() >= 0.01 * len(mesh.faces)
    assert len(np.unique(segmentation.regions)) == segmentation.region_count
    keys = np.unique(
        segmentation.fine.astype(np.int64) * segmentation.region_count + segmentation.regions
    )
    assert len(keys) == segmentation.fine_count


def test_one_colour_is_one_region_and_a_scalar_counts_first(terrain):
    """No colour, one colour: whatever hangs together; a scalar is compared where there is one."""
    mesh = terrain(2, cells=20)
    bare = SegmenterMesh(mesh.vertices, mesh.faces)
    assert MeanColourSegmenter().segment(bare).region_count == 1
    side = (mesh.vertices[mesh.faces].mean(axis=1)[:, 0] > 16).astype(np.float32)
    scalar = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours, side)
    segmentation = MeanColourSegmenter().segment(scalar)
    assert rand_error(segmentation.regions, side.astype(int)) == 0.0
    broken = replace(scalar, scalar=np.where(side > 0, np.nan, side))
    with pytest.raises(ValueError, match="scalar of face"):
        MeanColourSegmenter().segment(broken)


def test_no_faces_and_its_name():
    """An empty mesh has no regions; the engine is found by name."""
    empty = SegmenterMesh(
        np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8)
    )
    segmentation = segmenter_by_name("means").segment(empty)
    assert (segmentation.region_count, segmentation.fine_count) == (0, 0)


@pytest.mark.parametrize(
    "wrong",
    [{"spread": 0.0}, {"difference": -1.0}, {"small_share": 1.5}, {"lightness": float("nan")}],
)
def test_wrong_options_are_refused(wrong):
    """Before any work, by name."""
    with pytest.raises(ValueError, match=next(iter(wrong))):
        MeanColourSegmenter(**wrong)
