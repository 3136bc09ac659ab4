"""Regions of whole real surveys: against drawings, by how much else was flown, and under noise.

Engines run over a whole survey, thinned (``tests/pipeline/geometry/truth/pieces.py``), and are
scored on the pieces of it that were drawn by hand, each twice: the *human* row scores one drawing
against the other. Parameters of ``borders`` were chosen on the pieces marked +.

- *extents*: the same 200 m inside squares of 200, 400, 800 m and all: 1 - RI on the common ground.
- *noise*: colours with 1 and 4 grey levels, brighter by 3 %, and another half of the points: 1 - RI
  against the survey as it is, alone and over the version before, and the share of the ground whose
  region finds its number again.

    python benchmarks/drawn_regions.py --what pieces
    python benchmarks/drawn_regions.py --what extents noise
    python benchmarks/drawn_regions.py --smoke

``--smoke`` takes a small quarry that the project makes instead of surveys. Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float64, Int32, UInt8
from terraport_pipeline.geometry.borders.border_segmenter import (
    BorderSegmenter,
    RegionsBefore,
    compared_steps,
)
from terraport_pipeline.geometry.borders.cells import cells_of_faces
from terraport_pipeline.geometry.mesh.surface_samples import surface_samples
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.regions.region_match import match_regions, region_overlaps
from terraport_pipeline.geometry.regions.segmenter import Segmenter, SegmenterMesh
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh
from terraport_research.plan_scores import DISTANCES_M, PlanScore
from terraport_research.segmentation_scores import rand_error

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/pipeline/geometry/truth"))
from pieces import CHOOSING, PIECES, Piece, load_survey

SEED: Final = 5
ENGINES: Final[dict[str, Segmenter]] = {
    "borders": BorderSegmenter(),
    "means": MeanColourSegmenter(),
}
SQUARES_M: Final = (200.0, 400.0, 800.0)
_SAMPLES: Final = 100_000


def cropped(mesh: SegmenterMesh, kept: Bool) -> SegmenterMesh:
    """Leave only some faces."""
    used, corners = np.unique(mesh.faces[kept], return_inverse=True)
    assert mesh.colours is not None
    faces = corners.reshape(-1, 3).astype(np.int32)
    return SegmenterMesh(mesh.vertices[used], faces, mesh.colours[used])


def over_before(mesh: SegmenterMesh, before: RegionsBefore | None) -> Int32:
    """Regions of ``borders``, with the version before as evidence."""
    engine = BorderSegmenter()
    cells = cells_of_faces(
        mesh.vertices, mesh.faces, compared_steps(mesh), mesh.edge_pairs(), engine.cell_m
    )
    return number_by_first(engine.cut(cells, before).regions[cells.labels])[0]


def row(title: str, scores: list[PlanScore]) -> None:
    """Print the mean of the scores against both drawings."""
    figures = [float(np.mean([score.rand_error for score in scores]))]
    for number in range(len(DISTANCES_M)):
        figures += [
            float(np.mean([score.recall[number] for score in scores])),
            float(np.mean([score.precision[number] for score in scores])),
            float(np.mean([score.f_score(number) for score in scores])),
        ]
    figures += [
        float(np.mean([getattr(score, name) for score in scores]))
        for name in ("regions_per_drawn", "largest_share", "drawn_share")
    ]
    print(f"| {title} | {' | '.join(f'{figure:.3f}' for figure in figures)} |", flush=True)


def pieces(engines: dict[str, Segmenter]) -> None:
    """Score every engine on every piece."""
    heads = "".join(f" recall {d:g} m | precision {d:g} m | F {d:g} m |" for d in DISTANCES_M)
    print(f"\n| piece, engine | 1 - RI |{heads} regions / drawn | largest | drawn |")
    print("| --" * (5 + 3 * len(DISTANCES_M)) + " |")
    for survey in dict.fromkeys(Piece(name).survey for name in PIECES):
        mesh = load_survey(survey)
        if mesh is None:
            print(f"{survey}: not there, left out", file=sys.stderr)
            continue
        labels, seconds = {}, {}
        for name, engine in engines.items():
            start = time.process_time()
            labels[name] = engine.segment(
                SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
            ).regions
            seconds[name] = round(time.process_time() - start, 1)
        for piece in (Piece(name) for name in PIECES):
            if piece.survey != survey:
                continue
            ground, nearest = piece.nearest_faces(mesh)
            title = piece.name + " +" * (piece.name in CHOOSING)
            row(f"{title}: human", piece.human_scores(ground))
            for name, regions in labels.items():
                row(f"{title}: {name}", piece.scores(regions, ground, nearest))
        print(f"{survey}: {len(mesh.faces):,} faces, CPU s {seconds}", file=sys.stderr)


def extents(name: str, mesh: SegmenterMesh, engines: dict[str, Segmenter]) -> None:
    """Compare the same ground inside smaller and larger surveys."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)[:, [0, 2]]
    offset = np.abs(middle - np.median(middle, axis=0)).max(axis=1)
    for engine_name, engine in engines.items():
        whole = engine.segment(mesh).regions
        figures = []
        for side in SQUARES_M:
            kept = offset < side / 2
            common = offset[kept] < SQUARES_M[0] / 2
            regions = engine.segment(cropped(mesh, kept)).regions[common]
            of_whole = whole[kept][common]
            figures.append(f"{rand_error(of_whole, regions):.3f} ({len(np.unique(regions))})")
        count = len(np.unique(whole[offset < SQUARES_M[0] / 2]))
        print(f"| {name}, {engine_name} | {' | '.join(figures)} | ({count}) |", flush=True)


def noise(name: str, mesh: SegmenterMesh, engines: dict[str, Segmenter]) -> None:
    """Compare regions of the same ground with noise, another gain, and other points."""
    assert mesh.colours is not None
    rng = np.random.default_rng(SEED)
    colours = mesh.colours.astype(np.float64)
    variants: dict[str, UInt8] = {
        "1 level": _rounded(colours + rng.normal(0.0, 1.0, colours.shape)),
        "4 levels": _rounded(colours + rng.normal(0.0, 4.0, colours.shape)),
        "gain 1.03": _rounded(colours * 1.03),
    }
    moved = (mesh.vertices + rng.normal(0.0, 0.03, mesh.vertices.shape)).astype(np.float32)
    meshes = {
        title: SegmenterMesh(mesh.vertices, mesh.faces, changed)
        for title, changed in variants.items()
    }
    meshes["3 cm, 2 levels, gain 1.03"] = SegmenterMesh(
        moved, mesh.faces, _rounded(colours * 1.03 + rng.normal(0.0, 2.0, colours.shape))
    )
    for engine_name, engine in engines.items():
        regions = engine.segment(mesh).regions
        old = _samples(mesh, regions)
        for title, changed in meshes.items():
            ways: dict[str, Any] = {"alone": engine.segment(changed).regions}
            if engine_name == "borders":
                before = RegionsBefore(old.points, old.labels)
                ways["over the version before"] = over_before(changed, before)
            for way, again in ways.items():
                new = _samples(changed, again)
                mine, theirs = match_regions(region_overlaps(new, old))
                # Ground that has the number it had: its new region goes on as its old one.
                number = np.full(int(again.max()) + 1, -1)
                number[mine] = theirs
                kept = float((number[again] == regions).mean())
                print(
                    f"| {name}, {engine_name}, {way} | {title} | "
                    f"{rand_error(regions, again):.3f} | {kept:.3f} | "
                    f"{_largest(regions):.2f} |",
                    flush=True,
                )


def _samples(mesh: SegmenterMesh, regions: AnyInt) -> Any:
    step = max(1, len(mesh.faces) // _SAMPLES)
    return surface_samples(mesh.vertices, mesh.faces, regions, faces_per_sample=step, at_least=32)


def _rounded(colours: Float64) -> UInt8:
    return np.rint(np.clip(colours, 0.0, 255.0)).astype(np.uint8)


def _largest(regions: Int32) -> float:
    return float(np.bincount(regions).max() / len(regions))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--what", nargs="+", choices=["pieces", "extents", "noise"],
                        default=["pieces", "extents", "noise"])  # fmt: skip
    parser.add_argument("--engines", nargs="+", choices=list(ENGINES), default=list(ENGINES))
    parser.add_argument("--surveys", nargs="+", help="paths under the shared data")
    parser.add_argument("--smoke", action="store_true", help="a small quarry, no surveys")
    arguments = parser.parse_args()
    engines = {name: ENGINES[name] for name in arguments.engines}
    meshes = {}
    if arguments.smoke:
        surface = truth_mesh(QuarryOptions(seed=SEED), 8.0)
        meshes["quarry"] = SegmenterMesh(surface.vertices, surface.faces, surface.colours)
    else:
        if "pieces" in arguments.what:
            pieces(engines)
        for path in arguments.surveys or sorted({Piece(name).survey for name in PIECES}):
            mesh = load_survey(path) if arguments.what != ["pieces"] else None
            if mesh is not None:
                name = path.partition("/")[0]
                meshes[name] = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    if "extents" in arguments.what:
        heads = " | ".join(f"{side:g} m" for side in SQUARES_M)
        print(
            f"\n| 1 - RI against all (regions on 200 m) | {heads} | all |\n"
            "| -- | -- | -- | -- | -- |"
        )
        for name, mesh in meshes.items():
            if np.ptp(mesh.vertices, axis=0).max() > SQUARES_M[0]:
                extents(name, mesh, engines)
    if "noise" in arguments.what:
        print("\n| survey | change | 1 - RI | ground that keeps its number | largest region |")
        print("| -- | -- | -- | -- | -- |")
        for name, mesh in meshes.items():
            noise(name, mesh, engines)


if __name__ == "__main__":
    main()
