"""Compile the Unity package against stubs of the engine's API, as several releases of Unity.

A release differs from another in the defines that it sets and in what its API has, marks obsolete
or refuses; the stubs say so by ``#if`` and ``[Obsolete]``. Warnings are errors, so that a member
which is obsolete in a release does not compile there either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from engines.cores import UNITY, CsCore, built, compile_cs

__all__ = ["LADDER", "NEWEST", "RELEASES", "UnityLayer", "defines_of", "unity_layer"]

RELEASES: Final = ("2021.3", "2022.3", "6000.0", "6000.3", "6000.5", "6000.7")
"""Those whose public API is known, member by member (see ``test_unity_api.py``)."""

NEWEST: Final = RELEASES[-1]

LADDER: Final = (
    *(f"{year}.{minor}" for year in range(2017, 2020) for minor in range(1, 5)),
    *(f"{year}.{minor}" for year in range(2020, 2024) for minor in range(1, 4)),
    *(f"6000.{minor}" for minor in range(8)),
)
"""Releases in their order; each defines ``UNITY_X_Y_OR_NEWER`` for itself and all before it."""

OLD_INPUT: Final = "ENABLE_LEGACY_INPUT_MANAGER"
NEW_INPUT: Final = "ENABLE_INPUT_SYSTEM"
PROJECTS: Final = {
    "old": (OLD_INPUT,),
    "new": (NEW_INPUT, "TERRAPORT_INPUT_SYSTEM", "TERRAPORT_XRI_3"),
    "both": (OLD_INPUT, NEW_INPUT, "TERRAPORT_INPUT_SYSTEM", "TERRAPORT_XRI_3"),
    # Switched on in the settings, and its package is not installed.
    "bare": (NEW_INPUT,),
}
"""What projects have installed and switched on: the packages' stubs and the samples differ."""

FOLDERS: Final = ("Core", "Runtime", "Editor", "Samples~", "Stubs~")


@dataclass(frozen=True)
class UnityLayer(CsCore):
    """Runtime, editor and samples, compiled as one release of Unity."""

    release: str

    @property
    def stubs(self) -> Path:
        """Stubs of the engine and its editor, as this release has them."""
        return self.folder / "UnityStubs.dll"

    def packages(self, project: str) -> Path:
        """Stubs of the packages that a project of `PROJECTS` has."""
        return self.folder / f"Packages.{project}.dll"

    def compile(self, sources: Sequence[Path], out: Path, *options: str) -> str:
        """Compile other sources as the Runtime is compiled."""
        references = [f"-r:{path}" for path in (self.library, self.stubs)]
        return compile_cs(sources, out, [*_options(self.release), *references, *options])


def defines_of(release: str) -> tuple[str, ...]:
    """Return the version defines that a release of Unity sets.

    Raises
    ------
    ValueError
        The release is not in `LADDER`.
    """
    newest = LADDER.index(release)
    return tuple(f"UNITY_{earlier.replace('.', '_')}_OR_NEWER" for earlier in LADDER[: newest + 1])


def unity_layer(release: str = NEWEST) -> UnityLayer:
    """Compile Runtime, Editor and samples as one release, in every variant."""
    files = {name: sorted((UNITY / name).rglob("*.cs")) for name in FOLDERS}
    ktx = UNITY / "Runtime" / "Ktx"
    runtime = [path for path in files["Runtime"] if ktx not in path.parents]
    stubs = {
        folder.name: [path for path in files["Stubs~"] if path.parent == folder]
        for folder in {path.parent for path in files["Stubs~"]}
    }

    def build(folder: Path) -> None:
        def compiled(name: str, sources: Sequence[Path], *extra: str) -> str:
            compile_cs(sources, folder / name, [*_options(release), *extra])
            return f"-r:{folder / name}"

        references = [compiled("Terraport.Core.dll", files["Core"])]
        references.append(
            compiled("UnityStubs.dll", [*stubs["UnityEngine"], *stubs["UnityEditor"]])
        )
        # In a folder of its own: the core's friends are known by the names of their assemblies.
        (folder / "WebGL").mkdir()
        compiled("WebGL/Terraport.Runtime.dll", runtime, *references, "-d:UNITY_WEBGL")
        references.append(compiled("Terraport.Runtime.dll", runtime, *references))
        compiled("Terraport.Editor.dll", files["Editor"], *references, "-d:UNITY_EDITOR")
        for project, defines in PROJECTS.items():
            also = [*references, *(f"-d:{define}" for define in defines)]
            also.append(compiled(f"Packages.{project}.dll", stubs["Packages"], *also))
            for name, more in ((project, ()), (f"{project}.Editor", ("-d:UNITY_EDITOR",))):
                compiled(f"Terraport.Ktx.{name}.dll", sorted(ktx.rglob("*.cs")), *also, *more)
            compiled(f"Samples.{project}.dll", files["Samples~"], *also)
        compile_cs(stubs["Tests"], folder / "SceneOnStubs.exe", references, target="exe")
        compile_cs(stubs["Facts"], folder / "StubMembers.exe", target="exe")

    sources = [*(path for some in files.values() for path in some), Path(__file__)]
    return UnityLayer(built(f"unity{release}", sources, build), release)


def _options(release: str) -> list[str]:
    return [f"-d:{define}" for define in defines_of(release)]
