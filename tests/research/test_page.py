from __future__ import annotations

from pathlib import Path

from terraport_research.depth_sweep import DepthRow, DepthScene
from terraport_research.options import ReconstructionOptions
from terraport_research.page import page_of, write_page
from terraport_research.reconstruction import Evaluation

SCENE = DepthScene(
    "pit",
    "The <pit>",
    1000,
    0.5,
    100.0,
    9,
    (
        DepthRow(8, 1000, 1200, 1.0, 10**8),
        DepthRow(9, 4000, 4500, 3.0, 2 * 10**8),
        DepthRow(10, 0, 0, 0.0, 0, "not done after 1 s: stopped"),
    ),
)


def evaluation_of(scenes: tuple[DepthScene, ...]) -> Evaluation:
    return Evaluation(
        ReconstructionOptions(), None, (), {}, {}, scenes, ("no bunny",), {"numpy": "2"}
    )


def test_the_figure_has_a_chart_for_faces_time_and_memory() -> None:
    page = page_of(evaluation_of((SCENE,)))
    assert page.count("<svg") == 3
    assert page.count('class="line0 marked"') == 3
    assert "9 (ours)" in page
    assert "The &lt;pit&gt;" in page
    assert "not done after 1 s: stopped" in page


def test_what_was_not_run_is_said_with_what_to_do() -> None:
    page = page_of(evaluation_of(()))
    assert "no bunny" in page
    assert "<svg" not in page


def test_the_page_is_replaced_in_one_step(tmp_path: Path) -> None:
    write_page(evaluation_of(()), tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
