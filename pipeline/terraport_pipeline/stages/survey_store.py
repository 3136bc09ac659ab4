"""A survey as the read stage leaves it in a work directory."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.stages.contract import Facts, Stored

__all__ = ["NAME", "restore"]

NAME: Final = "read"


def restore(stored: Stored, facts: Facts) -> Survey:
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
