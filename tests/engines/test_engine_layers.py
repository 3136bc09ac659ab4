"""The engine layers, against stubs of exactly the engine's API that they use; the packages' shape.

Neither engine is run: a stub finds a wrong name or type, not a wrong picture.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from engines import cores
from engines.conftest import skip_or_fail
from engines.unity import Unity
from engines.unity_layers import UnityLayer, unity_layer
from faults.service import Service
from server.grid_scene import write_grid_scene

UNITY, UNREAL = cores.UNITY, cores.UNREAL


@pytest.fixture(scope="module")
def layer(unity: Unity) -> UnityLayer:
    return unity_layer()


@pytest.mark.parametrize(("scene", "radius_m"), [("grid", 25), ("levels", 8)])
def test_the_unity_scene_lands_on_the_stubs(
    layer: UnityLayer, server: Service, scene: str, radius_m: int
) -> None:
    """The component itself, on a fake engine that keeps what its meshes are given."""
    program = ["mono", str(layer.folder / "SceneOnStubs.exe")]
    done = subprocess.run(
        [*program, f"{server.url}/scenes/{scene}", str(radius_m)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]


def test_the_unity_scene_follows_another_version(layer: UnityLayer, tmp_path: Path) -> None:
    """The service comes back with another version: its base and landing replace the old ones."""
    write_grid_scene(tmp_path / "scenes" / "own")
    with Service(tmp_path / "scenes") as service:
        program = ["mono", str(layer.folder / "SceneOnStubs.exe")]
        visit = subprocess.Popen(
            [*program, f"{service.url}/scenes/own", "25", "changing"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert visit.stdout is not None
        output = ""
        for line in visit.stdout:
            output += line
            if line == "change\n":
                break
        service.kill()
        shutil.rmtree(tmp_path / "scenes" / "own")
        write_grid_scene(tmp_path / "scenes" / "own", cells=14)
        service.start()
        rest, _ = visit.communicate("\n", timeout=120)
        assert visit.returncode == 0, output + rest


def test_the_shaders_of_unity_compile() -> None:
    if shutil.which("glslangValidator") is None:
        skip_or_fail("the shaders cannot be compiled (apt-get install glslang-tools)")
    cores.run_logged([sys.executable, str(UNITY / "Stubs~" / "Shaders" / "check.py")])


def test_the_shaders_of_unity_compile_by_slang() -> None:
    if importlib.util.find_spec("slangpy") is None:
        pytest.skip("no second HLSL front end (pip install slangpy: 92 MB)")
    cores.run_logged([sys.executable, str(UNITY / "Stubs~" / "Shaders" / "check.py"), "--slang"])


def test_every_file_that_unity_imports_has_its_meta() -> None:
    done = subprocess.run(
        [sys.executable, str(UNITY / "Tools~" / "metas.py"), "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    guids = [
        re.search(r"^guid: ([0-9a-f]{32})$", path.read_text(), re.MULTILINE)
        for path in UNITY.rglob("*.meta")
    ]
    assert None not in guids
    assert len({match[1] for match in guids if match}) == len(guids) > 80


def test_the_unity_package_names_what_is_there() -> None:
    package = json.loads((UNITY / "package.json").read_text())
    assert package["name"] == "com.terraport.client"
    for sample in package["samples"]:
        assert any((UNITY / sample["path"]).rglob("*.cs")), sample
    assemblies = {}
    for path in UNITY.rglob("*.asmdef"):
        definition = json.loads(path.read_text())
        assemblies[definition["name"]] = definition
    assert assemblies["Terraport.Core"]["noEngineReferences"] is True
    assert assemblies["Terraport.Core"]["references"] == []
    ours = {name for name in assemblies if name.startswith("Terraport")}
    for definition in assemblies.values():
        references = {name for name in definition["references"] if name.startswith("Terraport")}
        assert references <= ours, definition["name"]


def test_the_unity_core_knows_no_engine_and_needs_no_reflection() -> None:
    for path in (UNITY / "Core").rglob("*.cs"):
        code = re.sub(r"//.*", "", path.read_text())
        for word in ("UnityEngine", "System.Reflection", "dynamic ", "Activator."):
            assert word not in code, f"{path.name} has {word}"


def test_files_stay_readable() -> None:
    """At most 600 lines: one subject a file, as long as the subject is."""
    long = {
        str(path.relative_to(cores.ROOT)): count
        for folder in (UNITY, UNREAL)
        for path in folder.rglob("*")
        if path.suffix in {".cs", ".h", ".cpp"} and ".generated." not in path.name
        if (count := len(path.read_text().splitlines())) > 600
    }
    assert long == {}


def test_nothing_of_this_machine_is_in_the_packages() -> None:
    words = re.compile(rf"{re.escape(str(cores.ROOT))}|/(home|root|tmp)/|C:\\\\Users")
    for folder in (UNITY, UNREAL):
        for path in folder.rglob("*"):
            if path.is_file() and path.suffix in {".cs", ".h", ".cpp", ".md", ".json", ".txt"}:
                assert not words.search(path.read_text()), path
