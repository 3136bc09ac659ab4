"""Pictures of each way of looking, compared with committed ones.

``TERRAPORT_WRITE_PICTURES=1 python -m pytest tests/browser/test_pictures.py`` writes them anew:
look at every one before it is committed.

Kept are pictures half as large, in 256 colours. Another build of Chromium smooths lines and letters
otherwise, so they are compared at a quarter of the page's size: each pixel there is the mean of
sixteen, and such differences vanish while another colour of the ground, a missing panel or a hole
does not. The last test shows that.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import PHOTOGRAPHED, SMALL
from browser.watched_page import Watch
from faults.service import Service
from PIL import Image
from playwright.sync_api import Page

from terraport_payload.types import UInt8

PICTURES: Final = Path(__file__).with_name("pictures")

MEAN_TOLERANCE: Final = 2.0
"""Mean difference of the channels, of 255."""
FAR: Final = 24
FAR_SHARE: Final = 0.005
"""So many of the small pixels may differ by more than FAR."""

# From the south, over the pit: detail in the middle, base around it.
EYE: Final = (0.0, 60.0, 95.0)
POSITION: Final = (0.0, 2.0, 0.0)
SCENES: Final = {
    "colour": (SMALL, "colour"),
    "vertex-colour": (PHOTOGRAPHED, "vertex-colour"),
    "regions": (SMALL, "regions"),
    "segments": (SMALL, "segments"),
    "attribute": (SMALL, "attribute&attribute=grade"),
    "slope": (SMALL, "slope"),
    "textured": (PHOTOGRAPHED, "colour"),
}

OpenPage = Callable[..., tuple[Page, Watch]]


@pytest.mark.parametrize("name", SCENES)
def test_ways_to_colour_the_ground(open_page: OpenPage, server: Service, name: str) -> None:
    scene, mode = SCENES[name]
    viewer = landed(open_page, server, scene, mode)
    check(f"ground-{name}", viewer.page.screenshot())


@pytest.mark.parametrize("name", ["light", "dark", "phone"])
def test_the_page(open_page: OpenPage, server: Service, name: str) -> None:
    options: dict[str, Any] = {"color_scheme": "dark" if name == "dark" else "light"}
    if name == "phone":
        options |= {"viewport": {"width": 360, "height": 640}, "has_touch": True, "is_mobile": True}
    viewer = landed(open_page, server, SMALL, "regions", **options)
    viewer.page.get_by_role("button", name="Panel").click()
    viewer.page.get_by_role("tab", name="Look").click()
    viewer.look(EYE, 0.0, -32.0)
    viewer.page.wait_for_timeout(500)
    check(f"page-{name}", viewer.page.screenshot())


def test_a_wrong_picture_is_found(open_page: OpenPage, server: Service) -> None:
    """Each picture of the ground differs from every other by more than is tolerated."""
    viewer = landed(open_page, server, SMALL, "colour")
    good = read(viewer.page.screenshot())
    viewer.run("() => terraport.setMode({kind: 'slope'})")
    viewer.look(EYE, 0.0, -32.0)
    assert not is_alike(good, read(viewer.page.screenshot()))
    pictures = [read((PICTURES / f"ground-{name}.png").read_bytes(), shrink=1) for name in SCENES]
    for number, picture in enumerate(pictures):
        for other in pictures[number + 1 :]:
            assert not is_alike(picture, other)
    # A hole of 30 by 20 pixels of these, as a segment that is missing leaves.
    holed = good.copy()
    holed[80:100, 150:180] = (210, 220, 230)
    assert not is_alike(good, holed)
    # What is nearly the same passes: noise, and all of it a little lighter.
    noise = np.random.default_rng(6).integers(-6, 8, good.shape)
    assert is_alike(good, np.clip(good.astype(int) + noise, 0, 255).astype(np.uint8))


def landed(
    open_page: OpenPage, server: Service, scene: str, mode: str, **options: Any
) -> DrivenViewer:
    page, _ = open_page(reduced_motion="reduce", **options)
    viewer = DrivenViewer(page, server.url, scene)
    viewer.open(f"&mode={mode}")
    viewer.land(POSITION, 45.0)
    viewer.look(EYE, 0.0, -32.0)
    # The landing's edge is draped over the ground in the frames that follow.
    viewer.until("glWatch.frame.length > glWatch.ground().length")
    return viewer


def check(name: str, picture: bytes) -> None:
    file = PICTURES / f"{name}.png"
    drawn = read(picture)
    if os.environ.get("TERRAPORT_WRITE_PICTURES") == "1":
        few = Image.fromarray(drawn).quantize(256, kmeans=1, dither=Image.Dither.NONE)
        few.save(file, optimize=True)
    expected = read(file.read_bytes(), shrink=1)
    assert expected.shape == drawn.shape
    mean, share = difference(expected, drawn)
    assert is_alike(expected, drawn), f"{name}: mean difference {mean:.1f}, far {share:.3f}"


def read(png: bytes, shrink: int = 2) -> UInt8:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    size = picture.width // shrink, picture.height // shrink
    return np.array(picture.resize(size, Image.Resampling.BOX))


def difference(first: UInt8, second: UInt8) -> tuple[float, float]:
    """Return the mean difference of the small pictures, and the share of pixels far apart."""
    height, width = first.shape[0] // 2, first.shape[1] // 2
    small = [
        picture[: height * 2, : width * 2].reshape(height, 2, width, 2, 3).mean((1, 3))
        for picture in (first, second)
    ]
    apart = np.abs(small[0] - small[1])
    return float(apart.mean()), float((apart.max(2) > FAR).mean())


def is_alike(first: UInt8, second: UInt8) -> bool:
    mean, share = difference(first, second)
    return mean <= MEAN_TOLERANCE and share <= FAR_SHARE
