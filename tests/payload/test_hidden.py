"""Hidden base faces of a set of segments, against a loop over the cover."""

from __future__ import annotations

import gzip

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_payload import Cover
from terraport_payload.hidden import HiddenFaces

SEGMENTS = 9
ROWS = st.lists(st.sets(st.integers(0, SEGMENTS - 1)), max_size=30)


@given(ROWS, st.sets(st.integers(0, SEGMENTS - 1)))
def test_a_face_is_hidden_where_all_segments_over_it_are_shown(
    rows: list[set[int]], shown: set[int]
) -> None:
    offsets = np.cumsum([0, *map(len, rows)]).astype(np.uint32)
    segments = np.array([one for row in rows for one in sorted(row)], np.uint32)
    hidden = HiddenFaces(Cover(offsets, segments), SEGMENTS)
    asked = np.array(sorted(shown), np.int64)
    expected = [bool(row) and row <= shown for row in rows]
    assert hidden.of(asked).tolist() == expected
    bits = np.frombuffer(gzip.decompress(hidden.packed(asked)), np.uint8)
    assert np.unpackbits(bits, count=len(rows), bitorder="little").tolist() == expected
    assert hidden.base_faces == len(rows)
