"""Where a build puts its scene, and what is refused there before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.options.build import default_scene_path
from terraport_pipeline.workflow.scene_path import check_scene_path


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("pit.laz", "pit"),
        ("surveys/pit.laz", "pit"),
        ("pit.copc.laz", "pit"),
        ("pit.2026.ply", "pit.2026"),
        ("north pit.e57", "north pit"),
        (".pit.xyz", "pit"),
        ("delivery.v2", "delivery.v2"),
        ("tiles/*.laz", "tiles"),
        ("tiles/**/a?.laz", "tiles"),
    ],
)
def test_the_name_is_the_surveys(tmp_path: Path, given: str, name: str) -> None:
    (tmp_path / "delivery.v2").mkdir()
    assert default_scene_path([Path(given)]) == Path(name)


def test_a_pattern_right_here_and_a_file_with_brackets(tmp_path: Path) -> None:
    assert default_scene_path([Path("*.laz")]) == Path(tmp_path.name)
    (tmp_path / "pit[1].laz").touch()
    assert default_scene_path([Path("pit[1].laz")]) == Path("pit[1]")


def test_several_inputs_have_no_name() -> None:
    with pytest.raises(OptionError, match=r"^2 files and folders, and no name .*: -o scenes/NAME$"):
        default_scene_path([Path("a.laz"), Path("b.laz")])


def refusal(scene: str, survey: Path, *, is_default: bool) -> str:
    with pytest.raises(OptionError) as raised:
        check_scene_path(Path(scene), [survey], is_default=is_default)
    return str(raised.value)


def test_the_default_is_never_the_surveys_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey = tmp_path / "my delivery"
    survey.mkdir()
    said = refusal("my delivery", survey, is_default=True)
    assert said == (
        f"{survey} lies in the survey's own folder; give the scene another path: "
        "-o 'scenes/my delivery'"
    )
    check_scene_path(Path("elsewhere/delivery"), [survey], is_default=True)
    monkeypatch.chdir(survey)
    assert "own folder" in refusal("delivery", Path(), is_default=True)
    check_scene_path(Path("scene"), [Path()], is_default=False)  # who asks for it may have it


@pytest.mark.parametrize("is_default", [False, True])
def test_what_is_there_and_no_scene_is_left_alone(tmp_path: Path, is_default: bool) -> None:
    (tmp_path / "pit").mkdir()
    check_scene_path(Path("pit"), [Path("pit.laz")], is_default=is_default)  # empty
    (tmp_path / "pit" / "v-1").mkdir()  # of a build that was interrupted
    check_scene_path(Path("pit"), [Path("pit.laz")], is_default=is_default)
    (tmp_path / "pit" / "notes.txt").touch()
    said = refusal("pit", Path("pit.laz"), is_default=is_default)
    assert "holds other files (notes.txt); expected a scene, or an empty or new directory" in said
    assert said.endswith("-o scenes/pit") == is_default
    (tmp_path / "pit" / "scene.json").touch()
    check_scene_path(Path("pit"), [Path("pit.laz")], is_default=is_default)
    (tmp_path / "face").touch()
    assert "is a file" in refusal("face", Path("face"), is_default=is_default)


def test_an_address_is_no_directory(tmp_path: Path) -> None:
    said = refusal("s3://bucket/pit", Path("pit.laz"), is_default=False)
    assert said == (
        "s3://bucket/pit is an address, expected a directory of this machine; terraport upload "
        "brings the scene there"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "cannot make" in refusal("file/scenes/pit", Path("pit.laz"), is_default=False)
