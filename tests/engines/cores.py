"""Compile the engine clients' cores, their tests and tools; once for all processes of a test run.

What is built lies in a folder named after the sources (``TERRAPORT_ENGINES_BUILD``, else the
system's folder for temporary files), so a second run has nothing to do.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = [
    "UNITY",
    "UNREAL",
    "BuildError",
    "CsCore",
    "built",
    "compile_cs",
    "missing_for",
    "run_logged",
]

ROOT: Final = Path(__file__).resolve().parents[2]
UNITY: Final = ROOT / "client_sdk" / "unity"
UNREAL: Final = ROOT / "client_sdk" / "unreal"

BUILD_TIMEOUT_S: Final = 600
"""Of one compiler: two cores may be shared with other tests."""

MCS: Final = ("mcs", "-langversion:latest", "-warnaserror", "-optimize+", "-debug-")
CS_REFERENCES: Final = ("-r:System.Net.Http.dll", "-r:System.Core.dll")
UNASSIGNED: Final = "-nowarn:0649"
"""Fields that are set by initialisers elsewhere, or by Unity from a scene, look unassigned."""

WITHOUT_UNITY: Final = ("Axes.cs", "PackedMesh.cs")
"""Files of the Runtime that the programs run: plain arithmetic."""


class BuildError(Exception):
    """A compiler failed; the text is what it said."""


@dataclass(frozen=True)
class CsCore:
    """What was compiled of ``client_sdk/unity``."""

    folder: Path

    @property
    def library(self) -> Path:
        return self.folder / "Terraport.Core.dll"

    @property
    def program(self) -> list[str]:
        """Command of the programs: ``corpus``, ``land``, ``decode``, ``axes`` follow."""
        return ["mono", str(self.folder / "terraport-tools.exe")]


def missing_for(language: str) -> str | None:
    """Say what this machine lacks to build the C# core; None where nothing."""
    assert language == "csharp"
    needed = {"mcs": "mono-mcs", "mono": "mono-runtime"}
    packages = [package for name, package in needed.items() if shutil.which(name) is None]
    return f"apt-get install {' '.join(packages)}" if packages else None


def csharp() -> CsCore:
    """Compile core and programs with Mono's compiler."""
    core = sorted((UNITY / "Core").rglob("*.cs"))
    tools = [
        *sorted((UNITY / "Tools~").glob("*.cs")),
        *(UNITY / "Runtime" / name for name in WITHOUT_UNITY),
    ]

    def build(folder: Path) -> None:
        compiled = CsCore(folder)
        compile_cs(core, compiled.library, ["-doc:" + str(folder / "Terraport.Core.xml")])
        own = f"-r:{compiled.library}"
        compile_cs(tools, folder / "terraport-tools.exe", [own], target="exe")

    return CsCore(built("csharp", [*core, *tools], build))


def compile_cs(
    sources: Iterable[Path], out: Path, extra: Sequence[str] = (), *, target: str = "library"
) -> str:
    """Compile some C# files; returns what the compiler said."""
    files = [str(path) for path in sources]
    if not files:
        raise BuildError(f"no sources for {out.name}")
    return run_logged(
        [*MCS, f"-target:{target}", f"-out:{out}", *CS_REFERENCES, UNASSIGNED, *extra, *files]
    )


def run_logged(command: Sequence[str], *, timeout_s: float = BUILD_TIMEOUT_S) -> str:
    """Run a program that must succeed; returns all that it said."""
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=timeout_s,
        check=False,
    )
    if done.returncode != 0:
        shown = " ".join(command)
        raise BuildError(f"exit code {done.returncode}: {shown[:400]}\n{done.stdout[-8000:]}")
    return done.stdout


def built(name: str, sources: Sequence[Path], build: Callable[[Path], None]) -> Path:
    """Return the folder of a build of exactly these sources; builds where nobody has."""
    # The checkout too: compiled tests name the data beside them by its path.
    digest = hashlib.sha256(str(ROOT).encode())
    for path in [*sources, Path(__file__)]:
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    places = Path(
        os.environ.get("TERRAPORT_ENGINES_BUILD")
        or Path(tempfile.gettempdir()) / f"terraport-engines-{os.getuid()}"
    )
    places.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = places / f"{name}-{digest.hexdigest()[:16]}"
    with (places / f"{name}.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        finished, failed = folder / ".finished", folder / ".failed"
        if failed.is_file():  # another process of this run met it: once is enough
            raise BuildError(failed.read_text())
        if not finished.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            try:
                build(folder)
            except BuildError as error:
                failed.write_text(str(error))
                raise
            finished.touch()
            _forget_older(places, name, folder)
    return folder


def _forget_older(places: Path, name: str, newest: Path) -> None:
    """Keep two builds of a kind: a folder for temporary files is not a museum."""
    builds = sorted(
        (path for path in places.glob(f"{name}-*") if path != newest),
        key=lambda path: path.stat().st_mtime,
    )
    for path in builds[:-1]:
        shutil.rmtree(path, ignore_errors=True)
