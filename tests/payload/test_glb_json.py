from __future__ import annotations

import pytest

from terraport_payload import PayloadError
from terraport_payload.glb_json import only, pick, typed


def test_values_of_the_right_kind_come_back() -> None:
    assert typed([1], list, "x") == [1]
    assert pick(["a", "b"], 1, "x") == "b"
    assert only({"nodes": [7]}, "nodes") == 7


def test_others_are_named() -> None:
    with pytest.raises(PayloadError, match="x is int, expected list"):
        typed(1, list, "x")
    for number in (True, -1, 2, "0", None):
        with pytest.raises(PayloadError, match="expected 0 to 1"):
            pick(["a", "b"], number, "x")
    with pytest.raises(PayloadError, match="2 nodes, expected 1"):
        only({"nodes": [1, 2]}, "nodes")
