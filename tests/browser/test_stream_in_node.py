"""The viewer's stream, without a browser, on the real service: vitest's tests that need one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from browser.small_scenes import SMALL
from faults.service import Service

WEB = Path(__file__).resolve().parents[2] / "client_sdk" / "web"
TOKEN = "sixteen-characters"


def test_it_lands_and_agrees_with_the_python_sdk(server: Service, scenes: Path) -> None:
    """Landings, cut links, tokens; visible sets beside the Python SDK's; 200 clicks of the page."""
    node, vitest = shutil.which("node"), WEB / "node_modules" / "vitest" / "vitest.mjs"
    if node is None or not vitest.is_file():
        pytest.skip("no Node on the PATH, or no node_modules (npm ci in client_sdk/web)")
    with Service(scenes, token=TOKEN) as guarded:
        done = subprocess.run(
            [node, str(vitest), "run", "test/client/server.test.ts", "test/client/clicks.test.ts"],
            cwd=WEB,
            env=os.environ
            | {
                # Of Node 20 alone; later ones have WebSockets without it.
                "NODE_OPTIONS": "--experimental-websocket",
                "NO_COLOR": "1",
                "TERRAPORT_URL": server.url,
                "TERRAPORT_SCENE": SMALL,
                "TERRAPORT_PYTHON": sys.executable,
                "TERRAPORT_TOKEN_URL": guarded.url,
                "TERRAPORT_TOKEN": TOKEN,
            },
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
    output = done.stdout + done.stderr
    assert done.returncode == 0, output[-6000:]
    assert re.search(r"Tests +\d+ passed \(", output), f"some were skipped:\n{output[-3000:]}"
