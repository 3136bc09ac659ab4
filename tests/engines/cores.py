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

__all__ = ["UNITY", "UNREAL", "BuildError", "CppCore", "CsCore", "missing_for", "run_logged"]

ROOT: Final = Path(__file__).resolve().parents[2]
UNITY: Final = ROOT / "client_sdk" / "unity"
UNREAL: Final = ROOT / "client_sdk" / "unreal"

BUILD_TIMEOUT_S: Final = 600
"""Of one compiler: two cores may be shared with other tests."""

MCS: Final = ("mcs", "-langversion:latest", "-warnaserror", "-unsafe", "-optimize+", "-debug-")
CS_REFERENCES: Final = ("-r:System.Net.Http.dll", "-r:System.Core.dll")
NUNIT: Final = "/usr/lib/cli/nunit.framework-2.6.3/nunit.framework.dll"

WITHOUT_UNITY: Final = ("Axes.cs", "PackedMesh.cs", "TintedVertex.cs", "PhotoVertex.cs")
"""Files of the Runtime that the axes' tool runs: plain arithmetic."""

UNITY_FOLDERS: Final = ("Core", "Runtime", "Editor", "Samples~", "Stubs~", "Tests/Runtime")


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
    def tests(self) -> Path:
        return self.folder / "Terraport.Core.Tests.dll"

    @property
    def layer_tests(self) -> Path:
        """Of the Runtime, on the stubs; only of what `unity_layer` returns."""
        return self.folder / "Terraport.Runtime.Tests.dll"

    def tool(self, name: str) -> list[str]:
        """Command of one tool: ``corpus``, ``land``, ``decode``, ``axes``."""
        return ["mono", str(self.folder / "terraport-tools.exe"), name]


@dataclass(frozen=True)
class CppCore:
    """What was compiled of ``client_sdk/unreal``."""

    folder: Path

    @property
    def tests(self) -> Path:
        return self.folder / "bin" / "terraport-core-tests"

    def tool(self, name: str) -> list[str]:
        """Command of one tool: ``corpus``, ``land``, ``decode``, ``axes``."""
        return [str(self.folder / "bin" / f"terraport-{name}")]


def missing_for(language: str) -> str | None:
    """Say what this machine lacks to build a core; None where nothing."""
    if language == "csharp":
        needed = {"mcs": "mono-mcs", "mono": "mono-runtime", "nunit-console": "nunit-console"}
        files = {NUNIT: "libnunit-cil-dev"}
    else:
        needed = {"g++": "g++", "cmake": "cmake"}
        files = {
            "/usr/include/doctest/doctest.h": "doctest-dev",
            "/usr/include/libwebsockets.h": "libwebsockets-dev",
        }
    packages = [package for name, package in needed.items() if shutil.which(name) is None]
    packages += [package for path, package in files.items() if not Path(path).is_file()]
    return f"apt-get install {' '.join(packages)}" if packages else None


def csharp() -> CsCore:
    """Compile core, tests and tools with Mono's compiler."""
    core = sorted((UNITY / "Core").rglob("*.cs"))
    tests = sorted((UNITY / "Tests" / "Core").rglob("*.cs"))
    tools = [
        *sorted((UNITY / "Tools~").glob("*.cs")),
        *(UNITY / "Runtime" / name for name in WITHOUT_UNITY),
    ]

    def build(folder: Path) -> None:
        made = CsCore(folder)
        compile_cs(core, made.library, ["-doc:" + str(folder / "Terraport.Core.xml")])
        own = f"-r:{made.library}"
        compile_cs(tests, made.tests, [own, f"-r:{NUNIT}"])
        compile_cs(tools, folder / "terraport-tools.exe", [own], target="exe")
        shutil.copy(NUNIT, folder)

    return CsCore(_built("csharp", [*core, *tests, *tools], build))


def cpp(*options: str, name: str = "cpp") -> CppCore:
    """Compile core, tests and tools with CMake and the system's g++; `options` are CMake's."""
    sources = [path for path in sorted(UNREAL.rglob("*")) if path.suffix in {".h", ".cpp", ".txt"}]

    def build(folder: Path) -> None:
        configure = ["cmake", "-S", str(UNREAL), "-B", str(folder), "-DCMAKE_BUILD_TYPE=Release"]
        run_logged([*configure, *options])
        run_logged(["cmake", "--build", str(folder), "-j", str(os.cpu_count() or 1)])

    return CppCore(_built(name, sources, build))


def unity_layer() -> CsCore:
    """Compile Runtime, Editor, samples and their tests against the stubs, in every variant."""
    files = {name: sorted((UNITY / name).rglob("*.cs")) for name in UNITY_FOLDERS}
    ktx = UNITY / "Runtime" / "Ktx"
    runtime = [path for path in files["Runtime"] if ktx not in path.parents]
    stubs = [path for path in files["Stubs~"] if path.parent.name in ("UnityEngine", "UnityEditor")]
    packages = [path for path in files["Stubs~"] if path.parent.name == "Packages"]
    visit = [path for path in files["Stubs~"] if path.parent.name == "Tests"]

    def build(folder: Path) -> None:
        def compiled(name: str, sources: Sequence[Path], *extra: str) -> str:
            # Fields that Unity fills from the scene look unassigned to a compiler (0649).
            compile_cs(sources, folder / name, ["-nowarn:0649", *extra])
            return f"-r:{folder / name}"

        known = [compiled("Terraport.Core.dll", files["Core"])]
        known.append(compiled("UnityStubs.dll", stubs, *known))
        browser = [*known, "-d:UNITY_WEBGL"]
        compiled("Terraport.Runtime.WebGl.dll", runtime, *browser)
        known.append(compiled("Terraport.Runtime.dll", runtime, *known))
        compiled("Terraport.Editor.dll", files["Editor"], *known)
        for variant in ("", "-d:TERRAPORT_XRI_3"):
            also = [*known, *filter(None, [variant])]
            name = variant.rpartition(":")[2] or "plain"
            also.append(compiled(f"Packages.{name}.dll", packages, *also))
            compiled(f"Terraport.Ktx.{name}.dll", sorted(ktx.rglob("*.cs")), *also)
            compiled(f"Samples.{name}.dll", files["Samples~"], *also)
        compiled("Terraport.Runtime.Tests.dll", files["Tests/Runtime"], *known, f"-r:{NUNIT}")
        compile_cs(visit, folder / "SceneOnStubs.exe", known, target="exe")
        shutil.copy(NUNIT, folder)

    return CsCore(_built("unity", [path for some in files.values() for path in some], build))


def compile_cs(
    sources: Iterable[Path], out: Path, extra: Sequence[str] = (), *, target: str = "library"
) -> str:
    """Compile some C# files; returns what the compiler said."""
    files = [str(path) for path in sources]
    if not files:
        raise BuildError(f"no sources for {out.name}")
    return run_logged([*MCS, f"-target:{target}", f"-out:{out}", *CS_REFERENCES, *extra, *files])


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


def _built(name: str, sources: Sequence[Path], build: Callable[[Path], None]) -> Path:
    """Return the folder of a build of exactly these sources; builds where nobody has."""
    digest = hashlib.sha256()
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
