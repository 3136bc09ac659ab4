"""Write one export of a scene: check what is asked for, then let the product's writer do it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import survey_frame
from terraport_pipeline.export.meshes import mesh_companions, write_mesh
from terraport_pipeline.export.output import writing_beside
from terraport_pipeline.export.products import Product, product_of
from terraport_pipeline.export.raster_grid import PixelGrid, make_grid
from terraport_pipeline.export.section import parse_line, write_section
from terraport_pipeline.export.selection import (
    SelectedScene,
    Selection,
    find_regions,
    ground_extent,
)
from terraport_pipeline.export.vector_file import SHAPEFILE_COMPANIONS
from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import NullProgress, Progress
from terraport_store import Scene

__all__ = ["ExportRequest", "Exported", "export_scene"]

_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
"""First digits of a step that nobody chose."""


@dataclass(frozen=True, slots=True)
class ExportRequest:
    """What is asked for."""

    output: Path
    product: Product | None = None
    extent: Extent | None = None
    """In the survey's coordinates and unit."""
    regions: tuple[str, ...] = ()
    """Labels or stable ids."""
    step_m: float | None = None
    """Metres; None: about the distance of the detail's vertices."""
    interval: float | None = None
    """Between contours, in the unit of the survey's heights; None: 1."""
    line: str | None = None
    """Of a section: ``E,N E,N ...`` in the survey's coordinates and unit."""
    radius_m: float | None = None
    """Of tiles: full detail within this distance of the eye."""
    height_shift_m: float | None = None
    """Of tiles: added to all heights; None: 0."""
    full_coordinates: bool = False
    """A mesh with whole coordinates in 64 bits, without a shift."""
    force: bool = False


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    path: Path
    product: Product
    bytes: int
    """Of the file and all that came with it."""
    crs: str
    """Name of the CRS that the coordinates are in."""
    unit: str
    companions: tuple[str, ...]
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What to say of it, by name."""


@dataclass(frozen=True, slots=True)
class _Job:
    """What every writer is given."""

    path: Path
    """In a folder of its own."""
    selected: SelectedScene
    request: ExportRequest
    progress: Progress

    @property
    def step(self) -> float:
        """Step in the unit of the survey."""
        step_m = self.request.step_m
        usual_m = _usual_step_m(self.selected.scene) if step_m is None else step_m
        return usual_m / self.selected.frame.unit_m

    @property
    def grid(self) -> PixelGrid:
        """Pixels of that step over the ground."""
        return make_grid(ground_extent(self.selected), self.step)


def export_scene(
    path: Path | str, request: ExportRequest, progress: Progress | None = None
) -> Exported:
    """Write one file, and what belongs beside it.

    Parameters
    ----------
    path : Path or str
        The scene directory, or its address (s3://...).
    request : ExportRequest
    progress : Progress, optional

    Returns
    -------
    Exported

    Raises
    ------
    OptionError
        Something cannot be as it is asked for; nothing was written.
    SceneNotFoundError, DamagedSceneError
        The scene cannot be read.
    """
    # (1) What is wrong without looking at the scene.
    product = product_of(
        request.output, request.product, interval=request.interval, line=request.line
    )
    _check(request, product)
    write, companions = _WRITERS[product]
    names = companions(request.output)
    # (2) The scene, and what is in it.
    holds = _folder_holds(request.output, product)
    with (
        writing_beside(
            request.output, companions=names, force=request.force, holds=holds
        ) as folder,
        Scene.open(path) as scene,
    ):
        frame = survey_frame(scene.manifest)
        regions, stable_ids = find_regions(scene, request.regions)
        extent = None if request.extent is None else frame.extent_to_plan(request.extent)
        selection = Selection(extent, regions, stable_ids)
        selected = SelectedScene(scene, frame, selection)
        ground_extent(selected)  # refuses a selection of nothing
        job = _Job(
            folder / request.output.name,
            selected,
            request,
            progress or NullProgress(),
        )
        facts = write(job)
        written = [file for file in folder.rglob("*") if file.is_file()]
        size = sum(file.stat().st_size for file in written)
        beside = tuple(name for name in names if (folder / name).exists())
        written_in = frame.in_metres(scene.manifest) if _is_glb(request.output) else frame
    crs = written_in.crs
    name = "no coordinate reference system stated" if crs is None else crs.name
    unit = written_in.unit_name
    if product == "tiles":
        name, unit = facts.pop("frame"), "m"
    return Exported(request.output, product, size, name, unit, beside, facts)


def _folder_holds(output: Path, product: Product) -> frozenset[str]:
    """Return what is in the folder that is written; nothing where it is a file."""
    if product != "tiles":
        return frozenset()
    from terraport_pipeline.export.tiles import ARCHIVE, FOLDER_HOLDS

    return frozenset() if output.suffix.lower() == ARCHIVE else FOLDER_HOLDS


def _is_glb(path: Path) -> bool:
    return path.suffix.lower() == ".glb"


def _check(request: ExportRequest, product: Product) -> None:
    if request.step_m is not None:
        if product not in ("orthophoto", "heights", "contours"):
            raise OptionError(f"--step-m is of pictures and contours, received it for {product}")
        if not (math.isfinite(request.step_m) and request.step_m > 0):
            raise OptionError(f"step {request.step_m}; expected metres above 0")

    if request.interval is not None:
        if product != "contours":
            raise OptionError(f"--interval is of contours, received it for {product}")
        if not (math.isfinite(request.interval) and request.interval > 0):
            raise OptionError(f"interval {request.interval}; expected a number above 0")
    if (request.line is None) == (product == "section"):
        said = "received none" if request.line is None else f"received it for {product}"
        raise OptionError(f"--line is what a section is cut along, {said}")
    if request.line is not None:
        parse_line(request.line)
    if product == "tiles" and (request.extent is not None or request.regions):
        raise OptionError("tiles are of a whole scene; leave out --extent and --region")
    for name, value in (
        ("--radius-m", request.radius_m),
        ("--height-shift-m", request.height_shift_m),
    ):
        if value is not None and product != "tiles":
            raise OptionError(f"{name} is of tiles, received it for {product}")
        if value is not None and not math.isfinite(value):
            raise OptionError(f"{name} {value}; expected metres")
    if request.radius_m is not None and request.radius_m <= 0:
        raise OptionError(f"--radius-m {request.radius_m}; expected metres above 0")
    if request.full_coordinates and product != "mesh":
        raise OptionError(f"--full-coordinates is of meshes, received it for {product}")


def _usual_step_m(scene: Scene) -> float:
    """About the distance of the detail's vertices: 1, 2 or 5 of a power of ten, not below it."""
    rows = scene.regions.get("regions", [])
    areas = [row.get("plan_area_m2") for row in rows if isinstance(row, dict)]
    area_m2 = sum(float(area) for area in areas if isinstance(area, int | float))
    if area_m2 <= 0:
        sides = scene.index.bounds[:, 3:] - scene.index.bounds[:, :3]
        area_m2 = float((sides[:, 0] * sides[:, 2]).sum())
    # Two faces to a cell of flat ground.
    spacing_m = max(math.sqrt(2 * area_m2 / scene.manifest.counts.detail_faces), 1e-3)
    power = 10.0 ** math.floor(math.log10(spacing_m))
    return next(first * power for first in _STEPS if first * power >= spacing_m * (1 - 1e-9))


def _orthophoto(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.geotiff import write_orthophoto

    grid = job.grid
    facts = write_orthophoto(job.path, job.selected, grid, job.progress)
    return {"step": f"{grid.step:.6g} {job.selected.frame.unit_name}", **facts}


def _heights(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.geotiff import write_heights

    grid = job.grid
    facts = write_heights(job.path, job.selected, grid, job.progress)
    return {"step": f"{grid.step:.6g} {job.selected.frame.unit_name}", **facts}


def _mesh(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.gathered import gather_mesh

    mesh = gather_mesh(job.selected, job.progress)
    return write_mesh(
        job.path,
        mesh,
        job.selected.frame,
        job.selected.scene.manifest,
        job.progress,
        full=job.request.full_coordinates,
    )


def _points(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.las import write_points

    return write_points(job.path, job.selected, job.progress)


def _contours(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.contours import write_contours

    grid = job.grid
    interval = 1.0 if job.request.interval is None else job.request.interval
    return write_contours(job.path, job.selected, grid, interval, job.progress)


def _section(job: _Job) -> dict[str, Any]:
    assert job.request.line is not None
    line = parse_line(job.request.line)
    return write_section(job.path, job.selected, line, job.progress)


def _tiles(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.tiles import write_tiles

    return write_tiles(
        job.path,
        job.selected.scene,
        job.progress,
        radius_m=job.request.radius_m,
        height_shift_m=job.request.height_shift_m or 0.0,
    )


def _regions(job: _Job) -> dict[str, Any]:
    from terraport_pipeline.export.region_shapes import write_region_shapes

    return write_region_shapes(job.path, job.selected, job.progress)


def _alone(_path: Path) -> tuple[str, ...]:
    return ()


def _of_shapefile(path: Path) -> tuple[str, ...]:
    if path.suffix.lower() != ".shp":
        return ()
    return tuple(f"{path.stem}{ending}" for ending in SHAPEFILE_COMPANIONS)


_Writer = Callable[[_Job], dict[str, Any]]

_WRITERS: Final[dict[Product, tuple[_Writer, Callable[[Path], tuple[str, ...]]]]] = {
    "orthophoto": (_orthophoto, _alone),
    "heights": (_heights, _alone),
    "mesh": (_mesh, mesh_companions),
    "points": (_points, _alone),
    "contours": (_contours, _of_shapefile),
    "section": (_section, _alone),
    "regions": (_regions, _of_shapefile),
    "tiles": (_tiles, _alone),
}
"""What writes each product, and the names of what it may write beside the file."""
