"""Texture: an atlas for every segment and one for the base, from photos or from vertex colours.

Memory: what the choice of views takes (about 180 bytes a detail face, with the rays' scene about
300), 12 bytes a face for the result, one atlas a thread (16 MB), and the photos that are kept: a
quarter of the build's memory at most. Images go to a file as they are made.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Int32, UInt8
from terraport_pipeline.engines.mesh_texels import Picture
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.texture import Options
from terraport_pipeline.ordered import in_order
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import choose_views as choosing
from terraport_pipeline.stages.atlas_maker import AtlasMaker, BakedAtlas
from terraport_pipeline.stages.choose_views import Photos
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.texture_sums import TextureSums
from terraport_pipeline.stages.view_gains import view_gains

__all__ = [
    "NAME",
    "BakedTextures",
    "BaseTextures",
    "Options",
    "faces_only",
    "photo_bytes",
    "texture_base",
    "texture_mesh",
    "worth_saying",
]

NAME: Final = "texture"


_WORST_UNSEEN: Final = 0.2
"""Share of the surface without a photo from which a warning says so."""

_WORST_BORROWED: Final = 0.1
"""Share of the faces with a neighbour's photo from which a warning says so."""

_DEFAULT_MEMORY: Final = 4 << 30


def photo_bytes(max_memory_bytes: int | None) -> int:
    """Bytes of decoded photos to keep: a quarter of what the build may use."""
    return (max_memory_bytes or _DEFAULT_MEMORY) // 4


@dataclass(frozen=True, slots=True, eq=False)
class BakedTextures:
    """Textures of one mesh, and numbers about them."""

    textures: TextureSet
    facts: dict[str, Any]
    sums: TextureSums


@dataclass(frozen=True, slots=True, eq=False)
class BaseTextures:
    """The base's texture, and the exposures that were found on the way."""

    atlases: BakedTextures
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
        choice = _choose(base, views, photos, rays, gains, context)
    atlases = texture_mesh(
        base, np.zeros(len(base.faces), np.int32), views, photos, choice, options,
        max_side=options.base_side, path=context.scratch / "base.images",
        threads=context.threads, progress=context.progress, label="texture: base",
    )  # fmt: skip
    if choice is not None:
        atlases.facts["borrowed_share"] = round(choice.facts["faces_borrowed"] / len(base.faces), 4)
    return BaseTextures(atlases, gains)


def worth_saying(counts: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Say where much of the surface is not as the photos show it, and why.

    Returns
    -------
    warnings : tuple of str
        The photos do not show it.
    choices : tuple of str
        They show it, and it was drawn otherwise.
    """
    warnings, choices = [], []
    unseen = float(counts["unseen_share"])
    if unseen > _WORST_UNSEEN and counts["photos"]:  # where none is left, that is said already
        warnings.append(
            f"{unseen:.0%} of the surface is in no photo and has the cloud's colours: are the "
            "cameras those of this survey, and all photos there?"
        )
    for level in ("base", "detail"):
        before = "" if level == "detail" else "base_"
        borrowed = float(counts.get(f"{before}borrowed_share", 0.0))
        if borrowed > _WORST_BORROWED:
            choices.append(
                f"{borrowed:.0%} of the {level}'s faces have the photo of a neighbour, which may "
                "not see them: the surface is so noisy that it fell into charts of a few faces; "
                "clean the cloud, or thin it with --max-points"
            )
        flat = float(counts[f"{before}crowded_share"])
        if flat > 0.0:
            choices.append(
                f"{flat:.2%} of the {level}'s surface have the cloud's colours, one a face: "
                f"{counts[f'{before}charts']:,} charts left no room in an image of "
                f"{counts[f'{before}longest_side']:,} texels"
            )
    return tuple(warnings), tuple(choices)


def texture_mesh(
    mesh: Mesh,
    pieces: Int32,
    views: Sequence[View | Picture],
    photos: Photos | None,
    choice: ViewChoice | None,
    options: Options,
    *,
    max_side: int,
    path: Path,
    threads: int,
    progress: Progress,
    label: str,
    colour_at: Callable[[Float32], UInt8] | None = None,
    max_bytes: int | None = None,
    pixels: Float32 | None = None,
) -> BakedTextures:
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
    colour_at, max_bytes, pixels
        As :class:`~terraport_pipeline.stages.atlas_maker.AtlasMaker` takes them.

    Returns
    -------
    BakedTextures
    """
    # (1) Faces of every piece.
    maker = AtlasMaker(
        mesh, views, photos, choice, options.texel_m, options.kind, options.quality,
        colour_at, max_bytes, pixels,
    )  # fmt: skip
    order = np.argsort(pieces, kind="stable")
    count = int(pieces.max()) + 1
    starts = np.searchsorted(pieces[order], np.arange(count + 1))
    rows = [order[begin:end] for begin, end in itertools.pairwise(starts)]
    # (2) Atlases by several threads, written in order. Invariant: offsets[n] is the file's length
    # after n images; memory holds no more images than threads.
    wedges = np.empty((len(pieces), 3, 2), np.uint16)
    sums = TextureSums(len(pieces), len(views))
    offsets, sides = [0], []
    progress.start(label, float(count), "segments")

    def make(faces: AnyInt) -> BakedAtlas:
        return maker.make(faces, max_side=max_side)

    with path.open("wb") as file:
        for faces, atlas in zip(rows, in_order(make, rows, threads), strict=True):
            file.write(atlas.image)
            offsets.append(offsets[-1] + len(atlas.image))
            sides.append((atlas.width, atlas.height))
            wedges[faces] = atlas.wedges
            sums.add(faces, atlas)
            progress.advance(1)
    # (3) The images stay in the file; the result maps it.
    facts = sums.facts(np.array(sides), offsets[-1])
    progress.done({"texel_m": facts["texel_m"]})
    return BakedTextures(
        TextureSet(
            wedges,
            np.memmap(path, np.uint8, "r"),
            np.array(offsets, dtype=np.int64),
            np.array(sides, dtype=np.int32),
        ),
        facts,
        sums,
    )


def _choose(
    mesh: Mesh,
    views: Sequence[View],
    photos: Photos,
    rays: RayScene,
    gains: Float32,
    context: Context,
) -> ViewChoice:
    return choosing.choose_views(
        mesh.vertices, mesh.faces, mesh.normals, mesh.colours, views, photos, rays, gains,
        choosing.Options(), context.threads, context.progress,
    )  # fmt: skip


def faces_only(mesh: Mesh, kept: Bool) -> Mesh:
    """Select faces of a mesh; vertices that only others use stay."""
    return Mesh(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.colours, mesh.attributes)
