"""The dependency audit: what it must not let through, and what it must not pass over."""

from __future__ import annotations

import importlib.util
import json
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

PATH = Path(__file__).resolve().parents[1] / ".ci" / "audit.py"


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("stated", "allowed"),
    [
        ("MIT", True),
        ("Mozilla Public License 2.0 (MPL 2.0)", True),
        ("Apache-2.0 AND (BSD-3-Clause)", True),
        ("GPL-3.0-only OR MIT", True),
        ("GPL-3.0-only AND MIT", False),
        ("GNU General Public License v3 (GPLv3)", False),
        ("AGPL-3.0-or-later", False),
        ("Proprietary", False),
        ("", False),
    ],
)
def test_licences(audit: ModuleType, stated: str, allowed: bool) -> None:
    assert audit.is_allowed(stated) is allowed


def test_what_is_pulled_in_is_found(audit: ModuleType) -> None:
    packages = audit.closure()
    assert {"fastapi", "starlette", "uvicorn", "pyjwt", "websockets", "numpy"} <= set(packages)
    assert audit.licences(packages) == []


def test_packages_that_were_passed_over_are_not_called_safe(
    audit: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As pip-audit answers behind a mirror without advisories."""
    dependencies = [
        {"name": "fastapi", "skip_reason": "Dependency not found on PyPI"},
        {"name": "PyJWT", "version": "1.0", "vulns": [{"id": "X-1", "fix_versions": ["2.0"]}]},
        {"name": "unrelated", "version": "1.0", "vulns": [{"id": "X-2", "fix_versions": []}]},
    ]

    def answer(*_arguments: object, **_options: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess([], 1, json.dumps({"dependencies": dependencies}), "")

    monkeypatch.setattr(audit.subprocess, "run", answer)
    lines, looked_up = audit.vulnerabilities({"fastapi": None, "pyjwt": None})
    assert lines == ["vulnerability: pyjwt 1.0 X-1, fixed in 2.0"]
    assert looked_up == 1


def test_the_viewers_packages_are_looked_at(audit: ModuleType) -> None:
    lock = json.loads((audit.WEB / "package-lock.json").read_text())
    packages = audit.locked(lock)
    assert {"three", "vite"} <= set(packages)
    assert audit.web_licences(packages) == []
    packages["bad"] = {"version": "1.0", "license": "GPL-3.0-only"}
    packages["silent"] = {"version": "1.0"}
    assert [line.split()[2] for line in audit.web_licences(packages)] == ["bad", "silent"]
