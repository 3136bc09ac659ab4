"""Which engine cuts the surface into regions, by what, and how it is set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from terraport_payload.types import AnyArray, Float64, Int32
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.borders.border_segmenter import BorderSegmenter
from terraport_pipeline.geometry.graph.felzenszwalb import FelzenszwalbSegmenter
from terraport_pipeline.geometry.graph.graph_options import (
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    SHAPE_GRAPH,
)
from terraport_pipeline.geometry.graph.graph_segmenter import GraphSegmenter
from terraport_pipeline.geometry.regions.engine_options import FINE_POOLS, REGION_POOLS
from terraport_pipeline.geometry.regions.grid_segmenter import GridSegmenter
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import (
    Segmenter,
    SegmenterMesh,
    TriangleSegmenter,
)
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.regions import (
    COLOUR,
    LEAST_SIZE_M,
    MOST_SIZES_ACROSS,
    SIZES_ACROSS,
    RegionOptions,
)

__all__ = [
    "SHAPE",
    "border_segmenter",
    "check_segment_by",
    "given",
    "is_closed",
    "make_segmenter",
    "means_segmenter",
    "segmenter_mesh",
    "sized",
]

SHAPE: Final = "shape"
_OPEN: Final = 0.1
"""Faces of a closed surface look to all sides alike: their area vectors sum to nothing. A hill, or
a body with a wall missing, leaves more than this share of its area."""
_SHAPE_RANGE: Final = 2.0
"""Upper end of the shape index with tpa: it gives the thesis's row on Princeton's models."""


def make_segmenter(
    options: RegionOptions, *, is_closed_body: bool = False, threads: int
) -> Segmenter:
    """Make the engine that was asked for.

    Parameters
    ----------
    options : RegionOptions
    is_closed_body : bool
        Whether the surface is a body's, as :func:`is_closed` says: by shape such are cut by other
        defaults than open ground.
    threads : int
        At most; the result does not depend on it.
    """
    small_share = options.small_region_share
    by_shape = options.segment_by == SHAPE
    if options.engine == "borders":
        return border_segmenter(options)
    if options.engine == "graph":
        of_shape = SHAPE_GRAPH if is_closed_body else OPEN_SHAPE_GRAPH
        graph = of_shape if by_shape else COLOUR_GRAPH
        return GraphSegmenter(
            replace(
                graph,
                threshold=given(options.graph_cut_drop, graph.threshold),
                small_share=given(small_share, graph.small_share),
            )
        )
    if options.engine == "felzenszwalb":
        edges = FelzenszwalbSegmenter()
        return replace(
            edges,
            region_scale=given(options.felzenszwalb_scale, edges.region_scale),
            region_share=given(small_share, edges.region_share),
        )
    if options.engine == "grid":
        return GridSegmenter(region_cell_m=options.grid_cell_m)
    if options.engine == "means":
        return means_segmenter(options, threads=threads)
    value_range = _SHAPE_RANGE if by_shape else REGION_POOLS.attribute_range
    return TriangleSegmenter(
        regions=replace(
            REGION_POOLS,
            attribute_range=value_range,
            threshold=given(options.tpa_region_threshold, REGION_POOLS.threshold),
            small_threshold=given(small_share, REGION_POOLS.small_threshold),
        ),
        fine=replace(
            FINE_POOLS,
            attribute_range=value_range,
            threshold=given(options.tpa_segment_threshold, FINE_POOLS.threshold),
        ),
        threads=threads,
    )


def border_segmenter(options: RegionOptions) -> BorderSegmenter:
    """Make the engine of borders, which also works tile by tile."""
    return BorderSegmenter(given(options.borders_size_m, BorderSegmenter().region_size_m))


_Sized = TypeVar("_Sized", bound=RegionOptions)


def sized(options: _Sized, width_m: float) -> _Sized:
    """Return options with a region size, where none is stated, that suits a scene so wide.

    `width_m` is the root of its surface's area.
    """
    if options.engine != "borders" or options.borders_size_m is not None:
        return options
    usual = BorderSegmenter().region_size_m
    size_m = max(min(usual, width_m / SIZES_ACROSS), width_m / MOST_SIZES_ACROSS, LEAST_SIZE_M)
    return replace(options, borders_size_m=size_m)


def is_closed(vertices: AnyArray, faces: Int32) -> bool:
    """Tell a body from ground: whether the faces' area vectors sum to nearly nothing."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    vectors = np.cross(b - a, c - a)
    total = float(np.linalg.norm(vectors, axis=1).sum())
    return total > 0.0 and float(np.linalg.norm(vectors.sum(axis=0))) < _OPEN * total


def means_segmenter(options: RegionOptions, *, threads: int = 1) -> MeanColourSegmenter:
    """Make the engine of mean colours, the one that also works tile by tile."""
    means = MeanColourSegmenter()
    return replace(
        means,
        spread=given(options.means_spread, means.spread),
        small_share=given(options.small_region_share, means.small_share),
        threads=threads,
    )


def segmenter_mesh(
    detail: Mesh, pairs: tuple[Int32, Int32], options: RegionOptions, *, threads: int
) -> SegmenterMesh:
    """Give the engine the detail with what it compares: colours, shape or an attribute.

    Parameters
    ----------
    detail : Mesh
    pairs : pair of ndarray
        ``face_pairs`` of the detail.
    options : RegionOptions
    threads : int
        At most.

    Raises
    ------
    OptionError
        No attribute has the name, or some of its values are not numbers; the shape diameter of a
        surface that is open everywhere.
    """
    mesh = SegmenterMesh(detail.vertices, detail.faces, detail.colours, pairs=pairs)
    if options.segment_by == COLOUR:
        return mesh
    if options.segment_by == SHAPE and options.engine == "graph":
        return replace(mesh, colours=None)  # the graph sees shape itself
    if options.segment_by == SHAPE:
        diameter = shape_diameter(detail.vertices, detail.faces, threads=threads)
        if not np.isfinite(diameter).any():
            raise OptionError(
                "segments by shape: no ray from any face met the other side; the shape diameter "
                "is for closed bodies, and this surface is open: use --engine graph, or colour"
            )
        return replace(mesh, scalar=shape_index(diameter, pairs[0]))
    return replace(mesh, scalar=_attribute_of_faces(detail, options.segment_by))


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
    choices = [COLOUR, SHAPE, *sorted(attributes)]
    if segment_by not in choices:
        raise OptionError(f"segments by {segment_by!r}; this survey has {', '.join(choices)}")


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


def given(value: float | None, default: float) -> float:
    """Return what was stated, else the default; 0 is stated."""
    return default if value is None else value
