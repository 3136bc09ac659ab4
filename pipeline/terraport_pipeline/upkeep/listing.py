"""``terraport list``: the scenes at a path or an address, and what builds keep beside them.

Only manifests are read, and names and sizes of files: a folder of large scenes is listed at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.export.frame import SurveyFrame, survey_frame
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.workflow.scene_lock import build_process
from terraport_pipeline.workflow.workdir import is_work_directory
from terraport_store import (
    Manifest,
    SceneNotFoundError,
    StoreError,
    is_url,
    list_scenes,
    meant_url,
    needing_obstore,
    read_manifest,
)
from terraport_store.layout import MANIFEST_NAME
from terraport_store.scene_folder import folder_bytes

__all__ = ["SceneExtent", "SceneRow", "WorkRow", "list_rows"]

_WORK_ENDING: Final = ".work"
_LOCK_ENDING: Final = ".lock"


@dataclass(frozen=True, slots=True)
class SceneExtent:
    """Where a scene lies, in the coordinates and the unit of its survey."""

    east: tuple[float, float]
    north: tuple[float, float]
    height: tuple[float, float]
    unit: str
    height_unit: str

    @classmethod
    def of(cls, manifest: Manifest) -> SceneExtent:
        """Convert the manifest's bounds."""
        # In metres the CRS does not matter here; to read one takes longer than all the rest.
        in_metres = manifest.survey_units is None
        frame = SurveyFrame(manifest.origin, None) if in_metres else survey_frame(manifest)
        (x0, y0, z0), (x1, y1, z1) = manifest.bounds.min, manifest.bounds.max
        ends = np.sort(frame.to_survey(np.array([(x0, y0, z1), (x1, y1, z0)])), axis=0)
        low, high = ends.tolist()
        east, north, height = zip(low, high, strict=True)
        return cls(east, north, height, frame.unit_name, frame.height_unit_name)

    def __str__(self) -> str:
        """Write the rectangle as ``--extent`` takes it."""
        corners = (self.east[0], self.north[0], self.east[1], self.north[1])
        return f"{' '.join(f'{value:.1f}' for value in corners)} {self.unit}"


@dataclass(frozen=True, slots=True)
class WorkRow:
    """A build's work directory."""

    path: str
    bytes: int


@dataclass(frozen=True, slots=True)
class SceneRow:
    """One scene, or what an unfinished build has of one."""

    name: str
    location: str
    """Path or address."""
    manifest: Manifest | None
    """None where nothing is published, or it cannot be read."""
    bytes: int
    """Of all files: versions, report, labels; without the work directory."""
    published: datetime | None
    """When the manifest was written; UTC."""
    extent: SceneExtent | None = None
    build_process: str | None = None
    """Number of the process that builds it now."""
    work: WorkRow | None = None
    problem: str | None = None
    """Why the manifest cannot be read."""

    @property
    def state(self) -> str:
        """Say in a word or two what is of it now."""
        if self.build_process is not None:
            return "being built"
        if self.problem is not None:
            return "damaged"
        return "published" if self.manifest is not None else "unfinished"


def list_rows(location: str | Path) -> Iterator[SceneRow]:
    """Look at every scene of a folder or an address, or at one scene.

    Parameters
    ----------
    location : str or Path
        An address is a str.

    Yields
    ------
    SceneRow
        By name, ascending; of a folder also what builds have not finished.

    Raises
    ------
    OriginError
        The address cannot be listed.
    FileNotFoundError
        There is no such folder.
    SceneNotFoundError
        It is an address with one slash.
    """
    if isinstance(location, str) and is_url(location):
        yield from _object_rows(location)
        return
    if meant_url(location) is not None:
        raise SceneNotFoundError(str(location))
    root = Path(location)
    if not root.is_dir():
        raise FileNotFoundError(2, "no such folder, expected one of scenes, or a scene", str(root))
    scenes = list_scenes(root)
    if (root / MANIFEST_NAME).is_file():
        scenes = {root.absolute().name: root}
        unfinished: dict[str, Path] = {}
    else:
        unfinished = _unfinished(root, scenes)
    for name, path in sorted({**scenes, **unfinished}.items()):
        yield _folder_row(name, path)


def _object_rows(url: str) -> Iterator[SceneRow]:
    with needing_obstore(url):
        from terraport_store.object_scene import reached_origin
        from terraport_store.origin import Origin
    # (1) One look with little patience; then its scenes, or the one that it is.
    asked = reached_origin(url)
    if asked.head(MANIFEST_NAME) is not None:
        scenes = {asked.url.rpartition("/")[2]: asked}
    else:
        names = [name for name in asked.folders() if not name.startswith((".", "v-"))]
        scenes = {name: Origin(f"{asked.url}/{name}", asked.options) for name in names}
    # (2) Folders without a manifest hold no scene; there is no work of builds in storage.
    for name, origin in scenes.items():
        objects = origin.objects()
        published = next((one for one in objects if one.path == MANIFEST_NAME), None)
        if published is not None:
            size = sum(one.size for one in objects)
            yield _row(name, origin.url, size, published.modified.astimezone(UTC))


def _folder_row(name: str, path: Path) -> SceneRow:
    scene = path.absolute()
    work = default_work_directory(scene)
    try:
        written_s = (path / MANIFEST_NAME).stat().st_mtime
    except FileNotFoundError:
        row = SceneRow(name, str(path), None, 0, None)
    else:
        row = _row(name, path, folder_bytes(path), datetime.fromtimestamp(written_s, UTC))
    work_row = WorkRow(str(work), folder_bytes(work)) if is_work_directory(work) else None
    return replace(row, build_process=build_process(scene), work=work_row)


def _row(name: str, location: str | Path, size: int, published: datetime) -> SceneRow:
    row = SceneRow(name, str(location), None, size, published)
    try:
        manifest = read_manifest(location)
    except StoreError as error:
        return replace(row, problem=str(error))
    return replace(row, manifest=manifest, extent=SceneExtent.of(manifest))


def _unfinished(root: Path, scenes: Mapping[str, Path]) -> dict[str, Path]:
    """Find work directories and locks of builds that have published nothing yet."""
    names = set()
    for entry in root.iterdir():
        for ending in (_WORK_ENDING, _LOCK_ENDING):
            if entry.name.startswith(".") and entry.name.endswith(ending):
                names.add(entry.name[1 : -len(ending)])
    paths = {name: root / name for name in names if name and name not in scenes}
    return {
        name: path
        for name, path in paths.items()
        if is_work_directory(default_work_directory(path)) or build_process(path) is not None
    }
