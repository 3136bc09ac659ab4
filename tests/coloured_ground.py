"""Coloured ground for the tests of tiles: a mesh, and the same mesh cut into tiles."""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Int64
from terraport_pipeline.model import Mesh

COLOURS = np.array([[180, 60, 50], [60, 150, 60], [70, 80, 190]], np.uint8)


def ground(cells: int, *, low: float = 0.0, high: float = 60.0) -> Mesh:
    """Rolling ground over a square, in three stripes of colour that run aslant across it."""
    line = np.linspace(low, high, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = 2.0 * np.sin(x / 7.0) * np.cos(z / 9.0) + 0.1 * np.sin(x * 1.7)
    index = np.arange((cells + 1) ** 2, dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    stripe = np.clip(((x + 0.4 * z) / 28.0).astype(int), 0, 2).ravel()
    noise = np.random.default_rng(5).integers(-4, 5, (len(vertices), 3))
    colours = np.clip(COLOURS[stripe].astype(int) + noise, 0, 255).astype(np.uint8)
    normals = np.tile(np.array([0.0, 1.0, 0.0], np.float32), (len(vertices), 1))
    height = vertices[:, 1].copy()
    return Mesh(vertices, faces, normals, colours, {"height": height})


def cut_mesh(mesh: Mesh, along: int) -> list[tuple[Mesh, Int64]]:
    """Cut a mesh into along x along tiles by the faces' middles: each with its faces' numbers."""
    middle = mesh.vertices[mesh.faces][:, :, [0, 2]].mean(axis=1)
    low, high = middle.min(axis=0), middle.max(axis=0)
    cell = np.minimum(((middle - low) / (high - low) * along).astype(int), along - 1)
    tile = cell[:, 0] * along + cell[:, 1]
    pieces = []
    for number in np.unique(tile):
        rows = np.flatnonzero(tile == number)
        used, corner = np.unique(mesh.faces[rows], return_inverse=True)
        piece = Mesh(
            mesh.vertices[used],
            corner.reshape(-1, 3).astype(np.int32),
            mesh.normals[used],
            mesh.colours[used],
            {name: values[used] for name, values in mesh.attributes.items()},
        )
        pieces.append((piece, rows))
    return pieces
