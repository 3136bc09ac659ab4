"""Settings: ranges, refusals, and the page that lists them."""

from __future__ import annotations

import re
from pathlib import Path

import pydantic
import pytest
import typer

from terraport_server.cli import _OPTIONS, register
from terraport_server.errors import SettingsError
from terraport_server.limits import Limits
from terraport_server.settings import (
    ENV_PREFIX,
    Settings,
    read_settings,
    typed_name,
    unknown_variables,
)

PAGE = Path(__file__).resolve().parents[2] / "docs" / "topics" / "settings.md"


def listed() -> dict[str, str]:
    """Default by setting, as the page's tables say."""
    rows = {}
    service = PAGE.read_text().split("## Fixed limits")[0]
    for names, default in re.findall(r"^\| (`[^|]+`) \| ([^|]+) \|", service, re.M):
        for name in re.findall(r"`(\w+)`", names):
            rows[name] = default.strip().strip("`")
    return rows


def test_the_page_lists_every_setting_with_its_default() -> None:
    page = listed()
    assert sorted(page) == sorted(Settings.model_fields)
    for name, field in Settings.model_fields.items():
        shown, default = page[name], field.default
        if default is None or default == ():
            assert shown == "none", name
        elif isinstance(default, bool):
            assert shown == str(default).lower(), name
        elif isinstance(default, int | float):
            assert float(shown) == default, name
        else:
            assert shown == str(default), name


def test_settings_bound_every_session(tmp_path: Path) -> None:
    settings = Settings(
        scenes_dir=tmp_path,
        max_radius_m=70.0,
        max_messages_per_s=3.0,
        idle_timeout_s=2.5,
        group_routing="query",
    )
    limits = Limits().with_changes(max_picks=2).of_session(settings, "name")
    assert (limits.max_radius_m, limits.max_messages_per_s) == (70.0, 3.0)
    assert (limits.idle_timeout_s, limits.groups) == (2.5, "query")
    assert (limits.max_picks, limits.server) == (2, "name")


def test_a_limit_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(TypeError, match="max_feet"):
        Limits().with_changes(max_feet=2)


def test_the_environment_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(f"{ENV_PREFIX}MAX_RADIUS_M", "123")
    monkeypatch.setenv(f"{ENV_PREFIX}ALLOWED_ORIGINS", '["https://a.example"]')
    monkeypatch.setenv(f"{ENV_PREFIX}TOKEN", "sixteen-characters")
    settings = Settings()
    assert settings.max_radius_m == 123.0
    assert settings.allowed_origins == ("https://a.example",)
    assert "sixteen" not in repr(settings)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_radius_m", 0.0),
        ("max_radius_m", float("nan")),
        ("max_radius_m", 2e6),
        ("port", 70_000),
        ("max_sessions", 0),
        ("idle_timeout_s", -1.0),
        ("pull_base_url", "ftp://cdn.example/scenes"),
        ("pull_base_url", "https://cdn.example/scenes?key=1"),
    ],
)
def test_values_out_of_range_are_refused(name: str, value: object) -> None:
    with pytest.raises(pydantic.ValidationError, match=name):
        Settings(**{name: value})  # type: ignore[arg-type]


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(pydantic.ValidationError):
        Settings().port = 1


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.8.8.8"])
def test_open_on_this_machine_is_fine(tmp_path: Path, host: str) -> None:
    Settings(scenes_dir=tmp_path, host=host).check()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "quarry.example"])
def test_open_to_others_must_be_said(tmp_path: Path, host: str) -> None:
    with pytest.raises(SettingsError, match=r"token: got none while listening on .*--allow-open"):
        Settings(scenes_dir=tmp_path, host=host).check()
    Settings(scenes_dir=tmp_path, host=host, allow_open=True).check()
    Settings(scenes_dir=tmp_path, host=host, token="sixteen-characters").check()  # type: ignore[arg-type]


def test_a_missing_directory(tmp_path: Path) -> None:
    with pytest.raises(
        SettingsError, match=r"there is no folder .*nowhere, expected a folder of scenes"
    ):
        Settings(scenes_dir=tmp_path / "nowhere").check()


def test_half_of_tls(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="got one of ssl_certfile and ssl_keyfile"):
        Settings(scenes_dir=tmp_path, ssl_keyfile=tmp_path / "key.pem").check()


def test_where_groups_can_be_joined() -> None:
    assert Settings().groups_served == "here"
    assert Settings(group_routing="query").groups_served == "query"
    assert Settings(group_routing="off").groups_served == "none"
    for routing in ("process", "query", "off"):
        assert Settings(group_routing=routing, workers=2).groups_served == "none"


NAMES = {"max_radius_m": "--max-radius", "token": "--token"}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # no .env but the test's own


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("max_radius_m", "abc", "got 'abc', expected a valid number"),
        ("port", 99_999, "got '99999', expected a number less than or equal to 65535"),
        ("max_sessions", 0, "got '0', expected a number greater than or equal to 1"),
        ("viewer", "maybe", "got 'maybe', expected a valid boolean"),
        ("log_format", "xml", "got 'xml', expected 'text' or 'json'"),
        ("allowed_hosts", 3, """got '3', expected a JSON list such as ["one", "two"]"""),
        ("token", 5, "got another value, expected a valid string"),
        ("viewer_dir", 3, "got '3', expected a path"),
        ("scenes_url", 3, "got '3', expected a valid string"),
    ],
)
def test_a_wrong_value_is_named_with_what_was_expected(name: str, value: object, what: str) -> None:
    with pytest.raises(SettingsError) as raised:
        read_settings({name: value})
    assert (raised.value.setting, raised.value.what) == (name, what)


def test_a_list_that_is_not_json_is_one_line_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERRAPORT_ALLOWED_ORIGINS", "https://a.example")
    with pytest.raises(SettingsError) as raised:
        read_settings({})
    what = """got 'https://a.example', expected a JSON list such as ["one", "two"]"""
    assert str(raised.value) == f"allowed_origins: {what}"


def test_the_name_is_the_one_that_was_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"max_radius_m": -1.0}
    assert typed_name("max_radius_m", NAMES, given) == "--max-radius"
    assert typed_name("token", NAMES, given) == "--token"  # none was given: what to give
    assert typed_name("idle_timeout_s", NAMES, given) == "TERRAPORT_IDLE_TIMEOUT_S"
    Path(".env").write_text("TERRAPORT_TOKEN=x\n")
    assert typed_name("token", NAMES, given) == "TERRAPORT_TOKEN"


def test_variables_that_are_no_settings_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERRAPORT_MAX_BURST_BYTES", "1")
    monkeypatch.setenv("TERRAPORT_PORT", "1")
    assert "TERRAPORT_MAX_BURST_BYTES" in unknown_variables()
    assert "TERRAPORT_PORT" not in unknown_variables()


def test_the_command_has_the_options_that_errors_name() -> None:
    app = typer.Typer()
    register(app)
    taken = {name for parameter in typer.main.get_command(app).params for name in parameter.opts}
    assert {name for name in _OPTIONS.values() if name.startswith("--")} <= taken
    assert set(_OPTIONS) <= set(Settings.model_fields)
