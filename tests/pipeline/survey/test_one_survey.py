"""Files that are one survey."""

from __future__ import annotations

from pyproj import CRS

from terraport_pipeline.survey.one_survey import one_crs


def test_files_without_a_system_agree_with_any() -> None:
    assert one_crs([("a", None), ("b", None)]) is None
    assert one_crs([("a", None), ("b", CRS.from_epsg(32735))]) == CRS.from_epsg(32735)
