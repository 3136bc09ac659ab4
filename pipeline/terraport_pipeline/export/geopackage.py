"""Lines as a GeoPackage: a SQLite database of four tables (OGC 12-128r18, version 1.3).

By Python's own sqlite3: a library of GDAL's drivers is 100 MB more to install, and this one table
needs nothing of it. What is written here is what the specification asks of every GeoPackage; a test
lets GDAL open it.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np
from pyproj import CRS
from pyproj.enums import WktVersion
from pyproj.exceptions import CRSError

from terraport_payload.types import Float64

__all__ = ["write_height_lines"]

_APPLICATION_ID: Final = 0x47504B47
"""``GPKG`` in ASCII."""

_USER_VERSION: Final = 10_300

_OWN_SRS: Final = 100_000
"""Number of a CRS that EPSG does not list."""

_UNDEFINED: Final = -1
"""Number of "Cartesian, but nobody says where"."""

_SCHEMA: Final = """
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE contours (
  fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom LINESTRING, height REAL,
  is_index BOOLEAN);
"""


def write_height_lines(
    path: Path,
    lines: Sequence[Float64],
    heights: Sequence[float],
    is_index: Sequence[bool],
    crs: CRS | None,
) -> None:
    """Write contour lines as the layer ``contours``.

    Parameters
    ----------
    path : Path
        A new file.
    lines : sequence of ndarray of shape (N, 2), float64
        Easting and northing; at least one line.
    heights : sequence of float
    is_index : sequence of bool
        Whether each is an index contour.
    crs : CRS, optional
    """
    low = np.min([line.min(axis=0) for line in lines], axis=0).tolist()
    high = np.max([line.max(axis=0) for line in lines], axis=0).tolist()
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {_USER_VERSION}")
        database.executescript(_SCHEMA)
        srs = _write_srs(database, crs)
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, "
            "max_y, srs_id) VALUES ('contours', 'features', 'contours', ?, ?, ?, ?, ?)",
            (*low, *high, srs),
        )
        database.execute(
            "INSERT INTO gpkg_geometry_columns VALUES ('contours', 'geom', 'LINESTRING', ?, 0, 0)",
            (srs,),
        )
        database.executemany(
            "INSERT INTO contours (geom, height, is_index) VALUES (?, ?, ?)",
            (
                (_geometry(line, srs), float(height), int(index))
                for line, height, index in zip(lines, heights, is_index, strict=True)
            ),
        )


def _write_srs(database: sqlite3.Connection, crs: CRS | None) -> int:
    """Write the three rows that must be there and the survey's own; return its number."""
    wgs84 = CRS.from_epsg(4326).to_wkt(WktVersion.WKT1_GDAL)
    rows = [
        ("Undefined cartesian SRS", -1, "NONE", -1, "undefined"),
        ("Undefined geographic SRS", 0, "NONE", 0, "undefined"),
        ("WGS 84 geodetic", 4326, "EPSG", 4326, wgs84),
    ]
    number = _UNDEFINED
    if crs is not None:
        code = crs.to_epsg()
        number = _OWN_SRS if code is None else code
        authority = ("NONE", _OWN_SRS) if code is None else ("EPSG", code)
        rows.append((crs.name, number, *authority, _wkt1(crs)))
    database.executemany(
        "INSERT INTO gpkg_spatial_ref_sys (srs_name, srs_id, organization, "
        "organization_coordsys_id, definition) VALUES (?, ?, ?, ?, ?)",
        rows,
    )
    return number


def _wkt1(crs: CRS) -> str:
    """Return the form that the column asks for (OGC 01-009), where PROJ can write it."""
    try:
        return crs.to_wkt(WktVersion.WKT1_GDAL)
    except CRSError:
        return crs.to_wkt()


def _geometry(points: Float64, srs: int) -> bytes:
    """GeoPackage's binary form of a line (clause 2.1.3): header, box, well-known binary."""
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    header = (
        b"GP\x00\x03" + np.array([srs], "<i4").tobytes()
    )  # little-endian, with a box of x and y
    box = np.array([x0, x1, y0, y1], "<f8").tobytes()
    head = b"\x01" + np.array([2, len(points)], "<u4").tobytes()
    return header + box + head + np.ascontiguousarray(points, "<f8").tobytes()
