"""The base of a detail in tiles: every tile thinned by itself, then all of them together.

As the whole build's base, with a tile in place of a block: what tiles share is held while they are
thinned apart, so the pieces still fit each other bit for bit. Memory: one tile, then about 500
bytes per face of four times the base.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.order import order_for_cache
from terraport_pipeline.engines.thin_detail import thin_block, thin_detail
from terraport_pipeline.geometry.carry import carry_values
from terraport_pipeline.geometry.deviation import distances_to_mesh
from terraport_pipeline.geometry.face_blocks import weld
from terraport_pipeline.geometry.vertex_normals import vertex_normals
from terraport_pipeline.model import Float32, Mesh
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context, Facts, Json, Stored
from terraport_pipeline.stages.reconstruct import Options
from terraport_pipeline.tiles import DetailTiles

__all__ = ["NAME", "TiledBase", "restore", "run", "store"]

NAME: Final = "tiled_base"

_FIRST_SHARE: Final = 4
"""Faces left after tiles were thinned apart, as multiple of what is wanted; see `thin_detail`."""

_DEVIATION_SAMPLES: Final = 100_000

_PERCENTILES: Final = (50.0, 95.0, 99.0, 99.9)


@dataclass(frozen=True, slots=True, eq=False)
class TiledBase:
    """The base and how far the detail lies from it."""

    base: Mesh
    deviation_m: tuple[float, ...]
    facts: Facts


def run(cleaned: Cleaned, tiles: DetailTiles, options: Options, context: Context) -> TiledBase:
    """Make the base.

    Parameters
    ----------
    cleaned : Cleaned
        The thinned survey; gives the base its colours and attributes.
    tiles : DetailTiles
    options : Options
        ``base_faces``.
    context : Context
    """
    total = sum(tiles.face_count(i) for i in range(tiles.count))
    wanted = _FIRST_SHARE * options.base_faces
    context.progress.start("base: tiles", float(tiles.count), "tiles")
    parts = []
    samples: list[Float32] = []
    step = max(1, sum(tiles.vertex_count(i) for i in range(tiles.count)) // _DEVIATION_SAMPLES)
    for i in range(tiles.count):
        mesh = tiles.load(i)
        samples.append(mesh.vertices[::step].copy())
        share = max(1, round(len(mesh.faces) * wanted / total))
        if total > 2 * wanted:
            parts.append(
                thin_block(mesh.vertices, mesh.faces, max_faces=share, threads=context.threads)
            )
        else:
            parts.append((mesh.vertices, mesh.faces))
        context.progress.advance(1.0)
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [part[1] + np.int32(base) for part, base in zip(parts, first, strict=False)]
    vertices, joined = weld(np.concatenate([v for v, _ in parts]), np.concatenate(faces))
    del parts
    context.progress.done({"faces": len(joined)})
    context.progress.start("base: whole", None, "faces")
    thin, triangles = thin_detail(
        vertices, joined, max_faces=options.base_faces, threads=context.threads
    )
    # Vertex cache order now: the cover names base faces by number.
    triangles = triangles[order_for_cache(triangles.astype(np.uint32))]
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
    picked = np.concatenate(samples)
    context.progress.start("base: deviation", float(len(picked)), "samples")
    distances_m = distances_to_mesh(picked, thin, triangles, workers=context.threads)
    found = tuple(float(value) for value in np.percentile(distances_m, _PERCENTILES))
    context.progress.done({"p99_m": found[2]})
    warnings: list[str] = []
    if len(triangles) > 1.1 * options.base_faces:
        warnings.append(
            f"the base keeps {len(triangles)} faces, {options.base_faces} were asked: its border "
            "alone needs more; raise --base-faces"
        )
    counts: dict[str, Json] = {"base_faces": len(triangles), "base_faces_before": len(joined)}
    for percentile, value in zip(_PERCENTILES, found, strict=True):
        counts[f"deviation_p{percentile:g}_m"] = value
    return TiledBase(base, found, Facts(counts, tuple(warnings)))


def store(result: TiledBase) -> Stored:
    """Turn the result into arrays and values."""
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


def restore(stored: Stored, facts: Facts) -> TiledBase:
    """Turn arrays and values back into the result."""
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
