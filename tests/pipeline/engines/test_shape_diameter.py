"""Shape diameters of bodies whose thickness is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from terraport_pipeline.engines.shape_diameter import shape_diameter

pytest.importorskip("embreex")


def arrays(mesh):
    return mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)


def test_sphere_is_as_thick_everywhere():
    vertices, faces = arrays(trimesh.creation.icosphere(subdivisions=3, radius=2.0))
    diameter = shape_diameter(vertices, faces)
    assert np.isfinite(diameter).all()
    # a chord at 35 degrees to the axis has 0.82 of the diameter: the mean lies between
    assert 0.8 * 4.0 < diameter.mean() < 4.0
    assert diameter.std() < 0.02 * diameter.mean()


def test_thin_plate_is_thin():
    thin = trimesh.creation.box(extents=(1.0, 1.0, 0.02)).subdivide_to_size(0.2)
    thick = trimesh.creation.box(extents=(1.0, 1.0, 1.0)).subdivide_to_size(0.2)
    a, b = (np.median(shape_diameter(*arrays(mesh))) for mesh in (thin, thick))
    assert 0.02 <= a < 0.05
    assert b > 20 * a


def test_open_ground_has_no_diameter():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    assert np.isnan(shape_diameter(vertices, np.array([[0, 2, 1]], np.int32))).all()


def test_faces_without_area_have_no_diameter():
    vertices, faces = arrays(trimesh.creation.icosphere(subdivisions=1))
    flat = np.concatenate([faces, [[0, 0, 1]]]).astype(np.int32)
    diameter = shape_diameter(vertices, flat)
    assert np.isnan(diameter[-1])
    assert np.isfinite(diameter[:-1]).all()


def test_threads_change_nothing():
    vertices, faces = arrays(trimesh.creation.torus(2.0, 0.5))
    one_thread, two_threads = (shape_diameter(vertices, faces, threads=n) for n in (1, 2))
    assert one_thread.tobytes() == two_threads.tobytes()


def test_no_faces():
    assert len(shape_diameter(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))) == 0
