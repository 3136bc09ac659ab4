from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground

from terraport_pipeline.geometry.cover.face_cells import face_cells
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.photos.view_labels import (
    FaceNeighbours,
    chosen_views,
    energy,
    face_neighbours,
    label_faces,
    view_costs,
)


def noisy(cells: int = 24, views: int = 3, seed: int = 1):
    """A sheet whose best view changes from left to right, and noise."""
    vertices, faces = ground(cells)
    rng = np.random.default_rng(seed)
    along = vertices[faces].mean(axis=1)[:, 0] / 40.0
    view = np.full((len(faces), SLOTS), -1, np.int16)
    quality = np.zeros((len(faces), SLOTS), np.uint16)
    for v in range(views):
        view[:, v] = v
        good = 30_000 - 4000 * np.abs(along - (v + 0.5) / views)
        quality[:, v] = good + rng.normal(0, 800, len(faces))
    candidates = Candidates(view, quality, np.zeros((len(faces), SLOTS, 3), np.uint8))
    view_costs(candidates)
    pairs, edges = face_pairs(faces, len(vertices))
    return candidates, face_neighbours(vertices, faces, pairs, edges), vertices, faces


def test_costs_are_relative_to_the_best() -> None:
    view = np.array([[0, 2, 5, -1, -1, -1, -1, -1]], np.int16)
    quality = np.array([[4096, 8192, 6144, 0, 0, 0, 0, 0]], np.uint16)
    candidates = Candidates(view, quality, np.zeros((1, SLOTS, 3), np.uint8))
    view_costs(candidates)
    # a factor of two is 2048 steps: a quarter, the best, a half
    assert candidates.quality[0, :3].tolist() == [49151, 0, 32768]
    assert (candidates.quality[0, 3:] == 65535).all()


def test_without_smoothness_every_face_has_its_best() -> None:
    candidates, neighbours, vertices, faces = noisy()
    labelling = label_faces(
        candidates, neighbours, face_cells(vertices, faces, 16.0), smoothness=0.0
    )
    assert (labelling.slot == candidates.quality.argmin(axis=1)).all()
    assert len(labelling.energies) == 1


@pytest.mark.parametrize("smoothness", [0.3, 4.0])
def test_the_energy_never_rises_and_ends_below_iterated_modes(smoothness: float) -> None:
    candidates, neighbours, vertices, faces = noisy()
    cells = face_cells(vertices, faces, 8.0)
    labelling = label_faces(
        candidates, neighbours, cells, smoothness=smoothness, max_rounds=12, min_gain=0.0
    )
    assert (np.diff(labelling.energies) <= 1e-6 * labelling.energies[0]).all()
    assert labelling.energies[-1] == pytest.approx(
        brute_energy(candidates, neighbours, labelling.slot, smoothness), rel=1e-5
    )
    slot = candidates.quality.argmin(axis=1).astype(np.int8)
    for _ in range(5):
        iterate_modes(candidates, neighbours, slot, smoothness)
    assert labelling.energies[-1] < energy(candidates, neighbours, slot, smoothness=smoothness)


def brute_energy(
    candidates: Candidates, neighbours: FaceNeighbours, slot: np.ndarray, smoothness: float
) -> float:
    rows = np.arange(len(slot))
    data = (neighbours.area * candidates.quality[rows, slot] / 65535.0).sum()
    view = candidates.view[rows, slot]
    other = neighbours.face
    differs = (other >= 0) & (view[np.maximum(other, 0)] != view[:, None])
    return float(data + 0.5 * smoothness * (differs * neighbours.length).sum())


def iterate_modes(
    candidates: Candidates, neighbours: FaceNeighbours, slot: np.ndarray, smoothness: float
) -> None:
    for f in range(len(slot)):
        cost = neighbours.area[f] * candidates.quality[f, :3] / 65535.0
        for g, length in zip(neighbours.face[f], neighbours.length[f], strict=True):
            if g >= 0:
                cost = cost + smoothness * length * (np.arange(3) != slot[g])
        slot[f] = cost.argmin()


def test_a_chain_of_faces_is_solved_exactly() -> None:
    # a strip of faces is a tree: one round must find the best of all 2^n choices
    n = 9
    rng = np.random.default_rng(4)
    view = np.full((n, SLOTS), -1, np.int16)
    view[:, :2] = 0, 1
    cost = np.full((n, SLOTS), 65535, np.uint16)
    cost[:, :2] = rng.integers(0, 65535, (n, 2))
    neighbour = np.full((n, 3), -1, np.int32)
    neighbour[1:, 0] = np.arange(n - 1)
    neighbour[:-1, 1] = np.arange(1, n)
    row = FaceNeighbours(neighbour, (neighbour >= 0).astype(np.float32), np.ones(n, np.float32))
    candidates = Candidates(view, cost, np.zeros((n, SLOTS, 3), np.uint8))
    alone = (np.arange(n, dtype=np.int32), np.arange(n + 1))
    labelling = label_faces(candidates, row, alone, smoothness=0.4)
    choices = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    best = min(brute_energy(candidates, row, choice, 0.4) for choice in choices)
    assert labelling.energies[1] == pytest.approx(best, rel=1e-6)


def test_faces_without_views_stay_without() -> None:
    candidates, neighbours, vertices, faces = noisy()
    candidates.view[::3] = -1
    labelling = label_faces(
        candidates, neighbours, face_cells(vertices, faces, 16.0), smoothness=2.0
    )
    chosen = chosen_views(candidates, labelling.slot)
    assert (chosen[::3] == -1).all()
    assert (np.delete(chosen, np.s_[::3]) >= 0).all()


def test_threads_change_nothing() -> None:
    candidates, neighbours, vertices, faces = noisy(cells=40)
    cells = face_cells(vertices, faces, 16.0)
    one_thread, two_threads = (
        label_faces(candidates, neighbours, cells, smoothness=1.0, threads=threads)
        for threads in (1, 2)
    )
    assert (one_thread.slot == two_threads.slot).all()
    assert one_thread.energies == two_threads.energies
