"""The first screen and the PDF: what a surveyor sees, in the survey's units, whatever the names."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pypdfium2
import pytest
from pyproj import CRS

from terraport_pipeline.report import pdf_page
from terraport_pipeline.report.input_cloud import InputCloud
from terraport_pipeline.report.pdf_page import printable
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.report import ReportOptions, ReportResult, write_report
from terraport_pipeline.report.surveyor import ACCURACY_UNKNOWN
from terraport_store import change_labels, manifest_digest

SMALL = ReportOptions(PictureOptions(160, 90, 2), rays=0)

HOSTILE = {
    7: '<script>alert(1)</script> & "more"',
    9: "\u202e\u05de\u05d7\u05e6\u05d1\u05d4 " + "\u05e6\u05e4\u05d5\u05df" * 30,
}
REGIONS = {
    "next_stable_id": 10,
    "regions": [
        {
            "id": region, "stable_id": number, "area_m2": 6000.0, "plan_area_m2": 5000.0,
            "height_m": {"min": 1.0, "mean": 2.0, "max": 3.5}, "slope_deg": {"mean": 8.0},
        }
        for region, number in enumerate(HOSTILE)
    ],
}  # fmt: skip


def changed(scene: Path, **members: object) -> Path:
    """Change members of a manifest, and give it the version that they ask for."""
    path = scene / "scene.json"
    document = json.loads(path.read_text())
    for name, value in members.items():
        if value is None:
            document.pop(name, None)
        else:
            document[name] = value
    document["version"] = manifest_digest(document)
    path.write_text(json.dumps(document))
    return scene


def pdf_text(path: Path) -> str:
    document = pypdfium2.PdfDocument(path)
    assert len(document) == 1
    text: str = document[0].get_textpage().get_text_range()
    return " ".join(text.split())


def page_text(path: Path) -> str:
    """What a reader of the page sees, folded or not."""
    text = path.read_text(encoding="utf-8")
    bare = re.sub(r"<style>.*?</style>|<[^>]+>", " ", text, flags=re.DOTALL)
    return " ".join(bare.split())


@pytest.fixture(scope="module")
def cloud(detail) -> InputCloud:
    return InputCloud(detail.vertices + np.float32([0, 0.1, 0]), detail.colours, 0.5, 777_777)


@pytest.fixture(scope="module")
def report(tmp_path_factory, write_scene, model, detail, base, cloud) -> ReportResult:
    """A scene with hostile names, its points 10 cm above the mesh."""
    folder = tmp_path_factory.mktemp("surveyor")
    scene = write_scene(folder / "ground", model, detail, base, regions=REGIONS)
    change_labels(scene, HOSTILE)
    return write_report(scene, options=SMALL, cloud=lambda _: cloud)


def test_the_first_screen_says_where_and_how_exact(report) -> None:
    text = page_text(report.path)
    for words in (
        "CRS WGS 84 / UTM zone 33N (EPSG:32633)", "units metres",
        "bias signed mean: mesh below the points -0.", "plan area seen from above 10,0",
        "size east x north 100 m x 100 m", "at 40,401 of 777,777 points",
        "12 points were outliers", "100 m", "point spacing",
    ):  # fmt: skip
        assert words in text, words
    assert report.accuracy is not None
    # Points stand 10 cm above sloping ground.
    assert 0.05 < report.accuracy.percentile_m(50) < 0.1
    # What is streamed is folded away, after everything that a surveyor reads.
    whole = report.path.read_text(encoding="utf-8")
    assert whole.index('id="plan"') < whole.index('id="regions"') < whole.index('id="internals"')
    assert whole.index('<details class="internals"') < whole.index('id="hand-off"')


def test_the_pdf_has_the_same_as_text_and_a_plan(report) -> None:
    text = pdf_text(report.pdf_path)
    for words in (
        'rolling <ground>', "WGS 84 / UTM zone 33N (EPSG:32633)", "plan m²", "above toe m³",
        "95 % of points within", "12 points were outliers", "version ", "500050 E", "published 20",
    ):  # fmt: skip
        assert words in text, words
    pixels = np.asarray(pypdfium2.PdfDocument(report.pdf_path)[0].render(scale=1).to_pil())
    assert pixels.shape[:2] == (842, 596)
    assert pixels[100:300, 60:300].std() > 15  # the plan is drawn


def test_hostile_names_do_no_harm_in_either_form(report) -> None:
    page = report.path.read_text(encoding="utf-8")
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert f"<bdi>9 · {HOSTILE[9]}</bdi>" in page
    text = pdf_text(report.pdf_path)
    assert "7 · <script>" in text  # text is only text
    assert "region 9 *" in text
    assert "font cannot write stands in the HTML page" in text


def test_choices_of_the_build_are_no_warnings_and_each_table_counts_its_own_rows(
    report, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = shutil.copytree(report.path.parent, tmp_path / "ground")
    stated = json.loads((scene / "scene.json").read_text())["build"]
    texts = {"warnings": ["The sun stood low."], "choices": ["Cells are 2 m wide."]}
    monkeypatch.setattr(pdf_page, "MAX_ROWS", 1)
    again = write_report(changed(scene, build={**stated, **texts}), options=SMALL)
    page, pdf = page_text(again.path), pdf_text(again.pdf_path)
    assert page.index("The sun stood low.") < page.index("Regions: areas and volumes")
    assert page.index("Notes") < page.index("Cells are 2 m wide.")
    assert "The sun stood low." in pdf
    assert "Cells are" not in pdf
    assert "The 1 largest of 2 regions." in pdf


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Grube Süd µ² ±3 m³", "Grube Süd µ² ±3 m³"),
        ("Łódź Ørsted ğış", "Łódz Ørsted ğış"),
        ("Příbram ő", "Príbram o"),
        ("a\u0000b\u202ec", "a b c"),
        ("\u043a\u0430\u0440\u044c\u0435\u0440", "region 3"),
        ("", "region 3"),
    ],
)
def test_names_fit_the_font_or_give_way(text: str, expected: str) -> None:
    assert printable(text, "region 3") == expected


def test_a_survey_in_feet_reads_feet(tmp_path, scene_path, cloud) -> None:
    foot = 1200 / 3937
    scene = changed(
        shutil.copytree(scene_path, tmp_path / "feet"),
        crs={"name": "NAD83 / New York Long Island (ftUS) (in metres)", "epsg": 32118},
        survey_units={
            "horizontal_m": foot,
            "height_m": foot,
            "crs_wkt": CRS.from_epsg(2263).to_wkt(),
        },
    )
    result = write_report(scene, options=SMALL, cloud=lambda _: cloud)
    for text in (page_text(result.path), pdf_text(result.pdf_path)):
        assert "NAD83 / New York Long Island (ftUS) (EPSG:2263)" in text
        assert "US survey feet" in text
        assert "328 ft x 328 ft" in text
        assert "above toe ft³" in text
        assert f"{round(100 * 100 / foot**2, -3):,.0f}"[:4] in text  # 107,6..
        assert " m²" not in text.partition("Internals: how")[0]
    # With the base, which is 2.5 m wider.
    box = f"E {499_997.5 / foot:,.2f} to {500_102.5 / foot:,.2f}"
    assert box in page_text(result.path)


def test_without_crs_and_points_both_are_said_and_how_to_get_them(tmp_path, scene_path) -> None:
    scene = changed(shutil.copytree(scene_path, tmp_path / "bare"), crs=None)
    result = write_report(scene, options=SMALL)
    assert result.accuracy is None
    page, pdf = page_text(result.path), pdf_text(result.pdf_path)
    for text in (page, pdf):
        assert "none stated" in text
        assert "--crs EPSG:n" in text
        assert "Unknown: the survey&#39;s points" in text or "Unknown: the survey's points" in text
    assert "terraport report SCENE --work DIR" in page
    assert "--survey FILE" in ACCURACY_UNKNOWN


def test_points_far_from_the_mesh_are_a_warning(tmp_path, scene_path, detail) -> None:
    points = detail.vertices.copy()
    points[:2000, 1] += 9.0
    cloud = InputCloud(points, detail.colours, 0.5, len(points))
    result = write_report(scene_path, tmp_path / "far.html", SMALL, cloud=lambda _: cloud)
    assert re.search(
        r"[45]\.\d% of the points lie more than 2\.50 m from the mesh", page_text(result.path)
    )
