"""Figures 5.18 to 5.20: how pools get smaller with Th, sTh 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from terraport_pipeline.geometry.regions.engine_options import REGION_POOLS
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools_many
from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Column, Row, Table
from terraport_research.options import ThesisOptions
from terraport_research.thesis.making import Made, Making, labelled_picture, view_of
from terraport_research.thesis.pieces import thesis_pieces

__all__ = ["make_pools"]

KEY: Final = "pools"
_THRESHOLDS: Final = (0.7, 0.5, 0.35, 0.2)
_STREAMED: Final = 2_000
"""Faces of the smallest segment worth streaming."""


def make_pools(options: ThesisOptions, progress: Progress) -> Made:
    """Cut the three pieces of the page landscapes at falling thresholds."""
    making = Making(
        KEY, "Pools by Th: Figures 5.18 to 5.20", "sTh 0, synthetic quarry", options.seed
    )
    making.say(
        "The pieces of Figures 5.15 to 5.17. The thesis shows pictures and prints no numbers. "
        f"Streamed: share of the faces in pools of {_STREAMED:,} faces or more, which can be sent "
        "as they are; smaller ones a build merges."
    )
    wanted = [replace(REGION_POOLS, threshold=th, small_threshold=0.0) for th in _THRESHOLDS]
    columns = (
        Column("k", "level 2 pools", 0),
        Column("pools", "segments", 0),
        Column("largest", "largest", 1, "% of faces"),
        Column("median", "median", 0, "faces"),
        Column("streamed", "streamed", 1, "% of faces"),
    )
    pieces = thesis_pieces(options.seed)
    progress.start("pools", float(len(pieces)), "pieces")
    for number, piece in enumerate(pieces):
        camera = view_of(piece.vertices, is_body=False)
        rows, pictures = [], []
        results = triangle_pools_many(
            piece.vertices, piece.faces, wanted, colours=piece.colours, pairs=piece.pairs[0]
        )
        for th, pools in zip(_THRESHOLDS, results, strict=True):
            sizes = np.bincount(pools.labels)
            share = 100.0 / len(piece.faces)
            streamed = float(sizes[sizes >= _STREAMED].sum() * share)
            rows.append(
                Row(
                    f"Th {th:g}",
                    (float(pools.k), float(pools.count), float(sizes.max() * share),
                     float(np.median(sizes)), streamed),
                )
            )  # fmt: skip
            picture = labelled_picture(piece.vertices, piece.faces, camera, pools.labels)
            pictures.append((f"Th {th:g}", f"{pools.count:,} segments", picture))
        figure = f"5.{number + 18}"
        making.tables.append(
            Table(figure, f"Figure {figure} in numbers: {piece.title}", "threshold", columns,
                  tuple(rows))
        )  # fmt: skip
        making.figure(figure, f"Figure {figure}: {piece.title}", list(pictures))
        progress.advance(1)
    progress.done({"pieces": len(pieces)})
    return making.made()
