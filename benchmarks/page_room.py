"""How many pages a landing is drawn from, and what room they take, by how pages are kept.

::

    python benchmarks/page_room.py [--landings 200] [--seed 1]

A walk of landings with 200 segments each over a made grid of 4,096, whose segments have 200 to
1,050 vertices. What a landing hides stays while it is within the spare share of the viewer (an
eighth of the device's, beside two landings). A page has at most 65,535 vertices, for indices of 16
bits, and at most 64 ranges. No browser: only what is where is followed. Told per rule are the
landings' draw calls, the most room for what lives, and what is copied for what is uploaded.
"""

from __future__ import annotations

import argparse
import math
import random
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final

SIDE: Final = 64
SHOWN: Final = 200
MAX_VERTICES: Final = 65_535
MAX_RANGES: Final = 64
SPARE_SHARE: Final = (1 / 8) / (7 / 16)
"""Spare room for the room of one landing: core/gpu-budget.ts."""
RULES: Final = {
    "a page per landing, never compacted": (False, 0.0),
    "a page per landing, compacted below a half": (False, 0.5),
    "a page per landing, compacted below three quarters": (False, 0.75),
    "open pages, never compacted": (True, 0.0),
    "open pages, compacted below a half": (True, 0.5),
    "open pages, compacted below three quarters": (True, 0.75),
}
"""Whether a landing goes on with the last page, which has all its room; live share to keep."""


@dataclass(eq=False)
class Page:
    """Room on the GPU; its segments in the order of their ranges."""

    room: int
    used: int = 0
    live: set[int] = field(default_factory=set)


class Pages:
    """Which segment lies where. ``vertices[segment]`` is its room."""

    def __init__(self, vertices: list[int], is_open: bool, least_share: float) -> None:
        self.vertices = vertices
        self.is_open = is_open
        self.least_share = least_share
        self.page_of: dict[int, Page] = {}
        self.pages: list[Page] = []
        self.copied = 0

    def add(self, segments: list[int]) -> None:
        """Give these room, in this order."""
        page = self.pages[-1] if self.pages and self.is_open else None
        closed: list[Page] = []
        for segment in segments:
            size = self.vertices[segment]
            if page is None or page.used + size > page.room or len(page.live) == MAX_RANGES:
                page = Page(MAX_VERTICES)
                self.pages.append(page)
                closed.append(page)
            page.used += size
            page.live.add(segment)
            self.page_of[segment] = page
        if not self.is_open:
            for made in closed:  # exactly as large as the batch: it is known before the upload
                made.room = made.used

    def free(self, segments: list[int]) -> None:
        """Take these away, then move what is left of sparse pages together."""
        for segment in segments:
            self.page_of.pop(segment).live.discard(segment)
        self.pages = [page for page in self.pages if page.live]
        sparse = [page for page in self.pages if self._share(page) < self.least_share]
        if self.is_open and self.pages[-1:] == sparse[-1:]:
            sparse = sparse[:-1]  # it is still being filled
        if sparse:
            moved = [segment for page in sparse for segment in sorted(page.live)]
            self.pages = [page for page in self.pages if page not in sparse]
            self.copied += sum(self.vertices[segment] for segment in moved)
            self.add(moved)

    def _share(self, page: Page) -> float:
        return sum(self.vertices[segment] for segment in page.live) / page.room

    @property
    def room(self) -> int:
        """Vertices that all pages have room for."""
        return sum(page.room for page in self.pages)


def walk(pages: Pages, landings: int, seed: int) -> tuple[list[int], float, float]:
    """Draw calls of each landing, most room by what lives, copied by what was uploaded."""
    chance = random.Random(seed)
    radius = math.sqrt(SHOWN / math.pi)
    x = z = SIDE / 2
    draws: list[int] = []
    most_room = 0.0
    uploaded = 0
    hidden: OrderedDict[int, None] = OrderedDict()
    spare = SPARE_SHARE * SHOWN * sum(pages.vertices) / len(pages.vertices)
    for _ in range(landings):
        by_distance = sorted(
            range(SIDE * SIDE), key=lambda s: math.hypot(s % SIDE - x, s // SIDE - z)
        )
        shown = by_distance[:SHOWN]
        new = [segment for segment in shown if segment not in pages.page_of]
        uploaded += sum(pages.vertices[segment] for segment in new)
        pages.add(new)
        for segment in sorted(set(pages.page_of) - set(shown) - set(hidden)):
            hidden[segment] = None
        for segment in shown:
            hidden.pop(segment, None)
        freed = []
        while sum(pages.vertices[segment] for segment in hidden) > spare:
            freed.append(hidden.popitem(last=False)[0])
        pages.free(freed)
        draws.append(len({id(pages.page_of[segment]) for segment in shown}))
        live = sum(pages.vertices[segment] for segment in pages.page_of)
        most_room = max(most_room, pages.room / live)
        turn, hop = chance.uniform(0, math.tau), chance.uniform(0, 2 * radius)
        x = min(max(x + hop * math.cos(turn), 0), SIDE)
        z = min(max(z + hop * math.sin(turn), 0), SIDE)
    return draws, most_room, pages.copied / uploaded


def main() -> None:
    """Walk by each rule, and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--landings", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--smoke", action="store_true", help="ten landings")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    vertices = [chance.randint(200, 1050) for _ in range(SIDE * SIDE)]
    print(f"{'':52} draws: median most   room/live   copied/uploaded")
    for name, rule in RULES.items():
        landings = 10 if options.smoke else options.landings
        draws, room, copied = walk(Pages(vertices, *rule), landings, options.seed)
        median = sorted(draws)[len(draws) // 2]
        print(f"{name:52} {median:13} {max(draws):4} {room:11.2f} {copied:17.2f}")


if __name__ == "__main__":
    main()
