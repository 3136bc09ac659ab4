"""validate: a good scene passes; flipped bytes, wrong covers and damaged files are found."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.engines import gltf_validator
from terraport_pipeline.engines.gltf_validator import GltfCheck, GltfMessage
from terraport_pipeline.validate.handoff_report import HandOffOptions
from terraport_pipeline.validate.validation import ValidationOptions, validate
from terraport_store import Scene, SceneNotFoundError
from terraport_store.layout import BASE

QUICK = ValidationOptions(HandOffOptions(4_000, 10))


def test_a_good_scene_has_no_problems(scene_path) -> None:
    result = validate(scene_path, QUICK)
    assert result.problems == 0
    assert result.findings == ()
    assert result.hand_off is not None
    assert result.hand_off.rays == 4_000
    assert result.manifest is not None
    assert result.gltf.not_run == "only with --khronos"


def test_rays_can_be_left_out(scene_path) -> None:
    result = validate(scene_path, ValidationOptions(None))
    assert (result.hand_off, result.hand_off_not_run) == (None, "left out")


def test_a_flipped_payload_byte_is_found_and_stops_the_rays(scene_path, tmp_path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    pack = next(copy.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[len(data) // 2] ^= 0x10
    pack.write_bytes(data)
    result = validate(copy, QUICK)
    assert result.problems >= 1
    assert any("segments.pack" in finding.file for finding in result.findings)
    assert result.hand_off is None
    assert "has hash" in result.hand_off_not_run


def test_a_manifest_that_does_not_parse_is_a_finding(scene_path, tmp_path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    (copy / "scene.json").write_text("{")
    result = validate(copy, QUICK)
    assert result.problems >= 1
    assert result.manifest is None
    assert "JSON" in result.hand_off_not_run


def test_holes_are_problems(write_scene, model, detail, base, tmp_path) -> None:
    first = model.cover_segments[model.cover_offsets[:-1]]
    wrong = replace(
        model,
        cover_offsets=np.arange(len(model.base_faces) + 1, dtype=np.uint32),
        cover_segments=first,
    )
    result = validate(write_scene(tmp_path / "holes", wrong, detail, base), QUICK)
    assert result.hand_off is not None
    assert result.problems == result.hand_off.holes > 0
    assert result.findings == ()  # the store cannot see it


def test_no_scene_is_an_error(tmp_path) -> None:
    with pytest.raises(SceneNotFoundError):
        validate(tmp_path, QUICK)


def test_a_required_validator_that_cannot_run_is_a_problem(scene_path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", "")
    result = validate(scene_path, ValidationOptions(None, khronos=True))
    assert result.gltf == GltfCheck(0, not_run="Node.js is not installed")
    assert result.problems == 1
    assert validate(scene_path, ValidationOptions(None)).problems == 0


def test_a_named_folder_without_the_package_is_said(monkeypatch, tmp_path) -> None:
    if gltf_validator.shutil.which("node") is None:
        pytest.skip("no Node at hand")
    monkeypatch.setenv(gltf_validator.FOLDER_VARIABLE, str(tmp_path / "none"))
    check = gltf_validator.check_gltf({"x": b""})
    assert "holds no gltf-validator" in check.not_run


def test_khronos_finds_what_is_wrong(scene_path, tmp_path) -> None:
    with Scene.open(scene_path) as scene:
        base = scene.file_glb(BASE)
    check = gltf_validator.check_gltf({"base": base, "broken": b"glTF" + bytes(30)})
    if check.not_run:
        pytest.skip(check.not_run)
    assert check.checked == 2
    assert check.errors >= 1
    assert {message.name for message in check.messages} == {"broken"}
    assert isinstance(check.messages[0], GltfMessage)


@pytest.fixture
def npm_calls(monkeypatch, tmp_path):
    """The file that lists calls of npm: one on PATH that writes them down and has no network."""
    node = gltf_validator.shutil.which("node")
    if node is None:
        pytest.skip("no Node at hand")
    calls, programs = tmp_path / "calls", tmp_path / "programs"
    programs.mkdir()
    (programs / "node").symlink_to(node)
    (programs / "npm").write_text(f'#!/bin/sh\necho "$@" >> "{calls}"\nexit 1\n')
    (programs / "npm").chmod(0o755)
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(gltf_validator.FOLDER_VARIABLE, raising=False)
    return calls


def test_nothing_is_fetched_unasked(scene_path, npm_calls) -> None:
    announced: list[str] = []
    result = validate(scene_path, ValidationOptions(None), announce=announced.append)
    assert (result.problems, result.gltf.not_run) == (0, "only with --khronos")
    assert not npm_calls.exists()
    assert announced == []


def test_what_is_fetched_is_said_first(scene_path, npm_calls) -> None:
    announced: list[str] = []

    def announce(line: str) -> None:
        assert not npm_calls.exists()
        announced.append(line)

    result = validate(scene_path, ValidationOptions(None, khronos=True), announce=announce)
    assert gltf_validator.PACKAGE in npm_calls.read_text()
    (line,) = announced
    assert line.startswith(f"fetching {gltf_validator.PACKAGE} from the npm registry into ")
    assert result.gltf.not_run == "npm could not install gltf-validator (no network?)"
    assert result.problems == 1
