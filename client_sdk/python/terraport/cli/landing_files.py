"""What ``terraport land`` writes: the landing as a model, and as a picture."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, Final

from terraport.base import BaseMesh
from terraport.errors import MissingExtraError
from terraport.http import scales_of
from terraport.landing import Landing
from terraport.mesh import mixed_model, write_glb
from terraport.obj import write_obj
from terraport.textures import vertex_colours
from terraport_payload import SegmentMesh

__all__ = ["require_pictures", "write_landing"]

_PICTURE: Final = (1280, 720)
"""Width and height of ``--png`` in pixels."""
_PHOTO_RELIEF: Final = 0.4
"""Photographed colours hold the light of the day already: shade softly, cast no shadows."""


def require_pictures() -> None:
    """Say before a landing, not after it, that pictures need an extra."""
    try:
        importlib.import_module("terraport_pipeline.engines.pictures")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("terraport"):
            raise
        raise MissingExtraError("--png", "terraport[pipeline]") from None


def write_landing(
    base: BaseMesh,
    landing: Landing,
    manifest: dict[str, Any],
    *,
    glb: Path | None,
    png: Path | None,
) -> list[dict[str, Any]]:
    """Write what a viewer would draw here: base and detail, as one mesh.

    Runs in a thread: decoding and writing some million faces would hold the connection up.
    """
    segments = {segment.id: segment.arrays() for segment in landing.segments}
    deviation_m = float(manifest["hand_off"]["deviation_m"])
    written = []
    if glb is not None:
        # Sunk at the rim, since a file has no eye to push the base away from.
        model = mixed_model(base, segments, landing.hidden_faces, sink_rim_m=deviation_m)
        scales = scales_of(manifest)
        if glb.suffix.lower() == ".obj":
            size = write_obj(model, glb)
        else:
            size = write_glb(model, glb, step_m=manifest["step_m"], attribute_scales=scales)
        written.append({"file": str(glb), "bytes": size, "triangles": len(model.faces)})
    if png is not None:
        _write_picture(base, segments, landing, deviation_m, png)
        written.append({"file": str(png), "bytes": png.stat().st_size})
    return written


def _write_picture(
    base: BaseMesh,
    segments: dict[int, SegmentMesh],
    landing: Landing,
    deviation_m: float,
    path: Path,
) -> None:
    """Draw the landing obliquely from above."""
    import numpy as np

    from terraport_pipeline.engines.cameras import oblique
    from terraport_pipeline.engines.pictures import render_mesh, save_png

    width, height = _PICTURE
    boxes = np.array([segment.bounds for segment in landing.segments], dtype=np.float64)
    corners = boxes.reshape(-1, 3) if len(boxes) else base.mesh.positions
    camera = oblique(corners, aspect=width / height)
    model = mixed_model(
        base, segments, landing.hidden_faces, push_back_m=deviation_m, eye=camera.eye
    )
    picture = render_mesh(
        model.positions,
        model.faces.astype(np.int32),
        camera,
        _PICTURE,
        colours=vertex_colours(model),
        normals=model.normals,
        relief=_PHOTO_RELIEF,
        shadows=False,
        supersample=2,
    )
    save_png(picture, path)
