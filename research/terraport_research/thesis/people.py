"""Tables B.1 to B.7 and Figure 5.12, from the results of ``terraport evaluate segmentation``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import SurveyError
from terraport_research.booklet_model import Column, Row, Stamp, Table
from terraport_research.cutters import CUTTERS
from terraport_research.segmentation import PEOPLE
from terraport_research.segmentation_page import HEADS
from terraport_research.segmentation_scores import METRICS
from terraport_research.thesis.making import Made, Making
from terraport_research.thesis_tables import THESIS_TABLES

__all__ = ["make_people"]

KEY: Final = "people"
_AVERAGE: Final = "Average"
_PARTS: Final = {"a": ("cd",), "b": ("hd", "rm", "rf"), "c": ("ri",), "d": ("gce", "lce")}
"""Sub-figures of Figure 5.12, with their metrics."""


def make_people(path: Path) -> Made:
    """Make the page from a results file; nothing is computed but means.

    Raises
    ------
    SurveyError
        The file is not there or no results file.
    """
    document = _read(path)
    try:
        return _page(document)
    except (KeyError, TypeError) as error:
        raise SurveyError(f"{path} is no result of terraport evaluate segmentation: {error}") from (
            error
        )


def _page(document: dict[str, Any]) -> Made:
    options, versions = document["options"], document["versions"]
    keys = list(document["algorithms"])
    has_thesis = options["models"] != "procedural"
    making = Making(KEY, "Segmentation against people: Tables B.1 to B.7, Figure 5.12", "", 0)
    count = len({one["number"] for one in document["models"]})
    making.say(
        f"{count} models ({options['models']}), k told {options['mode']}; lower is better. The "
        "thesis's values are of all 380 models."
    )
    # (1) Figure 5.12: one block of bars a metric.
    for part, metrics in _PARTS.items():
        columns = tuple(Column(metric, HEADS[metric]) for metric in metrics)
        rows = [
            Row(
                _title(key),
                tuple(_mean(document, key, metric, None) for metric in metrics),
                tuple(_thesis(key, metric, _AVERAGE) for metric in metrics) if has_thesis else (),
            )
            for key in keys
        ]
        title = f"Figure 5.12({part}): {', '.join(HEADS[metric] for metric in metrics)}"
        making.tables.append(
            Table(f"5.12{part}", title, "algorithm", columns, tuple(rows), "columns")
        )
    # (2) Tables B.1 to B.7: a row for each kind of body.
    kinds = list(dict.fromkeys(one["category"] for one in document["models"]))
    columns = tuple(Column(key, _title(key)) for key in keys)
    for number, metric in enumerate(METRICS, 1):
        rows = [
            Row(
                kind,
                tuple(
                    _mean(document, key, metric, None if kind == _AVERAGE else kind) for key in keys
                ),
                tuple(_thesis(key, metric, kind) for key in keys) if has_thesis else (),
            )
            for kind in (*kinds, _AVERAGE)
        ]
        title = f"Table B.{number}: {HEADS[metric]}"
        making.tables.append(Table(f"B.{number}", title, "models", columns, tuple(rows), "rows"))
    machine = ", ".join(f"{k} {v}" for k, v in versions.items() if k != "commit")
    cpu_s = sum(one["cpu_s"] for one in document["models"]) + document["metrics_cpu_s"]
    return making.made(
        Stamp(
            versions["terraport"], versions["commit"], options["mode"], options["seed"], machine,
            round(cpu_s, 2),
        )
    )  # fmt: skip


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise SurveyError(
            f"{path} is not there: run terraport evaluate segmentation first, or name its "
            "segmentation.json with --scores"
        )
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise SurveyError(f"{path} is no JSON: {error}") from error
    if not isinstance(document, dict):
        raise SurveyError(f"{path} is no result of terraport evaluate segmentation")
    return document


def _title(key: str) -> str:
    return "People" if key == PEOPLE else CUTTERS[key].title if key in CUTTERS else key


def _thesis(key: str, metric: str, kind: str) -> float | None:
    column = "Bench" if key == PEOPLE else CUTTERS[key].thesis if key in CUTTERS else ""
    return THESIS_TABLES[metric].get(kind, {}).get(column)


def _mean(document: dict[str, Any], key: str, metric: str, kind: str | None) -> float | None:
    values = [
        one[metric]
        for one in document["models"]
        if one["algorithm"] == key
        and kind in (None, one["category"])
        and one.get(metric) is not None
    ]
    return sum(values) / len(values) if values else None
