"""Build the Godot client, run it in the engine under Xvfb, and read what came of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from engines import cores

__all__ = ["GODOT", "Engine", "Visit", "build", "missing"]

GODOT: Final = cores.ROOT / "client_sdk" / "godot"
PROGRAM: Final = "godot3"
TIMEOUT_S: Final = 240
NO_PART: Final = ("src", "bin", ".import")
"""Folders that a project does not hold."""


@dataclass(frozen=True)
class Visit:
    """What `tests/drive.gd` wrote down."""

    events: list[dict[str, Any]]
    """Signals of the node in their order, each with its ``event`` and the ``frame``."""
    results: list[Any]
    """One of each step."""
    failure: str
    """Why it ended early; empty where it did not."""
    output: str = field(repr=False, default="")
    """All that the engine said."""

    def of(self, event: str) -> list[dict[str, Any]]:
        """Return the signals of one name."""
        return [facts for facts in self.events if facts["event"] == event]


def missing() -> str | None:
    """Say what this machine lacks to build and run the client; None where nothing."""
    needed = {"g++": "g++", "cmake": "cmake", PROGRAM: "godot3", "xvfb-run": "xvfb xauth"}
    packages = [package for name, package in needed.items() if shutil.which(name) is None]
    packages += [] if Path("/usr/include/zlib.h").is_file() else ["zlib1g-dev"]
    return f"apt-get install {' '.join(packages)}" if packages else None


def build() -> Engine:
    """Compile the library and lay out the project with it, once for all test processes."""
    native = [GODOT / "CMakeLists.txt", *sorted((GODOT / "src").iterdir())]
    core = sorted((cores.UNREAL / "Source").rglob("*"))
    sources = [path for path in core if path.suffix in {".h", ".cpp"}]

    def compile_library(folder: Path) -> None:
        configure = ["cmake", "-S", str(GODOT), "-B", str(folder / "build")]
        options = [
            f"-DCMAKE_INSTALL_PREFIX={folder}",
            "-DCMAKE_UNITY_BUILD=ON",
            "-DCMAKE_UNITY_BUILD_BATCH_SIZE=20",
            "-DCMAKE_CXX_FLAGS_RELEASE=-O1",
        ]
        cores.run_logged([*configure, *options])
        cores.run_logged(["cmake", "--build", str(folder / "build"), "-j", str(os.cpu_count())])
        cores.run_logged(["cmake", "--install", str(folder / "build")])

    library = cores.built("godot-library", [*native, *sources], compile_library)
    own = [path for path in sorted(GODOT.rglob("*")) if path.is_file() and "bin" not in path.parts]

    def lay_out(folder: Path) -> None:
        project = folder / "project"
        shutil.copytree(GODOT, project, ignore=shutil.ignore_patterns(*NO_PART))
        shutil.copytree(library / "addons", project / "addons", dirs_exist_ok=True)

    return Engine(cores.built("godot", [*own, *sources], lay_out) / "project")


@dataclass(frozen=True)
class Engine:
    """A project that holds the client, with its library."""

    project: Path

    def visit(
        self,
        scene_url: str,
        *steps: Sequence[Any],
        meanwhile: Callable[[], None] | None = None,
        width: int = 256,
        height: int = 144,
        magenta: bool = False,
        fov_deg: float = 60.0,
        renderer: str = "GLES3",
        **properties: object,
    ) -> Visit:
        """Open a scene in the engine and go through steps; see ``tests/drive.gd`` for them.

        Parameters
        ----------
        meanwhile
            Called once the engine has been started.
        width, height
            Of the window, pixels.
        magenta
            Clear to a colour that no ground has.
        fov_deg
            Of the camera, upright.
        renderer
            ``GLES3`` or ``GLES2``.
        **properties
            Of the node.
        """
        with tempfile.TemporaryDirectory() as folder:
            steps_file, out = Path(folder) / "steps.json", Path(folder) / "out.json"
            order = {
                "width": width,
                "height": height,
                "magenta": magenta,
                "fov": fov_deg,
                "properties": {"scene_url": scene_url, **properties},
                "steps": [["open"], *steps],
            }
            steps_file.write_text(json.dumps(order))
            output = self.run(
                ["--video-driver", renderer, "-s", "res://tests/drive.gd"],
                {"TERRAPORT_STEPS": str(steps_file), "TERRAPORT_OUT": str(out)},
                meanwhile,
            )
            if not out.is_file():
                raise AssertionError(f"the engine wrote nothing:\n{output[-4000:]}")
            told = json.loads(out.read_text())
        return Visit(told["events"], told["results"][1:], told["failure"], output)

    def run(
        self,
        arguments: Sequence[str],
        environment: dict[str, str],
        meanwhile: Callable[[], None] | None = None,
    ) -> str:
        """Run the engine in the project, on a screen of its own; returns all that it said."""
        with tempfile.TemporaryDirectory() as home:
            # A home of its own: the engine writes settings and caches there, in folders that exist.
            for name in (".cache", ".config", ".local/share/godot/app_userdata/terraport"):
                (Path(home) / name).mkdir(parents=True)
            own = {"HOME": home, "LANG": "en_GB.UTF-8", "LP_NUM_THREADS": "2"}
            # Where a screen cannot be locked, another number is tried.
            screen = ["xvfb-run", "-a", "-s", "-screen 0 1280x720x24 -nolisten tcp"]
            engine = [PROGRAM, "--audio-driver", "Dummy", "--path", str(self.project)]
            process = subprocess.Popen(
                [*screen, *engine, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                env=os.environ | own | environment,
            )
            try:
                if meanwhile is not None:
                    meanwhile()
                return process.communicate(timeout=TIMEOUT_S)[0]
            except BaseException:
                process.kill()
                raise
