"""What a report shows of textures: the photo itself beside the scene, and how fine, whole and even.

Pictures are drawn by the camera that took the photo, lens distortion included, so that the eye can
go back and forth: the photo, the textured scene, the scene with vertex colours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from terraport_payload.types import AnyFloat, Bool, Float32, Int32, UInt8
from terraport_pipeline.engines.camera_files import has_cameras, read_cameras
from terraport_pipeline.engines.cameras import PhotoCamera
from terraport_pipeline.engines.photos import OpenPhotos, open_photos, sizes_below
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.model import Crs
from terraport_pipeline.published.scene_model import SceneModel
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.report.picture import Picture, PictureOptions, picture_of
from terraport_pipeline.stages.texture_sums import PHOTO_SHARES
from terraport_store import Manifest, Scene

__all__ = [
    "VertexColours",
    "find_vertex_colours",
    "open_scene_photos",
    "photo_pictures",
    "photo_rows",
    "texture_rows",
]

MAX_PHOTO_BYTES: Final = 512 << 20
"""Decoded photos kept while pictures are made."""

PANEL_PX: Final = 640
"""Width of one of the panels side by side."""

CLOSE_PX: Final = (560, 420)
"""What a close-up shows: so many of the photo's own pixels."""

MAX_PHOTO_ROWS: Final = 30
"""Photos that are listed one by one."""

GRID: Final = (32, 24)
"""Rays by which views are judged."""

MIN_SHARE: Final = 0.5
"""A view that meets the scene with less of its picture shows mostly what lies beside it."""

MAX_TILES: Final = 100_000
"""Tiles whose vertex colours are looked for."""

GAP_PX: Final = 8

_OVERVIEW_SAMPLES: Final = 3
"""Of a pixel along each axis where a whole photo is drawn: a pixel is three of the photo's."""


@dataclass(frozen=True, slots=True, eq=False)
class VertexColours:
    """The detail's mesh with the vertex colours that it had before texturing."""

    vertices: Float32
    faces: Int32
    colours: UInt8


def open_scene_photos(
    model: SceneModel,
    photos: Path,
    cameras: Path | None = None,
    offset: tuple[float, float, float] | None = None,
) -> OpenPhotos:
    """Find the photos of a scene again.

    Parameters
    ----------
    model : SceneModel
    photos : Path
        Their folder.
    cameras : Path, optional
        File or project folder; looked for beside the photos by default.
    offset : tuple of float, optional
        As the build was given it.

    Raises
    ------
    ReadError, PhotoError
        As :func:`~terraport_pipeline.engines.camera_files.read_cameras` and
        :func:`~terraport_pipeline.engines.photos.open_photos` say.
    """
    folders = (photos, photos.absolute().parent)
    camera_file = cameras or next((folder for folder in folders if has_cameras(folder)), photos)
    manifest = model.manifest
    crs = manifest.crs
    vertices = model.detail.vertices
    placed = read_cameras(
        camera_file,
        origin=np.array(manifest.origin),
        crs=Crs(crs.name, crs.wkt or "", crs.epsg) if crs is not None else None,
        offset=offset,
        samples=vertices[:: max(1, len(vertices) // 20_000)].astype(np.float64),
        photo_size=sizes_below(photos),
    )
    return open_photos(placed.views, photos, max_bytes=MAX_PHOTO_BYTES)


def find_vertex_colours(scene: Scene, work: Path | None = None) -> VertexColours | None:
    """Look for the detail's vertex colours, which a textured scene does not hold any more.

    Parameters
    ----------
    scene : Scene
        Open.
    work : Path, optional
        The build's work directory; ``.<scene>.work`` beside the scene by default.

    Returns
    -------
    VertexColours or None
        None when they are not there or belong to another build.
    """
    folder = work or default_work_directory(scene.path)
    return _colours_of(scene, sorted(folder.glob("tile-*"))[:MAX_TILES])


def _colours_of(scene: Scene, tiles: Sequence[Path]) -> VertexColours | None:
    """Put the detail together from the folders of its tiles, if it is that of the scene."""
    vertices, faces, colours = [], [], []
    count = rows = 0
    try:
        for tile in tiles:
            here = [
                np.load(tile / f"{name}.npy", mmap_mode="r", allow_pickle=False)
                for name in ("vertices", "faces", "colours")
            ]
            if here[0].shape != here[2].shape or here[1].shape[1:] != (3,):
                return None
            count += len(here[1])
            if count > scene.manifest.counts.detail_faces:
                return None
            vertices.append(np.array(here[0], np.float32))
            faces.append(np.array(here[1], np.int32) + np.int32(rows))
            colours.append(np.array(here[2], np.uint8))
            rows += len(here[0])
    except (OSError, ValueError, EOFError):
        return None
    if not count or count != scene.manifest.counts.detail_faces:
        return None
    joined = VertexColours(*(np.concatenate(arrays) for arrays in (vertices, faces, colours)))
    drawn = np.zeros(len(joined.vertices), np.bool_)
    drawn[joined.faces.ravel()] = True
    used = joined.vertices[drawn]
    bounds = scene.index.bounds  # of the detail alone: the base reaches beyond it
    fits = np.allclose(used.min(axis=0), bounds[:, :3].min(axis=0), atol=0.05) and np.allclose(
        used.max(axis=0), bounds[:, 3:].max(axis=0), atol=0.05
    )
    return joined if fits else None


def photo_pictures(
    model: SceneModel,
    rays: RayScene,
    opened: OpenPhotos,
    plain: VertexColours | None,
    options: PictureOptions,
) -> Iterator[Picture]:
    """Draw the scene by cameras that took photos.

    Parameters
    ----------
    model : SceneModel
    rays : RayScene
        Its detail.
    opened : OpenPhotos
    plain : VertexColours or None
        The third panel; without it there are two.
    options : PictureOptions

    Yields
    ------
    Picture
        For the view nearest to straight down and for an oblique one: the whole photo, and a
        close-up in the photo's own pixels.
    """
    # (1) Words for two panels or three.
    panels = "the photo, the scene with textures" + (
        ", the scene with vertex colours" if plain is not None else ""
    )
    lacking = (
        ""
        if plain is not None
        else (
            " There are no vertex colours to compare: the work directory of the build is not here, "
            "or is another build's."
        )
    )
    # (2) By each camera the whole photo, then one part of it pixel by pixel.
    plain_rays = None if plain is None else RayScene(plain.vertices, plain.faces)

    def draw(
        view: View, part: tuple[slice, slice], size: tuple[int, int], supersample: int
    ) -> list[UInt8]:
        rows, columns = part
        window = (columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start)
        camera = PhotoCamera(view, window)
        drawn = [_draw(model, rays, camera, size, supersample)]
        if plain is not None:
            drawn.append(_draw_plain(plain, plain_rays, camera, size, supersample))
        return drawn

    for index, kind in chosen_views(opened.views, rays):
        view = opened.views[index]
        photo = opened.photos.get(index)
        whole = (PANEL_PX, round(PANEL_PX * view.lens.height / view.lens.width))
        everything = (slice(0, view.lens.height), slice(0, view.lens.width))
        yield _picture(
            f"photo-{kind}",
            f"Photo and scene, {kind}",
            f"{view.name}, side by side: {panels}",
            f"{view.name} ({view.lens.width} x {view.lens.height}): {panels}, drawn by the same "
            f"camera. Textures have the exposure that is common to all photos.{lacking}",
            [_resized(photo, whole), *draw(view, everything, whole, _OVERVIEW_SAMPLES)],
            options,
        )
        box = close_up(photo, view, rays)
        size = (box[1].stop - box[1].start, box[0].stop - box[0].start)
        yield _picture(
            f"close-{kind}",
            f"Close-up, {kind}",
            f"A part of {view.name} in the photo's own pixels: {panels}",
            f"{CLOSE_PX[0]} x {CLOSE_PX[1]} pixels of {view.name}, one to one: {panels}.",
            [photo[box], *draw(view, box, size, options.supersample)],
            options,
        )


def chosen_views(views: Sequence[View], rays: RayScene) -> list[tuple[int, str]]:
    """Choose a view straight down and an oblique one that the scene fills: (index, kind)."""
    share = np.array([_share(view, rays) for view in views])
    down = np.array([-view.rotation[2, 1] for view in views])
    good = share >= min(MIN_SHARE, float(share.max()))
    # Near the middle of the scene rather than at its edge: where most photos overlap.
    positions = np.array([view.position for view in views])[:, [0, 2]]
    away = np.linalg.norm(positions - np.median(positions[good], axis=0), axis=1)
    away /= max(float(away[good].max()), 1e-9)
    picked = [(int(np.argmax(np.where(good, down - 0.3 * away, -9.0))), "from above")]
    oblique = int(np.argmin(np.where(good, down, 9.0)))
    if oblique != picked[0][0] and down[oblique] < 0.9:
        picked.append((oblique, "oblique"))
    return picked


def close_up(photo: UInt8, view: View, rays: RayScene) -> tuple[slice, slice]:
    """Find the part of a photo with the most contrast that shows nothing but the scene."""
    height, width = photo.shape[:2]
    wide, high = min(CLOSE_PX[0], width), min(CLOSE_PX[1], height)
    best, corner = -1.0, ((height - high) // 2, (width - wide) // 2)
    for top in np.linspace(0, height - high, 7).astype(int):
        for left in np.linspace(0, width - wide, 7).astype(int):
            across, down = np.linspace(0.03, 0.97, 6), np.linspace(0.03, 0.97, 6)
            x, y = np.meshgrid(left + across * wide, top + down * high)
            if not _met(view, np.stack([x.ravel(), y.ravel()], axis=1), rays).all():
                continue
            grey = photo[top : top + high : 3, left : left + wide : 3, 1].astype(np.float32)
            # Contrast between neighbours: detail, not one bright and one dark half.
            contrast = float(np.abs(np.diff(grey, axis=0)).mean())
            if contrast > best:
                best, corner = contrast, (int(top), int(left))
    return slice(corner[0], corner[0] + high), slice(corner[1], corner[1] + wide)


_MADE_FROM: Final = {
    "photos": "photos",
    "vertex": "vertex colours",
    "mesh": "the images of the mesh",
}


def texture_rows(manifest: Manifest, record: Mapping[str, Any]) -> tuple[dict[str, str], ...]:
    """Tell of the segments' textures in words and numbers; empty without any."""
    textures = manifest.textures
    if textures is None or textures.segments == 0:
        return ()
    counts = _of_stage(record).get("counts", {})
    facts: list[tuple[str, str]] = [
        ("made from", _MADE_FROM[textures.source]),
        ("texel", f"{textures.texel_m * 100:.3g} cm (median over the surface)"),
    ]
    if textures.gsd_m is not None:
        facts.append(("ground sampling distance", f"{textures.gsd_m * 100:.3g} cm (median)"))
    facts += [
        ("images", f"{textures.segments:,} of {manifest.counts.segments:,} segments and the base"),
        ("texels", f"{textures.texels / 1e6:,.1f} million"),
        ("bytes", f"{textures.image_bytes / 1e6:,.1f} MB ({', '.join(textures.media_types)})"),
    ]
    for name, label, form in _COUNTS:
        value = counts.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            facts.append((label, form.format(value)))
    return tuple({"label": label, "value": value} for label, value in facts)


def photo_rows(record: Mapping[str, Any]) -> tuple[dict[str, str], ...]:
    """Tell how much of the surface each photo serves, largest first; empty where nobody noted it.

    At most :data:`MAX_PHOTO_ROWS` rows; the last one is of all others together.
    """
    noted = _of_stage(record).get(PHOTO_SHARES, [])
    try:
        shares = [(str(name), float(share)) for name, share in noted]
    except (TypeError, ValueError):
        return ()
    used = [(name, share) for name, share in shares if share > 0]
    unused = len(shares) - len(used)
    rows = [(name, f"{share:.1%}") for name, share in used[:MAX_PHOTO_ROWS]]
    others = used[MAX_PHOTO_ROWS:]
    if others:
        rows.append((f"{len(others):,} more", f"{sum(share for _, share in others):.1%}"))
    if unused:
        rows.append((f"{unused:,} not used", "0"))
    return tuple({"photo": photo, "share": share} for photo, share in rows)


def _of_stage(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what the build noted of the textures."""
    stages = record.get("stages", [])
    rows = [row for row in stages if isinstance(row, Mapping) and row.get("name") == "texture"]
    return rows[0] if rows else {}


_COUNTS: Final = (
    ("unseen_share", "surface that no photo sees", "{:.2%}, filled from vertex colours"),
    ("borrowed_share", "faces with a neighbour's photo", "{:.2%}, in small charts that joined it"),
    ("base_borrowed_share", "the same of the base", "{:.2%}"),
    ("crowded_share", "surface for which images have no room", "{:.2%}, one colour a face"),
    ("base_crowded_share", "the same of the base", "{:.2%}, one colour a face"),
    ("cells_share", "atlas used by charts", "{:.0%}"),
    ("charts", "charts", "{:,.0f}"),
    ("faces_per_chart", "faces a chart, mean", "{:,.1f}"),
    ("faces_per_chart_p50", "faces a chart, median", "{:,.0f}"),
    ("base_texel_m", "texel of the base", "{:.3g} m"),
    ("photos_left_out", "photos left out", "{:,.0f}"),
    ("choice_views_used", "photos used", "{:,.0f}"),
    ("choice_outliers", "photos dropped as outliers, face by face", "{:,.0f}"),
    ("choice_seam_edges", "edges between two photos", "{:,.0f}"),
    ("choice_seam_step_photos", "step at seams, photos as they are", "{:.1f} grey levels"),
    ("choice_seam_step_gains", "step at seams, exposure evened out", "{:.1f} grey levels"),
    ("choice_seam_step_smooth", "step at seams, levelled over the surface", "{:.1f} grey levels"),
    ("choice_seam_step_local", "step at seams, as published", "{:.1f} grey levels"),
)
"""Counts of the stage, what they are called, how they are written."""


def _share(view: View, rays: RayScene) -> float:
    columns, rows = GRID
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) / columns * view.lens.width,
        (np.arange(rows) + 0.5) / rows * view.lens.height,
    )
    return float(_met(view, np.stack([x.ravel(), y.ravel()], axis=1), rays).mean())


def _met(view: View, pixels: AnyFloat, rays: RayScene) -> Bool:
    headings = np.nan_to_num(view.rays(pixels))
    face = rays.closest_hit(np.broadcast_to(view.position, headings.shape), headings)[1]
    return face >= 0


def _draw(
    model: SceneModel, rays: RayScene, camera: PhotoCamera, size: tuple[int, int], supersample: int
) -> UInt8:
    detail = model.detail
    return render_mesh(
        detail.vertices,
        detail.faces,
        camera,
        size,
        colours=detail.colours,
        texturing=None if model.textures is None else model.textures.detail,
        relief=0.0,
        shadows=False,
        supersample=supersample,
        scene=rays,
    )


def _draw_plain(
    plain: VertexColours,
    rays: RayScene | None,
    camera: PhotoCamera,
    size: tuple[int, int],
    supersample: int,
) -> UInt8:
    return render_mesh(
        plain.vertices,
        plain.faces,
        camera,
        size,
        colours=plain.colours,
        relief=0.0,
        shadows=False,
        supersample=supersample,
        scene=rays,
    )


def _resized(image: UInt8, size: tuple[int, int]) -> UInt8:
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))


def _picture(
    key: str, title: str, alt: str, caption: str, panels: list[UInt8], options: PictureOptions
) -> Picture:
    gap = np.full((panels[0].shape[0], GAP_PX, 3), 255, dtype=np.uint8)
    columns = [panels[0]]
    for panel in panels[1:]:
        columns += [gap, panel]
    image = np.concatenate(columns, axis=1)
    return picture_of(options.quality, key.replace(" ", "-"), title, alt, caption, image)
