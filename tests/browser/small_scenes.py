"""Two scenes for the viewer's tests: few triangles, because the browser draws them by CPU.

They are committed as built: processors round the last digit of a survey differently, and other
regions have other colours. ``python tests/browser/small_scenes.py`` builds them anew, for instance
when the format of scenes changes.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Final

from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.flight import seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import write_photos
from terraport_pipeline.workflow.build import BuildOptions, build

__all__ = ["PHOTOGRAPHED", "SMALL", "small_scenes"]

SMALL: Final = "small"
"""Some 40,000 triangles in 200 segments (packages decide), ``grade``, vertex colours."""
PHOTOGRAPHED: Final = "photographed"
"""As many triangles, with textures."""

SEGMENT: Final = segment.Options(max_extent_m=36.0)
"""So that a landing of 60 m has dozens of segments, and one beside it shares some of them."""
FLIGHT: Final = FlightOptions(count=12, width=480, height=360)


BUILT: Final = Path(__file__).with_name("built_scenes")


def small_scenes(folder: Path) -> Path:
    """Copy both scenes into a folder; returns the folder of scenes in it."""
    return Path(shutil.copytree(BUILT, folder / "scenes"))


def build_scenes() -> None:
    """Build both scenes anew: half a minute."""
    with tempfile.TemporaryDirectory() as work:
        _build_small(Path(work))
        _build_photographed(Path(work))
        shutil.rmtree(BUILT, ignore_errors=True)
        shutil.copytree(Path(work) / "scenes", BUILT)


def _build_small(work: Path) -> None:
    survey = work / "small.laz"
    write_quarry(QuarryOptions(points=22_000, seed=3), survey)
    reconstruction = reconstruct.Options(base_faces=9_000)
    scene = work / "scenes" / SMALL
    build(BuildOptions(survey, scene, "Small quarry", segment=SEGMENT, reconstruct=reconstruction))


def _build_photographed(work: Path) -> None:
    survey, photos = work / "photographed.laz", work / "photos"
    options = seen_by(FLIGHT, QuarryOptions(points=12_000, seed=3))
    write_quarry(options, survey)
    write_photos(options, FLIGHT, photos, survey=survey.name)
    build(
        BuildOptions(
            survey,
            work / "scenes" / PHOTOGRAPHED,
            "Small quarry, photographed",
            segment=SEGMENT,
            reconstruct=reconstruct.Options(base_faces=5_000),
            texture=Texturing(photos=photos / "images", cameras=photos / "colmap"),
        )
    )


if __name__ == "__main__":
    build_scenes()
