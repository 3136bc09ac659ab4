"""``terraport segment``: cut any triangle mesh into segments."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from terraport_pipeline.cli.from_options import command_of
from terraport_pipeline.engines.mesh_files.endings import (
    GLTF_ENDINGS,
    MESH_ENDINGS,
    SEGMENT_ENDINGS,
)
from terraport_pipeline.errors import OptionError, ReadError
from terraport_pipeline.options.mesh_segments import MeshSegmentOptions

if TYPE_CHECKING:
    from terraport_payload.types import Float64
    from terraport_pipeline.engines.mesh_files.read_mesh import FileMesh
    from terraport_pipeline.stages.mesh_segments import MeshSegments

__all__ = ["register", "segment"]

_SHOWN = 5


def register(app: typer.Typer) -> None:
    """Add ``terraport segment`` to the command line `app`."""
    app.command("segment")(command_of(segment))


def segment(
    mesh: Annotated[
        Path,
        typer.Argument(help=f"Triangle mesh: {' '.join(MESH_ENDINGS)}", show_default=False),
    ],
    options: MeshSegmentOptions,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help=f"The file; its ending is the format: {' '.join(SEGMENT_ENDINGS)}",
            show_default=False,
        ),
    ],
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
) -> None:
    """Cut a mesh into segments: parts of a body, or regions of coloured ground.

    Any triangle mesh, of a scan, a CAD program or photogrammetry. A textured OBJ, whose corners
    have coordinates of their own, is cut by its texture's colours.

    OUTPUT.seg has a number a line, one for each triangle in the order of the file, as Princeton's
    segmentation benchmark has them; .npy the same as an array. OUTPUT.ply and .glb are the mesh
    with every segment in a colour of its own: open it and look.

    What to cut by is --by, how is --engine; how finely is an option of each engine. Bodies without
    colour fall into parts where they fold inwards (graph); --k says into how many.

    For example:

        terraport segment hand.off -o hand.ply

        terraport segment hand.off -o hand.seg --k 6

        terraport segment ant.off -o ant.ply --engine tpa --by shape

        terraport segment pit_textured.obj -o pit.glb --means-spread 0.7

        terraport segment pit.ply -o pit.npy --by ore_grade

        terraport segment part.stl -o part.ply --by thickness.txt --engine tpa
    """
    # (1) What can be refused before work.
    from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
    from terraport_pipeline.engines.mesh_files.write_segments import check_ending, write_segments
    from terraport_pipeline.stages.mesh_segments import segment_mesh

    check_ending(output)
    if output.exists() and not force:
        raise OptionError(f"{output} is there; expected a new file, or --force")
    if output.exists() and mesh.exists() and output.samefile(mesh):
        raise OptionError(f"{output} is the mesh itself; expected another file")
    # (2) Read, cut, write.
    start = time.perf_counter()
    body = read_mesh(mesh)
    values = None
    if options.by and options.by not in body.attributes and Path(options.by).is_file():
        values = _read_values(Path(options.by))
        options = replace(options, by=Path(options.by).name)
    result = segment_mesh(body, options, values=values, y_up=mesh.suffix.lower() in GLTF_ENDINGS)
    write_segments(output, result.labels, body.vertices, body.faces)
    if not quiet:
        console = Console(soft_wrap=True)
        console.print(_table(body, result, time.perf_counter() - start))
        if result.count == 1 and options.k != 1:
            console.print(
                f"warning: the mesh came out as one segment: engine {result.engine} finds no "
                f"border by {result.by}; another --engine or --by may, and --k says how many",
                markup=False,
                highlight=False,
            )
        console.print(f"written: {output}", markup=False, highlight=False)


def _read_values(path: Path) -> Float64:
    """Read a number for each face or vertex: an array, or words of text."""
    import numpy as np

    try:
        if path.suffix.lower() == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), np.float64).reshape(-1)
        return np.array(path.read_text(encoding="utf-8").replace(",", " ").split(), np.float64)
    except (ValueError, UnicodeDecodeError, EOFError) as error:
        raise ReadError(
            path, f"it does not hold numbers alone ({error})", "write a number a line, or .npy"
        ) from error


def _table(body: FileMesh, result: MeshSegments, seconds: float) -> Table:
    import numpy as np

    from terraport_pipeline.geometry.mesh.face_measures import face_areas

    area = np.bincount(result.labels, face_areas(body.vertices, body.faces))
    largest = np.sort(area)[::-1][:_SHOWN] / max(float(area.sum()), np.finfo(float).tiny)
    table = Table(show_header=False, box=None)
    rows = {
        "triangles": f"{len(body.faces):,}, {'closed' if result.closed else 'open'}, "
        f"{result.pieces:,} separate piece{'s' * (result.pieces != 1)}",
        "colours": body.origin_of_colours,
        "attributes": ", ".join(sorted(body.attributes)) or "none",
        "cut by": f"{result.by}, engine {result.engine}",
        "segments": f"{result.count:,}",
        "largest": ", ".join(f"{100 * share:.3g} %" for share in largest) + " of the area",
        "time": f"{seconds:,.1f} s",
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table
