"""Numbers, facts and volumes of another cut of the same faces."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pipeline.naming.named_ground import ground_at

from terraport_payload import SegmentMesh
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE
from terraport_pipeline.naming import recut as module
from terraport_pipeline.naming.recut import Cut, carried_unions, recut
from terraport_pipeline.naming.republish import with_regions


@pytest.fixture(scope="module")
def ground(published):
    return ground_at(published)


def test_the_same_cut_changes_nothing_but_neighbours(ground) -> None:
    new = recut(ground, Cut(ground.region_of_face + 5))
    assert (new.regions == ground.region_of_face).all()
    assert new.kept == 2
    assert new.labels == {}
    for row, before in zip(new.document["regions"], ground.document["regions"], strict=True):
        assert {key: row[key] for key in before} == before
    assert new.document["next_stable_id"] == 9


def test_a_region_that_is_gone_leaves_its_number_to_another(ground) -> None:
    """Numbers have no gap; stable ids never come back."""
    x = ground.centres[:, 0]
    thirds = np.digitize(x, [20, 40]).astype(np.int32)
    new = recut(ground, Cut(thirds))
    assert sorted(np.unique(new.regions)) == [0, 1, 2]
    ids = {row["stable_id"] for row in new.document["regions"]}
    assert ids & {4, 7}
    assert max(ids) == new.document["next_stable_id"] - 1
    one = recut(ground, Cut(np.zeros_like(thirds)))
    assert one.document["regions"][0]["stable_id"] == 4, "the larger of both"
    assert one.count == 1


def test_volumes_are_shared_out_by_what_moved(ground) -> None:
    x, z = ground.centres[:, 0], ground.centres[:, 2]
    rows = [dict(row) for row in ground.document["regions"]]
    rows[0]["change"] = {"cut_m3": 90.0, "fill_m3": 8.0, "area_m2": 60.0, "uncertainty_m3": 3.0}
    vertices = ground.mesh.vertices
    sank = (vertices[:, 0] < 40) & (vertices[:, 2] < 50)
    dz = np.where(sank, -2.0, np.nan).astype(np.float32)
    mesh = replace(ground.mesh, attributes={HEIGHT_CHANGE: dz})
    moved = replace(ground, mesh=mesh, document={**ground.document, "regions": rows})
    pieces = np.where((ground.region_of_face == 0) & (z > 50), 2, ground.region_of_face)
    document = recut(moved, Cut(pieces.astype(np.int32))).document
    shares = [row.get("change") for row in document["regions"]]
    assert shares[1] is None
    # All that sank lies in one half; nothing rose anywhere, so that is shared by area.
    assert sorted(share["cut_m3"] for share in shares if share) == [0.0, 90.0]
    sums = {key: sum(share[key] for share in shares if share) for key in rows[0]["change"]}
    uncertain_m3 = sums.pop("uncertainty_m3")
    assert sums == pytest.approx({"cut_m3": 90.0, "fill_m3": 8.0, "area_m2": 60.0}, abs=0.002)
    assert uncertain_m3 >= 3.0
    assert x.min() < 40


def test_more_regions_than_payloads_can_name_are_refused(ground, monkeypatch) -> None:
    monkeypatch.setattr(module, "MAX_REGIONS", 3)
    with pytest.raises(OptionError, match="4 regions, expected at most 3"):
        recut(ground, Cut((np.arange(len(ground.area)) % 4).astype(np.int32)))


def test_splitting_and_joining_again_gives_the_same_vertices() -> None:
    side = 5
    x, z = np.meshgrid(np.arange(side), np.arange(side))
    positions = np.stack([x, x * 0, z], -1).reshape(-1, 3).astype(np.float32)
    index = np.arange(side * side).reshape(side, side)
    quads = [
        (index[i][j], index[i + 1][j], index[i + 1][k])
        for i in range(4)
        for j, k in pairwise(range(side))
    ]
    faces = np.array(quads, np.uint32)
    mesh = SegmentMesh(
        positions,
        faces,
        np.tile(np.float32([0, 1, 0]), (len(positions), 1)),
        np.arange(len(positions) * 3, dtype=np.uint8).reshape(-1, 3),
        np.zeros(len(positions), np.uint16),
        {"grade": np.where(np.arange(len(positions)) % 3, 1.5, np.nan).astype(np.float32)},
    )
    whole = with_regions(mesh, np.zeros(len(faces), np.int32))
    used = len(np.unique(faces))
    assert len(whole.positions) == used
    split = with_regions(mesh, (np.arange(len(faces)) >= 8).astype(np.int32))
    assert used < len(split.positions) <= used + side
    assert (split.region_ids[split.faces] == (np.arange(len(faces)) >= 8)[:, None]).all()
    assert (split.positions[split.faces] == positions[faces]).all()
    joined = with_regions(split, np.zeros(len(faces), np.int32))
    assert len(joined.positions) == used
    assert (joined.colours[joined.faces] == mesh.colours[faces]).all()


def test_what_was_parted_is_united_first_and_goes_on_as_before() -> None:
    # Before: 0 and 1 are a farm, that and 2 the valley. Now 0 is cut in two (0 and 3), a pit (1)
    # lies mostly in 2, of which 2 is left; of 1 nothing is.
    unions = [[0, 1, 1.5], [2, 3, 4.0]]
    home = np.array([0, 2, 2, 0])
    assert carried_unions(unions, 3, home) == [[1, 2, 1.0], [0, 3, 1.0], [4, 5, 4.0]]
    # As it was: nothing changes.
    assert carried_unions(unions, 3, np.arange(3)) == unions
    # What cannot be ends it.
    assert carried_unions([[0, 1, 1.5], "x"], 3, np.arange(3)) == [[0, 1, 1.5]]
