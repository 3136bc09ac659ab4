"""Every option of ``terraport build`` goes through a whole build at least once.

The options are those that the command itself lists: one that no build below takes fails the test,
and so does a choice (``--units ft``) that none takes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import typer
from PIL import Image
from pipeline.conftest import hill_survey, survey_text
from pipeline.flat_photos import write_field
from pipeline.laz_files import Hill, write_tiles
from typer.testing import CliRunner

from terraport_pipeline.cli.build import register
from terraport_pipeline.cli.from_options import options_of
from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.errors import OptionError
from terraport_pipeline.options.profiles import PROFILES
from terraport_pipeline.workflow.build import BuildOptions
from terraport_store import read_manifest, validate_scene

SIDE = 16
SEGMENTS = {"--min-faces": "60", "--max-faces": "900"}
"""Small ones, so that a small survey has several."""

NOT_RECORDED = {
    "--output", "--name", "--skip-damaged", "--as-points", "--work", "--no-resume", "--max-memory",
    "--threads", "--tile-depth", "--cluster", "--photos", "--cameras", "--profile", "--report",
    "--no-report", "--quiet", "--camera-offset",
}  # fmt: skip
"""What no field of the same name in the manifest records: it changes no byte of the scene, or the
record has it by another name."""


LENGTH_UNITS = {"--units", "--height-units"}
"""Options whose every choice is a factor in one table: tests of reading take them all."""


@dataclass(frozen=True)
class Build:
    """An input, the options that it is built with, and what shows that they were followed."""

    make: Callable[[Path, ExitStack], Path]
    """Writes the input into a folder, and returns it."""
    options: Mapping[str, str]
    """By flag; the values of one with several are separated by blanks, ``{}`` is the folder."""
    shows: Callable[[Path, Mapping[str, Any]], bool] = lambda _scene, _manifest: True
    """Takes the scene and its manifest."""


def write_model(folder: Path, _: ExitStack) -> Path:
    """A textured hill, with y up."""
    x, y = np.meshgrid(np.arange(SIDE + 1.0), np.arange(SIDE + 1.0))
    height = 2.0 * np.exp(-((x - 8) ** 2 + (y - 6) ** 2) / 30)
    at = np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, -1) + 1
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    levels = np.random.default_rng(1).integers(0, 255, (4, 4, 3)).astype(np.uint8)
    Image.fromarray(levels).resize((64, 64)).save(folder / "t.png")
    (folder / "model.mtl").write_text("newmtl M\nmap_Kd t.png\n")
    lines = ["mtllib model.mtl", "usemtl M"]
    places = np.stack([x, height, -y], axis=2).reshape(-1, 3)
    lines += [f"v {east:g} {up:.5f} {south:g}" for east, up, south in places]
    lines += [f"vt {east / SIDE:.5f} {-south / SIDE:.5f}" for east, _, south in places]
    faces = [*zip(a, b, d, strict=True), *zip(a, d, c, strict=True)]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in faces]
    (folder / "model.obj").write_text("\n".join(lines) + "\n")
    return folder / "model.obj"


def write_upright_model(folder: Path, _: ExitStack) -> Path:
    """The hill without a texture, as PLY: colours at its vertices, z up."""
    mesh = trimesh.load_mesh(write_model(folder, _), process=False)
    places = mesh.vertices[:, [0, 2, 1]] * [1, -1, 1]
    colours = np.where(places[:, :1] < SIDE / 2, [[190, 60, 40, 255]], [[60, 110, 50, 255]])
    path = folder / "upright.ply"
    trimesh.Trimesh(places, mesh.faces, vertex_colors=colours, process=False).export(path)
    return path


def write_text(folder: Path, _: ExitStack) -> Path:
    path = folder / "hill.xyz"
    path.write_text(survey_text(hill_survey(1200)).partition("\n")[2], encoding="ascii")
    return path


def write_folder(folder: Path, _: ExitStack) -> Path:
    tiles = write_tiles(folder / "tiles", Hill(2400), tiles=2)
    tiles[3].write_bytes(b"")
    return folder / "tiles"


def write_photos(folder: Path, _: ExitStack) -> Path:
    return write_field(folder, spacing_m=0.8)


def with_cluster(folder: Path, opened: ExitStack) -> Path:
    distributed = pytest.importorskip("distributed", reason="needs terraport[cluster]")
    cluster = opened.enter_context(
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, scheduler_port=0
        )
    )
    (folder / "address").write_text(cluster.scheduler_address)
    return write_text(folder, opened)


def with_encoder(folder: Path, opened: ExitStack) -> Path:
    try:
        require_encoder()
    except OptionError as error:
        pytest.skip(str(error))
    return write_model(folder, opened)


def is_placed(_: Path, manifest: Mapping[str, Any]) -> bool:
    """A shift and a CRS: 8 m east and north of the model's corner is the scene's origin."""
    east, north, _height = manifest["origin"]
    return (east, north) == (500_008, 5_200_008) and manifest["crs"]["epsg"] == 32632


BUILDS: dict[str, Build] = {
    "mesh": Build(
        write_model,
        {
            "--output": "{}/scene", "--name": "Hill 7", "--work": "{}/work", "--no-report": "",
            "--up": "y", "--shift": "500000 5200000 -3.5", "--crs": "EPSG:32632", "--levels": "2",
            "--texture-from": "mesh", "--texture-format": "png", "--texel-size": "0.5",
            "--base-texture": "256", "--base-faces": "200", "--engine": "grid",
            "--grid-cell-m": "6", "--max-extent-m": "9", **SEGMENTS,
        },
        lambda scene, manifest: is_placed(scene, manifest)
        and manifest["name"] == "Hill 7"
        and (scene.parent / "work").is_dir(),
    ),
    "folder": Build(
        write_folder,
        {
            "--skip-damaged": "", "--keep-noise": "", "--units": "ft", "--height-units": "us-ft",
            "--max-points": "1000", "--extent": "641190 8594690 641205 8594720",
            "--segment-by": "grade", "--engine": "means", "--means-spread": "0.5",
            "--base-from": "detail", "--no-report": "", "--quiet": "", **SEGMENTS,
        },
    ),
    "text": Build(
        write_text,
        {
            "--columns": "x,y,z,r,g,b,-", "--outlier-ratio": "2.5", "--base-from": "poisson",
            "--base-depth": "6", "--detail-depth": "6", "--base-faces": "500",
            "--trim-spacings": "3", "--island-faces": "20", "--point-weight": "3",
            "--tile-depth": "12", "--threads": "1", "--max-memory": "2G", "--no-resume": "",
            "--engine": "borders", "--region-size": "8", "--units": "m", "--height-units": "ft",
            "--profile": "desktop", "--no-report": "", **SEGMENTS,
        },
    ),
    "points of a mesh": Build(
        write_upright_model,
        {
            "--as-points": "", "--units": "us-ft", "--height-units": "m",
            "--texture-from": "vertex", "--texture-format": "jpeg",
            "--texture-quality": "60", "--profile": "phone",
            "--engine": "felzenszwalb", "--felzenszwalb-scale": "50",
            "--small-region-share": "0.01", "--no-report": "", **SEGMENTS,
        },
        lambda _, manifest: manifest["build"]["options"]["texture"]["texel_m"] == 0.02,
    ),
    "photos": Build(
        write_photos,
        {
            "--photos": "{}/photos", "--cameras": "{}/colmap",
            "--camera-offset": "0,0,0.25", "--texture-from": "photos",
            "--texture-format": "webp", "--texture-quality": "70", "--base-faces": "400",
            "--no-report": "", **SEGMENTS,
        },
        lambda _, manifest: manifest["build"]["options"]["texture"]["camera_offset"]
        == [0, 0, 0.25]
        and manifest["build"]["options"]["texture"]["photos"]["count"] == 5,
    ),
    "graph": Build(
        write_upright_model,
        {
            "--up": "z", "--engine": "graph", "--graph-cut-drop": "0.4", "--streamed": "segments",
            "--no-report": "", **SEGMENTS,
        },
    ),
    "pools": Build(
        write_upright_model,
        {
            "--engine": "tpa", "--tpa-region-threshold": "0.6", "--tpa-segment-threshold": "0.1",
            "--streamed": "pools", "--no-report": "",
        },
    ),
}  # fmt: skip
"""Grouped, as each build takes one or two seconds of computing."""

LONG_BUILDS: dict[str, Build] = {
    "cluster": Build(with_cluster, {"--cluster": "{address}", "--report": ""},
        lambda scene, _: (scene / "report.html").is_file(),
    ),
    "compressed": Build(
        with_encoder,
        {
            "--up": "y", "--profile": "headset", "--texture-from": "vertex",
            "--texture-format": "ktx2", "--no-report": "",
        },
    ),
}  # fmt: skip


def flags() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every option of the command with its choices; the argument is what every build has."""
    choices = {field.flags[0]: field.choices for _, field in options_of(BuildOptions)}
    choices["--profile"] = tuple(PROFILES)
    app = typer.Typer(add_completion=False)
    register(app)
    for parameter in typer.main.get_command(app).params:
        if parameter.param_type_name == "option":
            # A switch that is on by default is tried turned off.
            flag, *_ = parameter.secondary_opts or parameter.opts
            yield flag, choices.get(flag, ())


def test_every_option_and_every_choice_is_built_with() -> None:
    taken = {
        (flag, value)
        for build in (*BUILDS.values(), *LONG_BUILDS.values())
        for flag, value in build.options.items()
    }
    listed = list(flags())
    assert len(listed) > 40
    untested = {flag for flag, _ in listed} - {flag for flag, _ in taken}
    assert not untested, f"add {untested} to BUILDS"
    listed_choices = {
        (flag, one) for flag, choices in listed for one in choices if flag not in LENGTH_UNITS
    }
    untested_choices = listed_choices - taken
    assert not untested_choices, f"add {untested_choices} to BUILDS"


def as_words(value: Any) -> list[str]:
    values = value if isinstance(value, list) else [value]
    return [
        f"{one:.10g}" if isinstance(one, int | float) and not isinstance(one, bool) else str(one)
        for one in values
    ]


def recorded_words(options: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Every value that a manifest records, by the name of its field, as words of the command."""
    for name, value in options.items():
        if isinstance(value, dict):
            yield from recorded_words(value)
        else:
            yield name, as_words(value)


def words_of(value: str) -> list[str]:
    """Spell numbers of the command line as :func:`as_words` does."""
    words = value.replace(",", " ").split() or ["True"]
    return [f"{float(w):.10g}" if w.lstrip("-")[:1].isdigit() else w for w in words]


@pytest.mark.parametrize(
    "name", [*BUILDS, *(pytest.param(name, marks=pytest.mark.thorough) for name in LONG_BUILDS)]
)
def test_a_scene_is_built_with_each_option(name: str, tmp_path: Path) -> None:
    build = (BUILDS | LONG_BUILDS)[name]
    with ExitStack() as opened:
        survey = build.make(tmp_path, opened)
        address = tmp_path / "address"
        arguments = [str(survey)]
        for flag, value in ({"--output": "{}/scene"} | dict(build.options)).items():
            text = value.replace("{}", str(tmp_path))
            if "{address}" in text:
                text = address.read_text()
            arguments += [flag, *text.split(" ")] if text and flag != "--name" else [flag]
            arguments += [text] if flag == "--name" else []
        app = typer.Typer()
        register(app)
        result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    scene = tmp_path / "scene"
    assert validate_scene(scene) == []
    manifest = json.loads((scene / "scene.json").read_text())
    assert read_manifest(scene).counts.segments > 0
    assert build.shows(scene, manifest)
    recorded = list(recorded_words(manifest["build"]["options"]))
    named = {field.flags[0]: field.name for _, field in options_of(BuildOptions)}
    for flag, value in build.options.items():
        if flag not in NOT_RECORDED:
            assert (named[flag], words_of(value)) in recorded, flag
