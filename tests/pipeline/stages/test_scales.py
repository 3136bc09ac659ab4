"""What is decided for a scene and its later versions, and when it has to be decided anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coloured_ground import ground

from terraport_payload import AttributeScale
from terraport_payload.grid import encode_attribute
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.tiles.tile_seams import Seams
from terraport_pipeline.stages.contract import Facts
from terraport_pipeline.stages.tiles import base_cover, scene_facts, tiled_pack
from terraport_pipeline.stages.tiles.base_cover import CoverScale, NearBase
from terraport_pipeline.stages.tiles.scene_facts import AttributeRange, SceneScale, TiledScene
from terraport_pipeline.stages.tiles.tiled_pack import Extents, Scales, scales_of

NO_SEAMS = Seams(np.zeros((0, 2), np.int32), np.zeros((0, 2), np.int32), np.zeros(0))
EXTENTS = Extents(30.0, 400.0, 0.1, {"grade": AttributeRange(0.5, 9.25, 0.5)})


def scene(faces: int = 1000, *, longest_m: float = 2.0, grey: bool = False) -> TiledScene:
    colours = np.zeros((faces, 3), np.int32)
    if not grey:
        colours[::2] = 300
    return TiledScene(
        (faces,), faces // 2, float(faces), np.zeros(3), np.full(3, 40.0), NO_SEAMS, {},
        ColourTotals.of(colours), longest_m, (1.0,),
    )  # fmt: skip


def test_the_scale_of_a_scene_comes_back_as_it_was() -> None:
    scale = SceneScale.decide(scene(), None, 500)
    stored = scene_facts.SCALE_FORM.store(scale)
    back = scene_facts.SCALE_FORM.restore(stored, Facts())
    assert scene_facts.SCALE_FORM.store(back).values == stored.values
    assert back.colours.spread(np.ones(3)) == scale.colours.spread(np.ones(3))
    assert scale.max_extent_m == pytest.approx(1.2 * np.sqrt(500))
    assert SceneScale.decide(scene(), 7.0, 500).max_extent_m == 7.0


@pytest.mark.parametrize(
    ("after", "stands"),
    [
        (scene(), True),
        (scene(7000), True),
        (scene(9000), False),  # eight times the ground is another scene
        (scene(100), False),
        (scene(longest_m=2000.0), True),  # lengths are steps of it: longer ones are more steps
        (scene(longest_m=2100.0), False),
        (scene(grey=True), False),
    ],
)
def test_a_scale_stands_as_long_as_the_scene_is_about_the_same(
    after: TiledScene, *, stands: bool
) -> None:
    assert SceneScale.decide(scene(), None, 500).stands(after) == stands


def test_a_grey_scene_that_gets_colours_is_told_apart_anew() -> None:
    grey = SceneScale.decide(scene(grey=True), None, 500)
    assert grey.stands(scene(grey=True))
    assert not grey.stands(scene())


@pytest.mark.parametrize(
    ("tolerance_m", "edge_m", "stands"),
    [
        (0.4, 2.0, True), (0.5, 2.0, True), (0.51, 2.0, False), (0.2, 2.0, True),
        (0.19, 2.0, False), (0.4, 4.0, True), (0.4, 4.1, False), (0.4, 0.9, False),
    ],
)  # fmt: skip
def test_a_covers_scale_stands_within_its_margins(
    tolerance_m: float, edge_m: float, *, stands: bool
) -> None:
    assert CoverScale(0.4, 2.0).stands(CoverScale(tolerance_m, edge_m)) == stands


def test_the_base_near_a_tile_does_not_depend_on_the_base_elsewhere() -> None:
    base = ground(20, low=0.0, high=100.0)
    boxes = [np.array([0.0, -9, 0, 10, 9, 10]), np.array([80.0, -9, 80, 100, 9, 100])]
    scale = CoverScale(0.1, 5.0)
    near = NearBase.of(base, boxes, (1.0, 1.0), scale)
    vertices, faces = near.piece(0)
    assert (vertices[faces] == base.vertices[base.faces[near.rows[0]]]).all()
    assert len(vertices) < len(base.vertices) / 4
    # Other faces elsewhere: other numbers of the base's faces, the same piece.
    fewer = replace(base, faces=np.delete(base.faces, near.rows[1], axis=0))
    after = NearBase.of(fewer, boxes, (1.0, 1.0), scale)
    assert after.digest(0) == near.digest(0)
    assert after.digest(1) != near.digest(1)
    assert base_cover.SCALE_FORM.restore(base_cover.SCALE_FORM.store(scale), Facts()) == scale


def test_the_scales_of_payloads_come_back_as_they_were() -> None:
    scales = scales_of(EXTENTS)
    form = tiled_pack.SCALES_FORM
    assert form.restore(form.store(scales), Facts()) == scales
    assert scales.stands(EXTENTS)


@pytest.mark.parametrize(
    ("after", "stands"),
    [
        (replace(EXTENTS, spacing_m=1.0), True),
        (replace(EXTENTS, widest_m=60.0), True),
        (replace(EXTENTS, widest_m=300.0), False),
        (replace(EXTENTS, farthest_m=50_000.0), False),
        (replace(EXTENTS, ranges={}), False),
        (replace(EXTENTS, ranges={"grade": AttributeRange(2.0, 8.0, 2.5)}), True),
        (replace(EXTENTS, ranges={"grade": AttributeRange(1.0, 0.0, None)}), True),
        (replace(EXTENTS, ranges={"grade": AttributeRange(0.4, 9.0, 0.4)}), False),
        (replace(EXTENTS, ranges={"grade": AttributeRange(0.5, 9.3, 0.5)}), False),
        (replace(EXTENTS, ranges={"grade": AttributeRange(0.5, 0.6, 0.5)}), False),  # 84 times
    ],
)
def test_a_grid_stands_as_long_as_all_fits_into_it(after: Extents, *, stands: bool) -> None:
    assert scales_of(EXTENTS).stands(after) == stands


def test_whole_numbers_are_not_rounded_to_when_fractions_come() -> None:
    classes = {"class": AttributeRange(1.0, 9.0, None)}
    scales = scales_of(replace(EXTENTS, ranges=classes))
    assert scales.attributes["class"] == AttributeScale(1.0, 1.0)
    more = {"class": AttributeRange(1.0, 60_000.0, None)}
    assert scales.stands(replace(EXTENTS, ranges=more))
    broken = {"class": AttributeRange(1.0, 60_000.0, 2.5)}
    assert not scales.stands(replace(EXTENTS, ranges=broken))


@pytest.mark.parametrize("seed", range(20))
def test_what_stands_can_be_encoded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = np.float32(rng.normal(rng.uniform(-1e3, 1e3), 10.0 ** rng.uniform(-3, 3), 50))
    scales = scales_of(replace(EXTENTS, ranges={"a": AttributeRange.of(values)}))
    other = np.float32(values[:40] + rng.uniform(-1, 1) * np.ptp(values) * 1e-5)
    after = replace(EXTENTS, ranges={"a": AttributeRange.of(other)})
    assert scales.stands(replace(EXTENTS, ranges={"a": AttributeRange.of(values)}))
    if Scales(scales.step_m, scales.attributes).stands(after):
        codes = encode_attribute(other, scales.attributes["a"])
        back = scales.attributes["a"].offset + scales.attributes["a"].step * codes
        assert np.abs(back - other).max() <= 0.51 * scales.attributes["a"].step + 1e-6
