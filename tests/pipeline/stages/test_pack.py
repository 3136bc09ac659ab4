from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terraport_payload import decode_glb, snap
from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Survey
from terraport_pipeline.stages import clean, pack, reconstruct, segment
from terraport_pipeline.stages.contract import Context
from terraport_store.manifest import BuildInfo, CrsInfo
from terraport_store.reader import Scene
from terraport_store.validate import validate_scene

Inputs = tuple[reconstruct.Reconstructed, segment.Segmented, pack.About]


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Context:
    return Context(tmp_path_factory.mktemp("scratch"), threads=2)


@pytest.fixture(scope="module")
def inputs(make_hill: Callable[..., Survey], context: Context) -> Inputs:
    survey = make_hill()
    survey.attributes["grade"][:300] = np.nan
    cleaned = clean.run(survey, clean.Options(), context)
    meshes = reconstruct.run(cleaned, reconstruct.Options(base_faces=800), context)
    labels = segment.run(meshes, segment.Options(min_faces=150, max_faces=900), context)
    about = pack.About(
        origin=cleaned.cloud.origin,
        crs=CrsInfo(name="UTM 35S", wkt="PROJCS[]", epsg=32735),
        points=len(cleaned.cloud.points),
        has_colour=True,
        build=BuildInfo(terraport="test"),
    )
    return meshes, labels, about


@pytest.fixture(scope="module")
def scene(inputs: Inputs, context: Context, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pack") / "hill"
    pack.run(path, *inputs, pack.Options("Hill"), context)
    return path


def test_the_scene_is_valid(scene: Path) -> None:
    assert validate_scene(scene) == []


def test_the_segments_together_are_the_detail(scene: Path, inputs: Inputs) -> None:
    """Every face once, at the place on the grid that its vertices round to."""
    detail = inputs[0].detail
    with Scene.open(scene) as opened:
        step_m = opened.manifest.step_m
        triangles = []
        for number in range(opened.manifest.counts.segments):
            mesh = decode_glb(opened.payload(number))
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
    meshes, labels, _ = inputs
    values: dict[tuple[float, ...], set[tuple[float, ...]]] = {}
    for mesh in pack.split_segments(meshes.detail, labels.segments, labels.regions):
        for position, normal, colour in zip(
            mesh.positions.tolist(), mesh.normals.tolist(), mesh.colours.tolist(), strict=True
        ):
            values.setdefault(tuple(position), set()).add((*normal, *colour))
    assert all(len(same) == 1 for same in values.values())


def test_vertices_are_split_where_regions_meet(inputs: Inputs) -> None:
    meshes, labels, _ = inputs
    order = np.argsort(labels.segments, kind="stable")
    expected = labels.regions[order]
    regions = []
    for mesh in pack.split_segments(meshes.detail, labels.segments, labels.regions):
        assert mesh.region_ids is not None
        corners = mesh.region_ids[mesh.faces]
        assert (corners == corners[:, :1]).all()
        regions.append(corners[:, 0])
    assert (np.concatenate(regions) == expected).all()


def test_values_come_back_within_their_step(scene: Path, inputs: Inputs) -> None:
    detail = inputs[0].detail
    with Scene.open(scene) as opened:
        info = {a.name: a for a in opened.manifest.attributes}
        assert set(info) == {"grade", "classification"}
        assert info["classification"].step == 1.0
        step_m = opened.manifest.step_m
        mesh = decode_glb(opened.payload(0))
    vertex_at = {tuple(row): i for i, row in enumerate(snap(detail.vertices, step_m).tolist())}
    index = np.array([vertex_at[tuple(row)] for row in mesh.positions.tolist()])
    assert np.abs(mesh.positions - detail.vertices[index]).max() <= step_m / 2
    assert mesh.colours is not None
    assert (mesh.colours == detail.colours[index]).all()
    for name, values in mesh.attributes.items():
        expected = detail.attributes[name][index]
        assert (np.isnan(values) == np.isnan(expected)).all()
        finite = ~np.isnan(expected)
        assert np.abs(values - expected)[finite].max() <= 0.51 * info[name].step + 1e-6


def test_threads_change_no_byte(
    inputs: Inputs, context: Context, scene: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other"
    packed = pack.run(other, *inputs, pack.Options("Hill"), replace(context, threads=1))
    assert (other / "scene.json").read_bytes() == (scene / "scene.json").read_bytes()
    for file in packed.manifest.files.values():
        assert (other / file.path).read_bytes() == (scene / file.path).read_bytes(), file.path


def test_base_faces_keep_the_order_of_the_cover(scene: Path, inputs: Inputs) -> None:
    base, kept = inputs[0].base, inputs[1].base_kept
    with Scene.open(scene) as opened:
        decoded = decode_glb(opened.base_path.read_bytes())
        step_m = opened.manifest.step_m
    got = np.sort(decoded.positions[decoded.faces], axis=1)
    assert (got == np.sort(snap(base.vertices, step_m)[base.faces[kept]], axis=1)).all()


def test_a_name_is_needed() -> None:
    with pytest.raises(OptionError, match="1 to 200"):
        pack.Options("")
