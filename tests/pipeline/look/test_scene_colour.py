"""Where a scene's colour comes from: said the same by the report and by inspect."""

from __future__ import annotations

from pathlib import Path

import pytest
from payload.images import pillow
from store.tiny_scene import write_tiny_scene
from typer.testing import CliRunner

from terraport.cli import app
from terraport_pipeline.inspection import inspect_scene
from terraport_pipeline.report.facts import collect_facts
from terraport_pipeline.report.scene_colour import SceneColour
from terraport_store import Manifest, Scene


@pytest.fixture(scope="module", params=["points", "photos"])
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene with vertex colours; one of which every other segment has a texture instead."""
    image = pillow("JPEG", 16, 8) if request.param == "photos" else None
    return write_tiny_scene(tmp_path_factory.mktemp("colour") / request.param, image=image).path


def expected_text(scene: Path) -> str:
    return {
        "points": "from the points",
        "photos": "from the photos, as textures on 2 of 4 segments; "
        "the others as the points have it",
    }[scene.name]


def test_the_report_says_where_colour_comes_from(scene: Path) -> None:
    with Scene.open(scene) as opened:
        details = collect_facts(opened, has_input=False).details
    assert {row["label"]: row["value"] for row in details}["colour"] == expected_text(scene)


def test_inspect_says_the_same(scene: Path) -> None:
    result = CliRunner().invoke(app, ["inspect", str(scene)], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert expected_text(scene) in result.stdout
    assert inspect_scene(scene)["colour"] == {
        "source": scene.name,
        "textured_segments": 2 if scene.name == "photos" else 0,
        "segments": 4,
    }


@pytest.mark.parametrize(
    ("textured", "source", "has_colour", "text"),
    [
        (0, None, True, "from the points"),
        (0, None, False, "none in the survey: everything is grey"),
        (4, "photos", False, "from the photos, as textures"),
        (4, "vertex", False, "from the points, as textures"),
        (4, "mesh", False, "from the images of the mesh, as textures"),
    ],
)
def test_every_kind_of_scene(
    tmp_path: Path, textured: int, source: str | None, has_colour: bool, text: str
) -> None:
    image = None if source is None else pillow("JPEG", 16, 8)
    with Scene.open(write_tiny_scene(tmp_path / "s", image=image).path) as opened:
        manifest: Manifest = opened.manifest
    textures = manifest.textures
    if textures is not None:
        textures = textures.model_copy(update={"source": source, "segments": textured})
    edited = manifest.model_copy(update={"textures": textures, "has_colour": has_colour})
    assert str(SceneColour.of(edited)) == text
