"""Settings that cannot be: the name that was typed, the value, and what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from terraport_server.cli import _OPTIONS, register
from terraport_server.errors import SettingsError
from terraport_server.setting_errors import read_settings, typed_name
from terraport_server.settings import ENV_PREFIX, Settings

NAMES = {"max_radius_m": "--max-radius", "token": "--token"}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # no .env but the test's own


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("max_radius_m", "abc", "got 'abc', expected a number above 0 to 1,000,000"),
        ("port", 99_999, "got 99999, expected a whole number from 0 to 65,535"),
        ("max_groups", 0, "got 0, expected a whole number from 1 to 100,000"),
        ("max_sessions", 0, "got 0, expected a whole number from 1 on"),
        ("viewer", "maybe", "got 'maybe', expected true or false"),
        ("log_format", "xml", "got 'xml', expected 'text' or 'json'"),
        ("allowed_hosts", 3, """got 3, expected a JSON list such as ["one", "two"]"""),
        ("token", 5, "got another value, expected a secret"),
        ("public_docs", "x", "got 'x', expected true or false"),
        ("congestion_control", "x y", "got 'x y', expected text that matches ^[a-z0-9_-]{1,15}$"),
        ("viewer_dir", 3, "got 3, expected a path"),
        ("scenes_url", 3, "got 3, expected text"),
    ],
)
def test_a_wrong_value_is_said_with_what_was_expected(name: str, value: object, what: str) -> None:
    with pytest.raises(SettingsError) as raised:
        read_settings({name: value})
    assert (raised.value.setting, raised.value.what) == (name, what)


@pytest.mark.parametrize("name", Settings.model_fields)
def test_every_setting_can_say_what_it_expects(name: str) -> None:
    with pytest.raises(SettingsError, match="expected "):
        read_settings({name: object()})


def test_a_list_that_is_no_json_is_one_line_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERRAPORT_ALLOWED_ORIGINS", "https://a.example")
    with pytest.raises(SettingsError) as raised:
        read_settings({})
    what = """got 'https://a.example', expected a JSON list such as ["one", "two"]"""
    assert str(raised.value) == f"allowed_origins: {what}"


def test_the_name_is_the_one_that_was_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"max_radius_m": -1.0}
    assert typed_name("max_radius_m", NAMES, given) == "--max-radius"
    assert typed_name("token", NAMES, given) == "--token"  # none was given: what to give
    assert typed_name("max_groups", NAMES, given) == "TERRAPORT_MAX_GROUPS"
    Path(".env").write_text("TERRAPORT_TOKEN=x\n")
    assert typed_name("token", NAMES, given) == "TERRAPORT_TOKEN in .env"
    monkeypatch.setenv("terraport_token", "x")
    assert typed_name("token", NAMES, given) == "TERRAPORT_TOKEN"


def test_the_command_has_the_options_that_errors_name() -> None:
    app = typer.Typer()
    register(app)
    taken = {name for parameter in typer.main.get_command(app).params for name in parameter.opts}
    assert {name for name in _OPTIONS.values() if name.startswith("--")} <= taken
    assert set(_OPTIONS) <= set(Settings.model_fields)
    assert ENV_PREFIX == "TERRAPORT_"
