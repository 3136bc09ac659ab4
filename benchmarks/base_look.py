"""How the base looks beside the detail: ``python benchmarks/base_look.py SCENE...``.

Base and detail are drawn from the same cameras, each 20 m from a place on the detail, and compared
where both are drawn. One row a scene: mean difference of colours alone, and of colours under the
light that the web viewer lays over them (0.35); faces and bytes. ``--pictures DIR`` keeps the
pictures: detail on the left, base on the right.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from terraport_pipeline.engines.cameras import Camera, eye_level
from terraport_pipeline.engines.pictures import render_mesh, save_png
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.texturing import Texturing
from terraport_pipeline.model import Mesh
from terraport_pipeline.published.scene_model import SceneModel, load_scene_model
from terraport_store import Scene

CORPUS = Path(__file__).resolve().parents[1] / "tests" / "conformance" / "scene"
DISTANCE_M = 20.0
PITCHES_DEG = (-30.0, -50.0, -75.0)
SIZE = (360, 240)
RELIEF = 0.35
"""As the viewer's shader has it over vertex colours."""
TRIES = 40
"""Places that are tried for each camera: from some the place is hidden."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--smoke", action="store_true", help="scenes of the corpus")
    options = parser.parse_args()
    scenes = [CORPUS / "tiny"] if options.smoke else options.scenes
    if not scenes:
        parser.error("got no scene, expected one or more")
    table = Table("scene", "detail", "base", "base.tsg", "cover", "of all", "image", "p99 of")
    for heading in ("colours", "lit", "95 %", "worst camera"):
        table.add_column(heading, justify="right")
    for path in scenes:
        table.add_row(*row(path, options.cameras, options.pictures))
    Console(width=200).print(table)


def row(path: Path, cameras: int, pictures: Path | None) -> list[str]:
    """Measure one scene."""
    with Scene.open(path) as scene:
        model = load_scene_model(scene)
        manifest = scene.manifest
    deviation_m = manifest.hand_off.deviation_m
    # (1) The same cameras for all builds of a survey: they depend on the detail alone.
    detail, base = Level.of(model, "detail"), Level.of(model, "base")
    bare, lit, worst = [], [], 0.0
    for number, camera in enumerate(views(detail, cameras)):
        # (2) Pixels that both levels are drawn on; edges of either are left in.
        both = detail.hits(camera) & base.hits(camera)
        if not both.any():
            continue
        plain = pair(detail, base, camera, 0.0)
        shaded = pair(detail, base, camera, RELIEF)
        bare.append(difference(*plain)[both])
        lit.append(difference(*shaded)[both])
        worst = max(worst, float(bare[-1].mean()))
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            name = f"{path.parent.name}-{path.name}-{number:02}.png"
            save_png(np.concatenate(shaded, axis=1), pictures / name)
    # (3) Sizes.
    files = manifest.files
    base_bytes, cover_bytes = files["base.tsg"].bytes, files["base.cover"].bytes
    whole = sum(file.bytes for file in files.values())
    all_bare = np.concatenate(bare)
    side = manifest.textures.base_side if manifest.textures else 0
    return [
        str(path),
        f"{manifest.counts.detail_faces:,}",
        f"{manifest.counts.base_faces:,}",
        f"{base_bytes / 1e6:.2f} MB",
        f"{cover_bytes / 1e3:.0f} kB",
        f"{(base_bytes + cover_bytes) / whole:.0%}",
        f"{side}",
        f"{deviation_m:.3f} m",
        f"{all_bare.mean():.1f}",
        f"{np.concatenate(lit).mean():.1f}",
        f"{np.percentile(all_bare, 95):.1f}",
        f"{worst:.1f}",
    ]


class Level:
    """One level of a scene, ready to be drawn."""

    def __init__(self, mesh: Mesh, texturing: Texturing | None) -> None:
        self.mesh, self.texturing = mesh, texturing
        self.rays = RayScene(mesh.vertices, mesh.faces)

    @classmethod
    def of(cls, model: SceneModel, name: str) -> Level:
        """Take base or detail out of a scene."""
        textures = model.textures
        return cls(getattr(model, name), None if textures is None else getattr(textures, name))

    def hits(self, camera: Camera) -> np.ndarray:
        """Tell which pixels show it, (H, W)."""
        return (self.rays.closest_hit(*camera.rays(*SIZE))[1] >= 0).reshape(SIZE[::-1])

    def picture(self, camera: Camera, relief: float) -> np.ndarray:
        """Draw it, (H, W, 3)."""
        mesh = self.mesh
        return render_mesh(
            mesh.vertices, mesh.faces, camera, SIZE, colours=mesh.colours, normals=mesh.normals,
            texturing=self.texturing, relief=relief, shadows=False, supersample=2,
            scene=self.rays,
        )  # fmt: skip


def pair(detail: Level, base: Level, camera: Camera, relief: float) -> list[np.ndarray]:
    """Draw both levels from one camera."""
    return [level.picture(camera, relief) for level in (detail, base)]


def difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Mean over the channels of what two pictures differ by, (H, W), levels."""
    apart: np.ndarray = np.abs(one.astype(np.float32) - other.astype(np.float32)).mean(axis=2)
    return apart


def views(detail: Level, count: int) -> list[Camera]:
    """Place cameras around the scene, each 20 m from the place in the middle of its picture."""
    random = np.random.default_rng(20)
    vertices = detail.mesh.vertices
    cameras: list[Camera] = []
    for _ in range(TRIES * count):
        place = vertices[random.integers(len(vertices))].astype(np.float64)
        camera = eye_level(
            np.zeros(3),
            azimuth_deg=float(random.uniform(0, 360)),
            pitch_deg=PITCHES_DEG[len(cameras) % len(PITCHES_DEG)],
        )
        eye = place - DISTANCE_M * np.array(camera.forward)
        # Seen from there, and not from below the ground; beside a small scene is well enough.
        ahead, _ = detail.rays.closest_hit(eye[None], np.array(camera.forward)[None])
        above, _ = detail.rays.closest_hit(eye[None], np.array([[0.0, 1.0, 0.0]]))
        if abs(float(ahead[0]) - DISTANCE_M) < 0.5 and not np.isfinite(above[0]):
            cameras.append(replace(camera, eye=tuple(eye.tolist())))
        if len(cameras) == count:
            break
    return cameras


if __name__ == "__main__":
    main()
