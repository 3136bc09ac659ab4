"""What all pages are made with: options, a stamp, pictures of pieces and bodies."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyInt, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera, oblique
from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.engines.pictures import encode_jpeg, render_mesh
from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Figure, Page, Picture, Stamp, Table
from terraport_research.options import ThesisOptions
from terraport_research.versions import versions_of_this

__all__ = [
    "SIZE",
    "Made",
    "Maker",
    "Making",
    "labelled_picture",
    "plain_picture",
    "view_of",
]

SIZE: Final = (400, 300)
_SUPERSAMPLE: Final = 2
_FRAMED: Final = 4000
"""Vertices that a camera frames."""


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
