"""The base: every tile of the detail thinned by itself, then all of them together.

What tiles share is held while they are thinned apart, so the pieces still fit each other bit for
bit. It starts from the wider surface that the join cuts beside the detail: with a hem, and without
the smaller gaps (``tile_edges.py``). A base by Poisson is solved on the thinned survey and cut to
that surface. Memory: one tile, then about 500 bytes per face of four times the base; for a base by
Poisson what its forecast says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import attrgetter
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Int32
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.engines.thin_detail import thin_block, thin_detail
from terraport_pipeline.geometry.clouds.carry import carry_values
from terraport_pipeline.geometry.cover.base_patch import append_surface, base_patch
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.mesh.face_blocks import weld
from terraport_pipeline.geometry.mesh.trim import (
    close_small_gaps,
    compact,
    island_mask,
    near_mask,
)
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.geometry.segments.strip_order import strip_order
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.reconstruct import BASE_DEPTH, Options
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context, Facts, Form, Json, Stored
from terraport_pipeline.stages.tiles.detail_tiles import StoredTiles
from terraport_pipeline.stages.tiles.tile_edges import HEM_SPACINGS

__all__ = [
    "FORM",
    "NAME",
    "THIN_BYTES_PER_FACE",
    "TiledBase",
    "faces_wanted",
    "first_share",
    "run",
    "thin_tile",
]

NAME: Final = "base"

THIN_BYTES_PER_FACE: Final = 500
"""Of a part while it is thinned by itself, in a process of its own."""

_FIRST_SHARE: Final = 4
"""Faces left after tiles were thinned apart, as multiple of what is wanted; see `thin_detail`."""

_BASE_MARGIN_CELLS: Final = 1.5
"""A base by Poisson reaches this many of its cells beyond the detail, so that no rim of detail lies
over nothing."""

_GAP_CELLS: Final = 8.0
"""Gaps of such a base up to this many of its cells wide, seen from above, are closed again."""

_DETAIL_SHARE: Final = 8
"""Faces of the detail over those of the base, at least. Beside a detail of 160,000 faces a base of
as many was half of the scene's bytes."""

_LEAST_FACES: Final = 2_000
"""Faces up to which the share of the detail does not count: so few cost nothing, and the border and
its hem alone need as many."""

_DEVIATION_SAMPLES: Final = 100_000
"""Detail vertices whose distance to the base is measured; the 99.9th percentile rests on 100."""

_PERCENTILES: Final = (50.0, 95.0, 99.0, 99.9)


@dataclass(frozen=True, slots=True, eq=False)
class TiledBase:
    """The base and how far the detail lies from it."""

    base: Mesh
    deviation_m: tuple[float, ...]
    facts: Facts


def run(
    cleaned: Cleaned,
    tiles: StoredTiles,
    thinned: Sequence[Stored],
    share: float,
    options: Options,
    context: Context,
) -> TiledBase:
    """Make the base.

    Parameters
    ----------
    cleaned : Cleaned
        The thinned survey; gives the base its colours and attributes.
    tiles : StoredTiles
    thinned : sequence of Stored
        From :func:`thin_tile`, of every part.
    share : float
        From :func:`first_share`.
    options : Options
    context : Context

    Raises
    ------
    ResourceError, EngineError
        As :func:`terraport_pipeline.engines.poisson.reconstruct`, with a base by Poisson.
    """
    # (1) Tiles thinned each by itself and joined, then thinned as a whole or solved again.
    wanted = faces_wanted(options.base_faces, sum(tiles.faces))
    context.progress.start("base: whole", None, "faces")
    vertices, joined = _joined(thinned, share, options.island_faces)
    counts: dict[str, Json] = {
        "base_from": options.base_from,
        "base_faces_before": len(joined),
        "base_faces_wanted": wanted,
    }
    if options.base_from == "poisson":
        thin, triangles, counts["base_depth"] = _solved(cleaned, vertices, wanted, options, context)
    else:
        thin, triangles = thin_detail(vertices, joined, max_faces=wanted, threads=context.threads)
    # (2) Patches where the thinned surface lost what a tile still has.
    patches = [
        base_patch(
            (thin, triangles),
            (tile.vertices, tile.faces),
            tiles.base_part(tiles.base_names.index(tiles.names[i])),
            margin_m=HEM_SPACINGS * cleaned.cloud.spacing_m,
            threads=context.threads,
        )
        for i in range(tiles.count)
        if len((tile := tiles.load(i)).faces)
    ]
    counts["base_faces_patched"] = sum(len(faces) for _, faces in patches)
    thin, triangles = reduce(append_surface, patches, (thin, triangles))
    # Strips now: they pack best, and the cover names base faces by number.
    triangles = triangles[strip_order(triangles)]
    # (3) Values of the cloud's nearest samples.
    cloud = cleaned.cloud
    tree = cKDTree(cloud.points, balanced_tree=False)
    colours, attributes = carry_values(
        tree,
        cloud.colours,
        cloud.attributes,
        thin,
        codes=cleaned.codes,
        workers=context.threads,
    )
    base = Mesh(thin, triangles, vertex_normals(thin, triangles), colours, attributes)
    context.progress.done({"base faces": len(triangles)})
    # (4) How far the detail is from it, by samples of every tile.
    step = max(1, sum(tiles.vertex_count(i) for i in range(tiles.count)) // _DEVIATION_SAMPLES)
    picked = np.concatenate([tiles.load(i).vertices[::step].copy() for i in range(tiles.count)])
    context.progress.start("base: deviation", float(len(picked)), "samples")
    distances_m = distances_to_mesh(picked, thin, triangles, workers=context.threads)
    percentiles_m = tuple(float(value) for value in np.percentile(distances_m, _PERCENTILES))
    context.progress.done({"p99_m": percentiles_m[2]})
    choices: list[str] = []
    if options.base_from == "poisson" and counts["base_depth"] < (options.base_depth or 0):
        choices.append(
            f"base depth {counts['base_depth']} instead of {options.base_depth}: finer cells than "
            "the samples that the base is solved on would only add noise"
        )
    if len(triangles) > 1.1 * options.base_faces:
        choices.append(
            f"the base keeps {len(triangles)} faces, {options.base_faces} were asked: its border "
            "alone needs more; raise --base-faces"
        )
    counts["base_faces"] = len(triangles)
    for percentile, value in zip(_PERCENTILES, percentiles_m, strict=True):
        counts[f"deviation_p{percentile:g}_m"] = value
    return TiledBase(base, percentiles_m, Facts(counts, choices=tuple(choices)))


def faces_wanted(most: int, detail_faces: int) -> int:
    """How many faces a base is thinned to.

    Examples
    --------
    >>> faces_wanted(200_000, 800_000), faces_wanted(200_000, 9_000), faces_wanted(1_000, 9_000)
    (100000, 2000, 1000)
    """
    return min(most, max(detail_faces // _DETAIL_SHARE, _LEAST_FACES))


def first_share(tiles: StoredTiles, options: Options) -> float:
    """Share of its faces that each tile keeps when it is thinned by itself.

    Four times the base's faces in all; rounded down to a quarter of a power of two, so that it
    stays what it is when a few tiles change.

    Examples
    --------
    >>> round(2.0 ** (math.floor(4 * math.log2(0.3)) / 4), 3)
    0.297
    """
    total = sum(tiles.base_faces)
    first = _FIRST_SHARE * faces_wanted(options.base_faces, sum(tiles.faces))
    if total <= 2 * first:
        return 1.0
    return float(2.0 ** (math.floor(4.0 * math.log2(first / total)) / 4.0))


def thin_tile(tiles: StoredTiles, part: int, share: float, context: Context) -> Stored:
    """Thin one part of the surface that the base is made from, holding its border bit for bit."""
    vertices, faces = tiles.base_part(part)
    if len(faces) and share < 1.0:
        vertices, faces = thin_block(
            vertices, faces, max_faces=max(1, round(len(faces) * share)), threads=context.threads
        )
    return Stored({"vertices": vertices, "faces": faces}, {})


def _joined(thinned: Sequence[Stored], share: float, island_faces: int) -> tuple[Float32, Int32]:
    """Join tiles that were thinned apart, bit for bit, without loose pieces."""
    pieces = [
        (np.array(stored.arrays["vertices"]), np.array(stored.arrays["faces"]))
        for stored in thinned
        if len(stored.arrays["faces"])
    ]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
    numbered = [piece[1] + np.int32(start) for piece, start in zip(pieces, starts, strict=False)]
    vertices, joined = weld(np.concatenate([v for v, _ in pieces]), np.concatenate(numbered))
    del pieces, numbered
    # Loose pieces that the detail dropped; half as strict, for thinning leaves each another share.
    least = max(1, int(0.5 * share * island_faces))
    keep, _ = island_mask(joined, len(vertices), min_faces=least)
    return compact(vertices, joined, keep)


def _solved(
    cleaned: Cleaned, near: Float32, wanted: int, options: Options, context: Context
) -> tuple[Float32, Int32, int]:
    """Solve the base on the thinned survey and cut it to what lies near the detail."""
    cloud = cleaned.cloud
    extent_m = float(np.ptp(cloud.points, axis=0).max())
    depth = poisson.depth_for(options.base_depth or BASE_DEPTH, extent_m, cloud.spacing_m)
    surface = poisson.reconstruct(
        cloud.points,
        cloud.normals,
        depth,
        context.scratch,
        max_memory_bytes=context.max_memory_bytes,
        point_weight=options.point_weight,
    )
    cell_m = poisson.SCALE * extent_m / 2**depth
    base = _trim_base(*surface, near, cell_m, threads=context.threads)
    return *decimate(*base, max_faces=wanted), depth


def _trim_base(
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


def _store(result: TiledBase) -> Stored:
    mesh = result.base
    arrays = {
        f"base-{field}": getattr(mesh, field)
        for field in ("vertices", "faces", "normals", "colours")
    }
    for i, values in enumerate(mesh.attributes.values()):
        arrays[f"base-attribute-{i}"] = values
    return Stored(
        arrays, {"attributes": list(mesh.attributes), "deviation_m": list(result.deviation_m)}
    )


def _restore(stored: Stored, facts: Facts) -> TiledBase:
    arrays, values = stored.arrays, stored.values
    base = Mesh(
        np.asarray(arrays["base-vertices"], np.float32),
        np.asarray(arrays["base-faces"], np.int32),
        np.asarray(arrays["base-normals"], np.float32),
        np.asarray(arrays["base-colours"], np.uint8),
        {
            name: np.asarray(arrays[f"base-attribute-{i}"], np.float32)
            for i, name in enumerate(values["attributes"])
        },
    )
    return TiledBase(base, tuple(values["deviation_m"]), facts)


FORM: Final = Form(_store, _restore, attrgetter("facts"))
