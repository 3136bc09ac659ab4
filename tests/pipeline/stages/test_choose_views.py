from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from photo_scene import BLOCK, CRATE_M, EXPOSURES, PhotoScene, crate_place, paint, photo_scene

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET, neutral_gains
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.stages.choose_views import Options, choose_views
from terraport_pipeline.stages.view_gains import view_gains


@cache
def scene(*, crate: bool = True) -> PhotoScene:
    return photo_scene(crate=crate)


@cache
def rays() -> RayScene:
    return RayScene(scene().mesh.vertices, scene().mesh.faces, threads=1)


def choose(
    site: PhotoScene, options: Options | None = None, *, gained: bool = True, **more: object
) -> ViewChoice:
    mesh = site.mesh
    gains = neutral_gains(len(site.views))
    if gained:
        gains = view_gains(mesh, site.views, site, rays())
    return choose_views(
        mesh.vertices, mesh.faces, mesh.normals, mesh.colours, site.views, site, rays(), gains,
        options, **more,  # type: ignore[arg-type]
    )  # fmt: skip


def hidden(site: PhotoScene, number: int) -> np.ndarray:
    """Faces that something hides from a camera, asked from the camera; not those at a rim."""
    view, normals = site.views[number], site.mesh.normals[site.mesh.faces].mean(axis=1)
    out_of_sight = np.ones(len(normals), bool)
    for lift_m in (0.0, 0.2):
        towards = site.centres + lift_m * normals - view.position
        distance, face = rays().closest_hit(np.broadcast_to(view.position, towards.shape), towards)
        out_of_sight &= (distance < 0.98) & (face != np.arange(len(towards)))
    return out_of_sight


def coloured(site: PhotoScene, choice: ViewChoice) -> np.ndarray:
    """Levels at the faces' middles as the module view_choice says."""
    mesh = site.mesh
    levels = mesh.colours[mesh.faces].mean(axis=1, dtype=np.float64)

    def seen(view: np.ndarray) -> np.ndarray:
        adjusted = levels.copy()
        for number, camera in enumerate(site.views):
            rows = np.flatnonzero(view == number)
            pixels, _ = camera.project(site.centres[rows])
            gain = choice.gains[number].astype(np.float64)
            size = np.array([camera.lens.width, camera.lens.height])
            square = 4.0 * ((pixels - size / 2) ** 2).sum(axis=1) / (size**2).sum()
            h = gain[:3] * (1.0 + square * (gain[3] + square * gain[4]))[:, None]
            photo = site.get(number)
            column, row = np.floor(pixels).astype(int).T
            adjusted[rows] = (photo[row, column] + SRGB_OFFSET) * h - SRGB_OFFSET
        return adjusted

    weight = choice.blend_weight.mean(axis=1)[:, None]
    mixed = (1 - weight) * seen(choice.view) + weight * seen(choice.blend_view)
    return np.where(weight > 0, mixed, seen(choice.view)) + choice.correction.astype(
        np.float64
    ).mean(axis=1)


def test_a_face_gets_the_photo_that_shows_it_largest() -> None:
    site = scene(crate=False)
    options = Options(smoothness=0.0, reject_outliers=False, level_seams=False)
    choice = choose(site, options, gained=False)
    # flat ground far from the block, seen by two cameras or more
    near_first = np.linalg.norm(site.centres[:, [0, 2]] - (13.0, 15.0), axis=1) < 1.5
    near_last = np.linalg.norm(site.centres[:, [0, 2]] - (27.0, 25.0), axis=1) < 1.5
    assert (choice.view[near_first] >= 0).all()
    assert (choice.view[near_last] >= 0).all()
    # what it got is as large as in any other photo that may be used
    area = np.stack([projected_area(site, number) for number in range(len(site.views))])
    usable = np.stack([~hidden(site, number) for number in range(len(site.views))])
    best = np.where(usable, area, 0.0).max(axis=0)
    rows = np.flatnonzero(near_first | near_last)
    assert (area[choice.view[rows], rows] > 0.6 * best[rows]).all()


def projected_area(site: PhotoScene, number: int) -> np.ndarray:
    view, mesh = site.views[number], site.mesh
    pixels, _ = view.project(mesh.vertices.astype(np.float64))
    corners = pixels[mesh.faces]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (b[:, 0] * a[:, 1] - a[:, 0] * b[:, 1])
    size = np.array([view.lens.width, view.lens.height])
    inside = ((corners >= 2) & (corners <= size - 2)).all(axis=(1, 2))
    return np.where(inside, area, 0.0)


@pytest.mark.parametrize("smoothness", [0.0, 1.0, 30.0])
def test_hidden_faces_are_never_coloured_by_what_hides_them(smoothness: float) -> None:
    site = scene()
    choice = choose(site, Options(smoothness=smoothness))
    behind = 0
    for number in range(len(site.views)):
        out_of_sight = hidden(site, number)
        behind += int(out_of_sight.sum())
        assert not (choice.view[out_of_sight] == number).any()
        assert not (choice.blend_view[out_of_sight] == number).any()
    assert behind > 500  # the block does hide something


def test_a_crate_that_stands_elsewhere_in_every_photo_is_voted_out() -> None:
    site = scene()
    kept, rejected = (choose(site, Options(reject_outliers=on)) for on in (False, True))
    wrong = []
    for choice in (kept, rejected):
        shown = np.zeros(len(site.centres), bool)
        for number in range(len(site.views)):
            x, z = crate_place(number)
            off = np.abs(site.centres[:, [0, 2]] - (x, z)).max(axis=1)
            shown |= (off < 0.5 * CRATE_M - 0.4) & (choice.view == number)
        wrong.append(int(shown.sum()))
    assert wrong[0] > 50
    assert wrong[1] == 0
    assert rejected.facts["outliers"] > 0


def test_gains_and_levelling_bring_the_colours_near_the_truth() -> None:
    site = scene()
    truth = paint(site.centres)
    seen = choose(site).view >= 0
    x, z = site.centres[:, 0], site.centres[:, 2]
    seen &= ~((x > BLOCK[0] - 1) & (x < BLOCK[1] + 1) & (z > BLOCK[2] - 1) & (z < BLOCK[3] + 1))
    error = []
    for options, gained in (
        (Options(level_seams=False, reject_outliers=False), False),
        (Options(level_seams=False), True),
        (Options(), True),
    ):
        choice = choose(site, options, gained=gained)
        error.append(np.abs(coloured(site, choice) - truth)[seen].mean())
    assert error[0] > 6.0
    assert error[1] < 4.0
    assert error[2] < error[1] + 0.3


def test_each_step_lowers_the_seams() -> None:
    facts = choose(scene()).facts
    photos, gains, smooth, local = (
        facts[f"seam_step_{name}"] for name in ("photos", "gains", "smooth", "local")
    )
    assert photos > 2 * gains
    assert smooth < 1.1 * gains
    assert local < 0.5 * gains


def test_the_result_is_the_same_with_two_threads() -> None:
    one_thread, two_threads = (choose(scene(), threads=threads) for threads in (1, 2))
    for name in ("view", "blend_view", "blend_weight", "correction", "gains"):
        assert getattr(one_thread, name).tobytes() == getattr(two_threads, name).tobytes()
    assert one_thread.facts == two_threads.facts


def test_inputs_may_be_read_only() -> None:
    site = scene()
    mesh = site.mesh
    before = mesh.faces.copy()
    for array in (mesh.vertices, mesh.faces, mesh.colours):
        array.setflags(write=False)
    choose(site)
    assert (mesh.faces == before).all()


def test_the_order_of_faces_does_not_matter() -> None:
    site = scene()
    mesh = site.mesh
    turned = mesh.faces[::-1].copy()
    gains = view_gains(mesh, site.views, site, rays())
    options = Options(smoothness=0.0, level_seams=False, reject_outliers=False)
    forwards, backwards = (
        choose_views(
            mesh.vertices, faces, mesh.normals, mesh.colours, site.views, site, rays(), gains,
            options,
        )
        for faces in (mesh.faces, turned)
    )  # fmt: skip
    assert (forwards.view == backwards.view[::-1]).all()


def test_with_no_view_everything_keeps_its_vertex_colours() -> None:
    site = PhotoScene(scene().mesh, [], [])
    choice = choose(site)
    assert (choice.view == -1).all()
    assert (choice.blend_view == -1).all()
    assert not choice.correction.any()


def test_one_view_colours_what_it_sees() -> None:
    site = PhotoScene(scene().mesh, scene().views[:1], scene().photos[:1])
    choice = choose(site)
    assert set(np.unique(choice.view)) == {-1, 0}
    assert not (choice.view[hidden(site, 0)] == 0).any()
    # at the border of what it sees the vertex colours meet it
    assert choice.facts["seam_step_local"] < choice.facts["seam_step_photos"]


def test_a_photo_that_sees_nothing_is_not_even_read() -> None:
    site = scene()
    blind = site.views[0]
    away = type(blind)(blind.name, blind.lens, -blind.rotation * [[1], [-1], [1]], blind.position)

    class Store:
        def get(self, view_index: int, scale: int = 1) -> np.ndarray:
            assert view_index != 6
            return site.get(view_index, scale)

    mesh = site.mesh
    choice = choose_views(
        mesh.vertices, mesh.faces, mesh.normals, mesh.colours, [*site.views, away], Store(),
        rays(), neutral_gains(7),
    )  # fmt: skip
    assert choice.facts["views_blank"] == 1
    assert not (choice.view == 6).any()


def test_an_empty_mesh() -> None:
    site = scene()
    none = np.zeros((0, 3))
    choice = choose_views(
        none.astype(np.float32), none.astype(np.int32), none.astype(np.float32),
        none.astype(np.uint8), site.views, site, rays(), neutral_gains(6),
    )  # fmt: skip
    assert choice.view.shape == (0,)
    assert choice.correction.shape == (0, 3, 3)


def test_gains_of_another_length_are_refused() -> None:
    site = scene()
    mesh = site.mesh
    with pytest.raises(ValueError, match="3 rows of gains for 6 views, expected one more"):
        choose_views(
            mesh.vertices, mesh.faces, mesh.normals, mesh.colours, site.views, site, rays(),
            neutral_gains(2),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"max_angle_degrees": 90.0}, "max angle 90.0 degrees"),
        ({"smoothness": -1.0}, "smoothness -1.0"),
        ({"smoothness": float("nan")}, "smoothness nan"),
        ({"blend_rings": 0}, "blend rings 0"),
        ({"occluder_offset_m": -0.1}, "occluder offset -0.1 m"),
    ],
)
def test_options_are_checked(wrong: dict[str, float], text: str) -> None:
    with pytest.raises(OptionError, match=text):
        Options(**wrong)  # type: ignore[arg-type]


def test_exposures_differ_in_the_scene() -> None:
    assert max(EXPOSURES) / min(EXPOSURES) > 1.5


def test_a_noisy_surface_has_few_charts_and_still_its_colours() -> None:
    """Ground so rough that each face hides from some of the cameras."""
    site = scene(crate=False)
    rng = np.random.default_rng(5)
    vertices = site.mesh.vertices.copy()
    vertices[:, 1] += rng.normal(0.0, 0.6, len(vertices)).astype(np.float32)
    levels = np.rint(paint(vertices.astype(np.float64))).astype(np.uint8)
    mesh = replace(site.mesh, vertices=vertices, colours=levels)
    noisy = RayScene(vertices, mesh.faces, threads=1)
    pairs, _ = face_pairs(mesh.faces, len(vertices))

    few = choose_views(
        vertices, mesh.faces, mesh.normals, levels, site.views, site, noisy,
        neutral_gains(len(site.views)),
    )  # fmt: skip
    assert components(len(mesh.faces), pairs, labels=few.view + 1)[1] <= 150
    assert 0 < few.facts["faces_borrowed"] < 0.5 * len(mesh.faces)
    assert np.isfinite(few.correction.astype(float)).all()
    assert np.abs(few.correction.astype(float)).max() <= 64.0
    shown = coloured(replace(site, mesh=mesh), few)
    truth = paint(vertices[mesh.faces].mean(axis=1, dtype=np.float64))
    assert np.median(np.abs(shown - truth)) < 15.0
