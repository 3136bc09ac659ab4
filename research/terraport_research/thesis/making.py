"""What all pages are made with: options, a stamp, pictures of pieces and bodies."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np

from terraport_payload.types import AnyInt, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera, oblique
from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.engines.pictures import encode_jpeg, render_mesh
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COUNT, Notation, Option, check_options
from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Figure, Page, Picture, Stamp, Table
from terraport_research.cutters import CUTTERS
from terraport_research.name_list import NAMES
from terraport_research.princeton import Mode
from terraport_research.versions import versions_of_this

__all__ = [
    "PAGES",
    "SIZE",
    "Made",
    "Maker",
    "Making",
    "ThesisOptions",
    "labelled_picture",
    "plain_picture",
    "view_of",
]

PAGES: Final = ("people", "bodies", "landscapes", "pools", "run-times", "depths", "photos")
"""In the order of the page."""
SIZE: Final = (400, 300)
_SUPERSAMPLE: Final = 2
_FRAMED: Final = 4000
"""Vertices that a camera frames."""
_DEEPEST: Final = 14
_THESIS_COMPARED: Final = ("tpa", "shape-diameter", "fitting-primitives")
_AUTOMATIC: Final = "automatic"


def _depths(text: str, what: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise OptionError(f"{what} {text!r}; expected whole numbers such as 8,10,11") from None


def _compared() -> tuple[str, ...]:
    """Algorithms of the thesis's pictures, as far as they are registered, and ours."""
    return (*(key for key in _THESIS_COMPARED if key in CUTTERS), _AUTOMATIC)


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
    algorithms: Annotated[tuple[str, ...], Option(notation=NAMES)] = _compared()
    """Algorithms for the pages bodies and landscapes, by commas; any of terraport evaluate
    segmentation."""
    mode: Annotated[Mode, Option()] = "by-model"
    """How many segments algorithms are told to make of a body."""
    depths: Annotated[
        tuple[int, ...],
        Option(notation=Notation("DEPTH,DEPTH", _depths, lambda d: ",".join(map(str, d)))),
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
            if not 4 <= depth <= _DEEPEST:
                raise OptionError(f"depth {depth}; expected 4 to {_DEEPEST}")
        if self.data is not None and not self.data.is_dir():
            raise OptionError(f"--data {self.data}; expected an existing folder")


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A page and the files of its pictures."""

    page: Page
    pictures: dict[str, bytes]


class Making:
    """Gathers one page while it is made; the processor time runs from the start."""

    def __init__(self, key: str, title: str, mode: str, seed: int) -> None:
        self.key, self._title, self._mode, self._seed = key, title, mode, seed
        self._start = _processor_s()
        self._versions = versions_of_this()  # of the code that runs: a checkout may change
        self._text: list[str] = []
        self.tables: list[Table] = []
        self._figures: list[Figure] = []
        self._pictures: dict[str, bytes] = {}

    def spent(self, cpu_s: float) -> None:
        """Count processor time of a process that this one does not wait for itself."""
        self._start -= cpu_s

    def say(self, paragraph: str) -> None:
        """Add words: what was done, what differs."""
        self._text.append(paragraph)

    def figure(self, key: str, title: str, pictures: list[tuple[str, str, bytes | None]]) -> None:
        """Add a figure: title, words and JPEG of each picture; one that is None says so."""
        shown = []
        for number, (name, words, jpeg) in enumerate(pictures):
            file = f"{self.key}-{key}-{number}.jpg"
            if jpeg is not None:
                self._pictures[file] = jpeg
            shown.append(Picture(file, name, words))
        self._figures.append(Figure(key, title, tuple(shown)))

    def made(self, stamp: Stamp | None = None) -> Made:
        """Finish the page. `stamp` is that of the numbers, where others made them."""
        if stamp is None:
            versions = self._versions
            stamp = Stamp(
                versions["terraport"],
                versions["commit"],
                self._mode,
                self._seed,
                ", ".join(f"{k} {v}" for k, v in versions.items() if k != "commit"),
                round(_processor_s() - self._start, 2),
            )
        page = Page(
            self.key,
            self._title,
            tuple(self._text),
            tuple(self.tables),
            tuple(self._figures),
            stamp,
        )
        return Made(page, self._pictures)


def _processor_s() -> float:
    """Of this process, and of the children that it waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def view_of(vertices: Float32 | Float64, *, is_body: bool) -> Camera:
    """Frame a body from low and in front, ground from above."""
    step = max(1, len(vertices) // _FRAMED)
    return oblique(
        vertices[::step],
        aspect=SIZE[0] / SIZE[1],
        azimuth_deg=-25.0 if is_body else 30.0,
        elevation_deg=20.0 if is_body else 45.0,
    )


def plain_picture(
    vertices: Float32, faces: Int32, camera: Camera, colours: UInt8 | None = None
) -> bytes:
    """Draw a mesh in its own colours, or grey; JPEG."""
    image = render_mesh(
        vertices,
        faces,
        camera,
        SIZE,
        colours=colours,
        relief=0.8 if colours is None else 0.35,
        shadows=False,
        supersample=_SUPERSAMPLE,
    )
    return encode_jpeg(image)


def labelled_picture(vertices: Float32, faces: Int32, camera: Camera, labels: AnyInt) -> bytes:
    """Draw a mesh with a colour for every segment; JPEG."""
    numbers = np.unique(labels, return_inverse=True)[1].astype(np.int32)
    colours = distinct_colours(int(numbers.max(initial=0)) + 1)[numbers]
    image = render_mesh(
        vertices,
        faces,
        camera,
        SIZE,
        face_colours=colours,
        relief=0.8,
        shadows=False,
        supersample=_SUPERSAMPLE,
    )
    return encode_jpeg(image)


Maker = Callable[[ThesisOptions, Progress], Made]
"""Makes one page."""
