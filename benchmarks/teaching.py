"""Teaching: how much ground gets its right name from three strokes per name, and how fast.

Truth: pieces of real surveys with regions drawn by hand (``tests/pipeline/geometry/truth``; where
``../shared/data`` holds them), and the true surface of
procedural quarries, each face with its material (boulders, nobody's region, are not scored;
grassland, bushes and trees are one). *visible*: materials that differ in colour, as in
``synth/truth_regions.py``. *forms*: all of them, so that road, bench and rock face, of nearly one
colour, have to be told apart by form. Of drawn pieces *places* gives every drawn region a name of
its own, *kinds* leaves out of its name where it lies: lawn_west and lawn_east are lawn.

A stroke is a line between two places of one name, at most 16 squares long, four wide. Each draw has
other strokes. Accuracy is the share of the area with truth that lies in a region of its name.
*Next survey*: the same ground with 3 cm of noise on every vertex, red by 3 % brighter and one grey
level of noise, named by the model of the first, without strokes.

    python benchmarks/teaching.py
    python benchmarks/teaching.py --faces 5M --only speed
    python benchmarks/teaching.py --only drawn --pieces churo_river red_rocks_meadow --strokes 10
    python benchmarks/teaching.py --smoke

Chosen was on quarries of seeds 3 and 4, which are not among those here, and on pieces apaxco_pit
and churo_fields, marked +. Prints Markdown; seconds are CPU seconds
of all threads.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from terraport_payload.types import Int32
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.model import Mesh
from terraport_pipeline.naming.drawings import Drawing
from terraport_pipeline.naming.taught_file import taught_file
from terraport_pipeline.naming.teacher import STROKE_CELLS, Teacher, stroke_areas
from terraport_pipeline.option import parse_count
from terraport_pipeline.published.ground import Ground
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import truth_mesh
from terraport_pipeline.synth.truth_regions import families
from terraport_store import RegionNames

DRAWS = 5
STROKES = 3
SEEDS = (11, 12)
CHOSEN_ON = ("apaxco_pit", "churo_fields")
WHERE = frozenset({
    "west", "east", "north", "south", "n", "s", "e", "w", "nw", "ne", "se", "sw", "mid", "corner",
    "far", "low", "w1", "w2", "w3", "southwest", "southeast", "northeast", "northwest", "inner",
    "outer",
})  # fmt: skip
"""Words of a drawn region's name that say where it lies."""
THREADS = 2


@dataclass(frozen=True)
class Piece:
    """Ground with a true name for some faces."""

    title: str
    ground: Ground
    truth: Int32
    """(F,) -1 without."""
    names: tuple[str, ...]


def ground_of(mesh: Mesh) -> Ground:
    """Ground that no scene has published."""
    none = np.zeros(len(mesh.faces), np.int32)
    return Ground("", {"regions": [{}]}, RegionNames(), mesh, none, none)


def drawn_pieces(wanted: Sequence[str] = ()) -> Iterator[Piece]:
    """Pieces of real surveys, those that are there: the ground of each one's box alone.

    Each under both truths; `wanted` of them, or all.
    """
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/pipeline/geometry/truth"))
    import pieces

    for name in wanted or pieces.PIECES:
        drawn = pieces.Piece(name)
        survey = pieces.load_survey(drawn.survey)
        if survey is None:
            print(f"{name}: survey not there, left out", file=sys.stderr)
            continue
        west, south, east, north = drawn.drawings[0]["box"]
        x, y = survey.plan_middles().T
        inside = np.flatnonzero((x >= west) & (x < east) & (y >= south) & (y < north))
        used, corners = np.unique(survey.faces[inside], return_inverse=True)
        faces = corners.reshape(-1, 3).astype(np.int32)
        vertices = survey.vertices[used]
        mesh = Mesh(vertices, faces, vertex_normals(vertices, faces), survey.colours[used], {})
        middles, (raster, _) = drawn.rasters
        of_face = raster.reshape(-1)[
            cKDTree(middles.reshape(-1, 2)).query(np.stack([x, y], axis=1)[inside])[1]
        ]
        kinds = [
            k for k in np.unique(of_face[of_face >= 0]) if np.count_nonzero(of_face == k) > 200
        ]
        truth = np.full(len(faces), -1, np.int32)
        for number, kind in enumerate(kinds):
            truth[of_face == kind] = number
        title = f"{name} +" if name in CHOSEN_ON else name
        places = tuple(region_names(drawn.drawings)[kind] for kind in kinds)
        ground = ground_of(mesh)
        yield Piece(f"{title}, places", ground, truth, places)
        called = [kind_of(place) for place in places]
        merged = tuple(sorted(set(called)))
        if 1 < len(merged) < len(places):
            of_place = np.array([*(merged.index(kind) for kind in called), -1], np.int32)
            yield Piece(f"{title}, kinds", ground, of_place[truth], merged)


def region_names(drawings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of a piece's regions, in the order in which its rasters number them."""
    names: dict[str, None] = {}
    for drawing in drawings:
        for feature in drawing["features"]:
            if feature["properties"]["region"] is not None:
                names[feature["properties"]["region"]] = None
    return list(names)


def kind_of(place: str) -> str:
    """Name of a region but for where it lies."""
    return "_".join(word for word in place.split("_") if word not in WHERE) or place


def quarry_mesh(seed: int, edge_m: float) -> tuple[Mesh, Int32]:
    """Make a procedural quarry as photographed, and the material of its faces."""
    made = truth_mesh(QuarryOptions(seed=seed, colour_noise=4.0, shadows=0.45), edge_m)
    normals = vertex_normals(made.vertices, made.faces)
    return Mesh(made.vertices, made.faces, normals, made.colours, {}), made.material.astype(
        np.int32
    )


def quarry_pieces(seeds: tuple[int, ...], edge_m: float) -> Iterator[Piece]:
    """Quarries under both truths."""
    for seed in seeds:
        mesh, material = quarry_mesh(seed, edge_m)
        ground = ground_of(mesh)
        forms = families("material")
        forms[[Material.TREE, Material.BUSH]] = Material.GRASSLAND
        for title, family in (("visible", families("visible")), ("forms", forms)):
            kind = np.where(material == Material.BOULDER, -1, family[material])
            kinds = [k for k in np.unique(kind[kind >= 0]) if np.count_nonzero(kind == k) > 200]
            truth = np.full(len(kind), -1, np.int32)
            for number, k in enumerate(kinds):
                truth[kind == k] = number
            names = tuple(f"kind {k}" for k in kinds)
            yield Piece(f"quarry {seed}, {title}", ground, truth, names)


def strokes_on(
    piece: Piece, cell_m: float, rng: np.random.Generator, strokes: int = STROKES
) -> list[Drawing]:
    """Three strokes per name, or so many: both ends of each lie on ground of that name."""
    plan = piece.ground.centres[:, [0, 2]]
    drawn = []
    for kind, name in enumerate(piece.names):
        faces = np.flatnonzero(piece.truth == kind)
        for _ in range(strokes):
            start = plan[rng.choice(faces)]
            near = faces[np.linalg.norm(plan[faces] - start, axis=1) < 16 * cell_m]
            line = shapely.LineString([start, plan[rng.choice(near)]])
            drawn.append(Drawing(len(drawn) + 1, name, line))
    return list(stroke_areas(drawn, STROKE_CELLS * cell_m))


def flown_again(ground: Ground, rng: np.random.Generator) -> Ground:
    """Make the same ground in another survey."""
    mesh = ground.mesh
    vertices = mesh.vertices + rng.normal(0.0, 0.03, mesh.vertices.shape).astype(np.float32)
    levels = mesh.colours * np.array([1.03, 1.0, 1.0]) + rng.normal(0.0, 1.0, mesh.colours.shape)
    colours = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return ground_of(Mesh(vertices, mesh.faces, mesh.normals, colours, {}))


def accuracy(piece: Piece, teacher: Teacher, answer_names: list[str], pieces: Int32) -> float:
    """Share of the area with truth that has its name."""
    kind = np.array([piece.names.index(name) for name in answer_names])[pieces]
    known = piece.truth >= 0
    area = teacher.ground.area[known]
    return float(area[kind[known] == piece.truth[known]].sum() / area.sum())


def scored(pieces: Iterator[Piece], draws: int, strokes: int = STROKES) -> None:
    """Print accuracy of every piece."""
    print("| piece | faces | names | draws | mean | worst | next survey, of the first's |")
    print("| -- | -- | -- | -- | -- | -- | -- |")
    every: list[float] = []
    ratios: list[float] = []
    teacher: Teacher | None = None
    for piece in pieces:
        if teacher is None or teacher.ground is not piece.ground:
            teacher = Teacher(piece.ground, threads=THREADS)
            again = Teacher(
                flown_again(piece.ground, np.random.default_rng(99)),
                cell_m=teacher.cell_m,
                threads=THREADS,
            )
        found, found_again = [], []
        for draw in range(draws):
            drawn = strokes_on(piece, teacher.cell_m, np.random.default_rng(draw), strokes)
            model, _ = teacher.learn(drawn)
            for one, list_ in ((teacher, found), (again, found_again)):
                cut = one.cut(one.answer(model))
                names = [cut.names[number] for number in range(len(cut.names))]
                list_.append(accuracy(piece, one, names, cut.pieces))
        ratio = float(np.mean(found_again) / np.mean(found))
        every += found
        ratios.append(ratio)
        listed = " ".join(f"{value:.3f}" for value in found)
        print(
            f"| {piece.title} | {len(piece.truth):,} | {len(piece.names)} | {listed} | "
            f"{np.mean(found):.3f} | {min(found):.3f} | {ratio:.3f} |",
            flush=True,
        )
    if every:
        print(
            f"| all | | | | **{np.mean(every):.3f}** | **{min(every):.3f}** | "
            f"**{min(ratios):.3f}** |\n"
        )


def timed(faces: int) -> None:
    """Print the seconds of a first lesson and of a further stroke."""
    edge_m = 1.6 * float(np.sqrt(250_000 / faces))
    mesh, material = quarry_mesh(SEEDS[0], edge_m)
    ground = ground_of(mesh)
    forms = families("material")
    truth = forms[material]
    kinds = [k for k in np.unique(truth) if np.count_nonzero(truth == k) > 200][:8]
    truth = np.select([truth == k for k in kinds], range(len(kinds)), -1).astype(np.int32)
    piece = Piece("speed", ground, truth, tuple(f"kind {k}" for k in kinds))
    ticks: list[tuple[str, float, float]] = []

    def tick(name: str) -> None:
        ticks.append((name, time.process_time(), time.perf_counter()))

    teacher = Teacher(ground, threads=THREADS)
    strokes = strokes_on(piece, teacher.cell_m, np.random.default_rng(0))
    tick("")
    _ = ground.pairs, ground.area, ground.centres
    tick("neighbours, areas")
    _ = teacher.features
    tick("features")
    model, _ = teacher.learn(strokes)
    tick("forest")
    answer = teacher.answer(model)
    tick("names")
    teacher.cut(answer)
    tick("regions")
    model, _ = teacher.learn([*strokes, *strokes_on(piece, teacher.cell_m, _rng(1))[:1]])
    teacher.cut(teacher.answer(model))
    tick("a further stroke: forest, names, regions")
    size = len(taught_file(teacher, teacher.answer(model), {}, "", "taught", ""))
    tick("a painted stroke's answer besides: names again, taught.json")
    print(f"taught.json: {size:,} bytes")
    print(f"{len(truth):,} faces, {teacher.units.count:,} squares of {teacher.cell_m:g} m\n")
    print("| step | CPU s | s |\n| -- | -- | -- |")
    for (_, cpu0, wall0), (name, cpu1, wall1) in itertools.pairwise(ticks):
        print(f"| {name} | {cpu1 - cpu0:.2f} | {wall1 - wall0:.2f} |")
    print(f"| first lesson | {ticks[-3][1] - ticks[0][1]:.2f} | {ticks[-3][2] - ticks[0][2]:.2f} |")


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", choices=("drawn", "quarries", "speed"))
    parser.add_argument("--faces", default="1M")
    parser.add_argument("--pieces", nargs="*", default=(), help="of the drawn ones")
    parser.add_argument("--strokes", type=int, default=STROKES, help="per name")
    parser.add_argument("--draws", type=int, default=DRAWS)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.smoke:
        scored(quarry_pieces(SEEDS[:1], 9.0), 1)
        timed(20_000)
        return
    if arguments.only in (None, "drawn"):
        scored(drawn_pieces(arguments.pieces), arguments.draws, arguments.strokes)
    if arguments.only in (None, "quarries"):
        scored(quarry_pieces(SEEDS, 2.6), arguments.draws, arguments.strokes)
    if arguments.only in (None, "speed"):
        timed(parse_count(arguments.faces))


if __name__ == "__main__":
    main()
