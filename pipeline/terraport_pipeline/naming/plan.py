"""From a file of outlines to a scene that is cut along them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import survey_frame
from terraport_pipeline.naming.drawings import read_drawings
from terraport_pipeline.naming.outlines import cut_along, with_width
from terraport_pipeline.naming.recut import recut
from terraport_pipeline.naming.republish import Republished, republish
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.ground import read_ground
from terraport_store import Scene

__all__ = ["label_by_plan", "published_text"]

_LISTED = 8


def label_by_plan(
    path: Path,
    plan: Path,
    progress: Progress,
    *,
    name_field: str | None = None,
    buffer_m: float | None = None,
    layer: str | None = None,
    crs: str | None = None,
) -> list[str]:
    """Cut the regions of a scene along a plan, name them, and publish.

    Parameters
    ----------
    path : Path
        Scene directory.
    plan : Path
        GeoJSON, Shapefile, GeoPackage, DXF.
    progress : Progress
    name_field, layer, crs
        See :func:`.drawings.read_drawings`.
    buffer_m : float, optional
        Of open lines, to either side.

    Returns
    -------
    list of str
        What was done, and what was left out.

    Raises
    ------
    PlanError, OptionError
        The plan cannot be used; nothing was changed.
    SceneStoreError
        The scene cannot be read, or not be published.
    """
    if buffer_m is not None and not (np.isfinite(buffer_m) and buffer_m > 0):
        raise OptionError(f"--buffer-m {buffer_m}; expected metres above 0")
    with Scene.open(path) as scene:
        frame = survey_frame(scene.manifest)
        drawings = read_drawings(plan, frame, crs=crs, layer=layer, name_field=name_field)
        areas = with_width(drawings, buffer_m)
        ground = read_ground(scene, progress)
        outlined = cut_along(ground, str(plan), areas)
        done = republish(scene, ground, recut(ground, outlined.cut), progress)
    named = len(outlined.cut.names)
    by = f", by {drawings.name_field!r}" if drawings.name_field and named else ""
    said = [
        f"{len(areas) - len(outlined.empty)} outlines of {plan}, {named} with a name{by}",
        published_text(done),
    ]
    if drawings.name_field is None:
        said.append("warning: no property name, label or layer: nothing was named (--name-field)")
    else:
        nameless = sum(d.name is None for d in areas)
        if nameless:
            said.append(
                f"warning: {nameless} of {len(areas)} outlines are empty in "
                f"{drawings.name_field!r}: they became regions without a name"
            )
    if frame.crs is None:
        said.append("warning: the scene states no CRS: coordinates were taken as they are")
    if outlined.shared_m2 > 0:
        said.append(
            f"{outlined.shared_m2:,.0f} m² lie in several outlines and went to the smallest"
        )
    if outlined.empty:
        listed = ", ".join(outlined.empty[:_LISTED])
        more = len(outlined.empty) - _LISTED
        said.append(
            f"warning: {len(outlined.empty)} outlines got no ground, being outside the scene, "
            f"smaller than a triangle or under smaller ones: {listed}"
            + (f" and {more} more" if more > 0 else "")
        )
    if drawings.skipped:
        said.append(f"left out: {', '.join(drawings.skipped)}")
    return said


def published_text(done: Republished) -> str:
    """Say what became of a scene."""
    return (
        f"{done.regions} regions, {done.kept} of them with the stable id that they had; "
        f"{done.segments_changed} of {done.segments} segments are loaded again "
        f"(version {done.version[:12]})"
    )
