"""What is left at seams, closed within a few faces: local levelling.

After the smooth corrections (:mod:`terraport_pipeline.geometry.textures.seam_levels`) two photos
still differ a little along their seam, by another amount at every vertex. In a band of some rings
of faces on both sides

* the photo beyond the seam is blended in, with weight 0.5 at the seam and 0 at the band's end, so
that
  both sides show the same mean of both photos there. Only where that photo may be used at all: it
  sees the face unhidden and was not outvoted. (Waechter, Moehrle, Goesele, ECCV 2014, section
  4.3.2, solve a Poisson equation in such a strip of 20 pixels; on a strip a few faces wide the
  result is a blend of both photos' details as well, and costs a solve per chart and the pixels of
  all of them.)
* half of what is left is added on one side and taken off on the other, fading over the band: this
  closes the seam where nothing can be blended. It is first averaged along the seam, so that an
  error of the cameras, which changes from vertex to vertex, is not drawn into the faces.

Weights belong to nodes, as corrections do. A node whose faces cannot all be blended with the same
photo has weight 0: inside a chart nothing jumps.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Bool, Float16, Float32, Int16, Int32, UInt8
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.textures.seams import Nodes, Seams

__all__ = ["Blend", "blend_seams", "no_blend", "seam_steps", "step_sizes"]

_SMOOTHING: Final = 4
"""Times that what is left is averaged with its neighbours along the seam."""

_MAX_LEFT: Final = 24.0
"""Most that is closed locally, levels: more is not a difference of exposure."""

_MAX_CORRECTION: Final = 64.0
"""Most that any correction is, levels."""

_NONE: Final = -3
"""Partner of a node that has none, or several."""


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """Second view, its weight and the correction of every face and node."""

    view: Int32
    """(F,) second view, -1 none."""
    weight: Float32
    """(F, 3) its weight at the corners, 0..0.5."""
    correction: Float16
    """(F, 3, 3) levels to add at corner, channel."""
    node_weight: Float32
    """(N,) the weight at every node."""
    node_level: Float32
    """(N, 3) the correction at every node."""


def blend_seams(
    nodes: Nodes,
    seams: Seams,
    levels: Float32,
    candidates: Candidates,
    *,
    rings: int,
    threads: int = 1,
) -> Blend:
    """Finish the faces near seams, and put all corrections in rows by face.

    Parameters
    ----------
    nodes : Nodes
    seams : Seams
    levels : ndarray of shape (N, 3), float32
        Smooth corrections of the nodes.
    candidates : Candidates
        Views that may be used.
    rings : int
        Width of the band on each side, in rings of vertices, 1 to 16.
    threads : int
        The result does not depend on it.

    Returns
    -------
    Blend
    """
    if not 1 <= rings <= 16:
        raise ValueError(f"{rings} rings, expected 1 to 16")
    # (1) What is left at the seams themselves.
    n_faces, n_nodes = len(nodes.corner), len(nodes.vertex)
    left, partner, twin = _left_at_seams(
        seams.node, seams.step, seams.weight, seams.trust, levels, nodes.view, n_nodes
    )
    # (2) The band: faces within so many rings of a seam, and the seam node nearest to each.
    distance, source = _rings_around(nodes.corner, np.unique(seams.node), n_nodes, rings)
    # (3) A second view for each, where it sees the face, with a weight that falls off.
    second = np.full(n_faces, -1, np.int32)
    in_chunks(
        lambda begin, end: _second_views(
            nodes.corner, distance, source, partner, candidates.view, second, begin, end
        ),
        n_faces, threads=threads,
    )  # fmt: skip
    # (4) Smooth correction, rest and blend of every node; then in rows by face.
    blends = _blends(nodes.corner, second, source, partner)
    weight, level = _finish_nodes(levels, left, distance, source, twin, blends, rings)
    np.clip(level, -_MAX_CORRECTION, _MAX_CORRECTION, out=level)
    correction = np.empty((n_faces, 3, 3), np.float16)
    face_weight = np.empty((n_faces, 3), np.float32)

    def by_face(begin: int, end: int) -> None:
        correction[begin:end] = level[nodes.corner[begin:end]]
        face_weight[begin:end] = weight[nodes.corner[begin:end]]

    in_chunks(by_face, n_faces, threads=threads)
    second[~face_weight.any(axis=1)] = -1
    return Blend(second, face_weight, correction, weight, level)


def no_blend(n_faces: int) -> Blend:
    """Leave so many faces as their photos are."""
    return Blend(
        np.full(n_faces, -1, np.int32),
        np.zeros((n_faces, 3), np.float32),
        np.zeros((n_faces, 3, 3), np.float16),
        np.zeros(0, np.float32),
        np.zeros((0, 3), np.float32),
    )


def step_sizes(seams: Seams, levels: Float32, blend: Blend) -> dict[str, AnyFloat]:
    """Measure the step across every seam, sRGB levels, mean of the channels; (S,) each.

    Between the photos as they are (``photos``), after their gains (``gains``), after the smooth
    corrections (``smooth``), and after all (``local``); steps count as 48 levels at most.
    """
    gained = seams.step[:, None, :]  # the same at both ends
    one, two = seams.node[:, :, 0], seams.node[:, :, 1]
    own = 1.0 - blend.node_weight[one] - blend.node_weight[two]
    steps = {
        "photos": seams.raw_step,
        "gains": seams.step,
        "smooth": (gained + levels[one] - levels[two]).mean(axis=1),
        "local": (own[..., None] * gained + blend.node_level[one] - blend.node_level[two]).mean(
            axis=1
        ),
    }
    return {name: np.minimum(np.abs(step), 48.0).mean(axis=-1) for name, step in steps.items()}


def seam_steps(seams: Seams, levels: Float32, blend: Blend) -> dict[str, float]:
    """Sum up :func:`step_sizes`: mean by length and 95th percentile of the edges."""
    total = float(seams.weight.sum())
    if total == 0.0:
        return {}
    facts = {"seam_edges": float(len(seams.weight))}
    for name, sizes in step_sizes(seams, levels, blend).items():
        facts[f"seam_step_{name}"] = float((sizes * seams.weight).sum(dtype=np.float64) / total)
        facts[f"seam_step_p95_{name}"] = float(np.percentile(sizes, 95.0))
    return facts


@numba.njit(cache=True, nogil=True)
def _left_at_seams(
    node: Int32,
    step: Float32,
    weight: Float32,
    trust: Float32,
    levels: Float32,
    view: Int32,
    n_nodes: int,
) -> tuple[Float32, Int32, Int32]:
    """Find what each seam node should add, the view beyond the seam, and the node of that view."""
    # (1) Half of what is left at each seam edge, with trust and length as weights, summed at the
    # nodes of both sides with opposite signs: both sides move to the middle.
    left = np.zeros((n_nodes, 3), np.float32)
    mass = np.zeros(n_nodes, np.float32)
    partner = np.full(n_nodes, _NONE, np.int32)
    twin = np.full(n_nodes, -1, np.int32)
    several = np.zeros(n_nodes, np.bool_)
    for p in range(len(node)):
        for end in range(2):
            for side in range(2):
                mine, other = node[p, end, side], node[p, end, 1 - side]
                sign = 1.0 if side == 0 else -1.0
                mass[mine] += weight[p]
                for k in range(3):
                    rest = sign * step[p, k] + levels[mine, k] - levels[other, k]
                    rest = min(max(rest, -_MAX_LEFT), _MAX_LEFT)
                    left[mine, k] -= 0.5 * trust[p] * weight[p] * rest
                if twin[mine] < 0:
                    twin[mine], partner[mine] = other, view[other]
                elif twin[mine] != other:
                    several[mine] = True
    # (2) Sums to means; a node where several seams meet has no one partner to blend with.
    for n in range(n_nodes):
        if mass[n] > 0.0:
            for k in range(3):
                left[n, k] /= mass[n]
        if several[n] or partner[n] < 0:
            partner[n] = _NONE
    # (3) Smooth along the seam, since one edge's measurement is noisy. Invariant: each round
    # replaces a node's value by the mean of itself and its neighbours on its own side of the
    # seam.
    count = np.zeros(n_nodes, np.float32)
    for _ in range(_SMOOTHING):
        total = left.copy()
        count[:] = 1.0
        for p in range(len(node)):
            for side in range(2):
                a, b = node[p, 0, side], node[p, 1, side]
                count[a] += 1.0
                count[b] += 1.0
                for k in range(3):
                    total[a, k] += left[b, k]
                    total[b, k] += left[a, k]
        for n in range(n_nodes):
            for k in range(3):
                left[n, k] = total[n, k] / count[n]
    return left, partner, twin


@numba.njit(cache=True, nogil=True)
def _rings_around(corner: Int32, sources: Int32, n_nodes: int, rings: int) -> tuple[UInt8, Int32]:
    distance = np.full(n_nodes, rings, np.uint8)
    source = np.full(n_nodes, -1, np.int32)
    for n in sources:
        distance[n], source[n] = 0, n
    for ring in range(rings - 1):
        for f in range(len(corner)):
            for c in range(3):
                n = corner[f, c]
                if distance[n] != ring:
                    continue
                for d in range(3):
                    m = corner[f, d]
                    if distance[m] > ring + 1:
                        distance[m], source[m] = ring + 1, source[n]
    return distance, source


@numba.njit(cache=True, nogil=True)
def _second_views(
    corner: Int32,
    distance: UInt8,
    source: Int32,
    partner: Int32,
    views: Int16,
    second: Int32,
    begin: int,
    end: int,
) -> None:
    """View beyond the nearest seam, where the face may use it."""
    for f in range(begin, end):
        best = -1
        for c in range(3):
            n = corner[f, c]
            if source[n] < 0 or partner[source[n]] < 0:
                continue
            if best < 0 or distance[n] < distance[best]:
                best = n
        if best < 0:
            continue
        wanted = partner[source[best]]
        for s in range(SLOTS):
            if views[f, s] == wanted:
                second[f] = wanted
                break


@numba.njit(cache=True, nogil=True)
def _blends(corner: Int32, second: Int32, source: Int32, partner: Int32) -> Bool:
    """Whether all faces around a node blend with the view that it would."""
    blends = source >= 0
    for f in range(len(corner)):
        for c in range(3):
            n = corner[f, c]
            if source[n] >= 0 and (second[f] < 0 or partner[source[n]] != second[f]):
                blends[n] = False
    return blends


@numba.njit(cache=True, nogil=True)
def _finish_nodes(
    levels: Float32,
    left: Float32,
    distance: UInt8,
    source: Int32,
    twin: Int32,
    blends: Bool,
    rings: int,
) -> tuple[Float32, Float32]:
    """Weight of the second view and the correction at every node."""
    weight = np.zeros(len(levels), np.float32)
    level = levels.copy()
    for n in range(len(levels)):
        s = source[n]
        if s < 0:
            continue
        fade = 1.0 - distance[n] / rings
        for k in range(3):
            level[n, k] += fade * left[s, k]
        if blends[n] and twin[s] >= 0:
            weight[n] = 0.5 * fade
            # the second view comes with its own correction, carried over from the seam
            t = twin[s]
            for k in range(3):
                beyond = levels[t, k] + left[t, k] - levels[s, k] - left[s, k]
                level[n, k] += weight[n] * beyond
    return weight, level
