"""Every compared algorithm on bodies made here: as many parts as asked, at the waist."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_research.cutters import CUTTERS, Body
from terraport_research.procedural_bodies import procedural_models
from terraport_research.segmentation_scores import MeshFacts, compare

MODEL = next(procedural_models())
MESH = MeshFacts.of(MODEL.vertices, MODEL.faces)


@pytest.mark.parametrize("key", CUTTERS)
def test_it_parts_a_dumb_bell_at_its_waist(key: str) -> None:
    body = Body(MODEL.vertices, MODEL.faces)
    before = (MODEL.vertices.copy(), MODEL.faces.copy())
    cut = CUTTERS[key].prepare(body)
    labels = cut(2)
    assert labels.shape == (len(MODEL.faces),)
    assert labels.min() >= 0
    # Nearer to one of the people than a cut a good way off the waist is; one has a part there.
    height = MODEL.vertices[MODEL.faces].mean(axis=1)[:, 2]
    off = (height > 0.9).astype(int)
    assert any(
        compare(MESH, MESH.split(labels), MESH.split(person)).ri
        < compare(MESH, MESH.split(off), MESH.split(person)).ri
        for person in MODEL.people
    )
    np.testing.assert_array_equal(MODEL.vertices, before[0])
    np.testing.assert_array_equal(MODEL.faces, before[1])


@pytest.mark.parametrize("key", [key for key, one in CUTTERS.items() if one.takes_k])
def test_it_makes_what_it_is_told_and_the_same_again(key: str) -> None:
    for k in (1, 3, 8):
        first, again = (
            CUTTERS[key].prepare(Body(MODEL.vertices, MODEL.faces, seed=5))(k) for _ in range(2)
        )
        assert len(np.unique(first)) == k
        np.testing.assert_array_equal(first, again)
