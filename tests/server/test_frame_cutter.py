"""Frames are cut where they end, however the bytes come."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.frames import Frame, Opcode

from terraport_server.frame_cutter import FrameCutter

contents = st.lists(
    st.one_of(st.binary(max_size=3), st.integers(0, 70_000).map(bytes)), min_size=1, max_size=6
)


def written(data: bytes, mask: bool) -> bytes:
    return Frame(Opcode.BINARY, data).serialize(mask=mask)


@settings(max_examples=150)
@given(data=st.data(), contents=contents, mask=st.booleans())
def test_pieces_end_where_frames_end(
    data: st.DataObject, contents: list[bytes], mask: bool
) -> None:
    frames = [written(content, mask) for content in contents]
    whole = b"".join(frames)
    ends = {sum(map(len, frames[: count + 1])) for count in range(len(frames))}
    cuts = data.draw(st.lists(st.integers(0, len(whole)), max_size=8).map(sorted), "cuts")
    cutter, cut = FrameCutter(), b""
    for start, stop in zip([0, *cuts], [*cuts, len(whole)], strict=True):
        cutter.add(whole[start:stop])
        while piece := cutter.next():
            before = len(cut)
            cut += piece
            # No piece reaches into the next frame.
            assert not {end for end in ends if before < end < len(cut)}
        assert len(cut) + len(cutter) == stop
        assert len(cutter) < 14  # of a header at most
    assert cut == whole


def test_what_breaks_the_rules_is_handed_out_too() -> None:
    cutter = FrameCutter()
    for data in (b"\xff\xff" + b"\xff" * 8 + b"abcd", b"more of it"):
        cutter.add(data)
        assert cutter.next() == data
    cutter.clear()
    assert (cutter.next(), len(cutter)) == (b"", 0)
