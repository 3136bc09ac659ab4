"""``terraport build``: from a survey to a published scene."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final, Literal, cast

import typer
from rich.console import Console

from terraport_pipeline.build import BuildOptions, default_work_directory
from terraport_pipeline.build import build as run_build
from terraport_pipeline.build_report import BuildReport
from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.cli.synth import parse_count
from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.input_cloud import find_input_cloud
from terraport_pipeline.photo_input import Texturing
from terraport_pipeline.progress import NullProgress, Progress, RichProgress
from terraport_pipeline.report import REPORT_NAME, write_report
from terraport_pipeline.report_textures import open_scene_photos
from terraport_pipeline.scene_model import SceneModel
from terraport_pipeline.stages import clean, reconstruct, segment, texture
from terraport_pipeline.stages.region_engine import ENGINES, Engine
from terraport_pipeline.tiled_reconstruct import TileOptions
from terraport_pipeline.unforeseen import stage_failed
from terraport_store import StoreError

__all__ = ["build", "parse_size", "register"]

_SIZES: Final = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}

_CLEAN: Final = clean.Options()
_RECONSTRUCT: Final = reconstruct.Options()
_SEGMENT: Final = segment.Options()
_TEXTURE: Final = texture.Options()


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("build")(build)


def build(
    survey: Annotated[
        Path, typer.Argument(help="Point cloud: LAS, LAZ, COPC, PLY, XYZ/CSV, PCD or E57.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Scene directory to publish (or renew).")
    ],
    name: Annotated[
        str | None, typer.Option(help="Name for people.  [the scene directory's name]")
    ] = None,
    base_from: Annotated[
        str,
        typer.Option(help="detail (thinned from it), or poisson (solved apart, as the thesis)."),
    ] = _RECONSTRUCT.base_from,
    base_depth: Annotated[
        int | None,
        typer.Option(
            help=f"Octree depth of a base by poisson.  [{reconstruct.BASE_DEPTH}, below the detail]"
        ),
    ] = None,
    detail_depth: Annotated[
        int | None,
        typer.Option(
            help="Octree depth of the detail, at most what the density supports.  [that one]"
        ),
    ] = None,
    base_faces: Annotated[
        str, typer.Option(help="Faces the base mesh is reduced to: 200000, 200k.")
    ] = str(_RECONSTRUCT.base_faces),
    trim_spacings: Annotated[
        float,
        typer.Option(help="Cut surface farther than this many sample spacings from a sample."),
    ] = _RECONSTRUCT.trim_spacings,
    island_faces: Annotated[
        int, typer.Option(help="Drop loose pieces with fewer faces.")
    ] = _RECONSTRUCT.island_faces,
    point_weight: Annotated[
        float, typer.Option(help="Higher follows samples and noise, lower smooths.")
    ] = _RECONSTRUCT.point_weight,
    outlier_ratio: Annotated[
        float, typer.Option(help="Higher keeps more lone points.")
    ] = _CLEAN.outlier_ratio,
    engine: Annotated[
        str,
        typer.Option(
            help="What cuts the surface into regions. means: mean colours of whole pieces; best on "
            "coloured ground. graph: borders weighed by length, fold and colour; also cuts by "
            "shape alone. tpa: the thesis's Triangle Pool Algorithm, one number per face; blind to "
            "hue. felzenszwalb, grid: to compare with."
        ),
    ] = _SEGMENT.engine,
    segment_by: Annotated[
        str,
        typer.Option(
            help="colour; shape (thickness of closed bodies, or with graph how the surface folds); "
            "or the name of an attribute of the points."
        ),
    ] = _SEGMENT.segment_by,
    region_threshold: Annotated[
        float | None,
        typer.Option(
            help="means: lower tells more apart [0.95]. graph: higher tells more apart [0.5; 2.5 "
            "by shape]. tpa: Th, lower tells more apart [0.7]. felzenszwalb: scale k, lower tells "
            "more apart [100]. grid: metres [a twentieth of the ground]."
        ),
    ] = None,
    region_small: Annotated[
        float | None,
        typer.Option(
            help="Regions below this share of the surface join a neighbour.  [means 0.002, graph "
            "0.003, tpa 0.015, felzenszwalb 0.002]"
        ),
    ] = None,
    segment_threshold: Annotated[
        float, typer.Option(help="tpa: Th of the pools that segments are made of.")
    ] = _SEGMENT.segment_threshold,
    min_faces: Annotated[int, typer.Option(help="Merge segments below this.")] = _SEGMENT.min_faces,
    max_faces: Annotated[int, typer.Option(help="Cut segments above this.")] = _SEGMENT.max_faces,
    max_extent_m: Annotated[
        float | None,
        typer.Option(help="Cut segments wider than this, metres.  [by the density of faces]"),
    ] = None,
    units: Annotated[
        str, typer.Option(help="segments, or pools (the thesis's units, for comparison).")
    ] = "segments",
    photos: Annotated[
        Path | None, typer.Option(help="Folder of the survey's photos: textures from them.")
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Where the photos were taken: file or project folder of COLMAP, OpenSfM, "
            "OpenDroneMap, Pix4D, Metashape or Bundler.  [looked for beside the photos]"
        ),
    ] = None,
    camera_offset: Annotated[
        str | None,
        typer.Option(help="E,N,H to add to the cameras' coordinates.  [where stated, found]"),
    ] = None,
    texture_from: Annotated[
        str | None,
        typer.Option(help="photos; vertex draws the cloud's colours into images, to compare."),
    ] = None,
    texel_size: Annotated[
        float | None,
        typer.Option(help="Metres a texel; never finer than the photos.  [as fine as the photos]"),
    ] = None,
    texture_format: Annotated[
        str,
        typer.Option(
            help="jpeg (every loader), webp (smaller), png, ktx2 (needs the program basisu)."
        ),
    ] = _TEXTURE.kind,
    texture_quality: Annotated[
        int, typer.Option(help="1 to 100, of jpeg and webp.")
    ] = _TEXTURE.quality,
    base_texture: Annotated[
        int, typer.Option(help="Longest side of the base's texture, pixels: 2048, 4096.")
    ] = _TEXTURE.base_side,
    max_points: Annotated[
        str | None, typer.Option(help="Thin the survey to this many points: 500k, 5M.")
    ] = None,
    work: Annotated[
        Path | None,
        typer.Option(help="Work directory.  [.SCENE.work beside the scene]"),
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Take up stages of earlier builds whose input is unchanged.")
    ] = True,
    max_memory: Annotated[
        str | None, typer.Option(help="For example 8G.  [80 % of what is free]")
    ] = None,
    tiles: Annotated[
        bool,
        typer.Option(
            "--tiles", help="In tiles also when the whole would fit.  [when it does not fit]"
        ),
    ] = False,
    tile_depth: Annotated[
        int | None,
        typer.Option(help="Octree depth of a tile, 7 to 12.  [what --max-memory allows]"),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler that works on the tiles: tcp://host:8786. Its "
            "workers must see the same paths.  [processes of this machine]"
        ),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="The result does not depend on it.  [all cores]")
    ] = None,
    report: Annotated[
        bool, typer.Option(help="Write SCENE/report.html with pictures afterwards.")
    ] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")] = False,
) -> None:
    """Turn a survey into a scene: clean, reconstruct, segment, pack, publish.

    Interrupt it whenever you like: the same command goes on after the last finished stage. The
    published scene is replaced in one act at the very end.
    """
    console = Console(stderr=True, soft_wrap=True)
    with reporting_errors(console):
        options = BuildOptions(
            survey=survey,
            scene=output,
            name=name,
            max_points=None if max_points is None else parse_count(max_points),
            clean=clean.Options(outlier_ratio=outlier_ratio),
            reconstruct=reconstruct.Options(
                base_from=cast("Literal['detail', 'poisson']", base_from),  # checked by Options
                base_depth=base_depth,
                detail_depth=detail_depth,
                base_faces=parse_count(base_faces),
                trim_spacings=trim_spacings,
                island_faces=island_faces,
                point_weight=point_weight,
            ),
            segment=segment.Options(
                engine=_parse_engine(engine),
                segment_by=segment_by,
                region_threshold=region_threshold,
                region_small=region_small,
                segment_threshold=segment_threshold,
                min_faces=min_faces,
                max_faces=max_faces,
                max_extent_m=max_extent_m,
                units=_parse_units(units),
            ),
            texture=_texturing(
                photos,
                cameras,
                camera_offset,
                texture_from,
                texture.Options(
                    source="vertex" if texture_from == "vertex" else "photos",
                    texel_m=texel_size,
                    kind=cast("Any", texture_format),
                    quality=texture_quality,
                    base_side=base_texture,
                ),
            ),
            work=work,
            resume=resume,
            threads=threads,
            max_memory_bytes=None if max_memory is None else parse_size(max_memory),
            tiles=TileOptions(
                force=tiles or cluster is not None, depth=tile_depth, cluster=cluster
            ),
        )
        with _watching(console, quiet=quiet) as progress:
            built = _build(options, console, progress, with_report=report)
    for text in built.warnings:
        console.print(f"warning: {text}", markup=False, highlight=False)
    if not quiet:
        console.print(built.table())
        state = "published" if built.published else "is up to date"
        console.print(f"{built.scene} {state}", markup=False, highlight=False)


def parse_size(text: str) -> int:
    """Read a number of bytes with an optional binary suffix.

    Raises
    ------
    OptionError
        The text is not a number with k, M, G or T.

    Examples
    --------
    >>> parse_size("1.5G")
    1610612736
    """
    found = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([kmgt]?)(?:i?b)?\s*", text.lower())
    if not found:
        raise OptionError(f"size {text!r}; expected a number with K, M, G or T, for example 8G")
    return int(float(found[1]) * _SIZES[found[2]])


def _texturing(
    photos: Path | None,
    cameras: Path | None,
    offset: str | None,
    source: str | None,
    options: texture.Options,
) -> Texturing | None:
    """Put together what was said of textures; None where nothing was."""
    if source not in (None, "photos", "vertex"):
        raise OptionError(f"textures from {source!r}; expected photos or vertex")
    if photos is None and cameras is None and source is None:
        return None
    if options.kind == "ktx2":
        require_encoder()  # told of now, not after the reconstruction
    return Texturing(options, photos, cameras, None if offset is None else _parse_offset(offset))


def _parse_offset(text: str) -> tuple[float, float, float]:
    try:
        east, north, height = (float(part) for part in text.split(","))
    except ValueError:
        raise OptionError(
            f"camera offset {text!r}; expected E,N,H in metres, for example 576600,5188100,0"
        ) from None
    return east, north, height


def _parse_engine(text: str) -> Engine:
    if text in ENGINES:
        return cast("Engine", text)
    raise OptionError(f"engine {text!r}; expected one of {', '.join(ENGINES)}")


def _parse_units(text: str) -> Literal["segments", "pools"]:
    if text == "segments":
        return "segments"
    if text == "pools":
        return "pools"
    raise OptionError(f"units {text!r}; expected segments or pools")


@contextmanager
def _watching(console: Console, *, quiet: bool) -> Iterator[Progress]:
    if quiet:
        yield NullProgress()
        return
    with RichProgress(console) as progress:
        yield progress


def _photos_beside(texturing: Texturing | None) -> Callable[[SceneModel], OpenPhotos] | None:
    """Open the build's photos again, for the report's pictures."""
    if texturing is None or texturing.photos is None:
        return None
    photos, cameras, offset = texturing.photos, texturing.cameras, texturing.camera_offset
    return lambda model: open_scene_photos(model, photos, cameras, offset)


def _build(
    options: BuildOptions, console: Console, progress: Progress, *, with_report: bool
) -> BuildReport:
    try:
        built = run_build(options, progress)
        if with_report and (built.published or not (built.scene / REPORT_NAME).exists()):
            _report(options, built, progress)
    except KeyboardInterrupt:
        console.print("the same command goes on after the last finished stage", highlight=False)
        raise
    return built


def _report(options: BuildOptions, built: BuildReport, progress: Progress) -> None:
    try:
        write_report(
            built.scene,
            cloud=lambda scene: find_input_cloud(scene, options.work),
            photos=_photos_beside(options.texture),
            work=options.work,
            progress=progress,
        )
    except (PipelineError, StoreError, OSError):
        raise
    except Exception as error:
        raise stage_failed(
            error,
            "the report",
            f"{built.scene} is published and whole, and terraport report writes the report again",
            options.work or default_work_directory(options.scene.absolute()),
        ) from error
