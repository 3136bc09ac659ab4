"""The hand-drawn pieces: well-formed everywhere, dense and alike where the surveys are."""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.geometry.truth.pieces import PIECES, SHARED_DATA, Piece, load_survey


@pytest.mark.parametrize("name", PIECES)
def test_rings_are_closed_and_within_their_box(name):
    """Labels only, at a decimetre: nothing of the survey is in the file."""
    piece = Piece(name)
    first, second = piece.drawings
    assert first["box"] == second["box"]
    assert (first["survey"], second["pass"]) == (piece.survey, "b")
    west, south, east, north = first["box"]
    for drawing in piece.drawings:
        drawn = [feature["properties"]["region"] for feature in drawing["features"]]
        assert len(set(drawn) - {None}) >= 6
        for feature in drawing["features"]:
            ring = np.array(feature["geometry"]["coordinates"][0])
            assert (ring[0] == ring[-1]).all()
            assert ((ring >= (west, south)) & (ring <= (east, north))).all()


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["apaxco_pit", "brighton_park"])
def test_both_drawings_cover_the_piece_and_agree(name):
    piece = Piece(name)
    mesh = load_survey(piece.survey)
    if mesh is None:
        pytest.skip(f"{SHARED_DATA} does not hold {piece.survey}")
    ground, nearest = piece.nearest_faces(mesh)
    for drawn in piece.rasters[1]:
        assert (drawn[ground] >= 0).mean() >= 0.7
    assert max(score.rand_error for score in piece.human_scores(ground)) < 0.05
    one_region = piece.scores(np.zeros(len(mesh.faces), np.int32), ground, nearest)
    assert min(score.rand_error for score in one_region) > 0.5


def test_no_survey_no_mesh(tmp_path):
    """Absent data is told by None, so that tests and benchmarks can skip."""
    assert load_survey(Piece(PIECES[0]).survey, tmp_path) is None
