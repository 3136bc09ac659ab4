"""What a walk on the sample quarry's haul road is like: ``python benchmarks/walk.py FOLDER...``.

A folder is one that ``terraport demo --no-serve --keep FOLDER`` left. One column each: samples and
texels on the road and elsewhere, how far the mesh lies from the true road, and the bytes of it all.
``--pictures DIR`` draws what is seen from 1.7 m above the road, the folders side by side.
``--smoke`` makes a small quarry and looks at that.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from terraport_pipeline.demo import prepare_demo
from terraport_pipeline.engines.cameras import eye_level
from terraport_pipeline.engines.pictures import render_mesh, save_png
from terraport_pipeline.published.scene_model import SceneModel, load_scene_model
from terraport_pipeline.synth.files import load_options, truth_path
from terraport_pipeline.synth.options import FlightOptions
from terraport_pipeline.synth.surface import Surface
from terraport_pipeline.synth.way import way_places
from terraport_store import Scene

EYE_M = 1.7
STANDS = 12
"""Places along the way that are looked from."""
SIZE = (640, 400)
SMALL = FlightOptions(count=8, width=160, height=120, way_share=0.5)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--smoke", action="store_true", help="make a small quarry")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folders = options.folders
        if options.smoke:
            prepare_demo(Path(name), points=20_000, flight=SMALL)
            folders = [Path(name)]
        if not folders:
            parser.error("got no folder, expected one that terraport demo kept, or --smoke")
        walks = [Walk.of(folder) for folder in folders]
    table = Table("", *(folder.name for folder in folders))
    for row in walks[0].facts:
        table.add_row(row, *(walk.facts[row] for walk in walks))
    Console(width=200).print(table)
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for stand in range(STANDS):
            sides = [walk.picture(stand) for walk in walks]
            save_png(np.concatenate(sides, axis=1), options.pictures / f"{stand:02}.png")


@dataclass(frozen=True, eq=False)
class Walk:
    """A quarry with its truth, and the scene that was built of it."""

    surface: Surface
    scale: float
    middle: np.ndarray
    """The site's middle in the scene, metres east, north and up."""
    model: SceneModel
    facts: dict[str, str]

    @classmethod
    def of(cls, folder: Path) -> Walk:
        """Read and measure what the demo left."""
        survey, scene_dir = folder / "quarry.laz", folder / "scenes" / "quarry"
        quarry = load_options(truth_path(survey))
        surface = Surface(quarry)
        with Scene.open(scene_dir) as scene:
            model = load_scene_model(scene)
        site = np.array([quarry.easting_m, quarry.northing_m, quarry.elevation_m])
        walk = cls(surface, quarry.scale, site - np.array(model.manifest.origin), model, {})
        # (1) Samples, by the place that each was measured at.
        with np.load(truth_path(survey)) as truth:
            samples = truth["truth_m"] / quarry.scale
        on_way = walk.on_way(samples[:, 0], samples[:, 1])
        middles, areas = surface.triangle_middles, surface.triangle_areas * quarry.scale**2
        way_area = walk.on_way(middles[:, 0], middles[:, 1])
        walk.facts["surface on the way, m2"] = f"{areas[way_area].sum():,.0f}"
        walk.facts["samples / m2, way"] = f"{on_way.sum() / areas[way_area].sum():.2f}"
        walk.facts["samples / m2, elsewhere"] = f"{(~on_way).sum() / areas[~way_area].sum():.2f}"
        # (2) Texels.
        side, area = walk.texels()
        places = walk.on_site(model.detail.vertices)
        centres = places[model.detail.faces].mean(axis=1)
        way = walk.on_way(centres[:, 0], centres[:, 1])
        walk.facts["texel, way: median, p90"] = _quantiles(side[way], area[way])
        walk.facts["texel, elsewhere: median, p90"] = _quantiles(side[~way], area[~way])
        walk.facts["way without a photo"] = (
            f"{1 - area[way & (side < np.inf)].sum() / area[way].sum():.1%}"
        )
        # (3) How near the mesh is to the truth, straight up or down.
        at = places[walk.on_way(places[:, 0], places[:, 1])]
        off = np.abs(at - surface.terrain.positions(at[:, 0], at[:, 1]))[:, 2] * quarry.scale
        walk.facts["mesh to road: median, p90"] = _quantiles(off, np.ones(len(off)))
        # (4) Bytes.
        manifest = model.manifest
        photos = folder / "photos" / "images"
        walk.facts["survey, bytes"] = f"{survey.stat().st_size:,}"
        walk.facts["photos, bytes"] = f"{sum(f.stat().st_size for f in photos.glob('*')):,}"
        walk.facts["scene, bytes"] = f"{sum(f.bytes for f in manifest.files.values()):,}"
        images = manifest.textures.image_bytes if manifest.textures else 0
        walk.facts["  of it images of the detail"] = f"{images:,}"
        walk.facts["faces of the detail"] = f"{manifest.counts.detail_faces:,}"
        build = json.loads((scene_dir / "build.json").read_text(encoding="utf-8"))
        seconds = sum(step["cpu_seconds"] for stage in build["stages"] for step in stage["steps"])
        walk.facts["build, CPU s"] = f"{seconds:.0f}"
        return walk

    def on_site(self, positions: np.ndarray) -> np.ndarray:
        """Convert from the scene's frame to design metres east, north and up."""
        axes = positions[:, [0, 2, 1]].astype(np.float64) * [1.0, -1.0, 1.0]
        places: np.ndarray = (axes - self.middle) / self.scale
        return places

    def on_way(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Tell which places, design metres, lie on the haul road."""
        road: np.ndarray = self.surface.terrain.sample(x.astype(float), y.astype(float)).road > 0.5
        return road

    def texels(self) -> tuple[np.ndarray, np.ndarray]:
        """Return side of a texel of each face of the detail (no image: inf), and its area."""
        mesh, textures = self.model.detail, self.model.textures
        area = _areas(mesh.vertices[mesh.faces].astype(np.float64))
        side = np.full(len(area), np.inf)
        if textures is not None:
            texturing = textures.detail
            image = texturing.image_of_face
            shown = np.flatnonzero(image >= 0)
            sizes = {int(n): texturing.images.size(int(n)) for n in np.unique(image[shown])}
            across = np.array([sizes[int(n)] for n in image[shown]], dtype=float)
            flat = texturing.uvs[mesh.faces[shown]].astype(np.float64) * across[:, None]
            texels = _areas(np.concatenate([flat, np.zeros((len(flat), 3, 1))], axis=2))
            side[shown] = np.sqrt(area[shown] / np.maximum(texels, 1e-9))
        side[side > 10.0] = np.inf  # one flat colour: no image of the ground
        return side, area

    def picture(self, stand: int) -> np.ndarray:
        """Draw what is seen from the way, looking down it."""
        places, headings, _ = way_places(self.surface.terrain, STANDS)
        x, y, z = places[stand] * self.scale + self.middle
        azimuth = float(np.degrees(np.arctan2(*headings[stand])))
        camera = eye_level((x, z + EYE_M, -y), azimuth_deg=azimuth, pitch_deg=-12.0)
        mesh = self.model.detail
        textures = self.model.textures
        return render_mesh(
            mesh.vertices, mesh.faces, camera, SIZE, colours=mesh.colours, normals=mesh.normals,
            texturing=None if textures is None else textures.detail, relief=0.0, shadows=False,
            supersample=2,
        )  # fmt: skip


def _areas(corners: np.ndarray) -> np.ndarray:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas: np.ndarray = 0.5 * np.linalg.norm(across, axis=1)
    return areas


def _quantiles(values: np.ndarray, weights: np.ndarray) -> str:
    """Say median and ninth decile, by weight, in centimetres."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    median, high = (values[order][np.searchsorted(share, q)] for q in (0.5, 0.9))
    return f"{median * 100:.1f}, {high * 100:.1f} cm"


if __name__ == "__main__":
    main()
