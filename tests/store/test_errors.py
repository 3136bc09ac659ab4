from __future__ import annotations

import pytest

from terraport_store import (
    CorruptPayloadError,
    DamagedSceneError,
    OutOfSpaceError,
    PublishError,
    RangeError,
    SceneBusyError,
    SceneNotFoundError,
    StoreError,
)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (SceneNotFoundError("a/b"), "no scene at a/b, expected a directory with scene.json"),
        (
            SceneNotFoundError("a", ["pit", "quarry"]),
            "no scene at a, expected a directory with scene.json; scenes in it: pit, quarry",
        ),
        (
            SceneNotFoundError("a", [str(number) for number in range(10)]),
            (
                "no scene at a, expected a directory with scene.json; scenes in it: "
                "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"
            ),
        ),
        (
            SceneNotFoundError("s3:/bucket/pit"),
            (
                "s3://bucket/pit was taken for a path of this machine; an address has two slashes, "
                "and in Python it is a str"
            ),
        ),
        (
            SceneNotFoundError("s3://bucket/pit"),
            "no scene at s3://bucket/pit, expected scene.json there",
        ),
        (DamagedSceneError("v/f", "3 bytes, expected 4"), "v/f: 3 bytes, expected 4"),
        (DamagedSceneError("v/f", "bad", offset=9), "v/f at byte 9: bad"),
        (
            CorruptPayloadError(7, 64, 0xAB, 0xCD, file="v/segments.pack"),
            (
                "v/segments.pack at byte 64: segment 7 has hash 00000000000000cd, "
                "expected 00000000000000ab; restore the file or build the scene again"
            ),
        ),
        (RangeError(5, 6, 7), "6 bytes at 5, expected within 0 to 7"),
        (
            OutOfSpaceError("d"),
            "no space left at d; nothing was published, free some space and run again",
        ),
        (
            OutOfSpaceError("d", needed_bytes=10, free_bytes=3),
            (
                "3 bytes free at d, expected at least 10; "
                "nothing was published, free some space and run again"
            ),
        ),
        (SceneBusyError("d"), "another process is publishing d; wait for it and run again"),
    ],
)
def test_text(error: StoreError, text: str) -> None:
    assert str(error) == text
    assert isinstance(error, StoreError)


def test_tree() -> None:
    """What callers catch."""
    assert issubclass(CorruptPayloadError, DamagedSceneError)
    assert issubclass(OutOfSpaceError, PublishError)
    assert issubclass(SceneBusyError, PublishError)
    error = CorruptPayloadError(7, 64, 0xAB, 0xCD, file="p")
    assert (error.segment, error.offset, error.expected, error.actual) == (7, 64, 0xAB, 0xCD)
