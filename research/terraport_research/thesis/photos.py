"""Figures 5.9 to 5.11 and A.1 to A.7: the ground with photos on it beside its vertex colours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from terraport_pipeline.demo_scenes import shipped_scene
from terraport_pipeline.engines.cameras import Camera, oblique
from terraport_pipeline.engines.pictures import encode_jpeg, render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.landing_view import choose_landing, view_from_eye
from terraport_pipeline.published.scene_model import WHOLE_FACES, SceneModel, load_scene_model
from terraport_pipeline.report.textures import VertexColours, find_vertex_colours
from terraport_research.options import ThesisOptions
from terraport_research.thesis.making import Made, Making
from terraport_store import Scene, StoreError

__all__ = ["make_photos"]

KEY: Final = "photos"
_SIZE: Final = (640, 420)
_NAMES: Final = ("5.9", "5.10", "5.11", "A.1", "A.2", "A.3", "A.4", "A.5", "A.6", "A.7")
_MOST: Final = len(_NAMES) // 2
"""Scenes: two figures each, from the eye and from above."""
_NEAR_SHARE: Final = 0.12
"""Side of what the view from above shows, of the scene's."""


def make_photos(options: ThesisOptions, progress: Progress) -> Made:
    """Draw textured scenes twice, from the eye of a visitor and from above."""
    making = Making(
        KEY, "Photos beside vertex colours: Figures 5.9 to 5.11, A.1 to A.7", "as built",
        options.seed,
    )  # fmt: skip
    making.say(
        "Scenes built with photos, drawn with their textures and with vertex colours alone, from "
        "one camera. Vertex colours are the cloud's where the build's work directory is there; "
        "else they are read off the texture at the vertices, which the words under them say."
    )
    paths = [Path(name) for name in options.scenes] or [shipped_scene()]
    progress.start("scenes", float(len(paths)), "scenes")
    names = iter(_NAMES)
    for path in paths[:_MOST]:
        try:
            _draw(making, path, names)
        except (PipelineError, StoreError, OSError) as error:
            making.say(f"{path.name} was not drawn: {error}.")
        progress.advance(1)
    for path in paths[_MOST:]:
        making.say(f"{path.name} was not drawn: at most {_MOST} scenes.")
    progress.done({"scenes": len(paths)})
    return making.made()


def _draw(making: Making, path: Path, names: Iterator[str]) -> None:
    with Scene.open(path) as scene:
        if scene.manifest.counts.detail_faces > WHOLE_FACES:
            making.say(
                f"{path.name} was not drawn: {scene.manifest.counts.detail_faces:,} faces, "
                f"at most {WHOLE_FACES:,}."
            )
            return
        model = load_scene_model(scene)
        if model.textures is None:
            making.say(f"{path.name} was not drawn: it has no textures.")
            return
        kept = find_vertex_colours(scene)
        for what, camera in _views(model):
            name = next(names)
            pictures = _pair(model, kept, camera)
            making.figure(name, f"Figure {name}: {scene.manifest.name}, {what}", pictures)


def _views(model: SceneModel) -> list[tuple[str, Camera]]:
    rays = RayScene(model.detail.vertices, model.detail.faces)
    landing = choose_landing(model, rays)
    vertices = model.detail.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = _NEAR_SHARE * float((high - low)[[0, 2]].max())
    place = landing.position
    near = (abs(vertices[:, 0] - place[0]) < half) & (abs(vertices[:, 2] - place[2]) < half)
    around = vertices[near][:: max(1, int(near.sum()) // 4000)]
    above = oblique(around, aspect=_SIZE[0] / _SIZE[1])
    return [("at eye level", view_from_eye(landing, rays)), ("from above", above)]


def _pair(
    model: SceneModel, kept: VertexColours | None, camera: Camera
) -> list[tuple[str, str, bytes | None]]:
    detail = model.detail
    assert model.textures is not None
    textured = render_mesh(
        detail.vertices, detail.faces, camera, _SIZE, colours=detail.colours,
        texturing=model.textures.detail, relief=0.0, shadows=False, supersample=2,
    )  # fmt: skip
    plain = kept or VertexColours(detail.vertices, detail.faces, detail.colours)
    coloured = render_mesh(
        plain.vertices, plain.faces, camera, _SIZE, colours=plain.colours,
        relief=0.0, shadows=False, supersample=2,
    )  # fmt: skip
    origin = "of the cloud" if kept is not None else "read off the texture"
    return [
        ("Vertex colours", f"{origin}, {len(plain.faces):,} faces", encode_jpeg(coloured)),
        ("Photos", f"{len(detail.faces):,} faces", encode_jpeg(textured)),
    ]
