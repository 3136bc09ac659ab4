"""The first screen of a report as one page of PDF, to print and to send.

Text is text: it can be searched and copied. Its font (Bitstream Vera, which comes with reportlab)
has the Latin letters, the Greek mu and what units need; a name in another script is given by its
number, and the note below says that the HTML page has it.
"""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

import reportlab
from reportlab.lib.colors import Color, HexColor, white
from reportlab.lib.pagesizes import A4
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas

from terraport_pipeline.report.picture import Picture
from terraport_pipeline.report.surveyor import Figure, SurveyorFacts

__all__ = ["pdf_page", "printable"]

_PLAIN: Final = "TerraportVera"
_BOLD: Final = "TerraportVera-Bold"

_MARGIN: Final = 36.0
_INK: Final = HexColor("#1b2430")
_SOFT: Final = HexColor("#56616f")
_LINE: Final = HexColor("#c9d0d9")
_WARN: Final = HexColor("#8a5a00")
_WARN_GROUND: Final = HexColor("#fff6e0")

MAX_ROWS: Final = 14
"""Regions of the table; the HTML page has more."""

MAX_WARNINGS: Final = 5


def pdf_page(survey: SurveyorFacts, pictures: Mapping[str, Picture]) -> bytes:
    """Make the page.

    Parameters
    ----------
    survey : SurveyorFacts
    pictures : mapping
        ``plan``, and ``accuracy`` where there is one.

    Returns
    -------
    bytes
        One page of A4, fonts embedded; same facts, same bytes.
    """
    _register()
    out = io.BytesIO()
    canvas = Canvas(out, pagesize=A4, invariant=1, pageCompression=1)
    canvas.setTitle(f"{survey.name} · terraport report")
    canvas.setSubject(f"Survey report, version {survey.version}")
    sheet = _Sheet(canvas)
    # (1) What and where.
    top = sheet.title(survey)
    # (2) The plan at the left, figures beside it.
    left, right = _MARGIN, A4[0] - _MARGIN
    plan_width = 364.0
    below = sheet.plan(survey, pictures["plan"], left, top, plan_width, 340.0)
    column = left + plan_width + 14.0
    figures_below = sheet.figures(
        (("Distance of points to mesh", survey.accuracy or (Figure("unknown", "-"),)),
         *survey.groups,
         *((("Change since the last survey", survey.change),) if survey.change else ())),
        column, top, right - column,
    )  # fmt: skip
    row = min(below, figures_below) - 12.0
    # (3) The map of distances and the regions.
    table_left = left
    map_below = row
    if "accuracy" in pictures:
        map_below = sheet.distances(survey, pictures["accuracy"], left, row, 210.0, 200.0)
        table_left = left + 222.0
    table_below = sheet.regions(survey, table_left, row, right - table_left)
    # (4) What to look out for, and what the words mean.
    sheet.warnings(survey, left, min(map_below, table_below) - 10.0, right - left)
    sheet.footer(survey, left, right - left)
    canvas.showPage()
    canvas.save()
    return out.getvalue()


def printable(text: str, otherwise: str | None = None) -> str:
    r"""Fit a text to the font: letters that it lacks lose their accents.

    Parameters
    ----------
    text : str
        Any; control characters become blanks.
    otherwise : str, optional
        Taken where the text is in another script; None writes ``?`` for each such letter.

    Examples
    --------
    >>> printable("Přístav Ø 3\n", "region 4"), printable("\u05de\u05d7", "region 4")
    ('Prístav Ø 3', 'region 4')
    >>> printable("CRS \u05de\u05d7")
    'CRS ??'
    """
    _register()
    glyphs = _glyphs()
    letters = []
    for letter in text:
        if unicodedata.category(letter) in ("Cc", "Cf", "Zl", "Zp", "Cs", "Co"):
            letters.append(" ")
        elif ord(letter) in glyphs:
            letters.append(letter)
        else:
            bare = [
                c for c in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(c)
            ]
            if not bare or not all(ord(c) in glyphs for c in bare):
                if otherwise is not None:
                    return otherwise
                bare = ["?"]
            letters += bare
    return " ".join("".join(letters).split()) or otherwise or ""


@lru_cache(maxsize=1)
def _register() -> None:
    fonts = Path(reportlab.__file__).parent / "fonts"
    pdfmetrics.registerFont(TTFont(_PLAIN, str(fonts / "Vera.ttf")))
    pdfmetrics.registerFont(TTFont(_BOLD, str(fonts / "VeraBd.ttf")))


@lru_cache(maxsize=1)
def _glyphs() -> frozenset[int]:
    return frozenset(pdfmetrics.getFont(_PLAIN).face.charToGlyph)


def _clipped(text: str, font: str, size: float, width: float) -> str:
    """Cut a text to a width, with an ellipsis."""
    if stringWidth(text, font, size) <= width:
        return text
    low, high = 0, len(text)
    # Invariant: the first `low` letters and the ellipsis fit, the first `high` do not.
    while high - low > 1:
        middle = (low + high) // 2
        fits = stringWidth(f"{text[:middle].rstrip()}…", font, size) <= width
        low, high = (middle, high) if fits else (low, middle)
    return f"{text[:low].rstrip()}…"


def _wrapped(text: str, font: str, size: float, width: float, lines: int) -> list[str]:
    """Break a text into lines, the last with an ellipsis where it has no room."""
    out: list[str] = []
    words = text.split()
    line = ""
    for position, word in enumerate(words):
        longer = f"{line} {word}" if line else word
        if stringWidth(longer, font, size) <= width or not line:
            line = longer
            continue
        if len(out) == lines - 1:
            return [*out, _clipped(" ".join([line, *words[position:]]), font, size, width)]
        out.append(_clipped(line, font, size, width))
        line = word
    return [*out, _clipped(line, font, size, width)] if line else out


class _Sheet:
    """Draws blocks of the page; each returns how far down it reaches."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas

    def _text(
        self,
        x: float,
        y: float,
        text: str,
        size: float,
        *,
        font: str = _PLAIN,
        colour: Color = _INK,
        align: str = "left",
        width: float | None = None,
    ) -> None:
        shown = printable(text)
        if width is not None:
            shown = _clipped(shown, font, size, width)
        self._canvas.setFont(font, size)
        self._canvas.setFillColor(colour)
        draw = {
            "left": self._canvas.drawString,
            "right": self._canvas.drawRightString,
            "middle": self._canvas.drawCentredString,
        }[align]
        draw(x, y, shown)

    def title(self, survey: SurveyorFacts) -> float:
        """Say what scene this is, and where."""
        width = A4[0] - 2 * _MARGIN
        y = A4[1] - _MARGIN - 14.0
        name = printable(survey.name, f"scene {survey.version}")
        self._text(_MARGIN, y, name, 17.0, font=_BOLD, width=width)
        self._text(
            _MARGIN, y - 15.0, f"CRS: {survey.crs} · units: {survey.units}", 8.5, width=width
        )
        self._text(
            _MARGIN,
            y - 27.0,
            f"published {survey.published} · version {survey.version} · terraport "
            f"{survey.terraport} · {survey.extent}",
            8.5,
            colour=_SOFT,
            width=width,
        )
        self._canvas.setStrokeColor(_LINE)
        self._canvas.line(_MARGIN, y - 35.0, A4[0] - _MARGIN, y - 35.0)
        return float(y - 46.0)

    def plan(
        self,
        survey: SurveyorFacts,
        picture: Picture,
        left: float,
        top: float,
        width: float,
        most: float,
    ) -> float:
        """Draw the plan in its frame: grid, coordinates, scale bar, north."""
        canvas, sheet = self._canvas, survey.sheet
        room = 12.0  # for northings at the left, upright
        scale = min((width - room) / picture.width, most / picture.height)
        wide, high = picture.width * scale, picture.height * scale
        x, y = left + room, top - high
        canvas.drawImage(ImageReader(io.BytesIO(picture.jpeg)), x, y, wide, high)
        canvas.setLineWidth(0.3)
        canvas.setStrokeColor(Color(0.1, 0.14, 0.19, alpha=0.45))
        for line in sheet.eastings:
            canvas.line(x + line.share * wide, y, x + line.share * wide, top)
            self._text(x + line.share * wide, y - 8.0, f"{line.label} E", 6.0, align="middle")
        for line in sheet.northings:
            canvas.line(x, top - line.share * high, x + wide, top - line.share * high)
            canvas.saveState()
            canvas.translate(x - 4.0, top - line.share * high)
            canvas.rotate(90)
            self._text(0.0, 0.0, f"{line.label} N", 6.0, align="middle")
            canvas.restoreState()
        canvas.setStrokeColor(_INK)
        canvas.setLineWidth(0.6)
        canvas.rect(x, y, wide, high, stroke=1, fill=0)
        for region in survey.regions[:MAX_ROWS]:
            if region.place is not None:
                self._mark(x + region.place[0] * wide, top - region.place[1] * high, region.number)
        # The scale bar and the arrow stand below the frame: nothing hides the ground.
        bar, bar_y = sheet.bar_share * wide, y - 22.0
        canvas.setFillColor(_INK)
        canvas.rect(x, bar_y, bar / 2, 3.5, stroke=1, fill=1)
        canvas.setFillColor(white)
        canvas.rect(x + bar / 2, bar_y, bar / 2, 3.5, stroke=1, fill=1)
        self._text(x + bar + 5.0, bar_y - 0.5, sheet.bar_label, 7.0, font=_BOLD)
        arrow = x + wide - 8.0
        path = canvas.beginPath()
        path.moveTo(arrow, bar_y + 9.0)
        path.lineTo(arrow - 3.5, bar_y - 3.0)
        path.lineTo(arrow, bar_y - 0.5)
        path.lineTo(arrow + 3.5, bar_y - 3.0)
        path.close()
        canvas.setFillColor(_INK)
        canvas.drawPath(path, stroke=0, fill=1)
        self._text(arrow - 9.0, bar_y - 1.5, "N", 8.0, font=_BOLD, align="middle")
        (_, west, south), (_, east, north) = sheet.corners
        self._text(
            x, bar_y - 12.0, f"frame: E {west} to {east}, N {south} to {north}", 6.5,
            colour=_SOFT, width=wide,
        )  # fmt: skip
        return float(bar_y - 14.0)

    def _mark(self, x: float, y: float, number: str) -> None:
        """Write a region's number on the plan, in a white halo."""
        canvas = self._canvas
        half = stringWidth(number, _BOLD, 6.5) / 2 + 1.6
        canvas.setFillColor(Color(1.0, 1.0, 1.0, alpha=0.8))
        canvas.roundRect(x - half, y - 3.6, 2 * half, 7.8, 2.5, stroke=0, fill=1)
        self._text(x, y - 2.2, number, 6.5, font=_BOLD, align="middle")

    def figures(
        self,
        groups: Sequence[tuple[str, Sequence[Figure]]],
        left: float,
        top: float,
        width: float,
    ) -> float:
        """Tabulate numbers under headings."""
        y = top
        for heading, figures in groups:
            y -= 8.0
            self._text(left, y, heading, 8.0, font=_BOLD, width=width)
            self._canvas.setStrokeColor(_LINE)
            self._canvas.setLineWidth(0.5)
            self._canvas.line(left, y - 3.0, left + width, y - 3.0)
            y -= 3.0
            for figure in figures:
                y -= 10.5
                value = printable(figure.value)
                taken = stringWidth(value, _BOLD, 7.5)
                self._text(
                    left, y, figure.label, 7.5, colour=_SOFT, width=max(width - taken - 6.0, 20.0)
                )
                self._text(left + width, y, value, 7.5, font=_BOLD, align="right", width=width)
            y -= 7.0
        return y

    def distances(
        self,
        survey: SurveyorFacts,
        picture: Picture,
        left: float,
        top: float,
        width: float,
        most: float,
    ) -> float:
        """Draw the map of distances with its ramp."""
        canvas = self._canvas
        self._text(left, top - 8.0, "Mean distance of points to mesh", 8.0, font=_BOLD, width=width)
        top -= 14.0
        scale = min(width / picture.width, most / picture.height)
        wide, high = picture.width * scale, picture.height * scale
        canvas.drawImage(ImageReader(io.BytesIO(picture.jpeg)), left, top - high, wide, high)
        canvas.setStrokeColor(_INK)
        canvas.setLineWidth(0.6)
        canvas.rect(left, top - high, wide, high, stroke=1, fill=0)
        stops = () if picture.legend is None else picture.legend.stops
        y = top - high - 10.0
        if stops:
            self._ramp(left + 10.0, y - 1.0, max(wide - 60.0, 20.0), stops)
            self._text(left, y, "0", 6.5)
            self._text(left + wide, y, survey.map_top, 6.5, align="right")
        return y - 4.0

    def _ramp(self, x: float, y: float, width: float, stops: Sequence[str]) -> None:
        for number, stop in enumerate(stops):
            self._canvas.setFillColor(HexColor(stop))
            self._canvas.rect(
                x + number * width / len(stops), y, width / len(stops) + 0.3, 6.0, stroke=0, fill=1
            )

    def regions(self, survey: SurveyorFacts, left: float, top: float, width: float) -> float:
        """Tabulate the largest regions: areas and volumes."""
        if not survey.regions:
            return top
        area, volume, _ = survey.region_units
        self._text(left, top - 8.0, "Regions: areas and volumes", 8.0, font=_BOLD, width=width)
        y = top - 20.0
        heads = (f"plan {area}", f"surface {area}", f"above toe {volume}", f"below toe {volume}")
        first = max(width - 4 * 52.0, width * 0.25)
        step = (width - first) / 4
        for number, head in enumerate(heads):
            self._text(
                left + first + (number + 1) * step, y, head, 6.0, colour=_SOFT, align="right",
                width=step - 2.0,
            )  # fmt: skip
        self._canvas.setStrokeColor(_LINE)
        self._canvas.setLineWidth(0.5)
        self._canvas.line(left, y - 3.0, left + width, y - 3.0)
        for line in survey.regions[:MAX_ROWS]:
            y -= 11.5
            self._canvas.setFillColor(HexColor(line.colour))
            self._canvas.rect(left, y - 0.5, 6.0, 6.0, stroke=0, fill=1)
            name = printable(line.name, f"region {line.number} *")
            self._text(left + 9.0, y, name, 7.0, width=first - 11.0)
            cells = (line.plan_area, line.surface_area, line.above, line.below)
            for number, cell in enumerate(cells):
                self._text(
                    left + first + (number + 1) * step, y, cell or "-", 7.0, align="right",
                    width=step - 2.0,
                )  # fmt: skip
        y -= 4.0
        for text in _wrapped(survey.regions_line(MAX_ROWS), _PLAIN, 6.0, width, 4):
            y -= 8.0
            self._text(left, y, text, 6.0, colour=_SOFT)
        return y

    def warnings(self, survey: SurveyorFacts, left: float, top: float, width: float) -> None:
        """Say what to look out for; nothing where there is nothing."""
        if not survey.warnings:
            return
        lines: list[tuple[str, bool]] = []
        for text in survey.warnings[:MAX_WARNINGS]:
            shown = printable(text)
            pieces = _wrapped(shown, _PLAIN, 7.0, width - 24.0, 2)
            lines += [(piece, number == 0) for number, piece in enumerate(pieces)]
        more = len(survey.warnings) - MAX_WARNINGS
        if more > 0:
            lines.append((f"and {more:,} more in the HTML page", True))
        # Never over the footer: the last lines give way.
        room = int((top - _MARGIN - 40.0) / 9.5) - 1
        lines = lines[: max(room, 1)]
        height = 9.5 * len(lines) + 18.0
        self._canvas.setFillColor(_WARN_GROUND)
        self._canvas.setStrokeColor(_WARN)
        self._canvas.rect(left, top - height, width, height, stroke=1, fill=1)
        self._text(left + 7.0, top - 11.0, "To know", 8.0, font=_BOLD, colour=_WARN)
        for number, (text, is_first) in enumerate(lines):
            y = top - 21.0 - 9.5 * number
            if is_first:
                self._text(left + 8.0, y, "·", 8.0, font=_BOLD)
            self._text(left + 16.0, y, text, 7.0)

    def footer(self, survey: SurveyorFacts, left: float, width: float) -> None:
        """Say what the distances mean."""
        note = survey.accuracy_note
        if any(printable(line.name, "") == "" for line in survey.regions[:MAX_ROWS]):
            note = f"{note} * A name that this page's font cannot write stands in the HTML page."
        lines = _wrapped(note, _PLAIN, 6.5, width, 3)
        y = _MARGIN + 8.0 * (len(lines) - 1)
        self._canvas.setStrokeColor(_LINE)
        self._canvas.line(left, y + 10.0, left + width, y + 10.0)
        for number, text in enumerate(lines):
            self._text(left, y - 8.0 * number, text, 6.5, colour=_SOFT)
