from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order

from terraport_pipeline.engines.readers import read_ptx
from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey

ANGLE = 0.4
TURN = np.array(
    [[np.cos(ANGLE), np.sin(ANGLE), 0], [-np.sin(ANGLE), np.cos(ANGLE), 0], [0, 0, 1]]
) @ np.array([[1, 0, 0], [0, np.cos(0.01), np.sin(0.01)], [0, -np.sin(0.01), np.cos(0.01)]])


def scan(points, colours, position, *, turn=TURN, coloured=True, columns=10) -> list[str]:
    """A scan whose every fifth cell has no return."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = turn, position
    local = (points - position) @ turn.T
    lines = [str(columns), str(len(points) // columns)]
    lines += [" ".join(f"{v:.6f}" for v in row) for row in (position, *turn, *matrix)]
    for n, (point, colour) in enumerate(zip(local, colours, strict=True)):
        values = [*(f"{v:.6f}" for v in point), f"{n % 11 / 10:.6f}", *map(str, colour)]
        if n % 5 == 0:
            values = ["0", "0", "0", "0.500000", "0", "0", "0"]
        lines.append(" ".join(values[: 7 if coloured else 4]))
    return lines


def there(count: int) -> np.ndarray:
    return np.arange(count) % 5 != 0


@pytest.mark.parametrize("end", ["\n", " \r\n"])
@pytest.mark.parametrize("name", ["a.ptx", "a.txt"])
def test_scans_come_under_their_matrices_without_empty_cells(
    tmp_path, sample, name: str, end: str, monkeypatch
) -> None:
    monkeypatch.setattr(read_ptx, "_CHUNK_ROWS", 70)
    position = np.array([641_020.0, 8_594_010.0, 1_230.0])
    lines = scan(sample.points[:200], sample.colours[:200], position)
    lines += scan(sample.points[200:], sample.colours[200:], position + 4.0, turn=TURN.T)
    path = tmp_path / name
    path.write_text("".join(line + end for line in lines))
    kept = there(500)
    survey = read_in_order(path, sample.points[kept])
    np.testing.assert_array_equal(survey.colours, sample.colours[kept])
    number = np.concatenate([np.arange(200), np.arange(300)]) % 11 / 10
    np.testing.assert_allclose(survey.attributes["intensity"], number[kept])
    np.testing.assert_array_equal(survey.attributes["scan"], (np.arange(500) >= 200)[kept])
    assert survey.warnings[0] == "100 of 500 cells of the scans have no return: left out."


def test_a_scan_without_colour_beside_one_with_colour_is_named(tmp_path, sample) -> None:
    position = sample.points[0]
    lines = scan(sample.points[:200], sample.colours[:200], position)
    lines += scan(sample.points[200:], sample.colours[200:], position, coloured=False)
    path = tmp_path / "a.ptx"
    path.write_text("\n".join(lines))
    survey = read_in_order(path, sample.points[there(500)])
    assert survey.colours is not None
    assert (survey.colours[160:] == 160).all()
    assert "There is no colour in scan 1: its points are grey." in survey.warnings


def test_a_position_that_the_matrix_contradicts_is_named(tmp_path, sample) -> None:
    """Both forms are written: points of the scanner, and points in place with no matrix."""
    lines = scan(sample.points, sample.colours, np.zeros(3), turn=np.eye(3))
    lines[2] = "3.000000 4.000000 0.000000"
    path = tmp_path / "a.ptx"
    path.write_text("\n".join(lines))
    survey = read_in_order(path, sample.points[there(500)])
    words = "In 1 of 1 scans the stated position differs from the matrix by up to 5.00 m"
    assert any(words in warning for warning in survey.warnings)


MIRROR = np.diag([1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda lines: lines[:300], "scan 0 ends after 290 of 500 rows"),
        (lambda lines: [*lines, "1 2 3 0.5 1 2 3"], "is not the header of scan 1"),
        (lambda lines: [*lines[:100], "1 2 3", *lines[101:]], "a row of scan 0 is not 7 numbers"),
        (lambda lines: ["0", *lines[1:]], "scan 0 has 0 x 50 cells"),
        (lambda lines: [*lines[:6], "2 0 0 0", *lines[7:]], "the matrix of scan 0"),
        (lambda lines: [*lines[:10], "1 2 3 4 5", *lines[11:]], "a row of scan 0 has 5 values"),
        (lambda lines: lines[:7], "is not the header of scan 0"),
    ],
)
def test_damage_is_named(tmp_path: Path, sample, damage, message: str) -> None:
    path = tmp_path / "a.ptx"
    path.write_text("\n".join(damage(scan(sample.points, sample.colours, sample.points[0]))))
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert message in str(caught.value)


@pytest.mark.parametrize("turn", [MIRROR, 2 * TURN], ids=["mirror", "scale"])
def test_a_matrix_that_mirrors_or_scales_is_refused(tmp_path, sample, turn) -> None:
    path = tmp_path / "a.ptx"
    path.write_text("\n".join(scan(sample.points, sample.colours, sample.points[0], turn=turn)))
    with pytest.raises(ReadError, match="expected a rotation with the translation"):
        read_survey(path)
