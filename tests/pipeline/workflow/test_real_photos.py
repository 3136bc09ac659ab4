"""A real survey with its photos, built thinned: covered, as fine as the photos, nowhere white."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene, validate_scene


@pytest.mark.slow
@pytest.mark.shared_data
def test_brighton_beach(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "brighton_beach"
    if not (folder / "model.laz").is_file():
        pytest.skip(f"no {folder / 'model.laz'}: the survey with photos is not on this machine")
    texturing = Texturing(photos=folder / "images")  # its cameras lie beside it
    survey = folder / "model.laz"
    report = build(BuildOptions(survey, tmp_path / "b", max_points=60_000, texture=texturing))
    counts = next(stage for stage in report.stages if stage.name == "texture").facts.counts
    assert counts["unseen_share"] < 0.05
    assert counts["texel_m"] == pytest.approx(counts["gsd_m"], rel=0.15)
    assert 0.02 < counts["gsd_m"] < 0.06
    assert validate_scene(tmp_path / "b") == []
    with Scene.open(tmp_path / "b") as scene:
        meshes = [scene.mesh(number) for number in range(len(scene.index))]
    for mesh in meshes:
        assert mesh.texture is not None
        assert mesh.uvs is not None
        pixels = decode_image(mesh.texture.data)
        size = np.array([mesh.texture.width, mesh.texture.height])
        middle = (mesh.uvs[mesh.faces].mean(axis=1) * size).astype(int)
        shown = pixels[middle[:, 1], middle[:, 0]].astype(int)
        assert (shown.min(axis=1) >= 254).mean() < 0.02  # foam is bright; a hole would be white
        assert (shown.max(axis=1) <= 1).mean() < 0.02
