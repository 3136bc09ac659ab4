"""What ground is called and part of, over a running service: picks, larger pieces, places."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from pipeline.naming.named_ground import FACTS, square, write_geojson, write_named_ground

import terraport
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.progress import NullProgress
from terraport_server import BackgroundServer
from terraport_store import change_labels


@pytest.fixture
def pit(tmp_path: Path) -> Path:
    """Two regions that are one at cost 1.5; a plan has cut a pit out of both."""
    (tmp_path / "scenes").mkdir()
    scene = write_named_ground(
        tmp_path / "scenes" / "pit", facts={**FACTS, "unions": [[0, 1, 1.5]]}
    )
    change_labels(scene, {4: "west farm", 7: "east farm"})
    plan = write_geojson(tmp_path / "p.geojson", [("pit", square(40, -60, 70, -10))])
    label_by_plan(scene, plan, NullProgress())
    return scene


def test_a_pick_says_what_ground_is_called_and_part_of(pit: Path) -> None:
    with BackgroundServer(pit.parent) as server:
        asyncio.run(asyncio.wait_for(visit(f"{server.url}/scenes/pit"), 60))


async def visit(url: str) -> None:
    async with terraport.connect(url) as session:
        inside = await session.pick((60.0, 50.0, 30.0))
        outside = await session.pick((20.0, 50.0, 30.0))
        assert inside is not None
        assert outside is not None
        assert (inside.label, outside.label) == ("pit", "west farm")
        (of_pit, whole) = await session.coarser(inside.region)
        assert (of_pit.cost, whole.cost) == (1.0, 1.5)
        assert of_pit.label == "west farm"  # what the pit was cut out of, mostly
        assert len(whole.regions) == 3
        assert whole.area_m2 > of_pit.area_m2 > 30.0 * 50.0
        (place,) = [p for p in await session.places() if p.label == "pit"]
        assert place.is_view
        landing = await session.land(place.position, place.radius_m)
        segments = [segment async for segment in landing]
        assert segments
        there = await session.pick(place.position)
        assert there is not None
        assert there.label == "pit"
