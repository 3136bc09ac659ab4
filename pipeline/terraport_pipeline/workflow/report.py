"""What a build did, for people (a table) and for tools (``build.json``)."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from terraport_pipeline.mesh_statement import MESH
from terraport_pipeline.report.facts import extent_line, named_count
from terraport_pipeline.stages.contract import Facts
from terraport_pipeline.stages.texture_sums import PHOTO_SHARES
from terraport_pipeline.survey.one_survey import OUTSIDE
from terraport_pipeline.workflow.workdir import Cost

__all__ = ["BUILD_REPORT_NAME", "BuildReport", "StageReport", "write_build_report"]

BUILD_REPORT_NAME: Final = "build.json"
"""Beside ``scene.json``. It holds times, so it is no part of the published version."""

_SHOWN: Final = {
    "read": ("points", "attributes"),
    "read-mesh": ("faces", "vertices", "parts", "images"),
    "renew": ("changed_share", "cut_m3", "fill_m3", "volume_uncertainty_m3"),
    "clean": ("points", "duplicates", "outliers", "spacing_m"),
    "reconstruct": ("base_from", "cell_m", "base_faces", "detail_faces", "deviation_p99_m"),
    "segment": ("regions", "segments", "max_extent_m", "base_faces_beyond"),
    "texture": (
        "image_bytes",
        "texel_m",
        "gsd_m",
        "longest_side",
        "charts",
        "faces_per_chart",
        "unseen_share",
        "borrowed_share",
        "crowded_share",
        "photos_left_out",
    ),
    "base_atlas": ("longest_side", "image_bytes", "texel_m", "crowded_share"),
    "pack": ("payload_bytes", "bytes_per_face", "base_bytes", "step_m"),
}
"""Counts of each stage that the table shows."""


_KEPT: Final = (PHOTO_SHARES,)
"""Notes of stages that ``build.json`` has beside their counts: a row for each photo would be too
much for the manifest."""

_NAMED: Final = 8
"""Files that were not read and are named on the terminal; build.json has them all."""


@dataclass(frozen=True, slots=True)
class StageReport:
    """What one stage of a build cost and reported, and whether its result was taken up."""

    name: str
    taken_up: bool
    """The result was there from an earlier build; cost is what it took then."""
    cost: Cost
    facts: Facts


@dataclass(frozen=True, slots=True)
class BuildReport:
    """Outcome of one build: the published version, and a report of every stage."""

    scene: Path
    version: str
    published: bool
    """False when the scene already was this version."""
    stages: tuple[StageReport, ...]
    seconds: float
    inputs: Sequence[Mapping[str, Any]] = ()
    """The survey's files, as :func:`terraport_pipeline.workflow.read_step.inputs_of` lists them."""
    left_out: Sequence[Mapping[str, Any]] = ()
    """Files beside them that are no part of the survey, or damaged."""
    extent: Mapping[str, Any] | None = None
    """What lies outside the extent that was asked for, if one was; as listed there."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """All stages' warnings in their order."""
        return tuple(text for stage in self.stages for text in stage.facts.warnings)

    @property
    def choices(self) -> tuple[str, ...]:
        """What all stages decided by themselves, in their order."""
        return tuple(text for stage in self.stages for text in stage.facts.choices)

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of the survey's files: none for a single one with nothing beside it."""
        notes = []
        repeats = sum(file["repeats"] for file in self.inputs)
        if len(self.inputs) > 1 and self.inputs[0]["format"] == MESH:
            notes.append(f"{self.inputs[0]['name']}, with {len(self.inputs) - 1} files beside it")
        elif len(self.inputs) > 1:
            points = sum(file["points"] for file in self.inputs)
            notes.append(
                f"{len(self.inputs)} files with {points:,} points; {repeats:,} lie in several and "
                "were taken once"
            )
        if self.extent is not None:
            notes.append(f"extent {extent_line({'extent': self.extent})}")
            notes += self.extent["remarks"]
        ignored = [
            f"{f['name']} ({f['reason']})"
            for f in self.left_out
            if not f["damaged"] and f["reason"] != OUTSIDE
        ]
        if ignored:
            more = f" and {len(ignored) - _NAMED} more" if len(ignored) > _NAMED else ""
            notes.append(f"not read: {', '.join(ignored[:_NAMED])}{more}")
        return tuple(notes)

    @property
    def peak_bytes(self) -> int:
        """Largest memory of any stage that ran."""
        return max(
            (stage.cost.peak_bytes for stage in self.stages if not stage.taken_up), default=0
        )

    def table(self) -> Table:
        """Make a table of the stages for the terminal: time, memory, facts."""
        table = Table(title=f"{self.scene.name} {self.version[:12]}")
        table.add_column("stage")
        table.add_column("time", justify="right")
        table.add_column("peak memory", justify="right")
        table.add_column("result")
        for stage in self.stages:
            time = "taken up" if stage.taken_up else f"{stage.cost.seconds:.1f} s"
            memory = "" if stage.taken_up else f"{stage.cost.peak_bytes / 2**20:,.0f} MiB"
            table.add_row(stage.name, time, memory, _shown_facts(stage))
        table.add_row("all", f"{self.seconds:.1f} s", f"{self.peak_bytes / 2**20:,.0f} MiB", "")
        return table

    def to_json(self) -> dict[str, Any]:
        """Convert to the plain values of ``build.json``."""
        return {
            "format": "terraport-build",
            "version": self.version,
            "published": self.published,
            "seconds": round(self.seconds, 3),
            "peak_bytes": self.peak_bytes,
            "inputs": list(self.inputs),
            "left_out": list(self.left_out),
            **({} if self.extent is None else {"extent": dict(self.extent)}),
            "stages": [
                {
                    "name": stage.name,
                    "taken_up": stage.taken_up,
                    "seconds": round(stage.cost.seconds, 3),
                    "peak_bytes": stage.cost.peak_bytes,
                    "steps": [
                        {
                            "name": step.name,
                            "seconds": round(step.seconds, 3),
                            "cpu_seconds": round(step.cpu_seconds, 3),
                        }
                        for step in stage.cost.steps
                    ],
                    "counts": stage.facts.counts,
                    "warnings": list(stage.facts.warnings),
                    "choices": list(stage.facts.choices),
                    **{
                        name: stage.facts.notes[name] for name in _KEPT if name in stage.facts.notes
                    },
                }
                for stage in self.stages
            ],
        }


def write_build_report(report: BuildReport) -> Path:
    """Write ``build.json`` into the scene; readers never see half of it."""
    path = report.scene / BUILD_REPORT_NAME
    beside = path.with_name(f".{BUILD_REPORT_NAME}.tmp")
    with beside.open("w", encoding="utf-8") as file:
        json.dump(report.to_json(), file, indent=1)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    return path


def _shown_facts(stage: StageReport) -> str:
    counts = stage.facts.counts
    return "  ".join(named_count(name, counts[name]) for name in _available(stage.name, counts))


def _available(stage: str, counts: dict[str, Any]) -> Iterable[str]:
    return (name for name in _SHOWN.get(stage, ()) if counts.get(name) is not None)
