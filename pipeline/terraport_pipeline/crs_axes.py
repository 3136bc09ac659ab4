"""Axes of a coordinate reference system: directions and units of x, y and z.

PURE except for PROJ's database.

Files store x as easting and y as northing, whatever the axis order of their CRS (EPSG:2180, 3301
and 31467 list northings first). Axes that point south, west or down do change the coordinates.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, Final

from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from terraport_store.manifest import EAST_NORTH_UP, Axis

__all__ = [
    "UnusableAxesError",
    "code_of",
    "epsg_of",
    "height_axis",
    "is_one_system",
    "is_same_place",
    "own_code",
    "parts_of",
    "plan_axes",
    "same_grid",
    "with_axes",
]

_PLAN: Final[tuple[Axis, ...]] = ("east", "west", "north", "south")
_EAST_WEST: Final = ("east", "west")

_SCREEN: Final = frozenset({"unspecified", "displayRight", "displayUp", "right", "left"})
"""Axis directions of local grids without a relation to the Earth: x and y are used unchanged."""

_NAMES: Final = {
    "east": ("Easting", "E"), "west": ("Westing", "W"), "north": ("Northing", "N"),
    "south": ("Southing", "S"), "up": ("Gravity-related height", "H"), "down": ("Depth", "D"),
}  # fmt: skip

_NORTH_ORIENTED: Final = {
    9819: (1041, "Krovak (North Orientated)"),
    1042: (1043, "Krovak Modified (North Orientated)"),
    9808: (9807, "Transverse Mercator"),
}
"""EPSG codes of projection methods whose coordinates increase to the south and west whatever their
axes state, with the same method to the north and east. False easting and northing change sign."""

_FALSE_ORIGIN: Final = frozenset({8806, 8807})

_SAME_UNIT: Final = 1e-9
"""Largest relative difference of equal units; international and US survey feet differ by 2e-6."""

_SAME_PLACE_M: Final = 1e-4


class UnusableAxesError(ValueError):
    """The axes of a CRS are not easting or westing, northing or southing in one unit."""


def parts_of(crs: CRS) -> tuple[CRS | None, CRS | None]:
    """Return the horizontal and the vertical part of a CRS, without shifts to another datum."""
    while crs.is_bound and crs.source_crs is not None:
        crs = crs.source_crs
    if crs.is_compound:
        parts = [parts_of(part) for part in crs.sub_crs_list]
        horizontal = next((part for part, _ in parts if part is not None), None)
        return horizontal, next((part for _, part in parts if part is not None), None)
    return (None, crs) if crs.is_vertical else (crs, None)


def plan_axes(horizontal: CRS) -> tuple[tuple[Axis, Axis], float]:
    """Return the directions of x and y, and metres in their unit.

    Raises
    ------
    UnusableAxesError
        The axes are not perpendicular compass directions, or have two units.
    """
    axes = horizontal.axis_info[:2]
    if len(axes) < 2:
        return ("east", "north"), 1.0
    units = [axis.unit_conversion_factor for axis in axes]
    if not abs(units[0] - units[1]) <= _SAME_UNIT * units[0]:
        raise UnusableAxesError(f"units of {units[0]:.9g} m and {units[1]:.9g} m")
    first, second = (axis.direction for axis in axes)
    if {first, second} <= _SCREEN or first == second or (first, second) == ("north", "east"):
        # Both to the north or both to the south: a polar projection.
        return ("east", "north"), units[0]
    for x in _PLAN:
        for y in _PLAN:
            if (x, y) == (first, second) and (x in _EAST_WEST) != (y in _EAST_WEST):
                return (x, y), units[0]
    raise UnusableAxesError(f"axes that point {first} and {second}")


def height_axis(crs: CRS) -> tuple[Axis, float] | None:
    """Return the direction of z and metres in its unit; None where the CRS has no height."""
    horizontal, vertical = parts_of(crs)
    axes = [] if vertical is None else vertical.axis_info[:1]
    if not axes and horizontal is not None:
        axes = horizontal.axis_info[2:3]
    if not axes or axes[0].direction not in ("up", "down"):
        return None
    return ("down" if axes[0].direction == "down" else "up"), axes[0].unit_conversion_factor


def own_code(crs: CRS) -> int | None:
    """Return the EPSG code that a CRS states, or that PROJ identifies."""
    stated = crs.to_json_dict().get("id", {})
    if stated.get("authority") == "EPSG" and str(stated.get("code", "")).isdigit():
        return int(stated["code"])
    code: int | None = crs.to_epsg()
    return code


def epsg_of(crs: CRS) -> int | None:
    """Return the EPSG code of a CRS if its coordinates mean the same as under that code.

    PROJ also identifies a CRS with other axes: a CRS whose axes point north and east is not
    EPSG:5513, whose axes point south and west.
    """
    code = own_code(crs)
    if code is None:
        return None
    try:
        return code if _numbers(CRS.from_epsg(code)) == _numbers(crs) else None
    except (CRSError, UnusableAxesError):
        return None


def code_of(crs: CRS) -> int | None:
    """Return the EPSG code of a CRS, or else of its horizontal part."""
    horizontal, _ = parts_of(crs)
    code = epsg_of(crs)
    return code if code is not None or horizontal is None else epsg_of(horizontal)


def same_grid(one: CRS, other: CRS) -> bool:
    """Return whether two horizontal CRSs are the same grid, however each is written.

    The order of northing and easting is ignored, as in files; directions, units, datum and
    projection must agree.
    """
    if one == other:
        return True
    try:
        if _numbers(one) != _numbers(other):
            return False
    except UnusableAxesError:
        return False
    code = epsg_of(one)
    if code is not None and code == epsg_of(other):
        return True
    ordered = [with_axes(crs, None, None, None) for crs in (one, other)]
    return None not in ordered and ordered[0] == ordered[1]


def is_one_system(one: CRS, other: CRS) -> bool:
    """Return whether files in two CRSs can be one survey: the same grid and consistent heights.

    A shift to another datum (``TOWGS84``) is ignored. So is a vertical CRS that only one of them
    states, if its unit is the one in which the other's heights are read.
    """
    (plan, upright), (other_plan, other_upright) = parts_of(one), parts_of(other)
    if plan is None or other_plan is None:
        return one == other
    if not same_grid(plan, other_plan):
        return False
    try:
        unit_m = plan_axes(plan)[1]
    except UnusableAxesError:
        return one == other
    heights = [height_axis(crs) or ("up", unit_m) for crs in (one, other)]
    if heights[0][0] != heights[1][0] or abs(heights[0][1] - heights[1][1]) > 1e-12:
        return False
    if upright is None or other_upright is None:
        return True
    return upright == other_upright or "unknown" in (upright.name, other_upright.name)


def with_axes(
    crs: CRS,
    axes: tuple[Axis, Axis, Axis] | None,
    horizontal_m: float | None,
    height_m: float | None,
    name: str | None = None,
) -> CRS | None:
    """Return the same CRS with other axes and units.

    Parameters
    ----------
    crs : CRS
    axes : tuple of three directions, optional
        None keeps them, except that easting comes first.
    horizontal_m, height_m : float, optional
        Metres per unit; None keeps the unit.
    name : str, optional

    Returns
    -------
    CRS or None
        None if PROJ cannot represent it.
    """
    description = copy.deepcopy(crs.to_json_dict())

    def edit(part: dict[str, Any]) -> None:
        part.pop("id", None)
        for component in part.get("components", []):
            edit(component)
        if part["type"] == "BoundCRS":
            edit(part["source_crs"])
        system = part.get("coordinate_system")
        if system is None or part["type"] in ("GeographicCRS", "GeodeticCRS"):
            return
        changed = _edit_axes(system["axis"], axes, horizontal_m, height_m)
        if changed:
            part["name"] = f"{part['name']} ({', '.join(changed)})"
        if axes is not None and axes[:2] == EAST_NORTH_UP[:2]:
            _to_north_and_east(part.get("conversion", {}))

    edit(description)
    if name is not None:
        description["name"] = name
    try:
        return CRS.from_json_dict(description)
    except CRSError:
        return None


def is_same_place(own: CRS, metric: CRS, places: Any, to_metres: Callable[[Any], Any]) -> bool:
    """Return whether PROJ's transformation between two CRSs agrees with a computed one.

    Parameters
    ----------
    own, metric : CRS
        Horizontal.
    places : ndarray of shape (N, 2)
        In `own`.
    to_metres : callable
        Converts them to coordinates in `metric`.
    """
    try:
        convert = Transformer.from_crs(own, metric, always_xy=True)
        x, y = convert.transform(*places.T)
    except (CRSError, ProjError):
        return False
    east, north = to_metres(places).T
    return bool((abs(x - east) < _SAME_PLACE_M).all() and (abs(y - north) < _SAME_PLACE_M).all())


def _numbers(crs: CRS) -> tuple[object, ...]:
    """Return directions of a CRS's axes and their units, in nanometres."""
    horizontal, _ = parts_of(crs)
    plan: tuple[object, ...] = ()
    if horizontal is not None:
        directions, unit_m = plan_axes(horizontal)
        plan = (*directions, round(unit_m * 1e9))
    height = height_axis(crs)
    return plan if height is None else (*plan, height[0], round(height[1] * 1e9))


def _edit_axes(
    listed: list[dict[str, Any]],
    axes: tuple[Axis, Axis, Axis] | None,
    horizontal_m: float | None,
    height_m: float | None,
) -> list[str]:
    """Change the axes of one CRS in PROJ's JSON, in place; return the reversed directions."""
    turned: list[str] = []
    plan = [axis for axis in listed if axis["direction"] not in ("up", "down")]
    upright = [axis for axis in listed if axis["direction"] in ("up", "down")]
    directions = [axis["direction"] for axis in plan]
    if directions == ["north", "east"]:  # the usual order
        for axis, direction in zip(plan, ("east", "north"), strict=True):
            axis["name"], axis["abbreviation"] = _NAMES[direction]
            axis["direction"] = direction
    is_polar = len(set(directions)) < len(directions)
    if axes is not None and not is_polar:
        for axis, direction in zip(plan, axes[:2], strict=False):
            if axis["direction"] != direction:
                axis["name"], axis["abbreviation"] = _NAMES[direction]
                axis["direction"] = direction
                turned.append(direction)
    if axes is not None:
        for axis in upright:
            if axis["direction"] != axes[2]:
                axis["name"], axis["abbreviation"] = _NAMES[axes[2]]
                axis["direction"] = axes[2]
                turned.append(axes[2])
    for group, metres in ((plan, horizontal_m), (upright, height_m)):
        for axis in group if metres is not None else ():
            axis["unit"] = (
                "metre"
                if metres == 1.0
                else {
                    "type": "LinearUnit",
                    "name": f"unit of {metres:.12g} m",
                    "conversion_factor": metres,
                }
            )
    return turned


def _to_north_and_east(conversion: dict[str, Any]) -> None:
    """Replace a south- and west-oriented projection by its north- and east-oriented form."""
    method = conversion.get("method", {})
    replacement = _NORTH_ORIENTED.get(method.get("id", {}).get("code"))
    if replacement is None:
        return
    code, name = replacement
    conversion.pop("id", None)
    conversion["method"] = {"name": name, "id": {"authority": "EPSG", "code": code}}
    for parameter in conversion.get("parameters", []):
        if parameter.get("id", {}).get("code") in _FALSE_ORIGIN:
            parameter["value"] = 0.0 - parameter["value"]
