"""Closed bodies without colour cut into the parts that people see: a segmenter.

1. The graph engine's merge tree by shape is cut into some eighty pieces: their borders lie where
   the surface folds inwards, and hardly a border of people's is missed.
2. Rays measure how thick the body is everywhere, and what places see of each other inside it.
3. Pieces are united by how likely they are one part (:mod:`~..geometry.graph.part_merge`).

Folds are measured over a few faces, so that very fine meshes are cut on a coarser copy of them, and
labels are carried back to the nearest faces that look the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.engines.body_sight import body_sight
from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.geometry.graph.graph_merge import join_small
from terraport_pipeline.geometry.graph.graph_options import BODY_GRAPH, GraphOptions
from terraport_pipeline.geometry.graph.graph_segmenter import (
    GraphSegmenter,
    graph_of_mesh,
    merge_graph,
)
from terraport_pipeline.geometry.graph.part_merge import (
    LIKELY,
    PartMerges,
    PartWeights,
    merge_parts,
)
from terraport_pipeline.geometry.graph.part_table import BodyFacts
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh
from terraport_pipeline.geometry.regions.triangle_pool import face_similarity

__all__ = ["BodySegmenter", "base_pieces", "body_facts", "part_merges"]

PIECES: Final = 80
"""Pieces to begin with: what the best choice of unions leaves wrong of people's segmentations is a
1 - RI of .029 (40 pieces: .038, 300: .018)."""
_MOST_FACES: Final = 60_000
"""Bodies of more faces are cut on a copy."""
_COPY_FACES: Final = 30_000
_TURN_SHARE: Final = 0.02
"""Faces that look opposite ways count as twice this share of the diagonal apart: labels must not
pass through a wall."""


def base_pieces(mesh: SegmenterMesh, options: GraphOptions = BODY_GRAPH) -> tuple[Int32, int]:
    """Cut into the pieces that parts are made of; labels (F,) and their number."""
    graph = graph_of_mesh(mesh, options)
    labels, count = merge_graph(graph, options).tree.cut_by_count(PIECES)
    return join_small(graph, options.weights, labels, count, options.small_share)


def body_facts(mesh: SegmenterMesh, thickness: Float64, *, threads: int = 1) -> BodyFacts:
    """Measure what parts are compared by.

    Parameters
    ----------
    mesh : SegmenterMesh
        Closed, wound so that normals point outwards.
    thickness : ndarray of shape (F,), float64
        Shape diameter of its faces.
    threads : int
        Threads that trace; they change nothing but the time.
    """
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    pairs, edges = mesh.edge_pairs()
    normals = _normals(vertices, faces)
    area, centres = face_areas(vertices, faces), face_centres(vertices, faces)
    samples, sees = body_sight(
        mesh.vertices, faces, area, centres, normals, thickness, threads=threads
    )
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    return BodyFacts(area, centres, normals, pairs, lengths, thickness, samples, sees)


def part_merges(
    mesh: SegmenterMesh,
    options: GraphOptions = BODY_GRAPH,
    *,
    thickness: Float64 | None = None,
    weights: PartWeights | None = None,
    threads: int = 1,
) -> PartMerges:
    """Cut a closed body into pieces and unite them, the likeliest two first.

    Parameters
    ----------
    mesh : SegmenterMesh
        Closed; colours are not looked at.
    options : GraphOptions
        How pieces are made; those below ``small_share`` join a neighbour.
    thickness : ndarray of shape (F,), float64, optional
        Shape diameter, where the caller has it.
    weights : PartWeights, optional
        None: those that were fitted.
    threads : int
        Threads that trace; they change nothing but the time.

    Returns
    -------
    PartMerges
    """
    labels, count = base_pieces(mesh, options)
    if thickness is None:
        thickness = shape_diameter(mesh.vertices, mesh.faces, threads=threads)
    facts = body_facts(mesh, thickness, threads=threads)
    return merge_parts(facts, labels, count, weights)


@dataclass(frozen=True, slots=True)
class BodySegmenter:
    """Parts of a closed body: pieces of the graph engine, united as people would."""

    options: GraphOptions = BODY_GRAPH
    count: int | None = None
    """Regions to make, as many as the surface has pieces at least; None: as many as people would.
    Above what pieces there are, the graph engine's own cut."""
    threads: int = 1

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"graph"``."""
        return "graph"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions; fine pools are the pieces that these were made of."""
        if self.count is not None and self.count > PIECES:
            return GraphSegmenter(self.options, self.count).segment(mesh)
        if len(mesh.faces) > _MOST_FACES:
            vertices, faces = decimate(mesh.vertices, mesh.faces, max_faces=_COPY_FACES)
            carried = _carry(mesh, SegmenterMesh(vertices, faces))
        else:
            vertices, faces, carried = mesh.vertices, mesh.faces, None
        if _volume(vertices, faces) < 0.0:
            faces = np.ascontiguousarray(faces[:, ::-1])  # wound inwards: pairs stay as they are
        bare = SegmenterMesh(vertices, faces, pairs=mesh.pairs if carried is None else None)
        merges = part_merges(bare, self.options, threads=self.threads)
        fine = merges.base
        if self.count is None:
            regions, count = merges.cut_by_likelihood(LIKELY)
        else:
            regions, count = merges.cut_by_count(self.count)
        if carried is not None:
            regions, count = _whole(mesh, regions[carried], self.options)
            fine = _whole(mesh, merges.base[carried], self.options)[0]
        return Segmentation(
            regions,
            count,
            fine,
            face_similarity(mesh.vertices, mesh.faces, scalar=np.zeros(len(mesh.faces))),
            {"pieces": merges.count},
        )


def _carry(mesh: SegmenterMesh, copy: SegmenterMesh) -> Int64:
    """Face of the copy that is nearest to each of the mesh, (F,), and looks the same way."""
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))

    def places(of: SegmenterMesh) -> Float64:
        centres = face_centres(of.vertices, of.faces)
        look = _normals(of.vertices.astype(np.float64), of.faces)
        return np.concatenate([centres, _TURN_SHARE * diagonal * look], axis=1)

    return np.asarray(cKDTree(places(copy)).query(places(mesh))[1], np.int64)


def _whole(mesh: SegmenterMesh, labels: Int32, options: GraphOptions) -> tuple[Int32, int]:
    """Let splinters that carrying made join a neighbour; labels hang together."""
    pieces, count = components(len(labels), mesh.edge_pairs()[0], labels=labels)
    return join_small(
        graph_of_mesh(mesh, options), options.weights, pieces, count, options.small_share
    )


def _volume(vertices: Float32, faces: Int32) -> float:
    """Enclosed volume, negative where faces are wound inwards."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    return float((a * np.cross(b, c)).sum()) / 6.0


def _normals(vertices: Float64, faces: Int32) -> Float64:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    vectors = np.cross(b - a, c - a)
    length = np.linalg.norm(vectors, axis=1)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0)[:, None])
