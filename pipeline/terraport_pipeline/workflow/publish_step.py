"""The last step of every build: publish, unless the scene already is what would be published."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from terraport_pipeline.measure import Measure, StepClock
from terraport_pipeline.stages import pack
from terraport_pipeline.stages.contract import Context, Stored
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.workdir import Cost
from terraport_store.errors import StoreError
from terraport_store.layout import MANIFEST_NAME
from terraport_store.manifest import BuildInfo, InputInfo, Manifest

__all__ = ["build_info", "pack_once"]


def pack_once(
    runner: StageRunner, scene: Path, key: str, publish: Callable[[Context], pack.Packed]
) -> tuple[str, bool]:
    """Publish, unless the scene already is what would be published.

    Parameters
    ----------
    runner : StageRunner
        Gets the report.
    scene : Path
        Scene directory.
    key : str
        Of everything that changes the published bytes.
    publish : callable
        Does it.

    Returns
    -------
    version : str
    published : bool
        Whether it was published now.
    """
    record = runner.work.find(pack.NAME, key) if runner.resume else None
    if record is not None and _is_published(scene, record.values):
        runner.reports.append(StageReport(pack.NAME, True, record.cost, record.facts))
        return str(record.values["version"]), False
    clock = StepClock(runner.progress)
    with runner.at(pack.NAME), Measure() as measure, runner.work.scratch() as scratch:
        packed = publish(replace(runner.context(scratch), progress=clock))
    cost = Cost(measure.seconds, measure.peak_bytes, tuple(clock.steps))
    values = {"version": packed.manifest.version}
    record = runner.work.save(pack.NAME, key, Stored({}, values), packed.facts, cost)
    runner.reports.append(StageReport(pack.NAME, False, cost, record.facts))
    return packed.manifest.version, True


def build_info(
    recorded: Mapping[str, Any], input_info: InputInfo, reports: Sequence[StageReport]
) -> BuildInfo:
    """Say in the manifest how a scene came about.

    Parameters
    ----------
    recorded : mapping
        Options that change the published bytes.
    input_info : InputInfo
    reports : sequence of StageReport
        Of all stages but this one.
    """
    try:
        release = version("terraport")
    except PackageNotFoundError:
        release = "unknown"
    return BuildInfo(
        terraport=release,
        options=dict(recorded),
        input=input_info,
        warnings=tuple(text for report in reports for text in report.facts.warnings),
        stages=tuple({"name": r.name, "counts": r.facts.counts} for r in reports),
    )


def _is_published(scene: Path, values: Mapping[str, Any]) -> bool:
    """Whether the scene is the version that was packed, with all its files in full size."""
    try:
        manifest = Manifest.from_bytes((scene / MANIFEST_NAME).read_bytes())
        return manifest.version == values["version"] and all(
            (scene / file.path).stat().st_size == file.bytes for file in manifest.files.values()
        )
    except (OSError, StoreError):
        return False
