"""Device profiles: the same bounds in both engine clients."""

from __future__ import annotations

import re
from typing import Final

from engines.cores import UNITY, UNREAL

NAMES: Final = {
    "maxTriangles": "MaxTriangles",
    "maxGpuMebibytes": "MaxGpuMebibytes",
    "maxSegments": "MaxSegments",
    "cacheMebibytes": "CacheMiB",
    "diskMebibytes": "DiskMiB",
    "creditMebibytes": "CreditMiB",
}
"""Fields of Unity's budgets, and what they are called in Unreal's."""


def defaults(text: str, names: list[str]) -> dict[str, int]:
    """Return the values that the fields are declared with: a desktop's."""
    fields = dict(re.findall(r"(?:int|int32|int64) (\w+) = (\d+);", text))
    return {name: int(fields[name]) for name in names}


def assigned(text: str) -> dict[str, int]:
    """Return what a profile's part of ``For`` sets."""
    return {name: int(value) for name, value in re.findall(r"[bB]udgets\.(\w+) = (\d+);", text)}


def test_profiles_are_the_same_in_both_engines() -> None:
    unity = (UNITY / "Runtime" / "DeviceBudgets.cs").read_text()
    settings = UNREAL / "Source" / "Terraport"
    header = (settings / "Public" / "TerraportSettings.h").read_text()
    unreal = (settings / "Private" / "TerraportSettings.cpp").read_text()
    desktop = defaults(unity, list(NAMES))
    assert list(desktop.values()) == list(defaults(header, list(NAMES.values())).values())
    _, unity_phone, unity_headset = re.split(r"DeviceProfile\.\w+\)", unity.split(" For(")[1])[-3:]
    parts = dict(re.findall(r"ETerraportDevice::(\w+):(.*?)break;", unreal, re.DOTALL))
    for profile, part in {"Phone": unity_phone, "Headset": unity_headset}.items():
        expected = {NAMES[name]: value for name, value in assigned(part).items() if name in NAMES}
        assert assigned(parts[profile]) == expected, profile
        assert len(expected) == len(NAMES), "each field is a choice of its own"
