"""Pack what engines install: the Unity package as a tarball, Unreal's plugin and Godot's as zips.

    python client_sdk/pack.py [OUT] [--list]        OUT: dist

Unity takes ``com.terraport.client-VERSION.tgz`` by *Package Manager > + > Add package from
tarball*; ``terraport-unreal-VERSION.zip`` is unpacked in a project's ``Plugins``;
``terraport-godot-VERSION.zip`` holds a project with the addon. The same sources give the same
bytes. What only tests, stubs and tools need stays behind.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Final

__all__ = ["godot_files", "unity_files", "unity_tarball", "unreal_files", "write_zip"]

SDK: Final = Path(__file__).resolve().parent
UNITY: Final = SDK / "unity"
UNREAL: Final = SDK / "unreal"
GODOT: Final = SDK / "godot"

LICENSE: Final = SDK.parent / "LICENSE"

UNITY_LEFT_OUT: Final = ("Tests", "Tests.meta", "Stubs~", "Tools~")
UNREAL_TAKEN: Final = ("Terraport.uplugin", "README.md", "Content", "Source")
GODOT_TAKEN: Final = ("README.md", "addons", "example", "project.godot")
SKIPPED: Final = ("__pycache__", ".clang-format")

ZIP_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""The earliest time that a zip can say."""


def unity_files() -> dict[str, Path]:
    """Return the files of the tarball by their names in it, as npm packs: below ``package``."""
    return {
        f"package/{path.relative_to(UNITY).as_posix()}": path
        for path in _files(UNITY)
        if path.relative_to(UNITY).parts[0] not in UNITY_LEFT_OUT
    }


def unreal_files() -> dict[str, Path]:
    """Return the files of the zip by their names in it: one folder, with what a build reads."""
    files = {
        f"Terraport/{path.relative_to(UNREAL).as_posix()}": path
        for path in _files(UNREAL)
        if path.relative_to(UNREAL).parts[0] in UNREAL_TAKEN
    }
    return {**files, "Terraport/LICENSE": LICENSE}


def godot_files() -> dict[str, Path]:
    """Return the files of the zip by their names in it: one folder, a project."""
    files = {
        f"terraport-godot/{path.relative_to(GODOT).as_posix()}": path
        for path in _files(GODOT)
        if path.relative_to(GODOT).parts[0] in GODOT_TAKEN
    }
    return {**files, "terraport-godot/LICENSE": LICENSE}


def unity_tarball(out: Path) -> Path:
    """Write the tarball into a folder; returns its path."""
    version = json.loads((UNITY / "package.json").read_text("utf-8"))["version"]
    target = out / f"com.terraport.client-{version}.tgz"
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, path in sorted(unity_files().items()):
            entry = tarfile.TarInfo(name)
            entry.size = path.stat().st_size
            with path.open("rb") as content:
                tar.addfile(entry, content)
    target.write_bytes(gzip.compress(packed.getvalue(), mtime=0))
    return target


def write_zip(out: Path, engine: str, files: dict[str, Path]) -> Path:
    """Write an engine's zip into a folder; returns its path."""
    version = json.loads((UNREAL / "Terraport.uplugin").read_text("utf-8"))["VersionName"]
    target = out / f"terraport-{engine}-{version}.zip"
    with zipfile.ZipFile(target, "w") as archive:
        for name, path in sorted(files.items()):
            entry = zipfile.ZipInfo(name, ZIP_EPOCH)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)
    return target


def _files(root: Path) -> list[Path]:
    return [
        path
        for path in sorted(root.rglob("*"))
        if path.is_file() and not any(part in SKIPPED for part in path.relative_to(root).parts)
    ]


def main() -> int:
    """Pack all, and say what came of it."""
    parser = argparse.ArgumentParser(description="Pack what Unity, Unreal and Godot install.")
    parser.add_argument("out", nargs="?", type=Path, default=Path("dist"), help="folder (dist)")
    parser.add_argument("--list", action="store_true", help="print the files, write nothing")
    options = parser.parse_args()
    if options.list:
        print("\n".join(sorted([*unity_files(), *unreal_files(), *godot_files()])))
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    for path in (
        unity_tarball(options.out),
        write_zip(options.out, "unreal", unreal_files()),
        write_zip(options.out, "godot", godot_files()),
    ):
        content = path.read_bytes()
        print(f"{path}  {len(content):,} bytes  sha256 {hashlib.sha256(content).hexdigest()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
