from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.cover.uncovered import uncovered_faces

SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 4], [0, 0, 4]], np.float32)
HALVES = np.array([[0, 2, 1], [0, 3, 2]], np.int32)


def grid(cells: int, size_m: float, *, height_m: float = 0.0) -> tuple[Float32, Int32]:
    """A square of the plane in 2 x cells^2 faces that look up."""
    axis = np.linspace(0, size_m, cells + 1)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x, np.full_like(x, height_m), z], -1).reshape(-1, 3).astype(np.float32)
    at = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return vertices, faces.astype(np.int32)


def by_samples(vertices: Float32, faces: Int32, cover: tuple[Float32, Int32]) -> np.ndarray:
    """The model: a lattice of points inside every face, each looked for in every cover face."""
    steps = 12
    shares = np.array([(i + 1 / 3, j + 1 / 3) for i in range(steps) for j in range(steps - i)]) / (
        steps + 1
    )
    plan, corners = vertices[:, ::2].astype(float), cover[0][:, ::2].astype(float)[cover[1]]
    uncovered = np.zeros(len(faces), bool)
    for f, (a, b, c) in enumerate(plan[faces]):
        points = a + shares[:, :1] * (b - a) + shares[:, 1:] * (c - a)
        inside = np.zeros(len(points), bool)
        for p, q, r in corners:
            sides = np.stack([_side(points, p, q), _side(points, q, r), _side(points, r, p)])
            inside |= (sides >= -1e-9).all(axis=0) | (sides <= 1e-9).all(axis=0)
        uncovered[f] = not inside.all()
    return uncovered


def _side(points: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    along = stop - start
    return along[0] * (points[:, 1] - start[1]) - along[1] * (points[:, 0] - start[0])


def test_a_finer_surface_on_the_same_square_is_covered_at_any_height() -> None:
    vertices, faces = grid(9, 4.0, height_m=30.0)
    assert not uncovered_faces(vertices, faces, SQUARE, HALVES).any()


@pytest.mark.parametrize("turned", [False, True])
def test_which_way_the_cover_looks_does_not_matter(turned: bool) -> None:
    vertices, faces = grid(4, 4.0)
    cover = HALVES[:, ::-1].copy() if turned else HALVES
    assert not uncovered_faces(vertices, faces, SQUARE, cover).any()
    bare = uncovered_faces(vertices, faces, SQUARE, cover[:1])
    centre = vertices[faces].mean(axis=1)
    assert (bare == (centre[:, 2] > centre[:, 0])).all()


def test_a_slit_narrower_than_any_face_is_found() -> None:
    """Both borders of the slit pass through the same faces: no corner of them is uncovered."""
    left = SQUARE * np.float32([0.5, 1, 1]) - np.float32([0.001, 0, 0])
    right = SQUARE * np.float32([0.5, 1, 1]) + np.float32([2.001, 0, 0])
    cover = np.concatenate([left, right]), np.concatenate([HALVES, HALVES + 4]).astype(np.int32)
    vertices, faces = grid(3, 3.9)  # no line of the grid runs along the slit
    bare = uncovered_faces(vertices, faces, *cover)
    x = vertices[faces][:, :, 0]
    outside = (x.min(axis=1) < -0.001) | (x.max(axis=1) > 4.0)
    assert (bare == ((x.min(axis=1) < 2.0) & (x.max(axis=1) > 2.0)) | outside).all()


def test_a_fold_ends_the_cover_as_a_border_does() -> None:
    """A sheet that comes back under itself covers up to its fold; the fold has two faces."""
    vertices = np.array(
        [[0, 1, 0], [2, 1, 0], [2, 1, 4], [0, 1, 4], [0, 0, 0], [0, 0, 4]], np.float32
    )
    folded = np.array([[0, 2, 1], [0, 3, 2], [1, 2, 4], [2, 5, 4]], np.int32)
    fine, faces = grid(5, 4.0)
    bare = uncovered_faces(fine, faces, vertices, folded)
    assert (bare == (fine[faces][:, :, 0].max(axis=1) > 2.0)).all()


def test_walls_and_faces_without_area_are_left_to_their_neighbours() -> None:
    wall = np.array([[9, 0, 0], [9, 5, 0], [9, 0, 3]], np.float32)
    assert not uncovered_faces(
        wall, np.array([[0, 1, 2], [0, 0, 1]], np.int32), SQUARE, HALVES
    ).any()


def test_without_any_cover_all_is_bare() -> None:
    none = np.zeros((0, 3), np.int32)
    assert uncovered_faces(SQUARE, HALVES, SQUARE, none).tolist() == [True, True]
    assert uncovered_faces(SQUARE, none, SQUARE, HALVES).tolist() == []


@given(st.integers(0, 10**6))
@settings(max_examples=60)
def test_equals_the_model_on_crumpled_sheets(seed: int) -> None:
    """Sheets with folds, borders and holes; inputs stay as they are, threads change nothing."""
    rng = np.random.default_rng(seed)
    cover_vertices, cover_faces = grid(4, 4.0)
    cover_vertices = (cover_vertices + rng.uniform(-0.9, 0.9, cover_vertices.shape)).astype(
        np.float32
    )
    cover_faces = cover_faces[rng.random(len(cover_faces)) < 0.9]
    vertices, faces = grid(5, 4.0)
    vertices = (vertices + rng.uniform(-0.3, 0.3, vertices.shape)).astype(np.float32)
    for array in (vertices, faces, cover_vertices, cover_faces):
        array.flags.writeable = False
    bare = uncovered_faces(vertices, faces, cover_vertices, cover_faces)
    assert (bare == uncovered_faces(vertices, faces, cover_vertices, cover_faces, threads=2)).all()
    model = by_samples(vertices, faces, (cover_vertices, cover_faces))
    # What a sample finds bare is bare; the test finds smaller gaps than the samples do.
    assert not (model & ~bare).any()
    closer = bare & ~model
    assert closer.sum() <= 0.2 * len(faces)
