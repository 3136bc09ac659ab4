"""Which engine cuts the surface into regions, by what, and how it is set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.felzenszwalb import FelzenszwalbSegmenter
from terraport_pipeline.geometry.graph_segmenter import (
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    GraphSegmenter,
)
from terraport_pipeline.geometry.grid_segmenter import GridSegmenter
from terraport_pipeline.geometry.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.segmenter import Segmenter, SegmenterMesh, TriangleSegmenter
from terraport_pipeline.geometry.shape_index import shape_index
from terraport_pipeline.geometry.triangle_pool import FINE_POOLS, REGION_POOLS
from terraport_pipeline.model import Mesh

__all__ = [
    "ENGINES",
    "Engine",
    "check_segment_by",
    "make_segmenter",
    "means_segmenter",
    "segmenter_mesh",
]

Engine = Literal["means", "graph", "tpa", "felzenszwalb", "grid"]

ENGINES: Final = ("means", "graph", "tpa", "felzenszwalb", "grid")
"""Engines that a build may be asked for; the last two are there to compare with."""

COLOUR: Final = "colour"
SHAPE: Final = "shape"


def make_segmenter(
    engine: Engine,
    *,
    segment_by: str,
    region_threshold: float | None,
    region_small: float | None,
    segment_threshold: float,
    threads: int,
) -> Segmenter:
    """Make the engine that a build asks for.

    Parameters
    ----------
    engine : str
        One of ``ENGINES``.
    segment_by : str
        ``"colour"``, ``"shape"`` or an attribute's name.
    region_threshold, region_small : float or None
        The engine's own threshold and least share of a region; None for its defaults.
    segment_threshold : float
        Th of the fine pools; of ``tpa`` alone.
    threads : int
        Threads at most.

    Raises
    ------
    ValueError
        A value that the engine does not take.
    """
    if engine == "graph":
        graph = OPEN_SHAPE_GRAPH if segment_by == SHAPE else COLOUR_GRAPH
        return GraphSegmenter(
            replace(
                graph,
                threshold=_given(region_threshold, graph.threshold),
                small_share=_given(region_small, graph.small_share),
            )
        )
    if engine == "felzenszwalb":
        edges = FelzenszwalbSegmenter()
        return replace(
            edges,
            region_scale=_given(region_threshold, edges.region_scale),
            region_share=_given(region_small, edges.region_share),
        )
    if engine == "grid":
        return GridSegmenter(region_cell_m=region_threshold)
    if engine == "means":
        return means_segmenter(region_threshold, region_small, threads=threads)
    return TriangleSegmenter(
        regions=replace(
            REGION_POOLS,
            threshold=_given(region_threshold, REGION_POOLS.threshold),
            small_threshold=_given(region_small, REGION_POOLS.small_threshold),
        ),
        fine=replace(FINE_POOLS, threshold=segment_threshold),
        threads=threads,
    )


def means_segmenter(
    region_threshold: float | None, region_small: float | None, *, threads: int = 1
) -> MeanColourSegmenter:
    """Make the engine of mean colours; None for its own threshold and least share."""
    means = MeanColourSegmenter()
    return replace(
        means,
        spread=_given(region_threshold, means.spread),
        small_share=_given(region_small, means.small_share),
        threads=threads,
    )


def segmenter_mesh(
    detail: Mesh, pairs: tuple[Int32, Int32], *, engine: Engine, segment_by: str, threads: int
) -> SegmenterMesh:
    """Give the engine the detail with what it compares: colours, shape or an attribute.

    Parameters
    ----------
    detail : Mesh
    pairs : pair of ndarray
        ``face_pairs`` of the detail.
    engine, segment_by, threads
        As for :func:`make_segmenter`.

    Raises
    ------
    OptionError
        No attribute has the name, or some of its values are not numbers; the shape diameter of a
        surface that is open everywhere.
    """
    mesh = SegmenterMesh(detail.vertices, detail.faces, detail.colours, pairs=pairs)
    if segment_by == COLOUR:
        return mesh
    if segment_by == SHAPE and engine == "graph":
        return replace(mesh, colours=None)  # the graph sees shape itself
    if segment_by == SHAPE:
        diameter = shape_diameter(detail.vertices, detail.faces, threads=threads)
        if not np.isfinite(diameter).any():
            raise OptionError(
                "segments by shape: no ray from any face met the other side; the shape diameter "
                "is for closed bodies, and this surface is open: use --engine graph, or colour"
            )
        return replace(mesh, scalar=shape_index(diameter, pairs[0]))
    return replace(mesh, scalar=_attribute_of_faces(detail, segment_by))


def check_segment_by(segment_by: str, attributes: Iterable[str]) -> None:
    """Refuse to compare by what a survey does not have.

    Parameters
    ----------
    segment_by : str
    attributes : iterable of str
        Names of the survey's attributes.

    Raises
    ------
    OptionError
        It is none of them, nor colour, nor shape.
    """
    known = [COLOUR, SHAPE, *sorted(attributes)]
    if segment_by not in known:
        raise OptionError(f"segments by {segment_by!r}; this survey has {', '.join(known)}")


def _attribute_of_faces(detail: Mesh, name: str) -> Float64:
    """Mean of the attribute over every face's corners."""
    check_segment_by(name, detail.attributes)
    values = detail.attributes[name].astype(np.float64)
    if not np.isfinite(values).all():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        raise OptionError(
            f"segments by {name!r}: {bad} of {len(values)} values are not finite numbers"
        )
    total = values[detail.faces[:, 0]] + values[detail.faces[:, 1]]
    total += values[detail.faces[:, 2]]
    return np.asarray(total / 3.0, dtype=np.float64)


def _given(value: float | None, default: float) -> float:
    return default if value is None else value
