from __future__ import annotations

from dataclasses import fields, replace

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.cli import build as build_cli
from terraport_pipeline.option import option_fields
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.profiles import PROFILES, texture_options
from terraport_pipeline.stages import texture
from terraport_pipeline.workflow.build import BuildOptions


def built_with(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> BuildOptions:
    taken: list[BuildOptions] = []

    def keep(options: BuildOptions, *_: object, **__: object) -> None:
        taken.append(options)
        raise typer.Exit(0)

    monkeypatch.setattr(build_cli, "_build", keep)
    monkeypatch.setattr(build_cli, "expand_input", lambda given: [given])  # no file is read
    app = typer.Typer()
    build_cli.register(app)
    result = CliRunner().invoke(app, list(arguments))
    assert taken, result.output
    return taken[0]


def test_every_value_is_of_an_option_and_allowed() -> None:
    of_textures = {field.key for field in option_fields(texture.Options)}
    of_segments = {field.key: field.name for field in option_fields(segment.Options)}
    for profile, values in PROFILES.items():
        texture_options(profile, texture.Options())
        own = {of_segments[k]: v for k, v in values.items() if k in of_segments}
        replace(segment.Options(), **own)
        assert set(values) <= of_textures | set(of_segments)


def test_a_profile_gives_way_to_what_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = built_with(monkeypatch, "pit.laz")
    headset = built_with(monkeypatch, "pit.laz", "--profile", "headset", "--max-faces", "9000")
    differing = [
        field.name
        for field in fields(BuildOptions)
        if getattr(plain, field.name) != getattr(headset, field.name)
    ]
    assert differing == ["segment"], "no photos, no textures"
    assert (headset.segment.min_faces, headset.segment.max_faces) == (4000, 9000)


def test_textures_take_it_where_there_are_photos(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("pit.laz", "--photos", "flight", "--profile", "phone", "--texture-quality", "70")
    textures = built_with(monkeypatch, *arguments).texture
    assert textures is not None
    options = textures.options
    assert (options.kind, options.quality, options.texel_m) == ("ktx2", 70, 0.02)
