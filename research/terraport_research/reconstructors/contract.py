"""What a reconstruction algorithm takes, gives and says of itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from terraport_payload.types import Float32, Int32, UInt8

__all__ = ["Reconstructor", "Samples", "Surface", "Work"]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Oriented, coloured points, with their spacing: the input of every algorithm."""

    points: Float32
    """(N, 3) metres, Y up."""
    normals: Float32
    """(N, 3) unit, out of the surface."""
    colours: UInt8
    """(N, 3) sRGB."""
    local_spacing_m: Float32
    """(N,) areal spacing around each sample."""
    spacing_m: float
    """Areal spacing of the cloud."""


@dataclass(frozen=True, slots=True)
class Work:
    """What an algorithm may use; nothing in it changes the result."""

    scratch: Path
    """A folder for files, deleted afterwards."""
    threads: int = 1
    depth: int | None = None
    """Octree depth asked for; None: by density. Only Poisson has one."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Mesh that a reconstruction algorithm returned, with what is needed to compare it."""

    vertices: Float32
    """(V, 3) metres."""
    faces: Int32
    """(F, 3) counter-clockwise seen from outside."""
    sample: Int32 | None
    """(V,) the sample that each vertex is; None where vertices are new places, to which colours
    must be carried."""
    note: str = ""
    """What was chosen for this cloud: a depth, radii."""
    solved_faces: int = 0
    """Faces before anything was cut away; 0 where nothing was."""


class Run(Protocol):
    """Call of an algorithm: samples in, a :class:`Surface` out."""

    def __call__(self, samples: Samples, work: Work, /) -> Surface:
        """Return the surface; raise a ``PipelineError`` that says why there is none."""
        ...


@dataclass(frozen=True, slots=True)
class Reconstructor:
    """A reconstruction algorithm of the comparison: names, origin, and how to run it."""

    key: str
    """Name on the command line."""
    title: str
    """As the thesis calls it."""
    implementation: str
    """The implementation used here."""
    thesis_used: str
    """The implementation that the thesis used."""
    paper: str
    one_sheet: bool
    """Whether the result is a height field: one sheet, whose outline is no hole."""
    run: Run
