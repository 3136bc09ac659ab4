"""The survey's coordinate reference system and its place on the Earth, for people."""

from __future__ import annotations

from terraport_pipeline.crs_axes import code_of
from terraport_pipeline.export.frame import survey_frame
from terraport_store import Manifest
from terraport_store.tiles.placing import place_scene

__all__ = ["crs_line", "tiles_line"]


def crs_line(manifest: Manifest) -> tuple[str, bool]:
    """Return the name and code of the survey's CRS, and whether there is one.

    For a survey in feet, or with axes to the south and west, this is its own CRS, not the one that
    the scene is built in.
    """
    info = manifest.crs
    if info is None:
        return "none stated (build with --crs EPSG:n to add it)", False
    name, code = info.name, info.epsg
    if manifest.survey_units is not None and manifest.survey_units.crs_wkt:
        own = survey_frame(manifest).crs
        if own is not None:
            name, code = own.name, code_of(own)
    return (f"{name} (EPSG:{code})" if code else name), True


def tiles_line(manifest: Manifest) -> str:
    """Say how other viewers open the scene as 3D Tiles, and whether it has its place on Earth."""
    placing = place_scene(manifest)
    where = "on its place on the Earth"
    if placing.is_local:
        where = f"local (east, north, up): {placing.why_local}"
    return (
        f"{where}; /scenes/NAME/tileset.json of the service, or a file of them: terraport export "
        "SCENE -o FILE.3tz"
    )
