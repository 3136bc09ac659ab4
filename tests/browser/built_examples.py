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

__all__ = ["EXAMPLES", "built_examples", "served"]

WEB = Path(__file__).resolve().parents[2] / "client_sdk" / "web"
EXAMPLES = WEB / "examples"


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


_BUILD = """
import { build } from "vite";
const [configFile, root, outDir, three] = process.argv.slice(1);
const alias = [{ find: /^three(?=$|\\/)/, replacement: three }];
await build({ configFile, root, logLevel: "error", resolve: { alias }, build: { outDir } });
"""


@contextlib.contextmanager
def built_examples(folder: Path, *examples: Path, three: str = "three") -> Iterator[str]:
    """Build these projects into a folder, each below its own name; the origin that serves it.

    ``three`` names the installed package that three.js is taken from.
    """
    node, vite = shutil.which("node"), WEB / "node_modules" / "vite" / "bin" / "vite.js"
    if node is None or not vite.is_file() or not (WEB / "node_modules" / three).is_dir():
        pytest.skip(f"no Node on the PATH, or no vite or {three} (npm ci in client_sdk/web)")
    config = str(EXAMPLES / "vite.config.ts")
    for example in examples:
        subprocess.run(
            [
                *(node, "--input-type=module", "-e", _BUILD),
                *(config, str(example), str(folder / example.name), three),
            ],
            cwd=WEB,
            check=True,
            capture_output=True,
        )
    with served(folder) as origin:
        yield origin


@contextlib.contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder of files; the origin."""
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
