"""The table of labels: what is written, and every way in which what comes back can be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.errors import LabelFileError
from terraport_pipeline.region_table import (
    read_label_changes,
    region_rows,
    region_table_text,
)
from terraport_store import MAX_LABEL_LENGTH, RegionNames, label_fault

ORIGIN = (500_000.0, 8_000_000.0, 100.0)
DOCUMENT: dict[str, Any] = {
    "next_stable_id": 10,
    "regions": [
        {"id": 0, "stable_id": 4, "area_m2": 12.5, "faces": 7},
        {
            "id": 1,
            "stable_id": 2,
            "label": "rock",
            "area_m2": 99.25,
            "plan_area_m2": 88.5,
            "volume": {
                "above_m3": 7.0,
                "below_m3": 0.5,
                "uncertainty_m3": 1.25,
                "objects_m3": 0.0,
                "overhang_m3": 2.0,
            },
            "faces": 40,
            "centroid": [10.0, 2.5, -3.0],
            "height_m": {"min": 1.0, "mean": 2.5, "max": 4.125},
            "mean_colour": [255.0, 127.5, 0.2],
            "slope_deg": {"mean": 11.5, "p90": 30.0},
            "roughness_m": 0.0125,
        },
        {"id": 2, "stable_id": 9, "area_m2": 12.5, "faces": 9},
    ],
}
NAMES = RegionNames.of(DOCUMENT).with_labels({4: "pile, old", 7: "gone"})

TABLE = """\
stable_id,label,region,plan_area_m2,surface_area_m2,above_toe_m3,below_toe_m3,toe_uncertainty_m3,\
objects_m3,overhang_m3,faces,east_m,north_m,height_m,lowest_m,highest_m,mean_colour,slope_deg,\
roughness_m
2,rock,1,88.5,99.25,7.0,0.5,1.25,0.0,2.0,40,500010.0,8000003.0,102.5,101.0,104.125,#ff8000,11.5,\
0.0125
4,"pile, old",0,,12.5,,,,,,7,,,,,,,,
9,,2,,12.5,,,,,,9,,,,,,,,
"""


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "regions.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_volumes_of_a_scene_that_was_built_over_another() -> None:
    """In columns at the end, for all regions or for none; 0 where no ground moved."""
    change = {"cut_m3": 12.5, "fill_m3": 0.25, "area_m2": 20.0, "uncertainty_m3": 1.5}
    first, *others = DOCUMENT["regions"]
    document = {**DOCUMENT, "change": {}, "regions": [{**first, "change": change}, *others]}
    rows = region_rows(NAMES, document, ORIGIN)
    names = ("cut_m3", "fill_m3", "change_uncertainty_m3")
    assert tuple(rows[0])[-3:] == names
    by_region = {row["region"]: [row[name] for name in names] for row in rows}
    assert by_region == {0: [12.5, 0.25, 1.5], 1: [0.0] * 3, 2: [0.0] * 3}


def test_the_table_written_out() -> None:
    """Largest first, equal areas by region; places in the survey's coordinates, z to the south."""
    assert region_table_text(region_rows(NAMES, DOCUMENT, ORIGIN)) == TABLE


def test_nothing_known_but_the_regions() -> None:
    rows = region_rows(
        RegionNames(), {"regions": [{"id": 0}, 5, {"id": 2, "centroid": "x"}]}, ORIGIN
    )
    assert [row["region"] for row in rows] == [0, 1, 2]
    assert rows[2]["east_m"] is None
    assert region_table_text([]) == "stable_id,label\n"


def test_what_was_written_is_read_back_as_no_change(tmp_path: Path) -> None:
    """The build's own label (rock) does not become the user's by a round trip."""
    for text in (TABLE, "\ufeff" + TABLE, TABLE.replace("\n", "\r\n")):
        assert read_label_changes(write(tmp_path, text), NAMES) == {4: "pile, old", 9: None}


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_of_spreadsheets(tmp_path: Path, delimiter: str) -> None:
    rows = [
        ["Label", "area", " Stable_ID "],
        ["  haul road ", "1,5", "2"],
        ["", "", ""],
        ["", "", "9"],
    ]
    if delimiter == ",":
        rows[1][1] = '"1,5"'
    text = "\n".join(delimiter.join(row) for row in rows)
    assert read_label_changes(write(tmp_path, text), NAMES) == {2: "haul road", 9: None}


def test_quotes_and_other_scripts(tmp_path: Path) -> None:
    text = 'stable_id,label\n2,"Süd ""A"", 石"\n'
    assert read_label_changes(write(tmp_path, text), NAMES) == {2: 'Süd "A", 石'}


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("", 1, "nothing in it, expected a header and rows"),
        ("\n\n", 1, "nothing in it"),
        ("id,label\n", 1, "columns 'id', 'label', expected 'stable_id' among them once"),
        ("stable_id,name\n", 1, "expected 'label' among them once"),
        ("stable_id,label,label\n", 1, "expected 'label' among them once"),
        ("stable_id,label\n2,x\nseven,y\n", 3, "stable id 'seven', expected one of the scene's 3"),
        ("stable_id,label\n3,x\n", 2, "stable id '3', expected one of the scene's 3 (2 to 9)"),
        ("stable_id,label\n7,x\n", 2, "stable id '7', expected one of"),
        ("stable_id,label\n-2,x\n", 2, "stable id '-2'"),
        ("stable_id,label\n2.0,x\n", 2, "stable id '2.0'"),
        ("stable_id,label\n٢,x\n", 2, "stable id '٢'"),
        ("stable_id,label\n,x\n", 2, "stable id ''"),
        ("stable_id,label\n2,x\n\n2,y\n", 4, "stable id 2 a second time (first in line 2)"),
        ("stable_id,label\n2,a,b\n", 2, "3 columns, expected 2 as in the first line"),
        ("stable_id,label\n2\n", 2, "1 columns, expected 2"),
        (f"stable_id,label\n2,{'x' * 257}\n", 2, "a label of 257 characters, expected at most 256"),
        ('stable_id,label\n2,"a\nb"\n', 3, "control character U+000A"),
        ('stable_id,label\n2,"open\n', 2, "no CSV"),
        ('stable_id,label\n2,"a"b\n', 2, "no CSV"),
        (b"stable_id,label\n2,S\xfcd\n", 2, "byte 0xfc is not UTF-8"),
        (b"\xff\xfes\x00t\x00", 1, "byte 0xff is not UTF-8"),
        (b"stable_id,label\n2,a\x00b\n", 2, "control character U+0000"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, text: str | bytes, line: int, says: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(LabelFileError) as caught:
        read_label_changes(path, NAMES)
    assert (caught.value.path, caught.value.line) == (path, line)
    assert says in caught.value.reason
    assert str(caught.value).startswith(f"{path} line {line}: ")
    assert caught.value.advice in str(caught.value)


def test_a_file_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terraport_pipeline.region_table.MAX_LABEL_FILE_BYTES", 20)
    with pytest.raises(LabelFileError, match="more than 20 bytes"):
        read_label_changes(write(tmp_path, "stable_id,label\n2,xxx\n"), NAMES)


good_labels = st.text(min_size=1, max_size=MAX_LABEL_LENGTH).filter(lambda t: not label_fault(t))


@given(st.dictionaries(st.sampled_from([4, 2, 9]), good_labels))
@settings(max_examples=100)
def test_any_label_survives_the_round_trip(
    tmp_path_factory: pytest.TempPathFactory, labels: dict[int, str]
) -> None:
    names = RegionNames.of(
        {**DOCUMENT, "regions": [{**r, "label": None} for r in DOCUMENT["regions"]]}
    )
    named = names.with_labels(labels)
    text = region_table_text(region_rows(named, DOCUMENT, ORIGIN))
    path = write(tmp_path_factory.getbasetemp(), text)
    expected = {number: labels.get(number) for number in (4, 2, 9)}
    assert read_label_changes(path, names) == expected


@given(st.binary(max_size=60))
@settings(max_examples=200)
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    path = write(tmp_path_factory.getbasetemp(), b"stable_id,label\n" + data)
    try:
        changes = read_label_changes(path, NAMES)
    except LabelFileError:
        return
    assert set(changes) <= {4, 2, 9}
