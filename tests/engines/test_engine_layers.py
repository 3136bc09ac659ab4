"""The engine layers, against stubs of exactly the engine's API that they use; the packages' shape.

Neither engine is run: a stub finds a wrong name or type, not a wrong picture.
"""

from __future__ import annotations

import graphlib
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
from engines.test_units import run_doctest
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


def test_the_unreal_module_compiles_against_the_stubs() -> None:
    reason = cores.missing_for("cpp")
    if reason is not None:
        skip_or_fail(f"the Unreal module cannot be compiled ({reason})")
    cores.run_logged(["sh", str(UNREAL / "stubs" / "compile.sh")])


def test_the_unreal_layer_passes_its_tests_on_the_stubs(cpp: cores.CppCore) -> None:
    passed, failed, output = run_doctest(cpp.folder / "bin" / "terraport-engine-tests")
    assert failed == 0, output[-6000:]
    assert passed > 10


@pytest.mark.parametrize(("scene", "radius_m", "ring_m"), [("grid", 25, 0), ("levels", 8, 24)])
def test_the_unreal_scene_lands_on_the_stubs(
    cpp: cores.CppCore, server: Service, scene: str, radius_m: int, ring_m: int
) -> None:
    """The actor and the user's component themselves, on a fake engine."""
    done = subprocess.run(
        [
            str(cpp.folder / "bin" / "terraport-scene-on-stubs"),
            f"{server.url}/scenes/{scene}",
            str(radius_m),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    told = json.loads(done.stdout.strip().splitlines()[-1])
    assert (told["ring_m"], told["ring_off_m"]) == (ring_m, 0)


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


def test_the_unreal_plugin_names_what_is_there() -> None:
    plugin = json.loads((UNREAL / "Terraport.uplugin").read_text())
    for module in plugin["Modules"]:
        name = module["Name"]
        rules = (UNREAL / "Source" / name / f"{name}.Build.cs").read_text()
        assert f"class {name}" in rules
        sources = "".join(p.read_text() for p in (UNREAL / "Source" / name).rglob("*.cpp"))
        assert re.search(rf"IMPLEMENT_(GAME_)?MODULE\(.*\b{name}\b", sources), name


def test_the_unreal_core_knows_no_engine_and_throws_nothing() -> None:
    core = UNREAL / "Source" / "TerraportCore"
    for path in [*core.rglob("*.h"), *core.rglob("*.cpp")]:
        if path.name.endswith("Module.cpp") or path.name == "Api.h":
            continue  # the module's one file for the engine, and the one macro at its border
        code = re.sub(r"//.*", "", path.read_text())
        for word in (r"\bthrow\b", r"\bcatch\b", r"\bdynamic_cast\b", r"\bFString\b", r"\babort\("):
            assert not re.search(word, code), f"{path.name} has {word}"
        for include in re.findall(r'#include "([^"]+)"', code):
            near = (path.parent / include, core / "Public" / include, core / "Private" / include)
            assert any(candidate.is_file() for candidate in near), f"{path.name} includes {include}"


@pytest.mark.parametrize("module", ["TerraportCore", "Terraport"])
def test_an_unreal_module_includes_in_no_circle(module: str) -> None:
    """A unit is a header with its source, and with its own Impl."""
    source = UNREAL / "Source" / module
    units: dict[str, set[str]] = {}
    for path in [*source.rglob("*.h"), *source.rglob("*.cpp")]:
        included = re.findall(r'#include "([^"]+)\.h"', path.read_text())
        unit = path.stem.removesuffix("Impl")
        names = {name.rpartition("/")[2].removesuffix("Impl") for name in included}
        units.setdefault(unit, set()).update(names - {unit})
    assert len(units) > 20
    order = graphlib.TopologicalSorter(units)
    order.prepare()  # raises CycleError, which names the circle


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
