from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_payload import PayloadError, SegmentMesh
from terraport_payload.meshcheck import check_mesh


def test_good_mesh_passes(patch: SegmentMesh, triangle: SegmentMesh) -> None:
    check_mesh(patch)
    check_mesh(triangle)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((3, 3))}, "positions is float64"),
        (
            {"normals": np.zeros((2, 3), dtype=np.float32)},
            r"normals is float32 \(2, 3\), expected float32 \(3, 3\)",
        ),
        ({"faces": np.zeros((1, 3), dtype=np.int32)}, "faces is int32"),
        (
            {"faces": np.zeros((0, 3), dtype=np.uint32)},
            "3 vertices and 0 faces, expected at least one face",
        ),
        (
            {"faces": np.array([[0, 1, 3]], dtype=np.uint32)},
            "a face uses vertex 3, expected below 3",
        ),
        ({"colours": np.zeros((3, 4), dtype=np.uint8)}, r"colours is uint8 \(3, 4\)"),
        ({"region_ids": np.zeros(3, dtype=np.uint32)}, "region_ids is uint32"),
        ({"attributes": {"a": np.zeros(4, dtype=np.float32)}}, "attribute 'a' is float32"),
        (
            {"positions": np.array([[0, 0, 0], [0, np.nan, 0], [0, 0, 0]], dtype=np.float32)},
            "positions of vertex 1 are",
        ),
        ({"normals": np.full((3, 3), np.inf, dtype=np.float32)}, "normals of vertex 0 are"),
    ],
)
def test_names_the_first_wrong_array(
    triangle: SegmentMesh, change: dict[str, object], message: str
) -> None:
    with pytest.raises(PayloadError, match=message):
        check_mesh(replace(triangle, **change))  # type: ignore[arg-type]
