"""Settings: ranges, refusals, and the page that lists them."""

from __future__ import annotations

import re
from pathlib import Path

import pydantic
import pytest

from terraport_server.errors import SettingsError
from terraport_server.settings import ENV_PREFIX, Settings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "topics" / "limits.md"


def listed() -> dict[str, str]:
    """Default by setting, as the page's tables say."""
    rows = {}
    service = PAGE.read_text().split("## The Python SDK")[0]
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


def test_every_session_limit_comes_from_a_setting(tmp_path: Path) -> None:
    changed = Settings(
        scenes_dir=tmp_path,
        release_factor=2.0,
        max_radius_m=70.0,
        max_message_bytes=5000,
        max_messages_per_s=3.0,
        max_held_segments=5,
        max_plan_segments=6,
        max_credit_bytes=7,
        max_picks=2,
        handshake_timeout_s=1.5,
        idle_timeout_s=2.5,
        reconnect_after_ms=40,
        group_routing="query",
    ).session_limits("name")
    default = Settings().session_limits("terraport")
    for name in type(changed).__dataclass_fields__:
        assert getattr(changed, name) != getattr(default, name), name


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
        ("release_factor", 0.9),
        ("port", 70_000),
        ("max_sessions", 0),
        ("max_message_bytes", 2 << 20),
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


def test_every_bound_of_groups_comes_from_a_setting() -> None:
    changed = Settings(
        max_groups=3,
        max_groups_per_client=2,
        max_group_members=4,
        group_absence_s=5.0,
        group_deadline_s=6.0,
    ).group_limits()
    default = Settings().group_limits()
    for name in type(changed).__dataclass_fields__:
        assert getattr(changed, name) != getattr(default, name), name


def test_where_groups_can_be_joined() -> None:
    assert Settings().groups_served == "here"
    assert Settings(group_routing="query").groups_served == "query"
    assert Settings(group_routing="off").groups_served == "none"
    for routing in ("process", "query", "off"):
        assert Settings(group_routing=routing, workers=2).groups_served == "none"
