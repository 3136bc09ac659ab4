"""Charts of a few faces join their neighbours, where there are too many."""

from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground, look_at

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.textures.small_charts import join_small_charts

VIEWS = [
    look_at("a.jpg", (20.0, 60.0, 20.0), (20.0, 0.0, 20.1)),
    look_at("b.jpg", (18.0, 60.0, 20.0), (18.0, 0.0, 20.1)),
]
PACKED = np.array([view.packed() for view in VIEWS])


def noisy_place() -> tuple[Float32, Int32, Int32, Int32]:
    """Ground whose faces have now this photo, now that, now none; the middle is in both."""
    vertices, faces = ground(40)
    middle = vertices[faces].mean(axis=1)
    faces = faces[(np.abs(middle[:, [0, 2]] - 20.0) < 12.0).all(axis=1)]
    rng = np.random.default_rng(1)
    view = rng.choice([0, 0, 0, 0, 1, -1], len(faces)).astype(np.int32)
    pairs, _ = face_pairs(faces, len(vertices))
    return vertices, faces, view, pairs


@pytest.mark.parametrize("most", [200, 40])
def test_there_are_no_more_charts_than_asked_for(most: int) -> None:
    vertices, faces, view, pairs = noisy_place()
    before = components(len(view), pairs, labels=view + 1)[1]
    joined = join_small_charts(view, vertices, faces, pairs, PACKED, max_charts=most)
    assert before > 300
    assert joined.charts <= most
    assert joined.charts == components(len(view), pairs, labels=joined.view + 1)[1]
    assert ((joined.view != view) == joined.borrowed).all()


def test_nothing_joins_while_there_is_room() -> None:
    vertices, faces, view, pairs = noisy_place()
    joined = join_small_charts(view, vertices, faces, pairs, PACKED, max_charts=len(faces))
    assert (joined.view == view).all()
    assert not joined.borrowed.any()


def test_a_piece_that_the_photo_does_not_have_stays() -> None:
    """The second camera is far off: nothing of the place is in its picture."""
    vertices, faces, view, pairs = noisy_place()
    away = look_at("b.jpg", (900.0, 60.0, 20.0), (900.0, 0.0, 20.1)).packed()
    swapped = np.where(view == 0, 1, view)  # everybody's neighbour has the photo from afar
    joined = join_small_charts(
        swapped.astype(np.int32), vertices, faces, pairs, np.stack([PACKED[0], away]), max_charts=1
    )
    assert (joined.view == swapped).all()


def test_a_large_piece_that_no_photo_sees_stays() -> None:
    """Wholly folded over: beyond a few faces it is no noise, and keeps the vertex colours."""
    vertices, faces, view, pairs = noisy_place()
    middle = vertices[faces].mean(axis=1)
    under = (np.abs(middle[:, [0, 2]] - 20.0) < 5.0).all(axis=1)
    faces[under] = faces[under][:, ::-1]
    view = np.where(under, -1, 0).astype(np.int32)
    joined = join_small_charts(view, vertices, faces, pairs, PACKED, max_charts=1)
    assert under.sum() > 32
    assert (joined.view == view).all()
