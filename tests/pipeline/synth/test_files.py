from __future__ import annotations

import dataclasses
import hashlib
import shutil
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest

from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.synth import files as module
from terraport_pipeline.synth import quarry as maker
from terraport_pipeline.synth.files import load_options, truth_path, write_quarry
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise

OPTIONS = QuarryOptions(points=5_000, seed=2, size_m=120.0)


def sorted_rows(points: np.ndarray) -> np.ndarray:
    return np.lexsort(np.round(points, 6).T)


def test_the_file_read_back_is_the_quarry(tmp_path: Path) -> None:
    path = tmp_path / "quarry.laz"
    written = write_quarry(OPTIONS, path)
    quarry = synthesise(OPTIONS)
    survey = read_survey(path)
    # A survey has an order of its own, whatever that of its file is.
    read, made = sorted_rows(survey.points), sorted_rows(quarry.survey.points)
    np.testing.assert_allclose(survey.points[read], quarry.survey.points[made], rtol=0, atol=1e-9)
    assert survey.colours is not None
    assert quarry.survey.colours is not None
    np.testing.assert_array_equal(survey.colours[read], quarry.survey.colours[made])
    np.testing.assert_array_equal(
        survey.attributes["grade"][read], quarry.survey.attributes["grade"][made]
    )
    assert list(survey.attributes) == ["grade"]
    assert survey.crs is not None
    assert survey.crs.epsg == 32735
    assert survey.warnings == ()
    assert written.points == 5_000
    assert sum(written.material_points.values()) == 5_000
    assert written.survey_bytes == path.stat().st_size
    with laspy.open(path) as reader:
        assert str(reader.header.version) == "1.4"
        assert reader.header.point_format.id == 7


def test_the_truth_file_has_what_it_says(tmp_path: Path) -> None:
    path = tmp_path / "quarry.laz"
    write_quarry(OPTIONS, path)
    quarry = synthesise(OPTIONS)
    assert truth_path(path) == tmp_path / "quarry.truth.npz"
    with np.load(truth_path(path)) as truth:
        np.testing.assert_array_equal(truth["material"], quarry.material)
        np.testing.assert_allclose(
            truth["truth_m"] + truth["origin"], quarry.truth, rtol=0, atol=1e-4
        )
        names = dict(line.split(" ") for line in truth["material_names"].tolist())
    assert names == {str(int(m)): m.name.lower() for m in Material}
    assert load_options(truth_path(path)) == OPTIONS


def test_equal_options_give_equal_bytes(tmp_path: Path) -> None:
    digests = set()
    for name in ("a", "b"):
        path = tmp_path / f"{name}.laz"
        write_quarry(OPTIONS, path)
        both = path.read_bytes() + truth_path(path).read_bytes()
        digests.add(hashlib.sha256(both).hexdigest())
    assert len(digests) == 1


def test_several_chunks_are_written_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maker, "CHUNK_POINTS", 2_000)
    path = tmp_path / "quarry.laz"
    write_quarry(OPTIONS, path)
    np.testing.assert_allclose(
        laspy.read(path).xyz, synthesise(OPTIONS).survey.points, rtol=0, atol=1e-9
    )


def test_files_that_are_there_stay_unless_told(tmp_path: Path) -> None:
    path = tmp_path / "quarry.laz"
    truth_path(path).write_text("mine")
    with pytest.raises(OptionError, match=r"quarry.truth.npz: exists already"):
        write_quarry(OPTIONS, path)
    assert truth_path(path).read_text() == "mine"
    assert not path.exists()
    write_quarry(OPTIONS, path, overwrite=True)
    assert path.exists()


@pytest.mark.parametrize(
    ("name", "message"), [("quarry.ply", "ends in .laz or .las"), ("no/a.laz", "no such folder")]
)
def test_bad_names_are_refused_before_work(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        write_quarry(OPTIONS, tmp_path / name)


def test_too_little_room_is_said_before_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(ResourceError, match="MB free, about"):
        write_quarry(OPTIONS, tmp_path / "a.laz")


def test_a_disk_that_fills_up_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_write_truth", full)
    with pytest.raises(ResourceError, match="No space left on device"):
        write_quarry(OPTIONS, tmp_path / "a.laz")
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_leaves_the_old_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.laz"
    write_quarry(OPTIONS, path)
    before = path.read_bytes()

    class Stopping:
        def start(self, stage: str, total: float | None, unit: str) -> None: ...

        def advance(self, n: float) -> None:
            raise KeyboardInterrupt

        def done(self, facts: object) -> None: ...

    with pytest.raises(KeyboardInterrupt):
        write_quarry(
            dataclasses.replace(OPTIONS, seed=3), path, overwrite=True, progress=Stopping()
        )
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.laz", "a.truth.npz"]
