"""One segment (or the base) with its atlas: charts, packing, baking, the image file."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, UInt8, UInt16
from terraport_pipeline.engines.images import encode_image
from terraport_pipeline.engines.mesh_texels import Picture
from terraport_pipeline.geometry.photos.lens import PACKED, View
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET, neutral_gains
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.geometry.textures.atlas_pack import Atlas, pack_charts
from terraport_pipeline.geometry.textures.bake import (
    FaceColours,
    bake_photo_faces,
    bake_plain_faces,
)
from terraport_pipeline.geometry.textures.chart_room import charts_with_room, flat_colours
from terraport_pipeline.geometry.textures.charts import Charts
from terraport_pipeline.geometry.textures.gutters import fill_cells
from terraport_pipeline.geometry.textures.texel_places import texel_places
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.texture import ImageFormat
from terraport_pipeline.stages.choose_views import Photos

__all__ = ["AtlasMaker", "BakedAtlas"]


_RIM_TEXELS: Final = 1.5
"""Beyond its rim a chart goes on as its photo does for as far as a sample at the rim reads; further
out the gutter is filled with averages."""

_QUALITIES: Final = (80, 75, 70, 65, 60, 55, 50, 40, 30, 20)
"""Of JPEG and WebP, tried one after the other where an image has more bytes than it may."""

_MAX_PHOTO_SCALE: Final = 8
"""Photos are decoded at down to this part of their size, as JPEG decoders do at once."""


@dataclass(frozen=True, slots=True, eq=False)
class BakedAtlas:
    """The texture of one mesh of F faces."""

    wedges: UInt16
    """(F, 3, 2) corners in the image, half texels from its upper left."""
    image: bytes
    """Bytes of the encoded image file."""
    width: int
    height: int
    surface_m2: Float64
    """(F,) area of each face."""
    texels: Float64
    """(F,) area of each face in the image, texels."""
    gsd_m: Float64
    """(F,) length of a photo's pixel on each face; NaN without a photo."""
    flat: Bool
    """(F,) faces of one flat colour, that of their vertices: without area, as small as a texel or
    two and in no photo, or without room. They have no texels."""
    crowded: Bool
    """(F,) those without room."""
    chart_faces: Int32
    """(charts,) faces of each chart."""
    view: Int32
    """(F,) photo that colours each face; -1 none."""
    use: float
    """Share of the image within cells of charts."""

    @property
    def charts(self) -> int:
        """Number of charts."""
        return len(self.chart_faces)


@dataclass(frozen=True, slots=True, eq=False)
class AtlasMaker:
    """Makes atlases of pieces of one mesh. Thread-safe as far as the photos are."""

    mesh: Mesh
    views: Sequence[View | Picture]
    photos: Photos | None
    """None: everything from vertex colours."""
    choice: ViewChoice | None
    """Of all faces of the mesh; None where there are no photos."""
    texel_m: float | None
    """Length of a texel; None: as fine as the photos."""
    kind: ImageFormat
    quality: int
    colour_at: Callable[[Float32], UInt8] | None = None
    """Gives places (N, 3) in metres their sRGB (N, 3); what no photo colours is then drawn texel by
    texel, not from the vertices' colours."""
    max_bytes: int | None = None
    """Bytes of an image file, at most: its quality is lowered as far as it takes."""
    pixels: Float32 | None = None
    """(F, 3, 2) corners of all faces in their photos, where these are a mesh's own images."""

    def make(self, faces: AnyInt, *, max_side: int) -> BakedAtlas:
        """Make the atlas of some faces.

        Parameters
        ----------
        faces : ndarray of shape (K,), integer
            Numbers of faces of the mesh.
        max_side : int
            Longest side of the image, texels.

        Returns
        -------
        BakedAtlas
            In the order of *faces*.
        """
        # (1) The piece alone: its vertices renumbered, its faces' colours.
        used, local = np.unique(self.mesh.faces[faces], return_inverse=True)
        corners = local.reshape(-1, 3).astype(np.int32)
        points = self.mesh.vertices[used].astype(np.float64)
        colours = self._colours(faces, corners, used)
        packed = np.array([view.packed() for view in self.views]).reshape(-1, PACKED)
        # (2) Charts for faces with a photo, fine as the photos are, coarser where the image would
        # be too large; a shared cell for every colour of faces without one.
        roomy = charts_with_room(
            points, corners, colours.view, packed, texel_m=self.texel_m, max_side=max_side,
            pixels=None if self.pixels is None else self.pixels[faces],
        )  # fmt: skip
        charts, rows = roomy.charts, roomy.rows
        flat = np.ones(len(faces), np.bool_)
        flat[rows] = False
        shared = flat_colours(self._flat(colours, flat))
        sizes = np.zeros((0, 2)) if charts is None else charts.sizes
        # (3) Where each goes. Invariant: every face is either in a chart (`rows`) or in a cell
        # (`flat`).
        atlas = pack_charts(
            np.concatenate([sizes, np.zeros((len(shared.colours), 2))]), max_side=max_side
        )
        image = np.zeros((atlas.height, atlas.width, 3), np.uint8)
        covered = np.zeros((atlas.height, atlas.width), np.uint8)
        wedges = np.zeros((len(faces), 3, 2))
        texels, gsd_m = np.full(len(faces), np.nan), np.full(len(faces), np.nan)
        surface_m2, view = np.zeros(len(faces)), np.full(len(faces), -1, np.int32)
        chart_faces = np.zeros(0, np.int32)
        # (4) Draw: faces themselves, then a rim around them that only fills free texels.
        if charts is not None:
            # Whole half texels, as payloads hold them, before anything is drawn: nothing shifts
            # later.
            wedges[rows] = np.rint(atlas.to_texels(charts.uvs, charts.chart) * 2.0)
            chart_colours, chart_points = colours.rows(rows), points[corners[rows]]
            for rim in (None, charts.rim):
                self._bake(
                    image,
                    covered,
                    wedges[rows] * 0.5,
                    chart_points,
                    charts,
                    atlas,
                    chart_colours,
                    packed,
                    rim,
                )
            texels[rows], gsd_m[rows] = charts.texels * atlas.scale**2, charts.gsd_m
            surface_m2[rows], view[rows] = charts.surface_m2, charts.view
            chart_faces = np.bincount(charts.chart, minlength=charts.count).astype(np.int32)
        # (5) Cells of one colour: all corners of a face at the cell's middle.
        if flat.any():
            surface_m2[flat] = _areas(points[corners[flat]])
            cells = atlas.cells[len(sizes) :]
            for (x, y, width, height), colour in zip(cells.tolist(), shared.colours, strict=True):
                image[y : y + height, x : x + width] = colour
                covered[y : y + height, x : x + width] = 1
            wedges[flat] = (2 * cells[:, :2] + cells[:, 2:])[shared.of_face][:, None, :]
        # (6) Gutters from the charts, so that filtering at their edges reads no black.
        fill_cells(image, covered, atlas.cells)
        return BakedAtlas(
            wedges=wedges.astype(np.uint16),
            image=self._encoded(image),
            width=atlas.width,
            height=atlas.height,
            surface_m2=surface_m2,
            texels=texels,
            gsd_m=gsd_m,
            flat=flat,
            crowded=roomy.crowded,
            chart_faces=chart_faces,
            view=view,
            use=atlas.use,
        )

    def _encoded(self, image: UInt8) -> bytes:
        """Encode an image, at a lower quality where it would have too many bytes."""
        data = encode_image(image, self.kind, self.quality)
        if self.max_bytes is None or self.kind not in ("jpeg", "webp"):
            return data
        for quality in _QUALITIES:
            if len(data) <= self.max_bytes:
                break
            if quality < self.quality:
                data = encode_image(image, self.kind, quality)
        return data

    def _flat(self, colours: FaceColours, which: Bool) -> UInt8:
        """Mean vertex colour of some faces, after its gain."""
        gain = neutral_gains(0)[-1] if self.choice is None else self.choice.gains[-1]
        mean = colours.colours[which].mean(axis=1, dtype=np.float32)
        level = (mean + SRGB_OFFSET) * gain[:3] - SRGB_OFFSET
        flat: UInt8 = np.clip(np.rint(level), 0, 255).astype(np.uint8)
        return flat

    def _colours(self, faces: AnyInt, corners: Int32, used: AnyInt) -> FaceColours:
        colours = self.mesh.colours[used][corners]
        if self.choice is None or self.photos is None:
            count = len(faces)
            return FaceColours(
                view=np.full(count, -1, np.int32),
                blend_view=np.full(count, -1, np.int32),
                blend_weight=np.zeros((count, 3), np.float32),
                correction=np.zeros((count, 3, 3), np.float32),
                colours=colours,
            )
        return FaceColours(
            view=self.choice.view[faces],
            blend_view=self.choice.blend_view[faces],
            blend_weight=self.choice.blend_weight[faces],
            correction=self.choice.correction[faces].astype(np.float32),
            colours=colours,
        )

    def _bake(
        self,
        image: UInt8,
        covered: UInt8,
        texels: Float64,
        points: Float64,
        charts: Charts,
        atlas: Atlas,
        colours: FaceColours,
        packed: Float64,
        rim: Bool | None,
    ) -> None:
        """Draw all faces, photo by photo and within a photo by the second one.

        With *rim* those faces alone, and only beyond their edges.
        """
        # (1) Faces without a photo, in the cloud's colours under the cloud's exposure.
        margin = 0.0 if rim is None else _RIM_TEXELS
        drawn = np.ones(len(charts.view), np.bool_) if rim is None else rim
        gains = neutral_gains(0) if self.choice is None else self.choice.gains
        plain = np.flatnonzero(drawn & (charts.view < 0)).astype(np.int32)
        if len(plain) and self.colour_at is not None:
            texel, place = texel_places(covered, texels, points, plain, margin)
            image[texel[:, 0], texel[:, 1]] = self.colour_at(place)
        elif len(plain):
            bake_plain_faces(image, covered, texels, plain, colours, gains[-1], margin)
        if self.photos is None:
            return
        # (2) The others grouped by (photo, second photo), so that no more than two are decoded at
        # once.
        blend = np.where(charts.view >= 0, colours.blend_view, -1)
        order = np.lexsort((np.arange(len(blend)), blend, charts.view))
        order = order[(charts.view[order] >= 0) & drawn[order]]
        pairs = np.column_stack([charts.view[order], blend[order]])
        starts = np.flatnonzero(np.any(pairs[1:] != pairs[:-1], axis=1)) + 1
        for which in np.split(order.astype(np.int32), starts):
            if not len(which):
                continue
            view, second = int(charts.view[which[0]]), int(blend[which[0]])
            scale = _photo_scale(charts, atlas, which)
            other = None
            if second >= 0:
                other = (self.photos.get(second, scale), packed[second], gains[second], points)
            bake_photo_faces(
                image, covered, texels, charts.pixels, which, colours,
                self.photos.get(view, scale), packed[view], gains[view], other, margin,
            )  # fmt: skip


def _photo_scale(charts: Charts, atlas: Atlas, which: Int32) -> int:
    """Part of its size at which a photo has about the density of the texels, a power of two.

    Larger texels than pixels would otherwise pick single pixels, and flicker as one moves.
    """
    corners = charts.pixels[which].astype(np.float64)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    pixels = float(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    texels = float(charts.texels[which].sum()) * atlas.scale**2
    ratio = math.sqrt(pixels / texels) if texels > 0 else 1.0
    scale = 1
    while 2 * scale <= min(ratio * 1.05, _MAX_PHOTO_SCALE):
        scale *= 2
    return scale


def _areas(triangles: Float64) -> Float64:
    """Areas of triangles (K, 3, 3), square metres."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area: Float64 = 0.5 * np.linalg.norm(normal, axis=1)
    return area
