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

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.face_graph import EdgeWeights, FaceGraph, face_graph
from terraport_pipeline.geometry.graph_merge import MergedGraph, join_small, merge_faces
from terraport_pipeline.geometry.pool_refine import join_nearest, number_by_first
from terraport_pipeline.geometry.segmenter import Segmentation, SegmenterMesh
from terraport_pipeline.geometry.triangle_pool import face_similarity

__all__ = ["GraphOptions", "GraphSegmenter", "automatic_seeds"]

_Int32 = npt.NDArray[np.int32]

_SEEDS: Final = 2000
"""Automatic seeds: at least this many, so that no region is one seed."""
_SEED_FACES: Final = 32
"""Automatic seeds have at most this many faces: the mean colour of 32 faces has a fifth of one
vertex's noise, and 5 M faces make some 250,000 seeds."""


@dataclass(frozen=True, slots=True)
class GraphOptions:
    """Parameters of the graph engine."""

    threshold: float = 10.0
    """Regions merge while that lowers the normalised cut by more than this; scale-free. Larger
    gives more, smaller regions. > 0."""
    small_share: float = 0.005
    """Regions below this share of the whole area join a neighbour; 0 keeps them. 0..1."""
    fine_faces: int = 1000
    """Most faces of a fine pool. >= 1."""
    seed_faces: int | None = None
    """Most faces of a seed; None chooses by the mesh, 1 leaves seeds out. >= 1."""
    weights: EdgeWeights = field(default_factory=EdgeWeights)
    """How borders are weighed."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        if not 0.0 < self.threshold < np.inf:
            msg = f"threshold is {self.threshold}, expected a finite number above 0"
            raise ValueError(msg)
        if not 0.0 <= self.small_share < 1.0:
            msg = f"small_share is {self.small_share}, expected 0 to below 1"
            raise ValueError(msg)
        for name in ("fine_faces", "seed_faces"):
            value = getattr(self, name)
            if value is not None and value < 1:
                msg = f"{name} is {value}, expected 1 or more"
                raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class GraphSegmenter:
    """Greedy normalised-cut merging over shape and colour.

    A mesh with neither colours nor a scalar is cut by its shape alone.
    """

    options: GraphOptions = field(default_factory=GraphOptions)

    @property
    def name(self) -> str:
        """``"graph"``."""
        return "graph"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools; see :class:`~.segmenter.Segmenter`."""
        options = self.options
        graph = face_graph(
            mesh.vertices, mesh.faces,
            colours=None if mesh.scalar is not None else mesh.colours,
            scalar=mesh.scalar, pairs=mesh.edge_pairs()[0],
        )  # fmt: skip
        merged = self.merge(graph)
        tree = merged.tree
        cut, cut_count = tree.cut_by_cost(-options.threshold)
        regions, count = join_small(graph, options.weights, cut, cut_count, options.small_share)
        regions, count, islands = self._join_islands(mesh, graph, regions, count)
        fine, _ = tree.cut_by_size(options.fine_faces, -options.threshold)
        return Segmentation(
            regions=regions,
            region_count=count,
            fine=fine,
            similarity=self._similarity(mesh),
            facts={
                "region_pools": cut_count,
                "region_islands": islands,
                "seeds": merged.seed_count,
                "colour_scale": merged.colour_scale,
            },
        )

    def merge(self, graph: FaceGraph) -> MergedGraph:
        """Build the whole merge tree, from which any granularity is read."""
        seed_faces = self.options.seed_faces
        if seed_faces is None:
            seed_faces = automatic_seeds(len(graph.area))
        return merge_faces(graph, self.options.weights, (seed_faces,) if seed_faces > 1 else ())

    def _join_islands(
        self, mesh: SegmenterMesh, graph: FaceGraph, regions: _Int32, count: int
    ) -> tuple[_Int32, int, int]:
        """Give small regions, which touch nothing by now, the region of the nearest face."""
        area = np.bincount(regions, weights=graph.area.astype(np.float64), minlength=count)
        small = area < self.options.small_share * area.sum()
        islands = int(np.count_nonzero(small))
        if islands == 0 or islands == count:
            return regions, count, islands
        joined = join_nearest(mesh.vertices, mesh.faces, regions, small)
        labels, left = number_by_first(joined)
        return labels, left, islands

    def _similarity(self, mesh: SegmenterMesh) -> npt.NDArray[np.float32]:
        """Index by which pools become segments: the Triangle Pool Algorithm's s."""
        colours, scalar = mesh.colours, mesh.scalar
        if scalar is not None:
            colours = None
        elif colours is None:
            scalar = np.zeros(len(mesh.faces))
        return face_similarity(mesh.vertices, mesh.faces, colours=colours, scalar=scalar)


def automatic_seeds(n_faces: int) -> int:
    """Most faces of a seed where the options leave it open: 1 to 32, at least 2,000 seeds."""
    return max(1, min(_SEED_FACES, n_faces // _SEEDS))
