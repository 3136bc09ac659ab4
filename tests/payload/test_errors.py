from __future__ import annotations

from terraport_payload import PayloadError


def test_text_names_offset() -> None:
    """An error of bytes says where."""
    assert (
        str(PayloadError("3 bytes, expected 4", offset=7))
        == "3 bytes, expected 4 (payload offset 7)"
    )


def test_text_without_offset() -> None:
    """An error of a mesh has no offset to name."""
    error = PayloadError("no field 'x'")
    assert str(error) == "no field 'x'"
    assert error.offset is None
    assert isinstance(error, ValueError)
