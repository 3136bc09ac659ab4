"""A synthetic quarry on disk: a LAZ survey and, apart from it, the truth.

The survey is LAS 1.4, point format 7 (RGB, GPS time left 0), with the extra dimension ``grade``
(float32, percent), coordinates in steps of 1 mm and the CRS as WKT. The truth is an uncompressed
``.npz``:

=================  ==========  ====================================================================
``material``       (N,) u1     label per point, see ``material_names``
``material_names`` (M,) str    ``"<label> <name>"``
``truth_m``        (N, 3) f4   the place on the surface before noise, metres about ``origin``
``origin``         (3,) f8     easting, northing, height
``parameters``     () str      the options as JSON: they make the surface again
=================  ==========  ====================================================================

Both are written beside their final names and renamed when whole: there is never a torso.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import laspy
import numpy as np
from pyproj import CRS

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import POINT_STEP_M, QuarryChunk, QuarryMaker

__all__ = ["WrittenQuarry", "load_options", "truth_path", "write_quarry"]

_BYTES_PER_POINT: Final = 26
"""LAZ 10.2 (measured, 1 M points, 15 mm noise) and truth 13, with a little room."""

_FILE_DATE: Final = dt.date(2026, 1, 1)
"""Stands in every header: the real date would make equal options give different bytes."""


@dataclass(frozen=True, slots=True)
class WrittenQuarry:
    """Files of a synthetic survey and its truth, with sizes, counts and bounds."""

    survey_path: Path
    truth_path: Path
    survey_bytes: int
    truth_bytes: int
    points: int
    material_points: dict[str, int]
    """Points by material name, materials that occur only."""
    bounds_m: tuple[float, float, float, float, float, float]
    """West, south, lowest, east, north, highest: CRS frame, outliers left out."""


def truth_path(survey: Path) -> Path:
    """Return where the truth of a survey lies: ``quarry.laz`` -> ``quarry.truth.npz``."""
    return survey.with_name(survey.stem + ".truth.npz")


def load_options(truth: Path) -> QuarryOptions:
    """Read the options back from a truth file."""
    with np.load(truth) as arrays:
        return QuarryOptions(**json.loads(str(arrays["parameters"])))


def write_quarry(
    options: QuarryOptions,
    path: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> WrittenQuarry:
    """Make a quarry and write survey and truth, chunk by chunk.

    Needs about 300 MB and 13 bytes per point of memory.

    Parameters
    ----------
    options : QuarryOptions
        What to make; equal options give equal bytes.
    path : pathlib.Path
        The survey; its suffix says how: ``.laz`` or ``.las``.
    overwrite : bool
        Replace files that are there.
    progress : Progress, optional
        Told about points written.

    Raises
    ------
    OptionError
        When the suffix is neither, the folder is missing, or a file is there and `overwrite` is
        not set.
    ResourceError
        When the disk has too little room, before or while writing.
    """
    # (1) Refuse before anything is made.
    truth_file = truth_path(path)
    _validate_target(options, path, truth_file, overwrite=overwrite)
    report = progress or NullProgress()
    maker = QuarryMaker(options)
    material = np.empty(options.points, dtype=np.uint8)
    truth = np.empty((options.points, 3), dtype=np.float32)
    # (2) Chunk by chunk into drafts. Invariant: the first `start` points are in the file, and
    # their material and truth in the arrays. Both files get their names when both are whole.
    with _renamed_when_whole(path, truth_file) as (draft, truth_part):
        report.start("synth: points", options.points, "points")
        start = 0
        header = _make_header(options, maker)
        with laspy.open(
            draft,
            mode="w",
            header=header,
            do_compress=path.suffix.lower() == ".laz",
            laz_backend=laspy.LazBackend.Lazrs,
        ) as writer:
            for chunk in maker.chunks():
                writer.write_points(_make_record(chunk, header))
                rows = slice(start, start + len(chunk.ticks))
                material[rows], truth[rows] = chunk.material, chunk.truth
                start = rows.stop
                report.advance(len(chunk.ticks))
        report.done({"points": options.points})
        _write_truth(truth_part, options, maker, material, truth)
    # (3) What was written.
    counts = np.bincount(material, minlength=256)
    low, high = truth.min(axis=0) + maker.origin, truth.max(axis=0) + maker.origin
    west, south, lowest = map(float, low)
    east, north, highest = map(float, high)
    return WrittenQuarry(
        path,
        truth_file,
        path.stat().st_size,
        truth_file.stat().st_size,
        options.points,
        {kind.name.lower(): int(counts[kind]) for kind in Material if counts[kind]},
        (west, south, lowest, east, north, highest),
    )


def _validate_target(
    options: QuarryOptions, path: Path, truth_file: Path, *, overwrite: bool
) -> None:
    if path.suffix.lower() not in (".laz", ".las"):
        raise OptionError(f"{path}: expected a name that ends in .laz or .las; choose one")
    if not path.parent.is_dir():
        raise OptionError(f"{path.parent}: no such folder; make it or choose another")
    for file in (path, truth_file):
        if file.exists() and not overwrite:
            raise OptionError(f"{file}: exists already; choose another name or overwrite (--force)")
    need = options.points * _BYTES_PER_POINT
    if path.suffix.lower() == ".las":
        need += options.points * 24
    free = shutil.disk_usage(path.parent).free
    if free < need:
        raise ResourceError(
            f"{path.parent}: {free / 1e6:,.0f} MB free, about {need / 1e6:,.0f} MB needed for "
            f"{options.points:,} points; free some room or take fewer points"
        )


@contextlib.contextmanager
def _renamed_when_whole(*targets: Path) -> Iterator[tuple[Path, ...]]:
    """Give names to write to; rename them on success, delete them on any failure."""
    token = secrets.token_hex(4)
    drafts = tuple(
        target.with_name(f".{target.stem}.{token}.part{target.suffix}") for target in targets
    )
    try:
        yield drafts
        for draft, target in zip(drafts, targets, strict=True):
            draft.replace(target)
    except (OSError, laspy.LaspyException) as error:
        raise ResourceError(
            f"{targets[0]}: cannot be written: {error}; nothing was left behind, check the disk "
            "and try again"
        ) from error
    finally:
        for draft in drafts:
            draft.unlink(missing_ok=True)


def _make_header(options: QuarryOptions, maker: QuarryMaker) -> Any:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = np.full(3, POINT_STEP_M)
    header.offsets = maker.origin
    header.creation_date = _FILE_DATE
    header.system_identifier = "procedural quarry"
    header.generating_software = "terraport synth"
    header.add_extra_dim(
        laspy.ExtraBytesParams("grade", np.float32, description="synthetic ore grade, %")
    )
    header.add_crs(CRS.from_epsg(options.epsg))
    return header


def _make_record(chunk: QuarryChunk, header: Any) -> Any:
    record = laspy.ScaleAwarePointRecord.zeros(len(chunk.ticks), header=header)
    record["X"], record["Y"], record["Z"] = chunk.ticks.T
    # 257 maps 255 to 65535: the standard asks for the full 16-bit range.
    wide = chunk.colours.astype(np.uint16) * 257
    record["red"], record["green"], record["blue"] = wide.T
    record["return_number"] = np.ones(len(wide), dtype=np.uint8)
    record["number_of_returns"] = np.ones(len(wide), dtype=np.uint8)
    record["grade"] = chunk.grade
    return record


def _write_truth(
    path: Path, options: QuarryOptions, maker: QuarryMaker, material: UInt8, truth: Float32
) -> None:
    names = np.array([f"{int(kind)} {kind.name.lower()}" for kind in Material])
    with path.open("wb") as file:
        np.savez(
            file,
            material=material,
            material_names=names,
            truth_m=truth,
            origin=maker.origin,
            parameters=np.array(json.dumps(options.to_dict(), sort_keys=True)),
        )
        file.flush()
        os.fsync(file.fileno())
