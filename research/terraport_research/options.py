"""Options of ``terraport evaluate``, apart from the algorithms that are slow to import."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, get_args

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COUNT, Notation, Option, check_options
from terraport_research.name_list import NAMES, parse_names

__all__ = [
    "CUTTERS",
    "MODELS",
    "MODES",
    "PAGES",
    "RECONSTRUCTORS",
    "TIME_LIMIT_S",
    "Mode",
    "ReconstructionOptions",
    "SegmentationOptions",
    "ThesisOptions",
]

RECONSTRUCTORS: Final = (
    "delaunay",
    "marching-cubes",
    "voronoi-filtering",
    "ball-pivoting",
    "poisson",
    "greedy-projection",
)
"""Names of the compared reconstructors; :mod:`.reconstructors` has them."""

CUTTERS: Final = (
    "automatic",
    "graph",
    "tpa",
    "randomised-cuts",
    "normalised-cuts",
    "shape-diameter",
    "core-extraction",
    "random-walks",
    "fitting-primitives",
    "k-means",
)
"""Names of the compared segmentation algorithms; :mod:`.cutters` has them."""

TIME_LIMIT_S: Final = 300.0
"""Seconds after which an algorithm is stopped."""

Mode = Literal["by-segmentation", "by-model", "by-category", "by-dataset"]
MODES: Final = get_args(Mode)
"""How an algorithm is told k: what each person made of this model; what most people made of it;
what most made of its category; 7 for all."""

PAGES: Final = ("people", "bodies", "landscapes", "pools", "run-times", "depths", "photos")
"""In the order of the page."""

MODELS: Final = ("bunny", "armadillo", "block", "gear")
"""Four models, as the thesis had four: two of its own, and two with sharp edges."""

_LEAST_POINTS: Final = 1000
_MOST_POINTS: Final = 2_000_000
"""Voronoi filtering takes 30 GB and an hour beyond it."""


def _parse_depths(text: str, what: str) -> tuple[int, ...]:
    try:
        return tuple(sorted({int(word) for word in parse_names(text, what)}))
    except ValueError as error:
        raise OptionError(f"{what} {text!r}; expected whole numbers, for example 8,9,10") from error


_DEPTHS: Final = Notation(
    "DEPTH,DEPTH", _parse_depths, lambda depths: ", ".join(map(str, depths)) or "none"
)


@dataclass(frozen=True, slots=True)
class ReconstructionOptions:
    """Algorithms, models, sizes and limits of a comparison."""

    algorithms: Annotated[tuple[str, ...], Option(notation=NAMES)] = RECONSTRUCTORS
    """Algorithms to compare, by commas; none: only the depths."""
    models: Annotated[tuple[str, ...], Option(notation=NAMES)] = MODELS
    """Models with truth, by commas: bunny, armadillo, block, gear, stairs, torus, sphere."""
    points: Annotated[int, Option(least=_LEAST_POINTS, most=_MOST_POINTS, notation=COUNT)] = 20_000
    """Samples of each model and of the quarry: 20k."""
    depths: Annotated[tuple[int, ...], Option(notation=_DEPTHS)] = (8, 9, 10, 11, 12, 13)
    """Octree depths of Poisson in the figure, 4 to 16, by commas; none: only the algorithms."""
    depth_points: Annotated[int, Option(least=_LEAST_POINTS, most=_MOST_POINTS, notation=COUNT)] = (
        60_000
    )
    """Points of each scene that the depths are tried on."""
    scenes: Annotated[tuple[str, ...], Option(notation=NAMES)] = (
        "quarry",
        "red_rocks",
        "apaxco_quarry",
    )
    """Scenes that the depths are tried on, by commas: these, or paths of surveys."""
    data: Annotated[Path | None, Option(unset="none: models and scenes made here")] = None
    """Folder with real data: stanford/bunny.ply, stanford/armadillo.obj, red_rocks/red_rocks.laz,
    apaxco_quarry/apaxco_quarry_500k.laz. What is not there is left out, and said."""
    threads: Annotated[int | None, Option(least=1, most=64, unset="all cores")] = None
    """Algorithms at once; each runs on one thread."""
    time_limit_s: Annotated[float, Option(flags=("--time-limit",), above=0, unit="s")] = (
        TIME_LIMIT_S
    )
    """Stop an algorithm after this many seconds."""
    pictures: bool = True

    def __post_init__(self) -> None:
        check_options(self)
        for name in self.algorithms:
            if name not in RECONSTRUCTORS:
                raise OptionError(
                    f"algorithm {name!r}; expected one of {', '.join(RECONSTRUCTORS)}"
                )
        for depth in self.depths:
            if not 4 <= depth <= 16:
                raise OptionError(f"depth {depth}; expected 4 to 16")
        if self.data is not None and not self.data.is_dir():
            raise OptionError(f"--data {self.data}; expected an existing folder")

    @property
    def workers(self) -> int:
        """Algorithms at once, counted."""
        return self.threads or os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class SegmentationOptions:
    """Models, algorithms, and what these are told."""

    models: Annotated[Path | None, Option(unset="four bodies made here")] = None
    """Folder or tar archive of Princeton's MeshsegBenchmark-1.0, or a part of it: data/off,
    data/seg/Benchmark, util/parameters."""
    algorithms: Annotated[tuple[str, ...], Option(notation=NAMES)] = CUTTERS
    """Algorithms to compare, by commas; none: people against people alone."""
    mode: Annotated[Mode, Option()] = "by-model"
    """How many segments algorithms are told to make: by-segmentation, as the person that they are
    compared with; by-model, as most people made of this model; by-category, as most made of its
    kind; by-dataset, 7 for all."""
    every: Annotated[int, Option(least=1)] = 1
    """Take every Nth model alone: a look."""
    seed: Annotated[int, Option(least=0)] = 0
    """Of what algorithms draw by lot."""
    threads: Annotated[int | None, Option(least=1, most=64, unset="all cores")] = None
    """Models at once, each in a process."""

    def __post_init__(self) -> None:
        check_options(self)
        for name in self.algorithms:
            if name not in CUTTERS:
                raise OptionError(f"algorithm {name!r}; expected one of {', '.join(CUTTERS)}")


def _parse_thesis_depths(text: str, what: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise OptionError(f"{what} {text!r}; expected whole numbers such as 8,10,11") from None


@dataclass(frozen=True, slots=True)
class ThesisOptions:
    """Which pages, from what, how large."""

    pages: Annotated[tuple[str, ...], Option(notation=NAMES)] = PAGES
    """Pages to make anew, by commas; the others stay as they were made before. none: write all
    once more from the results, without computing anything."""
    scores: Annotated[Path | None, Option(unset="segmentation.json in the output folder")] = None
    """Results of terraport evaluate segmentation, for the page people."""
    models: Annotated[Path | None, Option(unset="bodies made here")] = None
    """Folder or tar archive of Princeton's models, for the page bodies."""
    data: Annotated[Path | None, Option(unset="the synthetic quarry alone")] = None
    """Folder of real surveys, for the page depths: red_rocks/red_rocks.laz and so on."""
    scenes: Annotated[
        tuple[str, ...], Option(notation=NAMES, unset="the scene that comes along")
    ] = ()
    """Built scenes with textures, paths by commas, for the page photos."""
    algorithms: Annotated[tuple[str, ...], Option(notation=NAMES)] = (
        "tpa",
        "shape-diameter",
        "fitting-primitives",
        "automatic",
    )
    """Algorithms for the pages bodies and landscapes, by commas; any of terraport evaluate
    segmentation."""
    mode: Annotated[Mode, Option()] = "by-model"
    """How many segments algorithms are told to make of a body."""
    depths: Annotated[
        tuple[int, ...],
        Option(
            notation=Notation("DEPTH,DEPTH", _parse_thesis_depths, lambda d: ",".join(map(str, d)))
        ),
    ] = (8, 10, 11)
    """Octree depths side by side; the thesis shows 13 too, which takes minutes."""
    depth_points: Annotated[int, Option(least=5_000, most=20_000_000, notation=COUNT)] = 60_000
    """Points of each survey that the depths are tried on."""
    most_faces: Annotated[int, Option(least=1_000, most=12_000_000, notation=COUNT)] = 1_000_000
    """Largest of the thesis's meshes to time TPA on: 1M; 12M takes 2 GB of memory."""
    seed: Annotated[int, Option(least=0)] = 0
    """Of what is drawn by lot: noise, and what algorithms draw."""

    def __post_init__(self) -> None:
        check_options(self)
        for name in self.pages:
            if name not in PAGES:
                raise OptionError(f"page {name!r}; expected some of {', '.join(PAGES)}, or none")
        for name in self.algorithms:
            if name not in CUTTERS:
                raise OptionError(f"algorithm {name!r}; expected one of {', '.join(CUTTERS)}")
        for depth in self.depths:
            if not 4 <= depth <= 14:
                raise OptionError(f"depth {depth}; expected 4 to 14")
        if self.data is not None and not self.data.is_dir():
            raise OptionError(f"--data {self.data}; expected an existing folder")
