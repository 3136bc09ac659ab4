"""Make the scene that comes along, ``data/sample_scene``: a bench of the sample quarry, 36 m wide.

::

    python data/make_sample_scene.py        two to four minutes on two cores

Surveyed as from a drone that flies 15 m above the ground: samples 8 cm apart, pixels of 1.7 cm.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.progress import RichProgress
from terraport_pipeline.report.report import ReportOptions, write_report
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import write_photos
from terraport_pipeline.workflow.build import BuildOptions, build

TARGET = Path(__file__).with_name("sample_scene")
MAX_BYTES = 6_000_000

QUARRY = QuarryOptions(
    points=220_000,
    window_m=36.0,
    window_east_m=-72.0,
    window_north_m=54.0,
    noise_m=0.004,
    colour_noise=2.0,
    outlier_fraction=0.0,
    holes=0,
    uneven=0.0,
)
FLIGHT = FlightOptions(
    count=72, width=1000, height=750, exposure_drift_ev=0.1, vignetting=0.05, truck=False
)


def main() -> None:
    """Survey, build, and put the published version in place."""
    with tempfile.TemporaryDirectory() as name, RichProgress() as progress:
        folder = Path(name)
        quarry = seen_by(FLIGHT, QUARRY)
        cloud = write_quarry(quarry, folder / "bench.laz", overwrite=True, progress=progress)
        photos = folder / "photos"
        write_photos(quarry, FLIGHT, photos, survey="bench.laz", progress=progress)
        scene = folder / "bench"
        build(
            BuildOptions(
                cloud.survey_path,
                scene,
                name="A bench of the sample quarry",
                texture=Texturing(photos=photos / "images", cameras=photos / "colmap"),
            ),
            progress,
        )
        # The pages about it tell times of this machine; its small picture comes along.
        report = write_report(scene, options=ReportOptions(rays=0), progress=progress)
        for file in (report.path, report.pdf_path, scene / "build.json"):
            file.unlink()
        size = sum(file.stat().st_size for file in scene.rglob("*") if file.is_file())
        if size > MAX_BYTES:
            raise SystemExit(f"the scene has {size:,} bytes, expected at most {MAX_BYTES:,}")
        shutil.rmtree(TARGET, ignore_errors=True)
        shutil.copytree(scene, TARGET)
    sys.stdout.write(f"{TARGET.name}: {size:,} bytes\n")


if __name__ == "__main__":
    main()
