"""``terraport diff``: what differs between two scenes, or a scene's version and the one before.

A segment is the same where its number and the hash of its payload are. Clients go by the hash alone
(``spec/protocol.md``, section 1): a client with the one in its cache loads for the other what is
not kept, or less.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Bool, Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.region_table import region_rows
from terraport_pipeline.upkeep.listing import SceneExtent
from terraport_store import (
    DamagedSceneError,
    FileInfo,
    Manifest,
    RegionNames,
    Scene,
    SegmentIndex,
    read_labels,
)
from terraport_store.layout import (
    BASE,
    COVER,
    INDEX,
    MAX_INDEX_BYTES,
    MAX_REGIONS_BYTES,
    REGIONS,
    VERSION_FOLDER,
)
from terraport_store.publishing import hash_file

__all__ = [
    "Compared",
    "Difference",
    "Share",
    "compare",
    "of_folder_before",
    "of_scene",
    "side_facts",
]

_LOADED: Final = (BASE, COVER)
"""What a client loads once, whole."""

_SAME_SHARE: Final = 1e-9
"""Relative difference of two areas that is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One side of a comparison."""

    location: str
    version: str
    """Of a version before, whose manifest is gone, the digits in its folder's name."""
    index: SegmentIndex
    regions: Mapping[str, Any]
    labels: Mapping[int, str]
    files: Mapping[str, FileInfo] = field(default_factory=dict)
    """Of a version before only those that a client loads whole."""
    manifest: Manifest | None = None
    """None of a version before: only that of the published version is kept."""


@dataclass(frozen=True, slots=True)
class Share:
    """Some segments: how many, and their payloads' bytes."""

    segments: int
    bytes: int


@dataclass(frozen=True, slots=True)
class Difference:
    """What differs; of two sides ``first`` and ``second``."""

    is_same: bool
    """The same version, under the same labels."""
    kept: Share
    changed: Share
    """Another payload under the number; bytes of the second."""
    new: Share
    """Numbers that the first has not."""
    gone: Share
    """Numbers that the second has not; bytes of the first."""
    renumbered: Share
    """Of ``changed`` and ``new``, payloads that the first has under other numbers: clients load
    them again."""
    files_bytes: int
    """Base mesh and cover, where they differ."""
    regions: tuple[dict[str, Any], ...]
    """Regions that differ, largest first: ``stable_id``, ``state`` (changed, new, gone, renamed),
    ``label``, ``label_before``, ``surface_area_m2``, ``surface_area_before_m2``."""
    regions_kept: int
    regions_problem: str | None
    """Why regions are not compared."""
    options: dict[str, tuple[Any, Any]]
    """What the builds were given differently, by name."""
    kept_first: Bool
    kept_second: Bool
    """(S,) by segment of either."""

    @property
    def load_bytes(self) -> int:
        """What a client with the first in its cache loads for all of the second."""
        return self.changed.bytes + self.new.bytes + self.files_bytes


def of_scene(scene: Scene, location: str) -> Compared:
    """Take what is compared from an open scene."""
    return Compared(
        location,
        scene.manifest.version,
        scene.index,
        scene.regions,
        read_labels(scene.files),
        scene.manifest.files,
        scene.manifest,
    )


def of_folder_before(scene_dir: Path, manifest: Manifest) -> Compared:
    """Take what is compared from the version before, which a publication leaves on disk.

    Parameters
    ----------
    scene_dir : Path
    manifest : Manifest
        Of the published version.

    Raises
    ------
    OptionError
        There is none.
    DamagedSceneError
        Its index or its regions are not what the format says.
    """
    folders = [
        path
        for path in scene_dir.iterdir()
        if VERSION_FOLDER.fullmatch(path.name) and path.name != manifest.folder
    ]
    if not folders:
        raise OptionError(
            f"{scene_dir} holds no version before the published one; expected a second scene"
        )
    folder = max(folders, key=lambda path: path.stat().st_mtime_ns)
    index = SegmentIndex.from_bytes(_read(folder / INDEX, MAX_INDEX_BYTES))
    try:
        regions = json.loads(_read(folder / REGIONS, MAX_REGIONS_BYTES))
    except ValueError as error:
        what = f"does not parse as JSON: {error}"
        raise DamagedSceneError(f"{folder.name}/{REGIONS}", what) from None
    digits = folder.name.removeprefix("v-").partition("-")[0]
    files = {key: _file_info(folder / key) for key in _LOADED if (folder / key).is_file()}
    return Compared(str(folder), digits, index, regions, read_labels(scene_dir), files)


def compare(first: Compared, second: Compared) -> Difference:
    """Compare two scenes, or two versions of one.

    Parameters
    ----------
    first, second : Compared

    Returns
    -------
    Difference
    """
    # (1) Segments, by number and hash.
    common = min(len(first.index), len(second.index))
    is_same = first.index.xxh3[:common] == second.index.xxh3[:common]
    kept_first, kept_second = (
        np.concatenate([is_same, np.zeros(len(side.index) - common, np.bool_)])
        for side in (first, second)
    )
    loaded = ~kept_second
    known = loaded & np.isin(second.index.xxh3, first.index.xxh3)
    behind = np.arange(len(second.index)) >= common
    gone = np.arange(len(first.index)) >= common
    # (2) Files that are loaded whole.
    files_bytes = sum(
        second.files[key].bytes
        for key in _LOADED
        if key in second.files
        and (key not in first.files or first.files[key].xxh3 != second.files[key].xxh3)
    )
    # (3) Regions and options.
    rows, regions_kept, problem = _regions(first, second)
    same_labels = dict(first.labels) == dict(second.labels)
    return Difference(
        is_same=first.version == second.version and same_labels,
        kept=_share(second.index, kept_second),
        changed=_share(second.index, loaded & ~behind),
        new=_share(second.index, loaded & behind),
        gone=_share(first.index, gone),
        renumbered=_share(second.index, known),
        files_bytes=files_bytes,
        regions=rows,
        regions_kept=regions_kept,
        regions_problem=problem,
        options=_options(first.manifest, second.manifest),
        kept_first=kept_first,
        kept_second=kept_second,
    )


def side_facts(side: Compared) -> dict[str, Any]:
    """Say of one side what stands beside the other's; plain values."""
    manifest = side.manifest
    extent = None if manifest is None else SceneExtent.of(manifest)
    crs = None if manifest is None or manifest.crs is None else manifest.crs.name
    return {
        "location": side.location,
        "version": side.version,
        "faces": int(side.index.face_count.sum(dtype=np.uint64)),
        "base_faces": None if manifest is None else manifest.counts.base_faces,
        "segments": len(side.index),
        "regions": len(side.regions.get("regions", [])),
        "payload_bytes": side.index.payload_bytes,
        "bytes": None if manifest is None else sum(file.bytes for file in side.files.values()),
        "extent": None
        if extent is None
        else {
            "east": list(extent.east),
            "north": list(extent.north),
            "height": list(extent.height),
            "unit": extent.unit,
            "height_unit": extent.height_unit,
        },
        "crs": crs,
    }


def _share(index: SegmentIndex, chosen: Bool) -> Share:
    return Share(int(chosen.sum()), int(index.length[chosen].sum(dtype=np.uint64)))


def _regions(
    first: Compared, second: Compared
) -> tuple[tuple[dict[str, Any], ...], int, str | None]:
    """Compare regions by stable id; those of one number that lie apart are two."""
    sides = []
    for side in (first, second):
        names = RegionNames.of(side.regions)
        if names.stable_ids is None:
            return (), 0, f"{side.location} has no stable ids"
        documents = side.regions["regions"]
        rows = region_rows(names.with_labels(dict(side.labels)), side.regions, (0.0, 0.0, 0.0))
        sides.append({row["stable_id"]: (row, documents[row["region"]]) for row in rows})
    before, after = sides
    shift = _shift(first.manifest, second.manifest)
    out, kept = [], 0
    for number in sorted(before.keys() | after.keys()):
        old, new = before.get(number), after.get(number)
        if old is not None and new is not None and not _apart(old[1], new[1], shift):
            moved = bool(shift.any()) or not _is_same_ground(old[1], new[1])
            renamed = old[0]["label"] != new[0]["label"]
            kept += not (moved or renamed)
            if moved or renamed:
                out.append(_region(number, "changed" if moved else "renamed", old[0], new[0]))
            continue
        if old is not None:
            out.append(_region(number, "gone", old[0], None))
        if new is not None:
            out.append(_region(number, "new", None, new[0]))
    out.sort(
        key=lambda row: -max(row["surface_area_m2"] or 0.0, row["surface_area_before_m2"] or 0.0)
    )
    return tuple(out), kept, None


def _region(
    number: int, state: str, old: Mapping[str, Any] | None, new: Mapping[str, Any] | None
) -> dict[str, Any]:
    return {
        "stable_id": number,
        "state": state,
        "label": None if new is None else new["label"],
        "label_before": None if old is None else old["label"],
        "surface_area_m2": None if new is None else new["surface_area_m2"],
        "surface_area_before_m2": None if old is None else old["surface_area_m2"],
    }


def _is_same_ground(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether triangles, area and centre are the same: numbers of neighbours may differ."""
    for key in ("faces", "area_m2", "centroid"):
        one, other = old.get(key), new.get(key)
        if (one is None) != (other is None):
            return False
        if one is None or other is None:
            continue
        if not np.allclose(one, other, rtol=_SAME_SHARE, atol=0.0):
            return False
    return True


def _apart(old: Mapping[str, Any], new: Mapping[str, Any], shift: Float64) -> bool:
    """Whether the boxes of two regions do not touch: one number, but two pieces of ground."""
    boxes = [row.get("bounds") for row in (old, new)]
    try:
        lows, highs = (
            np.array([box[end] for box in boxes], np.float64)  # type: ignore[index]
            for end in ("min", "max")
        )
    except (TypeError, KeyError, ValueError):  # facts are optional
        return False
    lows[1] += shift
    highs[1] += shift
    return bool((lows.max(axis=0) > highs.min(axis=0)).any())


def _shift(first: Manifest | None, second: Manifest | None) -> Float64:
    """Return the origin of the second in the scene frame of the first, metres.

    That of a version before is written nowhere: a scene that is built over keeps it.
    """
    if first is None or second is None:
        return np.zeros(3)
    east, north, height = np.subtract(second.origin, first.origin)
    return np.array([east, height, -north])


def _options(first: Manifest | None, second: Manifest | None) -> dict[str, tuple[Any, Any]]:
    if first is None or second is None:
        return {}
    sides = []
    for manifest in (first, second):
        build = manifest.build
        about = {
            "terraport": build.terraport,
            "name": manifest.name,
            "input": None if build.input is None else build.input.model_dump(),
        }
        sides.append({**about, **_flat(build.options)})
    one, other = sides
    return {
        name: (one.get(name), other.get(name))
        for name in [*one, *(name for name in other if name not in one)]
        if one.get(name) != other.get(name)
    }


def _flat(options: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Mapping):
            out |= _flat(value, f"{prefix}{name}.")
        else:
            out[f"{prefix}{name}"] = value
    return out


def _file_info(path: Path) -> FileInfo:
    """Say of a file what the manifest that is gone said."""
    size = path.stat().st_size
    return FileInfo(path=f"{path.parent.name}/{path.name}", bytes=size, xxh3=hash_file(path))


def _read(path: Path, limit: int) -> bytes:
    with path.open("rb") as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise DamagedSceneError(path.name, f"over {limit} bytes, expected at most that")
    return data
