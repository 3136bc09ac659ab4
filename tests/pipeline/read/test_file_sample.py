"""Pieces of large files: which are read, and that they are those of the file."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pipeline.indexed_files import write_chunks
from pipeline.laz_files import Hill, las_data, write_laz

from terraport_payload.types import Float64
from terraport_pipeline.engines.readers import read_pcd, read_ply
from terraport_pipeline.engines.readers.file_sample import (
    first_chunks,
    spread_pieces,
    text_sample,
    text_share,
)
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.survey_format import find_format
from terraport_pipeline.engines.readers.survey_stream import open_stream

HILL = Hill(2000)


@pytest.mark.parametrize("share", [0.01, 0.05, 0.3, 0.5, 0.99])
def test_pieces_hold_about_the_share_and_lie_all_over(share: float) -> None:
    rows = np.random.default_rng(2).integers(10, 60, 1000)
    chosen = spread_pieces(rows, share)
    assert rows[chosen].sum() / rows.sum() == pytest.approx(share, abs=0.002)
    tenths = np.array([rows[part][chosen[part]].sum() for part in np.split(np.arange(1000), 10)])
    assert tenths.max() <= tenths.min() + 60 + 0.2 * tenths.mean()


def test_one_piece_at_least() -> None:
    assert spread_pieces(np.array([0, 3, 9]), 0.01).tolist() == [False, False, True]
    assert spread_pieces(np.array([5]), 1.0).tolist() == [True]
    assert spread_pieces(np.zeros(0, np.int64), 0.5).tolist() == []
    assert not spread_pieces(np.zeros(3, np.int64), 0.5).any()


def test_what_has_no_pieces_is_read_from_its_beginning() -> None:
    chunks = [StreamChunk(np.full((2, 3), float(i)), {}, 2) for i in range(10)]
    first = list(first_chunks(chunks, 20, 0.25))
    assert [float(chunk.points[0, 0]) for chunk in first] == [0.0, 1.0, 2.0]
    assert len(list(first_chunks(chunks, 20, 0.01))) == 1


def _points(path: Path, share: float) -> Float64:
    with open_stream(path, find_format(path), share=share) as stream:
        return np.concatenate([chunk.points for chunk in stream.chunks()])


def test_chunks_of_laz_that_are_spread_over_the_file(tmp_path: Path) -> None:
    las = las_data(HILL)
    rows = np.split(np.arange(2000), 40)
    write_chunks(tmp_path / "a.laz", las, rows)
    whole = np.stack([las.x, las.y, las.z], axis=1)
    some = _points(tmp_path / "a.laz", 0.1)
    assert len(some) == 200
    near = np.abs(whole - some[:, None]).max(axis=2)
    numbers = near.argmin(axis=1)
    assert near.min(axis=1).max() < 1e-6
    assert np.diff(np.unique(numbers // 50)).tolist() == [10, 10, 10]


def test_uncompressed_las_and_laz_of_one_chunk(tmp_path: Path) -> None:
    las_data(HILL).write(tmp_path / "a.las")
    write_laz(tmp_path / "b.laz", HILL)
    # A chunk, or a run of rows, is read whole: there is no smaller piece.
    assert len(_points(tmp_path / "a.las", 0.1)) == len(_points(tmp_path / "b.laz", 0.1)) == 2000


def test_parts_of_binary_ply_and_pcd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_ply, "_CHUNK_POINTS", 100)
    monkeypatch.setattr(read_pcd, "_CHUNK_POINTS", 100)
    points = np.arange(6000, dtype="<f4").reshape(2000, 3)
    names = "\n".join(f"property float {axis}" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 2000\n{names}\nend_header\n"
    (tmp_path / "a.ply").write_bytes(head.encode() + points.tobytes())
    head = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2000\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2000\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(b"# .PCD v0.7\n" + head.encode() + points.tobytes())
    for name in ("a.ply", "a.pcd"):
        some = _points(tmp_path / name, 0.1)
        assert len(some) == 200
        assert np.array_equal(np.diff(some[:, 0])[[0, 98, 100]], [3.0, 3.0, 3.0])
        assert some[0, 0] == 300 * 4
        assert some[100, 0] > 3000


def test_ply_as_text_is_read_from_its_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(read_ply, "_ASCII_CHUNK", 100)
    names = "\n".join(f"property float {axis}" for axis in "xyz")
    lines = "\n".join(f"{i} {i} {i % 7}" for i in range(1000))
    (tmp_path / "a.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 1000\n{names}\nend_header\n{lines}\n"
    )
    assert _points(tmp_path / "a.ply", 0.2)[-1, 0] == 199


def test_lines_of_a_text_with_its_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    count = 300_000
    lines = [f"{number}.25,{number % 97}.5,{number % 13}.125" for number in range(count)]
    path.write_text("x,y,z\n" + "\n".join(lines) + "\n")
    size = path.stat().st_size
    with text_sample(path, 0.25) as sample:
        assert sample.name == path.name
        head, *some = sample.read_text().splitlines()
        assert sample.stat().st_size == pytest.approx(text_share(size, 0.25) * size, rel=0.01)
    assert not sample.exists()
    assert head == "x,y,z"
    numbers = [int(line.split(".")[0]) for line in some]
    assert all(lines[number] == line for number, line in zip(numbers, some, strict=True))
    assert len(set(numbers)) == len(numbers)
    assert 0.2 < len(numbers) / count < 0.35
    points = _points(path, 0.25)
    assert len(points) == len(numbers)


def test_a_short_text_is_sampled_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n4 5 6\n")
    assert text_share(path.stat().st_size, 0.5) == 1.0
    with text_sample(path, 0.5) as sample:
        assert sample.read_text() == path.read_text()


def test_the_header_of_a_sampled_file_says_all_its_points(tmp_path: Path) -> None:
    las = las_data(HILL)
    write_chunks(tmp_path / "a.laz", las, np.split(np.arange(2000), 40))
    with laspy.open(tmp_path / "a.laz") as reader:
        assert reader.header.point_count == 2000
    with open_stream(tmp_path / "a.laz", "las", share=0.1) as stream:
        assert (stream.total, stream.skipped) == (200, 1800)
