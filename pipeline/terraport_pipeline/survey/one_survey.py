"""Whether files are one survey: in one CRS, near each other, undamaged; else how it is said."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from pyproj import CRS

from terraport_pipeline.crs_axes import epsg_of, height_axis, is_one_system, parts_of
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.survey_statement import SurveyStatement

__all__ = [
    "FAR",
    "OUTSIDE",
    "crs_groups",
    "damage_of",
    "listed",
    "nothing_within",
    "one_crs",
    "refuse_far",
]

OUTSIDE: Final = "lies outside the extent"
"""Why a file is not read, or nothing of it is taken."""

_LISTED: Final = 3
"""Names in a message; of the others the number."""

FAR: Final = 100_000.0
"""Files of one survey lie nearer to each other than this, in metres or the CRS's unit."""


def crs_groups(files: Iterable[tuple[str, CRS | None]]) -> list[tuple[CRS, list[str]]]:
    """Group files by the CRS that they state, however each writes it.

    Parameters
    ----------
    files : iterable of (str, pyproj.CRS or None)
        Name of every file, and the CRS that it states; files without a CRS are left out.

    Returns
    -------
    list of (pyproj.CRS, list of str)
        The most complete statement of each CRS (with heights, with an EPSG code), and its files.
    """
    by_text: dict[str, tuple[CRS, list[str]]] = {}  # comparing CRSs is slow, comparing texts is not
    for name, crs in files:
        if crs is not None:
            by_text.setdefault(crs.srs, (crs, []))[1].append(name)
    groups: list[tuple[CRS, list[str]]] = []
    fullest = sorted(by_text.values(), key=lambda stated: _fullness(stated[0]), reverse=True)
    for crs, names in fullest:
        group = next((names for other, names in groups if is_one_system(other, crs)), None)
        if group is None:
            groups.append((crs, [*names]))
        else:
            group += names
    return groups


def one_crs(
    files: Sequence[tuple[str, CRS | None]],
    advice: str = "",
    statement: SurveyStatement | None = None,
) -> CRS | None:
    """Find the coordinate reference system that all files which state one agree on.

    Parameters
    ----------
    files : sequence of (str, pyproj.CRS or None)
        Name of every file, and the CRS that it states.
    advice : str
        Further advice for the error if they differ.
    statement : SurveyStatement, optional
        The user's statements; a CRS in it overrides all files.

    Returns
    -------
    pyproj.CRS or None
        None if no file states one.

    Raises
    ------
    SurveyError
        Files state different CRSs; names the files of each.
    """
    groups = crs_groups(files)
    if len(groups) > 1 and statement is not None and statement.system is not None:
        heights = {height_axis(crs) for crs, _ in groups} - {None}
        says_heights = height_axis(statement.system) is not None or (
            statement.height_units is not None or statement.units is not None
        )
        if len(heights) <= 1 or says_heights:
            return next((crs for crs, _ in groups if height_axis(crs) is not None), groups[0][0])
        advice = f"; or add the heights to --crs {statement.crs}, as in EPSG:26918+5703"
    if len(groups) > 1:
        stated = "; ".join(f"{_described(crs)} in {listed(names)}" for crs, names in groups)
        raise SurveyError(
            f"the files are in {len(groups)} coordinate reference systems ({stated}); expected "
            "one: reproject some (PDAL filters.reprojection, las2las), say with --crs which one "
            f"all of them are in, or build them apart{advice}"
        )
    return groups[0][0] if groups else None


def _fullness(crs: CRS) -> tuple[bool, bool, str]:
    return parts_of(crs)[1] is not None, epsg_of(parts_of(crs)[0] or crs) is not None, crs.srs


def _described(crs: CRS) -> str:
    """Name a CRS with the unit of its heights, which may be the only difference."""
    height = height_axis(crs)
    if height is None:
        return str(crs.name)
    kind = "depths" if height[0] == "down" else "heights"
    return f"{crs.name} ({kind} in units of {height[1]:.9g} m)"


def nothing_within(
    title: str,
    extent: Extent,
    boxes: Sequence[tuple[Sequence[float] | None, Sequence[float] | None]],
    crs: Any | None,
) -> SurveyError:
    """Say that a survey has no point within an extent, and where its points are.

    Parameters
    ----------
    title : str
        Of the survey.
    extent : Extent
    boxes : sequence of (low, high)
        Corners of each file, None where they are not known.
    crs : pyproj.CRS or None
        Of the survey.
    """
    stated = [(low, high) for low, high in boxes if low is not None and high is not None]
    where = "its bounds are not known"
    if stated:
        lows, highs = zip(*stated, strict=True)
        (xmin, ymin), (xmax, ymax) = (
            tuple(pick(corner[axis] for corner in corners) for axis in (0, 1))
            for pick, corners in ((min, lows), (max, highs))
        )
        where = f"it spans {xmin:.15g} {ymin:.15g} {xmax:.15g} {ymax:.15g}"
    system = "its own coordinates" if crs is None else crs.name
    return SurveyError(
        f"{title} has no point within extent {extent}: {where} ({system}); expected XMIN YMIN XMAX "
        "YMAX in the coordinates of the files"
    )


def listed(names: Sequence[str]) -> str:
    """Join names for a message: the first few, and how many more.

    Examples
    --------
    >>> listed(["a", "b", "c", "d", "e"])
    'a, b, c and 2 more'
    """
    if len(names) <= _LISTED + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])} and {len(names) - _LISTED} more"


def damage_of(errors: Sequence[ReadError], count: int) -> ReadError | SurveyError:
    """Say of a survey in several files which of them are damaged, and how to go on without."""
    if len(errors) == 1:
        error = errors[0]
        advice = f"{error.advice}, or go on without the file: --skip-damaged"
        return ReadError(error.path, error.reason, advice, error.location)
    each = "\n  ".join(str(error) for error in errors)
    return SurveyError(
        f"{len(errors)} of {count} files cannot be read; --skip-damaged goes on without them:\n"
        f"  {each}"
    )


def refuse_far(names: Sequence[str], middles: Sequence[Sequence[float]]) -> None:
    """Refuse files far from most others.

    Parameters
    ----------
    names : sequence of str
    middles : sequence of (float, float, float)
        Middle of each file's box.

    Raises
    ------
    SurveyError
        Names the files.
    """
    if len(middles) < 2:
        return
    usual = [sorted(axis)[len(middles) // 2] for axis in zip(*middles, strict=True)]
    away = [max(abs(middle[axis] - usual[axis]) for axis in (0, 1)) for middle in middles]
    far = [name for name, distance in zip(names, away, strict=True) if not distance < FAR]
    if far:
        raise SurveyError(
            f"{listed(far)} lies {max(away) / 1000:,.0f} km from the other files; expected one "
            "survey: is it in another coordinate reference system, or in local coordinates?"
        )
