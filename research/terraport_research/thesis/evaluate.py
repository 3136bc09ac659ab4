"""``terraport evaluate thesis``: makes pages, keeps those made before, writes them all."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from terraport_pipeline.errors import PipelineError
from terraport_pipeline.progress import NullProgress, Progress
from terraport_research.booklet import Booklet, read_pages, write_pages
from terraport_research.booklet_model import Page
from terraport_research.options import PAGES, ThesisOptions
from terraport_research.thesis.bodies import make_bodies
from terraport_research.thesis.depths import make_depths
from terraport_research.thesis.landscapes import make_landscapes
from terraport_research.thesis.making import Maker
from terraport_research.thesis.people import make_people
from terraport_research.thesis.photos import make_photos
from terraport_research.thesis.pools import make_pools
from terraport_research.thesis.run_times import make_run_times

__all__ = ["evaluate_thesis"]

_BOOKLET: Final = Booklet(
    "thesis",
    "terraport evaluate thesis",
    "The thesis's tables and figures, made again",
    "In brackets, and as grey bars: what the thesis printed. Every number says what it was made "
    "with.",
)
_MAKERS: Final[dict[str, Maker]] = {
    "bodies": make_bodies,
    "landscapes": make_landscapes,
    "pools": make_pools,
    "run-times": make_run_times,
    "depths": make_depths,
    "photos": make_photos,
}


def evaluate_thesis(
    options: ThesisOptions, folder: Path, progress: Progress | None = None
) -> tuple[list[Page], list[str]]:
    """Make pages and write them with those that were made before.

    Parameters
    ----------
    options : ThesisOptions
    folder : Path
        Results are kept there: after each page, so that an interrupted run loses one at most.
    progress : Progress, optional

    Returns
    -------
    pages : list of Page
        All that the folder has now.
    left_out : list of str
        Pages that could not be made, and why.

    Raises
    ------
    SurveyError
        The folder's results are damaged.
    """
    watcher = progress or NullProgress()
    pages = read_pages(folder, _BOOKLET)
    left_out = []
    for key in options.pages:
        try:
            if key == "people":
                made = make_people(options.scores or folder / "segmentation.json")
            else:
                made = _MAKERS[key](options, watcher)
        except PipelineError as error:
            left_out.append(f"{key}: {error}")
            continue
        pages[key] = made.page
        write_pages(_ordered(pages), made.pictures, folder, _BOOKLET)
    write_pages(_ordered(pages), {}, folder, _BOOKLET)
    return _ordered(pages), left_out


def _ordered(pages: dict[str, Page]) -> list[Page]:
    return [pages[key] for key in PAGES if key in pages]
