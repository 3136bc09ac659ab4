"""Read a survey of any supported format into memory.

The content decides the format, the file name only where the content cannot (text). The same for
all: points without finite coordinates are dropped and counted, coordinates are brought to metres,
and traps that ruin a scene (degrees, 32-bit coordinates, no colour) are refused or named. Points
come in the order of :mod:`.read_streamed`, which does the reading.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.survey.survey_files import SurveyFiles

__all__ = ["read_survey"]


def read_survey(
    survey: SurveyFiles | Path | str,
    *,
    progress: Progress | None = None,
    max_points: int | None = None,
    share: float = 1.0,
) -> Survey:
    """Read a survey.

    Parameters
    ----------
    survey : SurveyFiles or path
        LAS, LAZ, COPC, PLY, PCD, E57, PTX, or text (XYZ, CSV, TXT, ASC, PTS).
    progress : Progress, optional
        Receives the number of points read (bytes, for text and for several files).
    max_points : int, optional
        Thin the cloud to this many points, evenly over the ground and the same ones each time;
        None reads all. At least 1.
    share : float
        Read about this share of each file, as a preview of a survey that is too large.

    Returns
    -------
    Survey
        Points in metres; every further value per point as an attribute in the files' dtype.
        Surveys in feet are converted to metres (with a warning), and their CRS becomes the same
        projection in metres.

    Raises
    ------
    ReadError
        When a file is missing, empty, of no known format, cut off or damaged, without x, y, z,
        without one finite point, or in degrees.
    SurveyError
        When several files are no one survey.
    OptionError
        When `max_points` is not positive.
    """
    with tempfile.TemporaryDirectory(prefix="terraport-read-") as scratch:
        folder = Path(scratch)
        values, facts = read_streamed.run(
            SurveyFiles.of(survey),
            folder,
            Context(folder, progress or NullProgress()),
            max_points=max_points,
            bounded=False,
            share=share,
        )
        arrays = {path.stem: np.load(path) for path in folder.glob("*.npy")}
    return _survey_of(Stored(arrays, values), facts)


def _survey_of(stored: Stored, facts: Facts) -> Survey:
    """Turn the columns and values that :mod:`.read_streamed` wrote into a survey in memory."""
    arrays, values = stored.arrays, stored.values
    return Survey(
        points=np.asarray(arrays["points"], dtype=np.float64),
        colours=np.asarray(arrays["colours"], dtype=np.uint8) if "colours" in arrays else None,
        attributes={name: arrays[f"attribute-{i}"] for i, name in enumerate(values["attributes"])},
        crs=Crs(**values["crs"]) if values["crs"] else None,
        format=values["format"],
        warnings=facts.warnings,
        whole=tuple(values.get("whole", ())),
    )
