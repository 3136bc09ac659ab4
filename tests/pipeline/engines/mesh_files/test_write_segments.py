from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
from terraport_pipeline.engines.mesh_files.write_segments import write_segments
from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.errors import OptionError

FAR = np.array([[500000, 5200000, 100], [500001, 5200000, 100], [500001, 5200001, 100],
                [500000, 5200001, 100.001]])  # fmt: skip
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
LABELS = np.array([1, 0], np.int32)


def test_numbers(tmp_path: Path) -> None:
    write_segments(tmp_path / "new" / "a.seg", LABELS, FAR, FACES)
    assert (tmp_path / "new" / "a.seg").read_bytes() == b"1\n0\n"
    write_segments(tmp_path / "a.npy", LABELS, FAR, FACES)
    assert np.load(tmp_path / "a.npy").tolist() == [1, 0]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.seg"]


@pytest.mark.parametrize("kind", ["ply", "glb"])
def test_every_face_has_its_segments_colour_and_place(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    write_segments(path, LABELS, FAR, FACES)
    loaded = trimesh.load_scene(path, process=False).to_geometry()
    assert len(loaded.vertices) == 6  # those on the border are there twice
    np.testing.assert_allclose(loaded.vertices[loaded.faces], FAR[FACES], atol=1e-6)
    mesh = read_mesh(path)  # at one place one again: the mean on the border
    assert mesh.colours is not None
    own = mesh.colours[mesh.faces[0, 1]]
    np.testing.assert_allclose(own, distinct_colours(2)[1], atol=1)
    assert mesh.attributes["segment" if kind == "ply" else "SEGMENT"].max() == 1


def test_another_ending(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"\.obj; expected \.seg, \.npy, \.ply or \.glb"):
        write_segments(tmp_path / "a.obj", LABELS, FAR, FACES)
