"""Cut a reconstructed detail to its edges, and say what that changed.

Part of the stage *reconstruct*; its steps are apart so that pieces of a surface can be cut by one
rule made for the whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Int32
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.geometry.clouds.border import BorderFacts, measure_border
from terraport_pipeline.geometry.clouds.edges import EdgeRule, trim_edges
from terraport_pipeline.geometry.clouds.footprint import Footprint, footprint_of
from terraport_pipeline.geometry.clouds.support import (
    support_histogram,
    support_ratio,
    support_threshold,
)
from terraport_pipeline.geometry.mesh.chunks import side_by_side
from terraport_pipeline.geometry.mesh.trim import compact, island_mask
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Json

__all__ = [
    "BASE_GAP_SPACINGS",
    "HEM_SPACINGS",
    "SampledGround",
    "TrimmedDetail",
    "border_counts",
    "sampled_ground",
    "trim_detail",
]


HEM_SPACINGS: Final = 1.5
"""How far the base reaches beyond the detail, in the cloud's spacings: thinning moves a border by
less than one (99.9th percentile), and the hem is hidden where detail is shown."""


BASE_GAP_SPACINGS: Final = 12.0
"""Gaps that nowhere lie farther than this from a sample stay closed in the base: the detail shows
the holes of a thinly sampled wall when one stands before it, but from afar nobody should look
through the wall. (Without this the base of a quarry's highwall had holes of several metres.)"""


@dataclass(frozen=True, slots=True, eq=False)
class TrimmedDetail:
    """The detail cut to its edges, the wider cut for the base, and how clean the edge is."""

    vertices: Float32
    faces: Int32
    islands: int
    """Loose pieces dropped."""
    wide: tuple[Float32, Int32]
    """The same surface with a hem of :data:`HEM_SPACINGS`, to thin a base from."""
    counts: dict[str, Json]
    """What the edges were and are."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledGround:
    """What the edges need to know of the cloud: made before there is a surface."""

    tree: cKDTree
    """Over the cloud's points."""
    outline: Footprint
    """Outline that the detail is cut to."""
    wide: Footprint
    """Outline of the surface that the base is thinned from, with its hem."""


def sampled_ground(cleaned: Cleaned) -> SampledGround:
    """Make what depends on the cloud alone; a few seconds that fit beside the solver."""
    points, spacing_m = cleaned.cloud.points, cleaned.cloud.spacing_m
    # One radius for all: disks this wide that grow with the local spacing would be drawn in by
    # another length than they reach out by, several spacings too far where thin meets dense.
    even_m = np.full(len(points), spacing_m, dtype=np.float32)
    return SampledGround(
        cKDTree(points, balanced_tree=False),
        footprint_of(points, cleaned.local_spacing_m, spacing_m),
        footprint_of(points, even_m, spacing_m, closing_spacings=BASE_GAP_SPACINGS),
    )


def trim_detail(
    vertices: Float32,
    faces: Int32,
    cleaned: Cleaned,
    ground: SampledGround,
    *,
    largest: float,
    island_faces: int,
    threads: int = 1,
) -> TrimmedDetail:
    """Cut a whole surface to its edges and drop loose pieces.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    cleaned : Cleaned
    ground : SampledGround
        Of the same cloud.
    largest : float
        Support ratio that no place may pass.
    island_faces : int
        Loose pieces with fewer faces go.
    threads : int

    Returns
    -------
    TrimmedDetail

    Raises
    ------
    SurveyError
        Nothing is left.
    """
    # (1) Support of every vertex, and from its distribution where to cut.
    spacing_m, local_m = cleaned.cloud.spacing_m, cleaned.local_spacing_m

    def ratio_of(points: Float32) -> Float32:
        return support_ratio(points, ground.tree, local_m, spacing_m, workers=threads)

    ratio = ratio_of(vertices)
    threshold = support_threshold(support_histogram(vertices, faces, ratio), largest=largest)
    # (2) Two rules: the detail's edge, and farther out that of the surface the base is made of,
    # so that the base reaches under the detail's rim.
    outline = ground.outline
    rule = EdgeRule(threshold, largest, spacing_m, outline)
    hem = replace(
        rule,
        largest=max(largest, BASE_GAP_SPACINGS),
        footprint=ground.wide,
        outward_m=HEM_SPACINGS * spacing_m,
    )

    def cut(rule: EdgeRule) -> tuple[Float32, Int32, int]:
        cut_vertices, cut_faces = trim_edges(vertices, faces, ratio, rule)
        # Some of a small survey's pieces may all be islands: the largest always stays.
        keep, islands = island_mask(cut_faces, len(cut_vertices), min_faces=island_faces)
        return (*compact(cut_vertices, cut_faces, keep), islands)

    def measure_before() -> BorderFacts:
        # What whole faces by the largest ratio alone would have left: the rule up to November 2026.
        coarse = faces[(ratio <= largest)[faces].all(axis=1)]
        return measure_border(vertices, coarse, outline, ratio_of, spacing_m)

    # (3) Both cuts, and what a coarser rule would have left, to compare.
    (cut_vertices, cut_faces, islands), (*wide, _), before = side_by_side(
        [lambda: cut(rule), lambda: cut(hem), measure_before], threads=threads
    )
    if not len(cut_faces):
        raise SurveyError(
            f"no surface lies within {largest} spacings of the {ground.tree.n} samples; are they "
            "scattered in space rather than on a surface? raise --trim-spacings to see"
        )
    # (4) How clean the edge is now.
    after = measure_border(cut_vertices, cut_faces, outline, ratio_of, spacing_m)
    counts = {
        "support_threshold": rule.threshold,
        "footprint_m2": outline.area_m2,
        **border_counts(before, after),
    }
    return TrimmedDetail(cut_vertices, cut_faces, islands, (wide[0], wide[1]), counts)


def border_counts(before: BorderFacts, after: BorderFacts) -> dict[str, Json]:
    """Name what the trimming changed; lengths in spacings where nothing else is said."""
    return {
        f"{name}_{when}": getattr(facts, field)
        for name, field in (
            ("outside_footprint_m2", "outside_m2"),
            ("border_reach_p50", "reach_p50"),
            ("border_reach_p95", "reach_p95"),
            ("border_teeth_p50", "teeth_p50"),
            ("border_teeth_p95", "teeth_p95"),
        )
        for when, facts in (("before", before), ("after", after))
    }
