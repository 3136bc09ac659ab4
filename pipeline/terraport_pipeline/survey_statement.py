"""What a user states of a survey because its files do not say it, or say it wrongly.

PURE but for PROJ's own database.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Annotated, Any, Final, Literal

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Notation, Option

__all__ = ["LEFT_OUT", "METRES_PER_UNIT", "SurveyStatement"]

METRES_PER_UNIT: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}
"""International feet are 2 parts in a million shorter than the US survey's: 4 m at 2,000 km."""

LEFT_OUT: Final = "-"
"""Stands in ``--columns`` for a column that is not read."""

LengthUnit = Literal["m", "cm", "mm", "ft", "us-ft"]


def _parse_columns(text: str, what: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if len(names) < 3 or not all(names):
        raise OptionError(
            f"{what} {text!r}; expected a name for every column, as in x,y,z,r,g,b,- (- leaves a "
            "column out)"
        )
    return names


COLUMNS: Final = Notation("x,y,z,...", _parse_columns, ",".join)


@dataclass(frozen=True, slots=True)
class SurveyStatement:
    """CRS, units, columns and points of a survey, where its files say them wrong or not at all.

    Raises
    ------
    OptionError
        The CRS is not known, or in degrees or Earth-centred; a column is named twice.
    """

    crs: Annotated[str | None, Option(unset="what the files state")] = None
    """Coordinate reference system of the coordinates as they are: EPSG:26914, EPSG:2263+6360 with
    heights of their own, WKT or PROJ. It overrules what the files state."""
    units: Annotated[LengthUnit | None, Option(unset="the CRS's; without one metres")] = None
    """Length unit of the coordinates: metres, centimetres, millimetres, international feet or US
    survey feet. It overrules the CRS's; heights follow unless --height-units says theirs."""
    height_units: Annotated[LengthUnit | None, Option(unset="as --units, or the CRS's")] = None
    """Length unit of the heights, where it is another."""
    columns: Annotated[
        tuple[str, ...] | None,
        Option(notation=COLUMNS, unset="by the header, or by what the numbers look like"),
    ] = None
    """What the columns of a text are, in their order: -,y,x,z,r,g,b for a point number, which -
    leaves out, northing, easting, height and colour. Other names become attributes."""
    keep_noise: Annotated[bool, Option()] = False
    """Keep the points that a LAS or LAZ marks as withheld or as noise (classes 7 and 18); they are
    left out otherwise, and counted."""

    def __post_init__(self) -> None:
        named = [name.lower() for name in self.columns or () if name != LEFT_OUT]
        twice = sorted({name for name in named if named.count(name) > 1})
        if twice:
            raise OptionError(f"columns {','.join(self.columns or ())}: {twice[0]} stands twice")
        _ = self.system

    @property
    def system(self) -> Any | None:
        """The stated CRS as a pyproj.CRS."""
        return None if self.crs is None else _system(self.crs)

    @property
    def recorded(self) -> dict[str, Any]:
        """What was stated, by the names of the options; empty where nothing was."""
        stated = {name: value for name, value in asdict(self).items() if value not in (None, False)}
        if self.columns is not None:
            stated["columns"] = [*self.columns]
        return stated


@lru_cache(maxsize=4)
def _system(text: str) -> Any:
    from pyproj import CRS  # 40 ms, and most surveys say theirs
    from pyproj.exceptions import CRSError

    try:
        crs = CRS.from_user_input(text)
    except CRSError as error:
        raise OptionError(
            f"crs {text!r}; expected one that PROJ knows, as EPSG:26914 (epsg.io finds it by place)"
        ) from error
    if crs.is_geographic or crs.is_geocentric:
        kind = "degrees" if crs.is_geographic else "Earth-centred coordinates"
        raise OptionError(
            f"crs {text!r} ({crs.name}) has {kind}; expected one with eastings and northings: "
            "project the survey first, for example to its UTM zone"
        )
    return crs
