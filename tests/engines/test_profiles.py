"""Device profiles: the same bounds in every client, and in what measures scenes by them."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Final

import pytest
from engines.cores import UNITY, UNREAL

ROOT: Final = Path(__file__).resolve().parents[2]
MIB: Final = 1024 * 1024

NAMES: Final = {
    "maxTriangles": "MaxTriangles",
    "maxGpuMebibytes": "MaxGpuMebibytes",
    "maxSegments": "MaxSegments",
    "cacheMebibytes": "CacheMiB",
    "diskMebibytes": "DiskMiB",
    "creditMebibytes": "CreditMiB",
}
"""Fields of Unity's budgets, and what they are called in Unreal's."""
PROFILES: Final = ("desktop", "phone", "headset")


def number(text: str) -> int:
    """Read ``6_000_000`` or ``48 * MIB``."""
    value, _, unit = text.replace("_", "").partition(" * ")
    return int(value) * (MIB if unit == "MIB" else 1)


def fields_of(text: str) -> dict[str, int]:
    """Return the numbers that fields are declared with or given, by name."""
    pattern = r"(\w+) ?[=:] ?([\d_]+(?: \* MIB)?)[;,]"
    return {name: number(value) for name, value in re.findall(pattern, text)}


def unity(profile: str) -> dict[str, int]:
    text = (UNITY / "Runtime" / "DeviceBudgets.cs").read_text()
    desktop, phone, headset = re.split(r"DeviceProfile\.(?:Phone|Headset)\)", text)
    parts = {"desktop": "", "phone": phone, "headset": headset}
    return fields_of(desktop) | fields_of(parts[profile])


def unreal(profile: str) -> dict[str, int]:
    settings = UNREAL / "Source" / "Terraport"
    header = (settings / "Public" / "TerraportSettings.h").read_text()
    source = (settings / "Private" / "TerraportSettings.cpp").read_text()
    parts = dict(re.findall(r"ETerraportDevice::(\w+):(.*?)break;", source, re.DOTALL))
    declared = header.split("struct TERRAPORT_API FTerraportBudgets")[1]
    return fields_of(declared) | fields_of(parts.get(profile.title(), ""))


def web(profile: str) -> dict[str, int]:
    text = (ROOT / "client_sdk" / "web" / "src" / "core" / "budgets.ts").read_text()
    return fields_of(text.split(f"\n  {profile}: {{")[1].split("\n  }")[0])


def benchmark() -> ModuleType:
    """Load ``benchmarks/profiles.py``, which is no package."""
    path = ROOT / "benchmarks" / "profiles.py"
    spec = importlib.util.spec_from_file_location("benchmarks_profiles", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("profile", PROFILES)
def test_profiles_are_the_same_in_both_engines(profile: str) -> None:
    ours, theirs = unity(profile), unreal(profile)
    assert {name: ours[name] for name in NAMES} == {
        name: theirs[other] for name, other in NAMES.items()
    }


@pytest.mark.parametrize("profile", PROFILES)
def test_profiles_are_those_of_the_page(profile: str) -> None:
    """All but the disk: a page's storage is the browser's, and smaller."""
    engine, page = unity(profile), web(profile)
    for name in ("maxTriangles", "maxSegments", "radiusM"):
        assert engine[name] == page[name], name
    for name, other in {
        "maxGpu": "maxGpuBytes",
        "cache": "cacheBytes",
        "credit": "creditBytes",
    }.items():
        assert engine[f"{name}Mebibytes"] * MIB == page[other], name
    assert engine["diskMebibytes"] * MIB > page["diskBytes"]


@pytest.mark.parametrize("profile", PROFILES)
def test_profiles_are_those_that_scenes_are_measured_by(profile: str) -> None:
    device, page = benchmark().DEVICES[profile], web(profile)
    assert (device.radius_m, device.triangles, device.segments, device.gpu_bytes) == (
        page["radiusM"],
        page["maxTriangles"],
        page["maxSegments"],
        page["maxGpuBytes"],
    )


def test_each_profile_states_every_field() -> None:
    """None is a desktop's by accident."""
    seen = [tuple(web(profile).items()) for profile in PROFILES]
    assert len(set(seen)) == len(PROFILES)
    for fields in (web, unity):
        desktop = fields("desktop")
        for profile in ("phone", "headset"):
            assert all(fields(profile)[name] != value for name, value in desktop.items()), profile
