"""Terrain with patches of noisy colour, of any number of faces, as a build's work directory."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals

__all__ = ["SEED", "write_terrain"]

SEED: Final = 7


def _terrain(n_faces: int, *, detail: bool, noise: float, side_m: float) -> dict[str, AnyArray]:
    """Coloured grid terrain; base and detail are the same hills, the detail with small bumps."""
    rng = np.random.default_rng(SEED)
    n = int(np.sqrt(n_faces / 2)) + 1
    axis = np.linspace(0.0, side_m, n)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    y, field = np.zeros_like(x), np.zeros_like(x)
    for octave in range(5):
        wave = 2.0**octave * 2.0 * np.pi / side_m
        a, b, c, d = rng.uniform(0.0, 2.0 * np.pi, 4)
        y += side_m / 20.0 / 2.0**octave * np.sin(wave * x + a) * np.cos(wave * z + b)
        field += np.sin(0.7 * wave * x + c + 0.3 * wave * z) * np.cos(wave * z + d) / 1.5**octave
    if detail:
        y += 0.05 * np.sin(2.0 * x) * np.cos(2.3 * z)
    material = np.digitize(field, [-0.6, 0.3, 0.9]).ravel()
    palette = np.array([[60, 80, 50], [140, 120, 95], [190, 175, 150], [90, 90, 95]], np.float64)
    colours = palette[material] + rng.normal(0.0, noise, (n * n, 3))
    i, j = np.divmod(np.arange((n - 1) ** 2), n - 1)
    corner = i * n + j
    faces = np.stack(
        [corner, corner + 1, corner + n, corner + n, corner + 1, corner + n + 1], axis=1
    )
    return {
        "vertices": np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32),
        "faces": faces.reshape(-1, 3).astype(np.int32),
        "colours": np.clip(colours, 0, 255).astype(np.uint8),
    }


def write_terrain(folder: Path, n_faces: int, noise: float, base_faces: int) -> None:
    """Write the arrays of a terrain and its base as a build's work directory holds them."""
    side_m = float(np.sqrt(n_faces * 0.02))
    none = np.zeros(0, np.int64)
    for name, prefix, mesh in (
        (
            "tile-00000",
            "",
            {"border-rows": none, "border-shared": none}
            | _terrain(n_faces, detail=True, noise=noise, side_m=side_m),
        ),
        ("base", "base-", _terrain(base_faces, detail=False, noise=noise, side_m=side_m)),
    ):
        mesh["normals"] = vertex_normals(mesh["vertices"], mesh["faces"])
        (folder / name).mkdir(exist_ok=True)
        for array, values in mesh.items():
            np.save(folder / name / f"{prefix}{array}.npy", values)
    (folder / "settle").mkdir(exist_ok=True)
    np.save(folder / "settle" / "ids.npy", none)  # one tile shares nothing
    np.save(folder / "settle" / "ids-starts.npy", np.zeros(2, np.int64))
