"""Shapes with properties as GeoPackage, GeoJSON or Shapefile, written by GDAL (pyogrio)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyogrio.raw
import shapely

from terraport_pipeline.crs_axes import code_of, epsg_of
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import SurveyFrame

__all__ = ["SHAPEFILE_COMPANIONS", "write_shapes"]

_DRIVERS: Final = {".gpkg": "GPKG", ".geojson": "GeoJSON", ".shp": "ESRI Shapefile"}

SHAPEFILE_COMPANIONS: Final = (".shx", ".dbf", ".prj", ".cpg")
"""Endings of the files that belong to a Shapefile."""


def write_shapes(
    path: Path,
    layer: str,
    geometry_type: str,
    shapes: Sequence[Any],
    properties: Mapping[str, Sequence[Any]],
    frame: SurveyFrame,
) -> None:
    """Write a layer of shapes in the survey's coordinates.

    Parameters
    ----------
    path : Path
        A new file with the extension .gpkg, .geojson or .shp.
    layer : str
        Name of the layer, for formats with layers.
    geometry_type : str
        ``LineString`` or ``MultiPolygon``.
    shapes : sequence of shapely geometries
        In plan coordinates.
    properties : mapping of str to sequence
        Columns with one value per shape: text, number or boolean; None or NaN for no value.
    frame : SurveyFrame

    Raises
    ------
    OptionError
        GeoJSON in a CRS without a code.
    """
    ending = path.suffix.lower()
    crs = None if frame.crs is None else frame.crs.to_wkt()
    if frame.crs is not None:
        # GeoJSON names a CRS only by its code; for a compound CRS, the horizontal code is enough.
        code = code_of(frame.crs) if ending == ".geojson" else epsg_of(frame.crs)
        if code is not None:
            crs = f"EPSG:{code}"
        elif ending == ".geojson":
            raise OptionError(
                f"{layer} in {frame.crs.name}, which has no EPSG code, as GeoJSON, which names a "
                "CRS by it; expected .gpkg or .dxf"
            )
    # GeoJSON in the survey's own CRS, which its member "crs" names: RFC 7946 knows degrees alone;
    # GDAL and QGIS read it, and coordinates in degrees would be good to a centimetre only.
    options = {"COORDINATE_PRECISION": "4"} if ending == ".geojson" else {}
    columns = [_column(values) for values in properties.values()]
    with warnings.catch_warnings():
        # A survey may state no CRS; what is exported says so then.
        warnings.filterwarnings("ignore", "'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=shapely.to_wkb(
                np.array([frame.shape_to_survey(shape) for shape in shapes], object)
            ),
            field_data=[values for values, _ in columns],
            field_mask=[missing for _, missing in columns],
            fields=list(properties),
            layer=layer,
            driver=_DRIVERS[ending],
            geometry_type=geometry_type,
            crs=crs,
            **options,
        )


def _column(values: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Give GDAL a column of one type, and where it has no value."""
    missing = np.array([value is None for value in values], np.bool_)
    known = [value for value in values if value is not None]
    if all(isinstance(value, str) for value in known):
        return np.array(list(values), object), missing
    filled = [0 if value is None else value for value in values]
    return np.array(filled), missing
