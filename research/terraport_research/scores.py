"""How good a reconstruction is: colour, holes, distances, soundness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts, open_loops
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_research.reconstructors.contract import Surface
from terraport_research.subjects import Subject

__all__ = ["LOST_SPACINGS", "Distances", "Scores", "score"]

LOST_SPACINGS: Final = 2.0
"""A sample, or a place on the truth, with no surface this near is lost."""

RIM_SPACINGS: Final = 3.0
"""Open edges this near to where the truth itself ends are an outline, no hole."""

_OUTSIDE_SPACINGS: Final = 0.5
"""A place whose nearest truth is this near to the truth's own end lies beyond it."""

_PLACES: Final = 40_000
"""Places on the reconstruction whose distance to the truth is measured."""


@dataclass(frozen=True, slots=True)
class Distances:
    """Mean, percentiles and maximum of distances, in spacings of the samples."""

    mean: float
    p50: float
    p95: float
    p99: float
    most: float


@dataclass(frozen=True, slots=True)
class Scores:
    """Everything measured of one reconstruction."""

    faces: int
    vertices: int
    colour_p50: float
    """Grey levels (of 255, the channel that differs most) between a sample's colour and the mesh's
    at the nearest place on it: half the samples have less."""
    colour_p95: float
    colour_most: float
    samples_lost: float
    """Share of samples without surface within two spacings."""
    to_truth: Distances
    """From places on the reconstruction, even by area, to the truth; those beyond the truth's end
    are left out."""
    from_truth: Distances
    """From places on the truth that samples saw to the reconstruction."""
    hausdorff: float
    """The larger of both maxima."""
    outside: float
    """Share of the reconstruction's area beyond the truth's end."""
    holes: int
    """Groups of open edges away from the truth's own end."""
    hole_area: float
    """Area of the holes, as a share of the truth's."""
    truth_lost: float
    """Share of the truth without surface within two spacings."""
    open_edges: int
    non_manifold: int
    """Edges with three faces or more."""
    turned: int
    """Edges whose two faces are turned against each other."""
    euler: int


def score(surface: Surface, colours: UInt8, subject: Subject) -> Scores:
    """Measure a reconstruction against its truth.

    Parameters
    ----------
    surface : Surface
        At least one face with area.
    colours : ndarray of shape (V, 3), uint8
        sRGB of the surface's vertices.
    subject : Subject

    Returns
    -------
    Scores
    """
    samples = subject.samples
    spacing_m = samples.spacing_m
    tree = TriangleTree(surface.vertices, surface.faces)
    # Colour, at the samples
    at_samples = tree.nearest(samples.points)
    shown = at_samples.interpolate(surface.faces, colours)
    apart = np.abs(shown - samples.colours).max(axis=1)
    colour = np.percentile(apart, (50, 95, 100))
    # Distances, both ways
    rng = np.random.default_rng(len(surface.faces))
    surface_samples, _ = sample_mesh(surface.vertices, surface.faces, _PLACES, rng)
    true_tree = TriangleTree(subject.truth_vertices, subject.truth_faces)
    to_truth = true_tree.nearest(surface_samples)
    beyond = _beyond(to_truth.interpolate(subject.truth_faces, subject.truth_vertices), subject)
    away = to_truth.distance_m[~beyond] / spacing_m
    back = tree.nearest(subject.seen).distance_m / spacing_m
    one_way, other_way = _distances(away), _distances(back)
    # Edges
    facts = edge_facts(surface.faces)
    holes, hole_area = _holes(surface, facts.open_edges, subject, true_tree)
    return Scores(
        faces=len(surface.faces),
        vertices=len(np.unique(surface.faces)),
        colour_p50=float(colour[0]),
        colour_p95=float(colour[1]),
        colour_most=float(colour[2]),
        samples_lost=float((at_samples.distance_m > LOST_SPACINGS * spacing_m).mean()),
        to_truth=one_way,
        from_truth=other_way,
        hausdorff=max(one_way.most, other_way.most),
        outside=float(beyond.mean()),
        holes=holes,
        hole_area=hole_area,
        truth_lost=float((back > LOST_SPACINGS).mean()),
        open_edges=len(facts.open_edges),
        non_manifold=facts.non_manifold,
        turned=facts.against,
        euler=facts.euler,
    )


def _is_sheet(surface: Surface) -> bool:
    """Whether no two faces lie above each other: all look up, as a height field's do."""
    a, b, c = (surface.vertices[surface.faces[:, k]][:, [0, 2]] for k in range(3))
    turn = (b - a)[:, 1] * (c - a)[:, 0] - (b - a)[:, 0] * (c - a)[:, 1]
    return bool((turn >= 0).all())


def _distances(values: Float32) -> Distances:
    if len(values) == 0:
        return Distances(*(float("nan"),) * 5)
    p50, p95, p99 = (float(v) for v in np.percentile(values, (50, 95, 99)))
    return Distances(float(values.mean()), p50, p95, p99, float(values.max()))


def _beyond(feet: Float32, subject: Subject) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which places, given by their nearest places on the truth, lie beyond the truth's end."""
    if len(subject.rim) == 0:
        return np.zeros(len(feet), np.bool_)
    gap, _ = cKDTree(subject.rim).query(feet, workers=1)
    beyond: np.ndarray[tuple[int], np.dtype[np.bool_]] = (
        gap < _OUTSIDE_SPACINGS * subject.samples.spacing_m
    )
    return beyond


def _holes(
    surface: Surface, open_edges: Int32, subject: Subject, true_tree: TriangleTree
) -> tuple[int, float]:
    """Count groups of open edges that are holes, and their area as a share of the truth's."""
    loops = open_loops(surface.vertices, open_edges)
    count = len(loops.length_m)
    if count == 0:
        return 0, 0.0
    is_hole = np.ones(count, np.bool_)
    if len(subject.rim):
        middles = true_tree.nearest(surface.vertices[open_edges].mean(axis=1))
        feet = middles.interpolate(subject.truth_faces, subject.truth_vertices)
        gap, _ = cKDTree(subject.rim).query(feet, workers=1)
        near = gap < RIM_SPACINGS * subject.samples.spacing_m
        is_hole = np.bincount(loops.group, near, count) < 0.5 * np.bincount(loops.group)
    if subject.closed and _is_sheet(surface):
        is_hole[int(loops.length_m.argmax())] = False  # the sheet's own outline
    return int(is_hole.sum()), float(loops.area_m2[is_hole].sum() / _area(subject))


def _area(subject: Subject) -> float:
    corners: Float64 = subject.truth_vertices[subject.truth_faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(normal, axis=1).sum() / 2)
