"""The picture of the place where the proof of the hand-off fared worst.

Three panels from one camera: the full detail, the mixed model as a client draws it, and how far the
one lies behind the other. A hole shows as magenta in the third, so nobody has to guess.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from terraport_payload.types import AnyFloat, Bool, Float32, UInt8
from terraport_pipeline.engines.cameras import Camera
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.handoff_rays import hidden_base_faces
from terraport_pipeline.published.landing_view import mixed_mesh
from terraport_pipeline.published.mixed_model import ShownFaces
from terraport_pipeline.published.scene_model import SceneModel
from terraport_pipeline.validate.handoff_report import WorstRay

__all__ = ["compare_at", "describe", "difference_colours", "sight_of", "to_survey"]

NEAREST_VIEW_M: Final = 12.0
VIEW_TOLERANCES: Final = 30.0
"""Seen from at most this far: the larger of 12 m and 30 tolerances, so that a coarse scene shows
more than one base face."""

PHOTO_RELIEF: Final = 0.55
GAP_PX: Final = 6
"""White between the panels."""
LINE_PX: Final = 22
"""Height of the words over them."""

SAME: Final = np.array([205, 205, 205], dtype=np.float32)
NEARER: Final = np.array([40, 90, 200], dtype=np.float32)
FURTHER: Final = np.array([235, 120, 20], dtype=np.float32)
NOTHING: Final = np.array([230, 0, 200], dtype=np.float32)
SKY: Final = np.array([255, 255, 255], dtype=np.float32)
FULL_COLOUR: Final = 4.0
"""Tolerances of difference that get the full colour."""


def describe(worst: WorstRay) -> str:
    """Say in words what was found at the worst place."""
    if worst.verdict == "hole":
        return "a hole"
    far = f"{worst.distance_m:.3g} m from the full detail"
    if not np.isfinite(worst.distance_m):
        far = "nothing within reach"
    return far if worst.verdict == "distance" else f"no hole: a strict miss, excused; {far}"


def to_survey(
    origin: tuple[float, float, float], position: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Turn a place of the scene into easting, northing and height.

    Parameters
    ----------
    origin : (float, float, float)
        E0, N0, H0 of the manifest, metres.
    position : (float, float, float)
        x, y, z, metres, scene frame.

    Returns
    -------
    (float, float, float)

    Examples
    --------
    >>> to_survey((500.0, 8000.0, 100.0), (1.0, 2.0, 3.0))
    (501.0, 7997.0, 102.0)
    """
    return origin[0] + position[0], origin[1] - position[2], origin[2] + position[1]


def sight_of(worst: WorstRay, tolerance_m: float) -> Camera:
    """Look along a ray at the place where it meets the detail.

    Parameters
    ----------
    worst : WorstRay
        From the proof.
    tolerance_m : float
        The scene's; a coarse scene is looked at from further away.

    Returns
    -------
    Camera
        On the ray, at most as far from the place as the ray's own start.
    """
    heading, target = np.array(worst.direction), np.array(worst.target)
    furthest = max(NEAREST_VIEW_M, VIEW_TOLERANCES * tolerance_m)
    distance = min(float(np.linalg.norm(target - np.array(worst.origin))), furthest)
    eye = target - heading * distance
    # Looking straight down has no bearing of its own: north up.
    level = np.hypot(heading[0], heading[2])
    right = np.array([-heading[2], 0, heading[0]]) / level if level > 1e-6 else np.eye(3)[0]
    up = np.cross(right, heading)
    return Camera("perspective", _triple(eye), _triple(right), _triple(up), _triple(heading), 0.45)


def compare_at(
    model: SceneModel,
    worst: WorstRay,
    *,
    size: tuple[int, int] = (560, 420),
    supersample: int = 2,
    detail_rays: RayScene | None = None,
    base_rays: RayScene | None = None,
) -> UInt8:
    """Draw full detail, mixed model and their difference side by side.

    Parameters
    ----------
    model : SceneModel
        The scene.
    worst : WorstRay
        The place, and the segments loaded.
    size : (int, int)
        Width and height of one panel, pixels.
    supersample : int
        Rays per pixel and axis of the first two panels.
    detail_rays, base_rays : RayScene, optional
        The two meshes, where they are built already.

    Returns
    -------
    ndarray of shape (height + 22, 3 * width + 12, 3), uint8
        sRGB. The place is ringed. Third panel: grey within the tolerance, blue nearer than the full
        detail, orange further, full colour at four tolerances, magenta where the mixed model shows
        nothing.
    """
    # (1) Where to look from, and the two meshes to look at.
    tolerance_m = model.manifest.hand_off.tolerance_m
    camera = sight_of(worst, tolerance_m)
    loaded = np.zeros(len(model.segment_bounds), dtype=np.bool_)
    loaded[list(worst.loaded)] = True
    detail_scene = detail_rays or RayScene(model.detail.vertices, model.detail.faces)
    base_scene = base_rays or RayScene(model.base.vertices, model.base.faces)
    # (2) Both pictures by the same camera and light.
    full = render_mesh(
        model.detail.vertices,
        model.detail.faces,
        camera,
        size,
        colours=model.detail.colours,
        texturing=None if model.textures is None else model.textures.detail,
        normals=model.detail.normals,
        relief=PHOTO_RELIEF,
        shadows=False,
        supersample=supersample,
        scene=detail_scene,
    )
    mesh = mixed_mesh(model, loaded, camera, size[0] / size[1])
    mixed = render_mesh(
        mesh.vertices,
        mesh.faces,
        camera,
        size,
        colours=mesh.colours,
        texturing=mesh.texturing,
        tint=mesh.tint,
        normals=mesh.normals,
        relief=PHOTO_RELIEF,
        shadows=False,
        supersample=supersample,
    )
    # (3) Their difference in depth, in colour.
    full_t, mixed_t = _depths(model, loaded, camera, size, (detail_scene, base_scene))
    difference = difference_colours(full_t, mixed_t, tolerance_m).reshape(size[1], size[0], 3)
    most = f"{FULL_COLOUR * tolerance_m:.3g} m"
    words = (
        "full detail",
        f"mixed model ({len(worst.loaded):,} segments, base blue)",
        f"mixed behind full: blue nearer, orange further ({most}), magenta nothing",
    )
    return _side_by_side((full, mixed, difference), words)


def difference_colours(full_t: Float32, mixed_t: Float32, tolerance_m: float) -> UInt8:
    """Colour how far the mixed model lies behind the full detail.

    Parameters
    ----------
    full_t, mixed_t : ndarray of shape (N,), float32
        Metres along each line of sight; ``inf`` where nothing is met.
    tolerance_m : float
        Up to which the two count as the same.

    Returns
    -------
    ndarray of shape (N, 3), uint8
        See :func:`compare_at`.

    Examples
    --------
    >>> import numpy as np
    >>> full = np.array([5.0, 5.0, np.inf], np.float32)
    >>> mixed = np.array([5.0, np.inf, np.inf], np.float32)
    >>> difference_colours(full, mixed, 0.1).tolist()
    [[205, 205, 205], [230, 0, 200], [255, 255, 255]]
    """
    out = np.empty((len(full_t), 3), dtype=np.float32)
    met, shown = np.isfinite(full_t), np.isfinite(mixed_t)
    both = met & shown
    behind = np.zeros(len(full_t), dtype=np.float32)
    behind[both] = mixed_t[both] - full_t[both]
    beyond = np.maximum(np.abs(behind) - tolerance_m, 0) / ((FULL_COLOUR - 1) * tolerance_m)
    # A step at the tolerance, so that what lies just beyond it stands out from what does not.
    share = np.where(beyond > 0, 0.25 + 0.75 * np.minimum(beyond, 1), 0)[:, None]
    out[:] = SAME + (np.where((behind > 0)[:, None], FURTHER, NEARER) - SAME) * share
    out[~met & shown] = NEARER  # base before the full detail's sky
    out[met & ~shown] = NOTHING
    out[~met & ~shown] = SKY
    return np.round(out).astype(np.uint8)


def _depths(
    model: SceneModel,
    loaded: Bool,
    camera: Camera,
    size: tuple[int, int],
    scenes: tuple[RayScene, RayScene],
) -> tuple[Float32, Float32]:
    """Metres to the full detail and to the mixed model (base not pushed back), per pixel."""
    origins, headings = camera.rays(*size)
    first = scenes[0].closest_hit(origins, headings)
    hidden = hidden_base_faces(model.cover.offsets, model.cover.segments, loaded)
    detail = ShownFaces(scenes[0], loaded[model.segment_of_face])
    base = ShownFaces(scenes[1], ~hidden)
    mixed_t = np.minimum(detail.closest(origins, headings, first), base.closest(origins, headings))
    return first[0], mixed_t


def _side_by_side(panels: tuple[UInt8, ...], words: tuple[str, ...]) -> UInt8:
    height, width = panels[0].shape[:2]
    whole = Image.new("RGB", (len(panels) * (width + GAP_PX) - GAP_PX, height + LINE_PX), "white")
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(13)
    for number, (panel, text) in enumerate(zip(panels, words, strict=True)):
        left = number * (width + GAP_PX)
        whole.paste(Image.fromarray(panel), (left, LINE_PX))
        draw.text((left + 4, 3), text, fill="black", font=font)
        middle, reach = (left + width / 2, LINE_PX + height / 2), height / 12
        for colour, line in (("black", 4), ("white", 2)):  # shows on any ground
            draw.circle(middle, reach, outline=colour, width=line)
    return np.asarray(whole)


def _triple(vector: AnyFloat) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
