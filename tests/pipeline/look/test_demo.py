"""The demo, whole, on a small cloud: survey, scene, report, server, three landings."""

from __future__ import annotations

import re

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline import demo
from terraport_pipeline.cli import demo as command
from terraport_pipeline.demo import prepare_demo
from terraport_pipeline.errors import OptionError
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.report import ReportOptions
from terraport_pipeline.synth.options import FlightOptions
from terraport_store import Scene


def run(*arguments):
    app = typer.Typer()
    command.register(app)
    app.callback()(lambda: None)  # so that it stays a group
    return CliRunner().invoke(app, ["demo", *arguments])


def test_demo_goes_from_nothing_to_three_landings(tmp_path, monkeypatch) -> None:
    small = ReportOptions(PictureOptions(160, 90, 1), rays=5_000, subsets=5)
    monkeypatch.setattr(demo, "REPORT", small)
    monkeypatch.setattr(demo, "FLIGHT", FlightOptions(count=5, width=160, height=120))
    shown = run("--points", "20k", "--no-serve", "--keep", str(tmp_path / "demo"))
    assert shown.exit_code == 0, shown.output
    rows = {
        line.split("│")[1].strip(): [cell.strip() for cell in line.split("│")[2:-1]]
        for line in shown.stdout.splitlines()
        if line.startswith("│")
    }
    received = [int(cell.replace(",", "")) for cell in rows["bytes received"]]
    assert received[0] > 0
    assert received[2] == 0  # the return visit
    # Held segments up to the second radius stay, so the return shows no less.
    shown_first, _, shown_again = (int(t.replace(",", "")) for t in rows["triangles shown"])
    assert shown_again >= shown_first
    assert re.search(r"report +http://127\.0\.0\.1:\d+/scenes/quarry/report", shown.stdout)
    scenes = tmp_path / "demo" / "scenes"
    assert sorted(path.name for path in scenes.iterdir()) == ["bench", "quarry"]
    scene = scenes / "quarry"
    page = (scene / "report.html").read_text(encoding="utf-8")
    assert 'id="picture-input"' in page
    assert "No hole" in page
    assert 'id="picture-photo-from-above"' in page
    assert "surface that no photo sees" in page
    with Scene.open(scene) as opened:
        assert opened.manifest.counts.points <= 20_000
        assert opened.manifest.textures is not None


@pytest.mark.parametrize("points", [10, 10**9])
def test_senseless_sizes_are_refused_before_work(tmp_path, points) -> None:
    with pytest.raises(OptionError, match=f"received {points:,} points"):
        prepare_demo(tmp_path, points=points)
    assert list(tmp_path.iterdir()) == []


def test_wrong_points_are_exit_code_2() -> None:
    shown = run("--points", "many", "--no-serve")
    assert shown.exit_code == 2
    assert "many" in shown.stderr
