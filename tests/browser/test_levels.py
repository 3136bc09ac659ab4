"""Two levels in the page: a ring of the coarser one around full detail."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.watched_page import save_shot
from faults.service import Service
from playwright.sync_api import Page, expect
from server.grid_scene import SIDE, write_grid_scene

import terraport.sync

SEGMENTS = SIDE * SIDE
HERE, THERE = (15.0, 1.0, 15.0), (45.0, 1.0, 15.0)
RADIUS_M = 6.0


@pytest.fixture(scope="module")
def grids(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A scene of two levels and one of one."""
    root = tmp_path_factory.mktemp("levels") / "scenes"
    write_grid_scene(root / "two", levels=2)
    write_grid_scene(root / "one")
    with Service(root) as running:
        yield running


@pytest.fixture
def two(page: Page, grids: Service) -> DrivenViewer:
    viewer = DrivenViewer(page, grids.url, "two")
    viewer.open()
    return viewer


def _levels(ids: list[int]) -> tuple[set[int], set[int]]:
    return ({i for i in ids if i < SEGMENTS}, {i - SEGMENTS for i in ids if i >= SEGMENTS})


def test_a_landing_has_a_ring_and_the_base_gives_way_to_both(
    two: DrivenViewer, grids: Service
) -> None:
    with terraport.sync.connect(f"{grids.url}/scenes/two") as session:
        landing = session.land(HERE, radius_m=RADIUS_M, coarse_radius_m=3 * RADIUS_M)
        expected, base = sorted(segment.id for segment in landing.ready(30)), session.base()
        hidden_faces = session.hidden_faces
    shown = two.land(HERE, RADIUS_M)
    assert shown["visible"] == expected
    full, coarse = _levels(expected)
    assert full
    assert coarse
    assert not full & coarse
    hidden = two.hidden_on_gpu(len(base.mesh.faces))
    assert np.array_equal(hidden, hidden_faces)
    assert int(hidden.sum()) == 2 * len(full | coarse)
    reach = [shown["plan"][key] for key in ("effectiveRadiusM", "coarseRadiusM")]
    assert reach == [RADIUS_M, 3 * RADIUS_M]
    # What is told of as sharp is full detail alone.
    two.until("terraport.state.gain !== null")
    gain = two.run("terraport.state.gain")
    assert (gain["detailFaces"], gain["baseFaces"]) == (len(full) * 2 * 12**2, len(full) * 2)
    two.look((30.0, 60.0, 30.0), 0.0, -90.0)
    save_shot(two.page, "levels")


def test_a_hop_exchanges_levels_and_a_return_loads_nothing(two: DrivenViewer) -> None:
    first = two.land(HERE, RADIUS_M)
    hop = two.land(THERE, RADIUS_M)
    was, now = _levels(first["visible"]), _levels(hop["visible"])
    assert was[0] & now[1]  # what was sharp is coarse, and the other way round
    assert was[1] & now[0]
    assert not now[0] & now[1]
    created = two.run("terraport.stats.gpu.createdBytes")
    back = two.land(HERE, RADIUS_M)
    assert (back["digest"], back["payloadBytes"]) == (first["digest"], 0)
    assert two.run("terraport.stats.gpu.createdBytes") == created
    assert two.run("terraport.state.strayChanges") == 0
    # A point of the ring is told as its segment's: whatever asks for that need not know of levels.
    segment = sorted(_levels(first["visible"])[1])[0]
    row, column = divmod(segment, SIDE)
    place = [10.0 * column + 5.0, 40.0, 10.0 * row + 5.0]
    assert two.run("(eye) => terraport.cast(eye, [0, -1, 0]).segment", place) == segment


def test_an_aim_brings_the_ring_too(two: DrivenViewer) -> None:
    two.run("(place) => terraport.aim(place, 6)", list(HERE))
    two.until("terraport.state.aim?.bytes > 0")
    assert two.land(HERE, RADIUS_M)["payloadBytes"] == 0


def test_a_ring_beyond_what_the_service_allows_is_cut(two: DrivenViewer) -> None:
    allowed = two.run("terraport.state.maxRadiusM")
    shown = two.land(HERE, allowed - 1.0)
    assert shown["phase"] == "shown"
    assert shown["plan"]["coarseRadiusM"] == allowed


def test_the_ring_is_a_choice_of_who_looks(page: Page, grids: Service) -> None:
    viewer = DrivenViewer(page, grids.url, "two")
    viewer.open()
    page.get_by_role("button", name="Panel").click()
    ring = page.get_by_label("Coarser detail around it")
    expect(ring).to_be_checked()
    with_ring = viewer.land(HERE, RADIUS_M)
    expect(page.locator("[data-fact='radius']")).to_have_text("6 m, coarser to 18 m")
    ring.uncheck()
    without = viewer.land(HERE, RADIUS_M)
    expect(page.locator("[data-fact='radius']")).to_have_text("6 m")
    assert without["visible"] == sorted(_levels(with_ring["visible"])[0])
    assert without["plan"]["coarseRadiusM"] is None

    viewer = DrivenViewer(page, grids.url, "one")
    viewer.open()
    page.get_by_role("button", name="Panel").click()
    expect(page.get_by_label("Take me to the ground where I land")).to_be_visible()
    expect(ring).to_be_hidden()
