"""`terraport token`: keys, tokens, and what it says of them."""

from __future__ import annotations

import re
import shlex
import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from terraport.cli import app
from terraport_server.auth.gate import Gate
from terraport_server.auth.keys import read_keys


def run(*arguments: str | Path, typed: str | None = None) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["token", *map(str, arguments)], input=typed)
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.parametrize("algorithm", ["HS256", "EdDSA"])
def test_from_key_to_open_scene(tmp_path: Path, algorithm: str) -> None:
    tmp_path = tmp_path / "with a space"  # printed commands can be copied
    tmp_path.mkdir()
    keys = tmp_path / "keys"
    code, output, _ = run("new-key", keys, "--algorithm", algorithm)
    assert code == 0
    served = keys if algorithm == "HS256" else tmp_path / "keys.public"
    assert f"--token-keys {shlex.quote(str(served))}" in output
    assert f"--keys {shlex.quote(str(keys))} --name" in output
    for path in tmp_path.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    code, token, output = run(
        "create",
        "--keys",
        keys,
        "--name",
        "anna",
        "--scene",
        "pit",
        "--valid",
        "8h",
        "--scope",
        "guide",
    )
    assert code == 0
    assert re.search(r"for anna: pit; guide, until 20\d\d-", output)
    gate = Gate(None, read_keys(served))
    assert gate.check(token.strip(), "pit") is None
    assert gate.check(token.strip(), "other") is not None
    found = gate.find(token.strip())
    assert found is not None
    assert found.guide
    code, shown, _ = run("show", "-", "--keys", served, typed=token)
    assert code == 0
    assert '"sub": "anna"' in shown
    assert "signature and claims are valid" in shown

    revoked = re.search(r"revoke \w+", output)
    assert revoked is not None
    served.write_text(served.read_text() + revoked[0] + "\n")
    code, _, error = run("show", token.strip(), "--keys", served)
    assert (code, "or revoked" in error) == (1, True)


def test_a_key_file_is_named_as_it_was_given(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    code, _, error = run("create", "--keys", keys, "--name", "anna", "--all-scenes")
    assert code == 1
    assert error.startswith(f"error: --keys: {keys}: No such file")
    keys.write_text("no key\n")
    code, _, error = run("new-key", keys)
    assert code == 1
    assert error.startswith(f"error: FILE: {keys} line 1: ")


def test_a_new_key_signs_and_the_old_one_still_counts(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    run("new-key", keys)
    _, old, _ = run("create", "--keys", keys, "--name", "anna", "--all-scenes")
    code, _, _ = run("new-key", keys)
    assert code == 0
    _, new, _ = run("create", "--keys", keys, "--name", "anna", "--all-scenes")
    first, second = (key.id for key in read_keys(keys).keys)
    assert first == f"{second}.2"
    gate = Gate(None, read_keys(keys))
    assert gate.check(old.strip(), "pit") is None
    assert gate.check(new.strip(), "pit") is None
    keys.write_text("\n".join(keys.read_text().splitlines()[:2]))
    gate = Gate(None, read_keys(keys))
    assert gate.check(old.strip(), "pit") is not None
    assert gate.check(new.strip(), "pit") is None


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["create", "--name", "a"], "expected --scene ID, once or more, or --all-scenes"),
        (["create", "--name", "a", "--scene", "p", "--all-scenes"], "--all-scenes"),
        (["create", "--name", "a", "--scene", "p", "--valid", "8"], "expected like 30m, 8h, 7d"),
        (["create", "--name", "a", "--scene", "p", "--valid", "500d"], "at most 400d"),
        (["create", "--name", "", "--scene", "p"], "1 to 64 printable characters"),
        (["create", "--name", "a", "--scene", "p" * 4000], "token of"),
    ],
)
def test_what_cannot_be_is_said(tmp_path: Path, arguments: list[str], text: str) -> None:
    keys = tmp_path / "keys"
    run("new-key", keys)
    code, out, error = run(*arguments, "--keys", keys)
    assert (code, out) == (1, "")
    assert text in error


def test_a_missing_key_file_and_no_token() -> None:
    code, _, error = run("create", "--keys", "nowhere", "--name", "a", "--all-scenes")
    assert (code, "nowhere: No such file" in error) == (1, True)
    code, _, error = run("show", "no-token")
    assert (code, "not a signed token" in error) == (1, True)
