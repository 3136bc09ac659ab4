"""Texture, tile by tile: one levelling over all tiles, an atlas for every segment.

After ``tiled_views.py`` has chosen a photo for every face of every tile:

1. :func:`level`, per tile: what the cells of the smooth corrections want of each other, also across
   the tile's border; :func:`solve` levels the whole scene at once.
2. :func:`draw`, per tile: corrections and blending, and the atlases of its segments.

Both see a band of the neighbours around the tile, whose photos are settled by now: on both sides of
a border the same numbers come out. Memory: about 250 bytes per face with its band, and the photos
that are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.engines.mesh_texels import MeshTexels
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.view_candidates import Candidates
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.geometry.textures.level_sums import (
    LevelSums,
    joined_sums,
    shorter_sums,
    solve_levels,
)
from terraport_pipeline.geometry.textures.seam_blend import Blend, blend_seams, step_sizes
from terraport_pipeline.geometry.textures.seam_levels import (
    field_of_piece,
    level_sums,
    node_levels,
)
from terraport_pipeline.geometry.textures.seams import Nodes, Seams, find_seams, label_nodes
from terraport_pipeline.geometry.tiles.tile_band import Banded
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import choose_views as choosing
from terraport_pipeline.stages.contract import Context, Stored
from terraport_pipeline.stages.texture import Options, texture_mesh
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.tiled_views import TextureScale, banded

__all__ = [
    "DRAW_BYTES_PER_FACE",
    "STEP_BINS",
    "Levels",
    "draw",
    "draw_plain",
    "draw_texels",
    "level",
    "solve",
    "tile_textures",
]

DRAW_BYTES_PER_FACE: Final = 330

_BAND_EDGES: Final = 16.0
"""Width of the band while seams are levelled: the bands along seams are four rings wide, and what
is left at a seam is averaged over four edges along it."""

STEP_BINS: Final = 192
"""Bins of the histograms of steps across seams: a quarter of a level each."""

_BINS_PER_LEVEL: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """The smooth corrections of a whole scene; C cells."""

    keys: Int64
    """(C,) place and view."""
    level: Float64
    """(C, 3) sRGB levels."""


@dataclass(frozen=True, slots=True, eq=False)
class _Settled:
    """A tile and its band whose photos are chosen."""

    piece: Banded
    candidates: Candidates
    nodes: Nodes
    seams: Seams
    own_sides: UInt8
    """(S,) how many of the two faces at every seam are the tile's own."""
    border_pairs: tuple[int, int]
    """Edges between two of the tile's own faces, and between one and a neighbour's."""


def _settled(
    tiles: DetailTiles,
    tile: int,
    chosen: Sequence[Mapping[str, AnyArray]],
    gains: Float32,
    scale: TextureScale,
    context: Context,
) -> _Settled:
    """Put a tile, its band and the photos of all their faces together, and find the seams.

    Parameters
    ----------
    tiles : DetailTiles
    tile : int
    chosen : sequence of mapping
        What :func:`choose` found for every tile; best mapped, for parts of them are read.
    gains, scale, context
        As for :func:`choose`.
    """
    piece = banded(tiles, tile, _BAND_EDGES * scale.edge_m)

    def rows(name: str) -> AnyArray:
        return np.concatenate([chosen[number][name][rows] for number, rows in piece.rows_of_tiles])

    view = rows("view").astype(np.int32)
    seen = rows("candidate_view")
    candidates = Candidates(seen, np.zeros((0, 0), np.uint16), rows("candidate_colour"))
    pairs, edges = face_pairs(piece.faces, len(piece.vertices), threads=context.threads)
    nodes = label_nodes(piece.faces, view, len(piece.vertices))
    plain = choosing.own_colours(piece.faces, piece.colours, gains[-1], threads=context.threads)
    seams = find_seams(
        nodes, piece.faces, view, candidates, plain, gains, pairs, edges, piece.vertices,
        unit_m=scale.edge_m,
    )  # fmt: skip
    own = piece.is_own.astype(np.uint8)
    sides = own[pairs].sum(axis=1)
    counts = int((sides == 2).sum()), int((sides == 1).sum())
    return _Settled(piece, candidates, nodes, seams, own[seams.face].sum(axis=1), counts)


def level(
    tiles: DetailTiles,
    tile: int,
    chosen: Sequence[Mapping[str, AnyArray]],
    gains: Float32,
    scale: TextureScale,
    context: Context,
) -> Stored:
    """Add up what a tile's part of the smooth corrections wants; as `_settled`.

    Seams across the border count half: the tile beyond adds the other half.
    """
    settled = _settled(tiles, tile, chosen, gains, scale, context)
    sums, _ = level_sums(
        settled.piece.vertices, settled.nodes, settled.seams, scale.levels, own=settled.piece.own,
        share=settled.own_sides.astype(np.float64) * 0.5,
    )  # fmt: skip
    short = shorter_sums(sums)
    return Stored({field.name: getattr(short, field.name) for field in fields(LevelSums)}, {})


def solve(sums_of_tiles: Sequence[Mapping[str, AnyArray]]) -> Levels:
    """Level the whole scene; parts from :func:`level`."""
    sums = joined_sums(
        [
            LevelSums(
                **{field.name: np.array(sums_of_tile[field.name]) for field in fields(LevelSums)}
            )
            for sums_of_tile in sums_of_tiles
        ]
    )
    solution, _ = solve_levels(sums)
    return Levels(sums.keys, solution)


def draw(
    tiles: DetailTiles,
    tile: int,
    segments: Int32,
    chosen: Sequence[Mapping[str, AnyArray]],
    levels: Levels,
    opened: OpenPhotos,
    gains: Float32,
    scale: TextureScale,
    options: Options,
    context: Context,
) -> Stored:
    """Make the atlases of a tile's segments from photos.

    Parameters
    ----------
    tiles, tile, chosen, gains, scale, context
        As for `_settled`.
    segments : ndarray of shape (F,), int32
        Segment of every face, from 0.
    levels : Levels
    opened : OpenPhotos
    options : Options

    Returns
    -------
    Stored
        For :func:`tile_textures`, with sums.
    """
    settled = _settled(tiles, tile, chosen, gains, scale, context)
    field, cell = field_of_piece(
        settled.piece.vertices, settled.nodes, scale.levels, levels.keys, levels.level
    )
    smooth = node_levels(
        field, settled.piece.vertices, settled.nodes, cell, threads=context.threads
    )
    blend = blend_seams(
        settled.nodes, settled.seams, smooth, settled.candidates,
        rings=choosing.Options().blend_rings, threads=context.threads,
    )  # fmt: skip
    own = settled.piece.own
    choice = ViewChoice(
        view=np.asarray(chosen[tile]["view"], np.int32),
        blend_view=blend.view[own],
        blend_weight=blend.weight[own],
        correction=blend.correction[own],
        gains=gains,
    )
    steps = _step_sums(settled, smooth, blend)
    del settled, field, cell, smooth, blend
    return _drawn(tiles.load(tile), tile, segments, opened, choice, options, context, steps)


def draw_plain(
    mesh: Mesh, tile: int, segments: Int32, options: Options, context: Context
) -> Stored:
    """Draw a tile's vertex colours into atlases; as :func:`draw`."""
    return _drawn(mesh, tile, segments, None, None, options, context, {})


def draw_texels(
    mesh: Mesh, tile: int, segments: Int32, texels: MeshTexels, options: Options, context: Context
) -> Stored:
    """Carry a textured mesh's own texels over into atlases; as :func:`draw`."""
    return _drawn(mesh, tile, segments, texels, texels.choice(), options, context, {})


def tile_textures(arrays: Mapping[str, AnyArray]) -> TextureSet:
    """Read a tile's textures back; arrays may be mapped."""
    return TextureSet(
        wedges=np.asarray(arrays["wedges"], np.uint16),
        images=arrays["images"],
        offsets=np.asarray(arrays["offsets"], np.int64),
        sides=np.asarray(arrays["sides"], np.int32),
    )


def _drawn(
    mesh: Mesh,
    tile: int,
    segments: Int32,
    shown: OpenPhotos | MeshTexels | None,
    choice: ViewChoice | None,
    options: Options,
    context: Context,
    steps: dict[str, AnyArray],
) -> Stored:
    atlases = texture_mesh(
        mesh, segments, () if shown is None else shown.views,
        shown if isinstance(shown, MeshTexels) or shown is None else shown.photos, choice, options,
        max_side=options.max_side, path=context.scratch / f"{tile:04d}.images",
        threads=context.threads, progress=context.progress, label="texture: atlases",
        pixels=shown.pixels if isinstance(shown, MeshTexels) else None,
    )  # fmt: skip
    textures = atlases.textures
    tally = atlases.sums.tally()
    return Stored(
        {
            "wedges": textures.wedges,
            "images": textures.images,
            "offsets": textures.offsets,
            "sides": textures.sides,
            **tally.arrays(),
            **steps,
        },
        {
            "charts": atlases.sums.charts,
            "drawn": int((~atlases.sums.flat).sum()),
            "used": atlases.sums.used,
        },
    )


def _step_sums(settled: _Settled, smooth: Float32, blend: Blend) -> dict[str, AnyArray]:
    """Sum up the steps across seams, within the tile and across its border.

    Two rows everywhere: within, across (half of it: the tile beyond has the other half).
    ``steps_edges``: edges, and those that part two photos; ``steps_X``: their lengths, by the size
    of the step.
    """
    seams = settled.seams
    share = 0.5 * settled.own_sides
    rows = [settled.own_sides == 2, settled.own_sides == 1]
    arrays: dict[str, AnyArray] = {
        "steps_edges": np.array(
            [
                [count * half, float(row.sum()) * half]
                for count, row, half in zip(settled.border_pairs, rows, (1.0, 0.5), strict=True)
            ]
        )
    }
    for name, sizes in step_sizes(seams, smooth, blend).items():
        at = np.minimum((sizes * _BINS_PER_LEVEL).astype(np.int64), STEP_BINS - 1)
        arrays[f"steps_{name}"] = np.stack(
            [np.bincount(at[row], (share * seams.weight)[row], STEP_BINS) for row in rows]
        )
    return arrays
