"""The next survey over nine tiles, from the finished tiles on: what did not change stays.

One tile changes, and nothing that is computed of the others is computed again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from coloured_ground import cut_mesh, ground
from memory_tiles import MemoryTiles
from pipeline.one_piece import runner_in, surface_in_tiles

from terraport_payload import SegmentMesh
from terraport_payload.types import Bool
from terraport_pipeline.geometry.clouds.change_raster import ChangeRaster
from terraport_pipeline.geometry.clouds.height_changes import HeightChanges
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.model import Mesh
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.options import regions as segment
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import pack
from terraport_pipeline.stages.survey_change import SurveyChange
from terraport_pipeline.workflow.before import find_before
from terraport_pipeline.workflow.pack_step import publish_tiles
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_store import BuildInfo, InputInfo, Scene, read_manifest
from terraport_store.validate import validate_scene

# Engine borders heeds what stood before, so its regions do not go back to what they once were.
SEGMENT = segment.Options(engine="means", min_faces=150, max_faces=900)
PASSES = ("segment-measure", "segment-units", "segment-cut", "segment-cover", "pack-tile")
LATTICE = Lattice((0.0, 0.0, 0.0), 0.25)
DEVIATION_M = (0.1, 0.2, 0.5, 0.6)


@dataclass(frozen=True)
class Version:
    """What a client would hold of a published scene."""

    hashes: list[int]
    """By segment."""
    tiles: list[int]
    """Tile of every segment, by its middle."""
    regions: list[dict]


def surface_of(detail: Mesh, base: Mesh | None = None) -> Surface:
    return surface_in_tiles(base or ground(16, low=-3.0, high=63.0), detail, DEVIATION_M, along=3)


def within(detail: Mesh, *, low: float, high: float) -> Bool:
    x, _, z = detail.vertices.T
    return (x > low) & (x < high) & (z > low) & (z < high)


def with_pit(detail: Mesh, *, depth_m: float = 0.5, low: float = 24.0, high: float = 36.0) -> Mesh:
    """Dig into the tile in the middle, which is 20 m to 40 m."""
    inside = within(detail, low=low, high=high)
    vertices = detail.vertices.copy()
    vertices[inside, 1] *= np.float32(1.0 - depth_m)
    return replace(detail, vertices=vertices, attributes={"height": vertices[:, 1].copy()})


def with_pile(detail: Mesh) -> Mesh:
    """Put a yellow pile into the middle of the tile."""
    inside = within(detail, low=25.0, high=35.0)
    colours = np.where(inside[:, None], np.uint8([220, 220, 40]), detail.colours)
    return replace(detail, colours=colours)


def build(
    folder: Path,
    survey: str,
    surface: Surface,
    *,
    resume: bool = True,
    killed: bool = False,
    change: SurveyChange | None = None,
) -> Runner:
    """Build over the scene in a folder, killed right after publishing or not.

    The survey is known by 16 letters.
    """
    runner = runner_in(folder, threads=2, max_memory_bytes=2**31)
    runner.resume = resume
    scene = folder / "scene"
    runner.before = find_before(runner.work, scene, survey * 16)
    segmented = segment_tiles(runner, surface, SEGMENT)
    source = InputInfo(name="a.laz", bytes=1, xxh3=survey * 16)
    about = pack.About(
        np.array([500000.0, 8e6, 100.0]), None, 99, True,
        BuildInfo(terraport="0", options={}, input=source),
    )  # fmt: skip
    version, _ = publish_tiles(
        runner, scene, surface, segmented, None, None, about, pack.Options("ground"), change,
        prepare=partial(runner.prepare, about.build, survey * 16, survey="segment"),
    )  # fmt: skip
    if not killed:
        runner.remember(version, about.build, survey * 16, survey="segment")
    return runner


def sunk(detail: Mesh, by_m: float, *, low: float, high: float) -> Mesh:
    """Dig a square hole."""
    vertices = detail.vertices.copy()
    vertices[within(detail, low=low, high=high), 1] -= np.float32(by_m)
    return replace(detail, vertices=vertices, attributes={"height": vertices[:, 1].copy()})


def change_of(
    by_m: float, low: int, high: int, earlier: HeightChanges | None = None
) -> SurveyChange:
    """What the comparison finds of such a hole, in cubes of 1 m, four to a block."""
    dz_m = np.zeros((60, 60), np.float32)
    moved = np.zeros((60, 60), np.bool_)
    dz_m[low:high, low:high] = -by_m
    moved[low:high, low:high] = True
    raster = ChangeRaster((0.0, 0.0), 1.0, 1.0, dz_m, np.full_like(dz_m, 0.1), moved, (0, 0))
    every = range(low // 4, -(-high // 4))
    blocks = np.array([(x, y, z) for x in every for y in range(-3, 3) for z in every], np.int64)
    heights = (earlier or HeightChanges.none(4)).renewed(raster, 1, blocks)
    seen = ChangeMap((0.0, 0.0), 1.0, dz_m, raster.lod_m, moved, 0.02)
    return SurveyChange(LATTICE, 16, heights, seen, f"change-{by_m}-{low}-{high}")


def payloads(folder: Path) -> list[SegmentMesh]:
    with Scene.open(folder / "scene") as opened:
        return [opened.mesh(number) for number in range(len(opened.index))]


def published(folder: Path) -> Version:
    assert validate_scene(folder / "scene") == []
    with Scene.open(folder / "scene") as opened:
        index = opened.index
        middle = (index.bounds[:, :3] + index.bounds[:, 3:]) / 2
        at = np.clip(middle[:, [0, 2]] // 20.0, 0, 2).astype(int)
        return Version(
            index.xxh3.tolist(), (at[:, 0] * 3 + at[:, 1]).tolist(), opened.regions["regions"]
        )


def keys(runner: Runner) -> dict[str, int]:
    """When every tile's result was written."""
    return {
        path.parent.name: path.stat().st_mtime_ns
        for name in PASSES
        for path in runner.work.path.glob(f"{name}-*/stage.json")
    }


def computed(before: dict[str, int], runner: Runner) -> set[str]:
    return {name for name, time in keys(runner).items() if before.get(name) != time}


def files(folder: Path) -> dict[str, bytes]:
    with Scene.open(folder / "scene") as opened:
        return {
            key: (opened.path / file.path).read_bytes()
            for key, file in opened.manifest.files.items()
        }


@pytest.fixture(scope="module")
def detail() -> Mesh:
    return ground(80)


@pytest.fixture
def folder(detail: Mesh, tmp_path: Path) -> Path:
    build(tmp_path, "a", surface_of(detail))
    return tmp_path


@pytest.mark.parametrize("change", [with_pit, with_pile])
def test_what_did_not_change_is_neither_computed_nor_numbered_again(
    detail: Mesh, folder: Path, change: Callable[[Mesh], Mesh]
) -> None:
    old, runner = published(folder), runner_in(folder)
    times = keys(runner)
    build(folder, "b", surface_of(change(detail)))
    assert computed(times, runner) == {f"{name}-00004" for name in PASSES}
    new = published(folder)
    for number, (tile, value) in enumerate(zip(old.tiles, old.hashes, strict=True)):
        if tile != 4 and number < len(new.hashes):
            assert new.hashes[number] == value
    changed = sum(tile == 4 for tile in new.tiles)
    assert 0 < changed < len(new.tiles) / 4
    kept = len(set(old.hashes) & set(new.hashes))
    assert kept >= len(old.hashes) - sum(tile == 4 for tile in old.tiles)


def test_regions_go_on_and_a_new_one_gets_a_new_number(detail: Mesh, folder: Path) -> None:
    build(folder, "b", surface_of(with_pile(detail)))
    regions = published(folder).regions
    assert [row["stable_id"] for row in regions] == [0, 1, 2, 3]
    pile = regions[3]
    assert pile["mean_colour"][0] > 200
    assert pile["mean_colour"][1] > 200
    # Gone again: its number stays its own.
    build(folder, "c", surface_of(detail))
    assert [row["stable_id"] for row in published(folder).regions] == [0, 1, 2]
    build(folder, "d", surface_of(with_pile(detail)))
    assert [row["stable_id"] for row in published(folder).regions] == [0, 1, 2, 4]


def test_back_to_the_first_survey_is_back_to_its_payloads(detail: Mesh, folder: Path) -> None:
    old = published(folder)
    build(folder, "b", surface_of(with_pit(detail)))
    build(folder, "c", surface_of(detail))
    assert published(folder).hashes == old.hashes


def test_the_same_survey_again_is_the_same_scene(detail: Mesh, folder: Path) -> None:
    surface = surface_of(with_pile(with_pit(detail)))
    build(folder, "b", surface)
    whole, times = files(folder), keys(runner_in(folder))
    runner = build(folder, "b", surface)
    assert all(report.taken_up for report in runner.reports)
    assert computed(times, runner) == set()
    build(folder, "b", surface, resume=False)
    assert files(folder) == whole


def test_killed_right_after_publishing_the_next_survey_goes_by_what_stands(
    detail: Mesh, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "killed")
    for where, killed in ((folder, False), (tmp_path / "killed", True)):
        build(where, "b", surface_of(with_pit(with_pile(detail))), killed=killed)
        build(where, "c", surface_of(with_pile(detail)))
    assert files(tmp_path / "killed") == files(folder)
    assert [row["stable_id"] for row in published(folder).regions] == [0, 1, 2, 3]


def test_killed_before_publishing_the_next_survey_goes_by_what_stands(
    detail: Mesh, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "killed")
    build(tmp_path / "killed", "b", surface_of(with_pile(detail)), killed=True)
    shutil.rmtree(tmp_path / "killed" / "scene")
    shutil.copytree(folder / "scene", tmp_path / "killed" / "scene")
    for where in (folder, tmp_path / "killed"):
        build(where, "c", surface_of(with_pit(detail)))
    assert files(tmp_path / "killed") == files(folder)


def test_another_base_elsewhere_leaves_the_covers(detail: Mesh, folder: Path) -> None:
    base = ground(16, low=-3.0, high=63.0)
    vertices = base.vertices.copy()
    vertices[(vertices[:, ::2] > 60.0).all(axis=1), 1] += 0.1  # a corner of the scene
    times = keys(runner_in(folder))
    runner = build(folder, "b", surface_of(detail, replace(base, vertices=vertices)))
    assert "segment-cover-00008" in computed(times, runner)
    assert computed(times, runner) <= {f"segment-cover-0000{n}" for n in (4, 5, 7, 8)}
    assert validate_scene(folder / "scene") == []


def test_a_tile_without_detail_renames_no_other(detail: Mesh, folder: Path) -> None:
    """The number in a tile's name stays, though it is counted otherwise."""

    class Named(MemoryTiles):
        @property
        def names(self) -> tuple[str, ...]:
            return tuple(f"tile-{number:05d}" for number in range(9) if number != 1)

    surface, times = surface_of(detail), keys(runner_in(folder))
    pieces = [piece for number, (piece, _) in enumerate(cut_mesh(detail, 3)) if number != 1]
    every = surface.tiles
    digests = tuple(every.digest_of(number) for number in range(9) if number != 1)
    tiles = Named(tuple(pieces), (), (), np.zeros(0, bool), ("height",), "eight", digests)
    runner = build(folder, "b", replace(surface, tiles=tiles, digest="eight"))
    done = computed(times, runner)
    # Its neighbours have other seams, so their units are computed again.
    assert {name for name in done if "units" in name} == {
        f"segment-units-0000{n}" for n in (0, 2, 4)
    }
    assert not any(name.endswith(("3", "5", "6", "7", "8")) for name in done)
    assert not (runner.work.path / "pack-tile-00001").exists()
    # The corner behind the tile is an island now, a region of its own.
    assert [row["stable_id"] for row in published(folder).regions] == [0, 1, 2, 3]


def test_what_the_scale_does_not_fit_is_decided_anew_and_nothing_is_clipped(
    detail: Mesh, folder: Path
) -> None:
    """A pit far below all heights there were."""
    build(folder, "b", surface_of(with_pit(detail, depth_m=30.0)))
    with Scene.open(folder / "scene") as opened:
        heights = next(a for a in opened.manifest.attributes if a.name == "height")
    assert validate_scene(folder / "scene") == []
    deep = with_pit(detail, depth_m=30.0).vertices[:, 1]
    assert heights.offset == pytest.approx(float(deep.min()))
    assert heights.max == pytest.approx(float(deep.max()))


def test_the_next_survey_goes_by_what_was_decided_first(detail: Mesh, folder: Path) -> None:
    flat = with_pit(detail, depth_m=0.2)  # less spread of heights
    build(folder, "b", surface_of(flat))
    records = [
        runner_in(folder).work.latest(name)
        for name in ("segment-scale", "cover-scale", "pack-scales")
    ]
    before = find_before(runner_in(folder).work, folder / "scene", "b" * 16)
    assert before is not None
    for record in records:
        assert record is not None
        held = before.find(record.name)
        assert held is not None
        assert held.digest == record.digest


def test_a_version_whose_regions_people_cut_is_still_this_builds(
    detail: Mesh, folder: Path
) -> None:
    scene = folder / "scene"
    built = read_manifest(scene).version
    west = float(detail.vertices[:, 0].mean()) + 500_000.0
    ring = [(west - 1e4, 7.99e6), (west, 7.99e6), (west, 8.01e6), (west - 1e4, 8.01e6)]
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    feature = {"type": "Feature", "properties": {"name": "west"}, "geometry": geometry}
    plan = folder / "plan.geojson"
    plan.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    label_by_plan(scene, plan, NullProgress())
    assert read_manifest(scene).version != built
    for _ in range(2):  # and after a build that was killed before it published
        before = find_before(runner_in(folder).work, scene, "b" * 16)
        assert before is not None
        assert before.version == built


def test_a_hole_is_in_the_payloads_over_it_and_in_no_other(detail: Mesh, folder: Path) -> None:
    old, times = published(folder), keys(runner_in(folder))
    build(folder, "b", surface_of(sunk(detail, 1.5, low=22.0, high=26.0)),
                   change=change_of(1.5, 22, 26))  # fmt: skip
    assert computed(times, runner_in(folder)) == {f"{name}-00004" for name in PASSES}
    new = published(folder)
    # (1) Payloads of other tiles are those of before, bit by bit.
    others = {value for tile, value in zip(old.tiles, old.hashes, strict=True) if tile != 4}
    assert others <= set(new.hashes)
    # (2) Where the ground sank, vertices say by how much; segments beside it say nothing at all.
    has_change = 0
    for mesh in payloads(folder):
        dz_m = mesh.attributes.get("height_change_m")
        x, _, z = mesh.positions.T
        inside = (x > 22) & (x < 26) & (z > 22) & (z < 26)
        assert inside.any() == (dz_m is not None)
        if dz_m is not None:
            has_change += 1
            np.testing.assert_allclose(dz_m[inside], -1.5, atol=0.004)
            beyond = (x < 21.9) | (x > 26.1) | (z < 21.9) | (z > 26.1)
            assert np.isnan(dz_m[beyond]).all()
    assert 0 < has_change < sum(tile == 4 for tile in new.tiles)
    # (3) The manifest has its range, and the scale that never changes.
    with Scene.open(folder / "scene") as opened:
        (info,) = (a for a in opened.manifest.attributes if a.name == "height_change_m")
    assert (info.min, info.max, info.offset, info.step) == (-1.5, -1.5, -256.0, 2.0**-7)


def test_the_survey_after_it_keeps_what_tiles_say_that_do_not_change(
    detail: Mesh, folder: Path
) -> None:
    hole, times = sunk(detail, 1.5, low=25.0, high=33.0), keys(runner_in(folder))
    first = change_of(1.5, 25, 33)
    build(folder, "b", surface_of(hole), change=first)
    old, times = published(folder), keys(runner_in(folder))
    later = change_of(0.5, 5, 13, first.heights)
    runner = build(folder, "c", surface_of(sunk(hole, 0.5, low=5.0, high=13.0)), change=later)
    assert computed(times, runner) == {f"{name}-00000" for name in PASSES}
    others = {value for tile, value in zip(old.tiles, old.hashes, strict=True) if tile != 0}
    assert others <= set(published(folder).hashes)
    values = [mesh.attributes.get("height_change_m") for mesh in payloads(folder)]
    lowest = [float(np.nanmin(dz_m)) for dz_m in values if dz_m is not None]
    assert sorted(set(lowest)) == [-1.5, -0.5]
    # Nothing was found: all the same.
    whole = files(folder)["segments.pack"]
    nothing = change_of(0.5, 0, 0, later.heights)
    runner = build(folder, "d", surface_of(sunk(hole, 0.5, low=5.0, high=13.0)), change=nothing)
    assert files(folder)["segments.pack"] == whole


def test_volumes_of_the_regions_add_up(detail: Mesh, folder: Path) -> None:
    build(folder, "b", surface_of(sunk(detail, 1.5, low=15.0, high=33.0)),
          change=change_of(1.5, 15, 33))  # fmt: skip
    with Scene.open(folder / "scene") as opened:
        document = opened.regions
    whole = document["change"]["whole"]
    assert whole["cut_m3"] == pytest.approx(1.5 * 18 * 18)
    assert whole["fill_m3"] == 0.0
    assert 0.0 <= whole["uncertainty_m3"] < 0.1 * whole["cut_m3"]
    regions = [row["change"] for row in document["regions"] if "change" in row]
    assert len(regions) >= 2  # it lies across a border
    for name in ("cut_m3", "fill_m3", "area_m2"):
        pieces = [row[name] for row in (*regions, document["change"]["beyond"])]
        assert sum(pieces) == pytest.approx(whole[name], abs=0.01)


def test_an_attribute_of_the_survey_by_that_name_stands(detail: Mesh, tmp_path: Path) -> None:
    def named(mesh: Mesh) -> Mesh:
        return replace(mesh, attributes={"Height_Change_m": mesh.vertices[:, 1].copy()})

    base = named(ground(16, low=-3.0, high=63.0))
    build(tmp_path, "a", surface_of(named(detail), base))
    hole = named(sunk(detail, 1.5, low=25.0, high=33.0))
    build(tmp_path, "b", surface_of(hole, base), change=change_of(1.5, 25, 33))
    assert published(tmp_path).regions
    assert {name for mesh in payloads(tmp_path) for name in mesh.attributes} == {"Height_Change_m"}
