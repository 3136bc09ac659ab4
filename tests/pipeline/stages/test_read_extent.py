"""An extent of a survey is the same survey whichever way it was read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pipeline.indexed_files import append_lasindex, lasindex, strips, write_chunks, write_copc
from pipeline.laz_files import Hill, las_data, write_laz, write_tiles

from terraport_payload.types import Bool
from terraport_pipeline.engines.readers.survey_stream import survey_size
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context, Facts
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.stages.reading import sort, spool, strays
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles

HILL = Hill(4000)
XYZ = HILL.millimetres / 1000
EXTENT = Extent(641_205, 8_594_708.5, 641_219.25, 8_594_721)
WITHIN: Bool = EXTENT.holds(XYZ)


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks and buckets of a small survey."""
    monkeypatch.setattr(strays, "BLOCK_ROWS", 500)
    monkeypatch.setattr(sort, "BLOCK_ROWS", 500)
    monkeypatch.setattr(sort, "_BUCKET_ROWS", 200)
    monkeypatch.setattr(spool, "_SAMPLE_STEP", 10)


def columns_of(
    survey: SurveyFiles, folder: Path, max_points: int | None = None
) -> tuple[dict[str, bytes], Facts]:
    """Everything that reading writes, by file, and what it tells."""
    folder.mkdir()
    _, facts = read_streamed.run(survey, folder, Context(folder), max_points=max_points)
    return {path.name: path.read_bytes() for path in folder.iterdir()}, facts


def merged(folder: Path) -> Path:
    return write_laz(folder / "a.laz", HILL)


def tiles_with_margins(folder: Path) -> Path:
    write_tiles(folder / "tiles", HILL, margin_m=2.0)
    return folder / "tiles"


def copc(folder: Path) -> Path:
    return write_copc(folder / "a.copc.laz", las_data(HILL))


def index_beside(folder: Path) -> Path:
    chunks = strips(XYZ, 4.0, 100)
    write_chunks(folder / "a.laz", las_data(HILL), chunks)
    index = lasindex(las_data(HILL), np.concatenate(chunks))
    (folder / "a.lax").write_bytes(index)
    return folder / "a.laz"


def index_behind(folder: Path) -> Path:
    path = index_beside(folder)
    append_lasindex(path, (folder / "a.lax").read_bytes())
    (folder / "a.lax").unlink()
    return path


def copc_beside_tiles(folder: Path) -> Path:
    """Everything twice, each time in another form."""
    write_copc(tiles_with_margins(folder) / "z.copc.laz", las_data(HILL))
    return folder / "tiles"


@pytest.mark.parametrize("max_points", [None, 150])
@pytest.mark.parametrize(
    "write",
    [merged, tiles_with_margins, copc, index_beside, index_behind, copc_beside_tiles],
)
def test_all_ways_give_the_columns_of_a_file_with_only_these_points(
    tmp_path: Path, write: Callable[[Path], Path], max_points: int | None
) -> None:
    """To the last byte, with and without a look at the headers first."""
    only = SurveyFiles.of(write_laz(tmp_path / "only.laz", HILL, WITHIN))
    expected, facts = columns_of(only, tmp_path / "expected", max_points)
    (tmp_path / "survey").mkdir()
    survey = find_survey(write(tmp_path / "survey"), extent=EXTENT)
    headed, heads = survey.heads(NullProgress())
    for number, given in enumerate((survey, headed)):
        columns, told = columns_of(given, tmp_path / f"columns-{number}", max_points)
        assert columns == expected
        assert (told.counts, told.warnings) == (facts.counts, facts.warnings)
        files = told.notes["files"]
        taken = sum(file["points"] - file["outside"] - file["repeats"] for file in files)
        assert taken == WITHIN.sum()
    # Files that do not touch it are left out by their headers, and stay counted.
    assert len(headed.files) == len(heads) == len(survey.files) - len(headed.outside)
    assert survey_size(heads, EXTENT).points < 4000


def test_other_formats_are_filtered_too(tmp_path: Path) -> None:
    rows = np.column_stack([XYZ, HILL.colours // 257])
    form, columns = ["%.3f"] * 3 + ["%d"] * 3, "x y z red green blue"
    for name, some in (("all", slice(None)), ("only", WITHIN)):
        path = tmp_path / f"{name}.xyz"
        np.savetxt(path, rows[some], fmt=form, header=columns, comments="")
        head = f"ply\nformat ascii 1.0\nelement vertex {len(rows[some])}\n"
        head += "".join(f"property double {axis}\n" for axis in "xyz")
        head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
        np.savetxt(
            tmp_path / f"{name}.ply", rows[some], fmt=form, header=head + "end_header", comments=""
        )
    for ending in ("xyz", "ply"):
        within = read_survey(find_survey(tmp_path / f"all.{ending}", extent=EXTENT))
        only = read_survey(tmp_path / f"only.{ending}")
        np.testing.assert_array_equal(within.points, only.points)
        np.testing.assert_array_equal(within.colours, only.colours)


def test_a_tile_outside_is_not_opened_beyond_its_header(tmp_path: Path) -> None:
    """Its points may be rubbish: nobody looks."""
    paths = write_tiles(tmp_path / "tiles", HILL)
    corner = Extent(641_200, 8_594_700, 641_210, 8_594_710)
    whole, _ = columns_of(find_survey(tmp_path / "tiles", extent=corner), tmp_path / "whole")
    for path in paths[1:]:
        data = bytearray(path.read_bytes())
        data[3000:-200] = bytes(len(data) - 3200)
        path.write_bytes(data)
    survey, _ = find_survey(tmp_path / "tiles", extent=corner).heads(NullProgress())
    assert [file.name for file in survey.files] == ["tile_1.laz"]
    assert len(survey.outside) == 8
    assert columns_of(survey, tmp_path / "left")[0] == whole


def test_an_extent_without_points_is_refused_with_both_bounds(tmp_path: Path) -> None:
    write_tiles(tmp_path / "tiles", HILL)
    aside = Extent(1000, 2000, 1100, 2100)
    told = (
        r"tiles has no point within extent 1000 2000 1100 2100: it spans 641200\.\d+ "
        r"8594700\.\d+ 641239\.\d+ 8594739\.\d+ \(WGS 84 / UTM zone 35S\); expected XMIN YMIN"
    )
    with pytest.raises(SurveyError, match=told):
        find_survey(tmp_path / "tiles", extent=aside).heads(NullProgress())
    with pytest.raises(SurveyError, match=told):
        read_survey(find_survey(tmp_path / "tiles", extent=aside))
    # Headers say that there may be points: found out by reading.
    hole = Extent(641_210.001, 8_594_710.001, 641_210.002, 8_594_710.002)
    with pytest.raises(SurveyError, match=r"has no point within extent 641210\.001 "):
        read_survey(find_survey(tmp_path / "tiles", extent=hole))
    np.savetxt(tmp_path / "a.xyz", XYZ, fmt="%.3f")
    with pytest.raises(SurveyError, match=r"it spans 641200\.\d+ .* \(its own coordinates\)"):
        read_survey(find_survey(tmp_path / "a.xyz", extent=aside))


def test_a_file_outside_counts_for_the_reference_system(tmp_path: Path) -> None:
    west, east = HILL.inside(0, 0, 2), HILL.inside(1, 0, 2)
    write_laz(tmp_path / "west.laz", HILL, west, epsg=None)
    write_laz(tmp_path / "east.laz", HILL, east)
    extent = Extent(641_200, 8_594_700, 641_215, 8_594_715)
    survey, _ = find_survey(tmp_path, extent=extent).heads(NullProgress())
    assert [file.name for file in survey.files] == ["west.laz"]
    read = read_survey(survey)
    assert read.crs is not None
    assert read.crs.epsg == 32735
    assert any("is stated in west.laz: taken to be in" in text for text in read.warnings)
    # Another one is refused, though no point of it would be taken.
    write_laz(tmp_path / "west.laz", HILL, west, epsg=32736)
    with pytest.raises(SurveyError, match="2 coordinate reference systems"):
        find_survey(tmp_path, extent=extent).heads(NullProgress())


def test_the_extent_is_in_the_files_own_unit(tmp_path: Path) -> None:
    """A survey in US survey feet: so is the extent, and the points that come out are in metres."""
    write_laz(tmp_path / "feet.laz", HILL, epsg=2225)
    read = read_survey(find_survey(tmp_path / "feet.laz", extent=EXTENT))
    assert len(read.points) == WITHIN.sum()
    factor = 1200 / 3937
    assert read.points[:, 0].min() == pytest.approx(XYZ[WITHIN, 0].min() * factor, abs=1e-6)


def test_points_outside_decide_nothing(tmp_path: Path) -> None:
    """Colours of 16 bits, classes and odd types outside do not change what is read within."""
    inside, outside = np.flatnonzero(WITHIN), np.flatnonzero(~WITHIN)
    las = las_data(HILL, np.concatenate([inside, outside]))
    las.red[: len(inside)] //= 257
    las.green[: len(inside)] //= 257
    las.blue[: len(inside)] //= 257
    las.classification[: len(inside)] = 0
    las.intensity[len(inside) :] = 7
    las.write(tmp_path / "a.laz")
    read = read_survey(find_survey(tmp_path / "a.laz", extent=EXTENT))
    assert list(read.attributes) == ["grade"]
    assert read.colours is not None
    assert read.colours.max() > 200
    assert any("use only 8 of the 16 bits" in text for text in read.warnings)
