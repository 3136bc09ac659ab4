"""Reading the benchmark: folder and archive, numbers of segments, damage."""

from __future__ import annotations

import tarfile
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import SurveyError
from terraport_research.princeton import mode_of_counts, read_benchmark

OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


@pytest.fixture
def benchmark(tmp_path: Path) -> Path:
    """Two cups, and a spring that nobody cut."""
    root = tmp_path / "psb"
    for number in (21, 23, 261):
        (root / "data/off").mkdir(parents=True, exist_ok=True)
        (root / f"data/off/{number}.off").write_text(OFF)
    for number, cuts in ((21, ["0\n0\n", "0\n1\n", "3\n2\n"]), (23, ["0\n1\n"])):
        folder = root / f"data/seg/Benchmark/{number}"
        folder.mkdir(parents=True)
        for j, text in enumerate(cuts):
            (folder / f"{number}_{j}.seg").write_text(text)
    (root / "util/parameters").mkdir(parents=True)
    (root / "util/parameters/nSeg-ByModel.txt").write_text("\n".join(["9"] * 21 + ["0", "0"]))
    return root


def test_a_folder_and_its_archive_are_the_same(benchmark: Path, tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "psb.tar.xz", "w:xz") as tar:
        for name in ("data", "util"):
            tar.add(benchmark / name, name)
    for path in (benchmark, tmp_path / "psb.tar.xz"):
        found = read_benchmark(path)
        assert found.numbers == (21, 23)
        first, second = found.models()
        assert (first.category, first.vertices.shape, first.faces.tolist()) == (
            "Cup", (4, 3), [[0, 1, 2], [0, 2, 3]],
        )  # fmt: skip
        assert [labels.tolist() for labels in first.people] == [[0, 0], [0, 1], [3, 2]]
        assert first.counts("by-segmentation") == (1, 2, 2)
        assert first.counts("by-model") == (9, 9, 9)  # the file's
        assert second.counts("by-model") == (2,)  # a 0 there: from the people
        assert first.counts("by-category") == (2, 2, 2)
        assert first.counts("by-dataset") == (7, 7, 7)
        [only] = found.models((23,))
        assert only.number == 23


def test_the_commonest_closest_to_the_median() -> None:
    assert mode_of_counts([3, 3, 5, 9, 9, 4]) == 3
    assert mode_of_counts([2, 2, 8, 8, 8]) == 8
    assert mode_of_counts([2, 2, 6, 6, 7, 8, 9]) == 6


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("data/off/21.off", "OFF\n4 2 0\n0 0", "model 21: its OFF"),
        ("data/seg/Benchmark/21/21_0.seg", "0\n", "1 rows; expected 2"),
    ],
)
def test_damage_is_named(benchmark: Path, name: str, text: str, message: str) -> None:
    (benchmark / name).write_text(text)
    with pytest.raises(SurveyError, match=message):
        list(read_benchmark(benchmark).models())


def test_what_is_no_benchmark(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="not there"):
        read_benchmark(tmp_path / "none")
    with pytest.raises(SurveyError, match="no model that people have cut"):
        read_benchmark(tmp_path)
    (tmp_path / "a.tar").write_text("no tar")
    with pytest.raises(SurveyError, match="no tar archive"):
        read_benchmark(tmp_path / "a.tar")


def test_labels_are_one_a_face(benchmark: Path) -> None:
    model = next(read_benchmark(benchmark).models())
    assert all(np.issubdtype(labels.dtype, np.int32) for labels in model.people)
