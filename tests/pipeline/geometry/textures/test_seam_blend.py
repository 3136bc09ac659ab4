from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.textures.seam_blend import Blend, blend_seams, no_blend, seam_steps
from terraport_pipeline.geometry.textures.seam_levels import level_field, node_levels
from terraport_pipeline.geometry.textures.seams import Nodes, Seams, find_seams, label_nodes


def two_views(step: int = 12, *, shared: bool = True):
    """A sheet coloured by view 0 on its left half and 1 on its right, which is brighter."""
    vertices, faces = ground(40)
    centre_x = vertices[faces].mean(axis=1)[:, 0]
    view = (centre_x > 20.0).astype(np.int32)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    views[:, :2] = 0, 1
    colour[:, 0], colour[:, 1] = 100, 100 + step
    if not shared:
        views[:, 0], views[:, 1] = view, -1
        colour[:, 0] = 100 + step * view[:, None]
    candidates = Candidates(views, np.zeros((len(faces), SLOTS), np.uint16), colour)
    nodes = label_nodes(faces, view, len(vertices))
    pairs, edges = face_pairs(faces, len(vertices))
    grey = np.full((len(faces), 3), 100, np.uint8)
    seams = find_seams(
        nodes, faces, view, candidates, grey, neutral_gains(2), pairs, edges, vertices
    )
    return vertices, faces, view, candidates, nodes, seams


def finish(rings: int = 4, **how: object) -> tuple[Nodes, Seams, np.ndarray, Blend, np.ndarray]:
    vertices, _, view, candidates, nodes, seams = two_views(**how)  # type: ignore[arg-type]
    field, cell = level_field(vertices, nodes, seams)
    levels = node_levels(field, vertices, nodes, cell)
    return nodes, seams, levels, blend_seams(nodes, seams, levels, candidates, rings=rings), view


def test_seams_lie_where_views_meet_and_know_the_step() -> None:
    vertices, _, view, _, nodes, seams = two_views()
    assert (view[seams.face[:, 0]] != view[seams.face[:, 1]]).all()
    first = view[seams.face[:, 0]]
    assert (seams.step == np.where(first == 0, -12.0, 12.0)[:, None]).all()
    assert (seams.raw_step == seams.step).all()
    assert (nodes.vertex[seams.node[:, :, 0]] == nodes.vertex[seams.node[:, :, 1]]).all()
    assert (nodes.view[seams.node[:, :, 0]] == first[:, None]).all()
    assert len(nodes.vertex) == len(vertices) + len(np.unique(nodes.vertex[seams.node]))


def test_the_smooth_field_closes_most_of_an_even_step() -> None:
    _, seams, levels, _, _ = finish()
    first, second = seams.node[:, 0, 0], seams.node[:, 0, 1]
    left = seams.step + levels[first] - levels[second]
    assert np.abs(left).mean() < 0.5 * 12
    # each side comes half way
    assert abs(levels[first].mean() + levels[second].mean()) < 0.5


def test_blending_closes_the_rest() -> None:
    _, seams, levels, blend, view = finish()
    steps = seam_steps(seams, levels, blend)
    assert steps["seam_step_photos"] == pytest.approx(12.0)
    assert steps["seam_step_local"] < 0.5
    near = blend.view >= 0
    assert (blend.view[near] == 1 - view[near]).all()
    assert blend.weight.max() == 0.5
    assert 0.05 < near.mean() < 0.4


def test_the_band_ends_after_its_rings() -> None:
    narrow, wide = finish(1)[3], finish(6)[3]
    assert (narrow.view >= 0).sum() < (wide.view >= 0).sum() / 3


def test_nothing_jumps_inside_a_chart() -> None:
    nodes, _, _, blend, _ = finish()
    # weight and correction belong to nodes: all corners of a node agree
    for values in (blend.weight.reshape(-1), blend.correction.reshape(-1, 3)[:, 0]):
        first = np.zeros(len(nodes.vertex), np.float32)
        first[nodes.corner.ravel()] = values
        assert (first[nodes.corner.ravel()] == values.astype(np.float32)).all()


def test_what_the_other_view_does_not_see_is_not_blended() -> None:
    _, seams, levels, blend, _ = finish(shared=False)
    assert (blend.view == -1).all()
    assert not blend.weight.any()
    # the step is still smaller than it was
    steps = seam_steps(seams, levels, blend)
    assert steps["seam_step_local"] < 0.9 * steps["seam_step_photos"]


def test_large_steps_are_two_different_things_and_hardly_trusted() -> None:
    small, large = two_views(step=4)[5], two_views(step=100)[5]
    assert small.trust.min() > 0.85
    assert large.trust.max() < 0.1
    assert np.abs(large.step).max() == 48.0
    # 255 - 100 levels as they are
    assert np.abs(large.raw_step).max() == pytest.approx(100.0)


def test_no_seams_and_no_blend() -> None:
    none = no_blend(3)
    assert none.view.tolist() == [-1, -1, -1]
    assert none.correction.shape == (3, 3, 3)
    vertices, faces, view, candidates, _, _ = two_views()
    nodes = label_nodes(faces, np.zeros_like(view), len(vertices))
    pairs, edges = face_pairs(faces, len(vertices))
    seams = find_seams(
        nodes, faces, np.zeros_like(view), candidates, np.zeros((len(faces), 3), np.uint8),
        neutral_gains(2), pairs, edges, vertices,
    )  # fmt: skip
    field, cell = level_field(vertices, nodes, seams)
    levels = node_levels(field, vertices, nodes, cell)
    assert not levels.any()
    blend = blend_seams(nodes, seams, levels, candidates, rings=4)
    assert not blend.correction.any()
    assert seam_steps(seams, levels, blend) == {}


def test_rings_are_checked() -> None:
    _, _, _, candidates, nodes, seams = two_views()
    levels = np.zeros((len(nodes.vertex), 3), np.float32)
    with pytest.raises(ValueError, match="0 rings, expected 1 to 16"):
        blend_seams(nodes, seams, levels, candidates, rings=0)
