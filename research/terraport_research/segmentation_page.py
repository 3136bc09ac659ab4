"""The comparison of segmentation algorithms as Markdown, CSV, JSON and one HTML page."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.report.html_page import page_templates, replace_page
from terraport_research.cutters import CUTTERS
from terraport_research.segmentation import (
    PEOPLE,
    Row,
    SegmentationEvaluation,
    options_as_json,
)
from terraport_research.segmentation_scores import METRICS
from terraport_research.thesis_tables import THESIS_TABLES

__all__ = ["FAITHFUL", "HEADS", "to_csv", "to_json", "to_markdown", "write_evaluation"]

HEADS: Final = dict(
    zip(METRICS, ("CD", "HD", "HD-Rm", "HD-Rf", "1 - RI", "GCE", "LCE"), strict=True)
)
"""What the thesis calls each metric."""

FAITHFUL: Final = 0.03
"""Within this of the thesis's overall 1 - RI, told k by model, an algorithm is called faithful."""

_THESIS_MODE: Final = "by-model"
_AVERAGE: Final = "Average"


@dataclass(frozen=True, slots=True)
class _Line:
    """One algorithm as the page shows it."""

    key: str
    title: str
    row: Row
    thesis: dict[str, float]
    """By metric; empty where the thesis has none."""
    takes_k: bool
    paper: str
    verdict: str


def _lines(evaluation: SegmentationEvaluation) -> list[_Line]:
    lines = []
    for key in evaluation.algorithms:
        cutter = CUTTERS.get(key)
        column = "Bench" if cutter is None else cutter.thesis
        thesis = (
            {metric: THESIS_TABLES[metric][_AVERAGE][column] for metric in METRICS}
            if column and evaluation.options.models is not None
            else {}
        )
        row = evaluation.row(key)
        lines.append(
            _Line(
                key,
                "People against people" if cutter is None else cutter.title,
                row,
                thesis,
                cutter is not None and cutter.takes_k,
                "" if cutter is None else cutter.paper,
                "" if cutter is None else _verdict(evaluation, key, row, thesis),
            )
        )
    return lines


def _verdict(
    evaluation: SegmentationEvaluation, key: str, row: Row, thesis: dict[str, float]
) -> str:
    """Say whether an algorithm is as published, and what differs."""
    cutter = CUTTERS[key]
    if not thesis:
        return cutter.departs
    apart = row.scores[METRICS.index("ri")] - thesis["ri"]
    if cutter.takes_k and evaluation.options.mode != _THESIS_MODE:
        said = f"the thesis told k {_THESIS_MODE}: not judged"
    elif math.isnan(apart):
        said = "not judged: no model was cut"
    else:
        said = (
            f"{'faithful' if abs(apart) <= FAITHFUL else 'not faithful'}: 1 - RI {apart:+.3f} "
            "against the thesis"
        )
    return f"{said}. {cutter.departs}".rstrip()


def _headline(evaluation: SegmentationEvaluation) -> str:
    asked = options_as_json(evaluation.options)
    versions = evaluation.versions
    models = evaluation.row(PEOPLE).models + evaluation.row(PEOPLE).failed
    return (
        f"{models} models ({asked['models']}), k told {asked['mode']}, seed {asked['seed']}, "
        f"terraport {versions['terraport']}, commit {versions['commit']}"
    )


def to_csv(evaluation: SegmentationEvaluation) -> str:
    """Write one line for each algorithm and category, and one for all: means over models."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    asked = options_as_json(evaluation.options)
    writer.writerow(
        ["algorithm", "category", "models", "failed", *METRICS, "no_cut", "segments", "cpu_s",
         "mode", "seed", "terraport", "commit"]
    )  # fmt: skip
    for key in evaluation.algorithms:
        for category in (None, *evaluation.categories):
            row = evaluation.row(key, category)
            writer.writerow(
                [key, category or "all", row.models, row.failed,
                 *(f"{value:.5f}" for value in row.scores), row.no_cut, f"{row.segments:.2f}",
                 f"{row.cpu_s:.2f}", asked["mode"], asked["seed"],
                 evaluation.versions["terraport"], evaluation.versions["commit"]]
            )  # fmt: skip
    return out.getvalue()


def to_json(evaluation: SegmentationEvaluation) -> str:
    """Write every figure of every model, and what it was made with."""
    stamp = {"mode": evaluation.options.mode, "seed": evaluation.options.seed} | {
        key: evaluation.versions[key] for key in ("terraport", "commit")
    }

    def number(value: float) -> float | None:
        return round(value, 5) if math.isfinite(value) else None

    def scores(values: tuple[float, ...]) -> dict[str, float | None]:
        return dict(zip(METRICS, map(number, values), strict=True))

    document: dict[str, Any] = {
        "options": options_as_json(evaluation.options),
        "versions": evaluation.versions,
        "metrics_cpu_s": round(evaluation.metrics_cpu_s, 2),
        "wall_s": round(evaluation.wall_s, 2),
        "algorithms": {
            line.key: {
                **scores(line.row.scores),
                "models": line.row.models,
                "failed": line.row.failed,
                "no_cut": line.row.no_cut,
                "segments": number(line.row.segments),
                "cpu_s": round(line.row.cpu_s, 2),
                "thesis": line.thesis,
                "verdict": line.verdict,
                **stamp,
            }
            for line in _lines(evaluation)
        },
        "models": [
            {
                "algorithm": one.algorithm,
                "number": one.number,
                "category": one.category,
                "faces": one.faces,
                **(scores(one.scores) if one.scores else {}),
                "pairs": one.pairs,
                "no_cut": one.no_cut,
                "segments": number(one.segments),
                "cpu_s": round(one.cpu_s, 3),
                "error": one.error,
            }
            for one in evaluation.results
        ],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def to_markdown(evaluation: SegmentationEvaluation) -> str:
    """Write the tables as the thesis prints them: the averages, then one a metric."""
    lines = _lines(evaluation)
    text = [
        "# Segmentation algorithms against people",
        "",
        f"{_headline(evaluation)}. Lower is better. In brackets: the thesis, on all 380 models.",
        "",
        f"| algorithm | {' | '.join(HEADS.values())} | segments | failed | CPU s |",
        "| -- |" + " -- |" * (len(METRICS) + 3),
    ]
    for line in lines:
        cells = [
            _cell(value, line.thesis.get(metric))
            for metric, value in zip(METRICS, line.row.scores, strict=True)
        ]
        tail = [f"{line.row.segments:.1f}", str(line.row.failed), f"{line.row.cpu_s:.1f}"]
        text.append(f"| {line.title} | {' | '.join([*cells, *tail])} |")
    text += [""] + [f"- **{line.title}**: {line.verdict}" for line in lines if line.verdict]
    for metric, head in HEADS.items():
        text += ["", f"## {head}", "", f"{_headline(evaluation)}.", ""]
        text += [f"| model | {' | '.join(line.title for line in lines)} |"]
        text += ["| -- |" + " -- |" * len(lines)]
        for category in evaluation.categories:
            text.append(
                f"| {category} | {' | '.join(_of_category(evaluation, metric, category))} |"
            )
    skipped = {line.key: line.row.no_cut for line in lines if line.row.no_cut}
    if skipped:
        told = ", ".join(
            f"{CUTTERS[k].title if k in CUTTERS else k} {n}" for k, n in skipped.items()
        )
        text += ["", f"Pairs without a cut on one side, left out of CD: {told}."]
    failed = [one for one in evaluation.results if one.scores is None]
    text += [""] * bool(failed)
    text += [f"- {one.algorithm} failed on model {one.number}: {one.error}" for one in failed]
    return "\n".join(text) + "\n"


def _cell(value: float, thesis: float | None) -> str:
    own = "-" if math.isnan(value) else f"{value:.3f}"
    return own if thesis is None else f"{own} ({thesis:.3f})"


def _of_category(evaluation: SegmentationEvaluation, metric: str, category: str) -> list[str]:
    cells = []
    for key in evaluation.algorithms:
        column = "Bench" if key == PEOPLE else CUTTERS[key].thesis
        thesis = THESIS_TABLES[metric].get(category, {}).get(column)
        value = evaluation.row(key, category).scores[METRICS.index(metric)]
        cells.append(_cell(value, thesis))
    return cells


def to_html(evaluation: SegmentationEvaluation) -> str:
    """Make the page: bars, tables, verdicts; HTML that asks for nothing else."""
    lines = _lines(evaluation)
    return (
        page_templates("terraport_research")
        .get_template("evaluate_segmentation.html.j2")
        .render(
            e=evaluation,
            lines=lines,
            heads=HEADS,
            headline=_headline(evaluation),
            cell=_cell,
            of_category=lambda metric, category: _of_category(evaluation, metric, category),
            worst={
                metric: max(
                    (
                        value
                        for line in lines
                        for value in (line.row.scores[i], line.thesis.get(metric, 0.0))
                        if math.isfinite(value)
                    ),
                    default=1.0,
                )
                or 1.0
                for i, metric in enumerate(METRICS)
            },
            failed=[one for one in evaluation.results if one.scores is None],
        )
    )


def write_evaluation(evaluation: SegmentationEvaluation, folder: Path) -> None:
    """Write ``segmentation.html``, ``.md``, ``.csv`` and ``.json`` into a folder."""
    replace_page(folder / "segmentation.html", to_html(evaluation))
    for ending, write in (("md", to_markdown), ("csv", to_csv), ("json", to_json)):
        (folder / f"segmentation.{ending}").write_text(write(evaluation), encoding="utf-8")
