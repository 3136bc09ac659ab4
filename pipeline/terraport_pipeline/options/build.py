"""Options of a build, all stages together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final

from terraport_pipeline.errors import OptionError
from terraport_pipeline.extent import Extent
from terraport_pipeline.free_memory import MEMORY_SHARE
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.option import (
    BYTES,
    COMMON,
    COUNT,
    EXTENT,
    Option,
    Section,
    check_options,
)
from terraport_pipeline.options import clean, pack, reconstruct, regions
from terraport_pipeline.options.base_texture import Options as BaseTextureOptions
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.survey_statement import SurveyStatement

__all__ = ["BuildOptions", "default_scene_path"]

_WILDCARDS: Final = frozenset("*?[")

_MAX_LEVELS: Final = 2
"""Levels that a scene may have: ``terraport_store.layout.MAX_LEVELS``, which is slow to import."""

_SURVEY: Final = "Survey"
"""Heading of the options that say what is read, and what it means."""

_MACHINE: Final = "Machine and tiles"
"""Heading of the options that change how a build runs, not what it makes."""


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Inputs and options of a build, one group a stage."""

    survey: Annotated[Path | tuple[Path, ...], Option(is_argument=True, many=True)]
    """Point cloud: LAS, LAZ, COPC, PLY, XYZ/CSV, PCD or E57; a file, several, a folder of them, or
    a pattern in quotes. Or a mesh that was reconstructed elsewhere: OBJ, GLB, glTF, PLY, STL
    or OFF."""
    output: Annotated[
        Path | None,
        Option(
            flags=("--output", "-o"),
            unset="the survey's name without its ending, in the current directory",
        ),
    ] = None
    """Scene directory to publish, or to renew."""
    name: Annotated[str | None, Option(unset="the scene directory's name")] = None
    """The scene's name for people."""
    max_points: Annotated[
        int | None, Option(least=clean.MIN_POINTS, notation=COUNT, unset="all of them")
    ] = None
    """Thin the survey to this many points while reading: 500k, 5M."""
    statement: Annotated[SurveyStatement, Section(_SURVEY)] = field(default_factory=SurveyStatement)
    """What the files do not say of the survey."""
    mesh: Annotated[MeshStatement, Section(_SURVEY)] = field(default_factory=MeshStatement)
    """What a mesh does not say of itself."""
    extent: Annotated[
        Extent | None, Option(heading=_SURVEY, notation=EXTENT, unset="all of it")
    ] = None
    """Build only the points within this rectangle, edges included, in the coordinates and the unit
    of the survey's own CRS: 641200 8594700 641300 8594800. Of COPC, and of LAS and LAZ with a
    LASindex (.lax), only what lies there is read."""
    skip_damaged: Annotated[bool, Option(heading=_SURVEY)] = False
    """Of a survey in several files, go on without those that cannot be read; the report names
    them."""
    clean: Annotated[clean.Options, Section("Surface")] = field(default_factory=clean.Options)
    reconstruct: Annotated[reconstruct.Options, Section("Surface")] = field(
        default_factory=reconstruct.Options
    )
    segment: Annotated[regions.Options, Section("Regions and segments")] = field(
        default_factory=regions.Options
    )
    levels: Annotated[int, Option(heading="Regions and segments", least=1, most=_MAX_LEVELS)] = 1
    """Levels of every segment. 2 adds a coarser one with the same borders, a third of the bytes:
    clients that ask for it show it in a ring around the full detail, before the base begins."""
    texture: Annotated[Texturing | None, Section("Textures")] = None
    """Textures instead of vertex colours, from photos or for comparison from the colours."""
    base_texture: Annotated[int, Option(heading="Textures", unit="pixels")] = 2048
    """Longest side of the base's image, drawn from the photos, or without them from the colours of
    the points: 256, 512, 1024, 2048 or 4096. 0 leaves it the colours of its vertices."""
    work: Annotated[Path | None, Option(heading=_MACHINE, unset=".SCENE.work beside the scene")] = (
        None
    )
    """Work directory, with the results of all stages."""
    resume: Annotated[bool, Option(heading=COMMON)] = True
    """Take up stages of earlier builds whose input, options and code are unchanged."""
    max_memory_bytes: Annotated[
        int | None,
        Option(
            flags=("--max-memory",),
            heading=COMMON,
            least=2**28,
            notation=BYTES,
            unset=f"{MEMORY_SHARE * 100:.0f} % of what is free",
        ),
    ] = None
    """Memory that the build may take: 8G. The less, the smaller the tiles."""
    threads: Annotated[int | None, Option(heading=_MACHINE, least=1, unset="all cores")] = None
    """Threads at most. The result does not depend on it."""
    tiles: Annotated[TileOptions, Section(_MACHINE)] = field(default_factory=TileOptions)
    """How large tiles are, and who works on them."""

    def __post_init__(self) -> None:
        check_options(self)
        self.pack_options()  # refused before any work, not after an hour
        _ = self.base_image, self.texturing

    @property
    def inputs(self) -> tuple[Path, ...]:
        """What was given as the survey: files, folders, patterns."""
        return (self.survey,) if isinstance(self.survey, Path) else self.survey

    @property
    def scene(self) -> Path:
        """Scene directory: the one that was asked for, or one of the survey's name."""
        return default_scene_path(self.inputs) if self.output is None else self.output

    @property
    def base_image(self) -> BaseTextureOptions | None:
        """Options of the base's image where no photo gives one; None where it has none."""
        return BaseTextureOptions(self.base_texture) if self.base_texture else None

    @property
    def base_side(self) -> int:
        """Longest side of the base's image in a scene with textures.

        Raises
        ------
        OptionError
            None is wanted.
        """
        if self.base_texture == 0:
            raise OptionError(
                "base texture 0 pixels, in a scene with textures; expected 256 or more"
            )
        return self.base_texture

    @property
    def texturing(self) -> Texturing | None:
        """What textures are made of, the base's among them."""
        if self.texture is None:
            return None
        options = replace(self.texture.options, base_side=self.base_side)
        return replace(self.texture, options=options)

    def pack_options(self) -> pack.Options:
        """Options of the pack stage, made from the scene's name."""
        name = self.scene.absolute().name if self.name is None else self.name
        return pack.Options(name, self.levels)

    def recorded(self) -> dict[str, Any]:
        """Options that change the published bytes, as the manifest records them."""
        # Scenes without them keep the bytes that they had before there were these options.
        extent = {} if self.extent is None else {"extent": [*self.extent.values]}
        statement = {"statement": self.statement.recorded} if self.statement.recorded else {}
        return {
            "max_points": self.max_points,
            **extent,
            **statement,
            "clean": asdict(self.clean),
            "reconstruct": asdict(self.reconstruct),
            "segment": asdict(self.segment),
            "base_texture": self.base_texture,
            **({} if self.levels == 1 else {"levels": self.levels}),
        }


def default_scene_path(inputs: Sequence[Path]) -> Path:
    """Return where the scene of a survey goes that was given no place, in the current directory.

    Parameters
    ----------
    inputs : sequence of Path
        What was given as the survey: a file, a folder, or a pattern.

    Returns
    -------
    Path
        Relative: the file's name without its ending; the folder's name; of a pattern the name of
        the folder that it looks into.

    Raises
    ------
    OptionError
        There are several inputs, of which none is the survey's name.

    Examples
    --------
    >>> default_scene_path([Path("surveys/pit.copc.laz")]).name
    'pit'
    >>> default_scene_path([Path("tiles/2026/*.laz")]).name
    '2026'
    """
    if len(inputs) != 1:
        raise OptionError(
            f"{len(inputs)} files and folders, and no name for their scene; give it one: "
            "-o scenes/NAME"
        )
    [given] = inputs
    literal = [part for part in given.parts if _WILDCARDS.isdisjoint(part)]
    if len(literal) < len(given.parts) and not given.exists():  # a pattern
        first = next(i for i, part in enumerate(given.parts) if not _WILDCARDS.isdisjoint(part))
        name = Path(*given.parts[:first]).resolve().name
    elif given.is_dir():
        name = given.resolve().name
    else:
        stem = given.stem
        name = stem[: -len(".copc")] if stem.lower().endswith(".copc") else stem
    # A hidden folder would not be served.
    return Path(name.lstrip(".") or "scene")
