from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.clip import clip_with_sources

SQUARE = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]], np.float32)
TWO = np.array([[0, 1, 2], [2, 1, 3]], np.int32)


def clip(
    vertices: np.ndarray, faces: np.ndarray, field: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    result = clip_with_sources(vertices, faces, field)
    return result.vertices, result.faces


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    return float(0.5 * np.cross(b - a, c - a)[:, 1].sum())


@pytest.mark.parametrize("cut", [0.25, 0.5, 0.75])
def test_the_cut_follows_the_zero_line(cut: float) -> None:
    vertices, faces = clip(SQUARE, TWO, np.float32(cut) - SQUARE[:, 0])
    assert vertices[:, 0].max() == pytest.approx(cut)
    assert area(vertices, faces) == pytest.approx(cut, abs=1e-6)  # wound as before: not negative
    assert faces.max() == len(vertices) - 1


def test_all_or_nothing_stays_as_it_is() -> None:
    vertices, faces = clip(SQUARE, TWO, np.ones(4, np.float32))
    assert vertices.tobytes() == SQUARE.tobytes()
    assert faces.tobytes() == TWO.tobytes()
    vertices, faces = clip(SQUARE, TWO, np.full(4, np.nan, np.float32))
    assert vertices.shape == (0, 3)
    assert faces.shape == (0, 3)


def test_a_cut_near_a_vertex_goes_through_it() -> None:
    vertices, faces = clip(SQUARE, TWO, np.float32(0.05) - SQUARE[:, 0])
    assert len(faces) == 0  # a sliver of a twentieth is none
    vertices, faces = clip(SQUARE, TWO, SQUARE[:, 0] - np.float32(0.95))
    assert len(vertices) == len(faces) == 0


def test_two_pieces_cut_their_shared_edge_alike() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        vertices = rng.normal(size=(4, 3)).astype(np.float32)
        field = rng.normal(size=4).astype(np.float32)
        if (field[1] < 0) == (field[2] < 0):
            continue
        first, _ = clip(vertices[[0, 1, 2]], np.array([[0, 1, 2]], np.int32), field[:3])
        order = [3, 2, 1]  # the same edge, its ends the other way round
        second, _ = clip(vertices[order], np.array([[0, 1, 2]], np.int32), field[order])
        shared = {row.tobytes() for row in first} & {row.tobytes() for row in second}
        # The end that stays and the cut; one alone where a piece has nothing else left.
        assert len(shared) == 2 or not len(first) or not len(second)


def test_inputs_may_be_read_only() -> None:
    field = np.float32(0.5) - SQUARE[:, 0]
    for array in (SQUARE, TWO, field):
        array.flags.writeable = False
    clip(SQUARE, TWO, field)


def test_every_vertex_names_its_edge_and_how_far_along_it_lies() -> None:
    result = clip_with_sources(SQUARE, TWO, np.float32(0.5) - SQUARE[:, 0])
    for vertex, (first, second), share in zip(
        result.vertices, result.ends, result.share, strict=True
    ):
        between = SQUARE[first] + share * (SQUARE[second] - SQUARE[first])
        np.testing.assert_allclose(vertex, between, atol=1e-6)
    stayed = result.ends[:, 0] == result.ends[:, 1]
    assert stayed.tolist() == (result.share == 0).tolist() == [True, True, False, False, False]
