"""The report: one page, everything inside, nothing asked of the network, words for pictures."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.errors import OptionError
from terraport_pipeline.report.input_cloud import InputCloud
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.report import ReportOptions, write_report
from terraport_store import SceneNotFoundError

SMALL = ReportOptions(PictureOptions(160, 90, 1), rays=2_000, subsets=4)
NO_PROOF = ReportOptions(PictureOptions(160, 90, 1), rays=0)


class Page(HTMLParser):
    """Tags of a page, and whether they close in order."""

    VOID = frozenset({"meta", "img", "br", "rect", "line"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs) -> None:
        attributes = dict(attrs)
        if tag == "img":
            self.images.append(attributes)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if "href" in attributes:
            self.links.append(attributes["href"])
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs) -> None:
        pass

    def handle_endtag(self, tag) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def copy(scene_path, tmp_path_factory):
    """A scene that may be written beside."""
    return shutil.copytree(scene_path, tmp_path_factory.mktemp("report") / "ground")


@pytest.fixture(scope="module")
def page(copy):
    record = {
        "seconds": 12.5,
        "stages": [
            {
                "name": "read",
                "seconds": 2.5,
                "peak_bytes": 2_000_000,
                "counts": {"points": 5, "spacing_m": 0.25},
            },
            {"name": "clean", "seconds": 0.0, "taken_up": True},
        ],
    }
    (copy / "build.json").write_text(json.dumps(record))
    result = write_report(copy, options=SMALL)
    assert result.path == copy / "report.html"
    return result, result.path.read_text(encoding="utf-8")


def test_page_is_whole_and_asks_for_nothing(page) -> None:
    result, text = page
    parsed = Page(text)
    assert parsed.open == []
    assert len(parsed.ids) == len(set(parsed.ids))
    assert all(link.startswith("#") and link[1:] in parsed.ids for link in parsed.links)
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    assert "url(" not in text
    assert "<script" not in text
    assert len(text.encode()) == result.bytes


def test_every_picture_is_there_with_words_and_its_true_size(page) -> None:
    result, text = page
    images = Page(text).images
    assert len(images) == len(result.pictures)
    assert result.pictures == (
        "plan",
        "detail",
        "base",
        "regions",
        "segments",
        "attribute-grade",
        "hand-off-above",
        "hand-off-eye-tinted",
        "hand-off-eye",
        "worst",
    )
    sizes = []
    for image in images:
        assert len(image["alt"]) > 20
        data = base64.b64decode(image["src"].removeprefix("data:image/jpeg;base64,"))
        with Image.open(io.BytesIO(data)) as read:
            assert read.size == (int(image["width"]), int(image["height"]))
            sizes.append(read.size)
            assert np.asarray(read).std() > 5  # something is on it
    # The plan has the ground's form; the worst place has three panels of their own size.
    assert sizes[0] == (89, 89)
    assert sorted(sizes[1:]) == [(160, 90)] * 8 + [(3 * 560 + 12, 420 + 22)]


def test_numbers_names_and_warnings_are_on_the_page(page) -> None:
    _, text = page
    assert "rolling &lt;ground&gt;" in text  # escaped
    assert "rolling <ground>" not in text
    for words in ("123,456", "80,000", "EPSG:32633", "12 points were outliers", "No hole", "12.5"):
        assert words in text
    assert "taken up" in text
    assert "points 5, spacing 0.25 m" in text
    assert "No picture of the input" in text


def test_input_is_drawn_first_when_it_is_at_hand(copy, tmp_path, detail) -> None:
    cloud = InputCloud(detail.vertices, detail.colours, 0.5, 777_777)
    result = write_report(copy, tmp_path / "r.html", NO_PROOF, cloud=lambda _: cloud)
    text = result.path.read_text(encoding="utf-8")
    assert result.pictures[:3] == ("plan", "accuracy", "input")
    assert "777,777 points, of which 40,401 are drawn" in text
    assert "No picture of the input" not in text
    assert result.proof is None
    assert "Proof by rays" not in text


def test_same_scene_same_page(copy, tmp_path) -> None:
    first = write_report(copy, tmp_path / "one.html", SMALL)
    second = write_report(copy, tmp_path / "two.html", SMALL)
    assert first.path.read_bytes() == second.path.read_bytes()
    assert first.pdf_path.read_bytes() == second.pdf_path.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "one.html", "one.pdf", "two.html", "two.pdf",
    ]  # fmt: skip


def test_a_damaged_build_record_costs_only_the_timings(copy, tmp_path) -> None:
    other = shutil.copytree(copy, tmp_path / "other")
    (other / "build.json").write_text("{broken")
    text = write_report(other, options=NO_PROOF).path.read_text(encoding="utf-8")
    assert "No timings" in text


def test_no_scene_and_no_folder_are_refused(tmp_path, copy) -> None:
    with pytest.raises(SceneNotFoundError):
        write_report(tmp_path)
    with pytest.raises(OptionError, match="expected an existing folder"):
        write_report(copy, tmp_path / "no" / "r.html")
