from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.appearance import Sunlight, grade
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import Quarry
from terraport_pipeline.synth.surface import Surface


def test_the_grade_is_smooth_and_within_its_range() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform([-180, -160, -50], [180, 160, 15], (50_000, 3))
    values = grade(places)
    assert values.dtype == np.float32
    assert values.min() >= 0.2
    assert values.max() < 4.3
    step = rng.normal(size=places.shape)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    assert np.abs(grade(places + 0.1 * step) - values).max() < 0.25 * 0.1


def test_materials_look_like_themselves(clean_quarry: Quarry) -> None:
    colours = clean_quarry.survey.colours
    assert colours is not None

    def mean(material: Material) -> np.ndarray:
        return colours[clean_quarry.material == material].mean(axis=0)

    red, green, blue = mean(Material.TREE)
    assert green > red > blue
    red, green, blue = mean(Material.ORE_PILE)
    assert red > 1.4 * green > 1.4 * blue
    assert mean(Material.LIMESTONE_PILE).min() > mean(Material.OVERBURDEN_PILE).max()
    red, _, blue = mean(Material.WATER)
    assert blue > red


def test_light_is_between_dark_and_full_and_shadows_are_cast() -> None:
    site = Surface(QuarryOptions(seed=7))
    rng = np.random.default_rng(0)
    triangle = rng.choice(len(site.triangle_areas), 20_000)
    points = site.evaluate(triangle, rng.uniform(size=(20_000, 2)))
    light = Sunlight(site)(points)
    assert light.min() >= 0.0
    assert light.max() <= 1.0 + 1e-9
    # Level ground in the shade of a wall gets only the sky's light.
    level = (points.normals[:, 2] > 0.97) & (points.inside > 5)
    assert (light[level] < 0.25).any()
    assert (light[level] > 0.75).any()
