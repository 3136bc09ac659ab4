from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.mesh_facts import face_normals
from pipeline.one_piece import ReconstructedSurvey, reconstruct_survey, runner_in
from scipy.spatial import cKDTree

from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.cover.uncovered import uncovered_faces
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.model import Survey
from terraport_pipeline.options import reconstruct
from terraport_pipeline.stages import clean


@pytest.fixture(scope="module")
def survey() -> Survey:
    rng = np.random.default_rng(1)
    x, z = rng.uniform(-15, 15, (2, 6000))
    hole = np.hypot(x - 5, z - 5) < 4
    x, z = x[~hole], z[~hole]
    points = np.stack([x, z, 2 * np.sin(x / 5) + np.cos(z / 4)], axis=1)
    return Survey(
        points=points,
        colours=np.where((x > 0)[:, None], (250, 10, 10), (10, 10, 250)).astype(np.uint8),
        attributes={"grade": x.astype(np.float32), "code": (z > 0).astype(np.uint8)},
        crs=None,
        format="xyz",
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reconstruct")


@pytest.fixture(scope="module")
def result(survey: Survey, folder: Path) -> ReconstructedSurvey:
    return reconstruct_survey(
        runner_in(folder / "result"), survey, reconstruct.Options(base_faces=600)
    )


@pytest.fixture(scope="module")
def cleaned(result: ReconstructedSurvey) -> clean.Cleaned:
    return result.ground.cleaned.value()


@pytest.fixture(scope="module")
def solved_base(result: ReconstructedSurvey, survey: Survey, folder: Path) -> ReconstructedSurvey:
    options = reconstruct.Options(base_faces=600, base_from="poisson", base_depth=6)
    return reconstruct_survey(runner_in(folder / "solved_base"), survey, options)


@pytest.fixture(scope="module")
def ragged(folder: Path) -> ReconstructedSurvey:
    """A noisy survey with 40 bays and tongues, and a base whose edges are longer than these."""
    rng = np.random.default_rng(1)
    x, z = rng.uniform(-15, 15, (2, 40_000))
    inside = np.hypot(x, z) < 11 + 3 * np.sin(40 * np.arctan2(z, x))
    x, z = x[inside], z[inside]
    height = 2 * np.sin(x / 5) + np.cos(z / 4) + 0.1 * rng.standard_normal(len(x))
    grey = np.zeros((len(x), 3), np.uint8)
    survey = Survey(np.stack([x, z, height], axis=1), grey, {}, crs=None, format="xyz")
    options = reconstruct.Options(base_faces=100)
    return reconstruct_survey(runner_in(folder / "ragged"), survey, options)


def test_detail_passes_through_the_samples(
    cleaned: clean.Cleaned, result: ReconstructedSurvey
) -> None:
    mesh = result.detail
    inside = np.abs(cleaned.cloud.points[:, ::2]).max(axis=1) < 14
    distance_m = distances_to_mesh(cleaned.cloud.points[inside], mesh.vertices, mesh.faces)
    assert np.percentile(distance_m, 95) < 0.1 * cleaned.cloud.spacing_m


def test_detail_ends_where_samples_end(cleaned: clean.Cleaned, result: ReconstructedSurvey) -> None:
    distance_m, _ = cKDTree(cleaned.cloud.points).query(result.detail.vertices)
    assert distance_m.max() <= 4.0 * 3.0 * cleaned.cloud.spacing_m
    centre = result.detail.vertices[result.detail.faces].mean(axis=1)
    middle_of_hole = np.hypot(centre[:, 0] - 5, centre[:, 2] + 5) < 1.0
    assert not middle_of_hole.any()


def test_faces_look_up(result: ReconstructedSurvey) -> None:
    for mesh in (result.base, result.detail):
        normals, areas_m2 = face_normals(mesh.vertices, mesh.faces)
        # By area: thinning may leave slivers on the base's border that stand on edge.
        assert areas_m2[normals[:, 1] >= 0].sum() > 0.999 * areas_m2.sum()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


def test_the_base_lies_under_all_of_the_detail(
    result: ReconstructedSurvey, solved_base: ReconstructedSurvey, ragged: ReconstructedSurvey
) -> None:
    assert ragged.facts.counts["base_faces_patched"] > 0
    for reconstructed in (result, solved_base, ragged):
        base, detail = reconstructed.base, reconstructed.detail
        bare = uncovered_faces(detail.vertices, detail.faces, base.vertices, base.faces)
        assert not bare.any()


def test_the_base_keeps_its_budget(
    result: ReconstructedSurvey, solved_base: ReconstructedSurvey
) -> None:
    for reconstructed in (result, solved_base):
        assert 400 < len(reconstructed.base.faces) <= 660


def test_a_base_from_the_detail_is_nearer_to_it(survey: Survey, folder: Path) -> None:
    runner = runner_in(folder / "nearer")
    thinned, solved = (
        reconstruct_survey(runner, survey, reconstruct.Options(base_faces=2500, base_from=source))
        for source in ("detail", "poisson")
    )
    assert len(thinned.detail.faces) == len(solved.detail.faces)
    assert thinned.deviation_m[2] < solved.deviation_m[2]


def test_colours_attributes_and_codes_are_carried(result: ReconstructedSurvey) -> None:
    for mesh in (result.base, result.detail):
        x, z = mesh.vertices[:, 0], mesh.vertices[:, 2]
        clear = (np.abs(x) > 1) & (np.abs(x) < 14) & (np.abs(z) < 14)
        assert ((mesh.colours[:, 0] > 128) == (x > 0))[clear].all()
        assert np.abs(mesh.attributes["grade"] - x)[clear & (np.hypot(x - 5, z + 5) > 5)].max() < 1
        assert np.isin(mesh.attributes["code"], (0.0, 1.0)).all()


def test_cells_follow_the_density_and_nobody_is_warned(
    cleaned: clean.Cleaned, result: ReconstructedSurvey
) -> None:
    assert result.facts.counts["cell_m"] == pytest.approx(1.2 * cleaned.cloud.spacing_m, rel=0.1)
    assert not result.facts.warnings
    assert not result.facts.choices


def test_who_asks_for_more_than_the_density_supports_is_told(
    result: ReconstructedSurvey, survey: Survey, folder: Path
) -> None:
    options = reconstruct.Options(
        base_faces=600, base_from="poisson", detail_depth=13, base_depth=9
    )
    facts = reconstruct_survey(runner_in(folder / "deeper"), survey, options).facts
    choices = " ".join(facts.choices)
    assert not facts.warnings
    assert facts.counts["cell_m"] == result.facts.counts["cell_m"]
    assert "(--detail-depth 13): the samples stand" in choices
    assert f"base depth {facts.counts['base_depth']} instead of 9" in choices


def test_the_deviation_is_measured(result: ReconstructedSurvey) -> None:
    base, detail = result.base, result.detail
    distance_m = distances_to_mesh(detail.vertices, base.vertices, base.faces)
    assert result.deviation_m == tuple(np.percentile(distance_m, (50, 95, 99, 99.9)).tolist())
    assert list(result.deviation_m) == sorted(result.deviation_m)


def test_the_result_does_not_depend_on_threads(
    survey: Survey, result: ReconstructedSurvey, folder: Path
) -> None:
    options = reconstruct.Options(base_faces=600)
    runner = runner_in(folder / "threads", threads=2)
    second = reconstruct_survey(runner, survey, options)
    assert second.reconstructed.surface.digest == result.reconstructed.surface.digest


def test_what_is_kept_is_taken_up(
    survey: Survey, result: ReconstructedSurvey, folder: Path
) -> None:
    runner = runner_in(folder / "result")
    again = reconstruct_survey(runner, survey, reconstruct.Options(base_faces=600))
    assert all(report.taken_up for report in runner.reports)
    assert (again.detail.vertices == result.detail.vertices).all()
    assert list(again.base.attributes) == ["grade", "code"]
    assert again.deviation_m == result.deviation_m


def test_too_little_memory_for_one_piece_is_said_before_it_is_solved(
    survey: Survey, folder: Path
) -> None:
    runner = runner_in(folder / "little", max_memory_bytes=2**28)
    with pytest.raises(ResourceError, match=r"a test needs the surface in one piece, about [0-9.]"):
        reconstruct_survey(runner, survey, reconstruct.Options())
    assert not list(runner.work.path.glob("solve-*"))


def test_nothing_stays_beside_the_results(result: ReconstructedSurvey, folder: Path) -> None:
    assert not list((folder / "result" / "work").glob(".*.tmp"))


@pytest.mark.parametrize(
    "options",
    [
        {"base_from": "nothing"},
        {"base_depth": 2},
        {"detail_depth": 17},
        {"base_faces": 5},
        {"trim_spacings": 0.5},
        {"island_faces": 0},
        {"point_weight": -1.0},
    ],
)
def test_options_out_of_range(options: dict[str, float | str]) -> None:
    with pytest.raises(OptionError, match="expected"):
        reconstruct.Options(**options)  # type: ignore[arg-type]
