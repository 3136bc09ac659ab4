"""Options are refused before any work; what s depends on."""

from __future__ import annotations

from dataclasses import replace

import pytest

from terraport_pipeline.geometry.regions.engine_options import (
    FINE_POOLS,
    REGION_POOLS,
    TrianglePoolOptions,
)


def test_published_settings():
    assert (REGION_POOLS.threshold, REGION_POOLS.small_threshold) == (0.7, 0.015)
    assert (FINE_POOLS.threshold, FINE_POOLS.small_threshold) == (0.2, 0.0)


def test_what_the_similarity_depends_on():
    assert REGION_POOLS.similarity_key == FINE_POOLS.similarity_key
    for change in ({"mu": 2.0}, {"tau": 0.0}, {"normalise": "raw"}, {"origin": "first"}):
        assert replace(REGION_POOLS, **change).similarity_key != REGION_POOLS.similarity_key
    for same in ({"contiguity": "vertex"}, {"islands": "stay"}, {"threshold": 0.1}):
        assert replace(REGION_POOLS, **same).similarity_key == REGION_POOLS.similarity_key


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tau": -0.1}, r"tau is -0\.1, expected a finite number in 0"),
        ({"mu": float("inf")}, r"mu is inf"),
        ({"attribute_range": 0.0}, r"attribute_range is 0\.0"),
        ({"normalise": "log"}, r"normalise is 'log', expected one of minmax, max, raw"),
        ({"contiguity": "face"}, r"contiguity is 'face', expected one of edge, vertex"),
        ({"islands": "sink"}, r"islands is 'sink', expected one of nearest, stay"),
    ],
)
def test_bad_options_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        TrianglePoolOptions(**change)
