from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from pipeline.one_piece import (
    Labelled,
    reconstruct_survey,
    runner_in,
    segment_surface,
    surface_in_tiles,
)

from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Mesh, Survey
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.regions import ENGINES
from terraport_pipeline.stages.region_engine import make_segmenter, sized
from terraport_pipeline.stages.tiles import tiled_segment

SMALL = segment.Options(min_faces=150, max_faces=900)


@dataclass(frozen=True)
class Meshes:
    """Base and detail of a hill."""

    base: Mesh
    detail: Mesh
    deviation_m: tuple[float, ...]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("segment")


@pytest.fixture(scope="module")
def meshes(make_hill: Callable[..., Survey], folder: Path) -> Meshes:
    options = reconstruct.Options(base_faces=800)
    hill = reconstruct_survey(runner_in(folder / "hill"), make_hill(), options)
    return Meshes(hill.base, hill.detail, hill.deviation_m)


def run(meshes: Meshes, options: segment.Options, *, threads: int = 1) -> Labelled:
    surface = surface_in_tiles(meshes.base, meshes.detail, meshes.deviation_m)
    with TemporaryDirectory() as folder:
        return segment_surface(runner_in(Path(folder), threads=threads), surface, options)


@pytest.fixture(scope="module")
def result(meshes: Meshes) -> Labelled:
    return run(meshes, SMALL)


def test_every_face_has_one_region_and_one_segment(meshes: Meshes, result: Labelled) -> None:
    count = len(meshes.detail.faces)
    assert result.regions.shape == result.segments.shape == (count,)
    assert sorted(set(result.segments.tolist())) == list(range(len(result.joined.main_region)))
    assert sorted(set(result.regions.tolist())) == list(range(result.facts.counts["regions"]))
    assert np.bincount(result.segments).max() <= 900


def test_main_region_is_the_region_of_most_faces(result: Labelled) -> None:
    for number in range(len(result.joined.main_region)):
        inside = np.bincount(result.regions[result.segments == number])
        assert inside[result.joined.main_region[number]] == inside.max()
        assert result.joined.region_counts[number] == np.count_nonzero(inside)


def test_bounds_are_the_boxes_of_the_segments(meshes: Meshes, result: Labelled) -> None:
    for number, box in enumerate(result.joined.bounds):
        inside = meshes.detail.vertices[meshes.detail.faces[result.segments == number].ravel()]
        assert (box[:3] == inside.min(axis=0)).all()
        assert (box[3:] == inside.max(axis=0)).all()


def test_the_cover_has_a_row_per_base_face_and_names_known_segments(
    meshes: Meshes, result: Labelled
) -> None:
    assert len(result.joined.base_kept) == len(meshes.base.faces)
    assert len(result.joined.cover_offsets) == result.joined.base_kept.sum() + 1
    assert (np.diff(result.joined.cover_offsets.astype(np.int64)) > 0).all()
    assert result.joined.cover_offsets[-1] == len(result.joined.cover_segments)
    assert result.joined.cover_segments.max() < len(result.joined.main_region)
    assert result.joined.tolerance_m >= meshes.deviation_m[2]


def test_base_beyond_the_detail_is_not_kept_and_all_other_is(meshes: Meshes) -> None:
    detail = meshes.detail
    cut = (detail.vertices[:, 0] < 5)[detail.faces].all(axis=1)
    shorter = replace(meshes, detail=replace(detail, faces=detail.faces[cut]))
    kept = run(shorter, SMALL).joined.base_kept
    x = meshes.base.vertices[meshes.base.faces][:, :, 0]
    inner = (np.abs(meshes.base.vertices[:, ::2]) < 19)[meshes.base.faces].all(axis=(1, 2))
    assert kept[inner & (x.min(axis=1) < 4)].all()  # the base's hem reaches beyond the detail
    assert not kept[x.min(axis=1) > 9].any()


def test_two_materials_are_two_regions(meshes: Meshes, result: Labelled) -> None:
    """The hill is red in the east and green in the west."""
    centre = meshes.detail.vertices[meshes.detail.faces].mean(axis=1)
    east, west = (result.regions[centre[:, 0] * side > 3] for side in (1, -1))
    # A strip of mixed colours may stand between them at the very edge.
    sizes = np.sort(np.bincount(result.regions))
    assert sizes[-2:].sum() > 0.99 * len(result.regions)
    assert len(set(east.tolist())) == len(set(west.tolist())) == 1
    assert east[0] != west[0]


@pytest.mark.parametrize(
    ("width_m", "size_m"), [(0.1, 0.05), (8.0, 1.0), (120.0, 15.0), (1500.0, 15.0), (4000.0, 40.0)]
)
def test_the_size_of_regions_suits_the_scene_unless_it_is_stated(
    width_m: float, size_m: float
) -> None:
    assert sized(segment.Options(), width_m).borders_size_m == pytest.approx(size_m)
    stated = segment.Options(borders_size_m=2.0)
    assert sized(stated, width_m) == stated


def test_no_region_by_borders_holds_two_materials(meshes: Meshes) -> None:
    """Red in the east, green in the west; its slopes may be regions, too."""
    found = run(meshes, replace(SMALL, engine="borders")).regions
    x = meshes.detail.vertices[meshes.detail.faces].mean(axis=1)[:, 0]
    assert not set(found[x > 3].tolist()) & set(found[x < -3].tolist())
    assert len(np.unique(found)) <= 8


def test_more_regions_than_feature_ids_are_refused(
    meshes: Meshes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiled_segment, "MAX_REGIONS", 1)
    with pytest.raises(OptionError, match=r"[2-9] regions; at most 1 can be told apart"):
        run(meshes, SMALL)


def test_same_input_same_bytes(meshes: Meshes, result: Labelled) -> None:
    again = run(meshes, SMALL, threads=2)
    assert again.segmented.joined.digest == result.segmented.joined.digest
    assert again.regions.tobytes() == result.regions.tobytes()
    assert again.segments.tobytes() == result.segments.tobytes()


def test_what_is_kept_is_taken_up(meshes: Meshes, result: Labelled, tmp_path: Path) -> None:
    surface = surface_in_tiles(meshes.base, meshes.detail, meshes.deviation_m)
    runner = runner_in(tmp_path)
    for _ in range(2):
        back = segment_surface(runner, surface, SMALL)
    assert [(report.name, report.taken_up) for report in runner.reports] == [
        ("segment", False),
        ("segment", True),
    ]
    assert (back.segments == result.segments).all()
    assert back.joined.region_facts == result.joined.region_facts
    assert back.joined.tolerance_m == result.joined.tolerance_m


@pytest.mark.parametrize(
    "options",
    [
        {"engine": "borders", "borders_size_m": 0.0},
        {"engine": "means", "means_spread": 0.0},
        {"engine": "means", "means_spread": 101.0},
        {"engine": "graph", "graph_cut_drop": -1.0},
        {"engine": "grid", "grid_cell_m": float("inf")},
        {"engine": "magic"},
        {"segment_by": ""},
        {"engine": "tpa", "tpa_segment_threshold": float("nan")},
        {"engine": "means", "small_region_share": 1.0},
        {"min_faces": 10, "max_faces": 5},
        {"min_faces": 0},
        {"max_extent_m": -1.0},
    ],
)
def test_options_out_of_range(options: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="expected"):
        segment.Options(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("engine", "name"),
    [
        (engine, name)
        for engine in ENGINES
        for name in (
            "borders_size_m", "means_spread", "graph_cut_drop", "tpa_region_threshold",
            "tpa_segment_threshold", "felzenszwalb_scale", "grid_cell_m",
        )
    ],
)  # fmt: skip
def test_an_option_of_one_engine_is_refused_with_every_other(engine: Any, name: str) -> None:
    options: dict[str, Any] = {"engine": engine, name: 0.5}
    owner = name.partition("_")[0]
    if owner == engine:
        assert getattr(segment.Options(**options), name) == 0.5
    else:
        with pytest.raises(OptionError) as raised:
            segment.Options(**options)
        option_text = {"grid": "grid cell 0.5 m", "borders": "region size 0.5 m"}.get(
            owner, f"{name.replace('_', ' ')} 0.5"
        )
        flag = "region-size" if owner == "borders" else name.replace("_", "-")
        assert str(raised.value) == (
            f"{option_text} with engine {engine}; expected engine {owner}: leave out "
            f"--{flag}, or change --engine"
        )


@pytest.mark.parametrize("engine", ["borders", "grid"])
def test_some_engines_know_no_share_of_the_surface(engine: Any) -> None:
    with pytest.raises(
        OptionError,
        match=rf"small region share 0\.1 with engine {engine}; expected engine means",
    ):
        segment.Options(engine=engine, small_region_share=0.1)


@pytest.mark.parametrize(
    ("options", "field", "value"),
    [
        (segment.Options(engine="borders", borders_size_m=8.0), "region_size_m", 8.0),
        (segment.Options(engine="means", means_spread=0.5), "spread", 0.5),
        (segment.Options(engine="means", small_region_share=0.1), "small_share", 0.1),
        (segment.Options(engine="graph", graph_cut_drop=0.9), "options.threshold", 0.9),
        (segment.Options(engine="graph", segment_by="shape"), "options.threshold", 2.5),
        (segment.Options(engine="graph", small_region_share=0.1), "options.small_share", 0.1),
        (segment.Options(engine="tpa", tpa_region_threshold=0.9), "regions.threshold", 0.9),
        (segment.Options(engine="tpa", small_region_share=0.1), "regions.small_threshold", 0.1),
        (segment.Options(engine="tpa", tpa_segment_threshold=0.1), "fine.threshold", 0.1),
        (segment.Options(engine="felzenszwalb", felzenszwalb_scale=9.0), "region_scale", 9.0),
        (segment.Options(engine="felzenszwalb", small_region_share=0.1), "region_share", 0.1),
        (segment.Options(engine="grid", grid_cell_m=7.0), "region_cell_m", 7.0),
    ],
    ids=str,
)
def test_every_option_reaches_its_engine(
    options: segment.Options, field: str, value: float
) -> None:
    assert attrgetter(field)(make_segmenter(options, threads=1)) == value


@pytest.mark.parametrize(
    ("engine", "field", "ground", "body"),
    [
        ("graph", "options.threshold", 2.5, 5.0),
        ("graph", "options.small_share", 0.003, 0.01),
        ("tpa", "regions.attribute_range", 2.0, 2.0),
    ],
)
def test_by_shape_a_closed_body_has_defaults_of_its_own(
    engine: Any, field: str, ground: float, body: float
) -> None:
    options = segment.Options(engine=engine, segment_by="shape")
    for is_closed_body, value in ((False, ground), (True, body)):
        segmenter = make_segmenter(options, is_closed_body=is_closed_body, threads=1)
        assert attrgetter(field)(segmenter) == value


@pytest.mark.parametrize(
    ("engine", "segment_by"),
    [
        ("borders", "colour"),
        ("borders", "height"),
        ("means", "colour"),
        ("graph", "colour"),
        ("graph", "shape"),
        ("tpa", "height"),
        ("felzenszwalb", "colour"),
        ("grid", "colour"),
    ],
)
def test_every_engine_and_what_it_compares(meshes: Meshes, engine: Any, segment_by: str) -> None:
    detail = meshes.detail
    attributes = {"height": detail.vertices[:, 1].copy()}
    input_meshes = replace(meshes, detail=replace(detail, attributes=attributes))
    options = replace(SMALL, engine=engine, segment_by=segment_by)
    segmented = run(input_meshes, options)
    assert sorted(set(segmented.regions.tolist())) == list(range(segmented.facts.counts["regions"]))
    assert segmented.facts.counts["engine"] == engine
    assert segmented.facts.counts["segment_by"] == segment_by
    again = run(input_meshes, options, threads=2)
    assert again.regions.tobytes() == segmented.regions.tobytes()
    assert again.segments.tobytes() == segmented.segments.tobytes()


def test_a_grey_surface_is_one_region_and_the_build_says_what_would_help(meshes: Meshes) -> None:
    grey = np.full_like(meshes.detail.colours, 128)
    input_meshes = replace(meshes, detail=replace(meshes.detail, colours=grey))
    segmented = run(input_meshes, SMALL)
    assert segmented.facts.counts["regions"] == 1
    assert any("--segment-by shape" in text for text in segmented.facts.warnings)
    by_shape = replace(SMALL, engine="graph", segment_by="shape")
    [warning] = run(input_meshes, by_shape).facts.warnings
    assert warning.startswith("the surface came out as one region: engine graph finds no border")


def test_unknown_attribute_is_refused_with_those_there_are(meshes: Meshes) -> None:
    input_meshes = replace(
        meshes,
        detail=replace(meshes.detail, attributes={"reading": np.ones(len(meshes.detail.vertices))}),
    )
    with pytest.raises(OptionError, match="'grade'; this survey has colour, shape, reading"):
        run(input_meshes, replace(SMALL, segment_by="grade"))


def test_attribute_with_gaps_is_refused(meshes: Meshes) -> None:
    values = np.ones(len(meshes.detail.vertices), np.float32)
    values[3:5] = np.nan
    input_meshes = replace(meshes, detail=replace(meshes.detail, attributes={"reading": values}))
    with pytest.raises(OptionError, match=r"2 of [0-9]+ values are not finite"):
        run(input_meshes, replace(SMALL, segment_by="reading"))
