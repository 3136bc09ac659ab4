"""A headset emulated in the page (iwer), and hands on its controllers.

The emulator is put into the page before its own scripts, as a browser with WebXR would have it; the
page is the built one, without anything made for tests. Poses are of the play space: metres, Y up,
-Z ahead; a yaw is counter-clockwise and a pitch upward, in degrees.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any, Final

from playwright.sync_api import Page

__all__ = ["IWER", "EmulatedHeadset"]

WEB: Final = Path(__file__).parents[2] / "client_sdk" / "web"
IWER: Final = WEB / "node_modules" / "iwer" / "build" / "iwer.min.js"

_INSTALL: Final = """
;{
  const device = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true });
  device.installRuntime({ forceInstall: true });
  device.stereoEnabled = true;
  device.position.set(0.3, 1.65, 0.2);
  window.emulated = { device, trace: null };
  // Every frame of the headset, once drawn: how bright it is, and what the viewer tells.
  const small = document.createElement("canvas");
  small.width = 16;
  small.height = 8;
  const context = small.getContext("2d", { willReadFrequently: true });
  const request = XRSession.prototype.requestAnimationFrame;
  XRSession.prototype.requestAnimationFrame = function (callback) {
    return request.call(this, (time, frame) => {
      callback(time, frame);
      const { trace } = window.emulated;
      const { terraport } = window;
      if (trace === null || !terraport?.headset) return;
      const canvas = document.querySelector("[data-webxr_runtime] canvas");
      context.drawImage(canvas, 0, 0, 16, 8);
      const pixels = context.getImageData(0, 0, 16, 8).data;
      const light = (x, y) => Math.max(...pixels.slice(4 * (16 * y + x), 4 * (16 * y + x) + 3));
      let most = 0;
      for (let y = 0; y < 8; y++) for (let x = 0; x < 16; x++) most = Math.max(most, light(x, y));
      trace.push({
        most,
        // Middle and corners of the left eye's picture.
        middle: Math.min(light(3, 3), light(4, 3), light(3, 4), light(4, 4)),
        corners: Math.max(light(0, 0), light(7, 0), light(0, 7), light(7, 7)),
        digest: terraport.visibleDigest,
        phase: terraport.headset.stats().phase,
        standpoint: terraport.headset.standpoint,
      });
    });
  };
}
"""


class EmulatedHeadset:
    """Drives the headset of one page; make it before the page goes anywhere."""

    def __init__(self, page: Page) -> None:
        self.page = page
        page.add_init_script(script=IWER.read_text("utf-8") + _INSTALL)

    # Page.wait_for_function evaluates text, which the content policy of the page forbids.
    def until(self, expression: str, timeout_s: float = 90.0) -> Any:
        """Wait for an expression to be true in the page, and return it."""
        end = time.monotonic() + timeout_s
        while not (value := self.page.evaluate(expression)):
            assert time.monotonic() < end, f"never true: {expression}"
            self.page.wait_for_timeout(30)
        return value

    def open(self, url: str) -> None:
        """Open a scene, and wait for its viewer."""
        self.page.goto(url)
        self.until("!!window.terraport && terraport.frames > 0")

    def enter(self) -> None:
        """Click the page's button, and wait for the first frames in the headset."""
        self.page.locator("#enter-headset").click()
        self.until("!!terraport.headset && terraport.headset.standpoint !== null")
        self.frames(4)

    def frames(self, count: int) -> None:
        """Wait until so many frames were drawn."""
        drawn = self.page.evaluate("terraport.frames")
        self.until(f"terraport.frames >= {drawn + count}")

    def trace(self) -> None:
        """Begin to note every frame."""
        self.page.evaluate("emulated.trace = []")

    def traced(self) -> list[dict[str, Any]]:
        """The frames since :meth:`trace`."""
        frames: list[dict[str, Any]] = self.page.evaluate("emulated.trace")
        return frames

    def head(self, x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0) -> None:
        """Move the head: metres in the tracking space, degrees of yaw and pitch."""
        self._pose("device", (x, y, z), yaw, pitch)

    def point(
        self,
        hand: str,
        pitch: float,
        yaw: float = 0.0,
        at: tuple[float, float, float] = (0.2, 1.3, -0.3),
        kind: str = "controllers",
    ) -> None:
        """Point a controller, or one of the ``hands``."""
        self._pose(f"device.{kind}.{hand}", at, yaw, pitch)

    def press(self, hand: str, button: str, value: float) -> None:
        """Press a controller's button, or let it go."""
        self.page.evaluate(
            "([hand, button, value]) => "
            "emulated.device.controllers[hand].updateButtonValue(button, value)",
            [hand, button, value],
        )

    def push(self, hand: str, x: float, y: float) -> None:
        """Push a thumbstick: x right, y towards the user."""
        self.page.evaluate(
            "([hand, x, y]) => emulated.device.controllers[hand].updateAxes('thumbstick', x, y)",
            [hand, x, y],
        )

    def pinch(self, hand: str, value: float) -> None:
        """Close thumb and finger of a hand, or open them."""
        self.page.evaluate(
            "([hand, value]) => emulated.device.hands[hand].updatePinchValue(value)", [hand, value]
        )

    def phase(self) -> str:
        """The teleport's state: idle, aiming and so on."""
        phase: str = self.page.evaluate("terraport.headset.stats().phase")
        return phase

    def standpoint(self) -> tuple[list[float], float]:
        """The ground under the head, and its azimuth in degrees."""
        standpoint = self.page.evaluate("terraport.headset.standpoint")
        return standpoint["place"], standpoint["yawDeg"]

    def _pose(self, what: str, at: tuple[float, float, float], yaw: float, pitch: float) -> None:
        half_yaw, half_pitch = math.radians(yaw) / 2, math.radians(pitch) / 2
        sin_y, cos_y = math.sin(half_yaw), math.cos(half_yaw)
        sin_p, cos_p = math.sin(half_pitch), math.cos(half_pitch)
        turned = [cos_y * sin_p, sin_y * cos_p, -sin_y * sin_p, cos_y * cos_p]
        self.page.evaluate(
            f"([at, turned]) => {{ emulated.{what}.position.set(...at);"
            f" emulated.{what}.quaternion.set(...turned); }}",
            [list(at), turned],
        )
