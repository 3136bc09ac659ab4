"""What is installed in an engine: the tarball and the zip of ``client_sdk/pack.py``, opened."""

from __future__ import annotations

import json
import re
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Final

import pytest
from engines.cores import ROOT, UNITY, UNREAL, run_logged

PACK: Final = ROOT / "client_sdk" / "pack.py"


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Tarball and zips, as the command makes them."""
    out = tmp_path_factory.mktemp("dist")
    run_logged([sys.executable, str(PACK), str(out)])
    (tarball,) = out.glob("com.terraport.client-*.tgz")
    (archive,) = out.glob("terraport-unreal-*.zip")
    (godot,) = out.glob("terraport-godot-*.zip")
    return tarball, archive, godot


def test_the_tarball_is_a_package_of_unity(packed: tuple[Path, Path, Path]) -> None:
    """All below ``package``, what is imported with its .meta, and nothing that only tests need."""
    with tarfile.open(packed[0]) as tar:
        assert all(member.isfile() for member in tar)
        names = set(tar.getnames())
        manifest = tar.extractfile("package/package.json")
        assert manifest is not None
        assert json.load(manifest)["name"] == "com.terraport.client"
    assert {name.split("/")[1] for name in names} == {
        "CHANGELOG.md",
        "CHANGELOG.md.meta",
        "Core",
        "Core.meta",
        "Documentation~",
        "Editor",
        "Editor.meta",
        "LICENSE.md",
        "LICENSE.md.meta",
        "README.md",
        "README.md.meta",
        "Runtime",
        "Runtime.meta",
        "Samples~",
        "package.json",
        "package.json.meta",
    }
    imported = {n for n in names if not n.endswith(".meta") and "/Documentation~/" not in n}
    assert {f"{name}.meta" for name in imported} <= names
    for folder in ("Core", "Runtime", "Editor", "Samples~"):
        expected = {
            f"package/{path.relative_to(UNITY).as_posix()}"
            for path in (UNITY / folder).rglob("*")
            if path.is_file()
        }
        assert expected <= names
    assert "package/Samples~/FirstLanding/FirstLanding.unity" in names
    assert "package/Samples~/FirstLandingXR/XRWalker.prefab" in names
    assert "package/Runtime/Resources/TerraportGroundLit.shader" in names


def test_the_zip_is_a_plugin_of_unreal(packed: tuple[Path, Path, Path]) -> None:
    with zipfile.ZipFile(packed[1]) as archive:
        names = set(archive.namelist())
        plugin = json.loads(archive.read("Terraport/Terraport.uplugin"))
    assert {name.split("/")[0] for name in names} == {"Terraport"}
    assert {name.split("/")[1] for name in names} == {
        "Content",
        "LICENSE",
        "README.md",
        "Source",
        "Terraport.uplugin",
    }
    for module in plugin["Modules"]:
        assert f"Terraport/Source/{module['Name']}/{module['Name']}.Build.cs" in names
    sources = {
        f"Terraport/{path.relative_to(UNREAL).as_posix()}"
        for path in (UNREAL / "Source").rglob("*")
        if path.suffix in {".h", ".cpp", ".cs"}
    }
    assert sources <= names
    assert "Terraport/Content/Python/terraport_materials.py" in names


def test_the_zip_of_godot_is_a_project(packed: tuple[Path, Path, Path], tmp_path: Path) -> None:
    """What the scenes and the addon name is there."""
    with zipfile.ZipFile(packed[2]) as archive:
        archive.extractall(tmp_path)
    project = tmp_path / "terraport-godot"
    assert (project / "LICENSE").is_file()
    assert not (project / "tests").exists()
    for path in [*project.rglob("*.tscn"), *project.rglob("*.gd"), project / "project.godot"]:
        for name in re.findall(r'"res://([^"]+)"', path.read_text(encoding="utf-8")):
            assert (project / name).exists(), f"{path.name} names {name}"


def test_the_same_sources_give_the_same_bytes(
    packed: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    run_logged([sys.executable, str(PACK), str(tmp_path)])
    for path in packed:
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def test_the_docs_install_what_is_made(packed: tuple[Path, Path, Path]) -> None:
    """No address that nobody has: the file's name, the folder's, and a path to a clone."""
    for page in (UNITY / "README.md", ROOT / "docs" / "how-to" / "unity.md"):
        text = page.read_text(encoding="utf-8")
        assert packed[0].name in text
        assert "client_sdk/unity/package.json" in text
        assert "?path=/client_sdk/unity" in text
        assert "HOST/terraport.git" not in text
    for page in (UNREAL / "README.md", ROOT / "docs" / "how-to" / "unreal.md"):
        assert packed[1].name in page.read_text(encoding="utf-8")
    assert packed[2].name in (ROOT / "docs" / "how-to" / "godot.md").read_text(encoding="utf-8")
