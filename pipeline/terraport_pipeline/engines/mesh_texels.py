"""The images of a mesh that was textured elsewhere, in the form in which photos colour faces.

To an atlas a source image is a photo: every face knows where its corners lie in it, a chart is a
set of connected faces that touch there, too, and its texels are copied, pixel for pixel where the
atlas has room. So no texture is unfolded or projected again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.texturing import MAX_HALVINGS, ImageCache, bilinear
from terraport_pipeline.geometry.mesh.uniform_samples import sample_weights
from terraport_pipeline.geometry.photos.lens import PACKED
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.model import Mesh

__all__ = ["MeshTexels", "Picture"]

_SAMPLES_PER_TEXEL: Final = 4.0
"""Places of the surface whose mean a texel of the base takes."""

_MOST_SAMPLES: Final = 20_000_000
_BLOCK: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Picture:
    """Size of an image, as atlases ask a photo's view for it."""

    width: int
    height: int

    def packed(self) -> Float64:
        """Row of numbers whose width and height alone are used."""
        row = np.zeros(PACKED)
        row[WIDTH], row[HEIGHT] = self.width, self.height
        return row


class MeshTexels:
    """Images of a mesh, and where the corners of its F faces lie in them.

    Parameters
    ----------
    pixels : ndarray of shape (F, 3, 2), float32
        From the image's upper left; NaN where a face has no image.
    image : ndarray of shape (F,), int32
        Row of the image; -1 for none.
    source : mapping of str to ndarray
        ``images``, ``offsets`` and ``sizes`` of :mod:`~terraport_pipeline.stages.read_mesh`; best
        mapped.
    max_bytes : int
        Decoded images that are kept.
    """

    def __init__(
        self, pixels: Float32, image: Int32, source: Mapping[str, AnyArray], max_bytes: int
    ) -> None:
        self.pixels, self.image = pixels, image
        data, offsets = source["images"], np.asarray(source["offsets"], np.int64)
        sizes = [(int(w), int(h)) for w, h in np.asarray(source["sizes"])]
        self.views = tuple(Picture(*size) for size in sizes)
        self._cache = ImageCache(
            lambda number: data[offsets[number] : offsets[number + 1]].tobytes(),
            dict(enumerate(sizes)),
            max_bytes,
        )

    def get(self, view_index: int, scale: int = 1) -> UInt8:
        """Pixels (H', W', 3), sRGB, at about 1/scale of the image's size."""
        return self._cache.get(view_index, min(max(scale.bit_length() - 1, 0), MAX_HALVINGS))

    def choice(self) -> ViewChoice:
        """Say for every face which image colours it: its own, as it is."""
        faces = len(self.image)
        return ViewChoice(
            view=self.image,
            blend_view=np.broadcast_to(np.int32(-1), faces),
            blend_weight=np.broadcast_to(np.float32(0), (faces, 3)),
            correction=np.broadcast_to(np.float16(0), (faces, 3, 3)),
            gains=neutral_gains(len(self.views)),
        )

    def texel_m(self, mesh: Mesh) -> float:
        """Length of a texel on the mesh, over all of it; 0 where no face has an image."""
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        seen = self.image >= 0
        first = self.pixels[:, 1].astype(np.float64) - self.pixels[:, 0]
        second = self.pixels[:, 2].astype(np.float64) - self.pixels[:, 0]
        texels = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[seen].sum()
        area = np.linalg.norm(normal, axis=1)[seen].sum()
        return float(np.sqrt(area / texels)) if texels > 0 else 0.0

    def samples(self, mesh: Mesh, texel_m: float) -> Iterator[tuple[Float32, UInt8]]:
        """Spread places over the mesh, four to a texel, and read their colours.

        Yields
        ------
        places : ndarray of shape (N, 3), float32
            Metres.
        colours : ndarray of shape (N, 3), uint8
            sRGB; where no image is, of the vertices.
        """
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(normal, axis=1)
        rng = np.random.default_rng(0)
        for number in range(-1, len(self.views)):
            rows = np.flatnonzero((self.image == number) & (area > 0))
            wanted = min(_SAMPLES_PER_TEXEL * float(area[rows].sum()) / texel_m**2, _MOST_SAMPLES)
            for begin in range(0, int(np.ceil(wanted)), _BLOCK):
                count = int(min(_BLOCK, np.ceil(wanted) - begin))
                weights, drawn = sample_weights(mesh.vertices, mesh.faces[rows], count, rng)
                face = rows[drawn]
                places = np.einsum("pc,pck->pk", weights, corners[face]).astype(np.float32)
                yield places, self._colours(mesh, number, weights, face)

    def _colours(self, mesh: Mesh, number: int, weights: Float64, face: AnyArray) -> UInt8:
        if number < 0:
            own = np.einsum("pc,pck->pk", weights, mesh.colours[mesh.faces[face]])
            mixed: UInt8 = np.rint(own).astype(np.uint8)
            return mixed
        view = self.views[number]
        at = np.einsum("pc,pck->pk", weights, self.pixels[face]) / (view.width, view.height)
        return np.rint(bilinear(self.get(number), at)).astype(np.uint8)
