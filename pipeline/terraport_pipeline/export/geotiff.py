"""Cloud-optimised GeoTIFFs: the orthophoto and the height model.

GDAL writes a COG as a copy of another picture. That one is a plain tiled GeoTIFF beside it, filled
window by window, so no more than GDAL's cache of it is ever in memory.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
import rasterio.shutil
from rasterio.enums import ColorInterp
from rasterio.transform import Affine
from rasterio.windows import Window as RasterWindow

from terraport_payload.types import Float32
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.raster_grid import BLOCK, PixelGrid, Window
from terraport_pipeline.export.sampling import colour_windows, height_windows
from terraport_pipeline.export.selection import SelectedScene
from terraport_pipeline.progress import Progress
from terraport_store import Scene

__all__ = ["NODATA", "raster_transform", "write_heights", "write_orthophoto"]

NODATA: Final = -9999.0
"""Height where there is no surface: what most height models have, and no ground."""

_GDAL: Final = {
    "GDAL_CACHEMAX": 256,  # MB
    "GDAL_TIFF_INTERNAL_MASK": True,
    "GDAL_NUM_THREADS": "2",
}


def write_orthophoto(
    path: Path,
    selected: SelectedScene,
    grid: PixelGrid,
    progress: Progress,
) -> dict[str, Any]:
    """Write the scene as seen from straight above: red, green, blue and opacity, without loss.

    Parameters
    ----------
    path : Path
        The file; its folder must be empty but for what this writes.
    selected : SelectedScene
    grid : PixelGrid
    progress : Progress

    Returns
    -------
    dict
        What to say of it.
    """
    profile = {"dtype": "uint8", "count": 4, "photometric": "RGB", "alpha": "UNSPECIFIED"}
    progress.start("orthophoto", grid.rows * grid.columns, "pixels")
    covered = 0
    plain = path.with_name("plain.tif")
    with rasterio.Env(**_GDAL):
        with rasterio.open(plain, "w", **_profile(grid, selected.frame), **profile) as picture:
            picture.colorinterp = [
                ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha,
            ]  # fmt: skip
            picture.update_tags(**_tags(selected.scene, "orthophoto"))
            for window, levels in colour_windows(selected, grid):
                picture.write(levels, window=_raster_window(window))
                covered += int((levels[3] > 0).sum())
                progress.advance(window.rows * window.columns)
        _optimise(plain, path, overviews="AVERAGE", predictor="STANDARD")
    facts = _facts(grid, covered)
    progress.done(facts)
    return facts


def write_heights(
    path: Path,
    selected: SelectedScene,
    grid: PixelGrid,
    progress: Progress,
) -> dict[str, Any]:
    """Write the height of the highest surface at the centre of every pixel, float32.

    Arguments and result as for :func:`write_orthophoto`; places without a surface have
    :data:`NODATA`.
    """
    progress.start("height model", grid.rows * grid.columns, "pixels")
    covered = 0
    plain = path.with_name("plain.tif")
    with rasterio.Env(**_GDAL):
        profile = {"dtype": "float32", "count": 1, "nodata": NODATA}
        with rasterio.open(plain, "w", **_profile(grid, selected.frame), **profile) as picture:
            picture.update_tags(**_tags(selected.scene, "height model"))
            sign = selected.frame.height_sign
            picture.set_band_description(1, "depth" if sign < 0 else "height")
            picture.set_band_unit(1, _unit(selected.frame))
            for window, heights in height_windows(selected, grid):
                there = np.isfinite(heights)
                values = heights * np.float32(sign)
                filled: Float32 = np.where(there, values, np.float32(NODATA))
                picture.write(filled, 1, window=_raster_window(window))
                covered += int(there.sum())
                progress.advance(window.rows * window.columns)
        _optimise(plain, path, overviews="AVERAGE", predictor="FLOATING_POINT")
    facts = _facts(grid, covered)
    progress.done(facts)
    return facts


def _profile(grid: PixelGrid, frame: SurveyFrame) -> dict[str, Any]:
    return {
        "driver": "GTiff",
        "width": grid.columns,
        "height": grid.rows,
        "transform": raster_transform(frame, grid.west, grid.north, grid.step),
        "crs": None if frame.crs is None else rasterio.CRS.from_wkt(frame.crs.to_wkt()),
        "tiled": True,
        "blockxsize": BLOCK,
        "blockysize": BLOCK,
        "compress": "LZW",
        "BIGTIFF": "IF_SAFER",
        "SPARSE_OK": True,
    }


def raster_transform(frame: SurveyFrame, west: float, north: float, step: float) -> Affine:
    """Return the transform from columns and rows to survey coordinates; row 0 is the northernmost.

    If the survey's axes are not east and north, the image still has north at the top, and the
    transform includes the rotation.
    """
    (x, y), (ax, ay), (bx, by) = frame.plan_to_survey(
        np.array([(west, north), (step, 0.0), (0.0, -step)])
    ).tolist()
    return Affine(ax, bx, x, ay, by, y)


def _optimise(plain: Path, path: Path, *, overviews: str, predictor: str) -> None:
    rasterio.shutil.copy(
        plain,
        path,
        driver="COG",
        COMPRESS="DEFLATE",
        PREDICTOR=predictor,
        BLOCKSIZE=BLOCK,
        OVERVIEWS="AUTO",
        OVERVIEW_RESAMPLING=overviews,
        BIGTIFF="IF_SAFER",
    )
    plain.unlink()


def _raster_window(window: Window) -> RasterWindow:
    return RasterWindow(window.column, window.row, window.columns, window.rows)


def _tags(scene: Scene, what: str) -> dict[str, str]:
    return {
        "TIFFTAG_IMAGEDESCRIPTION": f"{scene.manifest.name}: {what}",
        "TIFFTAG_SOFTWARE": f"terraport {scene.manifest.build.terraport}",
        "TERRAPORT_VERSION": scene.manifest.version,
    }


def _unit(frame: SurveyFrame) -> str:
    return {"m": "metre", "ft": "foot", "us-ft": "US survey foot"}.get(
        frame.height_unit_name, frame.height_unit_name
    )


def _facts(grid: PixelGrid, covered: int) -> dict[str, Any]:
    return {
        "pixels": f"{grid.columns} x {grid.rows}",
        "with a surface": f"{covered / (grid.rows * grid.columns):.1%}",
    }
