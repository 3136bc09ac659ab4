"""The study's page: the same walk with detail frozen between landings, and following the head."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.emulated_headset import IWER, EmulatedHeadset
from browser.small_scenes import SMALL
from browser.watched_page import Watch, save_shot
from eventually import eventually
from faults.service import Service
from playwright.sync_api import Page

from terraport_research.study.measures import measure
from terraport_research.study.session_log import SessionLog, read_log

FRAMES_PER_S = 4
TURN_DEG = 30.0


def walk() -> dict[str, Any]:
    """Two landings; after each the head turns once around, 3 s."""
    legs = []
    for x, z in ((0.0, 0.0), (25.0, -15.0)):
        poses = [[t / 4, x, 12.0, z, TURN_DEG * t, -15.0] for t in range(13)]
        legs.append({"position": [x, 2.0, z], "radius_m": 45.0, "poses": poses})
    return {"form": 1, "legs": legs}


def played(page: Page, server: Service, condition: str, folder: Path) -> SessionLog:
    page.goto(
        f"{server.url}/study.html?condition={condition}&participant=3&radius=45&forms=no"
        f"#scene={SMALL}"
    )
    eventually(lambda: page.evaluate("window.study !== undefined"), 120)
    log = page.evaluate("([walk, rate]) => study.play(walk, rate)", [walk(), FRAMES_PER_S])
    save_shot(page, f"study-{condition}")
    path = folder / f"{condition}.json"
    path.write_text(json.dumps(log))
    return read_log(path)


def test_detail_is_frozen_in_one_condition_and_follows_the_head_in_the_other(
    open_page: Callable[..., tuple[Page, Watch]], server: Service, tmp_path: Path
) -> None:
    logs = {}
    for condition in ("landings", "head"):
        page, _ = open_page(device_scale_factor=0.2)
        logs[condition] = played(page, server, condition, tmp_path)
    frozen, following = (measure(logs[condition]) for condition in ("landings", "head"))
    assert (frozen.landings, following.landings) == (2, 2)
    assert frozen.moving_min == following.moving_min > 0.08
    assert frozen.changes == 0
    assert following.changes_in_view > 10
    assert logs["landings"].max_error_px is None
    assert logs["head"].max_error_px > 0


def test_a_participant_is_asked_before_and_after_and_saves_the_log(
    open_page: Callable[..., tuple[Page, Watch]], server: Service, tmp_path: Path
) -> None:
    page, _ = open_page(device_scale_factor=0.2)
    page.goto(f"{server.url}/study.html?condition=landings&participant=p-4&order=2#scene={SMALL}")
    answer(page, "before", 0)
    eventually(lambda: page.evaluate("window.study !== undefined"), 120)
    page.click("#finish")
    save_shot(page, "study-form")
    answer(page, "after", 2)
    with page.expect_download() as download:
        page.click("#save-log")
    assert download.value.suggested_filename == "study-p-4-landings.json"
    path = tmp_path / "log.json"
    download.value.save_as(path)
    log = read_log(path)
    assert (log.participant, log.order, log.walk) == ("p-4", 2, "live")
    assert measure(log).vrsq["total"] == 200 / 3
    assert len(log.frames["t_ms"]) > 0


def answer(page: Page, when: str, value: int) -> None:
    form = page.locator(f"#form-{when}")
    form.wait_for()
    # It is what is seen, whatever was shown before.
    assert page.evaluate("document.elementFromPoint(5, 5).closest('form')?.id") == f"form-{when}"
    for row in range(16):
        form.locator(f"input[name='symptom-{row}'][value='{value}']").check()
    form.locator("button[type=submit]").click()


@pytest.mark.parametrize("condition", ["landings", "head"])
def test_in_a_headset_as_on_a_screen(
    condition: str,
    open_page: Callable[..., tuple[Page, Watch]],
    server: Service,
    tmp_path: Path,
) -> None:
    if not IWER.is_file():
        pytest.skip("the emulator is not installed (npm ci in client_sdk/web)")
    headset = EmulatedHeadset(open_page()[0])
    headset.open(f"{server.url}/study.html?condition={condition}&radius=45&forms=no#scene={SMALL}")
    headset.until("window.study !== undefined")
    headset.enter()
    headset.point("right", pitch=-6, yaw=3)
    headset.press("right", "trigger", 1)
    headset.frames(3)
    headset.press("right", "trigger", 0)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")
    for yaw in range(0, 360, 30):
        headset.head(0.3, 1.65, 0.2, yaw)
        headset.frames(6)
    path = tmp_path / "headset.json"
    path.write_text(json.dumps(headset.page.evaluate("study.log.toJson()")))
    log = read_log(path)
    # The eye is the head's, turning; not the page's camera, which rests.
    assert np.ptp(log.frames["yaw_deg"]) > 300
    measures = measure(log)
    assert measures.landings >= 1
    assert measures.moving_min > 0
    assert (measures.changes_in_view > 0) == (condition == "head")


def test_a_session_under_no_condition_does_not_begin(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    page, _ = open_page()
    page.goto(f"{server.url}/study.html#scene={SMALL}")
    page.wait_for_selector("#study-failed")
    assert "expected landings" in page.locator("#study-failed").inner_text()
