"""The comparison of reconstruction algorithms as one HTML page, with everything inside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from terraport_pipeline.report.html_page import page_templates, replace_page
from terraport_research.depth_sweep import DepthRow, DepthScene
from terraport_research.line_chart import Line, line_chart
from terraport_research.reconstruction import Evaluation
from terraport_research.reconstructors import RECONSTRUCTORS
from terraport_research.verdicts import RULES, THESIS_COLOUR, THESIS_SHAPE

__all__ = ["page_of", "write_page"]


def page_of(evaluation: Evaluation) -> str:
    """Make the page.

    Parameters
    ----------
    evaluation : Evaluation

    Returns
    -------
    str
        HTML that asks for nothing else.
    """
    return (
        page_templates("terraport_research")
        .get_template("evaluate_reconstruction.html.j2")
        .render(
            e=evaluation,
            names={key: one.title for key, one in RECONSTRUCTORS.items()},
            rules=RULES,
            thesis_colour=THESIS_COLOUR,
            thesis_shape=THESIS_SHAPE,
            algorithms=[RECONSTRUCTORS[key] for key in evaluation.options.algorithms],
            charts=_charts(evaluation.scenes),
        )
    )


def write_page(evaluation: Evaluation, path: Path) -> None:
    """Write the page; a reader sees the old one or the new one."""
    replace_page(path, page_of(evaluation))


def _charts(scenes: tuple[DepthScene, ...]) -> list[tuple[str, str]]:
    def chart(title: str, value: Callable[[DepthRow], float], unit: float, y_title: str) -> str:
        lines = [
            Line(
                scene.title,
                tuple((row.depth, value(row)) for row in scene.rows if not row.error),
                scene.our_depth,
            )
            for scene in scenes
        ]
        return line_chart(lines, x_title="octree depth", y_title=y_title, y_unit=unit, title=title)

    if not scenes:
        return []
    faces = chart("Faces against octree depth", lambda row: row.faces, 1e3, "thousand faces")
    seconds = chart("CPU time against octree depth", lambda row: row.cpu_s, 1.0, "CPU seconds")
    memory = chart("Memory against octree depth", lambda row: row.memory_bytes, 2.0**20, "MiB")
    return [("Faces", faces), ("CPU time", seconds), ("Memory", memory)]
