from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.textures.cell_colours import CellColours, ColourField


def sheet() -> tuple[np.ndarray, np.ndarray]:
    """40 x 40 places a quarter of a metre apart; red grows with x, green is noise about 100."""
    x, z = np.meshgrid(np.arange(40) * 0.25 + 0.1, np.arange(40) * 0.25 + 0.1)
    places = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1).astype(np.float32)
    noise = np.where((np.arange(1600) // 40 + np.arange(1600)) % 2, 150, 50)
    colours = np.stack([20 * places[:, 0], noise, 0 * noise], axis=1).astype(np.uint8)
    return places, colours


def test_pieces_add_up_to_the_whole() -> None:
    places, colours = sheet()
    whole = CellColours.of(places, colours, 1.0)
    halves = [
        CellColours.of(places[half], colours[half], 1.0)
        for half in (slice(0, 700), slice(700, None))
    ]
    joined = CellColours.joined(halves)
    assert joined.key.tolist() == whole.key.tolist()
    np.testing.assert_allclose(joined.total, whole.total)
    assert whole.total[:, 6].sum() == len(places)


def test_noise_finer_than_a_cell_is_gone_and_what_is_wider_stays() -> None:
    places, colours = sheet()
    field = ColourField(CellColours.of(places, colours, 1.0))
    found = field(np.array([[2.5, 0.0, 5.0], [7.5, 0.3, 5.0]])).astype(int)
    assert np.abs(found[:, 1] - 100).max() <= 2
    assert np.abs(found[:, 0] - [50, 150]).max() <= 10  # half a cell


def test_cells_below_the_origin_and_far_away_are_cells_of_their_own() -> None:
    places = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], [9e5, 0.0, -9e5]], np.float32)
    cells = CellColours.of(places, np.eye(3, dtype=np.uint8), 1.0)
    assert len(cells.key) == 3


def test_threads_change_nothing() -> None:
    places, colours = sheet()
    cells = CellColours.of(places, colours, 0.5)
    asked = np.random.default_rng(1).uniform(0, 10, (500, 3))
    assert (ColourField(cells)(asked) == ColourField(cells, threads=2)(asked)).all()
