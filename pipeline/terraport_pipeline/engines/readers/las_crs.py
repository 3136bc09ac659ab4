"""The coordinate reference system that a LAS file states: well-known text, or GeoTIFF keys.

Of the keys (GeoTIFF 1.0, section 6.2; OGC 19-008r4), the EPSG codes of the horizontal and the
vertical CRS and their units are read. A user-defined projection (code 32767) becomes a local grid
with its name and unit; its parameters are not read.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Final

import laspy
from laspy.vlrs.known import (
    GeoDoubleParamsVlr,
    GeoKeyDirectoryVlr,
)
from pyproj import CRS
from pyproj.crs import CompoundCRS
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from terraport_pipeline.crs_axes import height_axis, parts_of, same_grid
from terraport_pipeline.engines.readers.las_blocks import brief
from terraport_pipeline.engines.readers.survey_crs import UnitDoubt

__all__ = ["LasCrs", "las_crs"]

_WKT: Final = 2112
_ASCII: Final = 34737
"""Numbers of the records that hold well-known text, and the texts of GeoTIFF keys."""

_CITATION: Final = 1026
_GEOGRAPHIC: Final = 2048
_PROJECTED: Final = 3072
_PROJECTED_CITATION: Final = 3073
_PROJECTION: Final = 3074
_PLAN_UNITS: Final = 3076
_PLAN_UNIT_SIZE: Final = 3077
_VERTICAL: Final = 4096
_VERTICAL_CITATION: Final = 4097
_VERTICAL_UNITS: Final = 4099
"""Numbers of GeoTIFF keys."""

_USER_DEFINED: Final = 32767
_CODES: Final = range(1024, 32767)
"""Values that are EPSG codes."""

_ESRI_TEXT: Final = "ESRI PE String = "
"""Prefix of well-known text in a citation."""

_LIKE: Final = 1e-5
"""Relative difference above that of the two kinds of feet, and below that of any other units."""

_SAME: Final = 1e-9

Unit = tuple[str, float]
"""Name of a unit, and its length in metres."""


@dataclass(frozen=True, slots=True)
class LasCrs:
    """Coordinate reference system of a LAS file, with doubts about its units and warnings."""

    crs: CRS | None = None
    doubts: tuple[UnitDoubt, ...] = ()
    warnings: tuple[str, ...] = ()


def las_crs(header: laspy.LasHeader) -> LasCrs:
    """Read the coordinate reference system of a LAS file.

    If a file has well-known text and GeoTIFF keys, the WKT bit of its header decides; a warning
    names the other one if they differ.
    """
    records = [*header.vlrs, *(header.evlrs or ())]
    texts = [text.decode("utf-8", "replace").strip(" \0") for text in _data(records, _WKT)]
    warnings: list[str] = []
    by_text = None
    for text in filter(None, texts):
        try:
            by_text = CRS.from_wkt(text)
            break
        except CRSError as error:
            warnings.append(_not_understood(error))
    try:
        by_keys = _of_keys(_Keys(records))
    except (CRSError, ValueError, KeyError, IndexError) as error:
        by_keys = LasCrs(warnings=(_not_understood(error),))
    is_by_text = by_text is not None and (
        bool(header.global_encoding.wkt) or (by_keys.crs is None and not by_keys.doubts)
    )
    if not is_by_text:
        if by_text is not None and by_keys.crs is not None and not _agree(by_text, by_keys.crs):
            warnings.append(_both(by_keys.crs, "GeoTIFF keys", by_text, "well-known text"))
        return LasCrs(by_keys.crs, by_keys.doubts, (*warnings, *by_keys.warnings))
    assert by_text is not None
    if by_keys.crs is not None and not _agree(by_text, by_keys.crs):
        warnings.append(_both(by_text, "well-known text", by_keys.crs, "GeoTIFF keys"))
    return LasCrs(by_text, (), tuple(warnings))


def _data(records: list[Any], number: int) -> list[bytes]:
    """Return the bytes of records: laspy cannot read text that is not ASCII."""
    return [
        record.record_data_bytes()
        for record in records
        if record.user_id == "LASF_Projection" and record.record_id == number
    ]


class _Keys:
    """Values of the GeoTIFF keys, by number."""

    def __init__(self, records: list[Any]) -> None:
        text = b"".join(_data(records, _ASCII))
        reals = [
            float(real.value)
            for r in records
            if isinstance(r, GeoDoubleParamsVlr)
            for real in r.doubles
        ]
        self._numbers: dict[int, float] = {}
        self._texts: dict[int, str] = {}
        for record in records:
            for key in record.geo_keys if isinstance(record, GeoKeyDirectoryVlr) else ():
                first, end = key.value_offset, key.value_offset + key.count
                if key.tiff_tag_location == 0:
                    self._numbers[key.id] = key.value_offset
                elif key.tiff_tag_location == 34736 and first < len(reals):
                    self._numbers[key.id] = reals[first]
                elif key.tiff_tag_location == 34737:
                    named = text[first:end].decode("utf-8", "replace")
                    self._texts[key.id] = named.replace("\0", "").strip(" |")

    def __contains__(self, key: int) -> bool:
        return self.code(key) != 0

    def code(self, key: int) -> int:
        """Return a whole number; 0 (undefined) if the key is missing."""
        return int(self._numbers.get(key, 0))

    def number(self, key: int) -> float | None:
        """Return a number."""
        return self._numbers.get(key)

    def text(self, *keys: int) -> str:
        """Return the first text that is not empty."""
        return next((self._texts[key] for key in keys if self._texts.get(key)), "")

    def unit(self, key: int, size: int | None = None) -> Unit | None:
        """Return a unit of length; None if the key is missing or the unit unknown."""
        code = self.code(key)
        if code == _USER_DEFINED and size is not None:
            length = self.number(size)
            return None if length is None or not length > 0 else ("user-defined unit", length)
        return _linear_units().get(code)


@functools.lru_cache(maxsize=1)
def _linear_units() -> dict[int, Unit]:
    """Return the units of length by EPSG code."""
    units = get_units_map(auth_name="EPSG", category="linear", allow_deprecated=True)
    return {int(unit.code): (unit.name, unit.conv_factor) for unit in units.values()}


def _of_keys(keys: _Keys) -> LasCrs:
    """Combine the horizontal and the vertical CRS of the keys."""
    plan = _plan_of_keys(keys)
    unit_m = None
    if plan.crs is not None and not (plan.crs.is_geographic or plan.crs.is_geocentric):
        unit_m = plan.crs.axis_info[0].unit_conversion_factor
    height = _height_of_keys(keys, unit_m)
    doubts, warnings = plan.doubts + height.doubts, plan.warnings + height.warnings
    if plan.crs is None or height.crs is None:
        return LasCrs(plan.crs or height.crs, doubts, warnings)
    name = f"{plan.crs.name} + {height.crs.name}"
    return LasCrs(CompoundCRS(name, [plan.crs, height.crs]), doubts, warnings)


def _plan_of_keys(keys: _Keys) -> LasCrs:
    """Read the horizontal CRS of the keys."""
    code, unit = keys.code(_PROJECTED), keys.unit(_PLAN_UNITS, _PLAN_UNIT_SIZE)
    name = keys.text(_PROJECTED_CITATION, _CITATION)
    warnings: list[str] = []
    if code in _CODES:
        try:
            crs = CRS.from_epsg(code)
        except CRSError:
            name = name or f"EPSG:{code}"
            warnings.append(
                f"GeoTIFF key {_PROJECTED} states EPSG:{code}, which PROJ does not know."
            )
        else:
            own_m = crs.axis_info[0].unit_conversion_factor
            stated = "" if unit is None else f"key {_PLAN_UNITS} units of {unit[0]}"
            if unit is None or abs(unit[1] - own_m) <= _SAME * own_m:
                return LasCrs(crs)
            said = (
                f"the file contradicts itself: its GeoTIFF keys state {crs.name} (EPSG:{code}), "
                f"which is in units of {crs.axis_info[0].unit_name}, and in {stated}"
            )
            if abs(unit[1] - own_m) <= _LIKE * own_m:
                return LasCrs(crs, (), (_taken(said, crs.axis_info[0].unit_name),))
            return LasCrs(crs, (UnitDoubt(is_height=False, reason=said),))
    elif code != _USER_DEFINED and _PLAN_UNITS not in keys and _PROJECTION not in keys:
        code = keys.code(_GEOGRAPHIC)
        return LasCrs(CRS.from_epsg(code) if code in _CODES else None)
    if name.startswith(_ESRI_TEXT):
        return LasCrs(CRS.from_wkt(name.removeprefix(_ESRI_TEXT)))
    # A user-defined CRS.
    if unit is None and _PLAN_UNITS in keys:
        return LasCrs(None, (_unknown_unit(keys, _PLAN_UNITS, is_height=False),), tuple(warnings))
    shown = f" ({name})" if name else ""
    if unit is None:
        warnings.append(
            f"The GeoTIFF keys have a user-defined coordinate reference system{shown} without a "
            "unit. State it with --crs EPSG:n or --units."
        )
        return LasCrs(None, (), tuple(warnings))
    warnings.append(
        f"The GeoTIFF keys have a user-defined coordinate reference system{shown} in units of "
        f"{unit[0]}: sizes are right, but the position on Earth is not known. State it with --crs "
        "EPSG:n."
    )
    local = _local_crs(name or "local grid", unit)
    return LasCrs(local, (), tuple(warnings))


def _height_of_keys(keys: _Keys, plan_unit_m: float | None) -> LasCrs:
    """Read the vertical CRS of the keys; nothing if heights have the unit of x and y."""
    code, unit = keys.code(_VERTICAL), keys.unit(_VERTICAL_UNITS)
    doubt: tuple[UnitDoubt, ...] = ()
    if unit is None and _VERTICAL_UNITS in keys:
        doubt = (_unknown_unit(keys, _VERTICAL_UNITS, is_height=True),)
    crs = None
    if code in _CODES:
        try:
            crs = CRS.from_epsg(code)
        except CRSError:
            crs = None
        crs = crs if crs is not None and crs.is_vertical else None
    if crs is not None:
        axis = crs.axis_info[0]
        own_m = axis.unit_conversion_factor
        said = (
            f"the file contradicts itself: its GeoTIFF keys state {crs.name} (EPSG:{code}), which "
            f"is in units of {axis.unit_name}, and in key {_VERTICAL_UNITS} "
        )
        if doubt:
            said += f"unit {keys.code(_VERTICAL_UNITS)}, which EPSG does not know"
            return LasCrs(crs, (), (_taken(said, axis.unit_name),))
        if unit is None or abs(unit[1] - own_m) <= _SAME * own_m:
            return LasCrs(crs)
        said += f"units of {unit[0]}"
        if abs(unit[1] - own_m) <= _LIKE * own_m:
            return LasCrs(crs, (), (_taken(said, axis.unit_name),))
        return LasCrs(crs, (UnitDoubt(is_height=True, reason=said),))
    warnings: tuple[str, ...] = ()
    if code in _CODES and unit is None:
        said = (
            f"GeoTIFF key {_VERTICAL} is {code}, no vertical system that PROJ knows, and no key "
            "states the unit of heights"
        )
        if not doubt and plan_unit_m is not None and abs(plan_unit_m - 1.0) > _SAME:
            doubt = (UnitDoubt(is_height=True, reason=said),)
        elif not doubt:
            warnings = (f"{said}: they are taken as metres.",)
    if unit is None or abs(unit[1] - (plan_unit_m or 1.0)) <= _SAME * unit[1]:
        return LasCrs(None, doubt, warnings)
    return LasCrs(
        _unknown_heights(keys.text(_VERTICAL_CITATION) or "unknown", unit), doubt, warnings
    )


def _unknown_unit(keys: _Keys, key: int, *, is_height: bool) -> UnitDoubt:
    what = "heights" if is_height else "x and y"
    return UnitDoubt(
        is_height=is_height,
        reason=f"GeoTIFF key {key} states unit {keys.code(key)} for {what}, expected a unit of "
        "length that EPSG knows (9001 metre, 9002 foot, 9003 US survey foot)",
    )


def _local_crs(name: str, unit: Unit) -> CRS:
    """Create an engineering CRS, without a position on Earth."""
    name = name.replace('"', "'")
    return CRS.from_wkt(
        f'ENGCRS["{name}",EDATUM["{name}"],CS[Cartesian,2],AXIS["easting (E)",east],'
        f'AXIS["northing (N)",north],LENGTHUNIT["{unit[0]}",{unit[1]!r}]]'
    )


def _unknown_heights(name: str, unit: Unit) -> CRS:
    """Create a vertical CRS of which only the unit is known."""
    name = name.replace('"', "'")
    return CRS.from_wkt(
        f'VERTCRS["{name}",VDATUM["{name}"],CS[vertical,1],AXIS["height (H)",up],'
        f'LENGTHUNIT["{unit[0]}",{unit[1]!r}]]'
    )


def _agree(one: CRS, other: CRS) -> bool:
    """Return whether two CRS statements of one file give coordinates the same meaning."""
    grids = parts_of(one)[0], parts_of(other)[0]
    if (grids[0] is None) != (grids[1] is None):
        return False
    if grids[0] is not None and grids[1] is not None and not same_grid(grids[0], grids[1]):
        return False
    heights = height_axis(one), height_axis(other)
    return None in heights or heights[0] == heights[1]


def _both(taken: CRS, source: str, other: CRS, other_source: str) -> str:
    return (
        f"The file states {taken.name} ({_axes(taken)}) as {source} and {other.name} "
        f"({_axes(other)}) as {other_source}. Its header selects the first. Override it with --crs."
    )


def _axes(crs: CRS) -> str:
    """Name the units of a CRS."""
    return ", ".join(f"{axis.direction} in {axis.unit_name}" for axis in crs.axis_info)


def _taken(said: str, unit: str) -> str:
    return (
        f"{said[0].upper()}{said[1:]}: {unit} is used. Override it with --units or --height-units."
    )


def _not_understood(error: Exception) -> str:
    return (
        f"The file's coordinate reference system cannot be understood ({brief(error)}); the "
        "survey is treated as one without."
    )
