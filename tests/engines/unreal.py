"""Compile the Unreal plugin's core, and its module on stubs of the engine; run their programs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from engines import cores

__all__ = ["CoreTool", "Unreal", "Visited", "missing", "unreal"]

UNREAL: Final = cores.ROOT / "client_sdk" / "unreal"
TIMEOUT_S: Final = 180
FAST: Final = (
    # Many files at once: most of the time goes into reading the same headers. What a file forgets
    # to include is found where each is compiled alone: stubs/compile.sh --each.
    "-DCMAKE_UNITY_BUILD=ON",
    "-DCMAKE_UNITY_BUILD_BATCH_SIZE=8",
    "-DCMAKE_CXX_FLAGS_RELEASE=-O1",
)


@dataclass(frozen=True)
class Visited:
    """The JSON that ``terraport-visit`` printed, and its exit code. Fields: see visit.cpp."""

    exit_code: int
    told: dict[str, Any]
    output: str = field(repr=False)

    def __getitem__(self, name: str) -> Any:
        return self.told[name]


@dataclass(frozen=True)
class Unreal:
    """What was compiled of ``client_sdk/unreal``."""

    folder: Path

    def program(self, name: str) -> Path:
        """Path of ``core-tool`` or ``visit``."""
        return self.folder / "bin" / f"terraport-{name}"

    def visit(self, scene_url: str, *steps: str, **options: object) -> Visited:
        """Visit a scene, with ``name=value`` options as flags; see visit_main.cpp for the steps."""
        flags: list[object] = []
        for name, value in options.items():
            flags += [f"--{name.replace('_', '-')}", value]
        done = subprocess.run(
            [self.program("visit"), scene_url, *map(str, [*flags, *steps])],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
            check=False,
        )
        try:
            told = json.loads(done.stdout.strip().splitlines()[-1])
        except (IndexError, ValueError):
            raise AssertionError(f"no JSON from visit:\n{done.stdout[-4000:]}") from None
        return Visited(done.returncode, told, done.stdout)


class CoreTool:
    """``terraport-core-tool``: a command a line, a line of JSON for each."""

    def __init__(self, built: Unreal) -> None:
        self._process = subprocess.Popen(
            [built.program("core-tool")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, command: str) -> Any:
        """Send a command; return its answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate(timeout=10)


def missing() -> str | None:
    """Return what this machine lacks to compile it; None where nothing."""
    files = {
        "/usr/include/libwebsockets.h": "libwebsockets-dev",
        "/usr/include/zlib.h": "zlib1g-dev",
    }
    packages = [name for name in ("g++", "cmake") if shutil.which(name) is None]
    packages += [package for path, package in files.items() if not Path(path).is_file()]
    return f"apt-get install {' '.join(packages)}" if packages else None


def unreal(*options: str, name: str = "unreal") -> Unreal:
    """Compile with CMake; `options` are CMake's, otherwise for a fast build."""
    sources = [path for path in sorted(UNREAL.rglob("*")) if path.suffix in {".h", ".cpp", ".txt"}]

    def build(folder: Path) -> None:
        configure = ["cmake", "-S", str(UNREAL), "-B", str(folder), "-DCMAKE_BUILD_TYPE=Release"]
        cores.run_logged([*configure, *(options or FAST)])
        cores.run_logged(["cmake", "--build", str(folder), "-j", str(os.cpu_count() or 1)])

    return Unreal(cores.built(name, sources, build))
