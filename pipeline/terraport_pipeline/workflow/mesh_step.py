"""From a mesh that was reconstructed elsewhere to a surface: read it, order it, thin a base of it.

The stages: ``read-mesh``, ``tile-00000`` (the mesh in the scene's frame), ``base-tile-00000`` and
``base``, which are those of a survey. Nothing is cleaned and nothing reconstructed; from here on
the build goes on as with any surface of one tile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Float32
from terraport_pipeline.engines.mesh_texels import MeshTexels
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.mesh_statement import MESH
from terraport_pipeline.model import Cloud
from terraport_pipeline.options import reconstruct
from terraport_pipeline.stages import read_mesh
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import IN_FOLDER, Facts
from terraport_pipeline.stages.region_engine import check_segment_by
from terraport_pipeline.stages.tiles import mesh_tile, tiled_base
from terraport_pipeline.stages.tiles.detail_tiles import StoredTiles
from terraport_pipeline.survey.find_mesh import MeshInput
from terraport_pipeline.workflow.brought import Brought
from terraport_pipeline.workflow.photo_input import LocatedPhotos, camera_samples
from terraport_pipeline.workflow.read_step import crs_of, units_of
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import Runner, Stage, TileResults, TileStage, for_tiles
from terraport_pipeline.workflow.workdir import StageRecord, file_digest, stage_key

__all__ = ["bring_mesh"]

_BYTES_PER_FACE: Final = 600
"""At the peak of what follows: segmentation, atlases; as of one tile of a survey."""

_TEXT_FACTOR: Final = 6
"""Memory that reading an OBJ takes, over its size."""

_MOST_FACING_DOWN: Final = 0.7
"""Share of the plan whose faces show their backs, from which a warning says so. A closed body has a
half."""


def bring_mesh(
    runner: Runner,
    given: MeshInput,
    photos: LocatedPhotos | None,
    *,
    textured: bool,
    options: reconstruct.Options,
    segment_by: str,
) -> Brought:
    """Read a mesh and make a base of it, or take both up.

    Parameters
    ----------
    runner : Runner
    given : MeshInput
    photos : LocatedPhotos or None
        Tried on its vertices before further work.
    textured : bool
        Carry its own textures over, where it has any.
    options : reconstruct.Options
        The faces of the base; the rest is for surveys.
    segment_by : str
        What it is to be cut by.

    Raises
    ------
    ReadError, SurveyError
        The mesh cannot be used.
    OptionError
        It is to be cut by an attribute that it has not.
    ResourceError
        It is too large for the memory allowed.
    """
    # (1) The file, as columns on disk. Over a scene everything is built anew: nothing says which
    # ground did not change.
    runner.before = None
    given = _hashed(runner, given)
    read = _read(runner, given, textured=textured)
    check_segment_by(segment_by, tuple(read.values["attributes"]))
    # (2) The mesh as the one tile of the scene, and its base.
    with runner.reported_as(reconstruct.NAME) as group:
        tile = _tile(runner, read)
        values = tile.records[0].values
        tiles = _stored(runner, tile, read)
        mesh = tiles.load(0)
        cloud = Cloud(
            mesh.vertices, mesh.normals, mesh.colours, mesh.attributes,
            np.array(values["origin"]), values["spacing_m"], bool(read.values["has_colour"]),
        )  # fmt: skip
        samples = camera_samples(mesh.vertices).copy()
        colours = camera_samples(mesh.colours).copy() if cloud.has_colour else None
        if photos is not None:
            photos.try_on(samples, colours, cloud.origin, crs_of(read), runner.progress)
        surface, facts = _with_base(runner, tiles, cloud, replace(options, island_faces=1))
        group.facts = _facts(values, facts)
    return Brought(
        surface=surface,
        source=read,
        worked_on=read.name,
        origin=cloud.origin,
        crs=crs_of(read),
        units=units_of(read),
        points=len(mesh.vertices),
        samples=samples,
        sample_colours=colours,
        recorded={MESH: {"up": given.up, **given.mesh.recorded}},
        inputs=_inputs(given, read),
        texels=_opener(runner, read, tile) if read.values["textured"] else None,
    )


def _hashed(runner: Runner, given: MeshInput) -> MeshInput:
    """Hash the mesh's files; refuse at once what could never fit."""
    need = _TEXT_FACTOR * given.path.stat().st_size
    _check_memory(f"{given.path.name} takes", need, runner.max_memory_bytes)
    runner.progress.start("read: checksum", float(given.size_bytes), "bytes")
    hashes = [file_digest(file, runner.progress.advance) for file in given.files]
    runner.progress.done({"files": len(hashes)})
    return given.hashed(hashes)


def _read(runner: Runner, given: MeshInput, *, textured: bool) -> StageRecord:
    """Read the mesh, or take it up; refuse what does not fit."""
    read = runner.run(
        Stage(
            read_mesh.NAME,
            read_mesh,
            lambda context: read_mesh.run(given, context, textured=textured),
            IN_FOLDER,
            {
                "statement": given.survey.recorded, "mesh": given.mesh.recorded, "up": given.up,
                "textured": textured,
            },
            {"files": given.key},
        )
    ).record  # fmt: skip
    faces = int(read.values["faces"])
    _check_memory(f"{faces:,} faces take", _BYTES_PER_FACE * faces, runner.max_memory_bytes)
    return read


def _check_memory(what: str, need: int, allowed: int) -> None:
    if need > allowed:
        raise ResourceError(
            f"{what} about {need / 2**30:.1f} GiB; allowed are {allowed / 2**30:.1f} GiB: raise "
            "--max-memory, or export the mesh with fewer faces or in several"
        )


def _tile(runner: Runner, read: StageRecord) -> TileResults:
    folder = runner.work.path / read.name
    attributes = len(read.values["attributes"])

    def arrays() -> Mapping[str, AnyArray]:
        wanted = {"vertices", "faces", "colours", "pixels", "image"}
        wanted |= {f"attribute-{i}" for i in range(attributes)}
        return {
            path.stem: np.load(path, mmap_mode="r", allow_pickle=False)
            for path in folder.glob("*.npy")
            if path.stem in wanted
        }

    return runner.run_tiles(
        TileStage(
            "tile",
            mesh_tile,
            "mesh: order of its faces",
            for_tiles(range(1), lambda _tile, _context: mesh_tile.run(arrays(), attributes)),
            [{"mesh": read.digest}],
            [int(read.values["faces"])],
            bytes_per_unit=mesh_tile.BYTES_PER_FACE,
        )
    )


def _stored(runner: Runner, tile: TileResults, read: StageRecord) -> StoredTiles:
    [record] = tile.records
    values = record.values
    if not values["faces"]:
        raise OptionError("no face of the mesh has an area in single precision; check its units")
    return StoredTiles(
        runner.work.path,
        (record.name,),
        np.array([values["box"]], np.float64),
        (int(values["faces"]),),
        (int(values["vertices"]),),
        (record.digest,),
        tuple(read.values["attributes"]),
        0,
        (np.zeros(0, np.int64),),
        tile.digest,
        (record.name,),
        (int(values["base_faces"]),),
    )


def _with_base(
    runner: Runner, tiles: StoredTiles, cloud: Cloud, options: reconstruct.Options
) -> tuple[Surface, Facts]:
    """Thin a base of the mesh, by the stages that thin one of a survey's tiles."""
    share = tiled_base.first_share(tiles, options)
    thinned = runner.run_tiles(
        TileStage(
            "base-tile",
            tiled_base,
            "base: tiles",
            for_tiles(
                range(1), lambda part, context: tiled_base.thin_tile(tiles, part, share, context)
            ),
            [{"tile": tiles.digest_of(0)}],
            [max(1, tiles.base_faces[0])],
            options={"share": share},
            bytes_per_unit=tiled_base.THIN_BYTES_PER_FACE,
        )
    )
    cleaned = Cleaned(cloud, np.zeros(0, np.float32), (), Facts())
    base = runner.run(
        Stage(
            tiled_base.NAME,
            tiled_base,
            lambda context: tiled_base.run(
                cleaned, tiles, thinned.every(), share, options, context
            ),
            tiled_base.FORM,
            asdict(options),
            {"tiles": tiles.digest, "thinned": thinned.digest},
        )
    )  # fmt: skip
    result = base.value()
    surface = Surface(
        result.base,
        tiles,
        result.deviation_m,
        base.digest,
        stage_key("surface", "", {}, {"base": base.digest, "tiles": tiles.digest}),
        cloud.spacing_m,
    )
    return surface, result.facts


def _facts(values: Mapping[str, Any], base: Facts) -> Facts:
    counts = {
        "detail_faces": values["faces"],
        "detail_vertices": values["vertices"],
        "median_edge_m": values["spacing_m"],
        **{name: values[name] for name in ("faces_without_area", "faces_repeated", "open_edges")},
        **base.counts,
    }
    warnings = []
    if values["facing_down_share"] > _MOST_FACING_DOWN:
        warnings.append(
            f"{values['facing_down_share']:.0%} of the mesh, seen from above, shows its back: is "
            "another axis up (--up y), or is it inside out?"
        )
    choices = list(base.choices)
    left = values["faces_without_area"], values["faces_repeated"]
    if any(left):
        choices.append(
            f"{left[0]:,} faces without area and {left[1]:,} repeated ones were left out."
        )
    return Facts(counts, (*base.warnings, *warnings), choices=tuple(choices))


def _inputs(given: MeshInput, read: StageRecord) -> dict[str, Any]:
    """List the mesh's files as :func:`.read_step.inputs_of` lists a survey's."""
    return {
        "inputs": [
            {
                "name": file.name,
                "format": MESH if file == given.path else "beside the mesh",
                "bytes": file.stat().st_size,
                "xxh3": digest,
                "points": int(read.values["vertices"]) if file == given.path else 0,
                "repeats": 0,
            }
            for file, digest in zip(given.files, given.hashes, strict=True)
        ],
        "left_out": [],
        "extent": None,
    }


def _opener(runner: Runner, read: StageRecord, tile: TileResults) -> Callable[[int], MeshTexels]:
    """Make what opens the mesh's images, by the faces' order in the tile."""
    folder = runner.work.path / read.name

    def opened(max_bytes: int) -> MeshTexels:
        source = {
            name: np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False)
            for name in ("images", "offsets", "sizes")
        }
        pixels: Float32 = tile.array(0, "pixels")
        return MeshTexels(pixels, tile.array(0, "image"), source, max_bytes)

    return opened
