"""What a compared segmentation algorithm takes, gives and says of itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.body_parts import part_merges
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.geometry.graph.face_graph import FaceGraph
from terraport_pipeline.geometry.graph.graph_options import SHAPE_GRAPH
from terraport_pipeline.geometry.graph.graph_segmenter import graph_of_mesh
from terraport_pipeline.geometry.graph.part_merge import PartMerges
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh

__all__ = ["Body", "Cut", "Cutter"]


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh, with what several algorithms ask of it, measured when first asked."""

    vertices: Float64
    """(V, 3) any unit."""
    faces: Int32
    """(F, 3) wound so that normals point outwards."""
    seed: int = 0
    """Of what is drawn by lot."""
    colours: UInt8 | None = None
    """(V, 3) sRGB, where the surface has colour."""

    @cached_property
    def neighbours(self) -> tuple[Int32, Int32]:
        """Faces over edges (P, 2), and those edges' vertices (P, 2)."""
        return face_pairs(self.faces, len(self.vertices))

    @cached_property
    def area(self) -> Float64:
        """Of the faces, (F,)."""
        return face_areas(self.vertices, self.faces)

    @cached_property
    def centres(self) -> Float64:
        """Middles of the faces, (F, 3)."""
        return face_centres(self.vertices, self.faces)

    @cached_property
    def normals(self) -> Float64:
        """(F, 3) unit; zero of a face without area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        vectors = np.cross(b - a, c - a)
        length = np.sqrt((vectors * vectors).sum(axis=1))
        return np.asarray(vectors / np.where(length > 0.0, length, 1.0)[:, None])

    @cached_property
    def edge_lengths(self) -> Float64:
        """(P,) of the shared edges."""
        edges = self.neighbours[1]
        step = self.vertices[edges[:, 0]] - self.vertices[edges[:, 1]]
        return np.asarray(np.sqrt((step * step).sum(axis=1)))

    @cached_property
    def folds(self) -> Float64:
        """(P,) angle between the normals of neighbours, radians; negative where folded inwards."""
        pairs = self.neighbours[0]
        a, b = self.normals[pairs[:, 0]], self.normals[pairs[:, 1]]
        cosine = np.clip((a * b).sum(axis=1), -1.0, 1.0)
        apart = self.centres[pairs[:, 1]] - self.centres[pairs[:, 0]]
        inwards = ((a - b) * apart).sum(axis=1) > 0.0
        return np.asarray(np.where(inwards, -1.0, 1.0) * np.arccos(cosine))

    @cached_property
    def face_colours(self) -> Float64:
        """(F, 3) mean of the corners', sRGB levels.

        Raises
        ------
        SurveyError
            The mesh has no colour.
        """
        if self.colours is None:
            raise SurveyError("the mesh has no colour; this algorithm compares colours")
        return np.asarray(self.colours[self.faces].mean(axis=1, dtype=np.float64))

    def nearest_faces(self, count: int) -> Int32:
        """Pairs (P, 2) of faces, lower first, of which one's middle is among the other's nearest.

        In space: faces need not touch. ``count`` of every face; fewer where there are no more.
        """
        n = len(self.faces)
        _, near = cKDTree(self.centres).query(self.centres, k=range(1, min(count + 1, n) + 1))
        one = np.repeat(np.arange(n), near.shape[1])
        other = near.reshape(-1)
        apart = one != other
        low, high = (
            order(one, other)[apart].astype(np.int64) for order in (np.minimum, np.maximum)
        )
        return np.stack(np.divmod(np.unique(low * n + high), n), axis=1).astype(np.int32)

    @cached_property
    def thickness(self) -> Float64:
        """(F,) shape diameter; NaN where there is none."""
        return shape_diameter(self.vertices32, self.faces)

    @cached_property
    def vertices32(self) -> Float32:
        """(V, 3) about the middle."""
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return np.asarray(self.vertices - middle, np.float32)

    @cached_property
    def graph(self) -> FaceGraph:
        """What the graph engine sees of it, by shape alone."""
        mesh = SegmenterMesh(self.vertices32, self.faces, pairs=self.neighbours)
        return graph_of_mesh(mesh, SHAPE_GRAPH)

    @cached_property
    def parts(self) -> PartMerges:
        """What ``terraport segment`` makes of a closed body, in the order of its unions."""
        mesh = SegmenterMesh(self.vertices32, self.faces, pairs=self.neighbours)
        return part_merges(mesh, thickness=self.thickness)


Cut = Callable[[int], Int32]
"""Segment of every face (F,) for a number of segments asked for; what is told no number ignores
it."""


@dataclass(frozen=True, slots=True)
class Cutter:
    """A segmentation algorithm of the comparison: names, origin, and how to run it."""

    key: str
    """Name on the command line."""
    title: str
    paper: str
    takes_k: bool
    """Whether it is told the number of segments."""
    prepare: Callable[[Body], Cut]
    """Does all that does not depend on the number, once for a body. Raises a ``PipelineError``
    where it cannot cut this one."""
    thesis: str = ""
    """Its column in the thesis's tables; empty: not there."""
    departs: str = ""
    """What differs from the paper, for the page."""
