"""What can be opened after installing: the sample's scene and prefab, read as Unity's text form.

Unity is not run. What its importer looks up is looked up here: every reference within a file, every
GUID, every script's fields; and the place where the visitor starts, in the scene that comes along.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest
from engines.cores import ROOT, UNITY

from terraport_pipeline.demo_scenes import SHIPPED_ID, shipped_scene

SAMPLES: Final = UNITY / "Samples~"
PREFABS: Final = (
    SAMPLES / "FirstLanding" / "Walker.prefab",
    SAMPLES / "FirstLandingXR" / "XRWalker.prefab",
)
SCENES: Final = (
    SAMPLES / "FirstLanding" / "FirstLanding.unity",
    SAMPLES / "FirstLandingXR" / "FirstLandingXR.unity",
)
COMMON: Final = {"TerraportScene", "TerraportUser"}
SCRIPTS: Final = {
    "Walker": COMMON | {"TerraportGroundCollider", "FirstLanding"},
    "XRWalker": COMMON | {"TerraportTeleport", "HeadsetRig"},
}
"""Components of each prefab that are scripts."""

BUILT_IN: Final = "0000000000000000f000000000000000"
"""GUID of the engine's own resources."""

OWN_FIELDS: Final = {"m_Script", "m_Name", "m_EditorClassIdentifier", "m_EditorHideFlags"}
GAME_OBJECT, TRANSFORM, CAMERA, SCRIPT = 1, 4, 20, 114


@dataclass(frozen=True)
class Item:
    """One object of a file: its class by Unity's number, and its text."""

    kind: int
    text: str

    def field(self, name: str) -> str:
        """Return the text of a top-level field."""
        match = re.search(rf"^  {re.escape(name)}: ?(.*)$", self.text, re.MULTILINE)
        assert match, f"no {name} in\n{self.text}"
        return match[1]

    def local(self, name: str) -> int:
        """Return the number of the object of this file that a field names."""
        match = re.fullmatch(r"\{fileID: (\d+)\}", self.field(name))
        assert match, (name, self.field(name))
        return int(match[1])

    def guid(self) -> str:
        """Return the GUID of a component's script."""
        match = re.search(r"fileID: 11500000, guid: (\w{32}), type: 3", self.field("m_Script"))
        assert match, self.text
        return match[1]


def items_of(path: Path) -> dict[int, Item]:
    """Read a file's objects by their numbers, of which no two may be the same."""
    text = path.read_text(encoding="utf-8")
    head, *parts = re.split(r"^--- !u!(\d+) &(\d+)\n", text, flags=re.MULTILINE)
    assert head == "%YAML 1.1\n%TAG !u! tag:unity3d.com,2011:\n"
    items = {}
    for kind, number, body in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
        assert int(number) not in items
        items[int(number)] = Item(int(kind), body)
    return items


@pytest.fixture(scope="module", params=PREFABS, ids=lambda path: path.stem)
def prefab_path(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


@pytest.fixture(scope="module")
def prefab(prefab_path: Path) -> dict[int, Item]:
    return items_of(prefab_path)


@pytest.fixture(scope="module")
def assets() -> dict[str, Path]:
    """Files of the package by the GUIDs in their .meta files."""
    found = {}
    for path in UNITY.rglob("*.meta"):
        match = re.search(r"^guid: (\w{32})$", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert match, path
        found[match[1]] = path.with_suffix("")
    return found


@pytest.mark.parametrize("path", [*PREFABS, *SCENES], ids=lambda path: path.name)
def test_every_reference_leads_somewhere(path: Path, assets: dict[str, Path]) -> None:
    items = items_of(path)
    text = path.read_text(encoding="utf-8")
    local = {int(number) for number in re.findall(r"\{fileID: (\d+)\}", text)} - {0}
    assert local <= items.keys()
    guids = set(re.findall(r"guid: (\w{32})", text)) - {BUILT_IN}
    assert guids
    assert guids <= assets.keys()
    for number, guid in re.findall(r"target: \{fileID: (\d+), guid: (\w{32})", text):
        assert assets[guid].parent == path.parent
        assert int(number) in items_of(assets[guid])


def test_components_and_their_objects_name_one_another(prefab: dict[int, Item]) -> None:
    for number, item in prefab.items():
        if item.kind == GAME_OBJECT:
            components = [int(c) for c in re.findall(r"component: \{fileID: (\d+)\}", item.text)]
            assert prefab[components[0]].kind == TRANSFORM
            assert all(prefab[c].local("m_GameObject") == number for c in components)
            assert components == [
                other
                for other, of in prefab.items()
                if of.kind != GAME_OBJECT and of.local("m_GameObject") == number
            ]
        if item.kind == TRANSFORM:
            children = [int(child) for child in re.findall(r"  - \{fileID: (\d+)\}", item.text)]
            assert all(prefab[child].local("m_Father") == number for child in children)


def test_scripts_have_the_fields_that_are_set(
    prefab: dict[int, Item], prefab_path: Path, assets: dict[str, Path]
) -> None:
    """And a field that names an object names one of its own type."""
    kinds = {"Transform": TRANSFORM, "Camera": CAMERA}
    seen = set()
    for item in prefab.values():
        if item.kind != SCRIPT:
            continue
        path = assets[item.guid()]
        source = path.read_text(encoding="utf-8")
        assert re.search(rf"class {path.stem} : MonoBehaviour", source)
        seen.add(path.stem)
        for name in set(re.findall(r"^  (\w+):", item.text, re.MULTILINE)) - OWN_FIELDS:
            if name.startswith("m_"):
                continue
            declared = re.search(
                rf"\[SerializeField\](?:(?!private).)*private (\w+) {name}\b", source, re.DOTALL
            )
            assert declared, f"{path.stem} has no field {name}"
            if "fileID" not in item.field(name):
                continue
            named = prefab[item.local(name)]
            if named.kind == SCRIPT:
                assert assets[named.guid()].stem == declared[1]
            else:
                assert named.kind == kinds[declared[1]]
    assert seen == SCRIPTS[prefab_path.stem]


def test_the_visitor_starts_on_the_ground_of_the_scene_that_the_demo_serves(
    prefab: dict[int, Item], assets: dict[str, Path]
) -> None:
    scripts = {assets[i.guid()].stem: i for i in prefab.values() if i.kind == SCRIPT}
    url = scripts["TerraportScene"].field("sceneUrl")
    assert url == f"http://127.0.0.1:8080/scenes/{SHIPPED_ID}"
    rig = prefab[scripts["TerraportUser"].local("rig")]
    place = re.fullmatch(r"\{x: (\S+), y: (\S+), z: (\S+)\}", rig.field("m_LocalPosition"))
    assert place
    # Unity's Z is north, the scene's is south.
    position = (float(place[1]), float(place[2]), -float(place[3]))
    bounds = json.loads((shipped_scene() / "scene.json").read_text())["bounds"]
    for low, at, high in zip(bounds["min"], position, bounds["max"], strict=True):
        assert low < at < high


def test_the_docs_count_five_clicks() -> None:
    text = (ROOT / "docs" / "how-to" / "unity.md").read_text(encoding="utf-8")
    section = text.split("## First landing in five clicks\n")[1].split("\n## ")[0]
    steps = re.findall(r"^1\. (.*(?:\n   .*)*)", section, re.MULTILINE)
    assert 1 <= len(steps) <= 5
    assert SCENES[0].stem in section
