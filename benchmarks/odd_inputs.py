"""Mistaken and odd surveys, as people really give them: what a build makes of each.

A hill of 40 by 40 m is written in some forty ways: in feet, in degrees, with axes swapped, point
numbers, wrong CRS, stray points, damaged, as no survey at all. For each the command must either
refuse it in one message that says what to add, or build it at its true size, with a warning where
something was assumed. A scene of another size without a word, half a scene, or a traceback fails.

    python benchmarks/odd_inputs.py             about a minute
    python benchmarks/odd_inputs.py --only feet
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import laspy
import numpy as np
import typer
from pyproj import CRS, Transformer
from typer.testing import CliRunner

from terraport_payload.types import Float64, UInt8
from terraport_pipeline.cli.build import register
from terraport_store import Scene

SIDE_M: Final = 40.0
EDGE_M: Final = 6.0
"""The surface reaches so far beyond the last points at most; feet would be 12 m or 91 m off."""
UTM: Final = np.array([480_000.0, 2_210_000.0, 1_200.0])
FOOT_M: Final = 0.3048
REFUSED: Final = "refused"
WARNED: Final = "built, warned"
BUILT: Final = "built"


@dataclass(frozen=True)
class Case:
    """One way to give a survey, and what must come of it."""

    name: str
    write: Callable[[Path], object]
    """Writes into an empty folder; what it returns, a path or several, is given to the build."""
    outcome: str
    words: str
    """Stands in what is said."""
    options: tuple[str, ...] = ()


def hill(count: int = 3000) -> tuple[Float64, UInt8]:
    """Points about the origin, metres east, north, up, and their colours."""
    rng = np.random.default_rng(3)
    east, north = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (2, count))
    up = 4 * np.sin(east / 9) * np.cos(north / 11) + 0.05 * east
    rgb = np.where((east > 0)[:, None], (200, 60, 40), (60, 120, 50)).astype(np.uint8)
    return np.stack([east, north, up], axis=1), rgb


HILL, RGB = hill()
AT_UTM: Final = HILL + UTM
AT_NEW_YORK: Final = HILL + np.array([300_000.0, 60_000.0, 30.0])
"""In metres of a CRS that has feet."""
AWAY: Final = np.array([300_000.0, 0.0, 0.0])


def las(
    path: Path, points: Float64, crs: str | None = None, rgb: UInt8 | None = RGB, step: float = 1e-3
) -> Path:
    """Write LAS or LAZ by the ending."""
    header = laspy.LasHeader(point_format=7 if rgb is not None else 6, version="1.4")
    header.offsets, header.scales = np.floor(points.min(axis=0)), [step, step, 1e-3]
    if crs is not None:
        header.add_crs(CRS(crs))
    records = laspy.LasData(header)
    records.x, records.y, records.z = points.T
    if rgb is not None:
        records.red, records.green, records.blue = rgb.astype(np.uint16).T * 257
    records.write(path)
    return path


def noisy(folder: Path) -> Path:
    """Write the hill with points up to 60 m above it that the file calls noise."""
    path = las(folder / "a.las", AT_UTM, "EPSG:32614")
    records = laspy.read(path)
    classes, z = np.full(len(records), 2, np.uint8), np.asarray(records.z).copy()
    classes[::20] = 7
    z[::20] += np.linspace(20.0, 60.0, len(z[::20]))
    records.classification, records.z = classes, z
    records.write(path)
    return path


def text(
    path: Path, columns: Sequence[Sequence[object]], separator: str = " ", header: str = ""
) -> Path:
    """Write columns as lines."""
    lines = [separator.join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*([header] if header else []), *lines, ""]), encoding="utf-8")
    return path


def columns_of(points: Float64, decimals: int = 3) -> list[list[str]]:
    """Coordinates as text, column by column."""
    return [[f"{value:.{decimals}f}" for value in axis] for axis in points.T]


def degrees() -> Float64:
    """Give the hill in longitude, latitude, metres."""
    to_degrees = Transformer.from_crs(32614, 4326, always_xy=True)
    longitude, latitude = to_degrees.transform(AT_UTM[:, 0], AT_UTM[:, 1])
    return np.stack([longitude, latitude, AT_UTM[:, 2]], axis=1)


def in_crs(target: str) -> Float64:
    """Give the hill in another CRS, by its place on Earth."""
    x, y = Transformer.from_crs(32614, target, always_xy=True).transform(AT_UTM[:, 0], AT_UTM[:, 1])
    return np.stack([x, y, AT_UTM[:, 2]], axis=1)


def ply(path: Path, points: Float64, *, faces: bool = False) -> Path:
    """Write an ASCII PLY without colours."""
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    if faces:
        head += "element face 1\nproperty list uchar int vertex_indices\n"
    rows = "\n".join(" ".join(row) for row in zip(*columns_of(points), strict=True))
    path.write_text(f"{head}end_header\n{rows}\n{'3 0 1 2' if faces else ''}\n")
    return path


def cut(path: Path, share: float) -> Path:
    """Keep the first part of a file."""
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    return path


def stray(*points: Sequence[float]) -> Float64:
    """Give the hill with further points."""
    return np.concatenate([AT_UTM, np.array(points, np.float64)])


def tile(folder: Path, name: str, points: Float64, crs: str | None = "EPSG:32614") -> Path:
    """Write a tile into a delivery's folder, and return the folder."""
    folder = folder / "delivery"
    folder.mkdir(exist_ok=True)
    las(folder / name, points, crs, RGB[: len(points)])
    return folder


def zipped(folder: Path) -> Path:
    """Write a ZIP archive under a survey's name."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("a.xyz", "1 2 3\n")
    (folder / "a.laz").write_bytes(buffer.getvalue())
    return folder / "a.laz"


def photos(folder: Path) -> Path:
    """Make a folder with two pictures."""
    (folder / "photos").mkdir()
    for name in ("DJI_0001.JPG", "DJI_0002.JPG"):
        (folder / "photos" / name).write_bytes(b"\xff\xd8\xff")
    return folder / "photos"


NUMBERS: Final = list(range(1, len(HILL) + 1))
COLOURS: Final = RGB.T.tolist()
TRUTH: Final = ("--units", "m")
FEET: Final = AT_UTM / FOOT_M
CASES: Final = (
    # What is stated, and right.
    Case("LAZ in UTM", lambda d: las(d / "a.laz", AT_UTM, "EPSG:32614"), BUILT, "published"),
    Case("LAS in feet of its CRS",
         # Of Texas, and the hill stands in Mexico: that is warned of.
         lambda d: las(d / "a.las", in_crs("EPSG:2278"), "EPSG:2278"),
         WARNED, "converted to metres"),
    Case("New York in ftUS, heights too",
         lambda d: las(d / "a.las", AT_NEW_YORK / (1200 / 3937), "EPSG:2263"),
         BUILT, "converted to metres"),
    Case("UTM with heights in ftUS",
         lambda d: las(d / "a.las", AT_UTM / (1, 1, 1200 / 3937), "EPSG:26914+6360"),
         BUILT, "height unit 0.304"),
    # Units and CRS that nobody states, or wrongly.
    Case("LAS in feet, no CRS", lambda d: las(d / "a.las", FEET), REFUSED, "look like feet"),
    Case("the same with --units ft",
         lambda d: las(d / "a.las", FEET), BUILT, "converted to metres", ("--units", "ft")),
    Case("LAS in feet, CRS in metres",
         lambda d: las(d / "a.las", FEET, "EPSG:32614"), REFUSED, "within it in us-ft"),
    Case("metres under a CRS in feet",
         lambda d: las(d / "a.las", AT_NEW_YORK, "EPSG:2263"),
         REFUSED, "add --units m"),
    Case("XYZ of UTM, no CRS",
         lambda d: text(d / "a.xyz", [*columns_of(AT_UTM), *COLOURS]), WARNED, "taken as metres"),
    Case("the same with --crs",
         lambda d: text(d / "a.xyz", [*columns_of(AT_UTM), *COLOURS], header="x y z r g b"),
         BUILT, "published", ("--crs", "EPSG:32614")),
    Case("local frame", lambda d: ply(d / "a.ply", HILL), WARNED, "no colour"),
    Case("degrees, no CRS", lambda d: las(d / "a.las", degrees(), step=1e-8), REFUSED, "degrees"),
    Case("latitude before longitude, and --units m",
         lambda d: text(d / "a.csv", columns_of(degrees()[:, [1, 0, 2]], 8), ","),
         REFUSED, "no surface is left", TRUTH),
    Case("degrees as stated",
         lambda d: las(d / "a.las", degrees(), "EPSG:4326", step=1e-8), REFUSED, "degrees"),
    Case("degrees in a text with header",
         lambda d: text(d / "a.csv", columns_of(degrees(), 8), ",", "lon,lat,height"),
         REFUSED, "degrees"),
    Case("degrees in a text without",
         lambda d: text(d / "a.csv", columns_of(degrees(), 8), ","), REFUSED, "look like degrees"),
    Case("latitude before longitude",
         lambda d: text(d / "a.csv", columns_of(degrees()[:, [1, 0, 2]], 8), ","),
         REFUSED, "look like degrees"),
    Case("UTM under a CRS in degrees",
         lambda d: las(d / "a.las", AT_UTM, "EPSG:4326"), WARNED, "cannot be that"),
    Case("Web Mercator", lambda d: las(d / "a.las", in_crs("EPSG:3857"), "EPSG:3857"),
         REFUSED, "reproject it"),
    Case("x and y swapped", lambda d: las(d / "a.las", AT_UTM[:, [1, 0, 2]], "EPSG:32614"),
         REFUSED, "mirror image"),
    Case("an unknown --crs", lambda d: las(d / "a.las", AT_UTM),
         REFUSED, "expected one that PROJ knows", ("--crs", "EPSG:99999")),
    # Columns of texts.
    Case("number, northing, easting, height",
         lambda d: text(d / "a.txt", [NUMBERS, *columns_of(AT_UTM[:, [1, 0, 2]])]),
         REFUSED, "counts the points"),
    Case("the same with --columns",
         lambda d: text(d / "a.txt", [NUMBERS, *columns_of(AT_UTM[:, [1, 0, 2]])]),
         WARNED, "no colour", ("--columns", "-,y,x,z", "--units", "m")),
    Case("point names",
         lambda d: text(d / "a.txt", [[f"P{n}" for n in NUMBERS], *columns_of(AT_UTM)], ","),
         REFUSED, "is text"),
    Case("--columns too few", lambda d: text(d / "a.txt", [*columns_of(AT_UTM), *COLOURS]),
         REFUSED, "6 columns", ("--columns", "x,y,z")),
    Case("--columns of a LAS", lambda d: las(d / "a.las", AT_UTM),
         REFUSED, "expected a text", ("--columns", "x,y,z")),
    Case("birds and dust, classified as noise", noisy, WARNED, "marked in the survey", TRUTH),
    Case("German header, decimal commas",
         lambda d: text(d / "a.csv", [[v.replace(".", ",") for v in c] for c in columns_of(AT_UTM)],
                        ";", "Rechtswert;Hochwert;Höhe"),
         WARNED, "no colour", TRUTH),
    Case("commas of thousands",
         lambda d: text(d / "a.csv", [[f"{v:,.2f}" for v in axis] for axis in AT_UTM.T], ","),
         REFUSED, "error"),
    Case("prose", lambda d: text(d / "a.txt", [["It", "rained"], ["on", "us"], ["all", "day"]]),
         REFUSED, "not followed by rows of numbers"),
    # Points that are not the ground.
    Case("one point at 0 0 0",
         lambda d: las(d / "a.las", stray((0, 0, 0)), "EPSG:32614", None, 1e-2),
         WARNED, "1 of 3,001 points lie more than 100 km"),
    Case("a hundred points at 0 0 0",
         lambda d: las(d / "a.las", stray(*np.zeros((100, 3))), "EPSG:32614", None, 1e-2),
         REFUSED, "expected one site"),
    Case("one point 3 km above",
         lambda d: las(d / "a.las", stray((480_000, 2_210_000, 4_200)), "EPSG:32614", None),
         WARNED, "no colour"),
    Case("damaged exponents",
         lambda d: text(d / "a.xyz", columns_of(stray((4e30, 1, 1)), 1)),
         WARNED, "1 of 3,001 points lie more than 100 km"),
    Case("NaN in a tenth of the rows",
         lambda d: text(d / "a.xyz", [*columns_of(np.where(np.arange(3000)[:, None] % 10, AT_UTM,
                                                           np.nan)), *COLOURS]),
         WARNED, "no finite coordinates", TRUTH),
    Case("every point three times", lambda d: las(d / "a.las", np.repeat(AT_UTM, 3, 0),
         "EPSG:32614", np.repeat(RGB, 3, 0)), BUILT, "published"),
    Case("twenty points", lambda d: las(d / "a.las", AT_UTM[:20], "EPSG:32614", RGB[:20]),
         REFUSED, "error"),
    Case("points on one line",
         lambda d: las(d / "a.las", UTM + np.linspace(0, 40, 3000)[:, None] * (1, 1, 0),
                       "EPSG:32614"), REFUSED, "error"),
    Case("whole metres",
         lambda d: las(d / "a.las", np.rint(AT_UTM), "EPSG:32614", step=1.0),
         WARNED, "in steps of 1"),
    # Files that are something else.
    Case("no bytes", lambda d: text(d / "a.laz", [[]]) and cut(d / "a.laz", 0), REFUSED, "empty"),
    Case("a LAZ cut short",
         lambda d: cut(las(d / "a.laz", AT_UTM, "EPSG:32614"), 0.6), REFUSED, "error"),
    Case("a ZIP called .laz", zipped, REFUSED, "ZIP"),
    Case("a web page called .laz",
         lambda d: text(d / "a.laz", [["<!DOCTYPE html>"]]), REFUSED, "web page"),
    Case("a picture called .las",
         lambda d: (d / "a.las").write_bytes(b"\xff\xd8\xff\xe0" * 99) and d / "a.las",
         REFUSED, "error"),
    Case("no such file", lambda d: d / "none.laz", REFUSED, "no file"),
    Case("a folder of photos", photos, REFUSED, "no survey"),
    Case("a pattern that matches nothing", lambda d: d / "*.laz", REFUSED, "no file matches"),
    # Deliveries.
    Case("two CRS in one folder",
         lambda d: (tile(d, "a.laz", AT_UTM), tile(d, "b.laz", in_crs("EPSG:32613"),
                                                   "EPSG:32613"))[0],
         REFUSED, "coordinate reference systems"),
    Case("a tile of another site",
         lambda d: (tile(d, "a.laz", AT_UTM), tile(d, "b.laz", AT_UTM + AWAY))[0],
         REFUSED, "km from the other files"),
    Case("tiles beside the merged file",
         lambda d: (tile(d, "a.laz", AT_UTM), tile(d, "b.laz", AT_UTM))[0], BUILT, "published"),
    Case("an extent elsewhere", lambda d: las(d / "a.las", AT_UTM, "EPSG:32614"),
         REFUSED, "no point within", ("--extent", "0", "0", "9", "9")),
)  # fmt: skip


def run(case: Case, folder: Path) -> tuple[str, str, str]:
    """Build a case; return outcome, the first line that explains it, and what is wrong with it."""
    given, scene = case.write(folder), folder / "scene"
    app = typer.Typer()
    register(app)
    command = [str(given), "-o", str(scene), "--no-report", "--base-faces", "800", *case.options]
    result = CliRunner().invoke(app, command)
    said = " ".join(result.output.split())
    lines = [line for line in result.output.splitlines() if line.startswith(("error", "warning"))]
    warnings = [line for line in lines if line.startswith("warning")]
    outcome = REFUSED if result.exit_code else WARNED if warnings else BUILT
    line = (lines or [said[-100:]])[0]
    # What must hold of every outcome, expected or not.
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return outcome, line, f"raised {result.exception!r}"
    if "nobody foresaw" in said:
        return outcome, line, "was not foreseen"
    if outcome == REFUSED and (scene / "scene.json").exists():
        return outcome, line, "refused, and published"
    if outcome != REFUSED:
        with Scene.open(scene) as opened:
            low, high = opened.manifest.bounds.min, opened.manifest.bounds.max
        sides = [high[axis] - low[axis] for axis in (0, 2)]
        if any(abs(side - SIDE_M) > EDGE_M for side in sides):
            return outcome, line, f"is {sides[0]:.3g} by {sides[1]:.3g} m"
    if outcome != case.outcome:
        return outcome, line, f"expected {case.outcome}"
    return outcome, line, "" if case.words in said else f"says nothing of {case.words!r}"


def main() -> int:
    """Run the cases, print the table, and return how many went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases whose names have this")
    parser.add_argument("--smoke", action="store_true", help="every fifth case")
    options = parser.parse_args()
    cases = [case for case in CASES if options.only in case.name][:: 5 if options.smoke else 1]
    wrong = 0
    print("| given | outcome | what is said |\n| -- | -- | -- |")
    for case in cases:
        folder = Path(tempfile.mkdtemp(prefix="odd-"))
        try:
            outcome, line, problem = run(case, folder)
        finally:
            shutil.rmtree(folder)
        line = line.replace(f"{folder}/", "").replace("|", "/")
        print(f"| {case.name} | {outcome} | {line[:150]} |{f'  WRONG: {problem}' * bool(problem)}")
        sys.stdout.flush()
        wrong += bool(problem)
    print(f"\n{len(cases)} cases, {wrong} wrong")
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
