from __future__ import annotations

import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order
from pyproj import CRS

from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey_statement import SurveyStatement

STEP = 0.001


def write(path: Path, sample, *, widen=257, crs=32735, point_format=7, **fields) -> Path:
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = np.full(3, STEP), sample.points[0]
    header.add_extra_dim(laspy.ExtraBytesParams("grade", np.float32))
    header.add_extra_dim(laspy.ExtraBytesParams("vector", "3f8"))
    if crs:
        header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = sample.points.T
    if point_format != 6:
        las.red, las.green, las.blue = sample.colours.astype(np.uint16).T * widen
    las.classification = sample.classes
    las.grade = sample.grade
    las.vector = np.stack([sample.grade, -sample.grade, 2 * sample.grade], axis=1)
    for name, values in fields.items():
        las[name] = values
    las.write(path, do_compress=path.suffix == ".laz", laz_backend=laspy.LazBackend.Lazrs)
    return path


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_everything_comes_back(tmp_path: Path, sample, name: str) -> None:
    survey = read_in_order(write(tmp_path / name, sample), sample.points)
    np.testing.assert_allclose(survey.points, sample.points, rtol=0, atol=STEP / 2 + 1e-9)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert survey.attributes["grade"].dtype == np.float32
    np.testing.assert_array_equal(survey.attributes["grade"], sample.grade)
    np.testing.assert_array_equal(survey.attributes["classification"], sample.classes)
    np.testing.assert_array_equal(survey.attributes["vector_2"], 2.0 * sample.grade)
    assert survey.crs is not None
    assert survey.crs.epsg == 32735
    assert survey.warnings == ()


@pytest.mark.parametrize("point_format", [3, 7])
def test_points_marked_as_noise_are_left_out_and_counted(
    tmp_path: Path, sample, point_format: int
) -> None:
    noise = np.zeros(500, bool)
    noise[[3, 100, 499]] = True
    # Class 18 is high noise by LAS 1.4.
    classes = np.where(noise, 7 if point_format == 3 else 18, 2).astype(np.uint8)
    withheld = np.zeros(500, np.uint8)
    withheld[200] = 1
    path = write(
        tmp_path / "a.laz", sample, point_format=point_format, classification=classes,
        withheld=withheld,
    )  # fmt: skip
    taken = ~noise & (withheld == 0)
    survey = read_in_order(path, sample.points[taken])
    np.testing.assert_array_equal(survey.colours, sample.colours[taken])
    [warning] = survey.warnings
    assert warning.startswith("4 of 500 points are marked in the survey as withheld or as noise")
    kept = find_survey([path], statement=SurveyStatement(keep_noise=True))
    assert len(read_survey(kept).points) == 500


def test_nothing_but_noise_is_no_survey(tmp_path: Path, sample) -> None:
    path = write(tmp_path / "a.laz", sample, classification=np.full(500, 7, np.uint8))
    with pytest.raises(ReadError, match="500 of 500 points are marked as withheld or as noise"):
        read_survey(path)


def test_unset_standard_fields_are_left_out_and_set_ones_kept(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample, point_source_id=np.full(500, 12, np.uint16))
    survey = read_in_order(path, sample.points)
    assert set(survey.attributes) == {
        "classification", "grade", "point_source_id", "vector_0", "vector_1", "vector_2",
    }  # fmt: skip


def test_eight_bit_colours_in_sixteen_bits_are_seen_and_said(tmp_path, sample) -> None:
    survey = read_in_order(write(tmp_path / "a.las", sample, widen=1), sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert "only 8 of the 16 bits" in survey.warnings[0]


def test_a_format_without_colour_has_none(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample, point_format=6, crs=None)
    survey = read_in_order(path, sample.points)
    assert survey.colours is None
    assert survey.crs is None


def test_no_points_is_an_error(tmp_path) -> None:
    path = tmp_path / "a.las"
    laspy.LasData(laspy.LasHeader(point_format=7, version="1.4")).write(path)
    with pytest.raises(ReadError, match="the header says 0 points"):
        read_survey(path)


def test_a_cut_las_says_at_which_point_and_byte(tmp_path, sample) -> None:
    path = write(tmp_path / "a.las", sample)
    data = path.read_bytes()
    with laspy.open(path) as reader:
        start, size = reader.header.offset_to_point_data, reader.header.point_format.size
    path.write_bytes(data[: start + 123 * size + 5])
    with pytest.raises(ReadError, match="ends after 123 of 500 points") as caught:
        read_survey(path)
    assert caught.value.location == f"byte {start + 123 * size + 5:,}"
    assert caught.value.path == path


def test_a_cut_laz_says_how_much_is_there(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    with pytest.raises(ReadError, match=r"about \d+% of 500 points are there"):
        read_survey(path)


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_every_truncation_is_a_read_error(tmp_path, sample, name: str) -> None:
    path = write(tmp_path / name, sample)
    data = path.read_bytes()
    for length in [*range(4, len(data) - 1, 509), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_survey(path)


def test_a_laz_damaged_in_the_middle_is_refused(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample)
    data = bytearray(path.read_bytes())
    with laspy.open(path) as reader:
        start = reader.header.offset_to_point_data
    (table,) = struct.unpack_from("<q", data, start)
    data[table : table + 8] = b"\xff" * 8
    path.write_bytes(data)
    with pytest.raises(ReadError):
        read_survey(path)


def test_an_absurd_point_count_is_refused_before_allocation(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, 247, 10**15)
    path.write_bytes(data)
    with pytest.raises(ReadError, match="1,000,000,000,000,000 points"):
        read_survey(path)


def test_a_table_that_does_not_add_up_is_not_trusted(tmp_path, sample, monkeypatch) -> None:
    """The decoder in threads goes by the table of chunks; the plain one does without."""
    path = write(tmp_path / "a.laz", sample)
    used = []
    opened = laspy.open

    def open_and_note(*arguments, laz_backend, **more):
        used.append(laz_backend)
        return opened(*arguments, laz_backend=laz_backend, **more)

    monkeypatch.setattr(laspy, "open", open_and_note)
    trusted = read_survey(path)
    assert used == [laspy.LazBackend.Lazrs, laspy.LazBackend.LazrsParallel]
    monkeypatch.setattr(lazrs, "read_chunk_table", lambda *_: [(500, 1)])
    plain = read_survey(path)
    assert used[2:] == [laspy.LazBackend.Lazrs]
    np.testing.assert_array_equal(plain.points, trusted.points)


def test_a_damaged_table_of_chunks_is_refused_or_does_not_matter(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample)
    whole = read_survey(path).points
    data = path.read_bytes()
    with laspy.open(path) as reader:
        start = reader.header.offset_to_point_data
    (table,) = struct.unpack_from("<q", data, start)
    for at in [*range(start, start + 8), *range(table, len(data))]:
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x15]) + data[at + 1 :])
        try:
            points = read_survey(path).points
        except ReadError:
            continue
        np.testing.assert_array_equal(points, whole)


def with_extra_dims(path: Path, sample, dims, values, **written) -> Path:
    """Write a LAS with extra dimensions, given as laspy describes them."""
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = np.full(3, STEP), sample.points[0]
    header.add_extra_dims([laspy.ExtraBytesParams(**dim) for dim in dims])
    las = laspy.LasData(header)
    las.x, las.y, las.z = sample.points.T
    las.red, las.green, las.blue = sample.colours.astype(np.uint16).T * 257
    for name, column in values.items():
        las.points.array[name] = column
    for name, column in written.items():
        las[name] = column
    las.write(path, do_compress=path.suffix == ".laz", laz_backend=laspy.LazBackend.Lazrs)
    return path


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_stated_no_data_of_extra_dimensions_is_no_value(tmp_path, sample, name: str) -> None:
    count = len(sample.points)
    gap = np.arange(count) % 7 == 3
    stored = np.arange(count) % 200
    f4_lowest = float(np.finfo(np.float32).min)
    kinds = [  # name, type, value of no data, further parameters
        ("assay", np.float32, -99.25, {}),
        ("lowest", np.float32, f4_lowest, {}),
        ("rock", np.uint8, 255, {}),
        ("wide", np.int64, -(2**40), {}),
        # The standard states it before scale and offset: here 30000 * .5 - 7.
        ("scaled", np.uint16, 30_000, {"scales": np.array([0.5]), "offsets": np.array([-7.0])}),
        # 241 is what -15 becomes in 8 bits: no point has -15.
        ("unfit", np.uint8, 0, {}),
    ]
    dims = [
        {"name": title, "type": kind, "no_data": np.array([value]), **more}
        for title, kind, value, more in kinds
    ]
    columns = {
        title: np.where(gap, value, stored).astype(kind) for title, kind, value, _ in kinds[:-1]
    }
    columns["unfit"] = np.where(gap, 241, stored).astype(np.uint8)
    path = with_extra_dims(tmp_path / name, sample, dims, columns)
    data = path.read_bytes()
    at = data.index(b"unfit") + 32 + 4  # the record's name has 32 bytes, then 4 unused ones
    path.write_bytes(data[:at] + struct.pack("<q", -15) + data[at + 8 :])
    survey = read_in_order(path, sample.points)
    for title in ("assay", "lowest", "rock", "wide"):
        np.testing.assert_array_equal(
            survey.attributes[title], np.where(gap, np.nan, stored), err_msg=title
        )
    np.testing.assert_array_equal(
        survey.attributes["scaled"], np.where(gap, np.nan, stored * 0.5 - 7.0)
    )
    np.testing.assert_array_equal(survey.attributes["unfit"], columns["unfit"])
    assert set(survey.whole) == {"rock", "wide"}  # codes stay codes though they have gaps


def test_no_data_of_each_component(tmp_path, sample) -> None:
    vector = np.stack([sample.grade] * 3, axis=1)
    vector[::5, 0], vector[1::5, 2] = -1.0, -3.0
    dim = {"name": "v", "type": "3f4", "no_data": np.array([-1.0, -2.0, -3.0])}
    survey = read_in_order(
        with_extra_dims(tmp_path / "a.las", sample, [dim], {"v": vector}), sample.points
    )
    missing = [int(np.isnan(survey.attributes[f"v_{k}"]).sum()) for k in range(3)]
    assert missing == [100, 0, 100]


def test_names_that_are_one_name_in_a_scene_are_told_apart(tmp_path, sample) -> None:
    titles = ["Intensity", "ore %", "ore_#", "feature id 0", "classification"]
    dims = [{"name": title, "type": np.float32} for title in titles[:4]]
    values = {title: sample.grade + k for k, title in enumerate(titles[:4])}
    path = with_extra_dims(
        tmp_path / "a.las", sample, dims, values, intensity=np.arange(500), classification=[2] * 500
    )
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.attributes["intensity"], np.arange(500))
    for k, title in enumerate(["Intensity_2", "ore %", "ore_#_2", "survey_feature id 0"]):
        np.testing.assert_array_equal(survey.attributes[title], sample.grade + k)
    told = [text for text in survey.warnings if "its name in glTF" in text]
    assert len(told) == 3
    assert "'Intensity' is called 'Intensity_2'" in told[0]


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_records_beyond_the_stated_count_are_told(tmp_path, name: str) -> None:
    rows, chunk = 1300, 400
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = np.full(3, STEP)
    points = np.random.default_rng(5).integers(0, 9000, (rows, 3)) * STEP
    path = tmp_path / name
    if path.suffix == ".laz":
        with path.open("wb") as file:
            write_chunks(file, header, points, chunk)
    else:
        las = laspy.LasData(header)
        las.x, las.y, las.z = points.T
        las.write(path)
    whole = path.read_bytes()
    assert len(read_survey(path).points) == rows
    assert not any("further" in text for text in read_survey(path).warnings)
    path.write_bytes(whole[:107] + struct.pack("<I", 350) + whole[111:])
    survey = read_survey(path)
    assert len(survey.points) == 350
    # Of the last chunk the table does not say how full it is.
    further = "950" if path.suffix == ".las" else "at least 851"
    assert f"350 points, but {further} further point records follow" in survey.warnings[0]


def write_chunks(file, header, points, chunk: int) -> None:
    """Write a LAZ in chunks of some points, all in one table."""
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    record = lazrs.LazVlr.new_for_compression(3, 0)
    raw = bytearray(record.record_data())
    struct.pack_into("<I", raw, 12, chunk)
    record = lazrs.LazVlr(bytes(raw))
    header = las.header
    header.are_points_compressed = True
    header.vlrs.append(laspy.VLR("laszip encoded", 22204, "", bytes(raw)))
    header.point_count = len(points)
    header.write_to(file)
    compressor = lazrs.LasZipCompressor(file, record)
    compressor.compress_many(np.frombuffer(las.points.array.tobytes(), np.uint8))
    compressor.done()


@pytest.mark.parametrize(
    ("wide", "legacy", "says"),
    [
        (0, 500, "states 0 points in the field of LAS 1.4 and 500 in the older one: 500 are read"),
        (0, 0, "states 0 points, but 500 point records follow: all are read"),
        (90_000, 500, "90,000 points in the field of LAS 1.4 and 500 in the older one: 500"),
        (500, 70, "states 500 points in the field of LAS 1.4 and 70 in the older one: 500"),
        (500, 0, ""),
        (500, 500, ""),
    ],
)
def test_the_two_counts_of_las_1_4(tmp_path, sample, wide: int, legacy: int, says: str) -> None:
    path = write(tmp_path / "a.las", sample, point_format=3)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 107, legacy)
    struct.pack_into("<Q", data, 247, wide)
    path.write_bytes(data)
    survey = read_survey(path)
    assert len(survey.points) == 500
    assert says in " ".join(survey.warnings)
    assert says or survey.warnings == ()


def test_a_count_of_zero_before_compressed_points_is_no_empty_file(tmp_path, sample) -> None:
    path = write(tmp_path / "a.laz", sample)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, 247, 0)
    path.write_bytes(data)
    with pytest.raises(ReadError, match="0 points, but compressed points follow"):
        read_survey(path)
