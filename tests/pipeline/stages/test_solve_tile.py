"""One tile: cleaned by what is usual in the whole, cut to its core, its walls described."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pipeline.two_tiles import ANCHOR_M, CELL_M, CORE, piece, task

from terraport_pipeline.geometry.clouds.detail_cell import detail_cell_m, smoothing_radius_m
from terraport_pipeline.geometry.clouds.support import BINS
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.tiles.solve_tile import TileTask, border_of, run, sample_type

WIDE = 88
"""Cells of the core in the tests that solve: a cube of 2^7 with room for the margin."""

NOTHING = np.zeros((0, 3), dtype=np.float32)
"""Above the tile."""


def wide_task() -> TileTask:
    return replace(
        task(0), centre_cells=(44.0, 44.0, 44.0), core_cells=WIDE, margin_cells=12.0, cell_m=0.1,
        spacing_m=0.2, usual=(float(np.log(0.1)), 0.5), raster_cell_m=0.2,
    )  # fmt: skip


def ground(count: int = 6000) -> np.ndarray:
    """Samples of a rolling ground over core and margin, with a copy and three outliers."""
    own = wide_task()
    rng = np.random.default_rng(0)
    half = 0.1 * (WIDE / 2 + 12)
    x, z = rng.uniform(-half, half, (2, count))
    y = 0.4 * np.sin(x) * np.cos(z / 1.5)
    samples = np.zeros(
        count + 4, sample_type([("grade", "<f4"), ("class", "<u1")], has_colour=True)
    )
    places = np.stack([x, y, z], axis=1)
    places = np.concatenate([places, [[0, 3, 0], [2, 3, 2], [-2, 3, -2]], places[:1]])
    east, up, south = (places + own.centre_m).T
    samples["position"] = np.stack([east, -south, up], axis=1) + np.array(own.origin)
    samples["colour"] = np.where(places[:, :1] > 0, (200, 60, 40), (60, 120, 50))
    samples["a0"] = places[:, 0]
    samples["a1"] = np.where(places[:, 2] > 0, 6, 2)
    return samples


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory):
    return run(wide_task(), ground(), NOTHING, Context(tmp_path_factory.mktemp("tile")))


def test_copies_and_outliers_go_and_what_lies_in_the_core_is_counted(solved) -> None:
    counts = solved.values
    assert (counts["samples"], counts["duplicates"], counts["outliers"]) == (6004, 1, 3)
    position = ground()["position"][:6000] - np.array(wide_task().origin)
    local = (
        np.stack([position[:, 0], position[:, 2], -position[:, 1]], axis=1) - wide_task().centre_m
    )
    assert counts["core"] == (np.abs(local) <= 0.1 * WIDE / 2).all(axis=1).sum()


def test_the_surface_fills_the_core_and_follows_the_ground(solved) -> None:
    vertices = solved.arrays["vertices"]
    half = 0.1 * WIDE / 2
    assert np.abs(vertices[:, [0, 2]]).max() == pytest.approx(half, abs=0.1)
    assert len(vertices) == counts_of(solved)["vertices"]
    true = 0.4 * np.sin(vertices[:, 0]) * np.cos(vertices[:, 2] / 1.5)
    assert np.percentile(np.abs(vertices[:, 1] - true), 95) < 0.05
    assert solved.arrays["ratio"].max() <= wide_task().kept_ratio
    assert solved.arrays["histogram"].sum() > 0


def counts_of(stored) -> dict[str, int]:
    return dict(stored.values)


def test_colours_and_attributes_come_from_the_samples(solved) -> None:
    x, _, z = solved.arrays["vertices"].T
    clear = np.abs(x) > 0.5
    assert (
        solved.arrays["colours"][clear]
        == np.where(x[clear, None] > 0, (200, 60, 40), (60, 120, 50))
    ).all()
    assert np.abs(solved.arrays["attribute-0"] - x).mean() < 0.1
    assert set(np.unique(solved.arrays["attribute-1"])) == {2.0, 6.0}
    assert (
        solved.arrays["attribute-1"][np.abs(z) > 0.5] == np.where(z[np.abs(z) > 0.5] > 0, 6, 2)
    ).all()


def test_the_raster_tells_where_samples_lie(solved) -> None:
    cells = solved.arrays["raster-cells"]
    own = wide_task()
    row, column = cells.T
    x = own.raster_low[0] + (row + 0.5) * own.raster_cell_m - own.centre_m[0]
    z = own.raster_low[1] + (column + 0.5) * own.raster_cell_m - own.centre_m[2]
    assert len(np.unique(cells, axis=0)) == len(cells) > 0.8 * (0.1 * WIDE / 0.2) ** 2
    assert np.abs([x, z]).max() < 0.1 * WIDE / 2 + 0.2
    assert (solved.arrays["raster-spacing"] > 0).all()


def test_a_tile_with_too_few_samples_has_no_surface(tmp_path) -> None:
    stored = run(wide_task(), ground()[:5], NOTHING, Context(tmp_path))
    assert len(stored.arrays["faces"]) == 0
    assert stored.arrays["histogram"].shape == (BINS,)
    assert stored.values["core"] == 0
    assert set(stored.arrays) >= {"attribute-0", "attribute-1", "border-edges"}


def test_samples_of_the_margin_alone_make_no_surface(tmp_path) -> None:
    own, samples = wide_task(), ground()
    west = samples["position"][:, 0] - own.origin[0] - own.centre_m[0]
    stored = run(own, samples[west < -0.1 * (WIDE / 2 + 8)], NOTHING, Context(tmp_path))
    assert stored.values["core"] == stored.values["faces"] == 0


NOISE_M = SPACING_M = 0.16


def noisy_ground() -> np.ndarray:
    """The rolling ground as one sample for each square of SPACING_M, with noise of one spacing."""
    rng = np.random.default_rng(1)
    x, z = rng.uniform(-8, 8, (2, int((16 / SPACING_M) ** 2)))
    places = np.stack([x, rolling(x, z), z], axis=1) + rng.normal(0, NOISE_M, (len(x), 3))
    samples = np.zeros(len(x), sample_type([], has_colour=False))
    samples["position"] = np.stack([places[:, 0], -places[:, 2], places[:, 1]], axis=1)
    return samples


def rolling(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(x) * np.cos(z / 1.5)


def noisy_task(cell_m: float, smoothing_m: float) -> TileTask:
    """A core of about 8 m in the middle of a cube of 2^7 cells."""
    core = 8 * round(1.0 / cell_m)
    return replace(
        wide_task(), cell_m=cell_m, core_cells=core, margin_cells=64 / 1.1 - core / 2,
        anchor_m=(0.0, 0.0, 0.0), centre_cells=(0.0, 0.0, 0.0), origin=(0.0, 0.0, 0.0), columns=(),
        attributes=(), codes=(), has_colour=False, spacing_m=SPACING_M,
        usual=(float(np.log(0.13)), 0.4), normal_neighbours=16, raster_low=(-20.0, -20.0),
        noise_m=NOISE_M, smoothing_m=smoothing_m,
    )  # fmt: skip


CELL_OF_NOISE_M = detail_cell_m(SPACING_M, NOISE_M)
SMOOTHING_M = smoothing_radius_m(SPACING_M, NOISE_M)


def test_a_noisy_cloud_comes_out_nearer_to_the_truth_with_fewer_faces(tmp_path) -> None:
    """Against cells of one spacing and samples as they are: half the error, half the faces."""
    figures = []
    for own in (noisy_task(SPACING_M, 0.0), noisy_task(CELL_OF_NOISE_M, SMOOTHING_M)):
        arrays = run(own, noisy_ground(), NOTHING, Context(tmp_path)).arrays
        x, y, z = arrays["vertices"].T
        inner = np.maximum(np.abs(x), np.abs(z)) < 3.5
        error_m = (y - rolling(x, z))[inner]
        faces = inner[arrays["faces"]].all(axis=1).sum()
        figures.append((float(np.sqrt((error_m**2).mean())), int(faces)))
    (before_m, many), (after_m, few) = figures
    assert after_m < 0.5 * before_m
    assert few < 0.55 * many


def test_two_tiles_of_a_noisy_cloud_meet_at_their_wall(tmp_path) -> None:
    """Their surfaces in the wall between them lie closer together than a tenth of a cell."""
    left = noisy_task(CELL_OF_NOISE_M, SMOOTHING_M)
    right = replace(left, centre_cells=(float(left.core_cells), 0.0, 0.0))
    curves = []
    for own, wall in ((left, 1), (right, 0)):
        arrays = run(own, noisy_ground(), NOTHING, Context(tmp_path)).arrays
        edges = arrays["border-edges"][arrays["border-walls"] == wall]
        rows = np.unique(edges)
        cells = arrays["border-cells"][rows]
        curves.append(cells[np.abs(cells[:, 2]) < left.core_cells / 2 - 4])
    assert len(curves[0]) > 15
    apart = [float(np.abs(curves[1][:, 1:] - cells[1:]).sum(axis=1).min()) for cells in curves[0]]
    assert np.percentile(apart, 90) < 0.1


def test_only_open_edges_along_walls_are_the_border() -> None:
    arrays = piece(0)
    border = border_of(task(0), arrays["vertices"], arrays["faces"], arrays["ratio"])
    # the sheet touches four walls: x low and high (0, 1), z low and high (4, 5)
    assert np.bincount(border.walls, minlength=6).tolist() == [CORE, CORE, 0, 0, CORE, CORE]
    assert len(border.rows) == 4 * CORE
    assert (np.diff(border.rows) > 0).all()
    places = border.cells[border.edges]
    for wall, at in ((0, 0), (1, CORE)):
        assert (places[border.walls == wall][..., 0] == at).all()
    metres = arrays["vertices"][border.rows] + task(0).centre_m
    assert border.cells == pytest.approx((metres - np.array(ANCHOR_M)) / CELL_M, abs=1e-5)


def test_what_almost_lies_in_a_wall_is_put_there() -> None:
    arrays = piece(0)
    shaken = arrays["vertices"] + np.random.default_rng(0).uniform(-4e-4, 4e-4, (81, 3)).astype(
        np.float32
    )
    border = border_of(task(0), shaken, arrays["faces"], arrays["ratio"])
    assert len(border.rows) == 4 * CORE
    on_high_x = np.unique(border.edges[border.walls == 1])
    assert (border.cells[on_high_x, 0] == CORE).all()


def test_a_wall_that_a_face_closes_is_no_border() -> None:
    arrays = piece(0)
    turned = np.concatenate([arrays["faces"], arrays["faces"][:, ::-1]])
    assert len(border_of(task(0), arrays["vertices"], turned, arrays["ratio"]).edges) == 0


def test_a_row_of_samples_says_what_it_holds() -> None:
    assert sample_type([("grade", "<f4")], has_colour=True).names == ("position", "colour", "a0")
    assert sample_type([], has_colour=False).itemsize == 24
