from __future__ import annotations

import pytest

from terraport_payload import PayloadError
from terraport_store.layout import STAGING, VERSION_FOLDER, check_pack_header, pack_header

HEADER = (
    b"TPSEGPK1"
    + bytes.fromhex("0100 0000 40000000 40000000")
    + b"segment-2".ljust(16, b"\0")
    + bytes(28)
)


def test_literal_header_both_ways() -> None:
    assert pack_header("segment-2") == HEADER
    check_pack_header(HEADER, "segment-2")
    check_pack_header(HEADER + b"payload", "segment-2")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (HEADER[:63], "63 bytes, expected a header of 64"),
        (b"X" + HEADER[1:], "magic b'XPSEGPK1'"),
        (HEADER[:8] + b"\2" + HEADER[9:], "format version 2, expected 1"),
        (HEADER[:12] + b"\x10" + HEADER[13:], "header of 16 bytes"),
        (HEADER[:16] + b"\x20" + HEADER[17:], "alignment 32"),
        (pack_header("draco"), "expected 'segment-2'"),
    ],
)
def test_refuses(data: bytes, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        check_pack_header(data, "segment-2")


def test_newer_minor_is_read() -> None:
    check_pack_header(HEADER[:10] + b"\7" + HEADER[11:], "segment-2")


@pytest.mark.parametrize("name", ["v-0123456789ab", "v-0123456789ab-1"])
def test_version_folders(name: str) -> None:
    assert VERSION_FOLDER.fullmatch(name)


@pytest.mark.parametrize("name", ["v-", "v-0123456789ab-", "v-0123456789abc", "v-data", "version"])
def test_other_folders_are_never_deleted(name: str) -> None:
    assert not VERSION_FOLDER.fullmatch(name)
    assert not STAGING.fullmatch(name)
