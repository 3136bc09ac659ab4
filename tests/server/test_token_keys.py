"""Key files: read, refused, written for their owner's eyes only."""

from __future__ import annotations

import builtins
import stat
from pathlib import Path
from typing import Any

import pytest

from terraport_server.auth.keys import KeyRing, TokenKey, new_key, read_keys, write_keys
from terraport_server.errors import SettingsError

SECRET = "A" * 43
"""32 bytes in base64url."""


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    keys = (new_key("new", "EdDSA"), new_key("old", "HS256"))
    write_keys(path, ["# a comment", *(key.line() for key in keys), "", "revoke t1"])
    assert read_keys(path) == KeyRing(keys, frozenset({"t1"}))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert list(tmp_path.iterdir()) == [path]
    write_keys(path, [keys[1].line()])
    assert read_keys(path).keys == keys[1:]


def test_a_key_is_not_shown() -> None:
    key = new_key("k", "HS256")
    assert repr(key) == "TokenKey('k', 'HS256')"
    assert key.line().split()[2] not in repr(KeyRing((key,), frozenset()))


def test_a_public_key_signs_nothing() -> None:
    key = new_key("k", "EdDSA")
    assert key.public().algorithm == "EdDSA"
    with pytest.raises(SettingsError, match="key k is public, expected HS256 or EdDSA-private"):
        key.public().signing()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", "holds no key"),
        ("revoke t1\n", "holds no key"),
        ("k HS256\n", "line 1: got 2 words, expected ID ALGORITHM KEY"),
        (f"k HS512 {SECRET}\n", "got algorithm 'HS512', expected one of: HS256, EdDSA"),
        (f"k none {SECRET}\n", "got algorithm 'none'"),
        ("k HS256 AAAA\n", "got a key of 3 bytes, expected 32 to 1024"),
        ("k HS256 !!!!\n", "not base64url"),
        ("k EdDSA " + "A" * 44 + "\n", "got a key of 33 bytes, expected 32"),
        (f"k/y HS256 {SECRET}\n", "got id 'k/y', expected 1 to 64 letters"),
        (f"k HS256 {SECRET}\nk HS256 {SECRET}\n", "two keys of one id"),
        (f"k HS256 {SECRET}\nrevoke\n", "line 2: expected revoke TOKEN_ID"),
        ("".join(f"k{n} HS256 {SECRET}\n" for n in range(17)), "17 keys, expected at most 16"),
    ],
)
def test_bad_files_are_refused_without_showing_a_key(
    tmp_path: Path, content: str, text: str
) -> None:
    path = tmp_path / "keys"
    path.write_text(content)
    with pytest.raises(SettingsError, match=text) as caught:
        read_keys(path)
    assert SECRET not in str(caught.value)


@pytest.mark.parametrize(("key_id", "algorithm"), [("", "HS256"), ("revoke", "HS256"), ("k", "no")])
def test_keys_that_cannot_be(key_id: str, algorithm: str) -> None:
    with pytest.raises(SettingsError):
        new_key(key_id, algorithm)


def test_eddsa_without_its_extra_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    key = new_key("k", "EdDSA").public()
    real = builtins.__import__

    def without(name: str, *arguments: Any) -> Any:
        if name.startswith("cryptography"):
            raise ModuleNotFoundError(name)
        return real(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(SettingsError, match=r'needs? cryptography, expected "terraport\[eddsa\]"'):
        key.verifying()
    assert TokenKey("k", "HS256", bytes(32)).verifying() == bytes(32)


def test_a_file_that_cannot_be_replaced_stays(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    path.mkdir()
    with pytest.raises(OSError, match="directory"):
        write_keys(path, ["x"])
    assert list(tmp_path.iterdir()) == [path]
