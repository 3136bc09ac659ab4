"""The pictures of a report, each with the words that belong to it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.engines.cameras import Camera, oblique, top_down
from terraport_pipeline.engines.palettes import (
    DIVERGING_STOPS,
    distinct_colours,
    ramp_colours,
    value_range,
)
from terraport_pipeline.engines.pictures import render_mesh, render_points
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.texturing import Texturing
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.published.landing_view import (
    Landing,
    choose_landing,
)
from terraport_pipeline.published.scene_model import SceneModel
from terraport_pipeline.report.accuracy import Accuracy, draw_distances
from terraport_pipeline.report.change_map import change_colours, change_span_m
from terraport_pipeline.report.input_cloud import InputCloud
from terraport_pipeline.report.picture import Legend, Picture, PictureOptions, picture_of
from terraport_pipeline.report.plan_view import Plan, draw_plan
from terraport_pipeline.report.traced_rays import TracedRays

__all__ = ["PHOTO_RELIEF", "PictureTaker"]

PHOTO_RELIEF: Final = 0.55
"""Photographed colours hold the light of the day already."""

FLAT_RELIEF: Final = 0.8
"""Flat colours need the light to show the shape, but must stay apart in the shade."""

PLAN_SHARE: Final = 0.55
"""Pixels of the plan, of those of another picture: figures stand beside it."""

FRAMING_POINTS: Final = 20_000
"""Vertices looked at to frame the overview."""

MAX_ATTRIBUTES: Final = 4
"""Attributes drawn; further ones, and constant ones, are named in a table only."""

MAX_POINTS: Final = 3_000_000
"""Points of the input drawn; a larger cloud is thinned evenly."""


class PictureTaker:
    """Takes the pictures of one scene; trees of rays are built once, a view's rays traced once."""

    def __init__(self, model: SceneModel, options: PictureOptions | None = None) -> None:
        self._model = model
        self._options = options or PictureOptions()
        self.detail_rays = RayScene(model.detail.vertices, model.detail.faces)
        self.base_rays = RayScene(model.base.vertices, model.base.faces)
        # One camera takes the pictures of the whole: its rays are traced once.
        self._overview_rays = TracedRays(self.detail_rays)
        self._aspect = self._options.width / self._options.height
        vertices = model.detail.vertices
        self._thin = vertices[:: max(1, len(vertices) // FRAMING_POINTS)]
        self._camera = oblique(self._thin, aspect=self._aspect)
        self.landing: Landing = choose_landing(model, self.detail_rays)

    def plan(self) -> Plan:
        """Draw the scene from above, and keep what its rays met."""
        options = self._options
        pixels = round(PLAN_SHARE * options.width * options.height)
        return draw_plan(self._model, self.detail_rays, pixels, options.supersample)

    def plan_pictures(self, plan: Plan, accuracy: Accuracy | None) -> list[Picture]:
        """Make the pictures of the first screen: the plan, and the distances over it."""
        pictures = [
            picture_of(
                self._options.quality,
                "plan",
                "Plan",
                "The scene from straight above, north up, in its own colours",
                "",
                plan.image,
            )
        ]
        if accuracy is not None:
            image, top_m = draw_distances(accuracy, plan)
            pictures.append(
                picture_of(
                    self._options.quality,
                    "accuracy",
                    "Distance from the points to the mesh",
                    "The plan coloured by how far the survey's points lie from the mesh, from dark "
                    "violet (near) to yellow (far)",
                    "Mean distance in each cell.",
                    image,
                    Legend(0.0, top_m, "distance, m"),
                )
            )
        return pictures

    def overview(self, cloud: InputCloud | None = None) -> Iterator[Picture]:
        """Take the pictures of the whole scene, one after the other.

        Parameters
        ----------
        cloud : InputCloud, optional
            Drawn first where there is one.

        Yields
        ------
        Picture
            Input, detail, base, regions, segments, attributes; all from one camera.
        """
        counts, detail = self._model.manifest.counts, self._model.detail
        textures = self._model.textures
        if cloud is not None:
            yield self._input(cloud)
        yield self._detail_picture(
            "detail",
            "Full detail",
            "The full detail of the scene, seen obliquely from above",
            f"{counts.detail_faces:,} triangles in {counts.segments:,} segments; a client shows "
            f"those around its landing.{self._thinned()}",
            colours=detail.colours,
            texturing=None if textures is None else textures.detail,
            relief=PHOTO_RELIEF,
        )
        yield self._base()
        yield from self._labels()
        varied = [name for name, values in detail.attributes.items() if _varies(values)]
        for name in varied[:MAX_ATTRIBUTES]:
            yield self._attribute(name)

    def change(self, change: ChangeMap) -> Iterator[Picture]:
        """Take the pictures of what the last survey changed: from above, and as the overview's.

        Parameters
        ----------
        change : ChangeMap
            Of the survey that the scene was renewed by.

        Yields
        ------
        Picture
            Ground that did not change beyond doubt is grey.
        """
        span_m = change_span_m(change)
        colours = change_colours(change, self._model.detail, span_m)
        legend = Legend(-span_m, span_m, "height difference, m", DIVERGING_STOPS)
        yield self._detail_picture(
            "change-above",
            "Change since the survey before, from above",
            "The ground from above, north up, coloured by how far its height changed: red where it "
            "sank, blue where it rose, grey where no change is beyond doubt",
            f"Height differences, metres, in cells of {change.cell_m:.3g} m: red where the ground "
            "sank (cut), blue where it rose (fill), the stronger the more; the ends of the ramp "
            "hold 99 % of them. Grey: no change beyond doubt, or within the level of detection at "
            "95 % of its cell. North is up.",
            face_colours=colours,
            relief=FLAT_RELIEF,
            legend=legend,
            camera=top_down(self._thin, aspect=self._aspect),
        )
        yield self._detail_picture(
            "change",
            "Change since the survey before",
            "The same colours on the ground seen obliquely from above",
            "The same, seen as in the other pictures of the whole.",
            face_colours=colours,
            relief=FLAT_RELIEF,
            legend=legend,
        )

    def _input(self, cloud: InputCloud) -> Picture:
        step = max(1, -(-len(cloud.points) // MAX_POINTS))
        options = self._options
        # One pixel per pixel: a splat has no edge worth smoothing.
        image = render_points(
            cloud.points[::step],
            cloud.colours[::step],
            self._camera,
            (options.width, options.height),
            spacing_m=cloud.spacing_m * step**0.5,
        )
        shown = len(cloud.points[::step])
        share = "" if shown == cloud.total else f", of which {shown:,} are drawn"
        return picture_of(
            self._options.quality,
            "input",
            "Input",
            "The survey's point cloud, seen obliquely from above",
            f"{cloud.total:,} points{share}.",
            image,
        )

    def _base(self) -> Picture:
        base, counts = self._model.base, self._model.manifest.counts
        options, textures = self._options, self._model.textures
        image = render_mesh(
            base.vertices,
            base.faces,
            self._camera,
            (options.width, options.height),
            colours=base.colours,
            texturing=None if textures is None else textures.base,
            relief=PHOTO_RELIEF,
            supersample=options.supersample,
            scene=self.base_rays,
        )
        share = counts.base_faces / max(1, counts.detail_faces)
        return picture_of(
            self._options.quality,
            "base",
            "Base mesh",
            "The base mesh of the scene, seen obliquely from above",
            f"{counts.base_faces:,} triangles ({share:.1%} of the detail), always there.",
            image,
        )

    def _thinned(self) -> str:
        """Say how much of a scene larger than memory the overview is drawn with."""
        drawn, total = len(self._model.detail.faces), self._model.manifest.counts.detail_faces
        return "" if drawn >= total else f" Drawn here, and below, with {drawn:,} triangles."

    def _likeness(self) -> str:
        """Name what the build cut the surface by, where it says so."""
        options = self._model.manifest.build.options.get("segment")
        by = options.get("segment_by") if isinstance(options, dict) else None
        return by if isinstance(by, str) else "material"

    def _labels(self) -> Iterator[Picture]:
        model, counts = self._model, self._model.manifest.counts
        region = model.region_of_face
        if (region >= 0).any():
            yield self._detail_picture(
                "regions",
                "Regions",
                "The detail with each region in a colour of its own",
                f"{counts.regions:,} regions: pieces of like {self._likeness()}; a pick names one.",
                face_colours=distinct_colours(int(region.max()) + 1)[np.maximum(region, 0)],
                relief=FLAT_RELIEF,
            )
        yield self._detail_picture(
            "segments",
            "Segments",
            "The detail with each segment in a colour of its own",
            f"{counts.segments:,} segments: the pieces that are streamed.",
            face_colours=distinct_colours(counts.segments)[model.segment_of_face],
            relief=FLAT_RELIEF,
        )

    def _attribute(self, name: str) -> Picture:
        values = self._model.detail.attributes[name]
        low, high = value_range(values)
        missing = float(np.isnan(values).mean())
        gap = f" {missing:.1%} of the vertices have no value (grey)." if missing else ""
        return self._detail_picture(
            f"attribute-{name}",
            f"Attribute {name}",
            f"The detail coloured by {name}, from dark violet (low) to yellow (high)",
            f"{name} from {low:.4g} to {high:.4g} (1st and 99th percentile).{gap}",
            colours=ramp_colours(values, low, high),
            relief=FLAT_RELIEF,
            legend=Legend(low, high, name),
        )

    def _detail_picture(
        self,
        key: str,
        title: str,
        alt: str,
        caption: str,
        *,
        relief: float,
        colours: UInt8 | None = None,
        texturing: Texturing | None = None,
        face_colours: UInt8 | None = None,
        legend: Legend | None = None,
        camera: Camera | None = None,
    ) -> Picture:
        """Draw the detail; from the overview's camera where no other is given."""
        detail, options = self._model.detail, self._options
        image = render_mesh(
            detail.vertices,
            detail.faces,
            camera or self._camera,
            (options.width, options.height),
            colours=colours,
            texturing=texturing,
            face_colours=face_colours,
            normals=detail.normals,
            relief=relief,
            supersample=options.supersample,
            scene=self._overview_rays,
        )
        return picture_of(self._options.quality, key, title, alt, caption, image, legend)


def _varies(values: Float32) -> bool:
    low, high = value_range(values)
    return high > low
