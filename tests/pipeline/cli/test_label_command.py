"""``terraport label``: the three steps that its help teaches, and what it refuses."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import typer
from store.tiny_scene import write_tiny_scene
from typer.testing import CliRunner, Result

from terraport_pipeline.cli import label
from terraport_store import SceneWriter, change_labels, read_labels


def run(*arguments: object) -> Result:
    app = typer.Typer()
    label.register(app)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_tiny_scene(tmp_path / "s", stable_ids=(4, 2, 9)).path


def test_export_fill_in_and_set(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "regions.csv"
    done = run(scene, "--export", table)
    assert done.exit_code == 0
    assert "3 regions, 0 of them with a label" in done.stderr
    with table.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["stable_id"] for row in rows] == ["4", "2", "9"]
    rows[2]["label"] = "Süd-Halde"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), delimiter=";")
        writer.writeheader()
        writer.writerows(rows)
    done = run(scene, table)
    assert done.exit_code == 0
    assert "1 labels set, 0 taken away; 1 of 3 regions have one" in done.stderr
    assert read_labels(scene) == {9: "Süd-Halde"}
    shown = run(scene)
    assert "Süd-Halde" in shown.stdout
    assert "bench" in shown.stdout, "what the build calls it"
    assert run(scene, "--export", "-").stdout.splitlines()[0].startswith("stable_id,label,region,")


def test_a_filled_table_is_not_overwritten(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "regions.csv"
    table.write_text("my work")
    done = run(scene, "--export", table)
    assert done.exit_code == 2
    assert "exists, expected a new file: it may hold labels" in done.stderr
    assert table.read_text() == "my work"


def test_a_wrong_row_is_one_line_with_its_place_and_sets_nothing(
    scene: Path, tmp_path: Path
) -> None:
    table = tmp_path / "regions.csv"
    table.write_text("stable_id,label\n4,pile\n3,road\n")
    done = run(scene, table)
    assert done.exit_code == 1
    assert done.stderr.startswith(f"error: {table} line 3: stable id '3', expected one of")
    assert done.stderr.count("\n") == 1
    assert read_labels(scene) == {}


def test_what_else_is_refused(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "regions.csv"
    both = run(scene, table, "--export", tmp_path / "x")
    assert (both.exit_code, "expected one of them" in both.stderr) == (2, True)
    missing = run(scene, table)
    assert missing.exit_code == 1
    assert missing.stderr == f"error: {table}: No such file or directory\n"
    nothing = run(tmp_path)
    assert (nothing.exit_code, nothing.stderr.startswith("error: no scene at")) == (1, True)
    table.write_text("stable_id,label\n4,pile\n")
    with SceneWriter(scene):
        busy = run(scene, table)
    assert (busy.exit_code, "another process is publishing" in busy.stderr) == (1, True)
    old = write_tiny_scene(tmp_path / "old").path
    table.write_text("stable_id,label\n")
    refused = run(old, table)
    assert (refused.exit_code, "gives no stable ids" in refused.stderr) == (1, True)


def test_labels_whose_region_is_gone_are_told(scene: Path) -> None:
    change_labels(scene, {2: "water"})
    write_tiny_scene(scene, seed=1, stable_ids=(4, 7, 9))
    assert "1 labels whose region is gone: 'water' (2)" in run(scene).stderr


def test_the_help_teaches() -> None:
    text = " ".join(run("--help").stdout.replace("│", " ").split())
    for words in ("--export regions.csv", "spreadsheet", "stable id", "empty label"):
        assert words in text
