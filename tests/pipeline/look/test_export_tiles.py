"""A scene as a folder of 3D Tiles, and in one file."""

from __future__ import annotations

import hashlib
import json
import struct
import zipfile
from pathlib import Path

import pytest
from glb_file import split_glb

from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.export.products import product_of
from terraport_pipeline.extent import Extent

SAMPLE = Path(__file__).resolve().parents[3] / "data" / "sample_scene"


def export(output: Path, **options):
    return export_scene(SAMPLE, ExportRequest(output, **options))


def uris(tile):
    if "content" in tile:
        yield tile["content"]["uri"]
    for child in tile.get("children", ()):
        yield from uris(child)


def test_a_folder_and_an_archive_hold_the_same(tmp_path: Path) -> None:
    written = export(tmp_path / "tiles", product="tiles", radius_m=8.0)
    packed = export(tmp_path / "bench.3tz", radius_m=8.0)
    assert written.crs == packed.crs == "Earth-centred (EPSG:4978)"
    folder = tmp_path / "tiles"
    document = json.loads((folder / "tileset.json").read_text())
    named = {"tileset.json", *uris(document["root"])}
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == named
    labelled = split_glb((folder / "segments/5.glb").read_bytes())[0]
    classes = labelled["extensions"]["EXT_structural_metadata"]["schema"]["classes"]
    assert "label" in classes["region"]["properties"]

    # The index of an archive (3TZ 1.3): viewers find a file by the hash of its name.
    data = (tmp_path / "bench.3tz").read_bytes()
    with zipfile.ZipFile(tmp_path / "bench.3tz") as archive:
        names = archive.namelist()
        assert names[-1] == "@3dtilesIndex1@"
        assert set(names[:-1]) == named
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
        index = archive.read(names[-1])
        for name in named:
            assert archive.read(name) == (folder / name).read_bytes()
    rows = [struct.unpack_from("<QQQ", index, at) for at in range(0, len(index), 24)]
    assert rows == sorted(rows)
    places = {row[:2]: row[2] for row in rows}
    for name in named:
        at = places[struct.unpack("<QQ", hashlib.md5(name.encode()).digest())]
        assert data[at : at + 4] == b"PK\x03\x04"
        assert data[at + 30 : at + 30 + len(name)].decode() == name


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "diary.txt").write_text("dear diary")
    with pytest.raises(OptionError, match=r"diary\.txt"):
        export(tmp_path / "mine", product="tiles", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    (tmp_path / "mine" / "diary.txt").rename(tmp_path / "mine" / "tileset.json")
    export(tmp_path / "mine", product="tiles", force=True)
    assert json.loads((tmp_path / "mine" / "tileset.json").read_text())["asset"]
    with pytest.raises(OptionError, match="exists already"):
        export(tmp_path / "mine", product="tiles")


@pytest.mark.parametrize(
    ("output", "options", "said"),
    [
        ("a.3tz", {"extent": Extent(0, 0, 1, 1)}, "whole scene"),
        ("a.3tz", {"regions": ("1",)}, "whole scene"),
        ("a.3tz", {"radius_m": 0.0}, "above 0"),
        ("a.3tz", {"height_shift_m": float("nan")}, "expected metres"),
        ("a.obj", {"radius_m": 5.0}, "of tiles"),
        ("a.obj", {"product": "tiles"}, r"\.3tz"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path: Path, output, options, said) -> None:
    with pytest.raises(OptionError, match=said):
        export(tmp_path / output, **options)
    assert not list(tmp_path.iterdir())


def test_an_ending_of_tiles() -> None:
    assert product_of(Path("a.3tz"), None) == "tiles"
    assert product_of(Path("a"), "tiles") == "tiles"
    with pytest.raises(OptionError):
        product_of(Path("a"), None)
