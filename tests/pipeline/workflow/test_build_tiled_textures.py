"""Textures of a build by tiles: one scene, whatever the threads and kills."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from photo_scene import PhotoScene, photo_scene
from pipeline.one_piece import runner_in, surface_in_tiles

from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.options import regions as segment
from terraport_pipeline.stages import pack, texture
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.workflow import texture_step
from terraport_pipeline.workflow.pack_step import publish_tiles
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_pipeline.workflow.texture_step import (
    TextureInput,
    texture_base_alone,
    texture_tiles,
)
from terraport_store import BuildInfo, InputInfo, Scene
from terraport_store.layout import BASE
from terraport_store.validate import validate_scene

SEGMENT = segment.Options(min_faces=150, max_faces=900)
OPTIONS = texture.Options(texel_m=0.2, max_side=512, base_side=512)
BUILD = BuildInfo(
    terraport="0", options={}, input=InputInfo(name="a.laz", bytes=1, xxh3="0" * 16),
    warnings=(), stages=(),
)  # fmt: skip


@cache
def site() -> PhotoScene:
    return photo_scene()


def photos() -> TextureInput:
    return TextureInput(
        OPTIONS,
        {"photos": "p", "cameras": "c"},
        lambda: OpenPhotos(tuple(site().views), site(), ("a warning.",)),  # type: ignore[arg-type]
    )


def build(
    folder: Path,
    asked: TextureInput | None,
    *,
    threads: int = 2,
    base_image: base_atlas.Options | None = None,
) -> Runner:
    runner = runner_in(folder, threads=threads, max_memory_bytes=2**31)
    surface = surface_in_tiles(site().mesh, site().mesh, (0.1, 0.2, 0.5, 0.6), along=2)
    segmented = segment_tiles(runner, surface, SEGMENT)
    textures = base_texture = None
    if asked is not None:
        textures = texture_tiles(runner, surface, segmented, asked)
        base_texture = textures.base
    elif base_image is not None:
        base_texture = texture_base_alone(runner, surface, segmented, base_image)
    about = pack.About(np.array([500000.0, 8e6, 100.0]), None, 99, True, BUILD)
    options = pack.Options("place")
    publish_tiles(
        runner, folder / "scene", surface, segmented, textures, base_texture, about, options
    )
    return runner


def published(folder: Path) -> dict[str, bytes]:
    with Scene.open(folder / "scene") as opened:
        return {
            key: (opened.path / file.path).read_bytes()
            for key, file in opened.manifest.files.items()
        }


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> tuple[Path, Runner]:
    folder = tmp_path_factory.mktemp("tiled-textures")
    return folder, build(folder, photos())


def test_every_segment_and_the_base_have_an_image(scene) -> None:
    folder, _ = scene
    assert list(validate_scene(folder / "scene")) == []
    with Scene.open(folder / "scene") as opened:
        textures = opened.manifest.textures
        assert textures is not None
        assert not opened.manifest.has_colour
        assert textures.segments == opened.manifest.counts.segments > 4
        assert textures.texel_m == pytest.approx(0.2, rel=0.3)
        for number in range(textures.segments):
            mesh = opened.mesh(number)
            assert mesh.texture is not None
            assert mesh.colours is None


def test_one_stage_is_told_with_its_warnings(scene) -> None:
    folder, runner = scene
    names = [report.name for report in runner.reports]
    assert names == ["segment", "texture", "pack"]
    facts = runner.reports[1].facts
    assert facts.warnings == ("a warning.",)
    assert facts.counts["choice_faces_unseen"] < 0.2 * len(site().mesh.faces)
    # Charts end at segments and these at tiles: slivers there take their own segment's photos.
    assert 0 < facts.counts["choice_seam_share_across_tiles"] < 0.7
    shares = facts.notes["photo_ground_shares"]
    assert {name for name, _ in shares} == {view.name for view in site().views}
    assert [share for _, share in shares] == sorted((share for _, share in shares), reverse=True)
    assert sum(share for _, share in shares) == pytest.approx(
        1.0 - facts.counts["unseen_share"], abs=0.001
    )
    assert (
        facts.counts["choice_seam_step_local_across_tiles"]
        < facts.counts["choice_seam_step_photos_across_tiles"]
    )
    again = build(folder, photos())
    assert [report.taken_up for report in again.reports] == [True, True, True]


def test_threads_and_kills_change_nothing(scene, tmp_path, monkeypatch) -> None:
    whole, seen = texture_step.tiled_texture.draw, []

    def dies(*arguments, **named):
        if len(seen) == 2:
            raise KeyboardInterrupt
        seen.append(1)
        return whole(*arguments, **named)

    monkeypatch.setattr(texture_step.tiled_texture, "draw", dies)
    with pytest.raises(KeyboardInterrupt):
        build(tmp_path, photos(), threads=1)
    assert not (tmp_path / "scene").exists()
    monkeypatch.undo()
    build(tmp_path, photos(), threads=1)
    assert published(tmp_path) == published(scene[0])


def test_without_textures_the_base_alone_has_an_image(tmp_path) -> None:
    image = base_atlas.Options(side=512)
    runner = build(tmp_path, None, base_image=image)
    assert list(validate_scene(tmp_path / "scene")) == []
    with Scene.open(tmp_path / "scene") as opened:
        manifest = opened.manifest
        assert manifest.has_colour
        assert manifest.textures is not None
        assert (manifest.textures.segments, manifest.textures.base_side) == (0, 512)
        base = opened.file_mesh(BASE)
        meshes = [opened.mesh(number) for number in range(len(opened.index))]
    assert base.texture is not None
    assert base.colours is None
    assert all(mesh.texture is None and mesh.colours is not None for mesh in meshes)
    assert [report.name for report in runner.reports] == ["segment", "base_atlas", "pack"]
    again = build(tmp_path, None, base_image=image)
    assert [report.taken_up for report in again.reports] == [True, True, True]


def test_an_image_changes_neither_faces_nor_cover_of_the_base(tmp_path) -> None:
    corners, covers = [], []
    for name, image in (("plain", None), ("image", base_atlas.Options(side=256))):
        build(tmp_path / name, None, base_image=image)
        with Scene.open(tmp_path / name / "scene") as opened:
            base = opened.file_mesh(BASE)
            corners.append(np.sort(base.positions[base.faces], axis=1))  # may be rotated
            covers.append(opened.cover.to_bytes())
            assert (opened.manifest.textures is None) == (image is None)
    assert np.array_equal(*corners)
    assert covers[0] == covers[1]


def test_vertex_colours_are_drawn_without_photos(tmp_path) -> None:
    texturing = TextureInput(texture.Options(source="vertex", max_side=512, base_side=512), {})
    runner = build(tmp_path, texturing)
    assert list(validate_scene(tmp_path / "scene")) == []
    with Scene.open(tmp_path / "scene") as opened:
        assert opened.manifest.textures is not None
        assert opened.manifest.textures.source == "vertex"
        assert opened.manifest.textures.gsd_m is None
    assert runner.reports[1].facts.warnings == ()
