"""Measures of regions seen from above: plan area, and volumes at their toe.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from terraport_pipeline.geometry.volumes.toe_volumes import SurveyNoise, toe_volumes
from terraport_pipeline.geometry.volumes.top_surface import TopSurface

__all__ = ["MAX_VOLUMES", "RASTER", "measure_plan", "with_plan"]

MAX_VOLUMES: Final = 500
"""Maximum number of regions with volumes, the largest ones: each takes about 10 ms."""

RASTER: Final = "volume_raster"
"""Key of regions.json for the raster on which volumes were measured."""

_DECIMALS: Final = 3
"""Decimals of areas and volumes: litres."""


def measure_plan(
    top: TopSurface, survey: SurveyNoise | None, wanted: Collection[int] | None = None
) -> dict[str, Any]:
    """Measure regions over the highest surface.

    Parameters
    ----------
    top : TopSurface
        Raster of the whole scene.
    survey : SurveyNoise or None
        None for a mesh, whose points are not known: its volumes have no uncertainty.
    wanted : collection of int, optional
        Only these regions.

    Returns
    -------
    dict
        ``hidden_m2``, by region; ``volumes``, by region as text; ``raster``. For :func:`with_plan`.
    """
    counts = np.bincount(top.region[top.region >= 0], minlength=len(top.hidden_m2))
    largest = np.argsort(-counts, kind="stable")[:MAX_VOLUMES].tolist()
    numbers = largest if wanted is None else [n for n in largest if n in wanted]
    volumes = toe_volumes(
        top.height_m, top.region, top.cell_m, numbers, survey, empty_m=top.empty_m
    )
    return {
        "hidden_m2": np.round(top.hidden_m2, _DECIMALS).tolist(),
        "volumes": {
            str(number): {
                key: round(value, _DECIMALS)
                for key, value in asdict(volume).items()
                if value is not None
            }
            for number, volume in sorted(volumes.items())
        },
        "raster": {
            "cell_m": top.cell_m,
            **({} if survey is None else asdict(survey)),
        },
    }


def with_plan(document: Mapping[str, Any], measured: Mapping[str, Any]) -> dict[str, Any]:
    """Add the results of :func:`measure_plan` to the contents of regions.json.

    Parameters
    ----------
    document : mapping
        Not modified. Its ``plan_area_m2`` are the areas of the triangles in plan.
    measured : mapping
    """
    volumes, regions = measured["volumes"], []
    for row in document["regions"]:
        number = row["id"]
        plan_m2 = max(row["plan_area_m2"] - measured["hidden_m2"][number], 0.0)
        volume = volumes.get(str(number))
        regions.append(
            {
                **row,
                "plan_area_m2": round(plan_m2, _DECIMALS),
                **({} if volume is None else {"volume": volume}),
            }
        )
    return {
        **{key: value for key, value in document.items() if key != "regions"},
        RASTER: measured["raster"],
        "regions": regions,
    }
