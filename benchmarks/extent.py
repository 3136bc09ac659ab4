"""What an extent costs against the whole survey: time and bytes, by the index of the file.

The same points as COPC, as LAZ with a LASindex, as LAZ without one and as the delivery that they
come from, each read for a square in the middle that holds about a share of the ground. What is
timed is the first step of a build (headers, hash, points to sorted columns), and its bytes are
those that reading and hashing take from the files; every extent must give the same columns.

    python benchmarks/extent.py DELIVERY [--share 0.01] [--keep FOLDER]
    python benchmarks/extent.py --smoke                      100 k points of a hill
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np

from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.workflow.read_step import look_at_survey, read_once
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.workdir import WorkDirectory

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from pipeline.indexed_files import lasindex, strips, write_chunks, write_copc
from pipeline.laz_files import Hill, write_tiles

_CHUNK = 50_000
"""Points of a chunk: what LAZ writers take."""


def middle_of(survey: SurveyFiles, share: float) -> Extent:
    """Square of a share of the ground, in the middle of the survey's box."""
    _, heads = survey.heads(NullProgress())
    low = np.min([head.low for head in heads], axis=0)[:2]
    high = np.max([head.high for head in heads], axis=0)[:2]
    half = np.sqrt(share * np.prod(high - low)) / 2
    middle = (low + high) / 2
    return Extent(*(middle - half), *(middle + half))


def write_forms(delivery: Path, folder: Path, chunk: int) -> dict[str, Path]:
    """Write the delivery's points in all forms; those that are there stay."""
    forms = {
        "LAZ tiles": delivery,
        "LAZ": folder / "plain" / "survey.laz",
        "LAZ, LASindex": folder / "indexed" / "survey.laz",
        "COPC": folder / "copc" / "survey.copc.laz",
    }
    if all(path.exists() for path in forms.values()):
        return forms
    parts = [laspy.read(path) for path in sorted(delivery.glob("*.laz"))]
    header = parts[0].header
    points = laspy.ScaleAwarePointRecord.zeros(sum(map(len, parts)), header=header)
    for number, first in enumerate(np.cumsum([0, *map(len, parts)])[:-1]):
        rows = slice(first, first + len(parts[number]))
        points.array[rows] = parts[number].points.array
        # Tiles have offsets of their own.
        for axis, offset in zip("XYZ", parts[number].header.offsets - header.offsets, strict=True):
            step = header.scales["XYZ".index(axis)]
            points.array[axis][rows] += np.rint(offset / step).astype(np.int32)
    las = laspy.LasData(header, points)
    for path in forms.values():
        path.parent.mkdir(parents=True, exist_ok=True)

    # Strips some metres wide: what a flight's lines look like to an index.
    xyz = np.stack([las.x, las.y], axis=1)
    lines = strips(xyz, float(np.ptp(xyz[:, 0])) / 100, chunk)
    write_chunks(forms["LAZ"], las, lines)
    shutil.copy(forms["LAZ"], forms["LAZ, LASindex"])
    index = lasindex(las, np.concatenate(lines), levels=7, least=0, gap=1000)
    forms["LAZ, LASindex"].with_suffix(".lax").write_bytes(index)
    write_copc(forms["COPC"], las, node_points=chunk)
    return forms


def measure(
    path: Path, extent: Extent | None, folder: Path
) -> tuple[float, float, int, int, int, str]:
    """Read once; return seconds and CPU seconds, bytes, points decoded and taken, and digest."""
    runner = Runner(WorkDirectory(folder), False, NullProgress(), 2, 8 << 30)
    started, cpu_started = time.perf_counter(), time.process_time()
    survey, heads = look_at_survey(runner, find_survey(path, extent=extent))
    record = read_once(runner, survey, max_points=None, bounded=True)
    seconds, cpu_s = time.perf_counter() - started, time.process_time() - cpu_started
    sizes = {file.path: file.bytes for file in survey.files}
    read = sum(
        size if head.ranges is None else sum(end - begin for begin, end in head.ranges)
        for size, head in zip(sizes.values(), heads, strict=True)
    )
    read += sum(beside.stat().st_size for beside in path.parent.glob("*.lax") if extent)
    decoded = sum(head.points if head.rows is None else head.rows for head in heads)
    shutil.rmtree(folder)
    return seconds, cpu_s, read, decoded, record.facts.counts["points"], record.digest


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("delivery", type=Path, nargs="?")
    parser.add_argument("--share", type=float, nargs="+", default=[0.01])
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.delivery is None and not arguments.smoke:
        parser.error("a folder of LAZ files, or --smoke")
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-extent-"))
    try:
        delivery, chunk = arguments.delivery, _CHUNK
        if arguments.smoke:
            write_tiles(folder / "tiles", Hill(100_000), tiles=8)
            delivery, chunk = folder / "tiles", 1000
        forms = write_forms(delivery, folder, chunk)
        survey = find_survey(forms["LAZ tiles"])
        extents: dict[str, Extent | None] = {"all": None}
        extents |= {f"{share:.3%}": middle_of(survey, share) for share in arguments.share}
        print("| extent | form | s | CPU s | MB read | points decoded | points taken |")
        print("| -- | -- | -- | -- | -- | -- | -- |")
        for title, extent in extents.items():
            digests = set()
            for form, path in forms.items():
                seconds, cpu_s, read, decoded, points, digest = measure(
                    path, extent, folder / "work"
                )
                digests.add(digest)
                print(
                    f"| {title} | {form} | {seconds:,.2f} | {cpu_s:,.2f} | "
                    f"{read / 1e6:,.1f} | {decoded:,} | {points:,} |",
                    flush=True,
                )
            if len(digests) > 1:
                sys.exit(f"{title}: the forms differ")
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder)


if __name__ == "__main__":
    main()
