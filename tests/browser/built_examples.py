"""The examples for web developers, built by Vite and served on an origin of their own."""

from __future__ import annotations

import contextlib
import functools
import http.server
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

__all__ = ["EXAMPLES", "built_examples"]

WEB = Path(__file__).resolve().parents[2] / "client_sdk" / "web"
EXAMPLES = WEB / "examples"


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@contextlib.contextmanager
def built_examples(folder: Path, *examples: Path) -> Iterator[str]:
    """Build these projects into a folder, each below its own name; the origin that serves it."""
    node, vite = shutil.which("node"), WEB / "node_modules" / "vite" / "bin" / "vite.js"
    if node is None or not vite.is_file():
        pytest.skip("no Node on the PATH, or no node_modules (npm ci in client_sdk/web)")
    config = str(EXAMPLES / "vite.config.ts")
    for example in examples:
        subprocess.run(
            [node, str(vite), "build", "--config", config, "--outDir", str(folder / example.name)],
            cwd=example,
            check=True,
            capture_output=True,
        )
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
