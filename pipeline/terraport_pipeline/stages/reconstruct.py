"""Reconstruct: from the cloud to two meshes of one surface, already aligned.

Screened Poisson, cut to where samples support it; a base thinned from that detail (or solved at a
lower octree depth, as the thesis does); colours and attributes carried from the cloud; the distance
between the two measured. Memory: the solver's (see
:func:`terraport_pipeline.engines.poisson.forecast`), then about 250 bytes per detail face.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.order import order_for_cache
from terraport_payload.types import Float32, Int32
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.engines.thin_detail import thin_detail
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.geometry.clouds.carry import carry_values
from terraport_pipeline.geometry.cover.base_patch import append_surface, base_patch
from terraport_pipeline.geometry.mesh.chunks import side_by_side
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.mesh.trim import close_small_gaps, compact, near_mask
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.model import Mesh
from terraport_pipeline.option import COUNT, Option, check_options
from terraport_pipeline.progress import ESTIMATE_UNIT
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context, Facts, Json, Stored
from terraport_pipeline.stages.trim_detail import HEM_SPACINGS, sampled_ground, trim_detail

__all__ = [
    "BASE_DEPTH",
    "NAME",
    "Options",
    "Reconstructed",
    "choose_detail_depth",
    "restore",
    "run",
    "store",
    "trim_base",
]

NAME: Final = "reconstruct"

BASE_DEPTH: Final = 9
"""Octree depth of a base by "poisson" where none was asked for."""

_MAX_DEPTH: Final = 16
"""The solver's own limit on a 64-bit build."""

_BASE_MARGIN_CELLS: Final = 1.5
"""The base reaches this many of its cells beyond the detail, so that no rim of detail lies over
nothing."""

_GAP_CELLS: Final = 8.0
"""Gaps of the base up to this many of its cells wide, seen from above, are closed again."""

_DEVIATION_SAMPLES: Final = 100_000
"""Detail vertices whose distance to the base is measured; the 99.9th percentile rests on 100."""

_PERCENTILES: Final = (50.0, 95.0, 99.0, 99.9)


@dataclass(frozen=True, slots=True)
class Options:
    """Octree depths, faces of the base and where to cut: how finely to reconstruct."""

    base_from: Annotated[Literal["detail", "poisson"], Option()] = "detail"
    """How the base is made, the coarse mesh that is always there. detail thins the detail: ten
    times nearer to it, and the same outline. poisson solves it apart, as the thesis does."""
    base_depth: Annotated[
        int | None,
        Option(least=3, most=_MAX_DEPTH, unset=f"{BASE_DEPTH}, and below the detail"),
    ] = None
    """Octree depth of a base by poisson; lower is lighter and farther from the detail."""
    detail_depth: Annotated[
        int | None,
        Option(least=3, most=_MAX_DEPTH, unset="where a cell is one spacing of the points wide"),
    ] = None
    """Octree depth of the detail: one less gives a quarter of the faces. More than the density of
    the points supports is lowered to it."""
    base_faces: Annotated[int, Option(least=100, notation=COUNT)] = 200_000
    """Faces that the base is thinned to. Every client holds all of it all the time."""
    trim_spacings: Annotated[float, Option(least=1)] = 4.0
    """Surface farther than this many spacings of the points from a point goes; between what the
    histogram of support says and this, gaps between points stay and borders go. Higher closes more
    holes, and invents more."""
    island_faces: Annotated[int, Option(least=1)] = 200
    """Loose pieces of detail with fewer faces go."""
    point_weight: Annotated[float, Option(least=0, most=100)] = poisson.POINT_WEIGHT
    """How closely Poisson follows the points. Higher follows them and their noise, lower
    smooths."""

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True, slots=True)
class Reconstructed:
    """Base and detail of one surface, and how far they deviate."""

    base: Mesh
    detail: Mesh
    deviation_m: tuple[float, ...]
    """Distance of detail vertices to the base: 50th, 95th, 99th and 99.9th percentile."""
    facts: Facts


def run(cleaned: Cleaned, options: Options, context: Context) -> Reconstructed:
    """Reconstruct base and detail from one cloud.

    Parameters
    ----------
    cleaned : Cleaned
    options : Options
    context : Context

    Returns
    -------
    Reconstructed

    Raises
    ------
    ResourceError
        The forecast, or the solver, passes the memory allowed.
    EngineError
        The solver failed.
    SurveyError
        Nothing is left after trimming.
    """
    progress = context.progress
    warnings: list[str] = []
    base_depth, detail_depth = _choose_depths(cleaned, options, warnings)
    depths = (detail_depth,) if options.base_from == "detail" else (detail_depth, base_depth)
    # (1) solve; what the cloud alone decides is made beside it: the solver takes one core
    with ThreadPoolExecutor(1) as beside:
        waiting = beside.submit(sampled_ground, cleaned) if context.threads > 1 else None
        surfaces, forecasts = _solve(cleaned, options, depths, context)
    ground = sampled_ground(cleaned) if waiting is None else waiting.result()
    solved = [len(faces) for _, faces in surfaces]
    # (2) trim
    progress.start("reconstruct: trim", None, "faces")
    trimmed = trim_detail(
        *surfaces[0],
        cleaned,
        ground,
        largest=options.trim_spacings,
        island_faces=options.island_faces,
        threads=context.threads,
    )
    detail = (trimmed.vertices, trimmed.faces)
    progress.done({"detail faces": len(detail[1]), "islands dropped": trimmed.islands})
    # (3) the base, thinned in processes of its own, and the detail's values beside it
    progress.start("reconstruct: base and colours", None, "faces")
    solved_base = surfaces[1] if len(surfaces) > 1 else None
    del surfaces

    def dress(surface: tuple[Float32, Int32]) -> Mesh:
        return _dress(*surface, cleaned, ground.tree, context.threads)

    def make_base() -> tuple[Mesh, dict[str, Json]]:
        base_counts: dict[str, Json] = {}
        if solved_base is None:
            thinned = thin_detail(
                *trimmed.wide, max_faces=options.base_faces, threads=context.threads
            )
        else:
            cell_m = poisson.SCALE * _extent_m(cleaned) / 2**base_depth
            thinned = trim_base(*solved_base, detail[0], cell_m, threads=context.threads)
            base_counts |= {
                "base_depth": base_depth,
                "base_faces_solved": solved[1],
                "base_faces_trimmed": len(thinned[1]),
            }
            thinned = decimate(*thinned, max_faces=options.base_faces)
        patch = base_patch(
            thinned,
            detail,
            trimmed.wide,
            margin_m=HEM_SPACINGS * cleaned.cloud.spacing_m,
            threads=context.threads,
        )
        base_counts["base_faces_patched"] = len(patch[1])
        thinned = append_surface(thinned, patch)
        # Vertex cache order now: the cover names base faces by number.
        order = order_for_cache(thinned[1].astype(np.uint32))
        return dress((thinned[0], thinned[1][order])), base_counts

    (base, base_counts), detail_mesh = side_by_side(
        [make_base, lambda: dress(detail)], threads=context.threads
    )
    if len(base.faces) > 1.1 * options.base_faces:
        warnings.append(
            f"the base keeps {len(base.faces)} faces, {options.base_faces} were asked: its border "
            "alone needs more; raise --base-faces"
        )
    progress.done({"base faces": len(base.faces)})
    # (4) measure
    deviation_m = _measure(base, detail_mesh, context)
    counts: dict[str, Json] = {
        "base_from": options.base_from,
        "detail_depth": detail_depth,
        "cell_m": poisson.SCALE * _extent_m(cleaned) / 2**detail_depth,
        "detail_faces_solved": solved[0],
        **base_counts,
        "base_faces": len(base.faces),
        "detail_faces": len(detail_mesh.faces),
        "detail_vertices": len(detail_mesh.vertices),
        "islands_dropped": trimmed.islands,
        **trimmed.counts,
        "forecast_memory_bytes": sum(forecast.memory_bytes for forecast in forecasts),
    }
    for percentile, value in zip(_PERCENTILES, deviation_m, strict=True):
        counts[f"deviation_p{percentile:g}_m"] = value
    return Reconstructed(base, detail_mesh, deviation_m, Facts(counts, tuple(warnings)))


def store(result: Reconstructed) -> Stored:
    """Turn the result into arrays and values."""
    arrays = {}
    for level, mesh in (("base", result.base), ("detail", result.detail)):
        for field in ("vertices", "faces", "normals", "colours"):
            arrays[f"{level}-{field}"] = getattr(mesh, field)
        for i, values in enumerate(mesh.attributes.values()):
            arrays[f"{level}-attribute-{i}"] = values
    names = list(result.detail.attributes)
    return Stored(arrays, {"attributes": names, "deviation_m": list(result.deviation_m)})


def restore(stored: Stored, facts: Facts) -> Reconstructed:
    """Turn arrays and values back into the result."""
    arrays, values = stored.arrays, stored.values

    def mesh(level: str) -> Mesh:
        return Mesh(
            vertices=np.asarray(arrays[f"{level}-vertices"], dtype=np.float32),
            faces=np.asarray(arrays[f"{level}-faces"], dtype=np.int32),
            normals=np.asarray(arrays[f"{level}-normals"], dtype=np.float32),
            colours=np.asarray(arrays[f"{level}-colours"], dtype=np.uint8),
            attributes={
                name: np.asarray(arrays[f"{level}-attribute-{i}"], dtype=np.float32)
                for i, name in enumerate(values["attributes"])
            },
        )

    return Reconstructed(mesh("base"), mesh("detail"), tuple(values["deviation_m"]), facts)


def _extent_m(cleaned: Cleaned) -> float:
    return float(np.ptp(cleaned.cloud.points, axis=0).max())


def choose_detail_depth(
    options: Options, extent_m: float, spacing_m: float
) -> tuple[int, list[str]]:
    """Cap the detail's depth by the survey's density.

    Returns
    -------
    depth : int
    warnings : list of str
        One where the user asked for more; what nobody asked for is no news.
    """
    depth = poisson.depth_for(options.detail_depth, extent_m, spacing_m)
    if options.detail_depth is None or depth == options.detail_depth:
        return depth, []
    warning = (
        f"detail depth {depth} instead of {options.detail_depth}: there a cell is one sample "
        f"spacing ({spacing_m:.3g} m); finer cells would only add noise"
    )
    return depth, [warning]


def _choose_depths(cleaned: Cleaned, options: Options, warnings: list[str]) -> tuple[int, int]:
    """Cap the detail by density and put the base below it."""
    spacing_m = cleaned.cloud.spacing_m
    detail, lowered = choose_detail_depth(options, _extent_m(cleaned), spacing_m)
    warnings += lowered
    base = max(1, min(options.base_depth or BASE_DEPTH, detail - 1))
    if options.base_depth is not None and base < options.base_depth:
        warnings.append(
            f"base depth {base} instead of {options.base_depth}: the base stays below the detail"
        )
    return base, detail


def _solve(
    cleaned: Cleaned, options: Options, depths: tuple[int, ...], context: Context
) -> tuple[list[tuple[Float32, Int32]], list[poisson.Forecast]]:
    """Run the reconstructions, the detail's first, within the memory allowed."""
    # (1) Refuse what cannot fit, before an hour of work.
    cloud = cleaned.cloud
    area_m2 = len(cloud.points) * cloud.spacing_m**2
    forecasts = [
        poisson.forecast(len(cloud.points), depth, _extent_m(cleaned), area_m2) for depth in depths
    ]
    allowed = context.max_memory_bytes
    needed = max(forecast.memory_bytes for forecast in forecasts)
    if allowed is not None and needed > allowed:
        raise ResourceError(
            f"reconstruction at depth {depths[0]} needs about {needed / 2**30:.1f} GiB, allowed "
            f"are {allowed / 2**30:.1f} GiB; lower --detail-depth (one less needs about a "
            "quarter), thin the survey with --max-points, or raise --max-memory"
        )
    # (2) Both depths at once where they fit together.
    together = sum(forecast.memory_bytes for forecast in forecasts)
    side_by_side = (
        context.threads > 1 and len(depths) > 1 and (allowed is None or together <= allowed)
    )
    times = [forecast.seconds for forecast in forecasts]
    expected_s = max(times) if side_by_side else sum(times)
    context.progress.start(
        f"reconstruct: Poisson, depth {' and '.join(map(str, depths))}", expected_s, ESTIMATE_UNIT
    )
    surfaces = poisson.reconstruct(
        cloud.points,
        cloud.normals,
        depths,
        context.scratch,
        side_by_side=side_by_side,
        max_memory_bytes=allowed,
        point_weight=options.point_weight,
        tick=context.progress.advance,
    )
    context.progress.done({"faces": sum(len(faces) for _, faces in surfaces)})
    return surfaces, forecasts


def trim_base(
    vertices: Float32, faces: Int32, detail: Float32, cell_m: float, *, threads: int = 1
) -> tuple[Float32, Int32]:
    """Keep every base face near any detail, so that the base lies under all of it.

    Parameters
    ----------
    vertices, faces : ndarray
        Of a base that was solved apart.
    detail : ndarray of shape (V, 3), float32
        Vertices of the detail, or of a surface thinned from it.
    cell_m : float
        Of the base's octree.
    threads : int
    """
    tree = cKDTree(detail, balanced_tree=False)
    keep = near_mask(vertices, faces, tree, margin_m=_BASE_MARGIN_CELLS * cell_m, workers=threads)
    if not keep.any():  # the two surfaces share nothing: keep all rather than leave a hole
        keep[:] = True
    # Where the base bulges and the detail does not (a tree that was an island of the detail), the
    # bulge's top is far from any detail: without it there would be a hole over the ground below.
    keep = close_small_gaps(vertices, faces, keep, max_extent_m=_GAP_CELLS * cell_m)
    return compact(vertices, faces, keep)


def _dress(vertices: Float32, faces: Int32, cleaned: Cleaned, tree: cKDTree, threads: int) -> Mesh:
    """Give a bare surface its normals, colours and attributes."""
    cloud = cleaned.cloud
    colours, attributes = carry_values(
        tree, cloud.colours, cloud.attributes, vertices, codes=cleaned.codes, workers=threads
    )
    return Mesh(vertices, faces, vertex_normals(vertices, faces), colours, attributes)


def _measure(base: Mesh, detail: Mesh, context: Context) -> tuple[float, ...]:
    """Measure how far the detail lies from the base."""
    step = max(1, len(detail.vertices) // _DEVIATION_SAMPLES)
    samples = detail.vertices[::step]
    context.progress.start("reconstruct: deviation", float(len(samples)), "samples")
    distances_m = distances_to_mesh(samples, base.vertices, base.faces, workers=context.threads)
    percentiles_m = tuple(float(value) for value in np.percentile(distances_m, _PERCENTILES))
    context.progress.done({"p99_m": percentiles_m[2]})
    return percentiles_m
