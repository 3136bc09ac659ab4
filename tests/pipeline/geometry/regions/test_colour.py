"""The closed form of CIEDE2000 to white against the whole published formula."""

from __future__ import annotations

import math

import numpy as np
import pytest

from terraport_pipeline.geometry.regions.colour import (
    face_colour_sums,
    face_lab,
    srgb_to_lab,
    white_distance,
    white_distance_of_sums,
)


def ciede2000(first, second):
    """Sharma, Wu and Dalal (2005), equations (2) to (22), written out."""
    l1, a1, b1 = first
    l2, a2, b2 = second
    c_bar = (math.hypot(a1, b1) + math.hypot(a2, b2)) / 2
    g = 0.5 * (1 - math.sqrt(c_bar**7 / (c_bar**7 + 25**7)))
    a1p, a2p = (1 + g) * a1, (1 + g) * a2
    c1p, c2p = math.hypot(a1p, b1), math.hypot(a2p, b2)
    h1p = math.degrees(math.atan2(b1, a1p)) % 360 if c1p else 0.0
    h2p = math.degrees(math.atan2(b2, a2p)) % 360 if c2p else 0.0
    dh = 0.0
    if c1p * c2p:
        dh = h2p - h1p
        dh += -360 if dh > 180 else 360 if dh < -180 else 0
    d_h = 2 * math.sqrt(c1p * c2p) * math.sin(math.radians(dh / 2))
    l_bar, cp_bar = (l1 + l2) / 2, (c1p + c2p) / 2
    h_bar = h1p + h2p
    if c1p * c2p:
        if abs(h1p - h2p) <= 180:
            h_bar = h_bar / 2
        else:
            h_bar = (h_bar + 360) / 2 if h_bar < 360 else (h_bar - 360) / 2
    t = (
        1
        - 0.17 * math.cos(math.radians(h_bar - 30))
        + 0.24 * math.cos(math.radians(2 * h_bar))
        + 0.32 * math.cos(math.radians(3 * h_bar + 6))
        - 0.20 * math.cos(math.radians(4 * h_bar - 63))
    )
    theta = 30 * math.exp(-(((h_bar - 275) / 25) ** 2))
    r_c = 2 * math.sqrt(cp_bar**7 / (cp_bar**7 + 25**7))
    s_l = 1 + 0.015 * (l_bar - 50) ** 2 / math.sqrt(20 + (l_bar - 50) ** 2)
    s_c, s_h = 1 + 0.045 * cp_bar, 1 + 0.015 * cp_bar * t
    r_t = -math.sin(math.radians(2 * theta)) * r_c
    x, y, z = (l2 - l1) / s_l, (c2p - c1p) / s_c, d_h / s_h
    return math.sqrt(x * x + y * y + z * z + r_t * y * z)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [  # rows 1, 7, 17 and 25 of the paper's table 1
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ],
)
def test_the_oracle_gives_the_published_values(first, second, expected):
    """The formula above is the published one, so it may judge the closed form."""
    assert ciede2000(first, second) == pytest.approx(expected, abs=5e-5)


def test_closed_form_equals_the_whole_formula():
    """On random colours and the corners of the cube."""
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid([0, 255], [0, 255], [0, 255])).reshape(3, 8).T
    colours = np.concatenate([corners, rng.integers(0, 256, (300, 3))]).astype(np.uint8)
    expected = [ciede2000((100.0, 0.0, 0.0), lab) for lab in srgb_to_lab(colours)]
    np.testing.assert_allclose(white_distance(colours), expected, atol=2e-5)
    np.testing.assert_allclose(white_distance(colours.astype(np.float64)), expected, atol=2e-5)


def test_lab_of_known_colours():
    """Published CIELAB values (D65) of the primaries."""
    colours = np.array(
        [[255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]], np.uint8
    )
    expected = [
        [100, 0, 0],
        [53.24, 80.09, 67.20],
        [87.73, -86.18, 83.18],
        [32.30, 79.19, -107.86],
        [0, 0, 0],
    ]
    np.testing.assert_allclose(srgb_to_lab(colours), expected, atol=0.01)


def test_face_colour_is_the_mean_and_ignores_corner_order(soup):
    """Sums keep thirds exactly; the table of 766 entries gives the formula's value for them."""
    mesh = soup(3)
    sums = face_colour_sums(mesh.colours, mesh.faces)
    mean = mesh.colours[mesh.faces].astype(np.float64).mean(axis=1)
    np.testing.assert_allclose(sums / 3.0, mean)
    np.testing.assert_array_equal(sums, face_colour_sums(mesh.colours, mesh.faces[:, [2, 0, 1]]))
    np.testing.assert_allclose(white_distance_of_sums(sums, 3), white_distance(mean), atol=1e-5)


def test_face_lab_is_the_lab_of_the_mean_colour(soup):
    """The compiled table of thirds gives the formula's value, to half a step."""
    mesh = soup(4)
    mean = mesh.colours[mesh.faces].astype(np.float64).mean(axis=1)
    lab = face_lab(mesh.colours, mesh.faces, 100.0)
    np.testing.assert_allclose(lab / 100.0, srgb_to_lab(mean), atol=0.0051)


def test_blind_to_hue():
    """Equal lightness and chroma give equal indices whatever the hue: a known limit, not a slip."""
    red, green = (50.0, 30.0, 0.0), (50.0, -30.0, 0.0)
    white = (100.0, 0.0, 0.0)
    assert ciede2000(red, green) > 45
    assert ciede2000(red, white) == pytest.approx(ciede2000(green, white))
    assert ciede2000(red, white) == pytest.approx(42.496, abs=1e-3)


def test_wrong_shape_is_named():
    """The shape received and the shape expected."""
    with pytest.raises(ValueError, match=r"shape \(4,\), expected \(N, 3\)"):
        white_distance(np.zeros(4, np.uint8))
    assert white_distance(np.zeros((0, 3), np.uint8)).shape == (0,)
