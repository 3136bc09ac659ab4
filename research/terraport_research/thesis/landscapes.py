"""Tables 5.1 to 5.3 and Figures 5.15 to 5.17: TPA, SD, FP and others on pieces of landscape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from terraport_payload.types import Int32
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.geometry.regions.engine_options import REGION_POOLS
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh, segmenter_by_name
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools
from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Column, Row, Table
from terraport_research.cutters import CUTTERS, Body
from terraport_research.options import ThesisOptions
from terraport_research.segmentation_scores import rand_error
from terraport_research.thesis.making import Made, Making, labelled_picture, plain_picture, view_of
from terraport_research.thesis.pieces import Piece, closed_below, thesis_pieces

__all__ = ["make_landscapes"]

KEY: Final = "landscapes"
_THESIS: Final = {
    "TPA": (0.017, 0.052, 0.195),
    "SD": (0.312, 0.372, 0.330),
    "FP": (0.121, 0.221, 0.121),
}
"""1 - RI of scenes 1 to 3, as printed in Tables 5.1 to 5.3."""
_BY_COLOUR: Final = ("means", "borders")
"""Engines of a build that see colour, beside the thesis's algorithms."""
_TPA: Final = "tpa"

Cut = Callable[[Piece], Int32]


def make_landscapes(options: ThesisOptions, progress: Progress) -> Made:
    """Cut three pieces of ground by every algorithm and score them against the truth."""
    mode = f"Th {REGION_POOLS.threshold:g}, sTh {REGION_POOLS.small_threshold:g}, synthetic quarry"
    making = Making(KEY, "Landscapes: Tables 5.1 to 5.3, Figures 5.15 to 5.17", mode, options.seed)
    making.say(
        "Not the thesis's scenes, whose meshes and drawings were not published: three pieces of a "
        "synthetic quarry with photographed colours (noise, shadows), whose regions the generator "
        "knows, the ground alone, without boulders and plants. TPA sees colour, as there; "
        "shape-diameter and other algorithms for bodies see "
        "shape alone. Where one needs a closed body the piece is given walls and a floor. What is "
        "told k is told the true number."
    )
    pieces = thesis_pieces(options.seed)
    cuts = _cuts(options)
    progress.start("pieces", float(len(pieces) * len(cuts)), "cuts")
    for number, piece in enumerate(pieces):
        rows = []
        camera = view_of(piece.vertices, is_body=False)
        count = int(piece.regions.max()) + 1
        pictures: list[tuple[str, str, bytes | None]] = [
            (piece.title, f"{len(piece.faces):,} faces",
             plain_picture(piece.vertices, piece.faces, camera, piece.colours)),
            ("Ground truth", f"{count} regions",
             labelled_picture(piece.vertices, piece.faces, camera, piece.regions)),
        ]  # fmt: skip
        for title, printed, cut in cuts:
            thesis = (_THESIS[printed][number],) if printed in _THESIS else (None,)
            try:
                labels = cut(piece)
            except Exception as error:  # noqa: BLE001  an algorithm that fails is a result
                rows.append(Row(title, (None, None), (*thesis, None), f"failed: {error}"))
                progress.advance(1)
                continue
            apart = rand_error(labels, piece.regions)
            found = len(np.unique(labels))
            rows.append(Row(title, (apart, float(found)), (*thesis, None)))
            words = f"1 - RI {apart:.3f}, {found:,} segments"
            pictures.append(
                (title, words, labelled_picture(piece.vertices, piece.faces, camera, labels))
            )
            progress.advance(1)
        table = f"5.{number + 1}"
        columns = (Column("ri", "1 - RI"), Column("segments", "segments", 0))
        making.tables.append(
            Table(table, f"Table {table}: 1 - RI on {piece.title}", "algorithm", columns,
                  tuple(rows))
        )  # fmt: skip
        figure = f"5.{number + 15}"
        making.figure(figure, f"Figure {figure}: {piece.title}", pictures)
    progress.done({"pieces": len(pieces)})
    return making.made()


def _cuts(options: ThesisOptions) -> list[tuple[str, str, Cut]]:
    """Title, the thesis's name and the function of every algorithm."""
    cuts: list[tuple[str, str, Cut]] = [("Triangle Pool Algorithm, by colour", "TPA", _pools)]
    for key in options.algorithms:
        if key == _TPA:
            continue  # it is here by colour, as in the thesis
        cutter = CUTTERS[key]
        cuts.append((cutter.title, cutter.thesis, _by_shape(key, options.seed)))
    cuts += [(f"terraport build --engine {name}", "", _by_engine(name)) for name in _BY_COLOUR]
    cuts.append(("All one region", "", lambda piece: np.zeros(len(piece.faces), np.int32)))
    return cuts


def _pools(piece: Piece) -> Int32:
    return triangle_pools(
        piece.vertices, piece.faces, colours=piece.colours, pairs=piece.pairs[0]
    ).labels


def _by_engine(name: str) -> Cut:
    def cut(piece: Piece) -> Int32:
        mesh = SegmenterMesh(piece.vertices, piece.faces, piece.colours, pairs=piece.pairs)
        return segmenter_by_name(name).segment(mesh).regions

    return cut


def _by_shape(key: str, seed: int) -> Cut:
    def cut(piece: Piece) -> Int32:
        k = int(piece.regions.max()) + 1
        try:
            body = Body(piece.vertices.astype(np.float64), piece.faces, seed)
            return CUTTERS[key].prepare(body)(k)
        except PipelineError:
            vertices, faces = closed_below(piece)
            body = Body(vertices.astype(np.float64), faces, seed)
            return CUTTERS[key].prepare(body)(k)[: len(piece.faces)]

    return cut
