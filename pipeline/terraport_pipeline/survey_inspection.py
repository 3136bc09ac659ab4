"""``terraport inspect`` for surveys: which files, how many points, where, in which CRS.

Only headers are read, so a delivery of any size answers within seconds.
"""

from __future__ import annotations

from typing import Any

from terraport_pipeline.engines.readers.survey_stream import survey_size
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey_files import OUTSIDE, SurveyFiles, one_crs

__all__ = ["inspect_survey"]


def inspect_survey(survey: SurveyFiles) -> dict[str, Any]:
    """Describe a survey by the headers of its files.

    Parameters
    ----------
    survey : SurveyFiles
        From :func:`~terraport_pipeline.survey_files.find_survey`.

    Returns
    -------
    dict
        Plain values, ready for JSON: ``name``, ``points`` (of text and PCD estimated by size),
        ``bytes``, ``crs``, ``bounds`` (None where a header does not say it; in the files' unit),
        ``files`` (each with ``name``, ``format``, ``points``, ``bytes``, ``bounds``) and
        ``left_out`` (``name``, ``reason``, ``damaged``). With an extent only of files that touch
        it, and ``within``: its ``values``, about how many ``points`` lie in it, and how many are
        ``read`` for that.

    Raises
    ------
    SurveyError, ReadError
        As :meth:`~terraport_pipeline.survey_files.SurveyFiles.heads`.
    """
    survey, heads = survey.heads(NullProgress())
    bounds = [
        None if head.low is None or head.high is None else [list(head.low), list(head.high)]
        for head in heads
    ]
    stated = [corners for corners in bounds if corners is not None]
    whole = None
    if len(stated) == len(bounds):
        lows, highs = zip(*stated, strict=True)
        whole = [[min(axis) for axis in zip(*lows, strict=True)],
                 [max(axis) for axis in zip(*highs, strict=True)]]  # fmt: skip
    within = None
    if survey.extent is not None:
        rows = [head.points if head.rows is None else head.rows for head in heads]
        about = survey_size(heads, survey.extent).points
        within = {"values": [*survey.extent.values], "points": about, "read": sum(rows)}
    names = [file.name for file in survey.files]
    crs = one_crs(list(zip(names, (head.crs for head in heads), strict=True)))
    return {
        "name": survey.title,
        "points": survey_size(heads).points,
        "bytes": survey.size_bytes,
        "crs": None if crs is None else {"name": crs.name, "epsg": crs.to_epsg()},
        "bounds": whole,
        **({} if within is None else {"within": within}),
        "files": [
            {
                "name": file.name,
                "format": file.format,
                "points": head.points,
                "bytes": file.bytes,
                "bounds": corners,
            }
            for file, head, corners in zip(survey.files, heads, bounds, strict=True)
        ],
        "left_out": [
            *({"name": n, "reason": why, "damaged": True} for n, why in survey.damaged),
            *({"name": n, "reason": why, "damaged": False} for n, why in survey.ignored),
            *({"name": n, "reason": OUTSIDE, "damaged": False} for n, _ in survey.outside),
        ],
    }
