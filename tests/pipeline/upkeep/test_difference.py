"""What differs between two scenes, with the answer written out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from store.tiny_scene import CELLS, SPACING_M, TinyScene, write_tiny_scene

from terraport_pipeline.errors import OptionError
from terraport_pipeline.upkeep.difference import (
    Compared,
    Share,
    compare,
    of_folder_before,
    of_scene,
)
from terraport_pipeline.upkeep.ground_change import ground_change, why_not
from terraport_store import Scene, change_labels, read_manifest
from terraport_store.manifest import CrsInfo


def side(scene: TinyScene) -> Compared:
    with Scene.open(scene.path) as opened:
        return of_scene(opened, str(scene.path))


@pytest.fixture
def plain(tmp_path: Path) -> TinyScene:
    return write_tiny_scene(tmp_path / "plain", stable_ids=(4, 2, 9))


def payload_bytes(scene: TinyScene, *segments: int) -> int:
    return sum(len(scene.payloads[segment]) for segment in segments)


def test_the_same_scene_elsewhere_is_the_same(plain: TinyScene, tmp_path: Path) -> None:
    copy = write_tiny_scene(tmp_path / "copy", stable_ids=(4, 2, 9))
    difference = compare(side(plain), side(copy))
    assert difference.is_same
    assert difference.kept == Share(4, payload_bytes(plain, 0, 1, 2, 3))
    assert (difference.load_bytes, difference.regions, difference.options) == (0, (), {})
    # Labels belong to no version, and differ all the same.
    change_labels(copy.path, {9: "haul road"})
    labelled = compare(side(plain), side(copy))
    assert not labelled.is_same
    assert [(row["stable_id"], row["state"], row["label"]) for row in labelled.regions] == [
        (9, "renamed", "haul road")
    ]


def test_what_a_client_loads(plain: TinyScene, tmp_path: Path) -> None:
    """The last segment sank; the base and the others are as they were."""
    sunk = write_tiny_scene(tmp_path / "sunk", stable_ids=(4, 2, 9), changed=True)
    difference = compare(side(plain), side(sunk))
    assert not difference.is_same
    assert difference.kept == Share(3, payload_bytes(plain, 0, 1, 2))
    assert difference.changed == Share(1, payload_bytes(sunk, 3))
    assert (difference.new, difference.gone, difference.renumbered) == (Share(0, 0),) * 3
    assert difference.load_bytes == payload_bytes(sunk, 3)
    assert difference.kept_second.tolist() == [True, True, True, False]


def test_new_gone_and_renumbered(plain: TinyScene, tmp_path: Path) -> None:
    twice = write_tiny_scene(tmp_path / "twice", copies=2, stable_ids=(4, 2, 9))
    there, back = compare(side(plain), side(twice)), compare(side(twice), side(plain))
    added = Share(4, payload_bytes(plain, 0, 1, 2, 3))
    assert (there.new, there.renumbered, there.gone) == (added, added, Share(0, 0))
    assert (back.gone, back.new, back.load_bytes) == (added, Share(0, 0), 0)


def test_regions_by_stable_id_and_options_by_name(plain: TinyScene, tmp_path: Path) -> None:
    other = write_tiny_scene(tmp_path / "other", seed=1, stable_ids=(4, 7, 9))
    difference = compare(side(plain), side(other))
    assert [(row["stable_id"], row["state"]) for row in difference.regions] == [
        (2, "gone"),
        (7, "new"),
    ]
    assert difference.regions_kept == 2
    assert difference.options == {"name": ("tiny 0", "tiny 1"), "seed": (0, 1)}
    without = write_tiny_scene(tmp_path / "without")
    assert compare(side(plain), side(without)).regions_problem == (
        f"{without.path} has no stable ids"
    )


def test_a_changed_region_has_both_areas(plain: TinyScene) -> None:
    first = side(plain)
    document = json.loads(json.dumps(dict(first.regions)))
    for region, area_m2 in zip(document["regions"], (5.0, 6.0, 7.0), strict=True):
        region["area_m2"] = area_m2
    first = replace(first, regions=document)
    changed = json.loads(json.dumps(document))
    changed["regions"][1]["area_m2"] = 8.5
    [row] = compare(first, replace(first, regions=changed)).regions
    assert row == {
        "stable_id": 2,
        "state": "changed",
        "label": "bench",
        "label_before": "bench",
        "surface_area_m2": 8.5,
        "surface_area_before_m2": 6.0,
    }
    # One number for two pieces of ground that lie apart: scenes that know nothing of each other.
    apart = json.loads(json.dumps(changed))
    document["regions"][1]["bounds"] = {"min": [0, 0, 0], "max": [1, 1, 1]}
    apart["regions"][1]["bounds"] = {"min": [5, 0, 0], "max": [6, 1, 1]}
    rows = compare(replace(first, regions=document), replace(first, regions=apart)).regions
    assert {(row["stable_id"], row["state"]) for row in rows} == {(2, "gone"), (2, "new")}


def test_the_version_before_is_read_from_its_folder(tmp_path: Path) -> None:
    write_tiny_scene(tmp_path / "pit", stable_ids=(4, 2, 9))
    with pytest.raises(OptionError, match="no version before"):
        of_folder_before(tmp_path / "pit", read_manifest(tmp_path / "pit"))
    now = write_tiny_scene(tmp_path / "pit", stable_ids=(4, 2, 9), changed=True)
    before = of_folder_before(now.path, now.manifest)
    difference = compare(before, side(now))
    assert (difference.kept.segments, difference.changed.segments) == (3, 1)
    assert difference.options == {}
    # The base is the same file: its hash is taken, since no manifest says it any more.
    assert difference.load_bytes == payload_bytes(now, 3)


def heights_between(first: TinyScene, second: TinyScene):  # type: ignore[no-untyped-def]
    with Scene.open(first.path) as one, Scene.open(second.path) as other:
        difference = compare(of_scene(one, "a"), of_scene(other, "b"))
        return ground_change((one, other), difference)


def test_heights_are_those_of_the_formula(plain: TinyScene, tmp_path: Path) -> None:
    change = heights_between(plain, write_tiny_scene(tmp_path / "moved", seed=1))
    side_m = 2 * CELLS * SPACING_M
    x, z = np.meshgrid(*(np.linspace(0, side_m, 1201)[:-1] + side_m / 2400,) * 2)
    truth = 0.4 * (np.sin(1.3 * x + 0.7) - np.sin(1.3 * x)) * np.cos(0.9 * z)
    assert change is not None
    assert change.area_m2 == pytest.approx(side_m**2, rel=0.01)
    assert change.lowest_m == pytest.approx(truth.min(), abs=0.01)
    assert change.highest_m == pytest.approx(truth.max(), abs=0.01)


def test_only_ground_that_differs_is_looked_at(plain: TinyScene, tmp_path: Path) -> None:
    """Another attribute in a quarter of the patch: other bytes, the same heights."""
    change = heights_between(plain, write_tiny_scene(tmp_path / "sunk", changed=True))
    assert change is not None
    assert change.area_m2 == pytest.approx((CELLS * SPACING_M) ** 2, rel=0.08)
    assert (change.lowest_m, change.highest_m) == (0.0, 0.0)
    copy = write_tiny_scene(tmp_path / "copy")
    assert heights_between(plain, copy) is None


def test_heights_in_two_systems_are_not_compared(plain: TinyScene) -> None:
    manifest = plain.manifest
    utm, other = (
        manifest.model_copy(update={"crs": CrsInfo(name=name, epsg=epsg)})
        for name, epsg in (("UTM 35S", 32735), ("UTM 36S", 32736))
    )
    assert why_not(manifest, manifest) is None
    assert why_not(utm, utm) is None
    assert why_not(utm, other) == "they are in UTM 35S and in UTM 36S"
    assert why_not(manifest, utm) == "only one of them states a coordinate reference system"
