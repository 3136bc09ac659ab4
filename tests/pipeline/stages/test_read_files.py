"""A survey in many files is what it is in one: order, overlaps, columns, colours, damage."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pipeline.laz_files import Hill, las_data, write_laz, write_tiles
from pyproj import CRS

from terraport_pipeline.engines.readers import point_order
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.model import Survey
from terraport_pipeline.stages import clean, read_streamed
from terraport_pipeline.stages.contract import Context, Facts
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.stages.reading import sort, spool, strays
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles

HILL = Hill(4000)


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks and buckets of a small survey."""
    monkeypatch.setattr(strays, "BLOCK_ROWS", 500)
    monkeypatch.setattr(sort, "BLOCK_ROWS", 500)
    monkeypatch.setattr(sort, "_BUCKET_ROWS", 700)
    monkeypatch.setattr(spool, "_SAMPLE_STEP", 10)


def assert_equal(one: Survey, other: Survey) -> None:
    """Both have the same points in the same order, to the last bit."""
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.colours, other.colours)
    assert list(one.attributes) == list(other.attributes)
    for name, values in one.attributes.items():
        assert values.dtype == other.attributes[name].dtype
        np.testing.assert_array_equal(values, other.attributes[name])
    assert (one.crs, one.format, one.warnings) == (other.crs, other.format, other.warnings)


def columns_of(survey: SurveyFiles, folder: Path) -> tuple[dict[str, bytes], Facts]:
    """Everything that reading writes, by file, and what it tells."""
    folder.mkdir()
    _, facts = read_streamed.run(survey, folder, Context(folder))
    return {path.name: path.read_bytes() for path in folder.iterdir()}, facts


@pytest.mark.parametrize("margin_m", [0.0, 2.0])
@pytest.mark.parametrize("max_points", [None, 700])
def test_tiles_and_the_merged_file_are_the_same_survey(
    tmp_path: Path, margin_m: float, max_points: int | None
) -> None:
    """Every tile with an offset of its own, in an order of its own, with a margin or without."""
    write_tiles(tmp_path / "tiles", HILL, margin_m=margin_m)
    merged = read_survey(write_laz(tmp_path / "merged.laz", HILL), max_points=max_points)
    tiles = read_survey(find_survey(tmp_path / "tiles"), max_points=max_points)
    assert_equal(tiles, merged)
    assert len(merged.points) == (max_points or len(HILL))


def test_points_chosen_by_hash_are_the_same_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a large survey not all points are sorted to keep a few: overlaps do not change which."""
    monkeypatch.setattr(point_order, "_SKETCH_SIZE", 300)
    write_tiles(tmp_path / "tiles", HILL, margin_m=2.0)
    merged = read_survey(write_laz(tmp_path / "merged.laz", HILL), max_points=100)
    assert_equal(read_survey(find_survey(tmp_path / "tiles"), max_points=100), merged)
    assert len(merged.points) == 100
    # Spread over the ground: every quarter of it has its share.
    middle = np.median(HILL.millimetres[:, :2] / 1000, axis=0)
    quarters = np.bincount((merged.points[:, :2] > middle) @ [1, 2], minlength=4)
    assert quarters.min() > 15


def test_columns_are_the_same_bytes_and_repeats_are_counted(tmp_path: Path) -> None:
    paths = write_tiles(tmp_path / "tiles", HILL, margin_m=2.0)
    merged = SurveyFiles.of(write_laz(tmp_path / "merged.laz", HILL))
    one, _ = columns_of(merged, tmp_path / "one")
    nine, facts = columns_of(find_survey(tmp_path / "tiles"), tmp_path / "nine")
    assert one == nine
    files = facts.notes["files"]
    assert len(files) == len(paths)
    assert facts.counts["points"] == len(HILL)
    assert sum(file["points"] - file["repeats"] for file in files) == len(HILL)
    assert files[0]["repeats"] == 0
    assert all(file["repeats"] > 0 for file in files[1:])


def test_a_copy_in_another_format_adds_nothing(tmp_path: Path) -> None:
    write_laz(tmp_path / "a.laz", HILL, fields=())
    # The same decimals as text, and the only attribute by its LAS name.
    rows = np.column_stack([HILL.millimetres / 1000, HILL.colours // 257, HILL.classes])
    form = ["%.3f"] * 3 + ["%d"] * 4
    header = "x y z red green blue classification"
    np.savetxt(tmp_path / "a.xyz", rows, fmt=form, header=header, comments="")
    both = read_survey(find_survey([tmp_path / "a.laz", tmp_path / "a.xyz"]))
    assert len(both.points) == len(HILL)
    assert both.format == "las, xyz"
    assert any("is stated in a.xyz" in text for text in both.warnings)


def test_what_some_files_lack_is_nan_and_said(tmp_path: Path) -> None:
    west, east = HILL.inside(0, 0, 2) | HILL.inside(0, 1, 2), HILL.inside(1, 0, 2)
    write_laz(tmp_path / "west.laz", HILL, west, fields=("grade", "rock"))
    write_laz(tmp_path / "east.laz", HILL, east, fields=())
    survey = read_survey(find_survey(tmp_path))
    lacking = survey.points[:, 0] >= 641_220
    assert np.isnan(survey.attributes["grade"][lacking]).all()
    assert np.isfinite(survey.attributes["grade"][~lacking]).all()
    assert survey.attributes["rock"].dtype == np.float64
    assert "Attribute 'rock' is not in east.laz: it has no value there." in survey.warnings
    # Codes stay codes: a class is never a mean of two.
    assert survey.whole == ("rock",)
    assert clean.run(survey, clean.Options(), Context(tmp_path)).codes == (
        "classification",
        "rock",
    )


def test_whole_numbers_of_64_bits_cannot_be_missing(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z,id\n1,2,3,4\n2,3,4,5\n")
    (tmp_path / "b.csv").write_text("x,y,z\n1,2,4\n2,3,5\n")
    with pytest.raises(SurveyError, match="attribute 'id' holds whole numbers of 64 bits"):
        read_survey(find_survey(tmp_path))


def test_more_attributes_than_a_segment_has_bits_for_are_left_out(tmp_path: Path) -> None:
    names = [f"band_{number}" for number in range(33)]
    rows = [",".join(str(row * 7 + n) for n in range(36)) for row in range(4)]
    (tmp_path / "a.csv").write_text("\n".join([",".join(["x", "y", "z", *names]), *rows]) + "\n")
    survey = read_survey(tmp_path / "a.csv")
    assert list(survey.attributes) == names[:31]
    (warning,) = [text for text in survey.warnings if "at most 31" in text]
    assert warning.startswith("The survey has 33 attributes, expected at most 31: band_31")


def test_points_of_a_file_without_colour_are_grey_and_it_is_named(tmp_path: Path) -> None:
    write_laz(tmp_path / "west.laz", HILL, HILL.inside(0, 0, 2))
    write_laz(tmp_path / "east.laz", HILL, HILL.inside(1, 0, 2), colour=False)
    survey = read_survey(find_survey(tmp_path))
    assert survey.colours is not None
    assert (survey.colours[survey.points[:, 0] >= 641_220] == 160).all()
    assert "There is no colour (RGB) in east.laz: its points are grey." in survey.warnings


def test_a_file_with_8_bit_colours_among_others_is_not_black(tmp_path: Path) -> None:
    write_laz(tmp_path / "west.laz", HILL, HILL.inside(0, 0, 2))
    write_laz(tmp_path / "east.laz", HILL, HILL.inside(1, 0, 2), depth=257)
    survey = read_survey(find_survey(tmp_path))
    assert survey.colours is not None
    assert survey.colours[survey.points[:, 0] >= 641_220].max() == 255
    assert any("in east.laz; there they are taken as 0..255" in w for w in survey.warnings)


def _coloured(path: Path, rows, colours: np.ndarray) -> None:
    las = las_data(HILL, rows)
    las.red, las.green, las.blue = colours.astype(np.uint16).T
    las.write(path, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)


def test_tiles_of_three_depths_and_one_without_colour(tmp_path: Path) -> None:
    """8 bits with one slip, widened 8 bits, a mix of both, and zeros."""
    eight = (HILL.colours // 257).astype(np.int64)
    rows = [HILL.inside(column, line, 2) for column in (0, 1) for line in (0, 1)]
    stored = [eight[rows[0]], eight[rows[1]] * 256, eight[rows[2]], eight[rows[3]] * 0]
    stored[0][5] = [256, 90, 80]
    stored[2][::3] *= 257
    for number, (inside, colours) in enumerate(zip(rows, stored, strict=True)):
        _coloured(tmp_path / f"t{number}.laz", inside, colours)
    survey = read_survey(find_survey(tmp_path))
    right = eight.copy()
    right[np.flatnonzero(rows[0])[5]] = [255, 90, 80]
    right[rows[3]] = 160
    millimetres = np.rint(survey.points * 1000).astype(np.int64)
    order = np.lexsort(millimetres.T)[np.argsort(np.lexsort(HILL.millimetres.T))]
    np.testing.assert_array_equal(survey.colours[order], right)
    warnings = "\n".join(survey.warnings)
    assert "above 255 in 1 points: they are taken as 255. (In t0.laz.)" in warnings
    assert "mix depths" in warnings
    assert "each point is scaled by its own depth. (in t2.laz.)" in warnings.lower()
    assert "The fields red, green, blue are 0 in every point. (In t3.laz.)" in warnings
    assert "no colour (RGB) in t3.laz" in warnings


def test_a_tile_of_a_depth_that_cannot_be_told_is_named(tmp_path: Path) -> None:
    eight = (HILL.colours // 257).astype(np.int64)
    west, east = HILL.inside(0, 0, 2), HILL.inside(1, 0, 2)
    _coloured(tmp_path / "west.laz", west, eight[west] * 257)
    _coloured(tmp_path / "east.laz", east, eight[east] * 16)  # 12 bits
    warnings = " ".join(read_survey(find_survey(tmp_path)).warnings)
    assert "The colours of east.laz are nearly black, and others are not" in warnings


def test_a_dark_tile_of_a_survey_at_night_stays_dark(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    dusk = rng.exponential(250, HILL.colours.shape)
    west, east = HILL.inside(0, 0, 2), HILL.inside(1, 0, 2)
    _coloured(tmp_path / "west.laz", west, dusk[west])
    _coloured(tmp_path / "east.laz", east, np.minimum(dusk[east], 255))
    survey = read_survey(find_survey(tmp_path))
    assert survey.colours.max() == int(dusk[west].max()) >> 8
    assert "nearly black" in " ".join(survey.warnings)


def test_damage_among_the_points_names_the_file_or_leaves_it_out(tmp_path: Path) -> None:
    paths = write_tiles(tmp_path / "tiles", HILL)
    paths[4].write_bytes(paths[4].read_bytes()[:-400])
    with pytest.raises(ReadError, match=r"tile_5\.laz.*or go on without the file: --skip-damaged"):
        read_survey(find_survey(tmp_path / "tiles"))
    survey = find_survey(tmp_path / "tiles", skip_damaged=True)
    left, facts = columns_of(survey, tmp_path / "left")
    assert [name for name, _ in facts.notes["damaged"]] == ["tile_5.laz"]
    assert any(text.startswith("Left out, 11.1% of the files, as they cannot be used: tile_5.laz (")
               for text in facts.warnings)  # fmt: skip
    assert facts.counts["points"] == len(HILL) - HILL.inside(1, 1, 3).sum()
    paths[4].unlink()
    without, _ = columns_of(find_survey(tmp_path / "tiles"), tmp_path / "without")
    assert left == without


def test_nothing_left_is_an_error(tmp_path: Path) -> None:
    for path in write_tiles(tmp_path, HILL, tiles=2):
        path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(SurveyError, match=r"not one of its files can be used: tile_1\.laz"):
        read_survey(find_survey(tmp_path, skip_damaged=True))


def test_progress_is_one_bar_over_all_files(tmp_path: Path) -> None:
    write_tiles(tmp_path, HILL, tiles=2)

    class Recorder:
        def __init__(self) -> None:
            self.steps: list[str] = []
            self.amounts: list[float] = []

        def start(self, stage: str, total: float | None, unit: str) -> None:
            self.steps.append(f"{stage}: {total:.0f} {unit}")
            self.amounts.append(0.0)

        def advance(self, n: float) -> None:
            self.amounts[-1] += n

        def done(self, facts: object) -> None: ...

    recorder = Recorder()
    survey = find_survey(tmp_path)
    read_survey(survey, progress=recorder)
    assert recorder.steps == [
        f"read 4 files: {survey.size_bytes} bytes",
        "read: order: 8000 points",
    ]
    assert recorder.amounts == [pytest.approx(survey.size_bytes), 8000]


def test_a_prj_beside_a_file_states_its_crs(tmp_path: Path) -> None:
    """Other reading, other key: a build takes up nothing that was read without it."""
    rows = "".join(f"{641_200 + n % 9}.5 {8_594_700 + n // 9}.5 {n % 5}.25\n" for n in range(90))
    (tmp_path / "a.xyz").write_text("x y z\n" + rows)
    without = find_survey(tmp_path)
    assert read_survey(without).crs is None
    (tmp_path / "a.prj").write_text(CRS.from_epsg(32735).to_wkt("WKT1_ESRI"))
    survey = find_survey(tmp_path)
    assert survey.ignored == ()
    crs = read_survey(survey).crs
    assert crs is not None
    assert CRS.from_wkt(crs.wkt) == CRS.from_wkt((tmp_path / "a.prj").read_text())
    assert survey.key != without.key
    # What states nothing is listed as what is left out.
    (tmp_path / "a.prj").write_text("unknown")
    assert find_survey(tmp_path).ignored == (("a.prj", "states no CRS of a survey beside it"),)
