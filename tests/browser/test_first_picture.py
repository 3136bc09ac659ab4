"""What comes before the first picture of a scene, and what is drawn meanwhile."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from browser.driven_viewer import DrivenViewer
from browser.watched_page import Watch, save_shot
from faults.service import Service
from playwright.sync_api import Page, Request, Route

import terraport_server
from terraport_store import Scene
from terraport_store.layout import OVERVIEW

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"
ASSETS = Path(terraport_server.__file__).with_name("page") / "assets"
MAX_FIRST_BYTES = 600_000


def test_the_overview_is_there_before_the_base(
    open_page: Callable[..., tuple[Page, Watch]], tmp_path: Path
) -> None:
    page, _ = open_page()
    received: dict[str, int] = {}

    def came(request: Request) -> None:
        sizes = request.sizes()
        received[request.url] = sizes["responseBodySize"] + sizes["responseHeadersSize"]

    held_back: list[Route] = []
    shutil.copytree(SAMPLE, tmp_path / "scenes" / "sample_scene")
    with Scene.open(SAMPLE) as scene:
        overview_faces = len(scene.file_mesh(OVERVIEW).faces)
    with Service(tmp_path / "scenes") as running:
        page.on("requestfinished", came)
        page.context.route(re.compile(r"/base\.(glb|tsg)"), lambda route: held_back.append(route))
        viewer = DrivenViewer(page, running.url, "sample_scene")
        viewer.open()
        # The overview's list of faces is drawn, while the base has not even been sent.
        assert [count for _, count in viewer.run("glWatch.ground()")] == [3 * overview_faces]
        save_shot(page, "first-picture-overview")
        # Workers' scripts are not in these sizes: counted from the disk, as they are sent.
        worker_bytes = sum(path.stat().st_size for path in ASSETS.glob("*.worker-*.js.br"))
        assert held_back
        assert not any(re.search(r"/base\.(glb|tsg)", url) for url in received)
        assert sum(received.values()) + worker_bytes < MAX_FIRST_BYTES

        # A landing that is asked for now waits for base and cover.
        viewer.begin_landing((0.0, 3.0, 0.0), 8.0)
        viewer.until("terraport.status.readyMs !== null")
        assert viewer.visible == []
        for route in held_back:
            route.continue_()
        viewer.until("window.went !== null")
        assert viewer.run("window.went") == "shown"
        assert viewer.visible
        save_shot(page, "first-picture-landed")
