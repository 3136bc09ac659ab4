"""Small LAS files of a slope whose coordinates are stated in odd ways, with their true place."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr

from terraport_payload.types import Float64
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import SurveyUnits

US_FOOT = 1200 / 3937
FOOT = 0.3048
PROJECTED = {1024: 1, 1025: 1}

Keys = dict[int, int | float | str]


def slope(east: float, north: float, height: float) -> Float64:
    """Make a slope of 30 x 20 m that rises 1 m to the east and 4 m to the north, metres."""
    u, v = np.meshgrid(np.linspace(0, 30, 31), np.linspace(0, 20, 21))
    places = np.stack([u.ravel(), v.ravel(), (u / 30 + v / 5).ravel()], axis=1)
    return places + np.array([east, north, height])


def key_records(keys: Keys) -> list[laspy.VLR]:
    """Write GeoTIFF keys: whole numbers in the directory, texts and reals beside it."""
    rows, texts, reals = [], b"", []
    for key, value in sorted(keys.items()):
        if isinstance(value, str):
            data = value.encode() + b"|"
            rows.append((key, 34737, len(data), len(texts)))
            texts += data
        elif isinstance(value, float):
            rows.append((key, 34736, 1, len(reals)))
            reals.append(value)
        else:
            rows.append((key, 0, 1, value))
    directory = struct.pack("<4H", 1, 1, 0, len(rows))
    directory += b"".join(struct.pack("<4H", *row) for row in rows)
    records = [laspy.VLR("LASF_Projection", 34735, "", directory)]
    if reals:
        packed = struct.pack(f"<{len(reals)}d", *reals)
        records.append(laspy.VLR("LASF_Projection", 34736, "", packed))
    if texts:
        records.append(laspy.VLR("LASF_Projection", 34737, "", texts + b"\0"))
    return records


def write_las(
    path: Path,
    points: Float64,
    keys: Keys | None = None,
    wkt: str | None = None,
    *,
    wkt_bit: bool = True,
) -> Path:
    """Write points as they are, and what is stated of them."""
    is_new = wkt is not None
    header = laspy.LasHeader(point_format=7 if is_new else 3, version="1.4" if is_new else "1.2")
    header.scales, header.offsets = np.full(3, 0.0001), np.floor(points.min(axis=0))
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.red = data.green = data.blue = np.arange(len(points), dtype=np.uint16) * 90
    if keys is not None:
        data.header.vlrs.extend(key_records(keys))
    if wkt is not None:
        data.header.vlrs.append(WktCoordinateSystemVlr(wkt))
        data.header.global_encoding.wkt = wkt_bit
    data.write(path)
    return path


class Read:
    """A survey as a build reads it."""

    def __init__(self, paths: Path | Sequence[Path], folder: Path, **stated: Any) -> None:
        survey = find_survey(
            [paths] if isinstance(paths, Path) else paths, statement=SurveyStatement(**stated)
        )
        survey, _ = survey.heads(NullProgress())
        folder.mkdir()
        context = Context(folder, NullProgress(), 1, result_folder=folder)
        values, facts = read_streamed.run(survey, folder, context)
        self.points: Float64 = np.load(folder / "points.npy")
        self.crs: dict[str, Any] | None = values["crs"]
        units = values.get("units")
        self.units = None if units is None else SurveyUnits(**units)
        self.warnings = facts.warnings
        self.choices = facts.choices

    def is_at(self, true: Float64) -> bool:
        """Whether these are the true places, whatever their order, within a millimetre."""
        return same_places(self.points, true)


def same_places(one: Float64, other: Float64, tolerance: float = 1e-3) -> bool:
    """Whether two clouds are the same, whatever their order."""
    ordered = [
        np.array(sorted(map(tuple, np.round(points - other.min(axis=0), 2).tolist())))
        for points in (one, other)
    ]
    return (
        ordered[0].shape == ordered[1].shape
        and bool(np.abs(ordered[0] - ordered[1]).max() <= 0.011)
        and bool(np.abs(np.sort(one, axis=0) - np.sort(other, axis=0)).max() <= tolerance)
    )
