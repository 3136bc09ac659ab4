"""Felzenszwalb and Huttenlocher's algorithm against a literal one."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.graph.felzenszwalb import (
    FelzenszwalbSegmenter,
    felzenszwalb,
    neighbour_differences,
)
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh


def literal(n_faces, pairs, difference, scale, least):
    """Algorithm 1 with sets: parts are sets, Int(C) is looked up in the joins made."""
    component = [{i} for i in range(n_faces)]
    inside = {id(p): 0.0 for p in component}
    order = sorted(range(len(pairs)), key=lambda i: difference[i])

    def join(a, b):
        union = a | b
        for face in union:
            component[face] = union
        return union

    keep = list(component)  # ids stay unique while the sets live
    for i in order:
        a, b = component[pairs[i][0]], component[pairs[i][1]]
        if a is b:
            continue
        slack = min(inside[id(p)] + scale / len(p) for p in (a, b))
        if difference[i] <= slack:
            union = join(a, b)
            keep.append(union)
            inside[id(union)] = float(difference[i])
    for i in order:
        a, b = component[pairs[i][0]], component[pairs[i][1]]
        if a is not b and min(len(a), len(b)) < least:
            keep.append(join(a, b))
    number = {}
    return [number.setdefault(id(component[i]), len(number)) for i in range(n_faces)]


@pytest.mark.parametrize("seed", range(120))
@pytest.mark.parametrize(("scale", "least"), [(0.0, 1), (30.0, 1), (200.0, 4), (3.0, 60)])
def test_parts_are_the_papers(seed, scale, least, soup):
    """Identical parts on soups with non-manifold edges, repeated faces and ties."""
    mesh = soup(seed)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    difference, _ = neighbour_differences(
        SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours), pairs
    )
    labels, count = felzenszwalb(len(mesh.faces), pairs, difference, scale, least)
    expected = literal(len(mesh.faces), pairs.tolist(), difference.tolist(), scale, least)
    assert labels.tolist() == expected
    assert count == max(expected) + 1


def test_difference_is_the_cielab_distance(terrain):
    """Black beside white differ by L* = 100; a scalar wins over colours; without both all is 0."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0, 0, 0], [1, 0, 0]])
    faces = np.array([[0, 1, 2], [1, 2, 3]], np.int32)
    pairs, _ = face_pairs(faces, 6)
    colours = np.array([[0] * 3, [0] * 3, [0] * 3, [255] * 3, [0] * 3, [0] * 3], np.uint8)
    plain = SegmenterMesh(vertices.astype(np.float32), faces, colours)
    third = 116 * ((85 / 255 + 0.055) / 1.055) ** (2.4 / 3) - 16
    assert neighbour_differences(plain, pairs)[0] == pytest.approx([third], rel=1e-4)
    scalar = SegmenterMesh(
        vertices.astype(np.float32), faces, colours, np.array([1.0, 4.5], np.float32)
    )
    assert neighbour_differences(scalar, pairs)[0].tolist() == [3.5]
    bare = SegmenterMesh(vertices.astype(np.float32), faces)
    assert neighbour_differences(bare, pairs)[0].tolist() == [0.0]


def test_regions_of_a_terrain(terrain):
    """Patches of colour come out; no region is below its share; bytes are the same again."""
    mesh = terrain(3, cells=60, noise=0.0, holes=0.05)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    engine = FelzenszwalbSegmenter(region_share=0.01)
    segmentation, again = engine.segment(subject), engine.segment(subject)
    assert segmentation.regions.tobytes() == again.regions.tobytes()
    assert segmentation.fine.tobytes() == again.fine.tobytes()
    assert 2 <= segmentation.region_count <= 100
    assert np.bincount(segmentation.regions).min() >= 0.01 * len(mesh.faces)
    assert len(np.bincount(segmentation.regions)) == segmentation.region_count
    assert segmentation.fine_count >= segmentation.region_count


def test_no_faces():
    """An empty mesh has no parts."""
    empty = SegmenterMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    segmentation = FelzenszwalbSegmenter().segment(empty)
    assert (segmentation.region_count, segmentation.fine_count, len(segmentation.similarity)) == (
        0,
        0,
        0,
    )


@pytest.mark.parametrize(
    "wrong", [{"region_scale": -1.0}, {"region_share": 2.0}, {"fine_scale": float("nan")}]
)
def test_wrong_options_are_refused(wrong):
    """Before any work, by name."""
    with pytest.raises(ValueError, match=next(iter(wrong))):
        FelzenszwalbSegmenter(**wrong)


def test_a_whole_number_scale_is_the_same(terrain):
    """The slack is a fraction whatever type the scale has."""
    mesh = terrain(6, cells=20)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    difference, _ = neighbour_differences(subject, pairs)
    whole, real = (felzenszwalb(len(mesh.faces), pairs, difference, k, 1)[0] for k in (40, 40.0))
    assert whole.tolist() == real.tolist()
