from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from terraport_research.line_chart import HEIGHT, WIDTH, Line, line_chart


def test_lines_points_and_the_ring() -> None:
    lines = [
        Line("one <&>", ((8, 0.0), (9, 500.0), (10, 1000.0)), marked_x=9),
        Line("two", ((8, 250.0), (10, 250.0))),
    ]
    svg = line_chart(lines, x_title="depth", y_title="thousands", y_unit=1e3, title='a "chart"')
    root = ET.fromstring(svg)
    circles = root.findall("circle")
    assert len(circles) == 5
    assert [circle.get("class") for circle in circles].count("line0 marked") == 1
    ys = [float(circle.get("cy", "")) for circle in circles]
    assert ys[0] > ys[1] > ys[2]  # more is higher
    assert ys[1] == pytest.approx((ys[0] + ys[2]) / 2)
    assert all(0 <= float(circle.get("cx", "")) <= WIDTH for circle in circles)
    assert all(0 <= y <= HEIGHT for y in ys)
    assert "one &lt;&amp;&gt;" in svg
    assert [label.text for label in root.findall("text")][:6] == [
        "0",
        "0.2",
        "0.4",
        "0.6",
        "0.8",
        "1",
    ]


def test_nothing_gives_an_empty_chart() -> None:
    ET.fromstring(line_chart([], x_title="x", y_title="y", title="none"))
