"""The pictures of a landing: the mixed model as a client shows it, and its worst place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from terraport_payload.types import Bool
from terraport_pipeline.engines.cameras import Camera
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.published.landing_view import (
    Landing,
    mixed_mesh,
    view_from_above,
    view_from_eye,
)
from terraport_pipeline.published.scene_model import SceneModel
from terraport_pipeline.report.picture import Picture, PictureOptions, picture_of
from terraport_pipeline.report.pictures import PHOTO_RELIEF
from terraport_pipeline.report.traced_rays import TracedRays
from terraport_pipeline.validate.handoff_report import WorstRay
from terraport_pipeline.validate.worst_place import compare_at, describe, to_survey

__all__ = ["hand_off_pictures", "worst_place_picture"]


@dataclass(frozen=True, slots=True)
class _Mixed:
    """A picture of the mixed model, see :class:`Picture`."""

    key: str
    title: str
    alt: str
    caption: str
    is_tinted: bool = True


def hand_off_pictures(
    model: SceneModel, landing: Landing, detail_rays: RayScene, options: PictureOptions
) -> Iterator[Picture]:
    """Take the pictures of a landing: from above, and from eye height.

    Parameters
    ----------
    model : SceneModel
    landing : Landing
    detail_rays : RayScene
        Of the model's detail.
    options : PictureOptions

    Yields
    ------
    Picture
        The base is tinted blue where it is shown, but for one picture as a client shows it.
    """
    total = model.manifest.counts.segments
    loaded = int(landing.loaded.sum())
    yield from _mixed(
        model,
        options,
        view_from_above(landing, options.width / options.height),
        landing.loaded,
        _Mixed(
            "hand-off-above",
            "Hand-off from above",
            "The mixed model from above: full detail around the landing, the base tinted blue "
            "around it",
            f"A landing with a radius of {landing.radius_m:.0f} m: {loaded:,} of {total:,} "
            "segments loaded; the base, tinted blue, is shown wherever not all segments over "
            "it are.",
        ),
    )
    yield from _mixed(
        model,
        options,
        view_from_eye(landing, detail_rays),
        landing.loaded,
        _Mixed(
            "hand-off-eye-tinted",
            "Hand-off at eye height, base tinted",
            "The view of a visitor at the landing, the base tinted blue in the distance",
            "The same landing from eye height: where the blue begins, the base takes over.",
        ),
        _Mixed(
            "hand-off-eye",
            "Hand-off at eye height, as seen",
            "The view of a visitor at the landing, as a client shows it",
            "The same view as a client shows it.",
            is_tinted=False,
        ),
    )


def worst_place_picture(
    model: SceneModel,
    worst: WorstRay,
    options: PictureOptions,
    *,
    detail_rays: RayScene | None = None,
    base_rays: RayScene | None = None,
) -> Picture:
    """Take the picture of the place where the proof of the hand-off fared worst.

    Parameters
    ----------
    model : SceneModel
    worst : WorstRay
        From the proof.
    options : PictureOptions
    detail_rays, base_rays : RayScene, optional
        Of the model, where they are built already.

    Returns
    -------
    Picture
        Along the ray, from nearby: :func:`~terraport_pipeline.validate.worst_place.compare_at`.
    """
    image = compare_at(
        model,
        worst,
        supersample=options.supersample,
        detail_rays=detail_rays,
        base_rays=base_rays,
    )
    scene, survey = (
        ", ".join(f"{value:,.2f}" for value in position)
        for position in (worst.target, to_survey(model.manifest.origin, worst.target))
    )
    return picture_of(
        options.quality,
        "worst",
        "Worst place of the hand-off",
        "The place where the proof fared worst, ringed, three times side by side: the full "
        "detail, the mixed model, and how far the one lies behind the other",
        f"Where the proof fared worst ({describe(worst)}), ringed: at {scene} m in the scene, "
        f"{survey} in the survey's coordinates; seen along that ray ({worst.kind}), "
        f"{len(worst.loaded):,} segments loaded. Left the full detail, in the middle the mixed "
        "model with the base blue, right the distance between them: grey within the "
        "tolerance, blue nearer, orange further, magenta nothing there.",
        image,
    )


def _mixed(
    model: SceneModel, options: PictureOptions, camera: Camera, loaded: Bool, *asked: _Mixed
) -> Iterator[Picture]:
    """Draw the mixed model, once for each that is asked for."""
    mesh = mixed_mesh(model, loaded, camera, options.width / options.height)
    rays = RayScene(mesh.vertices, mesh.faces)
    if len(asked) > 1:
        rays = TracedRays(rays)
    for each in asked:
        image = render_mesh(
            mesh.vertices,
            mesh.faces,
            camera,
            (options.width, options.height),
            colours=mesh.colours,
            texturing=mesh.texturing,
            tint=mesh.tint if each.is_tinted else None,
            normals=mesh.normals,
            relief=PHOTO_RELIEF,
            # The two levels shade each other at the rim, which no client does.
            shadows=False,
            supersample=options.supersample,
            scene=rays,
        )
        yield picture_of(options.quality, each.key, each.title, each.alt, each.caption, image)
