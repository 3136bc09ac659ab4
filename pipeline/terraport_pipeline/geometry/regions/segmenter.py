"""One interface for every way to cut a surface into regions and fine pools.

A *segmenter* takes a mesh as plain arrays and gives every face a region (the semantic piece) and a
fine pool (what streamable segments are merged from, ``segments.py``). Whatever the engine, the
result obeys the same rules: each face in exactly one region and one pool, both numbered 0.. by
their first face; the same input gives the same bytes; renumbering vertices changes nothing.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final, Protocol

import numpy as np

from terraport_payload.types import AnyFloat, Float32, Int32, UInt8
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.engine_options import (
    FINE_POOLS,
    REGION_POOLS,
    TrianglePoolOptions,
)
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools_many

__all__ = [
    "SEGMENTERS",
    "Segmentation",
    "Segmenter",
    "SegmenterMesh",
    "TriangleSegmenter",
    "segmenter_by_name",
]


@dataclass(frozen=True, slots=True, eq=False)
class SegmenterMesh:
    """What a segmenter reads and never changes."""

    vertices: Float32
    """(V, 3) metres, scene frame; finite."""
    faces: Int32
    """(F, 3) vertex indices. F may be 0."""
    colours: UInt8 | None = None
    """(V, 3) sRGB, where the surface has colour."""
    scalar: AnyFloat | None = None
    """(F,) one finite value per face that stands for the colour (a shape diameter, an attribute).
    Engines that compare one number per face take it instead of ``colours`` where both are given."""
    pairs: tuple[Int32, Int32] | None = None
    """``face_pairs(faces, V)``: neighbouring faces (P, 2) and the vertices of their edge (P, 2),
    where the caller has them already."""

    def __post_init__(self) -> None:
        """Refuse arrays that do not belong together; engines check values."""
        vertices, faces, scalar = self.vertices, self.faces, self.scalar
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            msg = f"vertices {vertices.shape} and faces {faces.shape}, expected (V, 3) and (F, 3)"
            raise ValueError(msg)
        if self.colours is not None and self.colours.shape != vertices.shape:
            msg = f"colours have shape {self.colours.shape}, expected {vertices.shape}"
            raise ValueError(msg)
        if scalar is not None and scalar.shape != (len(faces),):
            msg = f"scalar has shape {scalar.shape}, expected ({len(faces)},)"
            raise ValueError(msg)

    def edge_pairs(self) -> tuple[Int32, Int32]:
        """Neighbouring faces over shared edges, and the edges' vertices; computed where missing."""
        if self.pairs is not None:
            return self.pairs
        return face_pairs(self.faces, len(self.vertices))


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """Regions and fine pools of every face, and the engine's facts."""

    regions: Int32
    """(F,) region of every face, 0..region_count-1, numbered by each region's first face."""
    region_count: int
    """Number of regions."""
    fine: Int32
    """(F,) fine pool of every face, 0.., numbered by each pool's first face."""
    similarity: Float32
    """(F,) the index s by which pools are merged to segments: pools of like mean s belong
    together."""
    facts: dict[str, int | float] = field(default_factory=dict)
    """Counts and lengths for the build report, by name."""

    @property
    def fine_count(self) -> int:
        """Number of fine pools; `fine` numbers them from 0."""
        return int(self.fine.max()) + 1 if len(self.fine) else 0


class Segmenter(Protocol):
    """Interface of segmentation engines; an instance holds its options."""

    @property
    def name(self) -> str:
        """Name of the engine, as the command line and the report say it."""

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools.

        Raises
        ------
        ValueError
            Arrays that the engine cannot read.
        """


@dataclass(frozen=True, slots=True)
class TriangleSegmenter:
    """The Triangle Pool Algorithm, once for regions and once for fine pools.

    Adjacency is found once; the similarity index and its sorting once too where both options agree
    about them. Where the mesh has neither colours nor a scalar, every face is alike.
    """

    regions: TrianglePoolOptions = REGION_POOLS
    """Parameters of the regions."""
    fine: TrianglePoolOptions = FINE_POOLS
    """Parameters of the fine pools."""
    threads: int = 1
    """Threads at most; they change nothing but the time."""

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"tpa"``."""
        return "tpa"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools; see :class:`Segmenter`."""
        colours, scalar = mesh.colours, mesh.scalar
        if scalar is not None:
            colours = None
        elif colours is None:
            scalar = np.zeros(len(mesh.faces))
        by_edge = None if mesh.pairs is None else mesh.pairs[0]
        regions, fine = triangle_pools_many(
            mesh.vertices, mesh.faces, (self.regions, self.fine),
            colours=colours, scalar=scalar, pairs=by_edge, threads=self.threads,
        )  # fmt: skip
        return Segmentation(
            regions=regions.labels,
            region_count=regions.count,
            fine=fine.labels,
            similarity=fine.similarity,
            facts={
                "region_k": regions.k,
                "region_pools": regions.level3_count,
                "region_islands": regions.islands,
                "fine_k": fine.k,
            },
        )


SEGMENTERS: Final = {
    "borders": ("terraport_pipeline.geometry.borders.border_segmenter", "BorderSegmenter"),
    "tpa": ("terraport_pipeline.geometry.regions.segmenter", "TriangleSegmenter"),
    "graph": ("terraport_pipeline.geometry.graph.graph_segmenter", "GraphSegmenter"),
    "grid": ("terraport_pipeline.geometry.regions.grid_segmenter", "GridSegmenter"),
    "felzenszwalb": ("terraport_pipeline.geometry.graph.felzenszwalb", "FelzenszwalbSegmenter"),
    "means": ("terraport_pipeline.geometry.regions.mean_colour", "MeanColourSegmenter"),
}
"""Module and class of every engine, by name."""


def segmenter_by_name(name: str, **options: Any) -> Segmenter:
    """Make a segmenter.

    Parameters
    ----------
    name : str
        ``"tpa"``, ``"graph"``, or one to compare with: ``"grid"``, ``"felzenszwalb"``.
    **options
        Fields of the engine's class.

    Returns
    -------
    Segmenter

    Raises
    ------
    ValueError
        No engine has this name.

    Examples
    --------
    >>> segmenter_by_name("tpa").name
    'tpa'
    """
    if name not in SEGMENTERS:
        msg = f"engine is {name!r}, expected one of {', '.join(sorted(SEGMENTERS))}"
        raise ValueError(msg)
    module, kind = SEGMENTERS[name]
    # Imported here: every engine imports this module for the interface.
    engine = getattr(import_module(module), kind)
    segmenter: Segmenter = engine(**options)
    return segmenter
