"""Whether files are one survey: in one CRS, near each other, undamaged; else how it is said."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.extent import Extent

__all__ = ["FAR", "OUTSIDE", "damage_of", "listed", "nothing_within", "one_crs", "refuse_far"]

OUTSIDE: Final = "lies outside the extent"
"""Why a file is not read, or nothing of it is taken."""

_LISTED: Final = 3
"""Names in a message; of the others the number."""

FAR: Final = 100_000.0
"""Files of one survey lie nearer to each other than this, in metres or the CRS's unit."""


def one_crs(files: Sequence[tuple[str, Any | None]], advice: str = "") -> Any | None:
    """Find the coordinate reference system that all files which state one agree on.

    Parameters
    ----------
    files : sequence of (str, pyproj.CRS or None)
        Name of every file, and what it states.
    advice : str
        What else can be done where they differ.

    Returns
    -------
    pyproj.CRS or None
        None where no file states one.

    Raises
    ------
    SurveyError
        Two state different ones; names the files of each.
    """
    groups: list[tuple[Any, list[str]]] = []
    known: dict[str, list[str]] = {}  # the comparison of two systems is slow, that of texts is not
    for name, crs in files:
        if crs is None:
            continue
        text = crs.srs
        if text not in known:
            group = next((names for other, names in groups if other == crs), None)
            if group is None:
                group = []
                groups.append((crs, group))
            known[text] = group
        known[text].append(name)
    if len(groups) > 1:
        stated = "; ".join(f"{crs.name} in {listed(names)}" for crs, names in groups)
        raise SurveyError(
            f"the files are in {len(groups)} coordinate reference systems ({stated}); expected "
            f"one: reproject some (PDAL filters.reprojection, las2las), or build them apart{advice}"
        )
    return groups[0][0] if groups else None


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
