"""``terraport validate``: is a scene whole, does its cover leave holes, is its glTF good.

Three checks of which each can be left out: the store's own (hashes, sizes, counts, every payload
decoded), the proof of the hand-off by rays, and the Khronos validator on a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.gltf_validator import GltfCheck, check_gltf
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.handoff import check_hand_off
from terraport_pipeline.handoff_report import HandOffOptions, HandOffReport
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.scene_model import load_scene_model
from terraport_store import Manifest, Scene, StoreError, read_manifest
from terraport_store.validate import Finding, validate_scene

__all__ = ["ValidationOptions", "ValidationResult", "validate"]

GLTF_SAMPLE: Final = 32
"""Segments that the Khronos validator looks at, evenly spread; 0.1 s each."""


@dataclass(frozen=True, slots=True)
class ValidationOptions:
    """What is checked, and how hard."""

    hand_off: HandOffOptions | None = field(default_factory=HandOffOptions)
    """None leaves the rays out."""
    khronos: bool | None = None
    """True: it must run; False: it is left out; None: it runs where Node is at hand."""
    gltf_sample: int = GLTF_SAMPLE


@dataclass(frozen=True, slots=True)
class ValidationResult:
    """What was found."""

    path: Path
    manifest: Manifest | None
    """None when it cannot be read."""
    findings: tuple[Finding, ...]
    """Of the store's check."""
    hand_off: HandOffReport | None
    hand_off_not_run: str
    """Why the rays were not cast; empty when they were."""
    gltf: GltfCheck
    gltf_required: bool = False

    @property
    def problems(self) -> int:
        """Everything that makes the scene fail; warnings do not."""
        broken = sum(finding.severity == "error" for finding in self.findings)
        holes = self.hand_off.holes if self.hand_off else 0
        missing = int(self.gltf_required and bool(self.gltf.not_run))
        return broken + holes + self.gltf.errors + missing


def validate(
    scene_path: Path,
    options: ValidationOptions | None = None,
    *,
    progress: Progress | None = None,
) -> ValidationResult:
    """Check a published scene.

    Parameters
    ----------
    scene_path : Path
        The scene directory.
    options : ValidationOptions, optional
        Everything, by default.
    progress : Progress, optional
        Advances by segments, then by rays.

    Returns
    -------
    ValidationResult
        Whatever is wrong with the scene is a finding, not an error.

    Raises
    ------
    SceneNotFoundError
        When there is no scene.
    """
    chosen, watcher = options or ValidationOptions(), progress or NullProgress()
    findings = tuple(validate_scene(scene_path, progress=_by_segment(watcher)))
    watcher.done({"findings": len(findings)})
    hand_off, why = None, "left out"
    if chosen.hand_off is not None:
        hand_off, why = _look(scene_path, chosen.hand_off, watcher)
    gltf = GltfCheck(0, not_run="left out")
    if chosen.khronos is not False:
        gltf = _judge(scene_path, chosen.gltf_sample, watcher)
    try:
        manifest = read_manifest(scene_path)
    except StoreError:
        manifest = None  # it is among the findings
    return ValidationResult(
        scene_path, manifest, findings, hand_off, why, gltf, chosen.khronos is True
    )


def _by_segment(watcher: Progress) -> Callable[[int, int], None]:
    state = {"done": 0}

    def advance(done: int, total: int) -> None:
        if state["done"] == 0:
            watcher.start("check payloads", total, "segments")
        watcher.advance(done - state["done"])
        state["done"] = done

    return advance


def _look(
    scene_path: Path, options: HandOffOptions, watcher: Progress
) -> tuple[HandOffReport | None, str]:
    """Cast the rays; a scene too damaged for it is a reason, not an error."""
    try:
        with Scene.open(scene_path) as scene:
            model = load_scene_model(scene, progress=watcher)
        return check_hand_off(model.hand_off_model(), options, progress=watcher), ""
    except (StoreError, PipelineError) as error:
        return None, str(error)


def _judge(scene_path: Path, sample: int, watcher: Progress) -> GltfCheck:
    watcher.start("Khronos glTF validator", None, "payloads")
    payloads: dict[str, bytes | memoryview] = {}
    try:
        with Scene.open(scene_path) as scene:
            payloads["base"] = scene.base_path.read_bytes()
            count = len(scene.index)
            for segment in np.unique(np.linspace(0, count - 1, min(sample, count)).astype(int)):
                payloads[f"segment {segment}"] = bytes(scene.payload(int(segment)))
    except (StoreError, OSError) as error:
        watcher.done({})
        return GltfCheck(0, not_run=str(error))
    result = check_gltf(payloads)
    watcher.done({"payloads": result.checked, "errors": result.errors})
    return result
