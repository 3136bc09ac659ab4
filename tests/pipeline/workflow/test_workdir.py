from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import ResourceError, WorkDirectoryError
from terraport_pipeline.stages.contract import Facts, Stored
from terraport_pipeline.workflow import workdir
from terraport_pipeline.workflow.workdir import Cost, WorkDirectory, file_digest, stage_key

COST = Cost(1.5, 2**20)
FACTS = Facts({"points": 3, "spacing_m": 0.1}, ("Something to know.",))
STORED = Stored(
    {"points": np.arange(9.0).reshape(3, 3), "empty": np.zeros((0, 2), np.uint8)},
    {"name": "x", "list": [1, 2.5, None]},
)


@pytest.fixture
def work(tmp_path: Path) -> WorkDirectory:
    return WorkDirectory(tmp_path / "work")


def test_saved_is_found_and_equal(work: WorkDirectory) -> None:
    saved = work.save("clean", "k1", STORED, FACTS, COST)
    record = work.find("clean", "k1")
    assert record == saved
    assert record is not None
    loaded = work.load(record)
    assert loaded.values == STORED.values
    for name, array in STORED.arrays.items():
        assert (loaded.arrays[name] == array).all()
        assert loaded.arrays[name].dtype == array.dtype
    assert record.facts == FACTS
    assert record.cost == COST


def test_a_result_can_be_mapped_or_read_in_part(work: WorkDirectory) -> None:
    stored = Stored({"some": np.arange(6), "none": np.zeros((0, 3))}, {"a": 1})
    record = work.save("parts", "k", stored, Facts(), Cost(1.0, 2))
    mapped = work.looked_up(record)
    assert isinstance(mapped.arrays["some"], np.memmap)
    assert mapped.arrays["some"].tolist() == work.array(record, "some").tolist() == [*range(6)]
    assert mapped.arrays["none"].shape == (0, 3)  # nothing cannot be mapped
    assert mapped.values == {"a": 1}


def test_another_key_or_stage_is_not_found(work: WorkDirectory) -> None:
    work.save("clean", "k1", STORED, FACTS, COST)
    assert work.find("clean", "k2") is None
    assert work.find("segment", "k1") is None


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts descriptors by /proc")
def test_what_is_looked_up_holds_no_file_open(work: WorkDirectory) -> None:
    """Maps of all tiles together would pass the system's limit of open files."""
    record = work.save("clean", "k1", STORED, FACTS, COST)
    before = len(list(Path("/proc/self/fd").iterdir()))
    lookups = [work.looked_up(record) for _ in range(20)]
    for lookup in lookups:
        assert sorted(lookup.arrays) == sorted(STORED.arrays)
        np.testing.assert_array_equal(lookup.arrays["points"], STORED.arrays["points"])
    assert len(list(Path("/proc/self/fd").iterdir())) <= before + 1
    assert "nothing" not in lookups[0].arrays
    points = lookups[0].arrays["points"]
    assert isinstance(points, np.memmap)


@pytest.mark.parametrize(
    "harm",
    [
        lambda folder: (folder / "points.npy").write_bytes(b"short"),
        lambda folder: (folder / "points.npy").unlink(),
        lambda folder: (folder / "stage.json").write_text("{"),
        lambda folder: (folder / "stage.json").write_text("[]"),
        lambda folder: (folder / "stage.json").unlink(),
    ],
    ids=["cut", "missing", "half a record", "another record", "no record"],
)
def test_a_damaged_result_is_not_found(work: WorkDirectory, harm: object) -> None:
    work.save("clean", "k1", STORED, FACTS, COST)
    harm(work.path / "clean")  # type: ignore[operator]
    assert work.find("clean", "k1") is None


def test_a_file_that_cannot_be_read_says_what_to_do(work: WorkDirectory) -> None:
    record = work.save("clean", "k1", STORED, FACTS, COST)
    path = work.path / "clean" / "points.npy"
    path.write_bytes(b"\0" * path.stat().st_size)
    with pytest.raises(WorkDirectoryError, match=r"points\.npy cannot be read .*--no-resume"):
        work.load(record)


def test_the_digest_follows_the_result_and_not_the_cost(work: WorkDirectory) -> None:
    first = work.save("clean", "k1", STORED, FACTS, COST).digest
    assert work.save("clean", "k2", STORED, Facts(), Cost(9.0, 1)).digest == first
    other = Stored({**STORED.arrays, "points": np.arange(9.0).reshape(9, 1)}, STORED.values)
    assert work.save("clean", "k1", other, FACTS, COST).digest != first
    other = Stored(STORED.arrays, {**STORED.values, "name": "y"})
    assert work.save("clean", "k1", other, FACTS, COST).digest != first


def test_a_failed_save_leaves_the_older_result(
    work: WorkDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    older = work.save("clean", "k1", STORED, FACTS, COST)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(workdir, "_sync", full)
    with pytest.raises(ResourceError, match=r"no space left for .*; free some, or give --work"):
        work.save("clean", "k2", STORED, FACTS, COST)
    assert work.find("clean", "k1") == older
    assert sorted(path.name for path in work.path.iterdir()) == [".terraport-work", "clean"]


def test_what_a_killed_build_left_is_deleted(work: WorkDirectory) -> None:
    (work.path / ".clean.abc.tmp").mkdir()
    (work.path / ".clean.abc.tmp" / "points.npy").write_bytes(b"half")
    again = WorkDirectory(work.path)
    assert [path.name for path in again.path.iterdir()] == [".terraport-work"]


def test_a_directory_of_others_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(WorkDirectoryError, match="holds files that no build wrote"):
        WorkDirectory(tmp_path)
    with pytest.raises(WorkDirectoryError, match="is not a directory"):
        WorkDirectory(tmp_path / "thesis.txt")
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_scratch_is_gone_afterwards(work: WorkDirectory) -> None:
    seen: list[Path] = []

    def fill() -> None:
        with work.scratch() as folder:
            (folder / "big.ply").write_bytes(b"x")
            seen.append(folder)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill()
    assert not seen[0].exists()


def test_keys_differ_in_everything_that_matters() -> None:
    keys = {
        stage_key("a", "code", {"x": 1}, {"in": "1"}),
        stage_key("b", "code", {"x": 1}, {"in": "1"}),
        stage_key("a", "other", {"x": 1}, {"in": "1"}),
        stage_key("a", "code", {"x": 2}, {"in": "1"}),
        stage_key("a", "code", {"x": 1}, {"in": "2"}),
    }
    assert len(keys) == 5
    assert stage_key("a", "c", {"x": 1, "y": 2}, {}) == stage_key("a", "c", {"y": 2, "x": 1}, {})


def test_file_digest_is_of_the_bytes(tmp_path: Path) -> None:
    path = tmp_path / "f"
    path.write_bytes(b"")
    assert file_digest(path) == "2d06800538d394c2"  # XXH3-64 of nothing, by its specification
    path.write_bytes(b"a")
    assert file_digest(path) != "2d06800538d394c2"


def test_file_digest_of_ranges_is_of_their_bytes_and_places(tmp_path: Path) -> None:
    path = tmp_path / "f"
    path.write_bytes(bytes(range(100)))
    read: list[int] = []
    ranges = [(0, 10), (40, 50), (95, 200)]
    digest = file_digest(path, read.append, ranges)
    assert sum(read) == 25
    changed = bytearray(path.read_bytes())
    changed[20] = 0  # not in them
    path.write_bytes(changed)
    assert file_digest(path, None, ranges) == digest
    changed[45] = 0
    path.write_bytes(changed)
    assert file_digest(path, None, ranges) != digest
    path.write_bytes(bytes(100))
    assert file_digest(path, None, [(0, 10)]) != file_digest(path, None, [(10, 20)])


def test_records_are_readable(work: WorkDirectory) -> None:
    work.save("clean", "k1", STORED, FACTS, COST)
    record = json.loads((work.path / "clean" / "stage.json").read_text())
    assert record["cost"] == {"seconds": 1.5, "peak_bytes": 2**20, "steps": []}
    assert record["facts"]["warnings"] == ["Something to know."]


def test_a_folder_sealed_is_the_result_saved(tmp_path: Path) -> None:
    arrays = {"a": np.arange(12.0).reshape(4, 3), "b": np.arange(5, dtype=np.uint8)}
    facts, cost = Facts({"n": 1}), Cost(1.0, 2)
    saved = WorkDirectory(tmp_path / "one").save("s", "k", Stored(arrays, {"v": 1}), facts, cost)
    work = WorkDirectory(tmp_path / "two")
    with work.beside("s") as folder:
        for name, array in arrays.items():
            np.save(folder / f"{name}.npy", array)
        sealed = work.seal(folder, "s", "k", Stored({}, {"v": 1}), facts, cost)
    assert sealed.digest == saved.digest
    assert sealed.files == saved.files
    assert work.find("s", "k") == sealed
    assert work.names("s") == ["s"]
    work.forget("s")
    assert work.find("s", "k") is None
