from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pipeline.one_piece import Labelled, reconstruct_survey, runner_in, segment_surface
from scipy.spatial import cKDTree

from terraport_payload import snap
from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Mesh, Survey
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.stages import pack
from terraport_pipeline.workflow.pack_step import publish_tiles
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import Runner
from terraport_store.layout import BASE
from terraport_store.manifest import BuildInfo, CrsInfo
from terraport_store.reader import Scene
from terraport_store.validate import validate_scene

OPTIONS = pack.Options("Hill")


@dataclass(frozen=True)
class Inputs:
    """A hill in one tile, cut into segments, as it is published."""

    runner: Runner
    surface: Surface
    labelled: Labelled
    about: pack.About

    @property
    def detail(self) -> Mesh:
        return self.surface.tiles.load(0)

    def publish(self, scene: Path, runner: Runner | None = None) -> None:
        publish_tiles(
            runner or self.runner, scene, self.surface, self.labelled.segmented, None, None,
            self.about, OPTIONS,
        )  # fmt: skip


@pytest.fixture(scope="module")
def inputs(make_hill: Callable[..., Survey], tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    survey = make_hill()
    survey.attributes["grade"][:300] = np.nan
    runner = runner_in(tmp_path_factory.mktemp("inputs"), threads=2)
    hill = reconstruct_survey(runner, survey, reconstruct.Options(base_faces=800))
    surface = hill.reconstructed.surface
    labelled = segment_surface(runner, surface, segment.Options(min_faces=150, max_faces=900))
    about = pack.About(
        origin=hill.ground.origin,
        crs=CrsInfo(name="UTM 35S", wkt="PROJCS[]", epsg=32735),
        points=hill.reconstructed.points,
        has_colour=True,
        build=BuildInfo(terraport="test"),
    )
    return Inputs(runner, surface, labelled, about)


@pytest.fixture(scope="module")
def scene(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pack") / "hill"
    inputs.publish(path)
    return path


def test_the_scene_is_valid(scene: Path) -> None:
    assert validate_scene(scene) == []


def test_the_segments_together_are_the_detail(scene: Path, inputs: Inputs) -> None:
    """Every face once, at the place on the grid that its vertices round to."""
    detail = inputs.detail
    with Scene.open(scene) as opened:
        step_m = opened.manifest.step_m
        triangles = []
        for number in range(opened.manifest.counts.segments):
            mesh = opened.mesh(number)
            triangles.append(mesh.positions[mesh.faces])
    expected = snap(detail.vertices, step_m)[detail.faces]

    def canonical(triangles: np.ndarray) -> list[tuple[float, ...]]:
        rows = []
        for triangle in triangles.tolist():
            turned = [triangle[i:] + triangle[:i] for i in range(3)]
            rows.append(tuple(value for corner in min(turned) for value in corner))
        return sorted(rows)

    assert canonical(np.concatenate(triangles)) == canonical(expected)


def test_border_vertices_are_equal_in_all_segments(inputs: Inputs) -> None:
    labels = inputs.labelled
    values: dict[tuple[float, ...], set[tuple[float, ...]]] = {}
    for mesh in pack.split_segments(inputs.detail, labels.segments, labels.regions):
        for position, normal, colour in zip(
            mesh.positions.tolist(), mesh.normals.tolist(), mesh.colours.tolist(), strict=True
        ):
            values.setdefault(tuple(position), set()).add((*normal, *colour))
    assert all(len(same) == 1 for same in values.values())


def test_vertices_are_split_where_regions_meet(inputs: Inputs) -> None:
    labels = inputs.labelled
    order = np.argsort(labels.segments, kind="stable")
    expected = labels.regions[order]
    regions = []
    for mesh in pack.split_segments(inputs.detail, labels.segments, labels.regions):
        assert mesh.region_ids is not None
        corners = mesh.region_ids[mesh.faces]
        assert (corners == corners[:, :1]).all()
        regions.append(corners[:, 0])
    assert (np.concatenate(regions) == expected).all()


def test_values_come_back_within_their_step(scene: Path, inputs: Inputs) -> None:
    detail = inputs.detail
    with Scene.open(scene) as opened:
        info = {a.name: a for a in opened.manifest.attributes}
        assert set(info) == {"grade", "classification"}
        assert info["classification"].step == 1.0
        step_m = opened.manifest.step_m
        mesh = opened.mesh(0)
    snapped = snap(detail.vertices, step_m)
    _, first, times = np.unique(snapped, axis=0, return_index=True, return_counts=True)
    # Vertices nearer to each other than a step cannot be told apart.
    vertex_at = {tuple(snapped[i].tolist()): i for i in first[times == 1]}
    kept = np.array([tuple(row) in vertex_at for row in mesh.positions.tolist()])
    assert kept.mean() > 0.99
    index = np.array([vertex_at[tuple(row)] for row in mesh.positions[kept].tolist()])
    assert np.abs(mesh.positions[kept] - detail.vertices[index]).max() <= step_m / 2
    assert mesh.colours is not None
    assert (mesh.colours[kept] == detail.colours[index]).all()
    for name, values in mesh.attributes.items():
        expected = detail.attributes[name][index]
        values = values[kept]
        assert (np.isnan(values) == np.isnan(expected)).all()
        finite = ~np.isnan(expected)
        assert np.abs(values - expected)[finite].max() <= 0.51 * info[name].step + 1e-6


def test_threads_change_no_byte(inputs: Inputs, scene: Path, tmp_path: Path) -> None:
    inputs.publish(tmp_path / "hill", runner_in(tmp_path, threads=1))
    files = {path.relative_to(scene) for path in scene.rglob("*") if path.is_file()}
    assert files
    for name in files:
        assert (tmp_path / "hill" / name).read_bytes() == (scene / name).read_bytes(), name


def test_the_base_has_the_regions_of_the_detail_over_it(scene: Path, inputs: Inputs) -> None:
    """So that it can be coloured by them before anything has landed."""
    detail, labels = inputs.detail, inputs.labelled.regions
    middles = detail.vertices[detail.faces].mean(axis=1)
    with Scene.open(scene) as opened:
        base = opened.file_mesh(BASE)
    assert base.region_ids is not None
    _, nearest = cKDTree(middles).query(base.positions)
    # Positions are rounded to the grid: a vertex in the middle between two may turn to either.
    assert (base.region_ids == labels[nearest]).mean() > 0.99


def test_base_faces_keep_the_order_of_the_cover(scene: Path, inputs: Inputs) -> None:
    base, kept = inputs.surface.base, inputs.labelled.joined.base_kept
    with Scene.open(scene) as opened:
        decoded = opened.file_mesh(BASE)
        step_m = opened.manifest.step_m
    got = np.sort(decoded.positions[decoded.faces], axis=1)
    assert (got == np.sort(snap(base.vertices, step_m)[base.faces[kept]], axis=1)).all()


def test_a_name_is_needed() -> None:
    with pytest.raises(OptionError, match="1 to 200"):
        pack.Options("")
