from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.cover.uncovered import uncovered_faces
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.mesh.vertex_normals import face_normals
from terraport_pipeline.model import Survey
from terraport_pipeline.stages import clean, reconstruct
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.reconstruct import Reconstructed

Hill = Callable[..., Survey]


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch")


@pytest.fixture(scope="module")
def cleaned(scratch: Path) -> clean.Cleaned:
    rng = np.random.default_rng(1)
    x, z = rng.uniform(-15, 15, (2, 6000))
    hole = np.hypot(x - 5, z - 5) < 4
    x, z = x[~hole], z[~hole]
    points = np.stack([x, z, 2 * np.sin(x / 5) + np.cos(z / 4)], axis=1)
    survey = Survey(
        points=points,
        colours=np.where((x > 0)[:, None], (250, 10, 10), (10, 10, 250)).astype(np.uint8),
        attributes={"grade": x.astype(np.float32), "code": (z > 0).astype(np.uint8)},
        crs=None,
        format="xyz",
    )
    return clean.run(survey, clean.Options(), Context(scratch))


@pytest.fixture(scope="module")
def result(cleaned: clean.Cleaned, scratch: Path) -> Reconstructed:
    return reconstruct.run(cleaned, reconstruct.Options(base_faces=600), Context(scratch))


@pytest.fixture(scope="module")
def solved_base(cleaned: clean.Cleaned, scratch: Path) -> Reconstructed:
    options = reconstruct.Options(base_faces=600, base_from="poisson")
    return reconstruct.run(cleaned, options, Context(scratch))


@pytest.fixture(scope="module")
def ragged(scratch: Path) -> Reconstructed:
    """A noisy survey with 40 bays and tongues, and a base whose edges are longer than these."""
    rng = np.random.default_rng(1)
    x, z = rng.uniform(-15, 15, (2, 40_000))
    inside = np.hypot(x, z) < 11 + 3 * np.sin(40 * np.arctan2(z, x))
    x, z = x[inside], z[inside]
    height = 2 * np.sin(x / 5) + np.cos(z / 4) + 0.1 * rng.standard_normal(len(x))
    grey = np.zeros((len(x), 3), np.uint8)
    survey = Survey(np.stack([x, z, height], axis=1), grey, {}, crs=None, format="xyz")
    cleaned = clean.run(survey, clean.Options(), Context(scratch))
    return reconstruct.run(cleaned, reconstruct.Options(base_faces=100), Context(scratch))


def test_detail_passes_through_the_samples(cleaned: clean.Cleaned, result: Reconstructed) -> None:
    mesh = result.detail
    inside = np.abs(cleaned.cloud.points[:, ::2]).max(axis=1) < 14
    distance_m = distances_to_mesh(cleaned.cloud.points[inside], mesh.vertices, mesh.faces)
    assert np.percentile(distance_m, 95) < 0.1 * cleaned.cloud.spacing_m


def test_detail_ends_where_samples_end(cleaned: clean.Cleaned, result: Reconstructed) -> None:
    distance_m, _ = cKDTree(cleaned.cloud.points).query(result.detail.vertices)
    assert distance_m.max() <= 4.0 * 3.0 * cleaned.cloud.spacing_m
    centre = result.detail.vertices[result.detail.faces].mean(axis=1)
    middle_of_hole = np.hypot(centre[:, 0] - 5, centre[:, 2] + 5) < 1.0
    assert not middle_of_hole.any()


def test_faces_look_up(result: Reconstructed) -> None:
    for mesh in (result.base, result.detail):
        normals, areas_m2 = face_normals(mesh.vertices, mesh.faces)
        # By area: thinning may leave slivers on the base's border that stand on edge.
        assert areas_m2[normals[:, 1] >= 0].sum() > 0.999 * areas_m2.sum()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


def test_the_base_lies_under_all_of_the_detail(
    result: Reconstructed, solved_base: Reconstructed, ragged: Reconstructed
) -> None:
    assert ragged.facts.counts["base_faces_patched"] > 0
    for reconstructed in (result, solved_base, ragged):
        base, detail = reconstructed.base, reconstructed.detail
        bare = uncovered_faces(detail.vertices, detail.faces, base.vertices, base.faces)
        assert not bare.any()


def test_the_base_keeps_its_budget(result: Reconstructed, solved_base: Reconstructed) -> None:
    assert solved_base.facts.counts["base_faces_trimmed"] > 600
    for reconstructed in (result, solved_base):
        assert 400 < len(reconstructed.base.faces) <= 660


def test_a_base_from_the_detail_is_nearer_to_it(cleaned: clean.Cleaned, scratch: Path) -> None:
    thinned, solved = (
        reconstruct.run(
            cleaned, reconstruct.Options(base_faces=2500, base_from=source), Context(scratch)
        )
        for source in ("detail", "poisson")
    )
    assert len(thinned.detail.faces) == len(solved.detail.faces)
    assert thinned.deviation_m[2] < solved.deviation_m[2]


def test_edges_are_cleaner_than_whole_faces_leave_them(result: Reconstructed) -> None:
    counts = result.facts.counts
    assert counts["outside_footprint_m2_after"] < 0.05 * counts["outside_footprint_m2_before"]
    assert counts["border_reach_p95_after"] < counts["border_reach_p95_before"]
    assert counts["border_teeth_p50_after"] < 0.5 * counts["border_teeth_p50_before"]


def test_colours_attributes_and_codes_are_carried(result: Reconstructed) -> None:
    for mesh in (result.base, result.detail):
        x, z = mesh.vertices[:, 0], mesh.vertices[:, 2]
        clear = (np.abs(x) > 1) & (np.abs(x) < 14) & (np.abs(z) < 14)
        assert ((mesh.colours[:, 0] > 128) == (x > 0))[clear].all()
        assert np.abs(mesh.attributes["grade"] - x)[clear & (np.hypot(x - 5, z + 5) > 5)].max() < 1
        assert np.isin(mesh.attributes["code"], (0.0, 1.0)).all()


def test_the_depths_follow_the_density_and_nobody_is_warned(
    cleaned: clean.Cleaned, solved_base: Reconstructed
) -> None:
    counts = solved_base.facts.counts
    assert counts["detail_depth"] < 13
    assert counts["base_depth"] == counts["detail_depth"] - 1
    assert counts["cell_m"] == pytest.approx(cleaned.cloud.spacing_m, rel=0.5)
    assert not solved_base.facts.warnings


def test_who_asks_for_more_than_the_density_supports_is_told(
    cleaned: clean.Cleaned, scratch: Path
) -> None:
    options = reconstruct.Options(
        base_faces=600, base_from="poisson", detail_depth=13, base_depth=9
    )
    facts = reconstruct.run(cleaned, options, Context(scratch)).facts
    warnings = " ".join(facts.warnings)
    assert f"detail depth {facts.counts['detail_depth']} instead of 13" in warnings
    assert f"base depth {facts.counts['base_depth']} instead of 9" in warnings


def test_the_deviation_is_measured(result: Reconstructed) -> None:
    base, detail = result.base, result.detail
    distance_m = distances_to_mesh(detail.vertices, base.vertices, base.faces)
    assert result.deviation_m == tuple(np.percentile(distance_m, (50, 95, 99, 99.9)).tolist())
    assert list(result.deviation_m) == sorted(result.deviation_m)


def test_the_result_does_not_depend_on_threads(
    cleaned: clean.Cleaned, result: Reconstructed, scratch: Path
) -> None:
    options = reconstruct.Options(base_faces=600)
    second = reconstruct.run(cleaned, options, Context(scratch, threads=2))
    for name, array in reconstruct.store(result).arrays.items():
        assert array.tobytes() == reconstruct.store(second).arrays[name].tobytes(), name


def test_stored_and_restored(result: Reconstructed) -> None:
    back = reconstruct.restore(reconstruct.store(result), result.facts)
    assert (back.detail.vertices == result.detail.vertices).all()
    assert list(back.base.attributes) == ["grade", "code"]
    assert back.deviation_m == result.deviation_m


def test_too_little_memory_is_said_before_anything_runs(
    cleaned: clean.Cleaned, scratch: Path
) -> None:
    context = Context(scratch, max_memory_bytes=2**26)
    with pytest.raises(ResourceError, match=r"allowed are 0\.1 GiB; lower --detail-depth"):
        reconstruct.run(cleaned, reconstruct.Options(), context)


def test_nothing_stays_in_scratch(result: Reconstructed, scratch: Path) -> None:
    assert not list(scratch.iterdir())


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
