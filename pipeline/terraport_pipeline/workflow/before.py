"""What a build over a scene goes by: results of the build that published it.

::

    WORK/published/  of the version that stands there, with a note of it in ``about/``
    WORK/before/     of the version that it was built over
    WORK/next/       of the version that is being published

A build of the same survey goes by what the published one went by, so that it makes the same scene;
a build of another survey goes by the published one, which becomes what was before. Publishing and
noting it are two acts: of a build that is killed in between, ``next`` becomes ``published``.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import xxhash

from terraport_pipeline.engines.readers.npy_columns import link_or_copy
from terraport_pipeline.stages.contract import Facts, Json, Stored
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory
from terraport_store.errors import StoreError
from terraport_store.layout import MANIFEST_NAME
from terraport_store.manifest import BuildInfo, Manifest

__all__ = ["SURVEY", "Before", "find_before", "prepare", "remember"]

SURVEY: Final = "survey"
"""Columns of the survey that a version was built from, as read or renewed."""

_ABOUT: Final = "about"


@dataclass(frozen=True, slots=True)
class Before:
    """Results of the build that published the version before."""

    work: WorkDirectory
    version: str
    decisions: Mapping[str, str]
    """Of every decision that stands for later surveys: its code and options as one key, by the
    stage's name."""

    def find(self, name: str) -> StageRecord | None:
        """Look for a result, whatever it was made from, by the name that it was kept under."""
        record = self.work.latest(name)
        return None if record is None else replace(record, name=name)

    def decision(self, name: str, key: str) -> StageRecord | None:
        """Look for a decision of that code and these options."""
        return self.find(name) if self.decisions.get(name) == key else None


def find_before(work: WorkDirectory, scene: Path, survey: str) -> Before | None:
    """Find what a build of a survey goes by; None where it starts anew.

    Parameters
    ----------
    work : WorkDirectory
    scene : Path
        Scene directory.
    survey : str
        Digest of the survey as read.
    """
    manifest = _manifest(scene)
    if manifest is None:
        return None
    published, before = work.path / "published", work.path / "before"
    _note_publication(work, manifest)
    record = _about(published)
    if record is not None and not _is_of(record, manifest):
        record = None  # somebody else published here since
    if record is not None and record.values["survey"] != survey:
        # Not atomic with the next line, and need not be: killed in between, all is built anew.
        shutil.rmtree(before, ignore_errors=True)
        published.rename(before)
    about = _about(before)
    if about is None:
        return None
    # Of the published version, or of the one before it where this survey was published last.
    versions = {manifest.version, None if record is None else record.values["before"]}
    source = manifest.build.input
    is_this_survey = source is not None and source.xxh3 == survey[:16]
    goes_on = about.values["version"] in versions or _is_of(about, manifest)
    if not goes_on and not is_this_survey:
        return None
    return Before(WorkDirectory(before), about.values["version"], about.values["decisions"])


def prepare(
    work: WorkDirectory,
    names: Mapping[str, str],
    decisions: Mapping[str, str],
    *,
    build: BuildInfo,
    survey: str,
    before: Before | None,
) -> None:
    """Keep results of a build that is about to publish, as :func:`remember` does after it.

    Parameters
    ----------
    work, names, decisions, survey, before
        See :func:`remember`.
    build : BuildInfo
        As the manifest will have it: by this the version is known to be this build's.
    """
    values = {**_values(decisions, survey, before), "build": _digest(build)}
    _keep(work, "next", names, values)


def _note_publication(work: WorkDirectory, manifest: Manifest) -> None:
    """Remember a version whose build was killed after publishing it and before remembering it."""
    prepared, published = work.path / "next", work.path / "published"
    record, noted = _about(prepared), _about(published)
    if record is None:
        return
    # By its version where an earlier call was killed between the two steps below.
    ours = {record.values.get("build"), record.values.get("version")}
    if not ours & {_digest(manifest.build), manifest.version}:
        return
    if noted is None or noted.values["version"] != manifest.version:
        values = {**record.values, "version": manifest.version}
        WorkDirectory(prepared).save(_ABOUT, "", Stored({}, values), Facts(), Cost(0.0, 0))
        shutil.rmtree(published, ignore_errors=True)
        prepared.rename(published)


def remember(
    work: WorkDirectory,
    names: Mapping[str, str],
    decisions: Mapping[str, str],
    *,
    version: str,
    build: BuildInfo,
    survey: str,
    before: Before | None,
) -> None:
    """Keep results of a build that has published, for the next survey.

    Parameters
    ----------
    work : WorkDirectory
    names : mapping of str to str
        Results to keep, by the name that they are kept under.
    decisions : mapping
        See :class:`Before`.
    version : str
        What was published.
    build : BuildInfo
        As the manifest has it: versions that ``label`` and ``teach`` make of the same ground keep
        it, and are this build's too.
    survey : str
        Digest of the survey as read.
    before : Before or None
        What the build went by.
    """
    values = {**_values(decisions, survey, before), "build": _digest(build), "version": version}
    record = _about(work.path / "published")
    if record is None or dict(record.values) != values:
        _keep(work, "published", names, values)
    work.forget("next")


def _values(decisions: Mapping[str, str], survey: str, before: Before | None) -> dict[str, Json]:
    return {
        "survey": survey,
        "before": None if before is None else before.version,
        "decisions": dict(decisions),
    }


def _keep(
    work: WorkDirectory, name: str, names: Mapping[str, str], values: Mapping[str, Json]
) -> None:
    """Put links to results, and a note of what they are, in place of what a folder had."""
    with work.beside(name) as folder:
        kept = WorkDirectory(folder)
        for kept_name, result in names.items():
            # Results are never changed in place, only replaced: a link keeps what is there now.
            shutil.copytree(work.path / result, folder / kept_name, copy_function=link_or_copy)
        kept.save(_ABOUT, "", Stored({}, values), Facts(), Cost(0.0, 0))


def _is_of(record: StageRecord, manifest: Manifest) -> bool:
    """Whether a build published this version, or the one whose regions were cut anew since."""
    return record.values["version"] == manifest.version or record.values.get("build") == _digest(
        manifest.build
    )


def _digest(build: BuildInfo) -> str:
    document = json.dumps(build.model_dump(mode="json"), sort_keys=True)
    return xxhash.xxh3_128_hexdigest(document.encode())


def _about(folder: Path) -> StageRecord | None:
    return WorkDirectory(folder).latest(_ABOUT) if folder.is_dir() else None


def _manifest(scene: Path) -> Manifest | None:
    try:
        return Manifest.from_bytes((scene / MANIFEST_NAME).read_bytes())
    except (OSError, StoreError):
        return None
