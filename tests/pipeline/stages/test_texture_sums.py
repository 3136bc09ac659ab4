"""Sums of several pieces of a mesh are those of the whole."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.stages.atlas_maker import BakedAtlas
from terraport_pipeline.stages.texture_sums import TextureSums, TextureTally


def baked_atlas(count: int, rng: np.random.Generator) -> BakedAtlas:
    """A piece of so many faces of 1 to 2 m2, texels about 0.1 m; a third without a photo."""
    gsd_m = rng.uniform(0.05, 0.09, count)
    gsd_m[::3] = np.nan
    surface_m2 = rng.uniform(1.0, 2.0, count)
    return BakedAtlas(
        np.zeros((count, 3, 2), np.uint16), b"image", 64, 32, surface_m2,
        surface_m2 * rng.uniform(80.0, 120.0, count), gsd_m, *np.zeros((2, count), bool),
        np.array([9, 1, 30, 2, 5000], np.int32), np.where(np.isnan(gsd_m), -1, 2).astype(np.int32),
        0.5,
    )  # fmt: skip


def test_tallies_add_up() -> None:
    rng = np.random.default_rng(3)
    whole, tallies = TextureSums(900, 4), []
    for piece in range(3):
        atlas = baked_atlas(300, rng)
        sums = TextureSums(300, 4)
        sums.add(np.arange(300), atlas)
        tallies.append(sums.tally().arrays())
        whole.add(np.arange(300) + 300 * piece, atlas)
    facts = TextureTally.total(tallies).facts()
    exact = whole.facts(np.array([[64, 32]] * 3), 15)
    assert facts["texel_m"] == pytest.approx(exact["texel_m"], rel=0.006)
    assert facts["gsd_m"] == pytest.approx(exact["gsd_m"], rel=0.006)
    assert facts["unseen_share"] == pytest.approx(exact["unseen_share"], abs=1e-3)
    assert exact["charts"] == 15
    assert facts["faces_per_chart_p50"] == exact["faces_per_chart_p50"] == 9
    # The third of four photos shows what any photo shows; the others follow in their order.
    shares = TextureTally.total(tallies).photo_shares(["a", "b", "c", "d"])
    assert [name for name, _ in shares] == ["c", "a", "b", "d"]
    assert shares[0][1] == pytest.approx(1.0 - facts["unseen_share"], abs=1e-4)
    assert [share for _, share in shares[1:]] == [0.0, 0.0, 0.0]
    assert exact["cells_share"] == 0.5


def test_without_photos_there_is_no_pixel() -> None:
    sums = TextureSums(0)
    assert TextureTally.total([]).facts() == {
        "texel_m": None, "gsd_m": None, "unseen_share": 0.0, "crowded_share": 0.0
    }  # fmt: skip
    assert sums.tally().surface_m2 == 0.0
