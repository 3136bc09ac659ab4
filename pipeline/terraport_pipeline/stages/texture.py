"""Texture: an atlas for every segment and one for the base, from photos or from vertex colours.

Memory: what the choice of views takes (about 180 bytes a detail face, with the rays' scene about
300), 12 bytes a face for the result, one atlas a thread (16 MB), and the photos that are kept: a
quarter of the build's memory at most. Images go to a file as they are made.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Int32
from terraport_pipeline.engines.images import MEDIA_TYPES, ImageFormat
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.atlas_pack import SMALLEST_CELL
from terraport_pipeline.geometry.lens import View
from terraport_pipeline.geometry.view_choice import ViewChoice
from terraport_pipeline.model import Mesh
from terraport_pipeline.ordered import in_order
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import choose_views as choosing
from terraport_pipeline.stages.atlas_maker import AtlasMaker, MadeAtlas
from terraport_pipeline.stages.choose_views import Photos
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.segment import Segmented
from terraport_pipeline.stages.texture_set import Source, Textured, TextureSet
from terraport_pipeline.stages.texture_sums import TextureSums
from terraport_pipeline.stages.view_gains import view_gains

__all__ = [
    "NAME",
    "BaseTextures",
    "MadeTextures",
    "Options",
    "faces_only",
    "photo_bytes",
    "restore",
    "run",
    "store",
    "texture_base",
    "texture_mesh",
    "worth_warning",
]

NAME: Final = "texture"


_SIDES: Final = (256, 512, 1024, 2048, 4096)

_WORST_UNSEEN: Final = 0.2
"""Share of the surface without a photo from which a warning says so."""

_WORST_BORROWED: Final = 0.05
"""Share of the faces with a neighbour's photo from which a warning says so."""

_DEFAULT_MEMORY: Final = 4 << 30


@dataclass(frozen=True, slots=True)
class Options:
    """What textures are made of and how fine they are."""

    source: Source = "photos"
    """"vertex" draws the vertex colours into images, for comparison and for loaders that know no
    vertex colours."""
    texel_m: float | None = None
    """Length of a texel on the surface; None is as fine as the photos (of vertex colours two texels
    an edge). Never finer than a photo's pixel; coarser where a segment would not fit."""
    kind: ImageFormat = "jpeg"
    quality: int = 85
    """Of the image format, 1 to 100."""
    max_side: int = 2048
    """Longest side of a segment's image."""
    base_side: int = 2048
    """Longest side of the base's image."""

    def __post_init__(self) -> None:
        if self.source not in ("photos", "vertex"):
            raise OptionError(f"textures from {self.source!r}; expected photos or vertex")
        if self.texel_m is not None and not 1e-4 <= self.texel_m <= 1e3:
            raise OptionError(f"texel size {self.texel_m} m; expected 0.0001 to 1000")
        if self.kind not in MEDIA_TYPES:
            raise OptionError(f"texture format {self.kind!r}; expected {', '.join(MEDIA_TYPES)}")
        if not 1 <= self.quality <= 100:
            raise OptionError(f"texture quality {self.quality}; expected 1 to 100")
        if self.max_side not in _SIDES[:-1] or self.base_side not in _SIDES:
            raise OptionError(
                f"texture sides {self.max_side} (segments) and {self.base_side} (base); expected "
                "powers of two from 256 to 2048 and to 4096"
            )


def photo_bytes(max_memory_bytes: int | None) -> int:
    """Bytes of decoded photos to keep: a quarter of what the build may use."""
    return (max_memory_bytes or _DEFAULT_MEMORY) // 4


def run(
    reconstructed: Reconstructed,
    segmented: Segmented,
    opened: OpenPhotos | None,
    options: Options,
    context: Context,
) -> Textured:
    """Make the textures of a scene.

    Parameters
    ----------
    reconstructed : Reconstructed
    segmented : Segmented
    opened : OpenPhotos or None
        Views and photos; None for textures from vertex colours.
    options : Options
    context : Context

    Returns
    -------
    Textured

    Raises
    ------
    OptionError
        Photos are asked for and none are given, or the other way round.
    """
    if (opened is None) != (options.source == "vertex"):
        raise OptionError(
            f"textures from {options.source} {'without' if opened is None else 'with'} photos; "
            "expected photos for the one and none for the other"
        )
    detail = reconstructed.detail
    base = faces_only(reconstructed.base, segmented.base_kept)
    views: tuple[View, ...] = () if opened is None else opened.views
    photos = None if opened is None else opened.photos
    made_base = texture_base(base, opened, options, context)
    gains, detail_choice = made_base.gains, None
    if photos is not None and gains is not None:
        rays = RayScene(detail.vertices, detail.faces, threads=context.threads)
        detail_choice = _choose(detail, views, photos, rays, gains, context)
        del rays
    made = texture_mesh(
        detail, segmented.segments, views, photos, detail_choice, options,
        max_side=options.max_side, path=context.scratch / "detail.images",
        threads=context.threads, progress=context.progress, label="texture: atlases",
    )  # fmt: skip
    counts = made.facts | {f"base_{name}": n for name, n in made_base.made.facts.items()}
    if detail_choice is not None:
        counts |= {f"choice_{name}": number for name, number in detail_choice.facts.items()}
        counts["borrowed_share"] = round(
            detail_choice.facts["faces_borrowed"] / len(detail.faces), 4
        )
    warnings: tuple[str, ...] = ()
    if opened is not None:
        counts |= {"photos": len(views), "photos_left_out": opened.left_out}
        warnings = (*opened.warnings, *worth_warning(counts))
    return Textured(
        made.textures,
        made_base.made.textures,
        options.source,
        made.facts["texel_m"],
        made.facts["gsd_m"],
        Facts(counts, warnings),
    )


@dataclass(frozen=True, slots=True, eq=False)
class MadeTextures:
    """Textures of one mesh, and numbers about them."""

    textures: TextureSet
    facts: dict[str, Any]
    sums: TextureSums


@dataclass(frozen=True, slots=True, eq=False)
class BaseTextures:
    """The base's texture, and the exposures that were found on the way."""

    made: MadeTextures
    gains: Float32 | None
    """(views + 1, GAIN_COLUMNS); None with textures from vertex colours."""


def texture_base(
    base: Mesh, opened: OpenPhotos | None, options: Options, context: Context
) -> BaseTextures:
    """Find every photo's exposure and make the base's atlas.

    Parameters
    ----------
    base : Mesh
        Faces that are published.
    opened : OpenPhotos or None
        None for textures from vertex colours.
    options : Options
    context : Context
    """
    views: tuple[View, ...] = () if opened is None else opened.views
    photos = None if opened is None else opened.photos
    choice = gains = None
    if photos is not None:
        rays = RayScene(base.vertices, base.faces, threads=context.threads)  # hides itself alone
        gains = view_gains(
            base, views, photos, rays, threads=context.threads, progress=context.progress
        )
        # Half of the charts that the image may hold: those without a photo are cut further.
        room = (options.base_side // SMALLEST_CELL) ** 2 // 8
        choice = _choose(base, views, photos, rays, gains, context, max_charts=room)
    made = texture_mesh(
        base, np.zeros(len(base.faces), np.int32), views, photos, choice, options,
        max_side=options.base_side, path=context.scratch / "base.images",
        threads=context.threads, progress=context.progress, label="texture: base",
    )  # fmt: skip
    if choice is not None:
        made.facts["borrowed_share"] = round(choice.facts["faces_borrowed"] / len(base.faces), 4)
    return BaseTextures(made, gains)


def worth_warning(counts: Mapping[str, Any]) -> tuple[str, ...]:
    """Warn where much of the surface is not as the photos show it, and say why."""
    texts = []
    unseen = float(counts["unseen_share"])
    if unseen > _WORST_UNSEEN and counts["photos"]:  # where none is left, that is said already
        texts.append(
            f"{unseen:.0%} of the surface is in no photo and has the cloud's colours: are the "
            "cameras those of this survey, and all photos there?"
        )
    for level in ("base", "detail"):
        before = "" if level == "detail" else "base_"
        borrowed = float(counts.get(f"{before}borrowed_share", 0.0))
        if borrowed > _WORST_BORROWED:
            texts.append(
                f"{borrowed:.0%} of the {level}'s faces have the photo of a neighbour, which may "
                "not see them: the surface is so noisy that it fell into charts of a few faces; "
                "clean the cloud, or thin it with --max-points"
            )
        flat = float(counts[f"{before}crowded_share"])
        if flat > 0.0:
            texts.append(
                f"{flat:.2%} of the {level}'s surface have the cloud's colours, one a face: "
                f"{counts[f'{before}charts']:,} charts left no room in an image of "
                f"{counts[f'{before}longest_side']:,} texels"
            )
    return tuple(texts)


def texture_mesh(
    mesh: Mesh,
    pieces: Int32,
    views: Sequence[View],
    photos: Photos | None,
    choice: ViewChoice | None,
    options: Options,
    *,
    max_side: int,
    path: Path,
    threads: int,
    progress: Progress,
    label: str,
) -> MadeTextures:
    """Make the atlases of a mesh's pieces: of a whole detail, of one tile, or of a base.

    Parameters
    ----------
    mesh : Mesh
    pieces : ndarray of shape (F,), int32
        Piece (segment) of every face, from 0, none empty. Best numbered along a Morton curve:
        neighbours need the same photos.
    views, photos, choice
        As :class:`~terraport_pipeline.stages.atlas_maker.AtlasMaker` takes them.
    options : Options
    max_side : int
        Longest side of an image.
    path : Path
        Where the images go while they are made; the result is a view of this file.
    threads : int
        The result does not depend on it.
    progress : Progress
    label : str
        For the progress.

    Returns
    -------
    MadeTextures
    """
    maker = AtlasMaker(mesh, views, photos, choice, options.texel_m, options.kind, options.quality)
    order = np.argsort(pieces, kind="stable")
    count = int(pieces.max()) + 1
    starts = np.searchsorted(pieces[order], np.arange(count + 1))
    rows = [order[begin:end] for begin, end in itertools.pairwise(starts)]
    wedges = np.empty((len(pieces), 3, 2), np.uint16)
    sums = TextureSums(len(pieces))
    offsets, sides = [0], []
    progress.start(label, float(count), "segments")

    def make(faces: AnyInt) -> MadeAtlas:
        return maker.make(faces, max_side=max_side)

    with path.open("wb") as file:
        for faces, made in zip(rows, in_order(make, rows, threads), strict=True):
            file.write(made.image)
            offsets.append(offsets[-1] + len(made.image))
            sides.append((made.width, made.height))
            wedges[faces] = made.wedges
            sums.add(faces, made)
            progress.advance(1)
    facts = sums.facts(np.array(sides), offsets[-1])
    progress.done({"texel_m": facts["texel_m"]})
    return MadeTextures(
        TextureSet(
            wedges,
            np.memmap(path, np.uint8, "r"),
            np.array(offsets, dtype=np.int64),
            np.array(sides, dtype=np.int32),
        ),
        facts,
        sums,
    )


def store(result: Textured) -> Stored:
    """Turn the result into arrays and values."""
    arrays = {}
    for level, textures in (("detail", result.detail), ("base", result.base)):
        for name in ("wedges", "images", "offsets", "sides"):
            arrays[f"{level}-{name}"] = getattr(textures, name)
    values = {"source": result.source, "texel_m": result.texel_m, "gsd_m": result.gsd_m}
    return Stored(arrays, values)


def restore(stored: Stored, facts: Facts) -> Textured:
    """Turn arrays and values back into the result."""

    def level(name: str) -> TextureSet:
        return TextureSet(
            wedges=np.asarray(stored.arrays[f"{name}-wedges"], dtype=np.uint16),
            images=np.asarray(stored.arrays[f"{name}-images"], dtype=np.uint8),
            offsets=np.asarray(stored.arrays[f"{name}-offsets"], dtype=np.int64),
            sides=np.asarray(stored.arrays[f"{name}-sides"], dtype=np.int32),
        )

    values = stored.values
    return Textured(
        level("detail"),
        level("base"),
        values["source"],
        values["texel_m"],
        values["gsd_m"],
        facts,
    )


def _choose(
    mesh: Mesh,
    views: Sequence[View],
    photos: Photos,
    rays: RayScene,
    gains: Float32,
    context: Context,
    *,
    max_charts: int | None = None,
) -> ViewChoice:
    return choosing.choose_views(
        mesh.vertices, mesh.faces, mesh.normals, mesh.colours, views, photos, rays, gains,
        choosing.Options(max_charts=max_charts), context.threads, context.progress,
    )  # fmt: skip


def faces_only(mesh: Mesh, kept: Bool) -> Mesh:
    """Keep some faces, and all vertices."""
    return Mesh(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.colours, mesh.attributes)
