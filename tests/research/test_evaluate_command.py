from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from terraport_research.cli import register


def run(*arguments: str | Path):
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return CliRunner().invoke(
        app, ["evaluate", "reconstruction", *map(str, arguments)], env={"COLUMNS": "120"}
    )


def test_page_json_pictures_and_tables(tmp_path: Path) -> None:
    result = run(
        "-o", tmp_path / "out", "--points", "4k", "--depths", "none", "--threads", "2",
        "--algorithms", "poisson,ball-pivoting", "--models", "block,bunny",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    results = json.loads((tmp_path / "out/reconstruction.json").read_text())
    assert set(results["table_3_1"]) == {"poisson", "ball-pivoting"}
    assert results["table_3_1"]["poisson"]["kept"] is True
    assert results["table_3_2"]["poisson"]["proceed"] is True
    assert results["table_3_2"]["ball-pivoting"]["has_holes"] is True
    assert results["table_3_2"]["ball-pivoting"]["similar"] is True
    page = (tmp_path / "out/reconstruction.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 1 + 2 + 1 + 2
    assert "http" not in page
    assert (tmp_path / "out/pictures/block-poisson.jpg").stat().st_size > 2000
    assert "Table 3.2" in result.output
    assert "not run: stanford/bunny.ply not looked for" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--algorithms", "magic"), "algorithm 'magic'; expected one of delaunay"),
        (("--points", "10"), "points 10; expected 1,000 to"),
        (("--depths", "8,x"), "depths '8,x'"),
        (("--depths", "3"), "depth 3; expected 4 to 16"),
        (("--data", "/nowhere"), "--data /nowhere"),
    ],
)
def test_wrong_options_end_with_one_line(tmp_path: Path, arguments, message: str) -> None:
    result = run("-o", tmp_path / "out", *arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "out").exists()
