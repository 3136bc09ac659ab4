"""The simplest rules of Unreal's header tool, which a plain compiler does not see."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from engines import cores

SOURCE = cores.UNREAL / "Source"
REFLECTED = re.compile(r"^\s*U(?:CLASS|STRUCT|ENUM|INTERFACE)\(", re.MULTILINE)


def faults_of(name: str, text: str) -> list[str]:
    """Return what the header tool would refuse."""
    code = re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.DOTALL)
    includes = re.findall(r'#include\s+[<"]([^>"]+)[>"]', code)
    if not REFLECTED.search(code):
        return ["a generated header for nothing"] if any("generated" in i for i in includes) else []
    faults = []
    if not includes or includes[-1] != f"{name}.generated.h":
        faults.append("the last include is not its generated header")
    bodies = len(re.findall(r"^\s*U(?:CLASS|STRUCT|INTERFACE)\(", code, re.MULTILINE))
    if len(re.findall(r"^\s*GENERATED_BODY\(\)", code, re.MULTILINE)) != bodies:
        faults.append("not one GENERATED_BODY() for each class and struct")
    faults += [
        f"{kind} {member} has no category"
        for kind, rest, member in re.findall(
            r"^\s*(UPROPERTY|UFUNCTION)\((.*?)\)\s*\n\s*([^\n;{]+)", code, re.MULTILINE | re.DOTALL
        )
        if "Blueprint" in rest and "Category" not in rest
    ]
    faults += [
        f"{kind} in {member} is no type that Blueprint knows"
        for kind, member in re.findall(
            r"UPROPERTY\([^;]*?\)\s*\n\s*((?:u?int(?:8|16|64)_t|std::\S+)) (\w+)", code
        )
    ]
    return faults


@pytest.mark.parametrize(
    "path",
    sorted(p for p in SOURCE.glob("*/P*/**/*.h") if "Core" not in p.parts),
    ids=lambda path: f"{path.parent.name}/{path.name}",
)
def test_what_is_reflected_is_as_the_header_tool_wants_it(path: Path) -> None:
    assert faults_of(path.stem, path.read_text()) == []


def test_what_the_header_tool_refuses_is_found() -> None:
    good = (SOURCE / "Terraport" / "Public" / "TerraportUserComponent.h").read_text()
    name = "TerraportUserComponent"
    assert faults_of(name, good) == []
    include = f'#include "{name}.generated.h"\n'
    assert faults_of(name, good.replace(include, "")) != []
    assert faults_of(name, good.replace(include, include + '#include "CoreMinimal.h"\n')) != []
    assert faults_of(name, good.replace("GENERATED_BODY()", "")) != []
    assert faults_of(name, good.replace(', Category = "Terraport"', "")) != []
    assert faults_of("Other", good) != []
    assert faults_of("Plain", "#pragma once\n" + include) != []


def test_every_reflected_type_has_a_stub_of_its_generated_header() -> None:
    stubs = {path.name for path in (cores.UNREAL / "stubs" / "generated").iterdir()}
    expected = {
        f"{path.stem}.generated.h"
        for path in SOURCE.glob("*/Public/*.h")
        if REFLECTED.search(path.read_text())
    }
    assert stubs == expected
