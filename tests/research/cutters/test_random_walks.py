"""Random walks: pieces by the seed met first, united by their common border."""

from __future__ import annotations

import numpy as np
import trimesh

from terraport_research.cutters import Body
from terraport_research.cutters.random_walks import RANDOM_WALKS, _chance_to_pass, _first_met


def body_of(mesh: trimesh.Trimesh) -> Body:
    return Body(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32))


def test_a_box_is_six_sides() -> None:
    box = body_of(trimesh.creation.box((1.0, 2.0, 3.0)))
    labels = RANDOM_WALKS.prepare(box)(6)
    sides = np.round(box.normals @ [1, 2, 3]).astype(int)
    assert len(set(zip(labels.tolist(), sides.tolist(), strict=True))) == 6


def test_walks_stop_at_a_fold() -> None:
    """Two funnels that meet at a waist: hardly a piece lies on both."""
    length, around = 40, 24
    z, turn = np.meshgrid(np.arange(length + 1) / 10, np.arange(around) * 2 * np.pi / around)
    radius = 0.4 + 0.4 * np.abs(z - 2.0)  # a waist, folded inwards, at z = 2
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(length), indexing="ij")
    a, b = i * (length + 1) + j, (i + 1) % around * (length + 1) + j
    faces = np.stack([a, b, a + 1, a + 1, b, b + 1], axis=-1).reshape(-1, 3)
    tube = Body(vertices.reshape(-1, 3), faces.astype(np.int32))
    pieces = _first_met(tube, _chance_to_pass(tube))
    above = tube.centres[:, 2] > 2.0
    held = np.bincount(pieces[above], minlength=60) * np.bincount(pieces[~above], minlength=60)
    assert np.count_nonzero(held) <= 3
    labels = RANDOM_WALKS.prepare(tube)(2)
    apart = min(np.mean((labels == 1) == above), np.mean((labels == 0) == above))
    assert apart < 0.05


def test_bodies_apart_stay_apart_whatever_k() -> None:
    two = trimesh.util.concatenate(
        [trimesh.creation.icosphere(2), trimesh.creation.icosphere(2).apply_translation((5, 0, 0))]
    )
    body = body_of(two)
    first = body.centres[:, 0] < 2.5
    labels = RANDOM_WALKS.prepare(body)(1)
    assert len(np.unique(labels)) == 2
    np.testing.assert_array_equal(labels == labels[0], first == first[0])
    assert len(np.unique(RANDOM_WALKS.prepare(body)(7))) == 7
