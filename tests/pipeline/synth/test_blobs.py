from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.blobs import BUSH, ROCK, TREE
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.surface import Surface
from terraport_pipeline.synth.triangulate import icosphere


def surface() -> Surface:
    return Surface(QuarryOptions(seed=7))


def test_as_many_bodies_as_asked_for_on_dry_ground() -> None:
    site = surface()
    kinds = site.blobs.kind
    assert [int((kinds == kind).sum()) for kind in (ROCK, TREE, BUSH)] == [120, 70, 160]
    places = site.blobs.centres
    ground = site.terrain.sample(places[:, 0].copy(), places[:, 1].copy())
    assert (ground.water == 0).all()
    assert (ground.road < 0.01).all()
    assert (ground.inside[kinds != ROCK] < 0).all()  # plants grow on the plateau


def test_the_surface_bounds_the_inside() -> None:
    blobs = surface().blobs
    unit, _ = icosphere(1)
    for body in range(0, len(blobs.kind), 13):
        which = np.full(len(unit), body)
        shell = blobs.positions(which, unit)
        centre = blobs.centres[body]
        assert blobs.contain(centre + 0.98 * (shell - centre), which).all()
        assert not blobs.contain(centre + 1.02 * (shell - centre), which).any()


def test_normals_are_unit_and_outward() -> None:
    blobs = surface().blobs
    unit, _ = icosphere(1)
    for body in range(0, len(blobs.kind), 13):
        which = np.full(len(unit), body)
        normals = blobs.normals(which, unit)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        out = blobs.positions(which, unit) - blobs.centres[body]
        assert (np.einsum("ij,ij->i", normals, out) > 0).all()


def test_none_of_them_is_fine() -> None:
    assert len(Surface(QuarryOptions(seed=1, rocks=0, trees=0, bushes=0)).blobs.kind) == 0
