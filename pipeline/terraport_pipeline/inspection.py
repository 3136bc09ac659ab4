"""``terraport inspect``: what is in a scene, from its manifest, index and region facts.

No payload is read, so a scene of any size answers at once.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Int64
from terraport_pipeline.region_table import region_rows
from terraport_pipeline.report.facts import read_build_record
from terraport_pipeline.report.scene_colour import SceneColour
from terraport_store import DamagedSceneError, Manifest, RegionNames, Scene, is_url, read_labels

__all__ = ["inspect_scene"]

MAX_REGIONS: Final = 20
"""Regions that are listed."""

PERCENTILES: Final = (("min", 0), ("p10", 10), ("median", 50), ("p90", 90), ("max", 100))


def inspect_scene(location: Path | str) -> dict[str, Any]:
    """Describe a scene.

    Parameters
    ----------
    location : Path or str
        The scene directory, or its address, a str.

    Returns
    -------
    dict
        Plain values, ready for JSON: ``name``, ``version``, ``format``, ``place`` (crs, origin,
        bounds, size), ``counts``, ``segments`` (distribution of ``faces``, ``bytes``, ``extent_m``,
        ``bytes_per_face``), ``regions`` (the largest, and how many have labels), ``cover``,
        ``hand_off``, ``attributes``, ``files``, ``encodings``, ``limits``, ``build``,
        ``inputs`` and ``left_out`` (the survey's files, from ``build.json``; empty where that is
        not there), ``extent`` (what lies outside the one that was asked for; None for a whole
        survey) and ``versions_on_disk``.

    Raises
    ------
    SceneNotFoundError, DamagedSceneError
        When there is no scene, or its manifest, index or cover cannot be read.
    """
    folder = None if isinstance(location, str) and is_url(location) else Path(location)
    with Scene.open(location) as scene:
        manifest, index = scene.manifest, scene.index
        faces = index.face_count.astype(np.int64)
        lengths = index.length.astype(np.int64)
        sides = (index.bounds[:, 3:] - index.bounds[:, :3]).max(axis=1)
        offsets = scene.cover.offsets.astype(np.int64)
        over = offsets[1:] - offsets[:-1]
        record = {} if folder is None else read_build_record(folder)
        return {
            "name": manifest.name,
            "version": manifest.version,
            "format": f"{manifest.format} {manifest.format_version}",
            "place": _extent(manifest),
            "counts": manifest.counts.model_dump(),
            "colour": asdict(SceneColour.of(manifest)),
            "segments": {
                "faces": _spread(faces),
                "bytes": _spread(lengths),
                "extent_m": _spread(sides),
                "bytes_per_face": round(float(lengths.sum() / faces.sum()), 3),
            },
            "regions": _regions(scene),
            "cover": {
                "entries": int(over.sum()),
                "base_faces_never_hidden": int((over == 0).sum()),
                "segments_per_base_face": _spread(over),
            },
            "hand_off": manifest.hand_off.model_dump(),
            "attributes": [one.model_dump() for one in manifest.attributes],
            "encodings": {key: one.model_dump() for key, one in manifest.encodings.items()},
            "files": {key: info.bytes for key, info in manifest.files.items()},
            "bytes": sum(info.bytes for info in manifest.files.values()),
            "limits": manifest.limits.model_dump(),
            "build": manifest.build.model_dump(mode="json"),
            "inputs": record.get("inputs", []),
            "left_out": record.get("left_out", []),
            "extent": record.get("extent"),
            "versions_on_disk": [manifest.folder]
            if folder is None
            else sorted(path.name for path in folder.glob("v-*")),
        }


def _regions(scene: Scene) -> dict[str, Any]:
    """Names and facts of the largest regions; ``problem`` says why where they cannot be read."""
    try:
        names = RegionNames.of(scene.regions, file=scene.manifest.files["regions.json"].path)
        names = names.with_labels(read_labels(scene.files))
        rows = region_rows(names, scene.regions, scene.manifest.origin)
    except DamagedSceneError as error:
        return {"labelled": 0, "largest": [], "problem": str(error)}
    return {
        "labelled": sum(bool(row["label"]) for row in rows),
        "largest": rows[:MAX_REGIONS],
        "problem": None,
    }


def _extent(manifest: Manifest) -> dict[str, Any]:
    low, high = np.array(manifest.bounds.min), np.array(manifest.bounds.max)
    east, north, height = manifest.origin
    size = high - low
    return {
        "crs": manifest.crs.model_dump(exclude={"wkt"}) if manifest.crs else None,
        "origin": list(manifest.origin),
        "survey_units": manifest.survey_units and manifest.survey_units.model_dump(),
        "size_m": {
            "east_west": round(float(size[0]), 3),
            "north_south": round(float(size[2]), 3),
            "height": round(float(size[1]), 3),
        },
        "bounds_scene_m": {"min": list(manifest.bounds.min), "max": list(manifest.bounds.max)},
        # z runs south: the greatest z is the least northing.
        "bounds_crs": {
            "east": [east + low[0], east + high[0]],
            "north": [north - high[2], north - low[2]],
            "height": [height + low[1], height + high[1]],
        },
        "grid_step_m": manifest.step_m,
    }


def _spread(values: npt.NDArray[np.number] | Int64) -> dict[str, float]:
    whole = np.issubdtype(values.dtype, np.integer)
    percentiles = np.percentile(values, [share for _, share in PERCENTILES])
    spread = {
        name: float(value) if not whole else round(float(value))
        for (name, _), value in zip(PERCENTILES, percentiles, strict=True)
    }
    return {**spread, "mean": round(float(np.mean(values)), 3)}
