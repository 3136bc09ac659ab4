"""The build hook that makes the viewer: when it builds, what it refuses, what it leaves alone."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

WEB = Path(__file__).resolve().parents[1] / "client_sdk" / "web"


@pytest.fixture(scope="module")
def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_page", WEB / "hatch_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def web(tmp_path: Path) -> Path:
    """A checkout's viewer, as small as one can be."""
    folder = tmp_path / "client_sdk" / "web"
    (folder / "src").mkdir(parents=True)
    (folder / "src" / "main.ts").write_text("1;")
    (folder / "index.html").write_text("<html>")
    (folder / "package.json").write_text("{}")
    lock = {"packages": {"": {}, "node_modules/a": {"version": "1.0"}}}
    (folder / "package-lock.json").write_text(json.dumps(lock))
    return folder


@pytest.fixture
def no_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    monkeypatch.delenv("TERRAPORT_SKIP_VIEWER", raising=False)


def hook_at(hook: ModuleType, root: Path) -> Any:
    return hook.PageHook(str(root), {}, None, None, str(root / "dist"), "wheel")


def current_page(hook: ModuleType, root: Path) -> Path:
    page = root / "server" / "terraport_server" / "page"
    page.mkdir(parents=True)
    (page / "index.html").write_text("built")
    (page / ".sources").write_text(hook.PageBuilder(root / "client_sdk" / "web", page).digest())
    return page


@pytest.mark.parametrize(
    ("version", "enough"),
    [
        ("v20.18.3", False), ("v20.19.0", True), ("v20.20.2\n", True), ("v21.7.3", False),
        ("v22.11.0", False), ("v22.12.0", True), ("v24.1.0", True), ("v18.20.4", False),
        ("", False), ("nonsense", False),
    ],
)  # fmt: skip
def test_which_node_is_new_enough(hook: ModuleType, version: str, enough: bool) -> None:
    assert hook.is_enough(version) is enough


def test_every_source_counts(hook: ModuleType, web: Path, tmp_path: Path) -> None:
    """Also that a file moved, and what is beside the code; not what is made of it."""
    builder = hook.PageBuilder(web, tmp_path / "page")
    digests = [builder.digest()]
    for change in (
        lambda: (web / "src" / "main.ts").write_text("2;"),
        lambda: (web / "src" / "main.ts").rename(web / "src" / "other.ts"),
        lambda: (web / "package-lock.json").write_text("{}"),
        lambda: (web / "index.html").write_text("<html >"),
    ):
        change()
        digests.append(builder.digest())
    assert len(set(digests)) == len(digests)
    (web / "node_modules").mkdir()
    (web / "node_modules" / "x.js").write_text("x")
    assert builder.digest() == digests[-1]


def test_nothing_is_done_for_a_page_of_the_same_sources(
    hook: ModuleType, web: Path, tmp_path: Path, no_node: None
) -> None:
    page = current_page(hook, tmp_path)
    build_hook = hook_at(hook, tmp_path)
    assert build_hook.dependencies() == []
    data: dict[str, Any] = {"artifacts": []}
    build_hook.initialize("standard", data)
    encoder = "pipeline/terraport_pipeline/engines/basis/**"
    assert data == {"artifacts": ["server/terraport_server/page/**", encoder]}
    assert (page / "index.html").read_text() == "built"
    (web / "src" / "main.ts").write_text("changed")
    assert build_hook.dependencies() == [hook.NODE_WHEEL]


def test_a_wheel_without_the_page_is_none(
    hook: ModuleType, web: Path, tmp_path: Path, no_node: None
) -> None:
    data: dict[str, Any] = {"artifacts": []}
    with pytest.raises(SystemExit, match=r"no viewer: no Node 20\.19 or newer"):
        hook_at(hook, tmp_path).initialize("standard", data)
    assert data["artifacts"] == []


def test_an_editable_install_goes_on(
    hook: ModuleType, web: Path, tmp_path: Path, no_node: None, capsys: pytest.CaptureFixture[str]
) -> None:
    data: dict[str, Any] = {"artifacts": []}
    hook_at(hook, tmp_path).initialize("editable", data)
    assert data["artifacts"] == []
    output = "".join(capsys.readouterr())
    assert "no viewer" in output
    assert "Going on" in output


def test_left_out_when_that_is_said(
    hook: ModuleType, web: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_node: None
) -> None:
    """An old page that lies there is not shipped either."""
    current_page(hook, tmp_path)
    (web / "src" / "main.ts").write_text("changed")
    monkeypatch.setenv("TERRAPORT_SKIP_VIEWER", "1")
    data: dict[str, Any] = {"artifacts": []}
    build_hook = hook_at(hook, tmp_path)
    assert build_hook.dependencies() == []
    build_hook.initialize("standard", data)
    assert data["artifacts"] == []


def test_without_sources(hook: ModuleType, tmp_path: Path, no_node: None) -> None:
    with pytest.raises(SystemExit, match="client_sdk/web is not whole"):
        hook_at(hook, tmp_path).initialize("standard", {"artifacts": []})


def test_packages_fit_the_lock(hook: ModuleType, web: Path, tmp_path: Path) -> None:
    builder = hook.PageBuilder(web, tmp_path / "page")
    packages = {"": {}, "node_modules/a": {"version": "1.0"}, "node_modules/b": {"version": "2.0"}}
    lock = {"packages": packages | {"node_modules/c": {"version": "3.0", "optional": True}}}
    (web / "package-lock.json").write_text(json.dumps(lock))
    assert not builder._packages_fit()
    (web / "node_modules").mkdir()
    installed_lock = web / "node_modules" / ".package-lock.json"
    installed_lock.write_text(json.dumps({"packages": packages}))
    assert builder._packages_fit()
    for other in ({"node_modules/b": {"version": "2.1"}}, {"node_modules/c": {"version": "3.1"}}):
        installed_lock.write_text(json.dumps({"packages": packages | other}))
        assert not builder._packages_fit()
    installed_lock.write_text("{")
    assert not builder._packages_fit()


def test_a_tool_that_hangs_is_ended(hook: ModuleType, web: Path, tmp_path: Path) -> None:
    """With its children: npm starts some."""
    tools = hook.Toolchain(sys.executable, (sys.executable,), "this Python")
    builder = hook.PageBuilder(web, tmp_path / "page")
    start_s = time.monotonic()
    sleeping = "[sys.executable, '-c', 'import time; time.sleep(60)']"
    child = f"import subprocess, sys; subprocess.run({sleeping})"
    with pytest.raises(hook.PageBuildError, match=r"took longer than 0\.5 s"):
        builder._run(tools, [sys.executable, "-c", child], 0.5)
    assert time.monotonic() - start_s < 20


def test_what_a_failing_tool_said_is_told(hook: ModuleType, web: Path, tmp_path: Path) -> None:
    tools = hook.Toolchain(sys.executable, (sys.executable,), "this Python")
    builder = hook.PageBuilder(web, tmp_path / "page")
    with pytest.raises(hook.PageBuildError, match=r"(?s)failed with this Python:.*no such tree"):
        builder._run(tools, [sys.executable, "-c", "raise SystemExit('no such tree')"], 30)


def test_a_build_that_fails_leaves_the_page(hook: ModuleType, web: Path, tmp_path: Path) -> None:
    page = current_page(hook, tmp_path)
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node on the PATH")
    tools = hook.Toolchain(node, (sys.executable, "-c", "raise SystemExit('registry away')"), "x")
    with pytest.raises(hook.PageBuildError, match="registry away"):
        hook.PageBuilder(web, page).build(tools)
    assert (page / "index.html").read_text() == "built"
