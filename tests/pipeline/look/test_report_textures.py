"""Photos beside the scene: the right views, the right part, the right words."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines.cameras import PhotoCamera
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.textures import (
    VertexColours,
    chosen_views,
    close_up,
    find_vertex_colours,
    photo_pictures,
    photo_rows,
    texture_rows,
)
from terraport_store import Scene, TextureInfo

LENS = Lens(width=800, height=600, fx=600.0, fy=600.0, cx=400.0, cy=300.0, radial=(-0.05,))
DOWN = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])


def tilted(degrees: float) -> np.ndarray:
    turn = np.radians(degrees)
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ DOWN


VIEWS = (
    View("edge.jpg", LENS, DOWN, np.array([95.0, 60.0, 50.0])),
    View("middle.jpg", LENS, DOWN, np.array([50.0, 60.0, 52.0])),
    View("oblique.jpg", LENS, tilted(-45.0), np.array([50.0, 50.0, 95.0])),
    View("away.jpg", LENS, DOWN, np.array([900.0, 60.0, 50.0])),
)


@pytest.fixture(scope="module")
def loaded(scene_path):
    with Scene.open(scene_path) as scene:
        model = load_scene_model(scene)
    return model, RayScene(model.detail.vertices, model.detail.faces)


class Photos:
    """Draws what it is asked for."""

    def __init__(self, model, rays) -> None:
        self.model, self.rays = model, rays

    def get(self, index: int, scale: int = 1):
        detail = self.model.detail
        return render_mesh(
            detail.vertices, detail.faces, PhotoCamera(VIEWS[index]), (800, 600),
            colours=detail.colours, relief=0.0, shadows=False, scene=self.rays,
        )  # fmt: skip


def test_a_view_from_above_in_the_middle_and_an_oblique_one(loaded) -> None:
    assert chosen_views(VIEWS, loaded[1]) == [(1, "from above"), (2, "oblique")]
    assert chosen_views(VIEWS[:1], loaded[1]) == [(0, "from above")]


def test_photo_and_scene_stand_side_by_side_at_the_same_places(loaded) -> None:
    model, rays = loaded
    photos = OpenPhotos(VIEWS, Photos(model, rays), ())
    plain = VertexColours(model.detail.vertices, model.detail.faces, model.detail.colours)
    pictures = list(photo_pictures(model, rays, photos, plain, PictureOptions(supersample=1)))
    keys = ["photo-from-above", "close-from-above", "photo-oblique", "close-oblique"]
    assert [picture.key for picture in pictures] == keys
    assert "vertex colours" in pictures[0].caption
    image = np.asarray(Image.open(io.BytesIO(pictures[0].jpeg))).astype(int)
    assert image.shape == (480, 3 * 640 + 16, 3)
    # The photo was drawn from the scene: all three panels are one.
    for left in (648, 1296):
        assert np.abs(image[:, :640] - image[:, left : left + 640]).mean() < 3
    two = list(photo_pictures(model, rays, photos, None, PictureOptions(supersample=1)))
    assert two[1].width == 2 * 560 + 8
    assert "no vertex colours to compare" in two[0].caption


def test_a_close_up_shows_nothing_but_the_scene_where_it_can(loaded) -> None:
    photo = np.zeros((600, 800, 3), np.uint8)
    photo[::2] = 255  # contrast everywhere
    rows, columns = close_up(photo, VIEWS[2], loaded[1])
    assert rows.stop - rows.start == 420
    corners = [[columns.start + 20, rows.start + 20], [columns.stop - 20, rows.start + 20]]
    headings = VIEWS[2].rays(np.array(corners, dtype=float))
    starts = np.broadcast_to(VIEWS[2].position, headings.shape)
    assert (loaded[1].closest_hit(starts, headings)[1] >= 0).all()


def test_rows_tell_density_and_seams(loaded) -> None:
    manifest = loaded[0].manifest
    assert texture_rows(manifest, {}) == ()
    info = TextureInfo(
        source="photos", media_types=("image/jpeg",), segments=64, base_side=2048, max_side=1024,
        image_bytes=5_000_000, texels=30_000_000, texel_m=0.031, gsd_m=0.029,
    )  # fmt: skip
    counts = {"unseen_share": 0.013, "choice_seam_step_photos": 13.8, "choice_seam_step_local": 2}
    record = {"stages": [{"name": "read"}, {"name": "texture", "counts": counts}]}
    manifest = manifest.model_copy(update={"textures": info})
    values = {row["label"]: row["value"] for row in texture_rows(manifest, record)}
    assert values["texel"] == "3.1 cm (median over the surface)"
    assert values["ground sampling distance"] == "2.9 cm (median)"
    assert values["surface that no photo sees"] == "1.30%, filled from vertex colours"
    assert values["step at seams, as published"] == "2.0 grey levels"
    assert "atlas used by charts" not in values  # nobody counted it


def test_photos_are_told_by_what_they_serve() -> None:
    shares = [[f"p{number}.jpg", 0.02] for number in range(40)] + [["u.jpg", 0.0], ["v.jpg", 0.0]]
    rows = photo_rows({"stages": [{"name": "texture", "photo_ground_shares": shares}]})
    assert [(row["photo"], row["share"]) for row in rows][::15] == [
        ("p0.jpg", "2.0%"), ("p15.jpg", "2.0%"), ("10 more", "20.0%"),
    ]  # fmt: skip
    assert rows[-1] == {"photo": "2 not used", "share": "0"}
    assert photo_rows({}) == ()
    assert photo_rows({"stages": [{"name": "texture", "photo_ground_shares": [3]}]}) == ()


def test_vertex_colours_come_from_the_work_directory_if_they_fit(scene_path, loaded, tmp_path):
    detail = loaded[0].detail
    folder = tmp_path / "tile-00000"
    with Scene.open(scene_path) as scene:
        assert find_vertex_colours(scene, tmp_path) is None
        folder.mkdir()
        for name in ("vertices", "faces", "colours"):
            np.save(folder / f"{name}.npy", getattr(detail, name))
        vertex_colours = find_vertex_colours(scene, tmp_path)
        assert vertex_colours is not None
        np.testing.assert_array_equal(vertex_colours.colours, detail.colours)
        np.save(folder / "faces.npy", detail.faces[1:])
        assert find_vertex_colours(scene, tmp_path) is None


def test_vertex_colours_of_several_tiles_are_put_together(scene_path, loaded, tmp_path):
    detail = loaded[0].detail
    half = len(detail.faces) // 2
    tiles = (("tile-00000", detail.faces[:half]), ("tile-00001", detail.faces[half:]))
    for name, faces in tiles:
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "vertices.npy", detail.vertices)
        np.save(tmp_path / name / "colours.npy", detail.colours)
        np.save(tmp_path / name / "faces.npy", faces)
    with Scene.open(scene_path) as scene:
        vertex_colours = find_vertex_colours(scene, tmp_path)
        assert vertex_colours is not None
        np.testing.assert_array_equal(
            vertex_colours.colours[vertex_colours.faces], detail.colours[detail.faces]
        )
        (tmp_path / "tile-00001" / "faces.npy").unlink()
        assert find_vertex_colours(scene, tmp_path) is None
