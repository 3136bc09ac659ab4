"""Builds of two levels: the payloads of one, and the coarser ones behind them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.naming.recut import Cut, recut
from terraport_pipeline.naming.republish import republish
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.ground import read_ground
from terraport_pipeline.validate.handoff_report import HandOffOptions
from terraport_pipeline.validate.validation import ValidationOptions, validate
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene
from terraport_store.validate import validate_scene


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, make_hill_text: str) -> Path:
    """A survey, built at one level and at two."""
    folder = tmp_path_factory.mktemp("levels")
    (folder / "hill.xyz").write_text(make_hill_text, encoding="ascii")
    one = BuildOptions(
        folder / "hill.xyz",
        folder / "one",
        name="hill",
        work=folder / "work",
        reconstruct=reconstruct.Options(base_faces=800),
        segment=segment.Options(min_faces=150, max_faces=900),
    )
    build(one)
    build(replace(one, output=folder / "two", levels=2))
    return folder


def test_the_detail_is_the_same_and_coarser_payloads_follow(built: Path) -> None:
    assert validate_scene(built / "two") == []
    with Scene.open(built / "one") as one, Scene.open(built / "two") as two:
        count = len(one.index)
        assert (two.manifest.levels, len(two.rows)) == (2, 2 * count)
        assert "levels" not in one.manifest.build.options
        assert two.manifest.build.options["levels"] == 2
        np.testing.assert_array_equal(one.index.xxh3, two.index.xxh3)
        for key in ("base.tsg", "base.cover", "regions.json"):
            assert one.manifest.files[key].xxh3 == two.manifest.files[key].xxh3
        assert one.manifest.counts == two.manifest.counts
        coarse = two.rows.face_count[count:].sum() / two.index.face_count.sum()
        assert 0.15 < coarse < 0.5


def test_other_regions_keep_both_levels(built: Path, tmp_path: Path) -> None:
    """Of a segment whose regions change both payloads are written anew; of others neither."""
    shutil.copytree(built / "two", tmp_path / "two")
    with Scene.open(tmp_path / "two") as scene:
        ground = read_ground(scene, NullProgress())
        east = ground.centres[:, 0] > float(np.median(ground.centres[:, 0]))
        regions = np.where(east, ground.region_of_face, ground.region_of_face.max() + 1)
        before = scene.rows.xxh3.copy()
        done = republish(
            scene, ground, recut(ground, Cut(regions.astype(np.int32))), NullProgress()
        )
    assert validate_scene(tmp_path / "two") == []
    with Scene.open(tmp_path / "two") as scene:
        assert scene.manifest.levels == 2
        same = (scene.rows.xxh3 == before).reshape(2, -1)
    assert 0 < int(np.count_nonzero(~same[0])) == done.segments_changed < same.shape[1]
    assert not (same[0] & ~same[1]).any()


def test_validate_casts_rays_at_mixes_of_levels(built: Path) -> None:
    quick = ValidationOptions(HandOffOptions(20_000, 20))
    one, two = validate(built / "one", quick), validate(built / "two", quick)
    assert (one.levels, one.levels_not_run) == (None, "")
    assert two.levels is not None
    assert (two.levels.rays, two.levels.holes, two.levels.hole_places) == (20_000, 0, ())
    assert two.levels.hits > 15_000
    assert two.problems == 0
    unseen = validate(built / "two", ValidationOptions(None))
    assert (unseen.levels, unseen.levels_not_run) == (None, "left out")


@pytest.mark.parametrize("levels", [0, 3])
def test_levels_out_of_range(built: Path, levels: int) -> None:
    with pytest.raises(OptionError, match="levels"):
        BuildOptions(built / "hill.xyz", levels=levels)
