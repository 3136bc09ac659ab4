"""The graph engine behind the segmenter's interface: regions and fine pools from one merge tree.

Regions are the automatic cut: unions are kept while they cost less than ``-threshold``. Costs are
scale-free (times the root of the whole area), so one threshold serves a part of a millimetre and a
quarry of kilometres. A compact piece with the share q of the whole area, all of whose border weighs
w per length, gives about ``-3.5 * w / sqrt(q)``: the threshold says how weak the border of a piece
of that size must be for it to stand alone. Fine pools are the largest unions of at most
``fine_faces`` faces inside the regions.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.graph.face_graph import (
    FaceGraph,
    face_graph,
    smooth_colours,
    sum_areas,
)
from terraport_pipeline.geometry.graph.graph_merge import MergedGraph, join_small, merge_faces
from terraport_pipeline.geometry.graph.graph_options import COLOUR_GRAPH, SHAPE_GRAPH, GraphOptions
from terraport_pipeline.geometry.graph.merge_tree import MergeTree
from terraport_pipeline.geometry.regions.pool_refine import join_nearest, number_by_first
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh
from terraport_pipeline.geometry.regions.triangle_pool import face_similarity

__all__ = [
    "GraphSegmenter",
    "automatic_seeds",
    "cut_by_count",
    "cut_by_threshold",
    "graph_of_mesh",
    "merge_graph",
    "seed_levels",
]


_SEED_FACES: Final = 32
"""Seeds of meshes up to 147,000 faces have at most this many: the mean colour of 32 faces has a
fifth of one vertex's noise."""
_SEED_GROWTH: Final = 8
"""Levels of seeds: each at most this many times the one before, so that borders are weighed anew
before pieces have grown over them."""
_COLOUR_SEEDS: Final = 2000
"""With colour there are at least about this many seeds, so that no region is one seed."""
_MOST_COLOUR_SEEDS: Final = 4600
"""Of large meshes, about: finer faces must not make finer seeds. Colours blend over metres on real
ground, and between seeds much smaller than that no border stands out (Red Rocks at 6.8 M faces fell
into 3 regions with seeds of 32 faces, into 5 that mean something with these)."""
_SHAPE_SEEDS: Final = 100_000
"""By shape alone seeds only save time, and blur folds (1 - RI .141 without, .153 with 4 faces on 28
of Princeton's models, exponent 10): none below this many faces."""


@dataclass(frozen=True, slots=True)
class GraphSegmenter:
    """Greedy normalised-cut merging over shape and colour."""

    options: GraphOptions | None = None
    """None: ``COLOUR_GRAPH`` where the mesh has colours or a scalar, else ``SHAPE_GRAPH``."""
    count: int | None = None
    """Regions to make, as many as the surface has pieces at least; None: as many as the threshold
    leaves."""

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"graph"``."""
        return "graph"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools; see :class:`~.segmenter.Segmenter`."""
        options = self.options
        if options is None:
            shape_alone = mesh.colours is None and mesh.scalar is None
            options = SHAPE_GRAPH if shape_alone else COLOUR_GRAPH
        graph = graph_of_mesh(mesh, options)
        merged = merge_graph(graph, options)
        tree = merged.tree
        islands = 0
        if self.count is None:
            regions, count = cut_by_threshold(graph, options, tree)
            regions, count, islands = _join_islands(
                mesh, graph, regions, count, options.small_share
            )
        else:
            regions, count = cut_by_count(graph, options, tree, self.count)
        fine, _ = tree.cut_by_size(options.fine_faces, -options.threshold)
        return Segmentation(
            regions=regions,
            region_count=count,
            fine=fine,
            similarity=_similarity(mesh),
            facts={
                "region_islands": islands,
                "seeds": merged.seed_count,
                "colour_scale": merged.colour_scale,
            },
        )


def graph_of_mesh(mesh: SegmenterMesh, options: GraphOptions) -> FaceGraph:
    """Graph of a mesh's faces, colours smoothed as the options say."""
    graph = face_graph(
        mesh.vertices, mesh.faces,
        colours=None if mesh.scalar is not None else mesh.colours,
        scalar=mesh.scalar, pairs=mesh.edge_pairs()[0],
    )  # fmt: skip
    if options.weights.colour_scale <= 0.0:
        return graph
    return smooth_colours(graph, options.smooth_rounds)


def merge_graph(graph: FaceGraph, options: GraphOptions) -> MergedGraph:
    """Build the whole merge tree, from which any granularity is read."""
    seed_faces = options.seed_faces
    if seed_faces is None:
        by_colour = graph.facts.lab is not None and options.weights.colour_scale > 0.0
        seed_faces = automatic_seeds(len(graph.area), by_colour=by_colour)
    return merge_faces(graph, options.weights, seed_levels(seed_faces))


def cut_by_threshold(graph: FaceGraph, options: GraphOptions, tree: MergeTree) -> tuple[Int32, int]:
    """Cut at the options' threshold; regions below their least share join a neighbour."""
    labels, count = tree.cut_by_cost(-options.threshold)
    return join_small(graph, options.weights, labels, count, options.small_share)


def cut_by_count(
    graph: FaceGraph, options: GraphOptions, tree: MergeTree, count: int
) -> tuple[Int32, int]:
    """Cut into a number of regions, none of them below the options' least share if that goes.

    The tree is cut into more and more until, small ones joined, enough are left; crumbs that the
    greedy order keeps for long would else be most of a small number. Where even four times as many
    and 64 do not leave enough, the tree's own cut stands: so small are the parts that were asked
    for.
    """
    made = count
    while made <= 4 * count + 64:
        labels, before = tree.cut_by_count(made)
        labels, left = join_small(graph, options.weights, labels, before, options.small_share)
        if left >= count:
            return labels, left
        if before < made:
            break  # every face is a region of its own
        made += count - left
    return tree.cut_by_count(count)


def seed_levels(most_faces: int) -> tuple[int, ...]:
    """Sizes of seeds on the way to the largest, 32 and eight times more each; none for 1."""
    levels = []
    size = _SEED_FACES
    while size < most_faces:
        levels.append(size)
        size *= _SEED_GROWTH
    return (*levels, most_faces) if most_faces > 1 else ()


def automatic_seeds(n_faces: int, *, by_colour: bool) -> int:
    """Most faces of a seed where the options leave it open."""
    if by_colour:
        few = min(_SEED_FACES, n_faces // _COLOUR_SEEDS)
        return max(1, few, n_faces // _MOST_COLOUR_SEEDS)
    return max(1, min(_SEED_FACES, n_faces // _SHAPE_SEEDS))


def _join_islands(
    mesh: SegmenterMesh, graph: FaceGraph, regions: Int32, count: int, small_share: float
) -> tuple[Int32, int, int]:
    """Give small regions, which touch nothing by now, the region of the nearest face."""
    area = sum_areas(graph.area, regions, count)
    small = area < small_share * float(area.sum())
    islands = int(np.count_nonzero(small))
    if islands == 0 or islands == count:
        return regions, count, islands
    labels, left = number_by_first(join_nearest(mesh.vertices, mesh.faces, regions, small))
    return labels, left, islands


def _similarity(mesh: SegmenterMesh) -> Float32:
    """Index by which pools become segments: the Triangle Pool Algorithm's s."""
    colours, scalar = mesh.colours, mesh.scalar
    if scalar is not None:
        colours = None
    elif colours is None:
        scalar = np.zeros(len(mesh.faces))
    return face_similarity(mesh.vertices, mesh.faces, colours=colours, scalar=scalar)
