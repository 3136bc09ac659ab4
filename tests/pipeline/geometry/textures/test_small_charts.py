"""Charts of a few faces join their neighbours."""

from __future__ import annotations

import numpy as np
from photo_scene import ground, look_at

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.textures.small_charts import join_seen_charts, join_small_charts

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


def test_charts_of_a_few_faces_join() -> None:
    vertices, faces, view, pairs = noisy_place()
    joined = join_small_charts(view, vertices, faces, pairs, PACKED)
    assert components(len(view), pairs, labels=view + 1)[1] > 300
    assert components(len(view), pairs, labels=joined + 1)[1] <= 10


def test_charts_of_more_than_thirty_two_faces_stay() -> None:
    vertices, faces, _, pairs = noisy_place()
    view = np.zeros(len(faces), np.int32)
    middle = vertices[faces].mean(axis=1)[:, [0, 2]]
    for number, side_m in enumerate((3.6, 5.6)):
        view[(np.abs(middle - (14.0 + 10.0 * number, 20.0)) < 0.5 * side_m).all(axis=1)] = 1
    small = (view == 1) & (middle[:, 0] < 19.0)
    large = (view == 1) & ~small
    assert 16 < small.sum() <= 32 < large.sum()
    assert (join_small_charts(view, vertices, faces, pairs, PACKED) == large).all()
    # Folded over, it does not look at the photo, and has too many faces for noise.
    faces[small] = faces[small][:, ::-1]
    assert (join_small_charts(view, vertices, faces, pairs, PACKED) == view).all()


def seen_by_both(view: Int32) -> tuple[np.ndarray, np.ndarray]:
    """Both photos see every face, the second best."""
    candidates = np.full((len(view), 8), -1, np.int16)
    candidates[:, :2] = (0, 1)
    costs = np.full((len(view), 8), 65535, np.uint16)
    costs[:, :2] = (5000, 0)
    return candidates, costs


def test_a_chart_joins_the_photo_that_shows_it_nearly_as_well() -> None:
    vertices, faces, _, pairs = noisy_place()
    middle = vertices[faces].mean(axis=1)[:, [0, 2]]
    view = (np.abs(middle - 20.0) < 3.0).all(axis=1).astype(np.int32)
    candidates, costs = seen_by_both(view)

    def joined(**least: int) -> Int32:
        return join_seen_charts(view, candidates, costs, vertices, faces, pairs, PACKED, **least)

    inside = np.flatnonzero(view)
    assert 32 < len(inside) < 128
    assert not joined().any()
    assert (joined(least_faces=len(inside)) == view).all()  # large enough by itself
    # A photo that sees three of four faces will do, one that sees fewer will not.
    candidates[inside[: len(inside) // 4], 0] = 7
    assert not joined().any()
    candidates[inside[: len(inside) // 4 + 1], 0] = 7
    assert (joined() == view).all()


def test_a_chart_keeps_its_photo_where_the_neighbours_is_much_worse() -> None:
    vertices, faces, _, pairs = noisy_place()
    view = np.zeros(len(faces), np.int32)
    view[:20] = 1
    candidates, costs = seen_by_both(view)
    costs[:, 0] = 50_000
    joined = join_seen_charts(view, candidates, costs, vertices, faces, pairs, PACKED)
    assert (joined == view).all()


def test_a_piece_that_the_photo_does_not_have_stays() -> None:
    """The second camera is far off: nothing of the place is in its picture."""
    vertices, faces, view, pairs = noisy_place()
    away = look_at("b.jpg", (900.0, 60.0, 20.0), (900.0, 0.0, 20.1)).packed()
    swapped = np.where(view == 0, 1, view)  # everybody's neighbour has the photo from afar
    joined = join_small_charts(
        swapped.astype(np.int32), vertices, faces, pairs, np.stack([PACKED[0], away])
    )
    assert (joined == swapped).all()


def test_a_large_piece_that_no_photo_sees_stays() -> None:
    """Wholly folded over: beyond a few faces it is no noise, and keeps the vertex colours."""
    vertices, faces, view, pairs = noisy_place()
    middle = vertices[faces].mean(axis=1)
    under = (np.abs(middle[:, [0, 2]] - 20.0) < 5.0).all(axis=1)
    faces[under] = faces[under][:, ::-1]
    view = np.where(under, -1, 0).astype(np.int32)
    joined = join_small_charts(view, vertices, faces, pairs, PACKED)
    assert under.sum() > 32
    assert (joined == view).all()
