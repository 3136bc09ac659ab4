"""Line charts as SVG, small enough to write oneself; colours follow the page's.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

__all__ = ["Line", "line_chart"]

WIDTH: Final = 560
HEIGHT: Final = 300
_LEFT: Final = 56
_RIGHT: Final = 12
_TOP: Final = 14
_BOTTOM: Final = 40
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Line:
    """One polyline of a chart, with its title and an x to mark."""

    title: str
    points: tuple[tuple[float, float], ...]
    """(x, y), x ascending."""
    marked_x: float | None = None
    """Where a ring is drawn."""


def line_chart(
    lines: Sequence[Line], *, x_title: str, y_title: str, y_unit: float = 1.0, title: str
) -> str:
    """Draw lines over whole-numbered x.

    Parameters
    ----------
    lines : sequence of Line
    x_title, y_title : str
    y_unit : float
        Values are shown in this: 1e6 shows millions.
    title : str
        For those who cannot see it.

    Returns
    -------
    str
        An ``svg`` element that uses the classes ``line0``, ``line1``, ... of the page's style.
    """
    xs = sorted({x for line in lines for x, _ in line.points})
    top = _nice_top(max((y for line in lines for _, y in line.points), default=0.0) / y_unit)
    low, high = (xs[0], xs[-1]) if xs else (0.0, 1.0)
    span = max(high - low, 1.0)

    def across(x: float) -> float:
        return round(_LEFT + (x - low) / span * (WIDTH - _LEFT - _RIGHT), 1)

    def down(y: float) -> float:
        return round(HEIGHT - _BOTTOM - y / y_unit / top * (HEIGHT - _TOP - _BOTTOM), 1)

    elements = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title, quote=True)}">'
    ]
    for step in range(6):
        value = top * step / 5
        y = down(value * y_unit)
        elements.append(f'<line x1="{_LEFT}" y1="{y}" x2="{WIDTH - _RIGHT}" y2="{y}"/>')
        elements.append(f'<text x="{_LEFT - 6}" y="{y + 4}" text-anchor="end">{value:,.3g}</text>')
    foot = HEIGHT - _BOTTOM + 16
    elements += [f'<text x="{across(x)}" y="{foot}" text-anchor="middle">{x:g}</text>' for x in xs]
    middle = (WIDTH + _LEFT - _RIGHT) / 2
    elements.append(
        f'<text x="{middle}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_title)}</text>'
    )
    elements.append(f'<text x="{_LEFT - 44}" y="{_TOP - 3}">{escape(y_title)}</text>')
    for number, line in enumerate(lines):
        path = " ".join(f"{across(x)},{down(y)}" for x, y in line.points)
        elements.append(f'<polyline class="line{number}" points="{path}"/>')
        for x, y in line.points:
            marked = x == line.marked_x
            elements.append(
                f'<circle class="line{number}{" marked" if marked else ""}" cx="{across(x)}" '
                f'cy="{down(y)}" r="{7 if marked else 3}"><title>{escape(line.title)}, {x:g}: '
                f"{y:,.4g}</title></circle>"
            )
    elements.append("</svg>")
    return "".join(elements)


def _nice_top(value: float) -> float:
    """Smallest round number not below a value, for the top of an axis."""
    if value <= 0:
        return 1.0
    power = 1.0
    while power * 10 <= value:
        power *= 10
    while power > value:
        power /= 10
    return next(step * power for step in _STEPS if step * power >= value * (1 - 1e-9))
