"""The Unity package compiles as every release whose API is known, and the stubs tell the truth.

The facts, member by member and release by release, are no part of the repository: where they are
absent, the stubs are what was once compared with them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

import pytest
from engines import cores
from engines.conftest import skip_or_fail
from engines.cores import UNITY
from engines.unity_layers import LADDER, NEWEST, RELEASES, UnityLayer, unity_layer

FACTS: Final = "unity_api.json"
ASSEMBLIES: Final = sorted(UNITY.rglob("*.asmdef"))

NOT_IN_FACTS: Final = {
    # The facts know no subsystems, and of these three only other overloads; Stubs~/README.md says
    # where they were looked up instead.
    "ISubsystem",
    "IntegratedSubsystem",
    "SubsystemManager",
    "XRDisplaySubsystem",
    "LayerMask",
    # What the headset's sample reads and what the editor's preview is stepped by.
    "InputDevice",
    "InputDevices",
    "InputFeatureUsage",
    "CommonUsages",
    "XRNode",
    "XRInputSubsystem",
    "TrackingOriginModeFlags",
    "UnityAction",
    "PrimitiveType",
    "ExecuteAlways",
    "InitializeOnLoadAttribute",
    # By which the KTX2 reader gets into a player, and into the preview.
    "AlwaysLinkAssemblyAttribute",
    "InitializeOnLoadMethodAttribute",
    "EditorApplication",
    "EditorApplication.CallbackFunction",
    "SceneView",
    "EditorGUILayout.HelpBox",
    "EditorGUILayout.LabelField",
    "EditorGUILayout.Space",
}

MISUSES: Final = {
    # What the collider did before, to the letter.
    "int id = new Mesh().GetInstanceID(); Physics.BakeMesh(id, false);": {
        "6000.3": "CS0618",
        "6000.5": "CS0619",
        "6000.7": "CS0619",
    },
    "EntityId id = new Mesh().GetEntityId(); Physics.BakeMesh(id, false);": {
        "2021.3": "CS0246",
        "2022.3": "CS0246",
        "6000.0": "CS0246",
    },
    "Object.FindObjectOfType<Mesh>();": dict.fromkeys(RELEASES[2:], "CS0618"),
    "Object.FindAnyObjectByType<Mesh>();": {},
    # In the VR module, which leaves with 6.5.
    "bool there = UnityEngine.XR.XRSettings.enabled;": dict.fromkeys(RELEASES, "CS0234"),
    "Mesh.AllocateWriteableMeshData(1);": dict.fromkeys(RELEASES, "CS0117"),
}
"""Statements, and what the compiler says to them as a release, where it refuses."""


def compiled(release: str) -> UnityLayer:
    """Compile the package as one release; skips where the compiler is missing."""
    reason = cores.missing_for("csharp")
    if reason is not None:
        skip_or_fail(f"the Unity layer cannot be compiled ({reason})")
    return unity_layer(release)


@pytest.fixture(params=RELEASES)
def layer(request: pytest.FixtureRequest) -> UnityLayer:
    """Each release in turn."""
    return compiled(request.param)


@pytest.fixture
def facts(shared_data: Path) -> dict[str, Any]:
    path = shared_data / FACTS
    if not path.is_file():
        pytest.skip(f"no facts about Unity's API ({path})")
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


@pytest.mark.parametrize("release", RELEASES)
def test_the_package_compiles(release: str) -> None:
    """Runtime (also for WebGL), Editor, KTX, and the samples as projects differ."""
    assert (compiled(release).folder / "Samples.new.dll").is_file()


@pytest.mark.parametrize("statement", MISUSES)
def test_what_a_release_lacks_does_not_compile(
    layer: UnityLayer, statement: str, tmp_path: Path
) -> None:
    source = tmp_path / "Misuse.cs"
    source.write_text(
        f"using UnityEngine; class Misuse {{ public static void Do() {{ {statement} }} }}"
    )
    expected = MISUSES[statement].get(layer.release)
    if expected is None:
        layer.compile([source], tmp_path / "Misuse.dll", "-nowarn:0219")
        return
    with pytest.raises(cores.BuildError, match=expected):
        layer.compile([source], tmp_path / "Misuse.dll")


def test_the_stubs_are_what_the_release_has(layer: UnityLayer, facts: dict[str, Any]) -> None:
    """Every member of the stubs is in the release, as obsolete as there; its own are marked."""
    (version,) = [
        candidate for candidate in facts["versions"] if candidate.startswith(f"{layer.release}.")
    ]
    stubs = members_of(layer, layer.stubs)
    stubs += [stub for stub in members_of(layer, layer.packages("old")) if stub[0] == "Input"]
    wrong = []
    for type_name, member, state in stubs:
        members = facts["types"].get(type_name, {})
        if type_name in NOT_IN_FACTS or f"{type_name}.{plain(member)}" in NOT_IN_FACTS:
            continue
        if member == "(type)" and members and member not in members:
            continue  # the facts list enums by their values alone
        status = members.get(member, "absent")
        real = status if isinstance(status, str) else status.get(version, "ok")
        if real != state:
            wrong.append(f"{type_name}: {member} is {state} in the stubs, {real} in {version}")
    assert wrong == []
    assert len(stubs) > 200


def test_what_is_not_in_the_facts_is_really_not(facts: dict[str, Any]) -> None:
    for name in NOT_IN_FACTS:
        type_name, _, member = name.partition(".")
        members = facts["types"].get(type_name, {})
        assert not any(plain(recorded) == member for recorded in members), name


def test_every_release_of_the_facts_is_compiled(facts: dict[str, Any]) -> None:
    assert [".".join(version.split(".")[:2]) for version in facts["versions"]] == list(RELEASES)


def test_a_version_define_is_one_that_unity_sets() -> None:
    """A misspelt one would be false in every release, without a word."""
    defines = {f"UNITY_{release.replace('.', '_')}_OR_NEWER" for release in LADDER}
    used = {
        define
        for path in UNITY.rglob("*.cs")
        for define in re.findall(r"\bUNITY_\d\w*", path.read_text(encoding="utf-8"))
    }
    assert used <= defines
    assert len(used) >= 3


@pytest.mark.parametrize("assembly", ASSEMBLIES, ids=lambda path: path.stem)
def test_an_assembly_defines_what_its_sources_ask_for(assembly: Path) -> None:
    folders = {path.parent for path in ASSEMBLIES}
    needed = {
        define
        for path in assembly.parent.rglob("*.cs")
        # The nearest definition above a file is the one that compiles it.
        if next(folder for folder in path.parents if folder in folders) == assembly.parent
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.startswith(("#if", "#elif"))
        for define in re.findall(r"\bTERRAPORT_\w+", line)
    }
    definition = json.loads(assembly.read_text(encoding="utf-8"))
    assert needed <= {entry["define"] for entry in definition.get("versionDefines", [])}


def test_an_assembly_that_nothing_refers_to_is_linked_all_the_same() -> None:
    """Unity's linker leaves it out of players; KTX2 could be read in the editor alone."""
    named = {json.loads(path.read_text())["name"]: path for path in ASSEMBLIES}
    referred = {
        name for path in ASSEMBLIES for name in json.loads(path.read_text()).get("references", [])
    }
    alone = []
    for name, path in named.items():
        texts = [source.read_text(encoding="utf-8") for source in path.parent.glob("*.cs")]
        registers = any("[RuntimeInitializeOnLoadMethod" in text for text in texts)
        if registers and name not in referred:
            alone.append(name)
            assert any("AlwaysLinkAssembly]" in text for text in texts), name
    assert alone == ["Terraport.Ktx"]


def test_the_package_asks_for_no_module_that_a_release_lacks() -> None:
    package = json.loads((UNITY / "package.json").read_text(encoding="utf-8"))
    assert set(package["dependencies"]) == {
        f"com.unity.modules.{name}"
        for name in ("imageconversion", "physics", "unitywebrequest", "xr")
    }


def test_the_docs_name_the_releases() -> None:
    sentence = ", ".join(RELEASES[:-1]) + f" and {NEWEST}"
    for path in (UNITY / "README.md", cores.ROOT / "docs" / "how-to" / "unity.md"):
        assert sentence in " ".join(path.read_text(encoding="utf-8").split()), path


def plain(member: str) -> str:
    """Return a member's name, of its signature."""
    return member.split("(")[0].split(" :")[0].rsplit(" ", 1)[-1]


def members_of(layer: UnityLayer, library: Path) -> list[tuple[str, str, str]]:
    """Return type, signature and state of every public member of a library of stubs."""
    program = ["mono", str(layer.folder / "StubMembers.exe"), str(library)]
    lines = cores.run_logged(program).splitlines()
    return [
        (columns[0], columns[1], columns[2]) for columns in (line.split("\t") for line in lines)
    ]
