"""Time and peak memory of a build, per stage, on a synthetic quarry or on a survey.

python benchmarks/build.py                       250 k points
python benchmarks/build.py --points 1000000
python benchmarks/build.py --survey FILE --keep DIRECTORY
python benchmarks/build.py --smoke               20 k points
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from rich.console import Console

from terraport_pipeline.progress import RichProgress
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.workflow.build import BuildOptions, build


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=250_000)
    parser.add_argument("--survey", type=Path)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--keep", type=Path, help="folder for the scene; deleted when not given")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-build-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        survey = arguments.survey
        if survey is None:
            points = 20_000 if arguments.smoke else arguments.points
            survey = folder / "quarry.laz"
            write_quarry(QuarryOptions(points=points), survey, overwrite=True)
        with RichProgress() as progress:
            report = build(
                BuildOptions(survey, folder / survey.stem, threads=arguments.threads, resume=False),
                progress,
            )
        Console().print(report.table())
        print(json.dumps({stage.name: stage.facts.counts for stage in report.stages}))
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
