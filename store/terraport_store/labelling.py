"""Read and set the labels of a scene's regions: the file ``labels.json`` beside the manifest.

::

    change_labels(scene_dir, {7: "haul road", 12: None})      # None takes a label away

One small file is replaced in one step; no payload is touched, no version published. A running
service notices it as it notices a new version.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from terraport_store.errors import DamagedSceneError, LabelError
from terraport_store.files import SceneFiles
from terraport_store.labels import MAX_LABELS, encode_labels, label_fault, parse_labels
from terraport_store.layout import LABELS, MAX_LABELS_BYTES, MAX_REGIONS_BYTES, REGIONS
from terraport_store.location import scene_files
from terraport_store.opening import read_checked, read_manifest
from terraport_store.publishing import (
    PublishLock,
    out_of_space_named,
    replace_file,
    sweep_left_overs,
)
from terraport_store.regions import RegionNames

__all__ = ["change_labels", "read_labels", "read_names"]

_ATTEMPTS: Final = 5
"""As many as for opening a scene: a version vanishes only when two newer ones are published."""


def read_labels(scene_dir: str | Path | SceneFiles) -> dict[int, str]:
    """Read what users call the regions.

    Parameters
    ----------
    scene_dir : str, Path or SceneFiles
        The scene directory, or where else the scene lies.

    Returns
    -------
    dict of int to str
        Label by stable id, ascending; empty where there is no labels.json.

    Raises
    ------
    DamagedSceneError
        When the file is not what the format says.
    """
    files = scene_files(scene_dir)
    try:
        data = files.read(LABELS, MAX_LABELS_BYTES)
    except FileNotFoundError:
        return {}
    finally:
        if files is not scene_dir:
            files.close()
    return parse_labels(data)


def read_names(scene_dir: str | Path | SceneFiles) -> tuple[RegionNames, dict[str, Any]]:
    """Read names and facts of the published version's regions, without opening its segments.

    Parameters
    ----------
    scene_dir : str, Path or SceneFiles
        The scene directory, or where else the scene lies.

    Returns
    -------
    RegionNames
        With the users' labels.
    dict
        Contents of regions.json.

    Raises
    ------
    SceneNotFoundError
        When there is no scene.json.
    DamagedSceneError
        When manifest, regions or labels are not what the format says.
    """
    files = scene_files(scene_dir)
    try:
        document, path = _read_regions(files)
        names = RegionNames.of(document, file=path)
        return names.with_labels(read_labels(files)), document
    finally:
        if files is not scene_dir:
            files.close()


def change_labels(scene_dir: str | Path, changes: Mapping[int, str | None]) -> RegionNames:
    """Set and take away labels of regions of the published version, all or none.

    Parameters
    ----------
    scene_dir : str or Path
        The scene directory.
    changes : mapping of int to str or None
        New label by stable id; None takes it away. Regions that are not named keep theirs.

    Returns
    -------
    RegionNames
        Of the published version, with the labels as they are now.

    Raises
    ------
    LabelError
        When a stable id is none of the published version's, a label is too long or holds control
        characters, or the scene has no stable ids. Nothing was changed.
    SceneBusyError
        When another process is publishing the scene or setting labels.
    SceneNotFoundError, DamagedSceneError
        When there is no scene, or its manifest, regions or labels cannot be read.
    OutOfSpaceError
        When the disk is full; the labels before stand.
    """
    directory = Path(scene_dir)
    read_manifest(directory)  # "no scene" comes before "cannot lock"
    lock = PublishLock(directory)
    try:
        sweep_left_overs(directory)
        names, _ = read_names(directory)
        _check(names, changes)
        labels = dict(names.labels)
        for number, label in changes.items():
            if label is None:
                labels.pop(number, None)
            else:
                labels[number] = label
        # Labels of regions that are gone are kept for sessions of the version before, until there
        # is no room: then the oldest numbers go first.
        spare = list(names.with_labels(labels).without_region())
        for number in spare[: max(0, len(labels) - MAX_LABELS)]:
            del labels[number]
        data = encode_labels(labels)
        if len(data) > MAX_LABELS_BYTES:
            raise LabelError(f"{len(data)} bytes of labels, expected at most {MAX_LABELS_BYTES}")
        if labels != names.labels:
            with out_of_space_named(directory):
                replace_file(directory, LABELS, f".labels-{secrets.token_hex(8)}.json.tmp", data)
    finally:
        lock.release()
    return names.with_labels(dict(sorted(labels.items())))


def _check(names: RegionNames, changes: Mapping[int, str | None]) -> None:
    if names.stable_ids is None:
        raise LabelError("regions.json gives no stable ids; build the scene again, then label it")
    stable_ids = set(names.stable_ids.tolist())
    for number, label in changes.items():
        if number not in stable_ids:
            raise LabelError(
                f"stable id {number}, expected one of the {len(stable_ids)} of the published "
                f"version ({min(stable_ids, default=0)} to {max(stable_ids, default=0)})"
            )
        fault = None if label is None else label_fault(label)
        if fault is not None:
            raise LabelError(f"stable id {number}: {fault}")


def _read_regions(files: SceneFiles) -> tuple[dict[str, Any], str]:
    """Contents of regions.json of the published version, checked by its hash, and its path."""
    for attempt in range(_ATTEMPTS):
        manifest = read_manifest(files)
        path = manifest.files[REGIONS].path
        try:
            data = read_checked(files, manifest, REGIONS, MAX_REGIONS_BYTES)
        except FileNotFoundError:
            # A newer version may have been published in between.
            if attempt + 1 < _ATTEMPTS:
                continue
            raise DamagedSceneError(path, "no such file, expected by scene.json") from None
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DamagedSceneError(path, f"does not parse as JSON: {error}") from None
        if not isinstance(document, dict):
            raise DamagedSceneError(path, f"a {type(document).__name__}, expected an object")
        return document, path
    raise AssertionError  # pragma: no cover - the last attempt returns or raises
