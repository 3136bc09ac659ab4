"""A dump truck that drives through the quarry while the photos are taken.

It stands at another place in every photo, on level ground that the photo sees, and no cloud knows
it: what a texture must not show. Three boxes (tray, cab, running gear) and their shadow.

Frame: scene metres about the quarry's origin (x east, y up, z south). PURE.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Float32, Float64
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import HALF_X, HALF_Y
from terraport_pipeline.synth.surface import GROUND, Surface

__all__ = ["Truck", "parking_places", "place_truck"]

_BOXES: Final = np.array(
    # forward, left, up: least and most, design metres; the middle of the wheelbase is 0
    [
        [-4.4, -1.5, 0.0, 4.4, 1.5, 1.3],
        [-4.8, -1.9, 1.3, 1.9, 1.9, 3.4],
        [2.1, -1.7, 1.3, 4.6, 1.7, 4.0],
    ]
)
_PAINT: Final = np.array([[52, 50, 48], [236, 172, 36], [244, 226, 206]], dtype=np.float64)
"""sRGB in full sun: running gear, tray, cab."""

_LEAST_SCALE: Final = 0.7
"""A truck on a small site shrinks to this and no further: it is no toy, and covers as many points
of the cloud as a real one does."""

_TRIES: Final = 3_000
_MARGIN: Final = 0.12
"""Share of the photo's sides where no truck is put: it should be whole."""

_STREAM: Final = 6
REACH: Final = 12.0
"""Design metres around the truck within which its shadow falls: 4 high, the sun 49 degrees up."""


@dataclass(frozen=True, slots=True, eq=False)
class Truck:
    """A truck parked in one photo: position, heading and size."""

    position: Float64
    """(3,) on the ground, metres, scene frame."""
    heading_rad: float
    """Of its forward axis, from east towards north."""
    scale: float
    """Metres per design metre."""

    def to_local(self, vectors: AnyFloat) -> Float64:
        """Turn scene vectors (N, 3) into (forward, left, up), design metres."""
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        x, y, z = np.asarray(vectors, dtype=np.float64).T / self.scale
        return np.stack([c * x - s * z, -s * x - c * z, y], axis=1)

    def corners(self) -> Float64:
        """Return the eight corners of the whole truck, (8, 3) scene metres."""
        low, high = _BOXES[:, :3].min(axis=0), _BOXES[:, 3:].max(axis=0)
        pick = np.indices((2, 2, 2)).reshape(3, -1).T == 1
        f, left, up = np.where(pick, high, low).T
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        local = np.stack([c * f - s * left, up, -(s * f + c * left)], axis=1)
        result: Float64 = local * self.scale + self.position
        return result

    def intersect(
        self, origins: AnyFloat, directions: AnyFloat
    ) -> tuple[Float64, Float64, Float64]:
        """Meet rays.

        Parameters
        ----------
        origins, directions : ndarray of shape (R, 3)
            Metres, scene frame.

        Returns
        -------
        t : ndarray of shape (R,), float64
            In lengths of the direction; ``inf`` on a miss.
        colours : ndarray of shape (R, 3), float64
            sRGB in full sun.
        normals : ndarray of shape (R, 3), float64
            Scene frame, unit.
        """
        start = self.to_local(np.asarray(origins) - self.position)
        along = self.to_local(directions)
        best = np.full(len(start), np.inf)
        colours = np.zeros((len(start), 3))
        normals = np.zeros((len(start), 3))
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / along
        for box, paint in zip(_BOXES, _PAINT, strict=True):
            # The slab method: a ray is inside the box where it is between all three pairs.
            with np.errstate(invalid="ignore"):
                a, b = (box[:3] - start) * inverse, (box[3:] - start) * inverse
            near = np.fmin(a, b)
            enter, leave = near.max(axis=1), np.fmax(a, b).min(axis=1)
            hit = (enter <= leave) & (enter > 0.0) & (enter < best)
            best[hit] = enter[hit]
            colours[hit] = paint
            axis = near[hit].argmax(axis=1)
            local = np.zeros((len(axis), 3))
            local[np.arange(len(axis)), axis] = -np.sign(along[hit, axis])
            normals[hit] = self._to_scene(local)
        return best, colours, normals

    def _to_scene(self, local: Float64) -> Float64:
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        f, left, up = local.T
        return np.stack([c * f - s * left, up, -(s * f + c * left)], axis=1)


def parking_places(surface: Surface, seed: int, scale: float) -> Float32:
    """Find level, dry, bare ground.

    Parameters
    ----------
    surface : Surface
    seed : int
        Of the quarry.
    scale : float
        Metres per design metre.

    Returns
    -------
    ndarray of shape (P, 3), float32
        Scene metres; may be empty.
    """
    rng = np.random.default_rng([seed, _STREAM])
    tries = rng.uniform(-0.9, 0.9, (_TRIES, 2)) * (HALF_X, HALF_Y)
    parameters = np.concatenate([tries, np.zeros((_TRIES, 1))], axis=1)
    points = surface.evaluate_at(np.full(_TRIES, GROUND), parameters)
    good = np.isin(points.material, (Material.ROAD, Material.BENCH)) & ~points.hidden
    reach = 4.5 * max(1.0, _LEAST_SCALE / scale)
    for du, dv in ((reach, 0.0), (-reach, 0.0), (0.0, reach), (0.0, -reach)):
        z = surface.terrain.positions(tries[:, 0] + du, tries[:, 1] + dv)[:, 2]
        good &= np.abs(z - points.positions[:, 2]) < 0.16 * reach
    x, y, z = points.positions[good].T * scale
    return np.stack([x, z, -y], axis=1).astype(np.float32)


def place_truck(view: View, number: int, spots: Float32, seed: int, scale: float) -> list[Truck]:
    """Put the truck where a photo looks: candidates, the best first.

    Parameters
    ----------
    view : View
    number : int
        Of the photo; decides the place together with `seed`.
    spots : ndarray of shape (P, 3), float32
        From :func:`parking_places`.
    seed : int
    scale : float

    Returns
    -------
    list of Truck
        At most eight, in the order to try them in; the caller takes the first that is not hidden.
    """
    rng = np.random.default_rng([seed, _STREAM, number])
    pixels, depth = view.project(spots.astype(np.float64))
    side = np.array([view.lens.width, view.lens.height])
    with np.errstate(invalid="ignore"):
        inside = ((pixels > _MARGIN * side) & (pixels < (1 - _MARGIN) * side)).all(axis=1)
        inside &= depth > 15.0 * scale
    rows = np.flatnonzero(inside)
    rows = rows[rng.permutation(len(rows))][:8]
    turns = rng.uniform(0.0, 2 * np.pi, len(rows))
    return [
        Truck(spots[row].astype(np.float64), float(turn), max(scale, _LEAST_SCALE))
        for row, turn in zip(rows, turns, strict=True)
    ]
