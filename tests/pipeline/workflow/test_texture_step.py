"""A build with photos: what the photos show is what the payloads show."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from pipeline.flat_photos import ORIGIN, field_colour, field_views, render_field, write_field

from terraport_payload import SegmentMesh
from terraport_pipeline.engines.camera_files.write_colmap import write_colmap
from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.errors import OptionError, PhotoError
from terraport_pipeline.extent import Extent
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.stages import texture
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene, validate_scene
from terraport_store.layout import BASE


def options_for(folder: Path, scene: Path, **more: object) -> BuildOptions:
    return BuildOptions(
        folder / "field.xyz",
        scene,
        reconstruct=reconstruct.Options(base_faces=600),
        segment=segment.Options(min_faces=300, max_faces=1500),
        **{"texture": Texturing(photos=folder / "photos"), "threads": 1, **more},  # type: ignore[arg-type]
    )


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The field and its scene; never modified."""
    folder = tmp_path_factory.mktemp("field")
    write_field(folder)
    build(options_for(folder, folder / "scene"))
    return folder


def payloads(scene: Scene) -> Iterator[SegmentMesh]:
    for number in range(len(scene.index)):
        yield scene.mesh(number)


def shown(mesh: SegmentMesh, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Places on a mesh, and the level of the texture there as a sampler reads it."""
    assert mesh.texture is not None
    assert mesh.uvs is not None
    weights = rng.dirichlet(np.ones(3), len(mesh.faces)).astype(np.float32)
    points = (mesh.positions[mesh.faces] * weights[:, :, None]).sum(axis=1)
    uv = (mesh.uvs[mesh.faces] * weights[:, :, None]).sum(axis=1)
    pixels = decode_image(mesh.texture.data).astype(float)
    size = np.array([mesh.texture.width, mesh.texture.height])
    at = np.clip(uv * size - 0.5, 0, size - 1.001)
    i, j = at.astype(int).T
    s, t = (at - at.astype(int)).T[:, :, None]
    top = (1 - s) * pixels[j, i] + s * pixels[j, i + 1]
    low = (1 - s) * pixels[j + 1, i] + s * pixels[j + 1, i + 1]
    return points, (1 - t) * top + t * low


def test_payloads_show_what_the_photos_show(field: Path) -> None:
    rng = np.random.default_rng(1)
    with Scene.open(field / "scene") as scene:
        offset = np.array(scene.manifest.origin) - ORIGIN
        meshes = [*payloads(scene), scene.file_mesh(BASE)]
    errors = []
    for mesh in meshes:
        assert mesh.colours is None
        points, level = shown(mesh, rng)
        truth = field_colour(points[:, 0] + offset[0], -points[:, 2] + offset[1])
        errors.append(level - truth)
    error = np.concatenate(errors)
    mean_square = float((error**2).mean())
    assert 10 * np.log10(255**2 / mean_square) > 33  # JPEG at 85 and pixels of 13 cm
    assert np.abs(error).max() < 45  # no white, no hole, no foreign chart


def test_the_scene_is_whole_and_says_what_it_has(field: Path) -> None:
    assert validate_scene(field / "scene") == []
    with Scene.open(field / "scene") as scene:
        manifest = scene.manifest
        meshes = list(payloads(scene))
    stated = manifest.textures
    assert stated is not None
    assert (stated.source, stated.media_types) == ("photos", ("image/jpeg",))
    assert stated.segments == len(meshes)
    images = [mesh.texture for mesh in meshes if mesh.texture]
    assert stated.image_bytes == sum(len(image.data) for image in images)
    assert stated.max_side == max(max(image.width, image.height) for image in images)
    assert stated.texel_m == pytest.approx(40 / 300, rel=0.15)
    assert stated.gsd_m == pytest.approx(40 / 300, rel=0.05)
    assert manifest.has_colour is False
    recorded = manifest.build.options["texture"]
    assert recorded["photos"]["count"] == 5  # type: ignore[index, call-overload]


def test_vertices_on_seams_are_equal_but_for_their_uvs(field: Path) -> None:
    with Scene.open(field / "scene") as scene:
        mesh = max(payloads(scene), key=lambda mesh: len(mesh.faces))
    assert mesh.region_ids is not None
    rows = np.column_stack([mesh.positions, mesh.region_ids])
    unique, which = np.unique(rows, axis=0, return_inverse=True)
    assert len(unique) < len(rows)
    first = np.zeros((len(unique), 3), np.float32)
    first[which] = mesh.normals
    differ = (first[which] != mesh.normals).any(axis=1)
    # On this level field the solver puts some vertices nearer to each other than a grid step.
    assert differ.mean() < 0.02


def test_threads_change_nothing_and_nothing_is_done_twice(field: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    shutil.copytree(field / ".scene.work", work)
    shutil.rmtree(work / "texture-tile-00000")
    options = options_for(field, tmp_path / "scene", work=work, threads=2, name="scene")
    first = build(options)
    assert [stage.taken_up for stage in first.stages] == [True, True, True, True, False, False]
    with Scene.open(field / "scene") as original, Scene.open(tmp_path / "scene") as repeated:
        assert original.manifest.version == repeated.manifest.version
    again = build(options)
    assert all(stage.taken_up for stage in again.stages)


def test_textures_from_vertex_colours(field: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    shutil.copytree(field / ".scene.work", work)
    texturing = Texturing(texture.Options(source="vertex", kind="png"))
    build(options_for(field, tmp_path / "scene", work=work, texture=texturing))
    with Scene.open(tmp_path / "scene") as scene:
        assert scene.manifest.textures is not None
        assert scene.manifest.textures.source == "vertex"
        assert scene.manifest.textures.gsd_m is None
        mesh = next(payloads(scene))
    assert mesh.texture is not None
    assert np.ptp(decode_image(mesh.texture.data).astype(int)) <= 1  # a survey without colour: grey


def test_what_is_missing_is_told_before_any_work(field: Path, tmp_path: Path) -> None:
    alone = tmp_path / "deep" / "photos"
    shutil.copytree(field / "photos", alone)
    scene = tmp_path / "scene"
    with pytest.raises(OptionError, match="photos without cameras"):
        build(options_for(field, scene, texture=Texturing(photos=alone)))
    with pytest.raises(PhotoError, match="is not a folder"):
        build(options_for(field, scene, texture=Texturing(photos=tmp_path / "no")))
    with pytest.raises(OptionError, match="options of cameras or textures without photos"):
        Texturing(cameras=field / "colmap")
    with pytest.raises(OptionError, match="expected one or the other"):
        Texturing(texture.Options(source="vertex"), photos=alone)
    assert not (tmp_path / ".scene.work" / "read").exists()


def test_cameras_that_look_elsewhere_are_told_of_before_the_long_work(
    field: Path, tmp_path: Path
) -> None:
    work = tmp_path / "work"
    texturing = Texturing(photos=field / "photos", camera_offset=(5000.0, 0.0, 0.0))
    with pytest.raises(PhotoError):
        build(options_for(field, tmp_path / "scene", work=work, texture=texturing))
    assert (work / "read").exists()
    assert not (work / "partition").exists()


def damaged(field: Path, folder: Path, change: Callable[[Path], object], *numbers: int) -> Path:
    """The field's photos, some of them changed."""
    shutil.copytree(field / "photos", folder / "photos")
    shutil.copytree(field / "colmap", folder / "colmap")
    for number in numbers:
        change(folder / "photos" / f"p{number}.png")
    return folder / "photos"


def elsewhere(path: Path) -> None:
    """Another place's photo: spots of any colour."""
    rng = np.random.default_rng(int(path.stem[1:]))
    levels = rng.integers(0, 256, (12, 16, 3)).astype(np.uint8)
    PIL.Image.fromarray(levels).resize((320, 240)).save(path)


@pytest.mark.parametrize(
    ("change", "left_out", "word"),
    [
        (Path.unlink, 2, "2 of 5 photos are not below"),
        (lambda path: path.write_bytes(b"no picture"), 2, "2 of 5 photos cannot be used"),
        (lambda path: path.write_bytes(path.read_bytes()[:9000]), 2, "is truncated"),
        (lambda path: PIL.Image.new("RGB", (240, 240)).save(path), 2, "has 240 x 240 pixels"),
        (lambda path: PIL.Image.open(path).resize((160, 120)).save(path), 0, "lenses were scaled"),
        (elsewhere, 2, "2 of 5 photos show neither what the cloud nor"),
    ],
    ids=["missing", "no picture", "cut off", "other sides", "smaller", "elsewhere"],
)
def test_a_set_with_something_wrong_ends_in_a_scene_and_a_word(
    field: Path,
    tmp_path: Path,
    change: Callable[[Path], object],
    left_out: int,
    word: str,
) -> None:
    photos = damaged(field, tmp_path, change, 1, 3)
    work = tmp_path / "work"
    shutil.copytree(field / ".scene.work", work)
    result = build(
        options_for(field, tmp_path / "scene", work=work, texture=Texturing(photos=photos))
    )
    assert validate_scene(tmp_path / "scene") == []
    counts = next(stage.facts.counts for stage in result.stages if stage.name == "texture")
    assert (counts["photos"], counts["photos_left_out"]) == (5 - left_out, left_out)
    assert any(word in text for text in result.warnings), result.warnings


def test_an_extent_takes_photos_that_show_nothing_of_it(tmp_path: Path) -> None:
    """A photo of the other end of the field is no fault of the photos."""
    write_field(tmp_path)
    aside = replace(field_views()[0], name="aside.png", position=np.array([300.0, 40.0, 0.0]))
    PIL.Image.fromarray(render_field(aside)).save(tmp_path / "photos" / "aside.png")
    write_colmap(tmp_path / "colmap", [*field_views(), aside], origin=ORIGIN)
    east, north = ORIGIN[:2]
    west = Extent(east - 12, north - 12, east - 1, north + 12)
    result = build(options_for(tmp_path, tmp_path / "scene", extent=west))
    assert validate_scene(tmp_path / "scene") == []
    assert not any("photos" in text for text in result.warnings)
    with Scene.open(tmp_path / "scene") as scene:
        offset = np.array(scene.manifest.origin) - ORIGIN
        meshes = list(payloads(scene))
    rng = np.random.default_rng(1)
    for mesh in meshes:
        points, level = shown(mesh, rng)
        assert points[:, 0].max() + offset[0] < 1.5
        truth = field_colour(points[:, 0] + offset[0], -points[:, 2] + offset[1])
        assert np.abs(level - truth).mean() < 4


def test_where_no_photo_shows_the_survey_its_own_colours_are_drawn(
    field: Path, tmp_path: Path
) -> None:
    photos = damaged(field, tmp_path, elsewhere, 0, 1, 2, 3, 4)
    result = build(options_for(field, tmp_path / "scene", texture=Texturing(photos=photos)))
    assert validate_scene(tmp_path / "scene") == []
    assert any("no photo is left" in text for text in result.warnings), result.warnings
    with Scene.open(tmp_path / "scene") as scene:
        mesh = next(payloads(scene))
    assert mesh.texture is not None
    assert np.ptp(decode_image(mesh.texture.data).astype(int)) <= 1  # a survey without colour


def test_where_no_photo_can_be_used_nothing_is_begun(field: Path, tmp_path: Path) -> None:
    photos = damaged(field, tmp_path, lambda path: path.write_bytes(b"no"), 0, 1, 2, 3, 4)
    with pytest.raises(
        PhotoError, match=r"none of the 5 photos can be used: photo .*p0.png cannot"
    ):
        build(options_for(field, tmp_path / "scene", texture=Texturing(photos=photos)))
    assert not (tmp_path / ".scene.work" / "read").exists()


def test_options_are_checked() -> None:
    for change, message in (
        ({"texel_m": 0.0}, "texel size"),
        ({"quality": 0}, "texture quality"),
        ({"kind": "gif"}, "texture format"),
        ({"source": "dreams"}, "expected photos, vertex or mesh"),
        ({"max_side": 4096}, "texture sides"),
        ({"base_side": 1000}, "texture sides"),
    ):
        with pytest.raises(OptionError, match=message):
            replace(texture.Options(), **change)
