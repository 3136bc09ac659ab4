"""A bounded look at the points of a survey: what ``inspect`` says beyond the files' headers.

Up to :data:`MAX_POINTS` points are read, by the reader of the build, so that units, columns and
colours are what a build makes of them. Of a larger survey they are whole pieces of its files,
spread over them. The survey's measures, and the plan of its tiles, come from the functions that a
build calls; what they say of a sample is brought to the whole survey by its ground:

- Pieces of a file may lie close (scans, tiles), as dense as the whole, or anywhere, so much thinner
  as little was read. Which of the two is seen by reading a quarter of it, too: where pieces lie
  close that covers a quarter of the ground, where points come in any order all of it. The exponent
  between them says which share of the points at a place is in the sample.
- Spacing is that of the sample times the root of that share, surface and ground follow from it.

Memory: one part of a file, 24 bytes a point for copies, and the thinned copy (75 MB). Disk: the
sample twice, in a folder that goes again.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Float64, Int64
from terraport_pipeline.engines.readers.file_sample import text_share
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.raw_survey import thinning_rows
from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.geometry.clouds.density_map import (
    DensityMap,
    Gap,
    count_samples,
    find_gaps,
)
from terraport_pipeline.geometry.clouds.detail_cell import choose_cell, smoothing_radius_m
from terraport_pipeline.geometry.clouds.normals import estimate_normals
from terraport_pipeline.geometry.clouds.outliers import duplicate_mask
from terraport_pipeline.geometry.clouds.spacing import nearest_neighbours
from terraport_pipeline.geometry.tiles.fill_blocks import fill_blocks
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan
from terraport_pipeline.model import Survey
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.stages import clean, measure_survey, partition, read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.survey_files import FAR, SurveyFiles
from terraport_pipeline.workflow.build_forecast import VOXEL_CELLS, SolvedGround
from terraport_pipeline.workflow.tile_ground import choose_tiles, lattice_of

__all__ = ["MAX_POINTS", "Colours", "Column", "SurveySample", "choose_files", "sample_survey"]

MAX_POINTS: Final = 5_000_000
"""Points that are read, about: some 15 seconds with all that is measured on them."""

MAX_FILES: Final = 100
"""Files that points are read of: of each at least a chunk, of 50,000 points as a rule."""

_THINNED_POINTS: Final = 150_000
"""Of these the windows' middles and normals are taken: a second to clean, by the build's stage."""

_PATCHES: Final = 64
_PATCH_POINTS: Final = 2000
"""Patches that normals are taken of, in the density of the sample."""

_PLANE_POINTS: Final = 10
_MOST_PLANE_POINTS: Final = 128
"""Neighbours of a plane: as wide as a cell or two, or as the smoothing of noisy samples."""

_PATCH_REACH: Final = 2.0

_MORE: Final = 4
"""What is read to tell how close pieces lie: so many times more of some files than..."""

_MORE_AT_LEAST: Final = 1.5
"""...and where it comes to less than that (files of one chunk) it tells nothing."""

_FULL_CELL_POINTS: Final = 16.0
"""Points in a cell of the raster that ground is measured by, were they spread over the whole box:
then no cell of any ground is empty by chance."""

_BLOCK_ROWS: Final = 1_000_000

_MAP_CELLS: Final = 512
"""Cells along the longer side of the density map, at most..."""

_MAP_SPACINGS: Final = 4.0
"""...and the side of one at least: 16 samples, so that shades mean something."""

_GAP_CELLS: Final = 4
"""A gap has so many of them at least."""

_MOST_CODES: Final = 32
"""Whole numbers with at most so many values are counted value by value."""

_MOST_BLOCKS: Final = 60_000
"""Columns of blocks in a plan; wider blocks beyond it, or the choice of tiles takes a minute."""

_VOXEL_SPAN: Final = 1 << 21
"""Voxels along an axis that a key tells apart."""

_STATED_BOX: Final = 0.9
"""Share of the files that state their box from which on the boxes say where ground may be."""


@dataclass(frozen=True, slots=True)
class Column:
    """An attribute, by the points that were read."""

    name: str
    type: str
    low: float | None
    """Least value; None where all are missing."""
    high: float | None
    missing: int
    """Points without a value."""
    values: dict[str, int] | None
    """Points by value, of codes."""


@dataclass(frozen=True, slots=True)
class Colours:
    """Colours, by the points that were read."""

    depths: tuple[str, ...]
    """As the files hold them: ``unit`` (0..1), ``eight`` or ``sixteen`` bits."""
    distinct: int
    """Different colours, as 8 bits each of red, green and blue."""
    black: int
    """Points that are black: without colour, as a rule."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveySample:
    """What was read and measured of a survey; metres, and what is counted is of the sample."""

    read: int
    """Points that were read, repeats among them."""
    points: int
    """Of the whole survey: by the headers, or for text by what was read."""
    whole: bool
    """Every point was read."""
    files: int
    warnings: tuple[str, ...]
    """What a build would say of reading and cleaning."""
    units_m: tuple[float, float]
    """Metres in a unit of the survey's eastings and northings, and of its heights."""
    low: Float64
    high: Float64
    """(3,) corners of the sample's box, CRS frame."""
    measured: Mapping[str, Any]
    """As :mod:`measure_survey` gives, of the whole survey."""
    ground_m2: float
    """Of the whole survey, seen from above."""
    surface_m2: float
    density: DensityMap
    """Samples per cell; :attr:`local_share` of those that lie there in the whole survey."""
    local_share: float
    gaps: tuple[Gap, ...]
    repeats: int
    """Records that another one equals in every value."""
    copies: int
    """Further points at the place of another, with other values."""
    outliers: float
    """Share of the thinned copy that cleaning takes for outliers."""
    colours: Colours | None
    attributes: tuple[Column, ...]
    ground: SolvedGround
    """What a build would solve."""
    cell_warnings: tuple[str, ...]


def sample_survey(
    survey: SurveyFiles,
    heads: Sequence[FileHead],
    *,
    max_memory_bytes: int,
    max_points: int = MAX_POINTS,
    threads: int = 1,
    progress: Progress | None = None,
) -> SurveySample:
    """Read and measure a bounded part of a survey.

    Parameters
    ----------
    survey : SurveyFiles
        Without damaged files.
    heads : sequence of FileHead
        Of its files.
    max_memory_bytes : int
        That a build may take: tiles are chosen by it.
    max_points : int
        Points that are read, about.
    threads : int
    progress : Progress, optional

    Raises
    ------
    ReadError, SurveyError
        What would end a build, too: degrees, too few points, no relief, a damaged file.
    """
    progress = progress or NullProgress()
    expected = _expected_points(survey, heads)
    chosen, share = choose_files(survey, heads, max_points)
    with tempfile.TemporaryDirectory(prefix="terraport-inspect-") as scratch:
        # (1) Points as the build reads them, and of a sample a quarter again.
        folder = Path(scratch)
        context = Context(folder, progress, threads, result_folder=folder)
        values, facts = read_streamed.run(chosen, folder, context, share=share, bounded=share < 1.0)
        points = NpyReader(folder / "points.npy")
        read = sum(file["points"] - file["outside"] for file in facts.notes["files"])
        repeats = sum(file["repeats"] for file in facts.notes["files"])
        if share < 1.0:
            read = len(points) + repeats
            expected = _by_lines(survey, chosen, share, read, expected)
        count = read if share >= 1.0 else max(expected, read)
        low, high = np.array(facts.counts["low"]), np.array(facts.counts["high"])
        horizontal_m, vertical_m = values.get("units_m", (1.0, 1.0))
        box = _Boxes.of(survey, heads, low, high, float(horizontal_m))
        local_share = 1.0
        if share < 1.0:
            local_share = _local_share(
                chosen, share, len(points) / count / _chosen_part(chosen, survey, heads),
                box, context,
            )  # fmt: skip
        # (2) Spacing, noise and normals: the build's measures, of the whole sample.
        cleaned = clean.run(_thinned(points, values), clean.Options(), context)
        measured = dict(
            measure_survey.run(
                points.path, cleaned.cloud, clean.Options().normal_neighbours, context
            ).values
        )
        slant = _slant(points, low, measured, threads)
        # (3) From the sample to the survey.
        for name in ("spacing_m", "surface_spacing_m"):
            measured[name] *= math.sqrt(local_share)
        once = round(count * len(points) / max(1, read))  # a build takes repeats once
        surface_m2 = once * measured["surface_spacing_m"] ** 2
        # (4) The map, and what is missing in it.
        density = _map(points, low, high, measured["surface_spacing_m"] / math.sqrt(local_share))
        if share >= 1.0:
            ground_m2 = density.area_m2
        else:
            upright = float(np.abs(cleaned.cloud.normals[:, 1].astype(np.float64)).mean())
            ground_m2 = min(upright * surface_m2, box.area_m2)
        gaps = find_gaps(density, _GAP_CELLS) if share >= 1.0 else []
        # (5) Values, and what a build would solve.
        copies = int(duplicate_mask(points.read(0, len(points))).sum())
        ground, cell_warnings = _solved_ground(
            folder, measured, cleaned.cloud.origin, box, once, surface_m2,
            ground_m2, slant, max_memory_bytes, context,
            is_sample=share < 1.0,
        )  # fmt: skip
        return SurveySample(
            read=read,
            points=count,
            whole=share >= 1.0,
            files=len(chosen.files),
            warnings=(*facts.warnings, *cleaned.facts.warnings),
            units_m=(float(horizontal_m), float(vertical_m)),
            low=low,
            high=high,
            measured=measured,
            ground_m2=ground_m2,
            surface_m2=surface_m2,
            density=density,
            local_share=local_share,
            gaps=tuple(gaps),
            repeats=repeats,
            copies=copies,
            outliers=cleaned.facts.counts["outliers"] / max(1, len(cleaned.cloud.points)),
            colours=_colours(folder, facts.notes["colours"]),
            attributes=tuple(
                _column(name, NpyReader(folder / f"attribute-{number}.npy"))
                for number, name in enumerate(values["attributes"])
            ),
            ground=ground,
            cell_warnings=tuple(cell_warnings),
        )


def _expected_points(survey: SurveyFiles, heads: Sequence[FileHead]) -> int:
    return max(1, survey_size(heads, survey.extent).points)


def choose_files(
    survey: SurveyFiles, heads: Sequence[FileHead], max_points: int = MAX_POINTS
) -> tuple[SurveyFiles, float]:
    """Choose the files to read points of, spread over all, and which share of each.

    Returns
    -------
    survey : SurveyFiles
        :data:`MAX_FILES` files at most; all where all points are read.
    share : float
        1 where the survey has no more points than `max_points`.
    """
    rows = [head.points if head.rows is None else head.rows for head in heads]
    if sum(rows) <= max_points:
        return survey, 1.0
    files = survey.files
    step = max(1.0, len(files) / MAX_FILES)
    numbers = sorted({int((i + 0.5) * step) for i in range(min(len(files), MAX_FILES))})
    chosen = replace(survey, files=tuple(files[number] for number in numbers))
    return chosen, min(1.0 - 1e-9, max_points / max(1, sum(rows[number] for number in numbers)))


def _by_lines(
    survey: SurveyFiles,
    chosen: SurveyFiles,
    share: float,
    read: int,
    expected: int,
) -> int:
    """Points of a survey of text by how many lines of it were read; others say it themselves."""
    if any(file.format != "xyz" for file in survey.files):
        return expected
    taken = sum(file.bytes * text_share(file.bytes, share) for file in chosen.files)
    return round(read * survey.size_bytes / max(1.0, taken))


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Where ground may be, CRS frame, metres: the boxes of the files, or the sample's."""

    boxes: Float64
    """(N, 4) west, south, east, north."""

    @classmethod
    def of(
        cls,
        survey: SurveyFiles,
        heads: Sequence[FileHead],
        low: Float64,
        high: Float64,
        unit_m: float,
    ) -> _Boxes:
        """Take the boxes that headers state, cut to the extent; else the sample's own.

        So too where a header's box holds a stray point: then it is as wide as a country.
        """
        stated = [(h.low, h.high) for h in heads if h.low is not None and h.high is not None]
        if len(stated) < _STATED_BOX * len(heads):
            return cls(np.array([[low[0], low[1], high[0], high[1]]]))
        if survey.extent is not None:
            stated = [survey.extent.clipped(*corners) for corners in stated]
        corners = np.array(stated, np.float64)[:, :, :2] * unit_m
        if float(np.ptp(corners, axis=(0, 1)).max()) >= FAR:
            return cls(np.array([[low[0], low[1], high[0], high[1]]]))
        return cls(corners.reshape(-1, 4))

    @property
    def area_m2(self) -> float:
        """Of all, at most that of the box around them: tiles may overlap."""
        west, south, east, north = self.boxes.T
        each = float(((east - west) * (north - south)).sum())
        whole = float((east.max() - west.min()) * (north.max() - south.min()))
        return max(min(each, whole), 1e-6)

    @property
    def corners(self) -> tuple[Float64, Float64]:
        """South-west and north-east corner of the box around all."""
        return self.boxes[:, :2].min(axis=0), self.boxes[:, 2:].max(axis=0)

    def columns(self, lattice: Lattice, origin: Float64, block_cells: int) -> Int64:
        """Columns (x, z) of blocks of a lattice that touch a box, each once."""
        wide_m = block_cells * lattice.cell_m
        keys = []
        for west, south, east, north in self.boxes:
            x = (np.array([west, east]) - origin[0] - lattice.anchor_m[0]) / wide_m
            z = (np.array([-north, -south]) + origin[1] - lattice.anchor_m[2]) / wide_m
            columns = np.arange(math.floor(x[0]), math.ceil(x[1]) + 1)
            rows = np.arange(math.floor(z[0]), math.ceil(z[1]) + 1)
            keys.append(np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
        return np.unique(np.concatenate(keys), axis=0).astype(np.int64)


def _chosen_part(chosen: SurveyFiles, survey: SurveyFiles, heads: Sequence[FileHead]) -> float:
    """Part of a survey's points that the chosen files hold."""
    paths = {file.path for file in chosen.files}
    held = [
        head.points for file, head in zip(survey.files, heads, strict=True) if file.path in paths
    ]
    return sum(held) / max(1, sum(head.points for head in heads))


def _local_share(
    chosen: SurveyFiles,
    share: float,
    in_files: float,
    box: _Boxes,
    context: Context,
) -> float:
    """Which share of the points at a place are in the sample, by reading more and less of it.

    Parameters
    ----------
    chosen, share
        The files that the sample is of, and how much was read of each.
    in_files : float
        Share of the chosen files' points that is in it; other files lie elsewhere.
    box : _Boxes
        Where the survey may have ground.
    context : Context
    """
    # (1) Of many files some are looked at closer: there may be one piece of each in the sample.
    step = _MORE**2 if len(chosen.files) >= _MORE**2 else 1
    some = replace(chosen, files=chosen.files[step // 2 :: step])
    more = min(1.0, _MORE * share) if step > 1 else share
    # (2) How their ground grows with what is read of them.
    area_m2 = box.area_m2 * len(some.files) / len(chosen.files)
    west_south, east_north = box.corners
    points, covered_m2 = [], []
    cell_m = 0.0
    for part in (more / _MORE, more):  # the less first: the cells are wide enough for it
        with tempfile.TemporaryDirectory(prefix="part-", dir=context.folder) as scratch:
            folder = Path(scratch)
            inner = replace(context, scratch=folder, result_folder=folder)
            read_streamed.run(some, folder, inner, share=part)
            reader = NpyReader(folder / "points.npy")
            cell_m = cell_m or math.sqrt(_FULL_CELL_POINTS * area_m2 / max(len(reader), 1))
            points.append(len(reader))
            ground = count_samples(_blocks(reader), west_south, east_north, cell_m)
            covered_m2.append(max(ground.effective_m2, cell_m**2))
    less, all_of_them = (max(count, 1) for count in points)
    in_files = min(1.0, in_files)
    if all_of_them < _MORE_AT_LEAST * less:
        return in_files
    exponent = math.log(covered_m2[1] / covered_m2[0]) / math.log(all_of_them / less)
    return float(in_files ** (1.0 - min(max(exponent, 0.0), 1.0)))


def _blocks(points: NpyReader) -> Iterator[Float64]:
    for _, block in points.blocks(_BLOCK_ROWS):
        yield block


def _thinned(points: NpyReader, values: Mapping[str, Any]) -> Survey:
    """Take every n-th point or so; no columns, which cleaning does not change."""
    rows = thinning_rows(len(points), _THINNED_POINTS)
    some = [
        block if rows is None else block[_within(rows, first, len(block))]
        for first, block in points.blocks(_BLOCK_ROWS)
    ]
    return Survey(np.concatenate(some), None, {}, None, values["format"])


def _within(rows: Int64, first: int, count: int) -> Int64:
    begin, end = np.searchsorted(rows, (first, first + count))
    return rows[begin:end] - first


def _slant(points: NpyReader, low: Float64, measured: Mapping[str, Any], threads: int) -> float:
    """Mean of |nx| + |ny| + |nz|, of planes as wide as what a build smooths over.

    Points lie along a curve through the box: a run of them is a patch in the density of the sample.
    """
    radius = smoothing_radius_m(measured["surface_spacing_m"], measured["noise_m"])
    wide = math.pi * (radius / measured["surface_spacing_m"]) ** 2
    k = int(min(max(_PLANE_POINTS, wide), _MOST_PLANE_POINTS))
    rows = min(_PATCH_POINTS, len(points))
    sums = []
    for first in np.linspace(0, len(points) - rows, _PATCHES).astype(np.int64).tolist():
        patch = (points.read(first, first + rows) - low).astype(np.float32)
        neighbours = nearest_neighbours(patch, k, workers=threads)
        normals, _ = estimate_normals(patch, neighbours, k=k, threads=threads)
        # Where the curve leaves a patch and comes back, neighbours are far: no planes.
        far = neighbours.distances[:, -1]
        good = far <= _PATCH_REACH * np.median(far)
        sums.append(np.abs(normals[good].astype(np.float64)).sum(axis=1))
    return float(np.concatenate(sums).mean())


def _map(points: NpyReader, low: Float64, high: Float64, spacing_m: float) -> DensityMap:
    """Draw the map in cells of several spacings of the sample, not too many."""
    side_m = float((high - low)[:2].max())
    cell_m = max(_MAP_SPACINGS * spacing_m, side_m / _MAP_CELLS, 1e-6)
    return count_samples(_blocks(points), low, high, cell_m)


def _solved_ground(
    folder: Path,
    measured: Mapping[str, Any],
    origin: Float64,
    box: _Boxes,
    points: int,
    surface_m2: float,
    ground_m2: float,
    slant: float,
    max_memory_bytes: int,
    context: Context,
    *,
    is_sample: bool,
) -> tuple[SolvedGround, list[str]]:
    """Plan the tiles as a build does, over all ground that the survey must have."""
    spacing_m, noise_m = measured["surface_spacing_m"], measured["noise_m"]
    cell_m, warnings = choose_cell(None, 0.0, spacing_m, noise_m)
    lattice = lattice_of(measured, cell_m)
    block_cells = partition.BLOCK_CELLS
    while ground_m2 / (block_cells * cell_m) ** 2 > _MOST_BLOCKS:
        block_cells *= 2
    blocks, counts = partition.count_blocks(folder, lattice, origin, block_cells, context)
    if is_sample:
        columns = math.ceil(ground_m2 / (block_cells * cell_m) ** 2)
        ground = box.columns(lattice, origin, block_cells)
        blocks, counts = fill_blocks(blocks, ground, columns, points)
    plan: TilePlan = choose_tiles(
        lattice, blocks, counts, points=points, surface_spacing_m=spacing_m,
        max_memory_bytes=max_memory_bytes, block_cells=block_cells,
    )  # fmt: skip
    radius_m = smoothing_radius_m(spacing_m, noise_m)
    voxel_m = VOXEL_CELLS * cell_m
    voxels = None if is_sample else _voxels(NpyReader(folder / "points.npy"), origin, voxel_m)
    others = [NpyReader(path) for path in folder.glob("*.npy") if path.name != "points.npy"]
    solved = SolvedGround(
        points=points,
        surface_m2=surface_m2,
        cell_m=cell_m,
        slant=slant,
        voxels=voxels,
        voxel_m=voxel_m,
        noise_m=noise_m,
        smoothing_spacings=radius_m / spacing_m,
        plan=plan,
        row_bytes=24 + sum(c.dtype.itemsize * math.prod(c.shape[1:]) for c in others),
        attributes=len(list(folder.glob("attribute-*.npy"))),
    )
    return solved, warnings


def _voxels(points: NpyReader, origin: Float64, voxel_m: float) -> int:
    """Count occupied voxels, block by block: along the curve two blocks hardly share one."""
    count = 0
    for _, block in points.blocks(_BLOCK_ROWS):
        cells = np.floor((block - origin) / voxel_m).astype(np.int64) + _VOXEL_SPAN // 2
        keys = (cells[:, 0] * _VOXEL_SPAN + cells[:, 1]) * _VOXEL_SPAN + cells[:, 2]
        count += len(np.unique(keys))
    return count


def _colours(folder: Path, depths: Sequence[str]) -> Colours | None:
    path = folder / "colours.npy"
    if not path.exists():
        return None
    distinct: AnyArray = np.zeros(0, np.uint32)
    black = 0
    for _, block in NpyReader(path).blocks(_BLOCK_ROWS):
        packed = block.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        black += int((packed == 0).sum())
        distinct = np.union1d(distinct, packed)
    return Colours(tuple(depths), len(distinct), black)


def _column(name: str, reader: NpyReader) -> Column:
    low, high, missing = np.inf, -np.inf, 0
    is_float = reader.dtype.kind == "f"
    codes: dict[Any, int] | None = {}
    for _, block in reader.blocks(_BLOCK_ROWS):
        good = block[np.isfinite(block)] if is_float else block
        missing += len(block) - len(good)
        if len(good):
            low, high = min(low, float(good.min())), max(high, float(good.max()))
        if codes is not None:
            values, counts = np.unique(good, return_counts=True)
            if is_float and (values != np.rint(values)).any():
                codes = None
                continue
            for value, count in zip(
                values[: _MOST_CODES + 1].tolist(), counts.tolist(), strict=False
            ):
                codes[value] = codes.get(value, 0) + count
            if len(codes) > _MOST_CODES:
                codes = None
    has_values = low <= high
    return Column(
        name,
        reader.dtype.name,
        low if has_values else None,
        high if has_values else None,
        missing,
        None if codes is None else {f"{key:g}": codes[key] for key in sorted(codes)},
    )
