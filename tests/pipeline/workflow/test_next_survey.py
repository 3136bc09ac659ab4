"""The next survey over a scene of several tiles, whole: what did not change stays, bit by bit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, tile_shape
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions
from terraport_pipeline.workflow import reconstruct_step, tile_ground
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.workflow.workdir import StageRecord, WorkDirectory
from terraport_store import Scene
from terraport_store.validate import validate_scene

QUARRY = QuarryOptions(points=16_000, seed=4, size_m=160.0)


@dataclass(frozen=True)
class Published:
    """A scene in a folder of its own, with its work directory."""

    scene: Path

    @property
    def work(self) -> WorkDirectory:
        return WorkDirectory(default_work_directory(self.scene))

    def segments(self) -> dict[int, int]:
        """Hash by id."""
        with Scene.open(self.scene) as opened:
            return dict(enumerate(opened.index.xxh3.tolist()))

    def records(self, stage: str) -> dict[str, StageRecord]:
        records = {name: self.work.latest(name) for name in self.work.names(f"{stage}-")}
        return {name: record for name, record in records.items() if record is not None}

    def copied(self, folder: Path) -> Published:
        shutil.copytree(self.scene.parent, folder, symlinks=True, dirs_exist_ok=True)
        return Published(folder / self.scene.name)


def build_over(scene: Path, survey: Path) -> Published:
    build(
        BuildOptions(
            survey, scene, tiles=TileOptions(depth=7), threads=1,
            reconstruct=reconstruct.Options(base_faces=3_000, island_faces=50),
            segment=segment.Options(min_faces=150, max_faces=900),
        )
    )  # fmt: skip
    return Published(scene)


@pytest.fixture(scope="module")
def small_tiles() -> Iterator[None]:
    """Tiles of 128 cells with a core of 88, instead of the 512 and more of real ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tile_ground, "tile_shape", lambda depth: tile_shape(depth, 12.0))
        patch.setattr(reconstruct_step, "TilePool", lambda _, cluster: TilePool(0, cluster))
        yield


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("survey") / "quarry.las"
    write_quarry(QUARRY, path)
    return path


@pytest.fixture(scope="module")
def first(survey: Path, small_tiles: None, tmp_path_factory: pytest.TempPathFactory) -> Published:
    return build_over(tmp_path_factory.mktemp("first") / "scene", survey)


def plan_of(published: Published) -> TilePlan:
    plan, frame = (published.work.latest(name) for name in ("plan", "frame"))
    assert plan is not None
    assert frame is not None
    lattice = Lattice(tuple(frame.values["anchor_m"]), frame.values["cell_m"])
    indices = np.array(plan.values["tiles"])
    return TilePlan(
        lattice, tile_ground.tile_shape(plan.values["depth"]), tuple(plan.values["offset"]),
        indices, np.zeros(len(indices), np.int64),
    )  # fmt: skip


def dig(survey: Path, published: Published, target: Path) -> int:
    """Dig a pit into the fullest tile, near the middle of its ground; return the tile's number."""
    plan = plan_of(published)
    frame = published.work.latest("frame")
    assert frame is not None
    las = laspy.read(survey)
    local = np.array(las.xyz) - np.array(frame.values["origin"])
    scene = np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1)
    cells = plan.lattice.cells(scene)
    inside = [
        ((cells >= low) & (cells < high)).all(axis=1)
        for low, high in (plan.core(tile) for tile in range(plan.count))
    ]
    tile = int(np.argmax([mine.sum() for mine in inside]))
    middle = np.median(scene[inside[tile]], axis=0)
    pit_m = 0.08 * plan.shape.core * plan.lattice.cell_m
    reach = np.hypot(*(scene - middle)[:, [0, 2]].T) / pit_m
    deeper = inside[tile] & (reach < 1)
    assert deeper.sum() > 100
    las.z = np.array(las.z) - np.where(deeper, 2.0 * (1 - reach**2), 0)
    las.write(target)
    return tile


def test_a_pit_in_one_tile_changes_that_tile_alone(
    survey: Path, first: Published, tmp_path: Path
) -> None:
    tile = dig(survey, first, tmp_path / "pit.las")
    second = build_over(first.copied(tmp_path / "second").scene, tmp_path / "pit.las")
    for stage in ("solve", "look", "tile", "segment-units", "pack-tile"):
        before, now = first.records(stage), second.records(stage)
        assert len(before) >= 4
        assert before.keys() == now.keys()
        changed = {name for name in now if now[name].digest != before[name].digest}
        assert changed == {f"{stage}-{tile:05d}"}
    kept = first.segments().items() & second.segments().items()
    with Scene.open(first.scene) as opened:
        mine = opened.index
    changed_segments = len(mine.xxh3) - len(kept)
    assert 0 < changed_segments < len(mine.xxh3) / 2
    # Whole at the walls of what was kept and what is new.
    settled = second.work.latest("settle")
    assert settled is not None
    assert settled.facts.counts["seam_cracks"] == 0
    assert validate_scene(second.scene) == []
    with Scene.open(second.scene) as opened:
        report = check_hand_off(
            load_scene_model(opened).hand_off_model(), HandOffOptions(20_000, 20)
        )
    assert report.holes == 0


def test_back_again_is_whole_and_keeps_the_others(
    survey: Path, first: Published, tmp_path: Path
) -> None:
    tile = dig(survey, first, tmp_path / "pit.las")
    scene = first.copied(tmp_path / "again").scene
    build_over(scene, tmp_path / "pit.las")
    before = first.records("solve")
    now = build_over(scene, survey).records("solve")
    assert {name for name in now if now[name].digest != before[name].digest} <= {
        f"solve-{tile:05d}"
    }
    assert validate_scene(scene) == []


def test_the_same_ground_flown_again_keeps_every_byte(first: Published, tmp_path: Path) -> None:
    """Another sample, three centimetres of noise, three per cent more red."""
    again = tmp_path / "again.las"
    write_quarry(replace(QUARRY, sample_seed=9), again)
    las = laspy.read(again)
    rng = np.random.default_rng(5)
    las.xyz = np.array(las.xyz) + rng.normal(0.0, 0.03, (len(las), 3))
    las.red = np.minimum(np.array(las.red) * 1.03, 65535).astype(np.uint16)
    las.write(again)
    second = build_over(first.copied(tmp_path / "second").scene, again)
    assert second.segments() == first.segments()
    with Scene.open(first.scene) as one, Scene.open(second.scene) as other:
        assert [row["stable_id"] for row in one.regions["regions"]] == [
            row["stable_id"] for row in other.regions["regions"]
        ]
