"""Equations (3.1) to (3.3) without Python's loops, against the formula written out."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.chunks import CHUNK
from terraport_pipeline.geometry.mesh.face_measures import face_centres
from terraport_pipeline.geometry.regions.colour import face_colour_sums, white_distance_of_sums
from terraport_pipeline.geometry.regions.similarity import similarity_index


def formula(vertices, faces, index, *, mu, tau, normalise, attribute_range, origin):
    """(3.2) and (3.3) over whole arrays."""
    index = index.astype(np.float64)
    if normalise == "minmax":
        span = index.max() - index.min()
        index = (index - index.min()) * (attribute_range / span if span else 0.0)
    elif normalise == "max":
        most = np.abs(index).max()
        index = index * (attribute_range / most if most else 0.0)
    centres = face_centres(vertices, faces)
    start = {
        "first": centres[0],
        "centroid": centres.mean(axis=0),
        "min_corner": centres.min(axis=0),
    }[origin]
    distance = np.linalg.norm(centres - start, axis=1)
    if distance.max() > 0:
        distance = distance / distance.max()
    return (mu * index + tau * distance).astype(np.float32)


@pytest.mark.parametrize("normalise", ["minmax", "max", "raw"])
@pytest.mark.parametrize("origin", ["min_corner", "first", "centroid"])
@pytest.mark.parametrize("kind", ["colour", "float32", "float64"])
def test_formula(terrain, kind, origin, normalise):
    mesh = terrain(3, cells=10, holes=0.1)
    rng = np.random.default_rng(3)
    options = {
        "mu": 0.8, "tau": 0.3, "normalise": normalise, "attribute_range": 1.7, "origin": origin,
    }  # fmt: skip
    scalar = None
    if kind == "colour":
        index = white_distance_of_sums(face_colour_sums(mesh.colours, mesh.faces), 3)
    else:
        index = scalar = rng.normal(-1.0, 3.0, len(mesh.faces)).astype(kind)
    similarity = similarity_index(
        mesh.vertices, mesh.faces, scalar=scalar,
        colours=mesh.colours if kind == "colour" else None, **options,
    )  # fmt: skip
    expected = formula(mesh.vertices, mesh.faces, index, **options)
    np.testing.assert_allclose(similarity, expected, rtol=3e-7, atol=1e-7)


@pytest.mark.parametrize("origin", ["min_corner", "first", "centroid"])
def test_threads_change_no_byte(terrain, origin):
    """More than one piece of faces."""
    mesh = terrain(1, cells=370)
    assert len(mesh.faces) > CHUNK
    options = {
        "colours": mesh.colours, "scalar": None, "mu": 1.0, "tau": 0.1, "normalise": "minmax",
        "attribute_range": 1.0, "origin": origin,
    }  # fmt: skip
    one_thread = similarity_index(mesh.vertices, mesh.faces, threads=1, **options)
    many_threads = similarity_index(mesh.vertices, mesh.faces, threads=2, **options)
    assert one_thread.tobytes() == many_threads.tobytes()


def test_constant_values_and_one_place():
    faces = np.array([[0, 1, 2], [2, 1, 0]])
    options = {"mu": 1.0, "tau": 0.1, "normalise": "minmax", "attribute_range": 1.0}
    for origin in ("first", "centroid", "min_corner"):
        similarity = similarity_index(
            np.ones((3, 3)), faces, colours=None, scalar=np.full(2, 7.0), origin=origin, **options
        )
        assert similarity.tolist() == [0.0, 0.0]
