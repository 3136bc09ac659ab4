"""A level field without colour, and photos of it whose every pixel is known from a formula."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image

from terraport_pipeline.engines.camera_files.write_colmap import write_colmap
from terraport_pipeline.geometry.photos.lens import Lens, View

ORIGIN = np.array([500_000.0, 5_200_000.0, 100.0])
SIDE_M = 24.0
HEIGHT_M = 40.0
LENS = Lens(width=320, height=240, fx=300.0, fy=300.0, cx=160.0, cy=120.0, radial=(-0.02,))


def field_colour(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """sRGB levels of the field, metres about its middle."""
    return np.stack(
        [
            128 + 80 * np.sin(0.5 * east),
            128 + 80 * np.cos(0.4 * north),
            100 + 30 * np.sin(0.3 * (east + north)),
        ],
        axis=-1,
    )


def field_views(count: int = 5) -> list[View]:
    """Cameras that look straight down, north up, in a row from west to east."""
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    places = np.linspace(-6.0, 6.0, count)
    return [
        View(f"p{i}.png", LENS, rotation, np.array([x, HEIGHT_M, 0.5 * i]))
        for i, x in enumerate(places)
    ]


def render_field(view: View) -> np.ndarray:
    """The photo that a view takes of the field, (H, W, 3) uint8."""
    column, row = np.meshgrid(np.arange(LENS.width) + 0.5, np.arange(LENS.height) + 0.5)
    rays = view.rays(np.column_stack([column.ravel(), row.ravel()]))
    ground = view.position + rays * (-view.position[1] / rays[:, 1])[:, None]
    levels = field_colour(ground[:, 0], -ground[:, 2])
    return np.rint(levels).astype(np.uint8).reshape(LENS.height, LENS.width, 3)


def write_field(folder: Path, *, spacing_m: float = 0.5) -> Path:
    """Write ``field.xyz`` and ``photos/`` with ``colmap/`` beside it; return the survey."""
    rng = np.random.default_rng(5)
    axis = np.arange(-SIDE_M / 2, SIDE_M / 2 + spacing_m / 2, spacing_m)
    east, north = (coordinates.ravel() for coordinates in np.meshgrid(axis, axis))
    points = np.column_stack([east, north, np.zeros_like(east)])
    points += rng.uniform(-0.1, 0.1, points.shape) * spacing_m * [1, 1, 0.02]
    np.savetxt(folder / "field.xyz", points + ORIGIN, "%.4f")
    (folder / "photos").mkdir()
    views = field_views()
    for view in views:
        PIL.Image.fromarray(render_field(view)).save(folder / "photos" / view.name)
    write_colmap(folder / "colmap", views, origin=ORIGIN)
    return folder / "field.xyz"
