"""Choose views: which photo colours which face of a mesh.

(1) every photo's faces are rated, tested for occlusion and kept among the best few of each face,
one photo at a time; (2) photos that disagree with the others about a face are dropped; (3)
neighbouring faces are given the same photo where that costs little, and small charts join their
neighbours; (4) what remains at the seams is levelled.

Memory: 56 bytes a face for the candidates, about 60 for the neighbours and 60 for the result, and
40 per vertex; plus what the store of photos may hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Bool, Float32, Float64, Int32, UInt8
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.cover.face_cells import CellGrid, face_cells
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.mesh_blocks import MeshBlocks, mesh_blocks
from terraport_pipeline.geometry.photos.lens import PACKED, View
from terraport_pipeline.geometry.photos.occlusion import Occluder, visible_faces
from terraport_pipeline.geometry.photos.photo_samples import (
    SRGB_OFFSET,
    sample_faces,
    sharpness_map,
)
from terraport_pipeline.geometry.photos.view_candidates import (
    Candidates,
    insert,
    median_area,
    new_candidates,
    project_blocks,
    rate_faces,
    sorted_by_view,
    visible_blocks,
)
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.geometry.photos.view_labels import (
    chosen_views,
    face_neighbours,
    label_faces,
    view_costs,
)
from terraport_pipeline.geometry.photos.view_outliers import drop_outliers
from terraport_pipeline.geometry.textures.seam_blend import blend_seams, no_blend, seam_steps
from terraport_pipeline.geometry.textures.seam_levels import level_field, node_levels
from terraport_pipeline.geometry.textures.seams import find_seams, label_nodes
from terraport_pipeline.geometry.textures.small_charts import (
    join_seen_charts,
    join_small_charts,
)
from terraport_pipeline.progress import NullProgress, Progress

__all__ = [
    "CELL_EDGES",
    "NAME",
    "Labels",
    "Options",
    "Photos",
    "choose_labels",
    "choose_views",
    "collect",
    "own_colours",
]

NAME: Final = "choose views"

MAX_VIEWS: Final = 32_767
"""Views are kept as 16-bit numbers."""

_MAX_SCALE: Final = 8
"""Photos are read at down to one eighth of their size, which JPEG decoders do at once."""


CELL_EDGES: Final = 16.0
"""Side of the cells whose faces begin with one photo, in mean edges; see label_faces."""


class Photos(Protocol):
    """Where photos come from: :class:`terraport_pipeline.engines.photo_store.PhotoStore`."""

    def get(self, view_index: int, scale: int = 1) -> UInt8:
        """Pixels (H', W', 3), sRGB, at about 1/scale of the photo's size."""
        ...


@dataclass(frozen=True, slots=True)
class Options:
    """Angle, smoothness, seams and occlusion: how photos are chosen."""

    max_angle_degrees: float = 80.0
    """Faces seen at flatter angles than this from their normal are not coloured by that photo."""
    smoothness: float = 4.0
    """What a seam costs beside quality; see :mod:`terraport_pipeline.geometry.photos.view_labels`.
    Higher makes larger charts of less sharp photos."""
    reject_outliers: bool = True
    """Whether photos that show something else than the others are dropped, face by face."""
    level_seams: bool = True
    """Whether steps between photos are levelled and blended; without, every face is its photo."""
    blend_rings: int = 4
    """Width of the band along seams in which both photos are blended, in rings of vertices on each
    side. Wider hides more, and shows things double where the cameras are a little off."""
    occluder_offset_m: float = 0.0
    """How far the occluder may lie in front of the mesh where it is not the mesh itself."""

    def __post_init__(self) -> None:
        if not 0.0 < self.max_angle_degrees < 90.0:
            raise OptionError(
                f"max angle {self.max_angle_degrees} degrees; expected above 0 and below 90"
            )
        if not 0.0 <= self.smoothness <= 1000.0:
            raise OptionError(f"smoothness {self.smoothness}; expected 0 to 1000")
        if not 1 <= self.blend_rings <= 16:
            raise OptionError(f"blend rings {self.blend_rings}; expected 1 to 16")
        if not self.occluder_offset_m >= 0.0:
            raise OptionError(f"occluder offset {self.occluder_offset_m} m; expected at least 0")


def choose_views(
    mesh_vertices: Float32,
    faces: Int32,
    normals: Float32,
    colours: UInt8,
    views: Sequence[View],
    photos: Photos,
    occluder: Occluder,
    gains: Float32,
    options: Options | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> ViewChoice:
    """Choose a photo for every face of a mesh.

    Parameters
    ----------
    mesh_vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside.
    normals : ndarray of shape (V, 3), float32
    colours : ndarray of shape (V, 3), uint8
        The cloud's colours at the vertices, sRGB: what faces get that no photo sees.
    views : sequence of View
        In the scene frame; may be empty.
    photos : Photos
        Asked once for every view that sees anything, in order.
    occluder : Occluder
        The mesh itself and whatever else is in the way.
    gains : ndarray of shape (len(views) + 1, GAIN_COLUMNS), float32
        From :func:`terraport_pipeline.stages.view_gains.view_gains`, or
        :func:`terraport_pipeline.geometry.photos.photo_samples.neutral_gains`.
    options : Options, optional
    threads : int
        The result does not depend on it.
    progress : Progress, optional

    Returns
    -------
    ViewChoice
        In the mesh's own order of faces.

    Raises
    ------
    ValueError
        More than 32,767 views, or gains of another shape.
    """
    # (1) to (3) in :func:`choose_labels`: candidates, views that show something else, labels.
    options, progress = options or Options(), progress or NullProgress()
    del normals  # faces' own are what a photo sees
    blocks = mesh_blocks(mesh_vertices, faces)
    labelling = choose_labels(
        blocks, colours, views, photos, occluder, gains, options, threads, progress
    )
    # (4) seams
    chosen, facts = labelling.view, labelling.facts
    if options.level_seams:
        progress.start("texture: seams", None, "faces")
        nodes = label_nodes(blocks.faces, chosen, len(blocks.vertices))
        seams = find_seams(
            nodes, blocks.faces, chosen, labelling.candidates, labelling.own, gains,
            labelling.pairs, labelling.edges, blocks.vertices,
        )  # fmt: skip
        field, cell = level_field(blocks.vertices, nodes, seams)
        levels = node_levels(field, blocks.vertices, nodes, cell, threads=threads)
        blend = blend_seams(
            nodes, seams, levels, labelling.candidates, rings=options.blend_rings, threads=threads
        )
        steps = seam_steps(seams, levels, blend)
        facts |= steps
        progress.done({name: steps[name] for name in steps if name.startswith("seam_step_l")})
    else:
        blend = no_blend(len(faces))
    back = blocks.face_places()
    return ViewChoice(
        view=chosen[back],
        blend_view=blend.view[back],
        blend_weight=blend.weight[back],
        correction=blend.correction[back],
        gains=gains,
        facts=facts,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """The photo of every face, before seams are looked at; in the order of the blocks."""

    view: Int32
    """(F,) -1 where no photo sees the face."""
    candidates: Candidates
    """Sorted by view; qualities are costs now."""
    own: UInt8
    """(F, 3) faces' vertex colours after their gain."""
    pairs: Int32
    """(P, 2) neighbouring faces."""
    edges: Int32
    """(P, 2) the vertices between them."""
    borrowed: Bool
    """(F,) faces that have the photo of a neighbour, which does not see them."""
    facts: dict[str, Any]


def choose_labels(
    blocks: MeshBlocks,
    colours: UInt8,
    views: Sequence[View],
    photos: Photos,
    occluder: Occluder,
    gains: Float32,
    options: Options,
    threads: int,
    progress: Progress,
    *,
    grid: CellGrid | None = None,
    segments: Int32 | None = None,
) -> Labels:
    """Choose a photo for every face: the first three steps.

    Parameters
    ----------
    blocks : MeshBlocks
    colours : ndarray of shape (V, 3), uint8
        Of the vertices in their own order, not the blocks'.
    views, photos, occluder, gains, options, threads, progress
        As for :func:`choose_views`.
    grid : CellGrid, optional
        Where the cells lie that are judged together, and whose faces begin with one photo: the same
        for all pieces of a surface.
    segments : ndarray of shape (F,), int32, optional
        Segment of every face, in the order of the blocks: charts end at its border.

    Returns
    -------
    Labels

    Raises
    ------
    ValueError
        As :func:`choose_views`.
    """
    if len(views) > MAX_VIEWS:
        raise ValueError(f"{len(views)} views, expected at most {MAX_VIEWS}")
    if len(gains) != len(views) + 1:
        raise ValueError(f"{len(gains)} rows of gains for {len(views)} views, expected one more")
    own = own_colours(blocks.faces, colours[blocks.vertex_order], gains[-1], threads=threads)
    # (1) candidates
    candidates, facts = collect(blocks, views, photos, occluder, gains, options, threads, progress)
    # (2) photos that show something else
    progress.start("texture: moving things", None, "faces")
    coloured = len(colours) > 0 and int(np.ptp(colours, axis=0).max()) > 0
    facts["faces_seen"] = int((candidates.view[:, 0] >= 0).sum())
    if options.reject_outliers:
        facts["outliers"] = drop_outliers(
            candidates, blocks.vertices, blocks.faces, own if coloured else None, grid=grid,
            threads=threads,
        )  # fmt: skip
    progress.done({"outliers": facts.get("outliers", 0)})
    # (3) one photo for neighbours
    progress.start("texture: one photo for neighbours", None, "faces")
    pairs, edges = face_pairs(blocks.faces, len(blocks.vertices), threads=threads)
    neighbours = face_neighbours(blocks.vertices, blocks.faces, pairs, edges)
    view_costs(candidates, threads=threads)
    cells = face_cells(blocks.vertices, blocks.faces, CELL_EDGES, grid)
    labelled = label_faces(
        candidates, neighbours, cells, smoothness=options.smoothness, threads=threads
    )
    chosen = chosen_views(candidates, labelled.slot, threads=threads)
    packed = np.array([view.packed() for view in views]).reshape(-1, PACKED)
    if options.smoothness > 0.0:
        # A chart ends where its segment does, so nothing beyond is its neighbour.
        within = pairs
        if segments is not None:
            within = pairs[segments[pairs[:, 0]] == segments[pairs[:, 1]]]
        chosen = join_seen_charts(
            chosen, candidates.view, candidates.quality, blocks.vertices, blocks.faces, within,
            packed,
        )  # fmt: skip
        chosen = join_small_charts(chosen, blocks.vertices, blocks.faces, within, packed)
    borrowed = (chosen >= 0) & ~(candidates.view == chosen[:, None]).any(axis=1)
    facts |= {
        "energy_before": labelled.energies[0],
        "energy_after": labelled.energies[-1],
        "faces_unseen": int((chosen < 0).sum()),
        "faces_borrowed": int(borrowed.sum()),
    }
    progress.done({"faces unseen": facts["faces_unseen"]})
    return Labels(chosen, candidates, own, pairs, edges, borrowed, facts)


def collect(
    blocks: MeshBlocks,
    views: Sequence[View],
    photos: Photos,
    occluder: Occluder,
    gains: Float32,
    options: Options,
    threads: int,
    progress: Progress,
) -> tuple[Candidates, dict[str, Any]]:
    """Find the best views of every face, photo by photo; also what was counted on the way."""
    # Invariant: after photo n, `candidates` holds the best views of photos 0..n of every face.
    # Photos come and go one at a time, so memory does not grow with their number.
    candidates = new_candidates(len(blocks.faces))
    uv = np.empty((len(blocks.vertices), 2), np.float32)
    rays, rated_faces, blank = 0, 0, 0
    progress.start("texture: what each photo sees", float(len(views)), "photos")
    for number, view in enumerate(views):
        # (1) Where the photo looks: blocks of faces, their vertices in its pixels, and how fine
        # it must be.
        seen = visible_blocks(blocks, view)
        packed = view.packed()
        if len(seen):
            project_blocks(blocks, packed, seen, uv, threads=threads)
            scale = _photo_scale(blocks, packed, seen, uv)
        if not len(seen) or scale == 0:
            blank += 1
            progress.advance(1.0)
            continue
        # (2) Faces it would be good for, by its sharpness there.
        photo = photos.get(number, scale)
        rated = rate_faces(
            blocks, packed, seen, uv, sharpness_map(photo), candidates,
            min_cosine=float(np.cos(np.radians(options.max_angle_degrees))), threads=threads,
        )  # fmt: skip
        # (3) Those that nothing stands in front of.
        visible, cast = visible_faces(
            blocks, view, rated, occluder, offset_m=options.occluder_offset_m, threads=threads
        )
        photo_colours = sample_faces(
            photo, packed, gains[number], blocks.faces, uv, rated.face, threads=threads
        )
        insert(candidates, number, rated, visible, photo_colours, threads=threads)
        rays, rated_faces = rays + cast, rated_faces + len(rated.face)
        progress.advance(1.0)
    # By number from here on: equal lists of views compare in one pass.
    sorted_by_view(candidates, threads=threads)
    progress.done({"rays": rays})
    facts = {"views": len(views), "views_blank": blank, "rays": rays, "faces_rated": rated_faces}
    return candidates, facts


def own_colours(faces: Int32, colours: UInt8, gain: Float32, *, threads: int = 1) -> UInt8:
    """Vertex colours of every face after their gain, (F, 3) uint8."""
    own = np.empty((len(faces), 3), np.uint8)

    def work(begin: int, end: int) -> None:
        mean = colours[faces[begin:end]].mean(axis=1, dtype=np.float32)
        own[begin:end] = np.clip(np.rint((mean + SRGB_OFFSET) * gain[:3] - SRGB_OFFSET), 0, 255)

    in_chunks(work, len(own), threads=threads)
    return own


def _photo_scale(
    blocks: MeshBlocks, packed: Float64, seen: npt.NDArray[np.intp], uv: Float32
) -> int:
    """Power of two to shrink a photo by, so that a face covers a pixel; 0: it sees none."""
    area = median_area(blocks, packed, seen, uv)
    if area == 0.0:
        return 0
    scale = 1
    while scale < _MAX_SCALE and 4 * scale * scale <= area:
        scale *= 2
    return scale
