"""The true surface as a mesh with material: what is seen, what it looks like, what it ignores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh

CLEAN = QuarryOptions(seed=2, size_m=120.0, colour_noise=0.0, shadows=0.0)
EDGE_M = 2.0


@pytest.fixture(scope="module")
def clean():
    """A small quarry in even light."""
    return truth_mesh(CLEAN, EDGE_M)


def test_mesh_is_whole(clean):
    """Every vertex is used, no edge is too long, x east and y up span the site."""
    corners = clean.vertices[clean.faces]
    edges = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    assert edges.max() <= EDGE_M * 1.001
    assert np.array_equal(np.unique(clean.faces), np.arange(len(clean.vertices)))
    span = np.ptp(clean.vertices, axis=0)
    assert span[0] == pytest.approx(120.0, rel=0.05)
    assert span[2] == pytest.approx(120.0 * 8 / 9, rel=0.05)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.median(normal[clean.material == Material.WATER, 1]) > 0  # up is +y


def test_every_material_but_the_stray_point_occurs(clean):
    """The truth names what the cloud names."""
    assert set(np.unique(clean.material)) == {int(m) for m in Material} - {int(Material.OUTLIER)}


def test_same_options_same_bytes_and_light_changes_colours_only(clean):
    """Noise, shadows, contrast and texture leave geometry and truth alone."""
    again = truth_mesh(CLEAN, EDGE_M)
    assert again.colours.tobytes() == clean.colours.tobytes()
    for change in ({"colour_noise": 9.0}, {"shadows": 0.6}, {"contrast": 0.5}, {"texture": 0.0}):
        other = truth_mesh(replace(CLEAN, **change), EDGE_M)
        assert other.vertices.tobytes() == clean.vertices.tobytes()
        assert other.faces.tobytes() == clean.faces.tobytes()
        assert other.material.tobytes() == clean.material.tobytes()
        assert other.colours.tobytes() != clean.colours.tobytes()


def test_without_contrast_and_texture_all_is_one_colour():
    """What is left is nothing; without texture alone, one colour for each material."""
    grey = truth_mesh(replace(CLEAN, contrast=0.0, texture=0.0), EDGE_M)
    assert len(np.unique(grey.colours, axis=0)) == 1
    flat = truth_mesh(replace(CLEAN, texture=0.0), EDGE_M)
    assert len(np.unique(flat.colours, axis=0)) <= len(Material)


def test_shadows_darken(clean):
    """Light never adds."""
    dark = truth_mesh(replace(CLEAN, shadows=0.6), EDGE_M)
    assert (dark.colours <= clean.colours).all()
    assert dark.colours.mean() < 0.9 * clean.colours.mean()
