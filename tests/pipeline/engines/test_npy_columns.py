"""Arrays written and read in parts are ordinary NPY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter


@pytest.mark.parametrize("dtype", ["<f8", "<u2", ">i4", "u1"])
@pytest.mark.parametrize("row_shape", [(), (3,)])
def test_numpy_reads_what_was_appended(
    tmp_path: Path, dtype: str, row_shape: tuple[int, ...]
) -> None:
    rows = np.arange(60).reshape(-1, *row_shape).astype(dtype)
    with NpyWriter(tmp_path / "a.npy", dtype, row_shape) as writer:
        writer.append(rows[:7])
        writer.append(rows[7:7])
        writer.append(rows[7:])
    loaded = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert loaded.dtype == rows.dtype
    np.testing.assert_array_equal(loaded, rows)


def test_structured_rows_with_many_fields(tmp_path: Path) -> None:
    dtype = np.dtype([("position", "<f8", (3,)), *((f"a{i}", "<f4") for i in range(40))])
    rows = np.zeros(5, dtype=dtype)
    rows["position"] = np.arange(15).reshape(5, 3)
    with NpyWriter(tmp_path / "a.npy", dtype) as writer:
        writer.append(rows)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), rows)
    np.testing.assert_array_equal(NpyReader(tmp_path / "a.npy").read(1, 3), rows[1:3])


def test_nothing_appended_is_an_empty_array(tmp_path: Path) -> None:
    with NpyWriter(tmp_path / "a.npy", np.float32, (3,)):
        pass
    assert np.load(tmp_path / "a.npy").shape == (0, 3)
    assert list(NpyReader(tmp_path / "a.npy").blocks(10)) == []


def test_rows_of_another_shape_are_refused(tmp_path: Path) -> None:
    writer = NpyWriter(tmp_path / "a.npy", np.float32, (3,))
    with pytest.raises(ValueError, match=r"rows of shape \(2,\), expected \(3,\)"):
        writer.append(np.zeros((4, 2)))


def test_a_file_that_was_not_closed_cannot_be_read(tmp_path: Path) -> None:
    def fail() -> None:
        with NpyWriter(tmp_path / "a.npy", np.float32) as writer:
            writer.append(np.zeros(4))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    with pytest.raises(ValueError, match="magic"):
        NpyReader(tmp_path / "a.npy")


def test_blocks_give_every_row_once(tmp_path: Path) -> None:
    rows = np.arange(25 * 2).reshape(25, 2)
    np.save(tmp_path / "a.npy", rows)
    reader = NpyReader(tmp_path / "a.npy")
    assert len(reader) == 25
    blocks = list(reader.blocks(10))
    assert [first for first, _ in blocks] == [0, 10, 20]
    np.testing.assert_array_equal(np.concatenate([block for _, block in blocks]), rows)


def test_a_file_cut_short_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(100))
    whole = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(whole[:-1])
    with pytest.raises(ValueError, match=r"927 bytes, expected 928"):
        NpyReader(tmp_path / "a.npy")


def test_fortran_order_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asfortranarray(np.zeros((4, 3))))
    with pytest.raises(ValueError, match="Fortran order"):
        NpyReader(tmp_path / "a.npy")
