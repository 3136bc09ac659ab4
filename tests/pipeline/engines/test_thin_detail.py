from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines import thin_detail as module
from terraport_pipeline.engines.thin_detail import thin_detail
from terraport_pipeline.errors import EngineError
from terraport_pipeline.geometry.mesh.border_edges import border_edges
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh


def hills(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A round piece of ground, cut out by whole cells: its border has teeth."""
    x, z = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    height = 3 * np.sin(x / 9) + 2 * np.cos(z / 7)
    vertices = np.stack([x.ravel(), height.ravel(), z.ravel()], axis=1).astype(np.float32)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    first = np.stack([corner, corner + side + 1, corner + 1], axis=1)
    second = np.stack([corner + 1, corner + side + 1, corner + side + 2], axis=1)
    faces = np.concatenate([first, second])
    centre = vertices[faces].mean(axis=1)[:, ::2] - side / 2
    return vertices, faces[np.hypot(*centre.T) < 0.45 * side].astype(np.int32)


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    return hills(120)


def test_the_result_is_near_small_and_has_a_thinner_border(
    ground: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    vertices, faces = ground
    monkeypatch.setattr(module, "_BLOCK_FACES", 8000)
    results = [thin_detail(vertices, faces, max_faces=1500, threads=threads) for threads in (1, 2)]
    thin, left = results[0]
    assert thin.tobytes() == results[1][0].tobytes()
    assert left.tobytes() == results[1][1].tobytes()
    assert 1000 < len(left) < 1800
    assert len(border_edges(left, len(thin))) < 0.7 * len(border_edges(faces, len(vertices)))
    used = vertices[np.unique(faces)]
    assert np.percentile(distances_to_mesh(used, thin, left), 99) < 0.5
    assert len(np.unique(left)) == len(thin)


def test_a_small_surface_stays_as_it_is(ground: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = thin_detail(*ground, max_faces=10**6)
    assert vertices is ground[0]
    assert faces is ground[1]


def test_a_failing_child_is_told(
    ground: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_FIRST_AGGRESSION", "nonsense")
    with pytest.raises(EngineError, match="exit code 1; it printed"):
        thin_detail(*ground, max_faces=500)
