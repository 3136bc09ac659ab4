from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pipeline.engines.test_decimate import border, hills

from terraport_payload import SegmentMesh, decode_segment, encode_segment
from terraport_pipeline.engines.overview import MAX_FACES, overview_of, overview_payload
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_store import Scene

SAMPLE = Path(__file__).resolve().parents[3] / "data" / "sample_scene"
STEP_M = 2.0**-8


def hilly(side: int) -> SegmentMesh:
    """Hills, red in the west and blue in the east, a region each."""
    vertices, faces = hills(side)
    is_east = vertices[:, 0] > side / 2
    return SegmentMesh(
        positions=vertices,
        faces=faces.astype(np.uint32),
        normals=vertex_normals(vertices, faces),
        colours=np.where(is_east[:, None], [0, 0, 200], [200, 0, 0]).astype(np.uint8),
        region_ids=is_east.astype(np.uint16),
    )


def test_few_faces_in_the_same_shape_and_colours() -> None:
    base = hilly(60)
    overview = overview_of(base, STEP_M, 1500)
    assert 1000 < len(overview.faces) <= 1500
    faces = overview.faces.astype(np.int32)
    assert distances_to_mesh(base.positions, overview.positions, faces).max() < 0.3
    assert (overview.positions % STEP_M == 0).all()
    extent = {place[0] for place in border(overview.positions, faces)}
    assert (min(extent), max(extent)) == (0, 60)
    assert overview.colours is not None
    assert overview.region_ids is not None
    east = overview.positions[:, 0] > 33
    assert (overview.colours[east] == [0, 0, 200]).all()
    assert (overview.region_ids[east] == 1).all()
    assert (overview.colours[overview.positions[:, 0] < 27] == [200, 0, 0]).all()


def test_a_base_without_colour_stays_without() -> None:
    assert overview_of(replace(hilly(40), colours=None), STEP_M, 900).colours is None


def test_a_small_base_is_its_own_overview() -> None:
    base = encode_segment(hilly(60), step_m=STEP_M, scales={})
    assert overview_payload(base, STEP_M) is None


def test_the_scene_that_comes_along_has_the_one_that_its_base_gives() -> None:
    with Scene.open(SAMPLE) as scene:
        stored = scene.file_path("overview.tsg").read_bytes()
        assert overview_payload(scene.base_path.read_bytes(), scene.manifest.step_m) == stored
    overview = decode_segment(stored, scales=None)
    assert len(overview.faces) <= MAX_FACES
    assert overview.texture is None
    assert overview.colours is not None
    # A grey rock, not a black one: the image was looked up where the faces have it.
    assert 60 < overview.colours.mean() < 180
    assert len(stored) < 160_000
