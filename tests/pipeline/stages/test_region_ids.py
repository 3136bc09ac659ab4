"""Stable ids over rebuilds: the shell around the matching, on a published scene of four segments.

The tiny scene has three regions: 0 the corner at the origin, 2 the opposite corner, 1 the two
segments between.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from store.tiny_scene import CELLS, lattice_mesh, write_tiny_scene

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Mesh
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages.region_ids import CarriedNumbers, NumberedRegions, number_regions
from terraport_store import CrsInfo, DamagedSceneError, change_labels

ORIGIN = np.array([500000.0, 8000000.0, 100.0])
FACTS = {"roughness_scale_m": 1.0, "regions": [{"id": n, "area_m2": 1.0} for n in range(3)]}


@dataclass(frozen=True, slots=True, eq=False)
class NewSurface:
    """A detail in memory, as a build has it before it is packed."""

    detail: Mesh
    segments: Int32
    """(F,) segment of every face."""
    regions: Int32
    """(F,) region of every face, 0 to R - 1."""
    origin: Float64
    """(3,) E0, N0, H0."""
    crs: CrsInfo | None

    @property
    def face_count(self) -> int:
        return len(self.segments)

    def pieces(self) -> Iterator[tuple[Float32, Int32, Int32]]:
        order = np.argsort(self.segments, kind="stable")
        count = int(self.segments.max()) + 1
        starts = np.searchsorted(self.segments[order], np.arange(count + 1))
        for begin, end in itertools.pairwise(starts):
            chosen = order[begin:end]
            yield self.detail.vertices, self.detail.faces[chosen], self.regions[chosen]


def surface(*, seed: int = 0, names: tuple[int, ...] = (0, 1, 2), moved_m: float = 0.0):
    """The same patch as a build has it before it is packed; ``names`` renames the regions."""
    tiles = [lattice_mesh(i, j, seed=seed) for i in (0, CELLS) for j in (0, CELLS)]
    starts = np.cumsum([0, *(len(tile.positions) for tile in tiles)])
    faces = [tile.faces + start for tile, start in zip(tiles, starts, strict=False)]
    vertices = np.concatenate([tile.positions for tile in tiles])
    mesh = Mesh(
        vertices=vertices + np.float32(moved_m) * np.float32([0, 0, 1]),
        faces=np.concatenate(faces).astype(np.int32),
        normals=np.tile(np.float32([0, 1, 0]), (len(vertices), 1)),
        colours=np.zeros((len(vertices), 3), np.uint8),
        attributes={},
    )
    segments = np.repeat(np.arange(4), [len(tile.faces) for tile in tiles])
    regions = np.array(names)[np.array([0, 1, 1, 2])[segments]]
    return NewSurface(mesh, segments.astype(np.int32), regions.astype(np.int32), ORIGIN, None)


def numbered(
    scene: Path, new: NewSurface, facts=FACTS, carried: CarriedNumbers | None = None
) -> NumberedRegions:
    return number_regions(scene, facts, new, NullProgress(), carried)


def ids(result: NumberedRegions) -> list[int]:
    return [row["stable_id"] for row in result.document["regions"]]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_tiny_scene(tmp_path / "s", stable_ids=(4, 2, 9)).path


def test_a_new_place_counts_from_0(tmp_path: Path) -> None:
    result = numbered(tmp_path / "nowhere", surface())
    assert ids(result) == [0, 1, 2]
    assert result.document["next_stable_id"] == 3
    assert list(result.document["regions"][1]) == ["id", "stable_id", "area_m2"]
    assert result.document["roughness_scale_m"] == 1.0
    assert result.counts == {"regions_kept": 0, "regions_new": 3, "regions_retired": 0}
    assert "stable_id" not in FACTS["regions"][0]


def test_the_same_surface_keeps_every_number(scene: Path) -> None:
    result = numbered(scene, surface())
    assert (ids(result), result.document["next_stable_id"]) == ([4, 2, 9], 10)
    assert result.counts == {"regions_kept": 3, "regions_new": 0, "regions_retired": 0}
    assert result.warnings == ()
    assert numbered(scene, surface()) == result


def test_numbers_follow_the_ground_and_not_the_order(scene: Path) -> None:
    """Other heights, regions listed in another order."""
    assert ids(numbered(scene, surface(seed=1, names=(2, 0, 1)))) == [2, 9, 4]


def test_another_origin_is_another_name_for_the_same_place(scene: Path) -> None:
    """The survey begins elsewhere, so the frame does; 2 m south of an origin 2 m farther north."""
    new = surface(names=(2, 0, 1), moved_m=2.0)
    near, far = (ORIGIN + np.array([0.0, north, 0.0]) for north in (2.0, 1000.0))
    assert ids(numbered(scene, replace(new, origin=near))) == [2, 9, 4]
    assert ids(numbered(scene, replace(new, origin=far))) == [10, 11, 12]


def test_new_ground_gets_new_numbers_and_lost_labels_are_told(scene: Path) -> None:
    """Only the middle is still there, as region 0; beside it something new."""
    change_labels(scene, {4: "pile", 2: "haul road"})
    whole = surface()
    middle = (whole.regions == 1) | (whole.regions == 2)
    new = replace(
        whole,
        detail=replace(whole.detail, faces=whole.detail.faces[middle]),
        segments=np.where(whole.segments[middle] == 3, 1, 0).astype(np.int32),
        regions=(whole.regions[middle] - 1).astype(np.int32),
    )
    facts = {**FACTS, "regions": FACTS["regions"][:2]}
    result = numbered(scene, new, facts)
    assert (ids(result), result.document["next_stable_id"]) == ([2, 9], 10)
    assert result.counts == {"regions_kept": 2, "regions_new": 0, "regions_retired": 1}
    assert result.warnings == (
        "1 labels have no region any more: 'pile' (4); give them again with terraport label",
    )


def test_what_lies_within_a_named_region_has_its_name(scene: Path) -> None:
    """Region 1, two segments, is cut in two: one is the same ground, the other its heir."""
    change_labels(scene, {2: "haul road", 9: "pond"})
    new = surface()
    regions = np.array([0, 1, 3, 2], np.int32)[new.segments]
    facts = {"roughness_scale_m": 1.0, "regions": [{"id": n} for n in range(4)]}
    result = numbered(scene, replace(new, regions=regions), facts)
    rows = result.document["regions"]
    # Both halves are as like: which of them is the same ground is the matching's business.
    assert {rows[1]["stable_id"], rows[3]["stable_id"]} == {2, 10}
    heir = 1 if rows[1]["stable_id"] == 10 else 3
    labels = [row.get("label") for row in rows]
    assert labels == ["haul road" if region == heir else None for region in range(4)]
    assert result.warnings == ()


def test_a_name_whose_region_went_lives_in_its_heirs(scene: Path) -> None:
    """All is one region but four strips of the named one: none is the same ground as before."""
    change_labels(scene, {2: "haul road"})
    new = surface()
    middle = (new.segments == 1) | (new.segments == 2)
    strips = np.arange(len(new.regions)) % 4 + 1
    regions = np.where(middle, strips, 0).astype(np.int32)
    facts = {"roughness_scale_m": 1.0, "regions": [{"id": n} for n in range(5)]}
    result = numbered(scene, replace(new, regions=regions), facts)
    labels = [row.get("label") for row in result.document["regions"]]
    assert labels == [None, *["haul road"] * 4]
    assert result.warnings == (), "the name is not lost"


def test_numbers_that_go_on_need_no_ground(scene: Path) -> None:
    """Of the version that stands there: 1 is 2 now, and 2 is gone. Of another they say nothing."""
    version = json.loads((scene / "scene.json").read_bytes())["version"]
    numbers = np.array([-1, 0, 1], np.int32)
    result = numbered(scene, surface(), carried=CarriedNumbers(version, numbers))
    assert (ids(result), result.document["next_stable_id"]) == ([10, 4, 2], 11)
    assert result.counts == {"regions_kept": 2, "regions_new": 1, "regions_retired": 1}
    other = CarriedNumbers("0" * 32, numbers)
    assert ids(numbered(scene, surface(), carried=other)) == [4, 2, 9]
    north = ORIGIN + np.array([0.0, 1.0, 0.0])  # the version's, in another frame
    elsewhere = replace(surface(moved_m=1.0), origin=north)
    assert ids(numbered(scene, elsewhere, carried=CarriedNumbers(version, numbers))) == [4, 2, 9]


def test_another_crs_is_another_place(scene: Path) -> None:
    crs = CrsInfo(name="UTM 35S", epsg=32735)
    result = numbered(scene, replace(surface(), crs=crs))
    assert ids(result) == [10, 11, 12]
    assert "another coordinate reference system" in result.warnings[0]


def test_a_scene_of_format_1_0_has_no_numbers_to_carry(tmp_path: Path) -> None:
    old = write_tiny_scene(tmp_path / "old").path
    assert ids(numbered(old, surface())) == [0, 1, 2]


def test_a_damaged_segment_costs_its_own_ground_only(scene: Path) -> None:
    """Segment 0 is all of region 0; the others are found again."""
    pack = next(scene.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[300] ^= 1
    pack.write_bytes(data)
    result = numbered(scene, surface())
    assert ids(result) == [10, 2, 9]
    assert "1 of 4 segments of the scene published before cannot be read" in result.warnings[0]


def test_behind_a_damaged_scene_numbers_stay_clear_of_labels(scene: Path) -> None:
    change_labels(scene, {9: "pile"})
    (scene / "scene.json").write_text("{}")
    result = numbered(scene, surface())
    assert (ids(result), result.document["next_stable_id"]) == ([10, 11, 12], 13)
    assert "cannot be read" in result.warnings[0]
    (scene / "labels.json").write_text("{}")
    with pytest.raises(DamagedSceneError, match=r"labels\.json"):
        numbered(scene, surface())


def test_damaged_labels_change_no_number(scene: Path) -> None:
    (scene / "labels.json").write_text("{}")
    result = numbered(scene, surface())
    assert ids(result) == [4, 2, 9]
    assert "labels cannot be read" in result.warnings[0]


def test_all_numbers_used(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terraport_pipeline.stages.region_ids.MAX_STABLE_ID", 9)
    assert ids(numbered(scene, surface())) == [4, 2, 9]
    with pytest.raises(OptionError, match="stable ids up to 12; expected at most 9"):
        numbered(scene, replace(surface(), crs=CrsInfo(name="x")))
