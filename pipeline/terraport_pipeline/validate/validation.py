"""``terraport validate``: is a scene whole, does its cover leave holes, is its glTF good.

Checks of which each can be left out: the store's own (hashes, sizes, counts, every payload
decoded), the proofs of the hand-off and of mixes of levels by rays, and the Khronos validator on a
sample.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload import PayloadError
from terraport_pipeline.engines.gltf_validator import GltfCheck, check_gltf
from terraport_pipeline.engines.pictures import save_png
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.scene_model import WHOLE_FACES, load_scene_model
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions, HandOffReport
from terraport_pipeline.validate.level_mixes import LevelMixReport, check_level_mixes
from terraport_pipeline.validate.scene_windows import prove_in_windows, segments_around
from terraport_pipeline.validate.worst_place import compare_at
from terraport_store import Manifest, Scene, SceneFiles, StoreError, read_manifest, scene_files
from terraport_store.layout import BASE, OVERVIEW
from terraport_store.validate import Finding, validate_scene

__all__ = ["ValidationOptions", "ValidationResult", "validate"]

GLTF_SAMPLE: Final = 32
"""Segments that the Khronos validator looks at, evenly spread; 0.1 s each."""


@dataclass(frozen=True, slots=True)
class ValidationOptions:
    """Which checks run beyond the files, and with how many samples."""

    hand_off: HandOffOptions | None = field(default_factory=HandOffOptions)
    """None leaves the rays out. Of a scene with two levels as many are cast again, at mixes."""
    khronos: bool = False
    """Whether the Khronos validator must run; it may fetch its npm package over the network."""
    gltf_sample: int = GLTF_SAMPLE
    picture: Path | None = None
    """Where to write a PNG of the place where the rays fared worst."""


@dataclass(frozen=True, slots=True)
class ValidationResult:
    """Findings about a scene's files, payloads and hand-off, and which checks did not run."""

    path: Path | str
    manifest: Manifest | None
    """None when it cannot be read."""
    findings: tuple[Finding, ...]
    """Findings of the store's check of files, index and cover."""
    hand_off: HandOffReport | None
    hand_off_not_run: str
    """Why the rays were not cast; empty when they were."""
    gltf: GltfCheck
    gltf_required: bool = False
    hand_off_seconds: float = 0.0
    """Wall time of the rays and their judgement alone."""
    picture: Path | None = None
    """Where the picture of the worst place lies; None when none was drawn."""
    levels: LevelMixReport | None = None
    """What rays at mixes of levels found; None of a scene with one, or where they were not cast."""
    levels_not_run: str = ""
    """Why those of a scene with two levels were not cast; empty when they were."""

    @property
    def problems(self) -> int:
        """Everything that makes the scene fail; warnings do not."""
        broken = sum(finding.severity == "error" for finding in self.findings)
        holes = self.hand_off.holes if self.hand_off else 0
        holes += self.levels.holes if self.levels else 0
        missing = int(self.gltf_required and bool(self.gltf.not_run))
        return broken + holes + self.gltf.errors + missing


def validate(
    scene_path: Path | str,
    options: ValidationOptions | None = None,
    *,
    progress: Progress | None = None,
    announce: Callable[[str], None] | None = None,
) -> ValidationResult:
    """Check a published scene.

    Parameters
    ----------
    scene_path : Path or str
        The scene directory, or the address of a scene in object storage.
    options : ValidationOptions, optional
        Everything, by default.
    progress : Progress, optional
        Advances by segments, then by rays.
    announce : callable, optional
        Gets a line of text before the network is used, which only ``khronos`` does.

    Returns
    -------
    ValidationResult
        Whatever is wrong with the scene is a finding, not an error.

    Raises
    ------
    SceneNotFoundError
        When there is no scene.
    OptionError
        When the picture's folder does not exist.
    """
    chosen, watcher = options or ValidationOptions(), progress or NullProgress()
    if chosen.picture is not None and not chosen.picture.absolute().parent.is_dir():
        raise OptionError(
            f"received the picture {chosen.picture}, expected an existing folder "
            f"{chosen.picture.parent}"
        )
    files = scene_files(scene_path)
    try:
        findings = tuple(validate_scene(files, progress=_by_segment(watcher)))
        watcher.done({"findings": len(findings)})
        proof = _Proof(None, "left out")
        levels, levels_not_run = None, "left out"
        if chosen.hand_off is not None:
            proof = _look(files, chosen.hand_off, chosen.picture, watcher)
            levels, levels_not_run = _look_at_levels(files, chosen.hand_off, watcher)
        gltf = GltfCheck(0, not_run="only with --khronos")
        if chosen.khronos:
            gltf = _judge(files, chosen.gltf_sample, watcher, announce)
        try:
            manifest = read_manifest(files)
        except StoreError:
            manifest = None  # it is among the findings
    finally:
        files.close()
    return ValidationResult(
        scene_path,
        manifest,
        findings,
        proof.report,
        proof.why_not,
        gltf,
        chosen.khronos,
        proof.seconds,
        proof.picture,
        levels,
        levels_not_run,
    )


def _by_segment(watcher: Progress) -> Callable[[int, int], None]:
    state = {"done": 0}

    def advance(done: int, total: int) -> None:
        if state["done"] == 0:
            watcher.start("check payloads", total, "segments")
        watcher.advance(done - state["done"])
        state["done"] = done

    return advance


@dataclass(frozen=True, slots=True)
class _Proof:
    """Report of the rays, or why they did not run."""

    report: HandOffReport | None
    why_not: str = ""
    seconds: float = 0.0
    picture: Path | None = None


def _look(
    files: SceneFiles, options: HandOffOptions, picture: Path | None, watcher: Progress
) -> _Proof:
    """Cast the rays; a scene too damaged for it is a reason, not an error."""
    try:
        with Scene.open(files) as scene:
            if int(scene.index.face_count.sum(dtype=np.int64)) > WHOLE_FACES:
                return _look_in_windows(scene, options, picture, watcher)
            model = load_scene_model(scene, progress=watcher)
        levels = model.hand_off_model()
        detail = RayScene(levels.detail_vertices, levels.detail_faces)
        base = RayScene(levels.base_vertices, levels.base_faces)
        start = time.perf_counter()
        report = check_hand_off(
            levels, options, progress=watcher, detail_rays=detail, base_rays=base
        )
        seconds = time.perf_counter() - start
    except (StoreError, PipelineError) as error:
        return _Proof(None, str(error))
    if picture is None or report.worst is None:
        return _Proof(report, "", seconds)
    save_png(compare_at(model, report.worst, detail_rays=detail, base_rays=base), picture)
    return _Proof(report, "", seconds, picture)


def _look_at_levels(
    files: SceneFiles, options: HandOffOptions, watcher: Progress
) -> tuple[LevelMixReport | None, str]:
    """Cast rays at mixes of levels, where there are two; why not, where not."""
    try:
        with Scene.open(files) as scene:
            if scene.manifest.levels < 2:
                return None, ""
            return check_level_mixes(
                scene, rays=options.rays, seed=options.seed, progress=watcher
            ), ""
    except (StoreError, PipelineError) as error:
        return None, str(error)


def _look_in_windows(
    scene: Scene, options: HandOffOptions, picture: Path | None, watcher: Progress
) -> _Proof:
    """Cast the rays at a scene larger than memory."""
    start = time.perf_counter()
    report = prove_in_windows(scene, options, watcher)
    seconds = time.perf_counter() - start
    if picture is None or report.worst is None:
        return _Proof(report, "", seconds)
    near = segments_around(scene, report.worst.target)
    model = load_scene_model(scene, segments=near, progress=watcher)
    save_png(compare_at(model, report.worst), picture)
    return _Proof(report, "", seconds, picture)


def _judge(
    files: SceneFiles, sample: int, watcher: Progress, announce: Callable[[str], None] | None
) -> GltfCheck:
    watcher.start("Khronos glTF validator", None, "payloads")
    payloads: dict[str, bytes | memoryview] = {}
    try:
        with Scene.open(files) as scene:
            payloads["base"] = scene.file_glb(BASE)
            if OVERVIEW in scene.manifest.files:
                payloads["overview"] = scene.file_glb(OVERVIEW)
            count = len(scene.index)
            for segment in np.unique(np.linspace(0, count - 1, min(sample, count)).astype(int)):
                payloads[f"segment {segment}"] = scene.glb(int(segment))
    except (PayloadError, StoreError, OSError) as error:
        watcher.done({})
        return GltfCheck(0, not_run=str(error))
    result = check_gltf(payloads, announce=announce)
    watcher.done({"payloads": result.checked, "errors": result.errors})
    return result
