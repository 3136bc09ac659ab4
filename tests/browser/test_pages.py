"""Segments are drawn by pages: few calls, and the same picture whether or not WebGL draws many."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from browser.driven_viewer import DrivenViewer
from browser.small_scenes import PHOTOGRAPHED
from browser.watched_page import Watch
from eventually import eventually
from faults.service import Service
from playwright.sync_api import Page

NO_MULTI_DRAW = """(() => {
  const proto = WebGL2RenderingContext.prototype;
  const ask = proto.getExtension;
  proto.getExtension = function (name) {
    return name === "WEBGL_multi_draw" ? null : ask.call(this, name);
  };
})();"""
PICTURE = """async (pose) => {
  glWatch.groundOnly = true;
  await terraport.look(pose);
  const gl = glWatch.context;
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const rgba = new Uint8Array(width * height * 4);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  let hash = 0;
  for (const value of rgba) hash = (Math.imul(hash, 31) + value) | 0;
  return {hash, draws: glWatch.draws, ranges: glWatch.ground().length};
}"""


def test_a_page_is_one_call_or_as_many_as_it_has_ranges(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    seen: list[dict[str, Any]] = []
    for script in (None, NO_MULTI_DRAW):
        page, watch = open_page()
        watch.allow("WEBGL_multi_draw extension not supported")
        viewer = DrivenViewer(page, server.url, PHOTOGRAPHED)
        if script is not None:
            page.add_init_script(script)
        viewer.open()
        segments = len(viewer.land((0.0, 2.0, 0.0), 60.0)["visible"])
        pose = {"eye": [0.0, 300.0, 0.0], "yawDeg": 0, "pitchDeg": -90}
        # Moves between pages change how many there are, and nothing that is seen.
        eventually(partial(_rests, viewer), 60)
        seen.append(viewer.run(PICTURE, pose))
        assert seen[-1]["ranges"] == segments + 1
        pages = viewer.run("terraport.stats.gpu.pages")
        assert pages < segments / 2
        # The base is one more.
        assert seen[-1]["draws"] == (pages + 1 if script is None else segments + 1)
    assert seen[0]["hash"] == seen[1]["hash"]


def _rests(viewer: DrivenViewer) -> bool:
    """Whether the page draws no frame by itself: nothing is left to upload or to move."""
    before = viewer.run("glWatch.frames")
    viewer.page.wait_for_timeout(300)
    return bool(viewer.run("glWatch.frames") == before)
